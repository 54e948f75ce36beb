//! Model validation (Ljung, section 16.6): do the innovations look like noise, and do the data agree with themselves?
//!
//! Every test is of a quantity whose distribution is known when model and noise are right. Limits are set so that a right model fails about once
//! in a million tests; tolerances widen them by what they can explain.

use libm::{exp, sqrt};
use nalgebra::{Matrix4, SMatrix, Vector2, Vector4};
use serde::{Deserialize, Serialize};

use super::config::Verdict;
use super::innovations::{FIRST_TOLERANCE, Innovation, SIGNALS, TOLERANCES, UNKNOWNS};
use super::noise::OUTLIER;
use super::sums::{PredictionErrorSolution, Sums, inverse};

/// Limit of χ² with seven degrees of freedom between the last revolution and those before: probability 1.4·10⁻⁷.
const CHANGE_LIMIT: f64 = 45.0;

/// Harmonics of the rotor angle that are tested, and the limit of χ² with four degrees of freedom of each: probability 4.6·10⁻⁷.
const HARMONICS: usize = 4;
const HARMONIC_LIMIT: f64 = 35.0;

/// The part of the innovations' power at a harmonic that is taken to remain, whatever the estimate has absorbed: gains change while it settles.
const LEAST_LEFT: f64 = 1.0e-3;

/// Revolutions that the sums must hold before the innovations are tested for harmonics.
const HARMONICS_AFTER: f64 = 0.75;

/// Limit of the correlation of successive innovations, in standard deviations: probability 5.7·10⁻⁷.
const WHITENESS_LIMIT: f64 = 5.0;

/// Innovations beyond this many standard deviations count as such in the test of whiteness.
const WHITENESS_CLIP: f64 = 5.0;

/// Revolutions over which correlation and mean square of the innovations are taken.
const MEAN_REVOLUTIONS: f64 = 3.0;

/// Limit of the normalised innovation squared per degree of freedom where the noise is told: innovations 1.4 times as strong as they should be.
const NIS_LIMIT: f64 = 2.0;

/// More restarts than this within [`RESTART_REVOLUTIONS`] are no changes of λ.
const RESTART_LIMIT: f64 = 1.5;
const RESTART_REVOLUTIONS: f64 = 10.0;

/// What the tests have gathered.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Validation {
    /// Revolutions at the last start, and at the last restart after a change with the count of restarts that has not leaked away.
    since: f64,
    restarted: f64,
    restarts: f64,
    harmonics: Harmonics,
    /// The greatest χ² of a harmonic.
    greatest: f64,
    /// Innovations in the means; product of successive ones, square, the last one.
    averaged: f64,
    product: f64,
    square: f64,
    last: Vector2<f64>,
    /// Normalised innovation squared per degree of freedom.
    pub nis: f64,
}

/// Sums of the whitened signals times cosine and sine of each harmonic of the rotor angle, rows y cos, y sin, z cos, z sin. The innovations
/// of any estimate follow from them.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Harmonics {
    since: f64,
    /// Sums of cos², cos sin and sin².
    squares: [[f64; 3]; HARMONICS],
    signals: [[[f64; SIGNALS]; 4]; HARMONICS],
}

impl Harmonics {
    #[inline(always)]
    fn add(&mut self, innovation: &Innovation, [c, s]: [f64; 2], signals: usize) {
        let [y, z] = &innovation.signals;
        let w = innovation.whitening;
        let whitened: [[f64; SIGNALS]; 2] =
            [std::array::from_fn(|n| w.m11 * y[n]), std::array::from_fn(|n| w.m21 * y[n] + w.m22 * z[n])];
        let mut at = [1.0, 0.0];
        for harmonic in 0..HARMONICS {
            at = [at[0] * c - at[1] * s, at[1] * c + at[0] * s];
            let squares = [at[0] * at[0], at[0] * at[1], at[1] * at[1]];
            self.squares[harmonic].iter_mut().zip(squares).for_each(|(sum, square)| *sum += square);
            for (row, sums) in self.signals[harmonic].iter_mut().enumerate() {
                for (sum, value) in sums.iter_mut().zip(&whitened[row / 2]).take(signals) {
                    *sum += at[row % 2] * value;
                }
            }
        }
    }

    /// The greatest χ² of a harmonic (score test): with the estimate `ϑ = J⁻¹ b`, the sums a of its innovations have the covariance
    /// `C − B J⁻¹ Bᵀ`, C that of white innovations and B the sums of φ, and what the tolerances make of them.
    fn greatest(&self, found: &PredictionErrorSolution, position_variance: f64) -> f64 {
        let greatest = self.signals.iter().zip(self.squares).map(|(signals, [cc, cs, ss])| {
            let b = SMatrix::<f64, 4, UNKNOWNS>::from_fn(|row, n| signals[row][1 + n]);
            let psi = SMatrix::<f64, 4, TOLERANCES>::from_fn(|row, n| signals[row][FIRST_TOLERANCE + n]);
            let sums = Vector4::from_fn(|row, _| signals[row][0]) - b * found.unknowns;
            // ψ, and what the estimate makes of it.
            let by = psi + b * found.sensitivity;
            let floor = LEAST_LEFT * (cc + ss);
            let white = Matrix4::from_fn(|r, c| match (r / 2 == c / 2, r % 2 + c % 2) {
                (false, _) => 0.0,
                (true, at) => [cc + floor, cs, ss + floor][at],
            });
            let covariance = by * by.transpose() / position_variance + white - b * found.inverse * b.transpose();
            covariance.cholesky().map_or(0.0, |factor| factor.solve(&sums).dot(&sums) / position_variance)
        });
        greatest.fold(0.0, f64::max)
    }
}

impl Validation {
    /// Begins anew at a revolution.
    pub fn start(revolution: f64) -> Self {
        let harmonics = Harmonics { since: revolution, ..Harmonics::default() };
        Self { since: revolution, restarted: revolution, square: 2.0, nis: 1.0, harmonics, ..Self::default() }
    }

    /// Begins anew after a change of λ.
    pub fn restart(&mut self, revolution: f64) {
        *self = Self { restarts: self.recent_restarts(revolution) + 1.0, ..Self::start(revolution) };
    }

    /// Forgets the sums.
    pub fn forget(&mut self, revolution: f64) {
        self.harmonics = Harmonics { since: revolution, ..Harmonics::default() };
        self.greatest = 0.0;
    }

    pub fn is_finite(&self) -> bool {
        let Self { since, restarted, restarts, greatest, averaged, product, square, nis, .. } = self;
        let sums = self.harmonics.signals.as_flattened().as_flattened().iter();
        let harmonics = sums.chain(self.harmonics.squares.as_flattened()).chain([&self.harmonics.since]);
        let own = [since, restarted, restarts, greatest, averaged, product, square, nis];
        harmonics.chain(own).chain(&self.last).all(|x| x.is_finite())
    }

    /// Revolutions since the last start.
    pub fn revolutions(&self, revolution: f64) -> f64 {
        revolution - self.since
    }

    fn recent_restarts(&self, revolution: f64) -> f64 {
        self.restarts * exp(-(revolution - self.restarted) / RESTART_REVOLUTIONS)
    }

    /// Takes in the signals of an innovation at the rotor angle (cos θ, sin θ).
    #[inline(always)]
    pub fn add(&mut self, innovation: &Innovation, turn: [f64; 2], signals: usize) {
        self.harmonics.add(innovation, turn, signals);
    }

    /// Takes in the innovation of a good estimate.
    #[inline(always)]
    pub fn add_settled(&mut self, innovation: &Innovation, position_variance: f64, per_revolution: f64) {
        let white = innovation.whitening * innovation.error / sqrt(position_variance);
        let clipped = white.map(|e| e.clamp(-WHITENESS_CLIP, WHITENESS_CLIP));
        self.averaged += 1.0;
        let memory = MEAN_REVOLUTIONS * per_revolution;
        let part = 1.0 / self.averaged.min(memory);
        self.product += part * (clipped.dot(&self.last) - self.product);
        self.square += part * (clipped.norm_squared() - self.square);
        self.last = clipped;
        self.nis += (0.5 * white.norm_squared().min(OUTLIER) - self.nis) / memory;
    }

    /// Judges the harmonics of what an estimate leaves unexplained.
    pub fn judge_harmonics(&mut self, revolution: f64, found: &PredictionErrorSolution, position_variance: f64) {
        let enough = revolution - self.harmonics.since > HARMONICS_AFTER;
        self.greatest = if enough { self.harmonics.greatest(found, position_variance) } else { 0.0 };
    }

    /// What the tests say.
    pub fn verdict(&self, revolution: f64, per_revolution: f64, told: bool) -> Verdict {
        let samples = 2.0 * self.averaged.min(2.0 * MEAN_REVOLUTIONS * per_revolution);
        let correlation = self.product / self.square.max(1.0) * sqrt(samples);
        if self.recent_restarts(revolution) > RESTART_LIMIT {
            Verdict::Unsteady
        } else if self.greatest >= HARMONIC_LIMIT || (told && self.nis > NIS_LIMIT) {
            Verdict::Unexplained
        } else if !told && correlation.abs() >= WHITENESS_LIMIT {
            Verdict::Coloured
        } else {
            Verdict::Valid
        }
    }
}

/// Whether the last revolution contradicts what was known before it: the sums of both, in units of σ_z² each.
///
/// With the estimate ϑ of before, `z = b − J ϑ` of the last revolution has the covariance `J + J J_before⁻¹ J`, and what the tolerances make
/// of it.
pub fn has_changed(before: &Sums, last: &Sums, position_variance: f64) -> bool {
    let information = last.information();
    let Some((former, _)) = inverse(&before.information()) else { return false };
    let gain = information * former;
    let contradiction = last.right() - gain * before.right();
    let by_tolerance = last.by_tolerance() - gain * before.by_tolerance();
    let noise = (information + gain * information) * position_variance;
    let Some((weight, _)) = inverse(&(noise + by_tolerance * by_tolerance.transpose())) else { return false };
    contradiction.dot(&(weight * contradiction)) > CHANGE_LIMIT
}
