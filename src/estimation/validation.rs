//! Model validation (Ljung, section 16.6): do the innovations look like noise, and do the data agree with themselves?
//!
//! Every test is of a quantity whose distribution is known when model and noise are right. Limits are set so that a right model fails about once
//! in a million tests; tolerances widen them by what they can explain.

use std::f64::consts::{FRAC_PI_2, PI};

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

/// The value of χ² with n degrees of freedom that is so many standard deviations of a normal distribution out (E. B. Wilson, M. M. Hilferty, 1931).
#[must_use]
pub fn chi_square(n: f64, deviations: f64) -> f64 {
    let root = 1.0 - 2.0 / (9.0 * n) + deviations * sqrt(2.0 / (9.0 * n));
    n * root * root * root
}

/// Limit of χ² of a harmonic: 35 with four degrees of freedom, probability 4.6·10⁻⁷; and of another order, for the same probability over all
/// of them (Bonferroni): 41.
const HARMONIC_LIMIT: f64 = 4.735;
const ORDER_LIMIT: f64 = 5.2;

/// The part of these, in deviations, below which all lines have to be for an estimate to become valid (hysteresis), a level of about 5 % over all of
/// them: a line that is barely below its limit has moved λ by deviations. With 0.7, 25 of 400 runs with 1 N at twice the speed were valid and beyond 5
/// deviations, with 0.5 11, with 0.4 8, but then 8 of 200 nominal runs were not valid after two revolutions, with 0.5 one (seeds from 986001).
const LINES_EASED: f64 = 0.5;

/// Limit of the correlation of successive innovations in standard deviations, probability 5.7·10⁻⁷; innovations beyond it count as such.
const WHITENESS_LIMIT: f64 = 5.0;

/// Other orders that are tested, a quarter apart: the first, in quarters, that of the rotor with which they begin, and their number. Forces with a
/// frequency of their own show there before they have moved λ. Nearer to the speed, λ and unbalance that drift leave something, and the harmonics are
/// tested for longer: not so at rest and along the axis, where nothing turns.
const FIRST_ORDER: f64 = 2.0;
const FIRST_OF_ROTOR: f64 = 6.0;
const ORDERS: usize = 15;

/// Revolutions for which such an order counts: a line between two of these orders then loses least (`M/(1 + (π M/4)²)` is greatest at 4/π).
const ORDER_REVOLUTIONS: f64 = 4.0 / PI;

/// Revolutions over which correlation and mean square of the innovations are taken: over 600 samples at 3000 rpm and
/// 10 kHz the mean square is known to 4 %.
const MEAN_REVOLUTIONS: f64 = 3.0;

/// Sums and means of the tests.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Validation<const N: usize, const U: usize, const T: usize> {
    /// Quarters that have ended since the start, and since the sums of the lines began.
    quarters: [usize; 2],
    harmonics: [Line<N, U, T>; HARMONICS],
    orders: [Line<N, U, T>; ORDERS],
    /// Revolutions since the start, modulo four; those of the rotor in each of them, 0 at rest.
    turned: f64,
    of_rotor: f64,
    /// The greatest χ² of a harmonic, and of an order.
    greatest: [f64; 2],
    /// Innovations in the means; product of successive ones, square, the last one.
    averaged: f64,
    product: f64,
    square: f64,
    last: SVector<f64, N>,
    /// Normalised innovation squared per degree of freedom.
    pub nis: f64,
}

/// Sums of the whitened signals times cosine and sine of an order of the rotor. The innovations of any estimate follow from them.
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
        for (part, by) in [c, s].into_iter().enumerate() {
            self.motion[part] += innovation.motion * by;
            self.unknowns[part] += innovation.unknowns * by;
            if let Some(tolerances) = &innovation.tolerances {
                self.tolerances[part] += tolerances * by;
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

    /// χ² (score test): with the estimate `ϑ = J⁻¹ b`, the sums a of its innovations have the covariance
    /// `C − B J⁻¹ Bᵀ`, C that of white innovations and B the sums of φ, and what the tolerances make of them. It is `C + B J⁻¹ Bᵀ` where the
    /// unknowns may have moved since, as in the prediction of data that the estimate has not seen.
    fn chi_square(&self, found: &PredictionErrorSolution<U, T>, moved: bool, position_variance: f64) -> f64 {
        let sign = if moved { 1.0 } else { -1.0 };
        let [cc, cs, ss] = self.squares;
        // Whatever the estimate has absorbed of a harmonic, a part is taken to remain: gains change while it settles.
        let floor = 1.0e-3 * (cc + ss);
        let sums = [0, 1].map(|part| self.motion[part].transpose() - self.unknowns[part].tr_mul(&found.unknowns));
        // ψ, and what the estimate makes of it.
        let by = [0, 1].map(|part| self.tolerances[part] + found.sensitivity.tr_mul(&self.unknowns[part]));
        let estimated = self.unknowns.map(|unknowns| found.inverse * unknowns * sign);
        let covariance = |r: usize, c: usize, white: f64| {
            by[r].tr_mul(&by[c]) / position_variance
                + Square::<N>::identity() * white
                + self.unknowns[r].tr_mul(&estimated[c])
        };
        // Of the cosines first, then of what these leave of the sines.
        let Some(cosines) = covariance(0, 0, cc + floor).cholesky() else { return 0.0 };
        let mixed = covariance(0, 1, cs);
        let Some(sines) = (covariance(1, 1, ss + floor) - mixed.tr_mul(&cosines.solve(&mixed))).cholesky() else {
            return 0.0;
        };
        let along = cosines.solve(&sums[0]);
        let left = sums[1] - mixed.tr_mul(&along);
        (along.dot(&sums[0]) + sines.solve(&left).dot(&left)) / position_variance
    }
}

impl<const N: usize, const U: usize, const T: usize> Validation<N, U, T> {
    pub fn start() -> Self {
        Self {
            quarters: [0; 2],
            harmonics: [Line::zeros(); HARMONICS],
            orders: [Line::zeros(); ORDERS],
            turned: 0.0,
            of_rotor: 0.0,
            greatest: [0.0; 2],
            averaged: 0.0,
            product: 0.0,
            square: N as f64,
            last: SVector::zeros(),
            nis: 1.0,
        }
    }

    /// Counts the sums so far with this weight, and forgets for a time in s: what is too small to show within 10 s does not matter, and data of minutes
    /// show any approximation (one of three runs of 150 s with known noise ended unexplained).
    pub fn discount(&mut self, weight: f64, time_s: f64) {
        let weight = weight * exp(-time_s / 10.0);
        self.harmonics.iter_mut().for_each(|line| line.scale(weight));
    }

    /// Forgets the sums of the lines; what they said holds until new ones can be judged.
    pub fn forget(&mut self) {
        self.quarters[1] = 0;
        (self.harmonics, self.orders) = ([Line::zeros(); HARMONICS], [Line::zeros(); ORDERS]);
    }

    /// Counts a quarter of a revolution.
    pub fn end_quarter(&mut self) {
        self.quarters = self.quarters.map(|quarters| quarters + 1);
        let kept = exp(-0.25 / ORDER_REVOLUTIONS);
        self.orders.iter_mut().for_each(|line| line.scale(kept));
    }

    /// Quarters since the last start.
    pub fn quarters(&self) -> usize {
        self.quarters[0]
    }

    /// The first order, in quarters: whole ones, for the angle is one modulo four revolutions.
    fn first_order(&self) -> f64 {
        if N == 1 { FIRST_ORDER } else { FIRST_ORDER.max((FIRST_OF_ROTOR * self.of_rotor).ceil()) }
    }

    /// This part of a revolution passes, with so many revolutions of the rotor in one.
    pub fn advance(&mut self, passed: f64, of_rotor: f64) {
        self.turned = (self.turned + passed) % 4.0;
        self.of_rotor = of_rotor;
    }

    /// Takes in the signals of an innovation at the rotor angle (cos θ, sin θ).
    #[inline(always)]
    pub fn add<const K: usize>(&mut self, innovation: &Innovation<N, K, U, T>, turn: [f64; 2]) {
        let each = |lines: &mut [Line<N, U, T>], [mut a, mut b]: [f64; 2], [c, s]: [f64; 2]| {
            for line in lines {
                line.add(innovation, [a, b]);
                (a, b) = (a * c - b * s, b * c + a * s);
            }
        };
        if self.of_rotor > 0.0 {
            each(&mut self.harmonics, turn, turn);
        }
        let quarter = FRAC_PI_2 * self.turned;
        let [first, step] = [self.first_order() * quarter, quarter].map(angle::turn);
        each(&mut self.orders, first, step);
    }

    /// Takes in the innovation of a good estimate.
    #[inline(always)]
    pub fn add_settled(&mut self, error: &SVector<f64, N>, position_variance: f64, per_revolution: f64) {
        let white = error / sqrt(position_variance);
        let clipped = white.map(|e| e.clamp(-WHITENESS_LIMIT, WHITENESS_LIMIT));
        self.averaged += 1.0;
        let memory = MEAN_REVOLUTIONS * per_revolution;
        let part = 1.0 / self.averaged.min(memory);
        self.product += part * (clipped.dot(&self.last) - self.product);
        self.square += part * (clipped.norm_squared() - self.square);
        self.last = clipped;
        self.nis += (white.norm_squared().min(OUTLIER) / N as f64 - self.nis) / memory;
    }

    /// The normalised innovation squared, and the degrees of freedom of its exponentially weighted mean.
    pub fn present(&self, per_revolution: f64) -> [f64; 2] {
        [self.nis, N as f64 * 2.0 * MEAN_REVOLUTIONS * per_revolution]
    }

    /// Judges the lines in what an estimate leaves unexplained; whether the unknowns may have moved while the sums were gathered.
    pub fn judge_lines(
        &mut self,
        found: &PredictionErrorSolution<U, T>,
        moved: bool,
        position_variance: f64,
        per_revolution: f64,
    ) {
        // Less of a revolution holds no harmonic.
        if self.quarters[1] <= 3 {
            return;
        }
        // Beyond 0.4 of the sampling rate cosine and sine are no longer independent.
        let orders = (1.6 * per_revolution - self.first_order()).clamp(0.0, ORDERS as f64) as usize;
        let greatest = |lines: &[Line<N, U, T>]| {
            lines.iter().map(|line| line.chi_square(found, moved, position_variance)).fold(0.0, f64::max)
        };
        let harmonics = if self.of_rotor > 0.0 { greatest(&self.harmonics) } else { 0.0 };
        self.greatest = [harmonics, greatest(&self.orders[..orders])];
    }

    /// The verdict on an estimate that was valid or not.
    pub fn verdict(&self, per_revolution: f64, was_valid: bool) -> Verdict {
        // Hysteresis: an estimate becomes valid below this part of each limit.
        let [ease, line_ease] = if was_valid { [1.0; 2] } else { [0.7, LINES_EASED] };
        let samples = N as f64 * self.averaged.min(2.0 * MEAN_REVOLUTIONS * per_revolution);
        let correlation = self.product / self.square.max(1.0) * sqrt(samples);
        let [harmonic, order] = self.greatest;
        let order = order / (self.square / N as f64).max(1.0);
        // Innovations 1.6 times as strong as they should be.
        if harmonic >= chi_square((2 * N) as f64, HARMONIC_LIMIT * line_ease) || self.nis > 2.5 * ease {
            Verdict::Unexplained
        } else if correlation.abs() >= WHITENESS_LIMIT * ease
            || order >= chi_square((2 * N) as f64, ORDER_LIMIT * line_ease)
        {
            Verdict::Coloured
        } else {
            Verdict::Valid
        }
    }
}
