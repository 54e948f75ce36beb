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

use multiversion::multiversion;
use nalgebra::{SMatrix, SVector};
use serde::{Deserialize, Serialize};

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
    /// are the nominal noise of a position and of `∫ dτ`-ed acceleration times T_f², in the same unit.
    #[must_use]
    pub fn new(intervals: usize, hop: usize, continuous: bool, position: f64, current: f64) -> Self {
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
        Self { p, h, square, level, p_position, h_position, p_current, trace: noise.trace(x) }
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

/// Up to [`WIDTH`] numbers from `at` on, and zeros.
#[inline(always)]
fn load(values: &[f64], at: usize) -> Lane {
    if let Some(place) = values.get(at..at + WIDTH) {
        let mut lane = [0.0; WIDTH];
        lane.copy_from_slice(place);
        return lane;
    }
    let mut lane = [0.0; WIDTH];
    for (lane, value) in lane.iter_mut().zip(values.iter().skip(at)) {
        *lane = *value;
    }
    lane
}

#[inline(always)]
fn store(values: &mut [f64], at: usize, lane: &Lane) {
    if let Some(place) = values.get_mut(at..at + WIDTH) {
        place.copy_from_slice(lane);
        return;
    }
    for (value, lane) in values.iter_mut().skip(at).zip(lane) {
        *value = *lane;
    }
}

/// `sum += a b`, number by number.
#[inline(always)]
fn add_product(sum: &mut Lane, a: &Lane, b: &Lane) {
    for ((sum, a), b) in sum.iter_mut().zip(a).zip(b) {
        *sum += a * b;
    }
}

/// `sum += a b`, number by number.
#[inline(always)]
fn add_scaled(sum: &mut Lane, a: f64, b: &Lane) {
    for (sum, b) in sum.iter_mut().zip(b) {
        *sum += a * b;
    }
}

#[inline(always)]
fn times(a: &Lane, b: &Lane) -> Lane {
    let mut product = *a;
    for (product, b) in product.iter_mut().zip(b) {
        *product *= b;
    }
    product
}

/// `a − (b c + d e)`, number by number.
#[inline(always)]
fn without(a: &Lane, [b, c]: [&Lane; 2], [d, e]: [&Lane; 2]) -> Lane {
    let mut rest = *a;
    for lane in 0..WIDTH {
        rest[lane] -= b[lane] * c[lane] + d[lane] * e[lane];
    }
    rest
}

#[inline(always)]
fn total(lane: &Lane) -> f64 {
    ((lane[0] + lane[4]) + (lane[2] + lane[6])) + ((lane[1] + lane[5]) + (lane[3] + lane[7]))
}

/// `Σ uu current_k` of three magnets, `Σ zu gap_k`, and `Σ uu gap_k gap_l` of six pairs k ≤ l.
#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2"))]
fn profile(weights: &[Vec<f64>; 2], gains: Gains) -> [[f64; 6]; 3] {
    let [mixed, force] = weights;
    let [current, gap] = [gains.current, gains.gap];
    let mut by_current = [[0.0; WIDTH]; 3];
    let mut by_gap = [[0.0; WIDTH]; 3];
    let mut by_pair = [[0.0; WIDTH]; 6];
    let mut at = 0;
    while at < force.len() {
        let (zu, uu) = (load(mixed, at), load(force, at));
        let [a, b, c] = [load(gap[0], at), load(gap[1], at), load(gap[2], at)];
        add_product(&mut by_current[0], &uu, &load(current[0], at));
        add_product(&mut by_current[1], &uu, &load(current[1], at));
        add_product(&mut by_current[2], &uu, &load(current[2], at));
        add_product(&mut by_gap[0], &zu, &a);
        add_product(&mut by_gap[1], &zu, &b);
        add_product(&mut by_gap[2], &zu, &c);
        let weighted = [times(&uu, &a), times(&uu, &b), times(&uu, &c)];
        add_product(&mut by_pair[0], &weighted[0], &a);
        add_product(&mut by_pair[1], &weighted[0], &b);
        add_product(&mut by_pair[2], &weighted[0], &c);
        add_product(&mut by_pair[3], &weighted[1], &b);
        add_product(&mut by_pair[4], &weighted[1], &c);
        add_product(&mut by_pair[5], &weighted[2], &c);
        at += WIDTH;
    }
    let mut sums = [[0.0; 6]; 3];
    for k in 0..3 {
        sums[0][k] = total(&by_current[k]);
        sums[1][k] = total(&by_gap[k]);
    }
    for (sum, lane) in sums[2].iter_mut().zip(&by_pair) {
        *sum = total(lane);
    }
    sums
}

/// What cells that are worked on together bring into the score.
#[derive(Clone, Copy)]
struct Scores {
    /// `P − S F` along y and z.
    along: [[Lane; COLUMNS]; 2],
    force: [Lane; COLUMNS],
    /// Squares of the gains of the currents.
    gain: [Lane; 3],
}

/// Chunks between which the sums leave the registers.
const TILE: usize = 4;

/// Row and column of a symmetric matrix, and number by number.
type Square = [[Lane; COLUMNS]; COLUMNS];

/// Adds row L of the outer products of the scores, from the diagonal on.
#[inline(always)]
fn add_row<const L: usize>(scores: &[Scores], by_position: &mut Square, by_current: &mut [Square; 3]) {
    let mut sums = by_position[L];
    for Scores { along: [y, z], .. } in scores {
        for m in L..COLUMNS {
            add_product(&mut sums[m], &y[L], &y[m]);
            add_product(&mut sums[m], &z[L], &z[m]);
        }
    }
    by_position[L] = sums;
    let [mut first, mut second, mut third] = [by_current[0][L], by_current[1][L], by_current[2][L]];
    for Scores { force, gain: [a, b, c], .. } in scores {
        let weighted = [times(&force[L], a), times(&force[L], b), times(&force[L], c)];
        for m in L..COLUMNS {
            add_product(&mut first[m], &weighted[0], &force[m]);
            add_product(&mut second[m], &weighted[1], &force[m]);
            add_product(&mut third[m], &weighted[2], &force[m]);
        }
    }
    [by_current[0][L], by_current[1][L], by_current[2][L]] = [first, second, third];
}

/// The sums of a symmetric matrix, of which the rows from the diagonal on are given.
fn symmetric(sums: &Square) -> NormalMatrix {
    let mut matrix = NormalMatrix::zeros();
    for (l, row) in sums.iter().enumerate() {
        for (m, sum) in row.iter().enumerate().skip(l) {
            matrix[(l, m)] = total(sum);
            matrix[(m, l)] = matrix[(l, m)];
        }
    }
    matrix
}

/// Brings P and F of the cells up to date with a window, and sums what they make of `M_z` and `M_i`: over the cells that the next window
/// will not hold, then over the others.
fn gather(
    bank: &Bank,
    nodes: &mut [f64],
    columns: &[[f64; MAX_FUNCTIONS]; COLUMNS],
    keep: f64,
    sensitivity: &Sensitivity,
) -> [[NormalMatrix; 2]; 2] {
    let cells = nodes.len() / (2 * COLUMNS);
    let leaving = bank.cells.per_hop().min(cells);
    let nothing =
        Scores { along: [[[0.0; WIDTH]; COLUMNS]; 2], force: [[0.0; WIDTH]; COLUMNS], gain: [[0.0; WIDTH]; 3] };
    let mut scores = [nothing; TILE];
    let Sensitivity { scale, direction, .. } = sensitivity;
    let mut sums = [[NormalMatrix::zeros(); 2]; 2];
    for ((range, chunks), sums) in [0..leaving, leaving..cells].into_iter().zip(&bank.chunks).zip(&mut sums) {
        let mut by_position = [[[0.0; WIDTH]; COLUMNS]; COLUMNS];
        let mut by_current = [by_position; 3];
        let frame = Frame { start: range.start, end: range.end, leaving };
        gather_range(
            nodes,
            &frame,
            chunks,
            (columns, keep),
            sensitivity,
            &mut scores,
            &mut by_position,
            &mut by_current,
        );
        sums[0] = symmetric(&by_position);
        for (k, by_current) in by_current.iter().enumerate() {
            sums[1] += along_magnet(&symmetric(by_current), direction, k) * (scale[k] * scale[k]);
        }
    }
    sums
}

/// Cells of a window that are gathered, and how many the next window will not hold.
struct Frame {
    start: usize,
    end: usize,
    leaving: usize,
}

/// What [`gather`] does for the cells of a range.
#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2"))]
fn gather_range(
    nodes: &mut [f64],
    frame: &Frame,
    chunks: &[Chunk],
    (columns, keep): (&[[f64; MAX_FUNCTIONS]; COLUMNS], f64),
    Sensitivity { gains, scale, direction }: &Sensitivity,
    scores: &mut [Scores; TILE],
    by_position: &mut Square,
    by_current: &mut [Square; 3],
) {
    let cells = nodes.len() / (2 * COLUMNS);
    let end = frame.end;
    let mut at = frame.start;
    for tile in chunks.chunks(TILE) {
        for (chunk, scores) in tile.iter().zip(&mut *scores) {
            let mut position = [[0.0; WIDTH]; COLUMNS];
            update(&mut nodes[..COLUMNS * cells], (at, frame), &chunk.position, columns, keep, &mut position);
            let force = &mut scores.force;
            update(&mut nodes[COLUMNS * cells..], (at, frame), &chunk.force, columns, keep, force);
            // S, and what it leaves of the positions.
            let [mut yy, mut yz, mut zz] = [[0.0; WIDTH]; 3];
            for k in 0..3 {
                let gain = load(&gains.gap[k][..end], at);
                let [sin, cos] = direction[k];
                add_scaled(&mut yy, scale[k] * (sin * sin), &gain);
                add_scaled(&mut yz, scale[k] * (sin * cos), &gain);
                add_scaled(&mut zz, scale[k] * (cos * cos), &gain);
                scores.gain[k] = load(&gains.current[k][..end], at);
            }
            let [y, z] = &mut scores.along;
            for k in 0..3 {
                let [sin, cos] = direction[k];
                for lane in 0..WIDTH {
                    let (p, f) = (position[k][lane], force[k][lane]);
                    y[k][lane] = sin * p - f * (yy[lane] * sin + yz[lane] * cos);
                    z[k][lane] = cos * p - f * (yz[lane] * sin + zz[lane] * cos);
                }
            }
            let [c, s] = [&force[3], &force[4]];
            y[3] = without(&position[3], [&yy, c], [&yz, s]);
            z[3] = without(&position[4], [&yz, c], [&zz, s]);
            for lane in 0..WIDTH {
                y[4][lane] = (yy[lane] * s[lane] - yz[lane] * c[lane]) - position[4][lane];
                z[4][lane] = (yz[lane] * s[lane] - zz[lane] * c[lane]) + position[3][lane];
            }
            at += WIDTH;
        }
        let scores = &scores[..tile.len()];
        add_row::<0>(scores, by_position, by_current);
        add_row::<1>(scores, by_position, by_current);
        add_row::<2>(scores, by_position, by_current);
        add_row::<3>(scores, by_position, by_current);
        add_row::<4>(scores, by_position, by_current);
    }
}

/// Adds to P or F of the cells from `at` on what a window brings, and returns them in `values`.
#[inline(always)]
fn update(
    nodes: &mut [f64],
    (at, frame): (usize, &Frame),
    weights: &[Lane; MAX_FUNCTIONS],
    columns: &[[f64; MAX_FUNCTIONS]; COLUMNS],
    keep: f64,
    values: &mut [Lane; COLUMNS],
) {
    let cells = nodes.len() / COLUMNS;
    let [mut a, mut b, mut c, mut d, mut e] = [[0.0; WIDTH]; COLUMNS];
    // What has been the cell number `leaving` is number 0 now. Reading is always ahead of writing.
    let (from, to) = ((at + frame.leaving).min(cells), (frame.end + frame.leaving).min(cells));
    add_scaled(&mut a, keep, &load(&nodes[from..to], 0));
    add_scaled(&mut b, keep, &load(&nodes[cells + from..cells + to], 0));
    add_scaled(&mut c, keep, &load(&nodes[2 * cells + from..2 * cells + to], 0));
    add_scaled(&mut d, keep, &load(&nodes[3 * cells + from..3 * cells + to], 0));
    add_scaled(&mut e, keep, &load(&nodes[4 * cells + from..4 * cells + to], 0));
    for (i, weights) in weights.iter().enumerate() {
        add_scaled(&mut a, columns[0][i], weights);
        add_scaled(&mut b, columns[1][i], weights);
        add_scaled(&mut c, columns[2][i], weights);
        add_scaled(&mut d, columns[3][i], weights);
        add_scaled(&mut e, columns[4][i], weights);
    }
    *values = [a, b, c, d, e];
    for (m, value) in values.iter().enumerate() {
        store(&mut nodes[m * cells..m * cells + frame.end], at, value);
    }
}

/// `E F Eᵀ`, where E takes the five numbers of a sample to its forces along magnet k: `F_l dir_l·dir_k` for a magnet, and for the
/// rotation `F_c sin + F_s cos`, `F_c cos − F_s sin`.
fn along_magnet(forces: &NormalMatrix, direction: &Directions, k: usize) -> NormalMatrix {
    let [sin, cos] = direction[k];
    let along = direction.map(|[sin_l, cos_l]| sin_l * sin + cos_l * cos);
    let turned = |row: usize| {
        let (c, s) = (forces[(row, 3)], forces[(row, 4)]);
        [c * sin + s * cos, c * cos - s * sin]
    };
    let mut result = NormalMatrix::zeros();
    for l in 0..3 {
        for m in l..3 {
            result[(l, m)] = along[l] * along[m] * forces[(l, m)];
        }
        let [c, s] = turned(l);
        result[(l, 3)] = along[l] * c;
        result[(l, 4)] = along[l] * s;
    }
    let [[cc, cs], [sc, ss]] = [turned(3), turned(4)];
    result[(3, 3)] = sin * cc + cos * sc;
    result[(3, 4)] = sin * cs + cos * ss;
    result[(4, 4)] = cos * cs - sin * ss;
    result.fill_lower_triangle_with_upper_triangle();
    result
}
