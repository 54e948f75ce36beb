//! What the windows have taught: weighted normal equations with the noise in them, and a covariance that follows.
//!
//! One window gives per axis the rows `N = D x + e` of the test functions of a [`Bank`]. The memory adds them up,
//!
//! ```text
//! P = Σ w DᵀD        h = Σ w DᵀN        w = e^{−γ age}
//! ```
//!
//! and knows what noise does to these sums. To first order in the noise `n_a` of the positions (a = y, z; standard
//! deviation σ_z) and `n_k` of the currents (σ_i) a row of axis a has, with `u_k = i_k²/gap_k²` and node weights `g_z`, `g_u`,
//!
//! ```text
//! δN_a  = Σ_j g_z n_a                    δD_a,k = c_k dir_k,a Σ_j g_u (2 u_k/gap_k dir_k·n + 2 i_k/gap_k² n_k)
//! ```
//!
//! Three things follow exactly, without an assumption on how windows overlap:
//!
//! * **bias**: `E[δDᵀδD]` and `E[δDᵀδN]` are known sums over the nodes, per σ_z² and per σ_i². They are taken off P and h
//!   (compensated least squares), so that noise in the regressors does not draw λ̂ towards zero;
//! * **covariance**: the score `Σ w Dᵀ e` is linear in the noise of every single sample. Its coefficients are gathered
//!   sample by sample while the windows pass (`Memory::nodes`), so that `cov x̂ = P⁻¹ (σ_z² M_z + σ_i² M_i) P⁻¹` counts
//!   every sample once, however many windows it stands in;
//! * **noise level**: `E[Σ w |e|²] = Σ σ² (T − tr P⁻¹M)`, from which an unknown σ is found.

use nalgebra::{SMatrix, SVector};
use serde::{Deserialize, Serialize};

use super::kernel::Weights;
use super::regression::{MAX_UNKNOWNS, NormalMatrix, NormalVector};

/// The most test functions per axis.
pub const MAX_FUNCTIONS: usize = 12;

/// The rows of both axes for one window, y first; rows not in use are zero.
pub type Regressors = SMatrix<f64, { 2 * MAX_FUNCTIONS }, MAX_UNKNOWNS>;
/// The left-hand sides that belong to them.
pub type Targets = SVector<f64, { 2 * MAX_FUNCTIONS }>;

/// Test functions for the weighted least squares, and the noise profile that goes with them.
#[derive(Clone, Debug, PartialEq)]
pub struct Bank {
    /// Weights of the test functions, made so that nominal noise gives every row the variance one, and rows of one window
    /// no correlation.
    pub rows: Vec<Weights>,
    /// Weight of a current sample in each row, `held_start + held_end` or `node`.
    pub current: Vec<Vec<f64>>,
    /// `Σ g_z²`, `Σ g_z g_u`, `Σ g_u²` over the rows, per node.
    pub profile: Vec<[f64; 3]>,
}

impl Bank {
    /// The test functions of [`Weights::sines`] for windows of that many intervals; `position` and `current` are the nominal
    /// noise of a position and of `∫ dτ`-ed acceleration times T_f², in the same unit.
    #[must_use]
    pub fn new(intervals: usize, continuous: bool, position: f64, current: f64) -> Self {
        let rows = Weights::sines(intervals, MAX_FUNCTIONS, position, current);
        let current: Vec<Vec<f64>> = rows
            .iter()
            .map(|row| {
                if continuous {
                    row.node.clone()
                } else {
                    row.held_start.iter().zip(&row.held_end).map(|(a, b)| a + b).collect()
                }
            })
            .collect();
        let profile = (0..=intervals)
            .map(|j| {
                let mut sums = [0.0; 3];
                for (row, current) in rows.iter().zip(&current) {
                    let (z, u) = (row.position[j], current[j]);
                    sums[0] += z * z;
                    sums[1] += z * u;
                    sums[2] += u * u;
                }
                sums
            })
            .collect();
        Self { rows, current, profile }
    }

    /// `Σ g_z·(T g_z)/Σ g_z²` over the rows, dimensionless: how much of their position noise a loop follows whose complementary
    /// sensitivity T is a low-pass of second order that forgets to the part `keep` in a sample. Below 0 where it lags
    /// by more than a quarter turn.
    #[must_use]
    pub fn followed(&self, keep: f64) -> f64 {
        let (mut both, mut own) = (0.0, 0.0);
        for row in &self.rows {
            let mut lag = [0.0; 2];
            for g in &row.position {
                lag[0] = keep * lag[0] + (1.0 - keep) * g;
                lag[1] = keep * lag[1] + (1.0 - keep) * lag[0];
                both += g * lag[1];
                own += g * g;
            }
        }
        if own > 0.0 { both / own } else { 0.0 }
    }
}

/// What noise does at the nodes of a window, seen through λ.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sensitivity {
    /// Row per unit of `g_u` for the noise of a position: `T_f²/m Σ λ_k 2 u_k/gap_k dir_k dir_kᵀ`, yy, yz, zz.
    pub stiffness: [f64; 3],
    /// Row per unit of `g_u` for the noise of the current k: `T_f²/m λ_k 2 i_k/gap_k²`, 1/A times metre.
    pub current: [f64; 3],
}

/// Weighted sums over windows.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Sums {
    /// `Σ w DᵀD`.
    pub p: NormalMatrix,
    /// `Σ w DᵀN`.
    pub h: NormalVector,
    /// `Σ w |N|²`.
    pub square: f64,
    /// `Σ w (|N_y|² − |N_z|²)` and `Σ w 2 N_y·N_z`.
    pub shape: [f64; 2],
    /// The squares of what each column would be if nothing cancelled.
    pub level: [f64; 3],
    /// Expected `Σ w δDᵀδD` per σ_z².
    pub p_position: NormalMatrix,
    /// Expected `Σ w δDᵀδN` per σ_z².
    pub h_position: NormalVector,
    /// Expected `Σ w δDᵀδD` per σ_i², a diagonal.
    pub p_current: NormalVector,
    /// Expected `Σ w |e|²` per σ_z² and per σ_i², before anything is fitted.
    pub trace: [f64; 2],
}

impl Sums {
    /// `self · keep + other`.
    pub fn blend(&mut self, keep: f64, other: &Self) {
        self.p = self.p * keep + other.p;
        self.h = self.h * keep + other.h;
        self.square = self.square * keep + other.square;
        self.p_position = self.p_position * keep + other.p_position;
        self.h_position = self.h_position * keep + other.h_position;
        self.p_current = self.p_current * keep + other.p_current;
        for k in 0..3 {
            self.level[k] = self.level[k] * keep + other.level[k];
        }
        for k in 0..2 {
            self.trace[k] = self.trace[k] * keep + other.trace[k];
            self.shape[k] = self.shape[k] * keep + other.shape[k];
        }
    }

    /// Whether every sum is below `limit` in magnitude, and none is NaN.
    #[must_use]
    pub fn is_below(&self, limit: f64) -> bool {
        let all = self.p.iter().chain(self.h.iter()).chain(self.p_position.iter()).chain(self.h_position.iter());
        let scalars = self.level.iter().chain(&self.trace).chain([&self.square]);
        all.chain(self.p_current.iter()).chain(scalars).all(|x| x.abs() < limit)
    }

    /// `P` and `h` without what noise of these variances has added to them.
    #[must_use]
    pub fn compensated(&self, variance: [f64; 2]) -> (NormalMatrix, NormalVector) {
        let p = self.p - self.p_position * variance[0] - NormalMatrix::from_diagonal(&(self.p_current * variance[1]));
        (p, self.h - self.h_position * variance[0])
    }

    /// `Σ w |N − D x|²`, never negative.
    #[must_use]
    pub fn rest(&self, x: &NormalVector) -> f64 {
        (self.square - 2.0 * x.dot(&self.h) + x.dot(&(self.p * x))).max(0.0)
    }
}

/// Coefficients of the noise of one sample in the score: position y, z, then force y, z.
type Node = [NormalVector; 4];

/// The sums over all windows so far, and how the noise of every sample stands in them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Memory {
    /// The sums.
    pub sums: Sums,
    /// Sums of the weights of the windows and of their squares.
    pub weight: [f64; 2],
    /// `M_z`, `M_i` of the samples that no further window will hold.
    done: [NormalMatrix; 2],
    /// `M_z`, `M_i` of all samples.
    pub score: [NormalMatrix; 2],
    /// The samples of the last window.
    nodes: Vec<Node>,
}

impl Memory {
    /// An empty memory for windows of that many samples.
    #[must_use]
    pub fn new(nodes: usize) -> Self {
        Self {
            sums: Sums::default(),
            weight: [0.0; 2],
            done: [NormalMatrix::zeros(); 2],
            score: [NormalMatrix::zeros(); 2],
            nodes: vec![[NormalVector::zeros(); 4]; nodes],
        }
    }

    /// Whether it has the shape for windows of that many samples.
    #[must_use]
    pub fn has_shape(&self, nodes: usize) -> bool {
        self.nodes.len() == nodes
    }

    /// Forgets everything.
    pub fn clear(&mut self) {
        self.sums = Sums::default();
        self.weight = [0.0; 2];
        self.done = [NormalMatrix::zeros(); 2];
        self.score = [NormalMatrix::zeros(); 2];
        self.nodes.fill([NormalVector::zeros(); 4]);
    }

    /// No window to come will share samples with those before.
    pub fn part(&mut self) {
        self.done = self.score;
        self.nodes.fill([NormalVector::zeros(); 4]);
    }

    /// Takes in one window: `hop` samples further than the one before, weighing `1/keep` as much.
    pub fn add(
        &mut self,
        bank: &Bank,
        (d, window): (&Regressors, &Sums),
        sensitivity: impl Fn(usize) -> Sensitivity,
        (hop, keep): (usize, f64),
        direction: &[[f64; 2]; 3],
    ) {
        self.sums.blend(keep, window);
        self.weight = [self.weight[0] * keep + 1.0, self.weight[1] * keep * keep + 1.0];
        let hop = hop.min(self.nodes.len());
        self.nodes.copy_within(hop.., 0);
        let fresh = self.nodes.len() - hop;
        self.nodes[fresh..].fill([NormalVector::zeros(); 4]);
        for matrix in &mut self.done {
            *matrix *= keep * keep;
        }
        let functions = bank.rows.len();
        let mut columns = [[NormalVector::zeros(); 2]; MAX_FUNCTIONS];
        for (i, pair) in columns.iter_mut().enumerate().take(functions) {
            for (axis, column) in pair.iter_mut().enumerate() {
                *column = d.row(axis * functions + i).transpose();
            }
        }
        let mut total = self.done;
        for (j, node) in self.nodes.iter_mut().enumerate() {
            for vector in node.iter_mut() {
                *vector *= keep;
            }
            for (i, [y, z]) in columns.iter().enumerate().take(functions) {
                let (position, force) = (bank.rows[i].position[j], bank.current[i][j]);
                node[0] += y * position;
                node[1] += z * position;
                node[2] += y * force;
                node[3] += z * force;
            }
            let Sensitivity { stiffness: [yy, yz, zz], current } = sensitivity(j);
            let y = node[0] - node[2] * yy - node[3] * yz;
            let z = node[1] - node[2] * yz - node[3] * zz;
            total[0] += y * y.transpose() + z * z.transpose();
            for ([sin, cos], gain) in direction.iter().zip(current) {
                let v = (node[2] * *sin + node[3] * *cos) * gain;
                total[1] += v * v.transpose();
            }
            if j + 1 == hop {
                self.done = total;
            }
        }
        self.score = total;
    }
}
