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
//! All differences are formed on the polynomials and not on sampled values, so long windows lose no digits.

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

    /// The central difference `(p(τ + h/2) − p(τ − h/2))/h`, again a polynomial.
    ///
    /// It is the Taylor series `Σ_k (h/2)^{2k} p^{(2k+1)}/(2k+1)!`, which ends with the degree of the polynomial.
    #[must_use]
    pub fn central_difference(&self, h: f64) -> Self {
        let mut sum = Self::default();
        let mut term = self.derivative();
        let mut factor = 1.0;
        let mut order = 1.0;
        while !term.coefficients.is_empty() {
            sum = sum.plus(&term.scaled(factor));
            term = term.derivative().derivative();
            factor *= h * h / (4.0 * (order + 1.0) * (order + 2.0));
            order += 2.0;
        }
        sum
    }
}

/// `ψ_n(τ) = τⁿ (1 − τ)³`.
#[must_use]
pub fn psi(n: usize) -> Polynomial {
    Polynomial::power(n).times(&Polynomial::new([1.0, -3.0, 3.0, -1.0]))
}

/// `Ψ_n`, the primitive between the nodes: `ψ_n` with central factorials of step `h` at both ends.
///
/// `Ψ_n(τ) = τ^{n−2} (τ² − h²/4) (1 − τ) ((1 − τ)² − h²/4)`, for n ≥ 2; it vanishes at ±h/2 and at 1 ± h/2, and
/// `psi_between_nodes(n, 0.0)` is `psi(n)`.
#[must_use]
pub fn psi_between_nodes(n: usize, h: f64) -> Polynomial {
    let q = h * h / 4.0;
    Polynomial::power(n.saturating_sub(2))
        .times(&Polynomial::new([-q, 0.0, 1.0]))
        .times(&Polynomial::new([1.0, -1.0]))
        .times(&Polynomial::new([1.0 - q, -2.0, 1.0]))
}

/// `(n, factor)` of row `i` = 0, 1, 2: the paper's `g_u,i+1` is `factor · ψ_n'`.
fn exponent_and_factor(row: usize) -> (usize, f64) {
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
    /// Weights of the broken line through `phi` at the nodes of `intervals` equal intervals.
    ///
    /// `phi` must vanish at 0 and 1; the values there are taken as zero.
    #[must_use]
    pub fn new(phi: &Polynomial, intervals: usize) -> Self {
        let last = intervals.max(1);
        let h = 1.0 / last as f64;
        let at = |j: usize| if j == 0 || j >= last { 0.0 } else { phi.value(j as f64 * h) };
        let before = |j: usize| if j == 0 { 0.0 } else { at(j - 1) };
        let second = phi.central_difference(h).central_difference(h);
        let position = (0..=last)
            .map(|j| match j {
                0 => at(1) / h,
                j if j == last => before(j) / h,
                j => second.value(j as f64 * h) * h,
            })
            .collect();
        let interval = |j: usize, start: f64, end: f64| {
            if j == 0 { 0.0 } else { h / 6.0 * (start * before(j) + end * at(j)) }
        };
        Self {
            position,
            held_start: (0..=last).map(|j| interval(j, 2.0, 1.0)).collect(),
            held_end: (0..=last).map(|j| interval(j, 1.0, 2.0)).collect(),
            node: (0..=last).map(|j| h / 12.0 * (before(j) + 10.0 * at(j) + at(j + 1))).collect(),
        }
    }

    /// Weights of row `row` = 0, 1, 2 of P(18), the discrete counterpart of the paper's kernels i = 1, 2, 3.
    #[must_use]
    pub fn paper(row: usize, intervals: usize) -> Self {
        let h = 1.0 / intervals.max(1) as f64;
        let (n, factor) = exponent_and_factor(row);
        Self::new(&psi_between_nodes(n, h).central_difference(h).scaled(factor), intervals)
    }

    /// Weights that keep a constant force (method section 6, static load): `φ = ψ_3/∫ψ_3`, with mean one.
    #[must_use]
    pub fn static_load(intervals: usize) -> Self {
        let psi_3 = psi(3);
        Self::new(&psi_3.scaled(1.0 / psi_3.integral()), intervals)
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
