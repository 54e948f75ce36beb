//! Maximum-likelihood identification from whole recordings, including the imperfections of a bench.
//!
//! # Method
//!
//! Positions and currents are measured with white noise. The search is Gauss–Newton on the innovations of a Kalman filter whose states are the coordinates
//! read by the sensors and their rates; it includes negative stiffness and gyroscopic effect, and treats current noise as process noise. Every iteration
//! linearises again about the smoothed trajectory. The moving object is a [`Body`]; the radial and the axial motion of a shaft are each a [`Part`] with its own
//! likelihood. Forces, directions and accelerations come from the on-line estimator ([`Machine`](crate::estimation::Machine)); their derivatives with
//! respect to bench parameters are central differences of two such descriptions. Four measures keep the score `Σ φᵀ S⁻¹ e` unbiased:
//!
//! - The square of a noisy current is too large by σ² on average; σ² is subtracted.
//! - The sensitivity to λ is driven by the force at the position *predicted by the filter*. The smoothed position depends on later innovations; with
//!   the negative stiffness their product has a non-zero expectation, which for a rotor held by feedback is that of d ln det S/dλ (five standard
//!   deviations with 3 µm of noise over 5 s).
//! - The process noise of an interval uses the squared currents of that interval. Means over 33 samples, a third of a turn at 200 µs, left coloured
//!   innovations and biased the λ of a bearing that noise excites by 3.7 standard deviations after 5 s.
//! - The regressors contain the *measured* squared currents. Their noise attenuates λ; position noise, through the controller, raises it. The two
//!   cancel only where the loop is fast: at 82 nm and 23 mA one alone is 39 standard deviations after 5 s, and 5 of them remain. If the bench is known
//!   exactly, the remainder is estimated with instruments (two-stage least squares): the squared currents as shaft angle and past innovations explain them.
//!   Innovations are white, so the instruments are uncorrelated with later ones. The part they cannot determine is added to the covariance.
//!   The stiffness of the filter uses the same currents.
//!
//! The filter gains depend on the force noise, λ times the current noise. At the end of a search with an exactly known bench the columns are total
//! sensitivities: they include the effect of a parameter through the gains.
//!
//! A bench parameter ([`parameters`]) is one more column. With a tolerance it has a Gaussian prior; if known exactly it is not estimated, but its
//! column shows how an error in it would affect λ (the budget) and whether the residuals call for it (the suspects).
//!
//! Results are bit-identical for any number of threads: recordings are cut into pieces of fixed length, whose sums are added in order.

mod bench;
mod body;
mod case;
mod changes;
mod data;
mod expected;
mod filter;
mod kalman;
mod lag;
mod outcome;
mod resolution;
mod rotor;
mod search;
mod solve;

use std::ops::Range;

use nalgebra::{DMatrix, DVector};
use serde_json::{Value as Json, json};

pub use self::bench::{BenchParameter, Knowledge, by_name, parameters};
pub(super) use self::bench::{DELAY, DYNAMICS, LAG};
pub use self::body::Body;
pub use self::filter::HARMONICS;
pub(super) use self::search::BENCH_ROWS;
pub use crate::estimation::Hold;
use crate::machine::Bearing;
use crate::studies::identify::{plain, significant};

/// Noise below that of any position sensor, m, and of any current sensor, A: a simulation without noise, whose residuals are rounding. A wrong bench
/// raises that of the currents, a gap stated 4 % too large to 6 mA.
pub(super) const SILENT_M: f64 = 1e-9;
pub(super) const SILENT_A: f64 = 1e-4;

/// Whether the noise is below that of any sensor.
pub(super) fn is_silent(position_noise_m: f64, current_noise_a: f64) -> bool {
    position_noise_m < SILENT_M && current_noise_a < SILENT_A
}

/// One recording with a uniform sample time.
#[derive(Clone, Debug)]
pub struct Recording {
    /// Time of the first row, s.
    pub start_s: f64,
    /// Sample time, s.
    pub step_s: f64,
    /// Positions by coordinate, m.
    pub position_m: Vec<Vec<f64>>,
    /// Currents by magnet, A.
    pub current_a: Vec<Vec<f64>>,
    /// Angle of the shaft, rad; may be wrapped.
    pub theta_rad: Vec<f64>,
    /// Speed of the shaft, rad/s.
    pub omega_rad_s: Vec<f64>,
    /// Whether the angle counts from a mark of the shaft, the same in all recordings, and not from its position in the first row.
    pub has_mark: bool,
    /// Usable samples; unusable ones separate segments, each with its own state.
    pub usable: Vec<bool>,
    /// Standard deviation of positions that were not recorded, m, by coordinate: 0 for recorded ones; empty if all were recorded.
    pub position_error_m: Vec<Vec<f32>>,
    /// The same for squared currents, A², by magnet; infinite where nothing is known.
    pub square_error_a2: Vec<Vec<f32>>,
    /// Meaning of a current sample.
    pub hold: Hold,
    /// Standard deviation of the position noise, m, if stated.
    pub position_noise_m: Option<f64>,
    /// Standard deviation of the current noise, A, if stated.
    pub current_noise_a: Option<f64>,
}

impl Recording {
    /// Number of rows.
    fn rows(&self) -> usize {
        self.theta_rad.len()
    }
}

/// Settings of a part of the motion other than its bench.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PartSettings {
    /// Known loads, N or N·m, by coordinate; empty if there are none.
    pub load_n: Vec<Option<f64>>,
    /// Whether κ, the factor between statics and dynamics, is a bench parameter. It needs a known load.
    pub dynamics: bool,
    /// Whether the lag of the currents behind their commands is a bench parameter.
    pub lag: bool,
    /// Whether the exponent is estimated with which position noise grows with the gap.
    pub exponent: bool,
}

impl PartSettings {
    /// Whether a known load gives forces a scale of their own, apart from accelerations.
    #[must_use]
    pub fn is_loaded(&self) -> bool {
        self.load_n.iter().flatten().any(|load_n| *load_n != 0.0)
    }
}

/// A part of the motion that is identified separately.
#[derive(Clone, Debug)]
pub struct Part {
    /// The body that moves.
    pub body: Body,
    /// Index of its first position in a recording.
    pub positions: usize,
    /// Index of its first magnet.
    pub magnets: usize,
    /// Further settings.
    pub settings: PartSettings,
    /// Bench parameters.
    pub parameters: Vec<BenchParameter>,
    /// λ, U cos φ and U sin φ of each plane and values of the bench, if they are given; empty if they are to be estimated.
    pub given: Vec<f64>,
}

impl Part {
    /// A part whose bench is exactly as stated.
    #[must_use]
    pub fn new(body: Body, positions: usize, magnets: usize) -> Self {
        let settings = PartSettings::default();
        let parameters = parameters(&body, &settings);
        Self { body, positions, magnets, settings, parameters, given: Vec::new() }
    }

    /// The same with other settings; the knowledge of its bench stays.
    #[must_use]
    pub fn with(mut self, change: impl FnOnce(&mut PartSettings)) -> Self {
        change(&mut self.settings);
        let mut parameters = parameters(&self.body, &self.settings);
        for parameter in &mut parameters {
            if let Some(before) = by_name(&self.parameters, &parameter.name) {
                parameter.knowledge = self.parameters[before].knowledge;
            }
        }
        Self { parameters, ..self }
    }
}

/// Prior knowledge of a machine.
#[derive(Clone, Debug)]
pub struct Options {
    /// Parts of the motion.
    pub parts: Vec<Part>,
    /// Whether an unexplained slow force is estimated, a random walk along every coordinate.
    pub slow_force: bool,
    /// Whether rows inconsistent with the others are left out.
    pub excludes_rows: bool,
    /// Whether the bias of the likelihood is removed, and gains count in the covariance, where the bench is known exactly.
    pub corrects_bias: bool,
}

impl Options {
    /// The bench parameters.
    pub fn bench(&mut self) -> impl Iterator<Item = &mut BenchParameter> {
        self.parts.iter_mut().flat_map(|part| &mut part.parameters)
    }

    /// The same with given estimates of all that recordings share.
    pub(super) fn given(mut self, found: &Identification) -> Self {
        let (mut lambda, mut unbalance, mut bench) = (found.lambda.iter(), found.unbalance.iter(), found.bench.iter());
        for part in &mut self.parts {
            let lambda = lambda.by_ref().take(part.body.magnets()).map(|of| of.value);
            let unbalance = unbalance.by_ref().take(part.body.planes()).flat_map(Unbalance::components);
            let bench = bench.by_ref().take(part.parameters.len()).map(|of| of.estimate.value);
            part.given = lambda.chain(unbalance).chain(bench).collect();
        }
        self
    }

    /// The same with the tolerance of a typical bench for the delay of the positions, where neither a delay nor a lag is stated.
    pub(super) fn late(mut self) -> Self {
        let parts = self.parts.iter_mut().filter(|part| !part.settings.lag);
        let delays = parts.flat_map(|part| &mut part.parameters).filter(|of| plain(&of.name) == DELAY);
        delays.filter(|of| !of.is_uncertain()).for_each(|of| of.knowledge = Knowledge::Tolerance(of.typical));
        self
    }
}

/// Reason why identification failed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Failed {
    /// Too few consecutive samples.
    #[error("recording {recording} has no {SHORTEST} usable samples in a row")]
    TooShort {
        /// Number of the recording, from 1.
        recording: usize,
    },
    /// Some rows are inconsistent with the others, and none may be left out.
    #[error("some rows are inconsistent with the others")]
    Contradicted {
        /// Gain in log-likelihood by a slow force with everything else unchanged.
        gain: f64,
    },
    /// The search diverged.
    #[error("the search does not converge: {0}")]
    Diverged(String),
}

/// A value with its standard deviations.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Estimate {
    /// The value.
    pub value: f64,
    /// Standard deviation due to noise.
    pub noise_std: f64,
    /// Standard deviation due to noise and tolerances.
    pub total_std: f64,
}

/// A non-negative quantity estimated below 0 by more than this many standard deviations indicates a wrong model.
const SIGNIFICANT_STD: f64 = 3.0;

impl Estimate {
    /// Whether the value is significantly negative.
    pub(super) fn is_negative(&self) -> bool {
        self.value < -SIGNIFICANT_STD * self.total_std
    }

    /// Value and standard deviations as JSON.
    pub(super) fn json(&self) -> Json {
        json!({"value": self.value, "std": self.noise_std, "stdTotal": self.total_std})
    }

    /// Value and both standard deviations in this unit, formatted for tables.
    pub(super) fn cells(&self, unit: f64) -> [String; 3] {
        [(self.value, 5), (self.noise_std, 2), (self.total_std, 2)].map(|(of, digits)| significant(of / unit, digits))
    }

    /// Estimate of a quantity proportional to this one.
    #[must_use]
    pub fn scaled(&self, factor: f64) -> Self {
        Self { value: factor * self.value, noise_std: factor * self.noise_std, total_std: factor * self.total_std }
    }
}

/// Conditions of one recording, which differ between recordings, and its residuals.
#[derive(Clone, Debug, PartialEq)]
pub struct Conditions {
    /// Constant load by coordinate, N.
    pub load_n: Vec<Estimate>,
    /// By part of the motion.
    pub parts: Vec<PartResults>,
    /// Step of each position sensor, m; 0 unless it is quantised.
    pub resolution_m: Vec<f64>,
    /// Mean of `2 λ_k i_k/gap_k²` over the recording, N/A.
    pub ki_n_a: Vec<Estimate>,
    /// Mean of `2 λ_k i_k²/gap_k³` over the recording, N/m.
    pub ks_n_m: Vec<Estimate>,
    /// χ² (two degrees of freedom) of the whitened innovations at harmonics of the shaft angle, from the first, by coordinate.
    pub harmonics: Vec<[f64; HARMONICS]>,
    /// Amplitudes of these harmonics, relative to the noise of one innovation.
    pub amplitudes: Vec<[f64; HARMONICS]>,
    /// Position minus its one-step prediction, by coordinate and row, m; NaN where a row was not used.
    pub prediction_errors_m: Vec<Vec<f64>>,
}

/// Results of a recording for one part of the motion.
#[derive(Clone, Debug, PartialEq)]
pub struct PartResults {
    /// Standard deviation of the position noise, m.
    pub position_noise_m: f64,
    /// Standard deviation of the current noise, A.
    pub current_noise_a: f64,
    /// Level of a slow force along each coordinate, a random walk, N after one second; 0 unless estimated.
    pub slow_force_n: f64,
    /// Exponent with which position noise grows with the gap, if estimated; the noise level is that at the nominal gap.
    pub noise_exponent: Option<Estimate>,
    /// Rows used.
    pub rows: usize,
    /// Effective number of rows: smaller where quantisation errors repeat with the readings.
    pub counting: usize,
    /// rms of the prediction errors one sample and 20 ms ahead, m.
    pub prediction_rms_m: [f64; 2],
    /// Lag-one correlation of the whitened innovations, mean over all axes; 1/√(axes · rows) by chance.
    pub correlation: f64,
}

/// Estimate of a bench parameter and its entry in the budget: its effect on λ.
#[derive(Clone, Debug, PartialEq)]
pub struct BenchEstimate {
    /// The parameter.
    pub parameter: BenchParameter,
    /// Value and standard deviation; 0 if known exactly.
    pub estimate: Estimate,
    /// Whether it was estimated, or has a tolerance on which the data give no information; false if known, or not separable.
    pub estimated: bool,
    /// Whether it is free but held at its stated value because the data do not separate it from other parameters.
    pub is_held: bool,
    /// Relative error of λ̂_k per unit of unknown deviation of the parameter from its stated value.
    pub sensitivity: Vec<f64>,
    /// Standard deviation used for `contribution`, in the parameter's unit: the stated tolerance, or that of a typical bench.
    pub tolerance: f64,
    /// Relative standard deviation of λ_k due to this parameter. If estimated, its square is the variance that exact knowledge would remove.
    pub contribution: Vec<f64>,
}

/// Smallest contribution to ± of λ that is displayed.
const MIN_SHOWN: f64 = 5e-5;

/// A bench parameter that the residuals call for, the two that are the gain of one position sensor, or several together.
#[derive(Clone, Debug, PartialEq)]
pub struct Suspect {
    /// Indices in [`Identification::bench`], with the value after one step from the stated one, in the unit of the parameter.
    pub parameters: Vec<(usize, f64)>,
    /// Standard deviation of each value; NaN if they differ.
    pub std: f64,
    /// Decrease of the χ² of the innovations (Lagrange multiplier test) with the tolerances of a typical bench.
    pub chi_square: f64,
}

/// A section of a recording that is inconsistent with the others.
#[derive(Clone, Debug, PartialEq)]
pub struct Contradiction {
    /// Index of the recording, from 0.
    pub recording: usize,
    /// Index of the part of the motion, from 0.
    pub part: usize,
    /// Its rows.
    pub rows: Range<usize>,
    /// Description.
    pub what: Change,
}

/// Kind of inconsistency.
#[derive(Clone, Debug, PartialEq)]
pub enum Change {
    /// Innovations larger than elsewhere: an impact, a touchdown, a disturbance. The rows were left out.
    Disturbed {
        /// Normalised innovation squared, relative to the rest of the recording.
        ratio: f64,
    },
    /// Different λ, N·m²/A²: estimates from this section alone.
    Lambda(Vec<Estimate>),
    /// λ drifts throughout the recording, so that nothing was left out: relative differences between its end and its start.
    Drift(Vec<f64>),
    /// Different load.
    Load {
        /// χ² of the change, with one degree of freedom per load.
        chi_square: f64,
        /// Whether a change of λ explains it about as well.
        or_lambda: bool,
    },
}

impl Change {
    /// Whether λ or the load differ before and after an instant.
    pub(super) fn divides(&self) -> bool {
        matches!(self, Self::Lambda(_) | Self::Load { .. })
    }
}

/// Unbalance in a plane of the rotor.
#[derive(Clone, Debug, PartialEq)]
pub struct Unbalance {
    /// |U|, kg·m.
    pub magnitude: Estimate,
    /// Angle of U, rad.
    pub phase: Estimate,
}

impl Unbalance {
    /// U cos φ and U sin φ, kg·m.
    pub(super) fn components(&self) -> [f64; 2] {
        let (sin, cos) = libm::sincos(self.phase.value);
        [cos, sin].map(|of| self.magnitude.value * of)
    }
}

/// Result for all recordings.
#[derive(Clone, Debug, PartialEq)]
pub struct Identification {
    /// Force constants, N·m²/A².
    pub lambda: Vec<Estimate>,
    /// Relative standard deviations of the force constants with the tolerances of a typical bench where none is stated.
    pub typical_std: Vec<f64>,
    /// Covariance of the force constants due to noise and tolerances.
    pub lambda_covariance: DMatrix<f64>,
    /// By plane.
    pub unbalance: Vec<Unbalance>,
    /// By recording.
    pub conditions: Vec<Conditions>,
    /// By bench parameter.
    pub bench: Vec<BenchEstimate>,
    /// Bench parameters that the residuals call for, those first that explain most with the tolerances of a typical bench.
    pub suspects: Vec<Suspect>,
    /// All bench parameters that are not estimated, if the residuals call for them together, with the tolerances of a typical bench.
    pub together: Option<Suspect>,
    /// Sections inconsistent with the others.
    pub contradictions: Vec<Contradiction>,
    /// Whether the covariance comes from the scores of blocks of the recording (heteroscedasticity- and autocorrelation-consistent, Newey and West
    /// 1987), because they vary more than the model predicts, instead of from the information matrix.
    pub covariance_from_scores: bool,
    /// Iterations of the last search.
    pub iterations: usize,
    /// Whether the last step was smaller than 5 % of a standard deviation.
    pub converged: bool,
    /// Gain in log-likelihood by a slow force with everything else unchanged; where it is not estimated, taken before a change of load or λ is left out.
    pub gain_by_slow_force: f64,
    /// Log-likelihood of the rows used, up to a constant that depends only on their number.
    pub log_likelihood: f64,
}

/// The result, or why there is none.
pub type Identified = Result<Identification, Failed>;

/// Shortest segment, in rows: its first rows determine only its initial state.
const SHORTEST: usize = 16;

/// Identifies force constants, unbalance, loads and unknown bench parameters from all recordings together. The columns of a recording have equal length
/// and are finite where usable.
///
/// # Errors
/// See [`Failed`].
pub fn identify(recordings: &[Recording], options: &Options) -> Identified {
    let mut parts = options.parts.iter();
    let first = parts.next().expect("something moves").identify(recordings, options)?;
    parts.try_fold(first, |all, part| Ok(all.merged(part.identify(recordings, options)?)))
}

impl Identification {
    /// Budget entries to display for the magnets of a bearing; with several bearings, the relevant ones.
    pub fn budget_of(&self, bearing: &Bearing, magnets: &Range<usize>) -> impl Iterator<Item = &BenchEstimate> {
        self.bench.iter().filter(|line| {
            line.parameter.is_uncertain() && bearing.prefix.is_empty()
                || line.contribution[magnets.clone()].iter().any(|part| *part >= MIN_SHOWN)
        })
    }

    /// Names of the bench parameters that the data do not separate from others.
    pub(super) fn held(&self) -> impl Iterator<Item = &str> {
        self.bench.iter().filter(|of| of.is_held).map(|of| of.parameter.name.as_str())
    }

    /// Whether the search converged to magnets that push.
    pub(super) fn pushes(&self) -> bool {
        self.converged && self.lambda.iter().any(Estimate::is_negative)
    }

    /// Results of all recordings for all parts of the motion.
    pub(super) fn parts(&self) -> impl Iterator<Item = &PartResults> {
        self.conditions.iter().flat_map(|conditions| &conditions.parts)
    }

    /// Inflates the variances of λ by the square of its difference to another identification, with a weight from 0 to 1.
    pub(super) fn widen(&mut self, other: &Self, weight: f64) {
        let moved = DVector::from_fn(self.lambda.len(), |k, _| other.lambda[k].value - self.lambda[k].value);
        let moved = moved * weight.sqrt();
        self.lambda_covariance += &moved * moved.transpose();
        for (k, moved) in moved.iter().enumerate() {
            let relative = moved / self.lambda[k].value;
            self.typical_std[k] = self.typical_std[k].hypot(relative);
            let of_recordings = self.conditions.iter_mut().flat_map(|of| [&mut of.ki_n_a[k], &mut of.ks_n_m[k]]);
            for estimate in of_recordings.chain([&mut self.lambda[k]]) {
                let std = relative * estimate.value;
                estimate.noise_std = estimate.noise_std.hypot(std);
                estimate.total_std = estimate.total_std.hypot(std);
            }
        }
    }

    /// Combines this with another, independent part of the motion.
    fn merged(mut self, other: Self) -> Self {
        let (parameters, parts) = (self.bench.len(), self.conditions[0].parts.len());
        let [before, after] = [&self, &other].map(|of| of.lambda.len());
        // Neither part affects the magnets of the other.
        self.bench.extend(other.bench);
        for (at, line) in self.bench.iter_mut().enumerate() {
            for own in [&mut line.sensitivity, &mut line.contribution] {
                let first = if at < parameters { 0 } else { before };
                own.splice(..0, std::iter::repeat_n(0.0, first));
                own.resize(before + after, 0.0);
            }
        }
        self.lambda_covariance.resize_mut(before + after, before + after, 0.0);
        self.lambda_covariance.view_mut((before, before), (after, after)).copy_from(&other.lambda_covariance);
        self.lambda.extend(other.lambda);
        self.typical_std.extend(other.typical_std);
        self.unbalance.extend(other.unbalance);
        for (own, of) in self.conditions.iter_mut().zip(other.conditions) {
            own.load_n.extend(of.load_n);
            own.parts.extend(of.parts);
            own.resolution_m.extend(of.resolution_m);
            own.ki_n_a.extend(of.ki_n_a);
            own.ks_n_m.extend(of.ks_n_m);
            own.harmonics.extend(of.harmonics);
            own.amplitudes.extend(of.amplitudes);
            own.prediction_errors_m.extend(of.prediction_errors_m);
        }
        for mut suspect in other.suspects {
            suspect.parameters.iter_mut().for_each(|(at, _)| *at += parameters);
            self.suspects.push(suspect);
        }
        self.suspects.sort_by(|a, b| b.chi_square.total_cmp(&a.chi_square));
        if let Some(mut all) = other.together {
            all.parameters.iter_mut().for_each(|(at, _)| *at += parameters);
            if let Some(own) = self.together.take() {
                all.parameters.extend(own.parameters);
                all.chi_square += own.chi_square;
            }
            self.together = Some(all);
        }
        let contradictions = other.contradictions.into_iter();
        self.contradictions.extend(contradictions.map(|of| Contradiction { part: of.part + parts, ..of }));
        self.covariance_from_scores |= other.covariance_from_scores;
        self.iterations = self.iterations.max(other.iterations);
        self.converged &= other.converged;
        self.gain_by_slow_force += other.gain_by_slow_force;
        self.log_likelihood += other.log_likelihood;
        self
    }
}
