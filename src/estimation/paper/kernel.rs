//! Kernels of the algebraic estimator, P(10)–(17), and their discretisation.
//!
//! With `ψ_n(τ) = τⁿ (1 − τ)³`, n = 3, 4, 5 on τ ∈ [0, 1] (τ = 0 is the oldest instant of the window) the six
//! kernels of the paper are, up to powers of the window length `T_f`,
//!
//! ```text
//! g_u,1 = ψ_3'/6    g_u,2 = −ψ_4'/6    g_u,3 = ψ_5'/6        g_z,i = g_u,i''
//! ```
//!
//! so that P(15)–(17) are the weak form `∫ g_u'' Z dτ = T_f² ∫ g_u Z̈ dτ` of the equations of motion.
//!
//! # Discretisation
//!
//! The nodes are `τ_j = j h`, `h = 1/N`. The test function is the piecewise linear function `φ_h` through its values `φ_j` at
//! the nodes, with `φ_0 = φ_N = 0`. Then the weak form needs no quadrature on the position side:
//!
//! ```text
//! T_f² ∫ φ_h Z̈ dτ = Σ_j (φ_{j+1} − 2 φ_j + φ_{j−1}) Z_j / h        for every Z with an integrable Z̈
//! ```
//!
//! Constants and slopes of Z cancel to rounding. `φ` is the central difference of a primitive `Ψ` given between the nodes,
//! `φ(τ) = (Ψ(τ + h/2) − Ψ(τ − h/2))/h`, so that `Σ φ_j = 0` telescopes: a constant force cancels as well.
//! `Ψ` is `ψ_n` with one factor `τ²` replaced by `τ² − h²/4` and one factor `(1 − τ)²` by `(1 − τ)² − h²/4`
//! (central factorials). It differs from `ψ_n` by O(h²), and makes the two end values of `φ` vanish.
//! All differences are those of rounded values, so that the sums telescope in floating point as well. The relative
//! rounding error of `φ''` grows with N³: 1e-11 at N = 200, 2e-3 at 100 000.

/// Number of rows that one axis contributes to P(18).
pub const ROWS_PER_AXIS: usize = 3;

/// `Ψ_n(τ) = τ^{n−2} (τ² − h²/4) (1 − τ) ((1 − τ)² − h²/4)` at `τ = (j + ½) h`, for n ≥ 2 and j < N.
///
/// `ψ_n` with central factorials of step `h = 1/N`; exactly zero half a step inside both ends.
fn psi_between_nodes(n: usize, j: usize, intervals: usize) -> f64 {
    let from_start = (2 * j + 1) as f64;
    let width = (2 * intervals) as f64;
    let from_end = width - from_start;
    let (a, b) = (from_start / width, from_end / width);
    let factorial = |x: f64| (x * x - 1.0) / (width * width);
    (2..n).fold(factorial(from_start) * b * factorial(from_end), |product, _| product * a)
}

/// Weights of one test function for the samples of a window; each vector has a weight for each of the N + 1 nodes, oldest first. Dimensionless.
#[derive(Clone, Debug, PartialEq)]
pub struct Weights {
    /// `Σ position_j Z_j = T_f² ∫ φ_h Z̈ dτ`, exact for every motion.
    pub position: Vec<f64>,
    /// Weight of `f(t_{j−1})` in `∫ φ_h f dτ` over the interval that ends at node j, f linear within it; 0 for j = 0.
    pub held_start: Vec<f64>,
    /// Weight of `f(t_j)` in the same integral; 0 for j = 0.
    pub held_end: Vec<f64>,
    /// Weight of the sample j of a continuous f in `∫ φ_h f dτ`, error O(h⁴) (Numerov).
    pub node: Vec<f64>,
}

impl Weights {
    /// Weights of the piecewise linear function with the values `phi` at the nodes; the two end values count as zero.
    pub fn new(phi: &[f64]) -> Self {
        let last = phi.len().saturating_sub(1).max(1);
        let h = 1.0 / last as f64;
        let at = |j: usize| if j == 0 || j >= last { 0.0 } else { phi[j] };
        let before = |j: usize| if j == 0 { 0.0 } else { at(j - 1) };
        let interval = |j: usize, start: f64, end: f64| {
            if j == 0 { 0.0 } else { h / 6.0 * (start * before(j) + end * at(j)) }
        };
        Self {
            position: (0..=last).map(|j| ((at(j + 1) - at(j)) - (at(j) - before(j))) / h).collect(),
            held_start: (0..=last).map(|j| interval(j, 2.0, 1.0)).collect(),
            held_end: (0..=last).map(|j| interval(j, 1.0, 2.0)).collect(),
            node: (0..=last).map(|j| h / 12.0 * (before(j) + 10.0 * at(j) + at(j + 1))).collect(),
        }
    }

    /// Weights of row `row` = 0, 1, 2 of P(18), the discrete counterpart of the paper's kernels i = 1, 2, 3.
    pub fn paper(row: usize, intervals: usize) -> Self {
        // The paper's g_u,i is `factor · ψ_n'`.
        let (n, factor) = (row + 3, if row % 2 == 1 { -1.0 } else { 1.0 } / 6.0);
        let between = |j: usize| psi_between_nodes(n, j, intervals);
        let inside = |j: usize| factor * intervals as f64 * (between(j) - between(j - 1));
        let phi = (0..=intervals).map(|j| if (1..intervals).contains(&j) { inside(j) } else { 0.0 });
        Self::new(&phi.collect::<Vec<_>>())
    }

    /// Weights that retain a constant force (method section 6, static load): `φ = ψ_3/∫ψ_3`, with mean one.
    pub fn static_load(intervals: usize) -> Self {
        // Coefficients of `ψ_3(τ) = τ³ (1 − τ)³`, that of τⁿ at index n.
        let coefficients = [0.0, 0.0, 0.0, 1.0, -3.0, 3.0, -1.0];
        let psi_3 = |tau: f64| coefficients.iter().rev().fold(0.0, |sum, c| sum * tau + c);
        let mean: f64 = coefficients.iter().enumerate().map(|(n, c)| c / (n as f64 + 1.0)).sum();
        let phi: Vec<f64> = (0..=intervals).map(|j| psi_3(j as f64 / intervals as f64) / mean).collect();
        Self::new(&phi)
    }

    /// Gain of the position side for white noise, `√(Σ position_j²)`.
    pub fn noise_gain(&self) -> f64 {
        self.position.iter().map(|w| w * w).sum::<f64>().sqrt()
    }

    /// `Σ |node_j|`, the L1 gain of the current side: its largest response to a signal bounded by one.
    pub fn l1_gain(&self) -> f64 {
        self.node.iter().map(|w| w.abs()).sum()
    }
}
