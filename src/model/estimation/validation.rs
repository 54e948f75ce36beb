//! Model validation (Ljung, section 16.6): do the innovations look like noise, and do the data agree with themselves?
//!
//! Every test is of a quantity whose distribution is known when model and noise are right. Limits are set so that a right model fails about once
//! in a million tests; tolerances widen them by what they can explain.

use libm::exp;
use nalgebra::{SMatrix, SVector};
use serde::{Deserialize, Serialize};

use super::config::Verdict;
use super::innovations::{Innovation, TOLERANCES, UNKNOWNS};
use super::noise::OUTLIER;
use super::sums::{Definite, Sums, product};

/// Limit of χ² with seven degrees of freedom between the last revolution and those before: probability 1.4·10⁻⁷.
const CHANGE_LIMIT: f64 = 45.0;

/// Harmonics of the rotor angle that are tested, and the limit of χ² with four degrees of freedom of each: probability 4.6·10⁻⁷.
const HARMONICS: usize = 4;
const HARMONIC_LIMIT: f64 = 35.0;

/// Revolutions after a start before the innovations are tested for harmonics: those of a first estimate hold its error.
const HARMONICS_AFTER: f64 = 3.0;

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

/// What the tests have gathered since the last start.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Validation {
    /// Revolutions at the last start, and at the last restart after a change with the count of restarts that has not leaked away.
    since: f64,
    restarted: f64,
    restarts: f64,
    /// Samples in the sums of whitened innovations times cosine and sine of each harmonic, and of what each tolerance makes of them.
    samples: f64,
    harmonics: [[f64; 4]; HARMONICS],
    by_tolerance: [[[f64; TOLERANCES]; 4]; HARMONICS],
    /// The greatest χ² of a harmonic.
    greatest: f64,
    /// Innovations in the means; product of successive ones, square, the last one.
    averaged: f64,
    product: f64,
    square: f64,
    last: [f64; 2],
    /// Normalised innovation squared per degree of freedom.
    pub nis: f64,
}

impl Validation {
    /// Begins anew at a revolution.
    pub fn start(revolution: f64) -> Self {
        Self { since: revolution, restarted: revolution, square: 2.0, nis: 1.0, ..Self::default() }
    }

    /// Begins anew after a change of λ.
    pub fn restart(&mut self, revolution: f64) {
        self.restarts = self.recent_restarts(revolution) + 1.0;
        (self.restarted, self.since, self.samples) = (revolution, revolution, 0.0);
        (self.harmonics, self.by_tolerance, self.greatest) = Default::default();
    }

    /// Revolutions since the last start.
    pub fn revolutions(&self, revolution: f64) -> f64 {
        revolution - self.since
    }

    fn recent_restarts(&self, revolution: f64) -> f64 {
        self.restarts * exp(-(revolution - self.restarted) / RESTART_REVOLUTIONS)
    }

    /// Takes in an innovation at the rotor angle (cos θ, sin θ); `sensitivity` is that of the estimate, if there are tolerances.
    #[inline(always)]
    pub fn add(
        &mut self,
        innovation: &Innovation,
        position_variance: f64,
        turn: [f64; 2],
        revolution: f64,
        per_revolution: f64,
        sensitivity: Option<&[[f64; TOLERANCES]; UNKNOWNS]>,
    ) {
        let scale = 1.0 / position_variance.sqrt();
        let white = innovation.whitened(innovation.error).map(|e| scale * e);
        if self.revolutions(revolution) > HARMONICS_AFTER {
            self.samples += 1.0;
            let explained = sensitivity.map(|sensitivity| {
                let mut changes = innovation.tolerance;
                for (axis, change) in changes.iter_mut().enumerate() {
                    for (phi, by) in innovation.regression[axis][1..].iter().zip(sensitivity) {
                        // ψ, and what the estimate makes of it.
                        change.iter_mut().zip(by).for_each(|(change, by)| *change += phi * by);
                    }
                }
                std::array::from_fn::<[f64; 2], TOLERANCES, _>(|n| {
                    innovation.whitened([changes[0][n], changes[1][n]]).map(|e| scale * e)
                })
            });
            let [c, s] = turn;
            let mut at = [1.0, 0.0];
            for (sums, by) in self.harmonics.iter_mut().zip(&mut self.by_tolerance) {
                at = [at[0] * c - at[1] * s, at[1] * c + at[0] * s];
                for (n, sum) in sums.iter_mut().enumerate() {
                    *sum += white[n / 2] * at[n % 2];
                }
                if let Some(explained) = &explained {
                    for (n, row) in by.iter_mut().enumerate() {
                        row.iter_mut().zip(explained).for_each(|(sum, e)| *sum += e[n / 2] * at[n % 2]);
                    }
                }
            }
        }
        let clipped = white.map(|e| e.clamp(-WHITENESS_CLIP, WHITENESS_CLIP));
        self.averaged += 1.0;
        let part = 1.0 / self.averaged.min(MEAN_REVOLUTIONS * per_revolution);
        self.product += part * (clipped[0] * self.last[0] + clipped[1] * self.last[1] - self.product);
        self.square += part * (clipped[0] * clipped[0] + clipped[1] * clipped[1] - self.square);
        self.last = clipped;
        let nis = (white[0] * white[0] + white[1] * white[1]).min(OUTLIER);
        self.nis += (0.5 * nis - self.nis) / (MEAN_REVOLUTIONS * per_revolution);
    }

    /// Judges the harmonics: the sums of right innovations have the variance n/2, and what the tolerances make of them.
    pub fn judge_harmonics(&mut self, with_tolerances: bool) {
        self.greatest = 0.0;
        if self.samples < 1.0 {
            return;
        }
        for (sums, by) in self.harmonics.iter().zip(&self.by_tolerance) {
            let sums = SVector::from(*sums);
            let square = if with_tolerances {
                let covariance = SMatrix::<f64, 4, 4>::from_fn(|r, c| {
                    let explained: f64 = by[r].iter().zip(&by[c]).map(|(a, b)| a * b).sum();
                    explained + if r == c { 0.5 * self.samples } else { 0.0 }
                });
                covariance.cholesky().map_or(f64::INFINITY, |factor| factor.solve(&sums).dot(&sums))
            } else {
                2.0 * sums.norm_squared() / self.samples
            };
            self.greatest = self.greatest.max(square);
        }
    }

    /// What the tests say.
    pub fn verdict(&self, revolution: f64, per_revolution: f64, told: bool) -> Verdict {
        let samples = 2.0 * self.averaged.min(2.0 * MEAN_REVOLUTIONS * per_revolution);
        let correlation = self.product / self.square.max(1.0) * samples.sqrt();
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
pub fn has_changed(before: &Sums, last: &Sums, position_variance: f64, with_tolerances: bool) -> bool {
    let (information, former) = (last.information(), before.information());
    let Some(definite) = Definite::new(&former) else { return false };
    let contradiction = last.right() - product(&information, &definite.solve(&before.right()));
    let mut covariance = information + product(&information, &definite.solve(&information));
    covariance *= position_variance;
    if with_tolerances {
        let c = last.tolerances() - product(&information, &definite.solve(&before.tolerances()));
        covariance += SMatrix::from_fn(|r, s| (0..TOLERANCES).map(|n| c[(r, n)] * c[(s, n)]).sum());
    }
    let Some(definite) = Definite::new(&covariance) else { return false };
    definite.solve(&contradiction).dot(&contradiction) > CHANGE_LIMIT
}
