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
//! The nodes are `τ_j = j h`, `h = 1/N`. The test function is the broken line `φ_h` through its values `φ_j` at
//! the nodes, with `φ_0 = φ_N = 0`. For a broken line the weak form needs no quadrature on the position side:
//!
//! ```text
//! T_f² ∫ φ_h Z̈ dτ = Σ_j (φ_{j+1} − 2 φ_j + φ_{j−1}) Z_j / h        for every Z with an integrable Z̈
//! ```
//!
//! Constants and slopes of Z drop out to rounding. `φ` is the central difference of a primitive `Ψ` given between the nodes,
//! `φ(τ) = (Ψ(τ + h/2) − Ψ(τ − h/2))/h`, and therefore `Σ φ_j = 0` telescopes: a constant force drops out as well.
//! `Ψ` is `ψ_n` with one factor `τ²` read as `τ² − h²/4` and one factor `(1 − τ)²` as `(1 − τ)² − h²/4`
//! (central factorials). It differs from `ψ_n` by O(h²) and makes the two end values of `φ` vanish.
//! All differences are those of the rounded values, so that the sums that telescope on paper telescope in the computer
//! too. What rounding does to the shape of `φ''` grows with N³: relative 1e-11 at N = 200, 2e-3 at 100 000.

use nalgebra::DMatrix;
use serde::{Deserialize, Serialize};

/// Number of rows that one axis contributes to P(18).
pub const ROWS_PER_AXIS: usize = 3;

/// A polynomial in τ (dimensionless), coefficients in ascending order.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Polynomial {
    /// Coefficient of τⁿ at index n; no coefficients is the zero polynomial.
    pub coefficients: Vec<f64>,
}

impl Polynomial {
    /// The polynomial with these coefficients, ascending.
    #[must_use]
    pub fn new(coefficients: impl Into<Vec<f64>>) -> Self {
        Self { coefficients: coefficients.into() }
    }

    /// τⁿ.
    #[must_use]
    pub fn power(n: usize) -> Self {
        let mut coefficients = vec![0.0; n + 1];
        coefficients[n] = 1.0;
        Self { coefficients }
    }

    /// Value at `tau`, by Horner's rule.
    #[must_use]
    pub fn value(&self, tau: f64) -> f64 {
        self.coefficients.iter().rev().fold(0.0, |sum, c| sum * tau + c)
    }

    /// `self · factor`.
    #[must_use]
    pub fn scaled(&self, factor: f64) -> Self {
        Self { coefficients: self.coefficients.iter().map(|c| c * factor).collect() }
    }

    /// `self + other`.
    #[must_use]
    pub fn plus(&self, other: &Self) -> Self {
        let (long, short) =
            if self.coefficients.len() >= other.coefficients.len() { (self, other) } else { (other, self) };
        let mut coefficients = long.coefficients.clone();
        for (sum, c) in coefficients.iter_mut().zip(&short.coefficients) {
            *sum += c;
        }
        Self { coefficients }
    }

    /// `self · other`.
    #[must_use]
    pub fn times(&self, other: &Self) -> Self {
        if self.coefficients.is_empty() || other.coefficients.is_empty() {
            return Self::default();
        }
        let mut coefficients = vec![0.0; self.coefficients.len() + other.coefficients.len() - 1];
        for (i, a) in self.coefficients.iter().enumerate() {
            for (j, b) in other.coefficients.iter().enumerate() {
                coefficients[i + j] += a * b;
            }
        }
        Self { coefficients }
    }

    /// d/dτ.
    #[must_use]
    pub fn derivative(&self) -> Self {
        Self { coefficients: self.coefficients.iter().enumerate().skip(1).map(|(n, c)| c * n as f64).collect() }
    }

    /// `∫ self dτ` over [0, 1].
    #[must_use]
    pub fn integral(&self) -> f64 {
        self.coefficients.iter().enumerate().map(|(n, c)| c / (n as f64 + 1.0)).sum()
    }
}

/// `ψ_n(τ) = τⁿ (1 − τ)³`.
#[must_use]
pub fn psi(n: usize) -> Polynomial {
    Polynomial::power(n).times(&Polynomial::new([1.0, -3.0, 3.0, -1.0]))
}

/// `Ψ_n(τ) = τ^{n−2} (τ² − h²/4) (1 − τ) ((1 − τ)² − h²/4)` at `τ = (j + ½) h`, for n ≥ 2 and j < N.
///
/// This is `ψ_n` with central factorials of step `h = 1/N`; it is exactly zero half a step inside both ends.
#[must_use]
pub fn psi_between_nodes(n: usize, j: usize, intervals: usize) -> f64 {
    let from_start = (2 * j + 1) as f64;
    let width = (2 * intervals) as f64;
    let from_end = width - from_start;
    let (a, b) = (from_start / width, from_end / width);
    let cut = |x: f64| (x * x - 1.0) / (width * width);
    (2..n).fold(cut(from_start) * b * cut(from_end), |product, _| product * a)
}

/// `(n, factor)` of row `i` = 0, 1, 2: the paper's `g_u,i+1` is `factor · ψ_n'`.
pub(super) fn exponent_and_factor(row: usize) -> (usize, f64) {
    let sign = if row % 2 == 1 { -1.0 } else { 1.0 };
    (row + 3, sign / 6.0)
}

/// The paper's `g_{u_z,i}` without its power of `T_f`, from `ψ`; `row` = 0, 1, 2 is i = 1, 2, 3.
#[must_use]
pub fn paper_current_kernel(row: usize) -> Polynomial {
    let (n, factor) = exponent_and_factor(row);
    psi(n).derivative().scaled(factor)
}

/// The paper's `g_{z,i}` without its power of `T_f`, from `ψ`; `row` = 0, 1, 2 is i = 1, 2, 3.
#[must_use]
pub fn paper_position_kernel(row: usize) -> Polynomial {
    paper_current_kernel(row).derivative().derivative()
}

/// What one test function weighs the samples of a window with; every vector has a weight for each of the N + 1
/// nodes, oldest first. Dimensionless.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
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
    /// Weights of the broken line through `phi`, its values at all nodes; the two end values count as zero.
    #[must_use]
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
    #[must_use]
    pub fn paper(row: usize, intervals: usize) -> Self {
        let (n, factor) = exponent_and_factor(row);
        let between = |j: usize| psi_between_nodes(n, j, intervals);
        let phi: Vec<f64> =
            (0..=intervals)
                .map(|j| {
                    if j == 0 || j == intervals {
                        0.0
                    } else {
                        factor * intervals as f64 * (between(j) - between(j - 1))
                    }
                })
                .collect();
        Self::new(&phi)
    }

    /// Weights of at most `most − 1` test functions, the broken lines through [`sine_combinations`].
    #[must_use]
    pub fn sines(intervals: usize, most: usize, position_noise: f64, force_noise: f64) -> Vec<Self> {
        let combinations = sine_combinations(intervals, most, position_noise, force_noise);
        let sines: Vec<Vec<f64>> = (1..=combinations.len() + 1).map(|n| sine(n, intervals).collect()).collect();
        combinations
            .iter()
            .map(|combination| {
                let mut phi = vec![0.0; intervals + 1];
                for (sine, coefficient) in sines.iter().zip(combination) {
                    for (value, sine) in phi.iter_mut().zip(sine) {
                        *value += coefficient * sine;
                    }
                }
                Self::new(&phi)
            })
            .collect()
    }

    /// Weights that keep a constant force (method section 6, static load): `φ = ψ_3/∫ψ_3`, with mean one.
    #[must_use]
    pub fn static_load(intervals: usize) -> Self {
        let psi_3 = psi(3);
        let mean = psi_3.integral();
        let phi: Vec<f64> = (0..=intervals).map(|j| psi_3.value(j as f64 / intervals as f64) / mean).collect();
        Self::new(&phi)
    }

    /// Gain of the position side for white noise, `√Σ position_j²`.
    #[must_use]
    pub fn noise_gain(&self) -> f64 {
        self.position.iter().map(|w| w * w).sum::<f64>().sqrt()
    }

    /// `Σ |node_j|`, the largest answer of the current side to a signal bounded by one.
    #[must_use]
    pub fn reach(&self) -> f64 {
        self.node.iter().map(|w| w.abs()).sum()
    }
}

/// `sin nπτ` at the nodes of a window, both end values exactly zero.
fn sine(n: usize, intervals: usize) -> impl Iterator<Item = f64> {
    (0..=intervals).map(move |j| {
        if j == 0 || j == intervals {
            0.0
        } else {
            libm::sin(std::f64::consts::PI * ((n * j) % (2 * intervals)) as f64 / intervals as f64)
        }
    })
}

/// Coefficients of `sin nπτ`, n = 1 … `most`, in at most `most − 1` test functions that together see all that a window tells below
/// `most/(2 T_f)`.
///
/// They span the sines without their mean, so that a constant force drops out; they need no more than
/// the zeros at both ends that the weak form asks for. Noise of the positions, standard deviation `position_noise`, and
/// of the forces, `force_noise` (per sample and unit of `g_u`, in the unit of the positions), has the covariance
/// `R = position_noise² G_z G_zᵀ + force_noise² G_u G_uᵀ` in them; the functions returned are combined by the inverse of
/// its Cholesky factor, so that there `R = 1`: plain least squares on them is the weighted least squares of a window.
#[must_use]
pub fn sine_combinations(intervals: usize, most: usize, position_noise: f64, force_noise: f64) -> Vec<Vec<f64>> {
    let most = most.min(intervals / 2).max(2);
    let first: Vec<f64> = sine(1, intervals).collect();
    let first_sum: f64 = first.iter().sum();
    let (shares, plain): (Vec<f64>, Vec<Weights>) = (2..=most)
        .map(|n| {
            let mut phi: Vec<f64> = sine(n, intervals).collect();
            let share = if n % 2 == 1 { phi.iter().sum::<f64>() / first_sum } else { 0.0 };
            for (value, first) in phi.iter_mut().zip(&first) {
                *value -= share * first;
            }
            (share, Weights::new(&phi))
        })
        .unzip();
    let product = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let count = plain.len();
    let covariance = DMatrix::from_fn(count, count, |i, l| {
        position_noise * position_noise * product(&plain[i].position, &plain[l].position)
            + force_noise * force_noise * product(&plain[i].node, &plain[l].node)
    });
    // A Gram matrix of independent functions is positive definite; where rounding says otherwise the plain ones do.
    let factor = covariance.cholesky().and_then(|cholesky| cholesky.l().try_inverse());
    let factor = factor.unwrap_or_else(|| DMatrix::identity(count, count));
    (0..count)
        .map(|i| {
            let of_first: f64 = -(0..=i).map(|l| factor[(i, l)] * shares[l]).sum::<f64>();
            std::iter::once(of_first).chain((0..count).map(|l| if l <= i { factor[(i, l)] } else { 0.0 })).collect()
        })
        .collect()
}

/// Coefficients of `sin nπτ`, n = 1 … `most`, in the sum of sines nearest to `τ³ (1 − τ)³`, with mean one: the test function of the static
/// load where sums of sines are at hand. With twelve sines it is off by 1e-5 of its peak.
#[must_use]
pub fn static_load_sines(intervals: usize, most: usize) -> Vec<f64> {
    let psi_3 = psi(3);
    let h = 1.0 / intervals as f64;
    let coefficients: Vec<f64> = (1..=most)
        .map(|n| sine(n, intervals).enumerate().map(|(j, sine)| psi_3.value(j as f64 * h) * sine).sum())
        .collect();
    let mean: f64 = coefficients.iter().enumerate().map(|(n, c)| c * sine(n + 1, intervals).sum::<f64>() * h).sum();
    coefficients.iter().map(|coefficient| coefficient / mean).collect()
}
