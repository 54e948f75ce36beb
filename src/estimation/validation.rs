//! Model validation (Ljung, section 16.6): are the innovations white noise of the expected size?
//!
//! Each test statistic has a known distribution if model and noise are correct. A correct model fails about once in a million tests; tolerances widen the
//! limits by the errors that they can explain.

use std::f64::consts::{FRAC_PI_2, PI, TAU};
use std::mem::take;

use libm::{exp, sqrt};
use nalgebra::{SMatrix, SVector};
use serde::{Deserialize, Serialize};

use super::angle;
use super::config::Verdict;
use super::innovations::Innovation;
use super::motion::Square;
use super::noise::OUTLIER;
use super::sums::PredictionErrorSolution;

/// Harmonics of the rotor angle that are tested.
const HARMONICS: usize = 4;

/// The quantile of χ² with n degrees of freedom at this many standard deviations of a normal distribution (E. B. Wilson, M. M. Hilferty, 1931).
pub fn chi_square(n: f64, deviations: f64) -> f64 {
    let root = 1.0 - 2.0 / (9.0 * n) + deviations * sqrt(2.0 / (9.0 * n));
    n * root * root * root
}

/// Limit of χ² of a harmonic, in standard deviations: 35 with four degrees of freedom, probability 4.6·10⁻⁷; and of another order, for the same
/// probability over all orders (Bonferroni): 41.
const HARMONIC_LIMIT: f64 = 4.735;
const ORDER_LIMIT: f64 = 5.2;

/// Fraction of these limits below which all lines must be for an estimate to become valid (hysteresis), a level of about 5 % over all lines: a line just
/// below its limit has biased λ by several standard deviations. With 0.7, 25 of 400 runs with 1 N at twice the speed were valid but off by more than 5
/// standard deviations, with 0.5 11, with 0.4 8, but then 8 of 200 nominal runs were not valid after two revolutions, with 0.5 one (seeds from 986001).
const LINE_HYSTERESIS: f64 = 0.5;

/// Limit of the correlation of successive innovations in standard deviations, probability 5.7·10⁻⁷; innovations are clipped to it.
const WHITENESS_LIMIT: f64 = 5.0;

/// Other orders that are tested, a quarter apart: their number, and how far they stay away from 0 and from the rotor, in quarters of an order. They detect
/// forces with a frequency of their own before these bias λ. Drifting λ and unbalance leave residuals near the rotor speed, where harmonics are tested
/// with a longer memory.
const ORDERS: usize = 15;
const APART: f64 = 2.0;

/// Memory of correlation and mean square of the innovations, revolutions: 600 samples at 3000 rpm and 10 kHz, which give the mean square to 4 %.
const MEAN_REVOLUTIONS: f64 = 3.0;

/// Test statistics.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Validation<const N: usize, const U: usize, const T: usize> {
    /// Completed quarters since the start, and since the sums of the lines began.
    quarters: [usize; 2],
    /// Of the harmonics; with velocity and position of each coordinate in place of sine and cosine, because forces that lag behind the motion or damp it
    /// have its frequencies, whatever these are; then of the other orders. On the heap: the threads of importers have small stacks.
    lines: Vec<Line<N, U, T>>,
    /// Mean position, m.
    mean_m: SVector<f64, N>,
    /// Revolutions since the start, modulo four, and revolutions of the rotor per such revolution, 0 at rest.
    revolutions: f64,
    rotor_ratio: f64,
    /// The greatest χ² of a harmonic or of the motion, and of an order.
    greatest: [f64; 2],
    /// Number of innovations in the means; means of the product of successive ones and of the square; the last one.
    averaged: f64,
    product: f64,
    square: f64,
    last: SVector<f64, N>,
    /// Normalised innovation squared per degree of freedom.
    pub nis: f64,
}

/// A spectral line: sums of the whitened signals times cosine and sine of an order, from which the component of the innovations of any estimate follows.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Line<const N: usize, const U: usize, const T: usize> {
    /// Sums of cos², cos sin and sin².
    squares: [f64; 3],
    motion: [SMatrix<f64, 1, N>; 2],
    unknowns: [SMatrix<f64, U, N>; 2],
    tolerances: [SMatrix<f64, T, N>; 2],
}

impl<const N: usize, const U: usize, const T: usize> Line<N, U, T> {
    fn zeros() -> Self {
        Self {
            squares: [0.0; 3],
            motion: [SMatrix::zeros(); 2],
            unknowns: [SMatrix::zeros(); 2],
            tolerances: [SMatrix::zeros(); 2],
        }
    }

    #[inline(always)]
    fn add<const K: usize>(&mut self, innovation: &Innovation<N, K, U, T>, [c, s]: [f64; 2]) {
        self.squares[0] += c * c;
        self.squares[1] += c * s;
        self.squares[2] += s * s;
        for (part, factor) in [c, s].into_iter().enumerate() {
            self.motion[part] += innovation.motion * factor;
            self.unknowns[part] += innovation.unknowns * factor;
            if let Some(tolerances) = &innovation.tolerances {
                self.tolerances[part] += tolerances * factor;
            }
        }
    }

    fn scale(&mut self, weight: f64) {
        self.squares = self.squares.map(|x| x * weight * weight);
        for part in 0..2 {
            self.motion[part] *= weight;
            self.unknowns[part] *= weight;
            self.tolerances[part] *= weight;
        }
    }

    /// χ² (score test): with the estimate `ϑ = J⁻¹ b` the sums of its innovations have the covariance `C − B J⁻¹ Bᵀ`, C that of white innovations and
    /// B the sums of φ, plus the effect of the tolerances. It is `C + B J⁻¹ Bᵀ` if the unknowns may have changed since, as for predictions of data that
    /// were not used for the estimate.
    fn chi_square<const K: usize>(&self, found: &PredictionErrorSolution<'_, K, U, T>, changing: bool) -> f64 {
        let sign = if changing { 1.0 } else { -1.0 };
        let [cc, cs, ss] = self.squares;
        // However much of a harmonic the estimate absorbs, this variance is assumed to remain, because gains change while it settles.
        let floor = 1.0e-3 * (cc + ss);
        let sums = [0, 1].map(|part| self.motion[part].transpose() - self.unknowns[part].tr_mul(&found.unknowns));
        // ψ, and its effect through the estimate.
        let by_tolerance = [0, 1].map(|part| self.tolerances[part] + found.sensitivity.tr_mul(&self.unknowns[part]));
        let estimated = self.unknowns.map(|unknowns| found.inverse * unknowns * sign);
        let covariance = |r: usize, c: usize, white: f64| {
            by_tolerance[r].tr_mul(&by_tolerance[c]) / found.position_variance
                + Square::<N>::identity() * white
                + self.unknowns[r].tr_mul(&estimated[c])
        };
        // Test the cosine components, then the sine components given the cosines.
        let Some(cosines) = covariance(0, 0, cc + floor).cholesky() else { return 0.0 };
        let mixed = covariance(0, 1, cs);
        let Some(sines) = (covariance(1, 1, ss + floor) - mixed.tr_mul(&cosines.solve(&mixed))).cholesky() else {
            return 0.0;
        };
        let normalised = cosines.solve(&sums[0]);
        let remainder = sums[1] - mixed.tr_mul(&normalised);
        (normalised.dot(&sums[0]) + sines.solve(&remainder).dot(&remainder)) / found.position_variance
    }
}

impl<const N: usize, const U: usize, const T: usize> Validation<N, U, T> {
    /// Index of the first of the other orders among the lines, and the number of lines.
    const FIRST_ORDER: usize = HARMONICS + N;
    const LINES: usize = Self::FIRST_ORDER + ORDERS;

    pub fn start() -> Self {
        Self::of(vec![Line::zeros(); Self::LINES])
    }

    /// The start with these lines.
    fn of(lines: Vec<Line<N, U, T>>) -> Self {
        Self {
            quarters: [0; 2],
            lines,
            mean_m: SVector::zeros(),
            revolutions: 0.0,
            rotor_ratio: 0.0,
            greatest: [0.0; 2],
            averaged: 0.0,
            product: 0.0,
            square: N as f64,
            last: SVector::zeros(),
            nis: 1.0,
        }
    }

    /// Starts again, without allocation.
    pub fn restart(&mut self) {
        self.forget();
        *self = Self::of(take(&mut self.lines));
    }

    /// Whether all lines are there.
    pub fn has_shape(&self) -> bool {
        self.lines.len() == Self::LINES
    }

    /// Multiplies the sums of the harmonics by a weight, and forgets over a time in s. The memory is 10 s: lines not detected within that time do not
    /// matter, and over minutes any approximation is detected (one of three runs of 150 s with known noise ended `Unexplained`).
    pub fn discount(&mut self, weight: f64, time_s: f64) {
        let weight = weight * exp(-time_s / 10.0);
        self.lines[..Self::FIRST_ORDER].iter_mut().for_each(|line| line.scale(weight));
    }

    /// Discards the sums of the lines; their last test results hold until new ones are available.
    pub fn forget(&mut self) {
        self.quarters[1] = 0;
        self.lines.fill(Line::zeros());
    }

    /// Counts a quarter of a revolution.
    pub fn end_quarter(&mut self) {
        self.quarters = self.quarters.map(|quarters| quarters + 1);
        // A memory of 4/π revolutions minimises the loss of a line between two orders: `M/(1 + (π M/4)²)` is greatest there.
        let forgetting = exp(-0.25 / (4.0 / PI));
        self.lines[Self::FIRST_ORDER..].iter_mut().for_each(|line| line.scale(forgetting));
    }

    /// Quarters since the last start.
    pub fn quarters(&self) -> usize {
        self.quarters[0]
    }

    /// The orders that are left out, from and up to, in quarters, whole numbers because the angle is known modulo four revolutions.
    fn left_out(&self) -> [f64; 2] {
        let ratio = if N == 1 { 0.0 } else { self.rotor_ratio };
        // A slow rotor leaves out all orders below its own, and less above.
        let [below, above] = if ratio > 1.0 { [APART; 2] } else { [f64::INFINITY, APART * ratio] };
        [4.0 * ratio - below, 4.0 * ratio + above].map(|order| order.ceil().max(APART))
    }

    /// Adds a fraction of a revolution, with this many revolutions of the rotor per revolution.
    pub fn advance(&mut self, passed: f64, rotor_ratio: f64) {
        self.revolutions = (self.revolutions + passed) % 4.0;
        self.rotor_ratio = rotor_ratio;
    }

    /// Adds the signals of an innovation at the rotor angle (cos θ, sin θ), with the number of samples per revolution.
    #[inline(always)]
    pub fn add<const K: usize>(&mut self, innovation: &Innovation<N, K, U, T>, cos_sin: [f64; 2], per_revolution: f64) {
        let add = |lines: &mut [Line<N, U, T>], [mut a, mut b]: [f64; 2], [c, s]: [f64; 2]| {
            for line in lines {
                line.add(innovation, [a, b]);
                (a, b) = (a * c - b * s, b * c + a * s);
            }
        };
        let left_out = self.left_out();
        let (harmonics, others) = self.lines.split_at_mut(HARMONICS);
        let (motion, orders) = others.split_at_mut(N);
        if self.rotor_ratio > 0.0 {
            add(harmonics, cos_sin, cos_sin);
        }
        let quarter = FRAC_PI_2 * self.revolutions;
        let ([from, to], step) = (left_out, angle::cos_sin(quarter));
        let (below, above) = orders.split_at_mut(((from - APART) as usize).min(ORDERS));
        for (first, lines) in [(APART, below), (to, above)] {
            if !lines.is_empty() {
                add(lines, angle::cos_sin(first * quarter), step);
            }
        }
        let [position_m, per_sample_m] = innovation.predicted_m;
        let deviation_m = position_m - self.mean_m;
        self.mean_m += deviation_m / per_revolution.max(1.0);
        for (n, line) in motion.iter_mut().enumerate() {
            line.add(innovation, [per_sample_m[n] * per_revolution / TAU, deviation_m[n]]);
        }
    }

    /// Adds the innovation of a settled estimate to the means.
    #[inline(always)]
    pub fn add_settled(&mut self, error: &SVector<f64, N>, position_variance: f64, per_revolution: f64) {
        let white = error / sqrt(position_variance);
        let clipped = white.map(|e| e.clamp(-WHITENESS_LIMIT, WHITENESS_LIMIT));
        self.averaged += 1.0;
        // At least one sample: at an impossible speed the mean would diverge.
        let memory = (MEAN_REVOLUTIONS * per_revolution).max(1.0);
        let weight = 1.0 / self.averaged.min(memory);
        self.product += weight * (clipped.dot(&self.last) - self.product);
        self.square += weight * (clipped.norm_squared() - self.square);
        self.last = clipped;
        self.nis += (white.norm_squared().min(OUTLIER) / N as f64 - self.nis) / memory;
    }

    /// The normalised innovation squared, and the degrees of freedom of its exponentially weighted mean.
    pub fn nis_with_degrees(&self, per_revolution: f64) -> [f64; 2] {
        [self.nis, N as f64 * 2.0 * MEAN_REVOLUTIONS * per_revolution]
    }

    /// Tests the lines in the residuals of an estimate; `changing` if the unknowns may have changed while the sums were accumulated.
    pub fn test_lines<const K: usize>(
        &mut self,
        found: &PredictionErrorSolution<'_, K, U, T>,
        changing: bool,
        per_revolution: f64,
    ) {
        // Harmonics need a whole revolution.
        if self.quarters[1] <= 3 {
            return;
        }
        // Above 0.4 of the sampling rate cosine and sine are not independent.
        let [from, to] = self.left_out();
        let orders = (1.6 * per_revolution - APART - (to - from)).clamp(0.0, ORDERS as f64) as usize;
        let greatest =
            |lines: &[Line<N, U, T>]| lines.iter().map(|line| line.chi_square(found, changing)).fold(0.0, f64::max);
        let first = if self.rotor_ratio > 0.0 { 0 } else { HARMONICS };
        let (lines, others) = self.lines.split_at(Self::FIRST_ORDER);
        self.greatest = [greatest(&lines[first..]), greatest(&others[..orders])];
    }

    /// The verdict on an estimate that was valid so far, or not.
    pub fn verdict(&self, per_revolution: f64, was_valid: bool) -> Verdict {
        // Hysteresis: an estimate becomes valid below this fraction of each limit.
        let [hysteresis, line_hysteresis] = if was_valid { [1.0; 2] } else { [0.7, LINE_HYSTERESIS] };
        let samples = N as f64 * self.averaged.min(2.0 * MEAN_REVOLUTIONS * per_revolution);
        let correlation = self.product / self.square.max(1.0) * sqrt(samples);
        let [harmonic, order] = self.greatest;
        let order = order / (self.square / N as f64).max(1.0);
        // A normalised innovation squared of 2.5 means innovations 1.6 times too large.
        if harmonic >= chi_square((2 * N) as f64, HARMONIC_LIMIT * line_hysteresis) || self.nis > 2.5 * hysteresis {
            Verdict::Unexplained
        } else if correlation.abs() >= WHITENESS_LIMIT * hysteresis
            || order >= chi_square((2 * N) as f64, ORDER_LIMIT * line_hysteresis)
        {
            Verdict::Coloured
        } else {
            Verdict::Valid
        }
    }
}
