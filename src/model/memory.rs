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
//! Three things follow, without an assumption on how windows overlap:
//!
//! * **bias**: `E[δDᵀδD]` and `E[δDᵀδN]` are known sums over the nodes, per σ_z² and per σ_i². They are taken off P and h
//!   (compensated least squares), so that noise in the regressors does not draw λ̂ towards zero;
//! * **covariance**: the score `Σ w Dᵀ e` is linear in the noise of every single sample. Its coefficients are gathered
//!   while the windows pass (`Memory::nodes`), so that `cov x̂ = P⁻¹ (σ_z² M_z + σ_i² M_i) P⁻¹` counts
//!   every sample once, however many windows it stands in;
//! * **noise level**: `E[Σ w |e|²] = Σ σ² (T − tr P⁻¹M)`, from which an unknown σ is found.
//!
//! All three take the samples of a cell together ([`super::cells`]), which keeps their cost the same at any window.
//!
//! # What a sample stands with
//!
//! The two rows of a test function are made of the same five integrals: those of the three magnets, times `dir_k`, and those of
//! `ω² cos θ` and `ω² sin θ`, in turn. A sample stands in the score with five numbers P for its positions and five numbers F for
//! its forces, `P_m = Σ w D_m g_z`, `F_m = Σ w D_m g_u` over windows and test functions. With S, the stiffness
//! `T_f²/m Σ λ_k 2 u_k/gap_k dir_k dir_kᵀ`, noise of its position has the coefficients `P − S F`.

mod score;

use nalgebra::{SMatrix, SVector};
use serde::{Deserialize, Serialize};

use self::score::{gather, profile};
use super::cells::Cells;
use super::kernel::{Weights, sine_combinations, static_load_sines};
use super::regression::{NormalMatrix, NormalVector};
use super::sines::{HARMONICS, LANES, SineSums};

/// The most test functions per axis.
pub const MAX_FUNCTIONS: usize = HARMONICS - 1;

/// Integrals of a test function that make its two rows of D: three magnets, cosine and sine of the rotation.
pub const COLUMNS: usize = 5;

/// What the rows of both axes leave unexplained in one window, y first.
pub type Residuals = SVector<f64, { 2 * MAX_FUNCTIONS }>;

/// Cells that are worked on together.
const WIDTH: usize = 8;
type Lane = [f64; WIDTH];

/// The integrals of all test functions over one window.
#[derive(Clone, Debug, PartialEq)]
pub struct Rows {
    /// `∫ φ'' (Y, Z) dτ`, m.
    pub position: [[f64; MAX_FUNCTIONS]; 2],
    /// The integrals that make D, multiplied by the scale of their column; [`COLUMNS`] of them.
    pub column: [[f64; MAX_FUNCTIONS]; COLUMNS],
}

/// Directions of the magnets, `(sin α_k, cos α_k)`.
pub type Directions = [[f64; 2]; 3];

impl Rows {
    /// The normal equations of the window, `DᵀD`, `DᵀN` and `|N|²`.
    #[must_use]
    pub fn normal(&self, direction: &Directions) -> (NormalMatrix, NormalVector, f64) {
        let mut p = NormalMatrix::zeros();
        let mut h = NormalVector::zeros();
        let [y, z] = &self.position;
        let [.., c, s] = &self.column;
        for (k, [sin, cos]) in direction.iter().enumerate() {
            let column = &self.column[k];
            for (l, [sin_l, cos_l]) in direction.iter().enumerate().skip(k) {
                p[(k, l)] = (sin * sin_l + cos * cos_l) * product(column, &self.column[l]);
            }
            let (with_c, with_s) = (product(column, c), product(column, s));
            p[(k, 3)] = sin * with_c + cos * with_s;
            p[(k, 4)] = cos * with_c - sin * with_s;
            h[k] = sin * product(column, y) + cos * product(column, z);
        }
        p[(3, 3)] = product(c, c) + product(s, s);
        p[(4, 4)] = p[(3, 3)];
        h[3] = product(c, y) + product(s, z);
        h[4] = product(c, z) - product(s, y);
        p.fill_lower_triangle_with_upper_triangle();
        (p, h, product(y, y) + product(z, z))
    }

    /// `N − D x`.
    #[must_use]
    pub fn left(&self, direction: &Directions, x: &NormalVector) -> Residuals {
        let mut left = Residuals::zeros();
        for i in 0..MAX_FUNCTIONS {
            let [first, second, third, c, s] = self.column.map(|column| column[i]);
            // U ω² cos(θ + φ) = U cos φ · ω² cos θ − U sin φ · ω² sin θ, and the sine likewise.
            let mut y = x[3] * c - x[4] * s;
            let mut z = x[3] * s + x[4] * c;
            for ((k, value), [sin, cos]) in [first, second, third].into_iter().enumerate().zip(direction) {
                y += x[k] * sin * value;
                z += x[k] * cos * value;
            }
            left[i] = self.position[0][i] - y;
            left[MAX_FUNCTIONS + i] = self.position[1][i] - z;
        }
        left
    }
}

fn product(a: &[f64; MAX_FUNCTIONS], b: &[f64; MAX_FUNCTIONS]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Weights of all test functions at cells that are worked on together; zero where there is no cell.
#[derive(Clone, Debug, PartialEq)]
struct Chunk {
    position: [Lane; MAX_FUNCTIONS],
    force: [Lane; MAX_FUNCTIONS],
}

/// Test functions for the weighted least squares, and the noise profile that goes with them.
#[derive(Clone, Debug, PartialEq)]
pub struct Bank {
    functions: usize,
    /// Coefficients of `sin lπτ` in the test functions, made so that nominal noise gives every row the variance one, and rows of one
    /// window no correlation; one row per l.
    combinations: [[f64; MAX_FUNCTIONS]; HARMONICS],
    /// Those in the test function of the static load.
    load: [f64; HARMONICS],
    /// `Σ |node|` over all test functions, the largest answer of the current side to a signal bounded by one.
    reach: f64,
    followed: f64,
    cells: Cells,
    /// Weights of the cells that the next window will not hold, then of those that it will.
    chunks: [Vec<Chunk>; 2],
    /// `Σ g_z²` over nodes and rows.
    square: f64,
    /// `Σ g_z g_u`, `Σ g_u²` over the rows and the nodes of each cell.
    profile: [Vec<f64>; 2],
}

impl Bank {
    /// The test functions of [`Weights::sines`] for windows of that many intervals, one every `hop` samples; `position` and `current`
    /// are the nominal noise of a position and of `∫ dτ`-ed acceleration times T_f², in the same unit; `keep` as in [`Bank::followed`].
    #[must_use]
    pub fn new(intervals: usize, hop: usize, continuous: bool, [position, current]: [f64; 2], keep: f64) -> Self {
        let rows = Weights::sines(intervals, HARMONICS, position, current);
        let forces: Vec<Vec<f64>> = rows
            .iter()
            .map(|row| {
                if continuous {
                    row.node.clone()
                } else {
                    row.held_start.iter().zip(&row.held_end).map(|(a, b)| a + b).collect()
                }
            })
            .collect();
        let mut combinations = [[0.0; MAX_FUNCTIONS]; HARMONICS];
        for (i, combination) in sine_combinations(intervals, HARMONICS, position, current).iter().enumerate() {
            for (l, coefficient) in combination.iter().enumerate() {
                combinations[l][i] = *coefficient;
            }
        }
        let mut load = [0.0; HARMONICS];
        load[..=rows.len()].copy_from_slice(&static_load_sines(intervals, rows.len() + 1));
        let cells = Cells::new(intervals, hop);
        let mut starts = vec![0];
        starts.extend(cells.sizes().iter().scan(0, |end, size| {
            *end += size;
            Some(*end)
        }));
        let nodes = |cell: usize| starts[cell]..starts[cell + 1];
        let over_cells = |a: &[Vec<f64>], b: &[&Vec<f64>]| -> Vec<f64> {
            let at = |j: usize| a.iter().zip(b).map(|(a, b)| a[j] * b[j]).sum::<f64>();
            (0..cells.sizes().len()).map(|cell| nodes(cell).map(at).sum()).collect()
        };
        let positions: Vec<&Vec<f64>> = rows.iter().map(|row| &row.position).collect();
        let profile = [over_cells(&forces, &positions), over_cells(&forces, &forces.iter().collect::<Vec<_>>())];
        // A cell of n equal samples counts as one with √n times their mean.
        let lanes = |weights: &[&Vec<f64>], first: usize, end: usize| -> [Lane; MAX_FUNCTIONS] {
            std::array::from_fn(|i| {
                std::array::from_fn(|lane| match (weights.get(i), first + lane) {
                    (Some(weights), cell) if cell < end => {
                        nodes(cell).map(|j| weights[j]).sum::<f64>() / (nodes(cell).len() as f64).sqrt()
                    }
                    _ => 0.0,
                })
            })
        };
        let forces: Vec<&Vec<f64>> = forces.iter().collect();
        let chunk = |first: usize, end: usize| Chunk {
            position: lanes(&positions, first, end),
            force: lanes(&forces, first, end),
        };
        let (leaving, all) = (cells.per_hop(), cells.sizes().len());
        let chunks = [(0, leaving), (leaving, all)]
            .map(|(from, end)| (from..end).step_by(WIDTH).map(|first| chunk(first, end)).collect());
        Self {
            functions: rows.len(),
            followed: followed(&rows, keep),
            combinations,
            load,
            reach: rows.iter().map(Weights::reach).sum(),
            chunks,
            square: rows.iter().flat_map(|row| &row.position).map(|weight| weight * weight).sum(),
            profile,
            cells,
        }
    }

    /// Number of test functions per axis.
    #[must_use]
    pub fn functions(&self) -> usize {
        self.functions
    }

    /// `Σ |node|` over all test functions.
    #[must_use]
    pub fn reach(&self) -> f64 {
        self.reach
    }

    /// `Σ g_z·(T g_z)/Σ g_z²` over the rows, dimensionless: how much of their position noise a loop follows whose complementary
    /// sensitivity T is a low-pass of second order that forgets to the part `keep` in a sample. Below 0 where it lags
    /// by more than a quarter turn.
    #[must_use]
    pub fn followed(&self) -> f64 {
        self.followed
    }

    /// The samples that are taken together.
    #[must_use]
    pub fn cells(&self) -> &Cells {
        &self.cells
    }

    /// The integrals of the test functions out of those of the sines: positions, then what makes the columns of D, each times its scale.
    #[must_use]
    pub fn rows(&self, sums: &SineSums, scale: &[f64; COLUMNS]) -> Rows {
        let mut rows = [[0.0; MAX_FUNCTIONS]; LANES];
        for (row, sums) in rows.iter_mut().zip(sums) {
            for (sum, combination) in sums.iter().zip(&self.combinations) {
                for (value, coefficient) in row.iter_mut().zip(combination) {
                    *value += coefficient * sum;
                }
            }
        }
        let [y, z, ..] = rows;
        let column = std::array::from_fn(|m| rows[2 + m].map(|value| value * scale[m]));
        Rows { position: [y, z], column }
    }

    /// The integrals of the test function of the static load, lanes as in the sums.
    #[must_use]
    pub fn load(&self, sums: &SineSums) -> [f64; LANES] {
        sums.map(|sums| sums.iter().zip(&self.load).map(|(sum, coefficient)| sum * coefficient).sum())
    }

    /// What noise does in a window, with the gains of its cells and the scales of the magnets' columns.
    #[must_use]
    pub fn noise(&self, gains: Gains, scale: [f64; 3], direction: &Directions) -> NoiseSums {
        let [current, gap, pairs] = profile(&self.profile, gains);
        let mut sums = NoiseSums { square: self.square, ..NoiseSums::default() };
        let mut pair = pairs.into_iter();
        for k in 0..3 {
            sums.p_current[k] = current[k] * (scale[k] * scale[k]);
            sums.h_position[k] = gap[k] * scale[k];
            for l in k..3 {
                let along = direction[k][0] * direction[l][0] + direction[k][1] * direction[l][1];
                let value = scale[k] * scale[l] * along * along * pair.next().unwrap_or(0.0);
                sums.p_position[(k, l)] = value;
                sums.p_position[(l, k)] = value;
            }
        }
        sums
    }
}

/// See [`Bank::followed`].
fn followed(rows: &[Weights], keep: f64) -> f64 {
    let (mut both, mut own) = (0.0, 0.0);
    for row in rows {
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

/// Mean over each cell of what noise is multiplied by, oldest cell first.
#[derive(Clone, Copy, Debug)]
pub struct Gains<'a> {
    /// `(2 i_k/gap_k²)²`, for the noise of the current k.
    pub current: [&'a [f64]; 3],
    /// `2 i_k²/gap_k³`, for the noise of the positions.
    pub gap: [&'a [f64]; 3],
}

/// What noise does in one window.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct NoiseSums {
    /// `Σ g_z²`.
    square: f64,
    /// As in [`Sums`].
    p_position: SMatrix<f64, 3, 3>,
    h_position: [f64; 3],
    p_current: [f64; 3],
}

impl NoiseSums {
    /// Expected `|e|²` per σ_z² and per σ_i² with the unknowns x.
    #[must_use]
    pub fn trace(&self, x: &NormalVector) -> [f64; 2] {
        let mut trace = [2.0 * self.square, 0.0];
        for k in 0..3 {
            trace[0] -= 2.0 * x[k] * self.h_position[k];
            trace[1] += x[k] * x[k] * self.p_current[k];
            for l in 0..3 {
                trace[0] += x[k] * x[l] * self.p_position[(k, l)];
            }
        }
        trace
    }
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
    /// Expected `Σ w δDᵀδD` per σ_z²; unknowns beyond the magnets have none.
    pub p_position: SMatrix<f64, 3, 3>,
    /// Expected `Σ w δDᵀδN` per σ_z².
    pub h_position: [f64; 3],
    /// Expected `Σ w δDᵀδD` per σ_i², a diagonal.
    pub p_current: [f64; 3],
    /// Expected `Σ w |e|²` per σ_z² and per σ_i², before anything is fitted.
    pub trace: [f64; 2],
}

impl Sums {
    /// The sums of one window.
    #[must_use]
    pub fn of(rows: &Rows, direction: &Directions, level: [f64; 3], noise: &NoiseSums, x: &NormalVector) -> Self {
        let (p, h, square) = rows.normal(direction);
        let NoiseSums { p_position, h_position, p_current, .. } = *noise;
        Self { p, h, square, level, p_position, h_position, p_current, trace: noise.trace(x), shape: [0.0; 2] }
    }

    /// `self · keep + other`.
    pub fn blend(&mut self, keep: f64, other: &Self) {
        self.p = self.p * keep + other.p;
        self.h = self.h * keep + other.h;
        self.square = self.square * keep + other.square;
        self.p_position = self.p_position * keep + other.p_position;
        for k in 0..3 {
            self.h_position[k] = self.h_position[k] * keep + other.h_position[k];
            self.p_current[k] = self.p_current[k] * keep + other.p_current[k];
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
        let all = self.p.iter().chain(self.h.iter()).chain(self.p_position.iter());
        let scalars = self.level.iter().chain(&self.trace).chain(&self.h_position).chain(&self.p_current);
        all.chain(scalars).chain([&self.square]).all(|x| x.abs() < limit)
    }

    /// `P` and `h` without what noise of these variances has added to them.
    #[must_use]
    pub fn compensated(&self, variance: [f64; 2]) -> (NormalMatrix, NormalVector) {
        let (mut p, mut h) = (self.p, self.h);
        for k in 0..3 {
            for l in 0..3 {
                p[(k, l)] -= self.p_position[(k, l)] * variance[0];
            }
            p[(k, k)] -= self.p_current[k] * variance[1];
            h[k] -= self.h_position[k] * variance[0];
        }
        (p, h)
    }

    /// `Σ w |N − D x|²`, never negative.
    #[must_use]
    pub fn rest(&self, x: &NormalVector) -> f64 {
        (self.square - 2.0 * x.dot(&self.h) + x.dot(&(self.p * x))).max(0.0)
    }
}

/// How noise gets into the score.
#[derive(Clone, Copy, Debug)]
pub struct Sensitivity<'a> {
    /// The gains of the cells of the window.
    pub gains: Gains<'a>,
    /// `T_f² λ_k/m` of each magnet.
    pub scale: [f64; 3],
    /// Directions of the magnets.
    pub direction: &'a Directions,
}

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
    /// P and F of the cells of the last window, one column of D after the other.
    nodes: Vec<f64>,
}

impl Memory {
    /// An empty memory for windows of that many cells.
    #[must_use]
    pub fn new(cells: usize) -> Self {
        Self {
            sums: Sums::default(),
            weight: [0.0; 2],
            done: [NormalMatrix::zeros(); 2],
            score: [NormalMatrix::zeros(); 2],
            nodes: vec![0.0; 2 * COLUMNS * cells],
        }
    }

    /// Whether it has the shape for windows of that many cells.
    #[must_use]
    pub fn has_shape(&self, cells: usize) -> bool {
        self.nodes.len() == 2 * COLUMNS * cells
    }

    /// Forgets everything.
    pub fn clear(&mut self) {
        self.sums = Sums::default();
        self.weight = [0.0; 2];
        self.done = [NormalMatrix::zeros(); 2];
        self.score = [NormalMatrix::zeros(); 2];
        self.nodes.fill(0.0);
    }

    /// No window to come will share samples with those before.
    pub fn part(&mut self) {
        self.done = self.score;
        self.nodes.fill(0.0);
    }

    /// Takes in one window, a hop further than the one before, weighing `1/keep` as much.
    pub fn add(&mut self, bank: &Bank, (rows, window): (&Rows, &Sums), keep: f64, sensitivity: &Sensitivity) {
        self.sums.blend(keep, window);
        self.weight = [self.weight[0] * keep + 1.0, self.weight[1] * keep * keep + 1.0];
        let [leaving, staying] = gather(bank, &mut self.nodes, &rows.column, keep, sensitivity);
        for (done, leaving) in self.done.iter_mut().zip(leaving) {
            *done = *done * (keep * keep) + leaving;
        }
        for ((score, done), staying) in self.score.iter_mut().zip(self.done).zip(staying) {
            *score = done + staying;
        }
    }
}
