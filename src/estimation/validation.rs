//! Model validation (Ljung, section 16.6): do the innovations look like noise, and do the data agree with themselves?
//!
//! Every test is of a quantity whose distribution is known when model and noise are right. Limits are set so that a right model fails about once
//! in a million tests; tolerances widen them by what they can explain.

use libm::{exp, sqrt};
use nalgebra::{SMatrix, SVector};
use serde::{Deserialize, Serialize};

use super::config::Verdict;
use super::innovations::Innovation;
use super::motion::Square;
use super::noise::OUTLIER;
use super::sums::PredictionErrorSolution;

/// Harmonics of the rotor angle that are tested, and the limit of χ² of each; 35 with four degrees of freedom: probability 4.6·10⁻⁷.
const HARMONICS: usize = 4;
const HARMONIC_LIMIT: f64 = 4.735;

/// The value of χ² that is so many standard deviations of a normal distribution out (E. B. Wilson, M. M. Hilferty, 1931).
fn chi_square(degrees: usize, deviations: f64) -> f64 {
    let n = degrees as f64;
    let root = 1.0 - 2.0 / (9.0 * n) + deviations * sqrt(2.0 / (9.0 * n));
    n * root * root * root
}

/// The part of the innovations' power at a harmonic that is taken to remain, whatever the estimate has absorbed: gains change while it settles.
const LEAST_LEFT: f64 = 1.0e-3;

/// Memory of their sums, s: what is too small to show within this time does not matter, and data of minutes show any approximation.
const HARMONICS_MEMORY_S: f64 = 10.0;

/// Revolutions that the sums must hold before the innovations are tested for harmonics.
const HARMONICS_AFTER: f64 = 0.75;

/// Limit of the correlation of successive innovations, in standard deviations: probability 5.7·10⁻⁷.
const WHITENESS_LIMIT: f64 = 5.0;

/// Innovations beyond this many standard deviations count as such in the test of whiteness.
const WHITENESS_CLIP: f64 = 5.0;

/// Revolutions over which correlation and mean square of the innovations are taken.
const MEAN_REVOLUTIONS: f64 = 3.0;

/// Limit of the normalised innovation squared per degree of freedom: innovations 1.6 times as strong as they should be.
const NIS_LIMIT: f64 = 2.5;

/// An estimate that is not valid becomes so below this part of each limit (hysteresis).
const EASE: f64 = 0.7;

/// Sums and means of the tests.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Validation<const N: usize, const U: usize, const T: usize> {
    /// Revolutions at the start.
    since: f64,
    /// Revolutions when the sums of the harmonics began, and the sums.
    harmonics_since: f64,
    harmonics: [Harmonic<N, U, T>; HARMONICS],
    /// The greatest χ² of a harmonic.
    greatest: f64,
    /// Innovations in the means; product of successive ones, square, the last one.
    averaged: f64,
    product: f64,
    square: f64,
    last: SVector<f64, N>,
    /// Normalised innovation squared per degree of freedom.
    pub nis: f64,
}

/// Sums of the whitened signals times cosine and sine of a harmonic of the rotor angle. The innovations of any estimate follow from them.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Harmonic<const N: usize, const U: usize, const T: usize> {
    /// Sums of cos², cos sin and sin².
    squares: [f64; 3],
    motion: [SMatrix<f64, 1, N>; 2],
    unknowns: [SMatrix<f64, U, N>; 2],
    tolerances: [SMatrix<f64, T, N>; 2],
}

impl<const N: usize, const U: usize, const T: usize> Harmonic<N, U, T> {
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

    /// χ² (score test): with the estimate `ϑ = J⁻¹ b`, the sums a of its innovations have the covariance
    /// `C − B J⁻¹ Bᵀ`, C that of white innovations and B the sums of φ, and what the tolerances make of them. It is `C + B J⁻¹ Bᵀ` where the
    /// unknowns may have moved since, as in the prediction of data that the estimate has not seen.
    fn chi_square(&self, found: &PredictionErrorSolution<U, T>, moved: bool, position_variance: f64) -> f64 {
        let sign = if moved { 1.0 } else { -1.0 };
        let [cc, cs, ss] = self.squares;
        let floor = LEAST_LEFT * (cc + ss);
        let sums = [0, 1].map(|part| self.motion[part].transpose() - self.unknowns[part].tr_mul(&found.unknowns));
        // ψ, and what the estimate makes of it.
        let by = [0, 1].map(|part| self.tolerances[part] + found.sensitivity.tr_mul(&self.unknowns[part]));
        let covariance = |r: usize, c: usize, white: f64| {
            by[r].tr_mul(&by[c]) / position_variance
                + Square::<N>::identity() * white
                + self.unknowns[r].tr_mul(&(found.inverse * self.unknowns[c])) * sign
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
    /// Begins anew at a revolution.
    pub fn start(revolution: f64) -> Self {
        Self {
            since: revolution,
            harmonics_since: revolution,
            harmonics: [Harmonic::zeros(); HARMONICS],
            greatest: 0.0,
            averaged: 0.0,
            product: 0.0,
            square: N as f64,
            last: SVector::zeros(),
            nis: 1.0,
        }
    }

    /// Counts the sums so far with this weight, and forgets for a time in s.
    pub fn discount(&mut self, weight: f64, time_s: f64) {
        let weight = weight * exp(-time_s / HARMONICS_MEMORY_S);
        for harmonic in &mut self.harmonics {
            harmonic.squares = harmonic.squares.map(|x| x * weight * weight);
            for part in 0..2 {
                harmonic.motion[part] *= weight;
                harmonic.unknowns[part] *= weight;
                harmonic.tolerances[part] *= weight;
            }
        }
    }

    /// Forgets the sums.
    pub fn forget(&mut self, revolution: f64) {
        (self.harmonics_since, self.harmonics) = (revolution, [Harmonic::zeros(); HARMONICS]);
        self.greatest = 0.0;
    }

    /// Revolutions since the last start.
    pub fn revolutions(&self, revolution: f64) -> f64 {
        revolution - self.since
    }

    /// Takes in the signals of an innovation at the rotor angle (cos θ, sin θ).
    #[inline(always)]
    pub fn add<const K: usize>(&mut self, innovation: &Innovation<N, K, U, T>, [c, s]: [f64; 2]) {
        let mut at = [1.0, 0.0];
        for harmonic in &mut self.harmonics {
            at = [at[0] * c - at[1] * s, at[1] * c + at[0] * s];
            harmonic.add(innovation, at);
        }
    }

    /// Takes in the innovation of a good estimate.
    #[inline(always)]
    pub fn add_settled(&mut self, error: &SVector<f64, N>, position_variance: f64, per_revolution: f64) {
        let white = error / sqrt(position_variance);
        let clipped = white.map(|e| e.clamp(-WHITENESS_CLIP, WHITENESS_CLIP));
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

    /// Judges the harmonics of what an estimate leaves unexplained; whether the unknowns may have moved while the sums were gathered.
    pub fn judge_harmonics(
        &mut self,
        revolution: f64,
        found: &PredictionErrorSolution<U, T>,
        moved: bool,
        position_variance: f64,
    ) {
        let enough = revolution - self.harmonics_since > HARMONICS_AFTER;
        let found = self.harmonics.iter().map(|harmonic| harmonic.chi_square(found, moved, position_variance));
        self.greatest = if enough { found.fold(0.0, f64::max) } else { 0.0 };
    }

    /// The verdict on an estimate that was valid or not.
    pub fn verdict(&self, per_revolution: f64, was_valid: bool) -> Verdict {
        let ease = if was_valid { 1.0 } else { EASE };
        let samples = N as f64 * self.averaged.min(2.0 * MEAN_REVOLUTIONS * per_revolution);
        let correlation = self.product / self.square.max(1.0) * sqrt(samples);
        if self.greatest >= chi_square(2 * N, HARMONIC_LIMIT * ease) || self.nis > NIS_LIMIT * ease {
            Verdict::Unexplained
        } else if correlation.abs() >= WHITENESS_LIMIT * ease {
            Verdict::Coloured
        } else {
            Verdict::Valid
        }
    }
}
