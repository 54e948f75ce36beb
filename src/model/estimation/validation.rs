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
use super::sums::{Definite, PredictionErrorSolution, Sums, product};

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
    last: [f64; 2],
    /// Normalised innovation squared per degree of freedom.
    pub nis: f64,
}

/// Sums of the whitened regression times cosine and sine of each harmonic of the rotor angle, rows y cos, y sin, z cos, z sin. The innovations
/// of any estimate follow from them.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Harmonics {
    since: f64,
    /// Sums of cos², cos sin and sin².
    squares: [[f64; 3]; HARMONICS],
    regression: [[[f64; 1 + UNKNOWNS]; 4]; HARMONICS],
    tolerances: [[[f64; TOLERANCES]; 4]; HARMONICS],
}

impl Harmonics {
    #[inline(always)]
    fn add(&mut self, innovation: &Innovation, turn: [f64; 2], with_tolerances: bool) {
        let regression = innovation.whitened_rows(&innovation.regression);
        let tolerances =
            if with_tolerances { innovation.whitened_rows(&innovation.tolerance) } else { Default::default() };
        let [c, s] = turn;
        let mut at = [1.0, 0.0];
        for harmonic in 0..HARMONICS {
            at = [at[0] * c - at[1] * s, at[1] * c + at[0] * s];
            for (sum, square) in self.squares[harmonic].iter_mut().zip([at[0] * at[0], at[0] * at[1], at[1] * at[1]]) {
                *sum += square;
            }
            for row in 0..4 {
                let weight = at[row % 2];
                for (sum, value) in self.regression[harmonic][row].iter_mut().zip(regression[row / 2]) {
                    *sum += weight * value;
                }
                if with_tolerances {
                    for (sum, value) in self.tolerances[harmonic][row].iter_mut().zip(tolerances[row / 2]) {
                        *sum += weight * value;
                    }
                }
            }
        }
    }

    /// The greatest χ² of a harmonic (score test): with the estimate `ϑ = J⁻¹ b`, the sums a of its innovations have the covariance
    /// `C − B J⁻¹ Bᵀ`, C that of white innovations and B the sums of φ, and what the tolerances make of them.
    fn greatest(&self, found: &PredictionErrorSolution, position_variance: f64) -> f64 {
        let scale = 1.0 / position_variance.sqrt();
        let mut greatest: f64 = 0.0;
        for ((regression, tolerances), [cc, cs, ss]) in self.regression.iter().zip(&self.tolerances).zip(self.squares) {
            let b = SMatrix::<f64, 4, UNKNOWNS>::from_fn(|row, n| regression[row][1 + n]);
            let sums = SVector::<f64, 4>::from_fn(|row, _| {
                scale * (regression[row][0] - b.row(row).transpose().dot(&found.unknowns))
            });
            // ψ, and what the estimate makes of it.
            let by = SMatrix::<f64, 4, TOLERANCES>::from_fn(|row, n| {
                let moved: f64 = (0..UNKNOWNS).map(|l| b[(row, l)] * found.sensitivity[l][n]).sum();
                scale * (tolerances[row][n] + moved)
            });
            let white = [[cc, cs], [cs, ss]];
            let covariance = SMatrix::<f64, 4, 4>::from_fn(|r, c| {
                let explained: f64 = (0..TOLERANCES).map(|n| by[(r, n)] * by[(c, n)]).sum();
                let white = if r / 2 == c / 2 { white[r % 2][c % 2] } else { 0.0 };
                let fitted = product(&found.inverse, &b.row(c).transpose()).dot(&b.row(r).transpose());
                let floor = if r == c { LEAST_LEFT * (cc + ss) } else { 0.0 };
                explained + white - fitted + floor
            });
            let square = covariance.cholesky().map_or(0.0, |factor| factor.solve(&sums).dot(&sums));
            greatest = greatest.max(square);
        }
        greatest
    }
}

impl Validation {
    /// Begins anew at a revolution.
    pub fn start(revolution: f64) -> Self {
        Self { since: revolution, restarted: revolution, square: 2.0, nis: 1.0, ..Self::default() }
    }

    /// Begins anew after a change of λ.
    pub fn restart(&mut self, revolution: f64) {
        let restarts = self.recent_restarts(revolution) + 1.0;
        *self = Self { restarts, ..Self::start(revolution) };
        self.forget(revolution);
    }

    /// Forgets the sums, as the estimate has.
    pub fn forget(&mut self, revolution: f64) {
        self.harmonics = Harmonics { since: revolution, ..Harmonics::default() };
        self.greatest = 0.0;
    }

    /// Revolutions since the last start.
    pub fn revolutions(&self, revolution: f64) -> f64 {
        revolution - self.since
    }

    fn recent_restarts(&self, revolution: f64) -> f64 {
        self.restarts * exp(-(revolution - self.restarted) / RESTART_REVOLUTIONS)
    }

    /// Takes in an innovation at the rotor angle (cos θ, sin θ); that of a good estimate if it is `settled`.
    #[inline(always)]
    pub fn add(
        &mut self,
        innovation: &Innovation,
        position_variance: f64,
        turn: [f64; 2],
        per_revolution: f64,
        settled: bool,
        with_tolerances: bool,
    ) {
        self.harmonics.add(innovation, turn, with_tolerances);
        if !settled {
            return;
        }
        let scale = 1.0 / position_variance.sqrt();
        let white = innovation.whitened(innovation.error).map(|e| scale * e);
        let clipped = white.map(|e| e.clamp(-WHITENESS_CLIP, WHITENESS_CLIP));
        self.averaged += 1.0;
        let part = 1.0 / self.averaged.min(MEAN_REVOLUTIONS * per_revolution);
        self.product += part * (clipped[0] * self.last[0] + clipped[1] * self.last[1] - self.product);
        self.square += part * (clipped[0] * clipped[0] + clipped[1] * clipped[1] - self.square);
        self.last = clipped;
        let nis = (white[0] * white[0] + white[1] * white[1]).min(OUTLIER);
        self.nis += (0.5 * nis - self.nis) / (MEAN_REVOLUTIONS * per_revolution);
    }

    /// Judges the harmonics of what an estimate leaves unexplained.
    pub fn judge_harmonics(&mut self, revolution: f64, found: &PredictionErrorSolution, position_variance: f64) {
        let enough = revolution - self.harmonics.since > HARMONICS_AFTER;
        self.greatest = if enough { self.harmonics.greatest(found, position_variance) } else { 0.0 };
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
