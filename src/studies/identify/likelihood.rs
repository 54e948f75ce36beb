//! Maximum likelihood over whole recordings, with the imperfections of a bench.
//!
//! # Method
//!
//! Positions and currents are measured with white noise. Gauss–Newton on the innovations of a Kalman filter for the coordinates that the sensors read and their
//! rates, negative stiffness and gyroscope included, with the noise of the currents as process noise. Every iteration linearises anew about the smoothed
//! trajectory. What moves is a [`Body`]: a shaft moves across itself and along itself, each a [`Part`] with a likelihood of its own. Forces, directions and accelerations
//! are those of the on-line estimator ([`Machine`](crate::estimation::Machine)); derivatives to what the bench changes of them are differences of two such descriptions.
//! Four things keep the score `Σ φᵀ S⁻¹ e` free of bias:
//!
//! - The square of a noisy current is too large by σ² on average, which is subtracted.
//! - The sensitivity to λ is driven by the pull where the *filter predicts* the rotor. The smoothed position knows the innovations to come; with
//!   the negative stiffness the product of both has an expectation, which for the rotor held by feedback is that of d ln det S/dλ (with 3 µm of noise over
//!   5 s it is five standard deviations).
//! - The noise of an interval is reckoned with the squared currents of that interval. Means over 33 samples, at 200 µs a third of a turn, left innovations
//!   that were not white, and biased the λ of a bearing that noise excites by 3.7 standard deviations after 5 s.
//! - The regressors contain the *measured* squared currents. Their noise attenuates λ; what the controller makes of the noise of the positions
//!   raises it. The two cancel only where the loop is fast: at 82 nm and 23 mA one is 39 standard deviations after 5 s, and 5 of them remain.
//!   If the bench is known exactly, instruments (two-stage least squares) tell what remains: the squared currents as the angle of the shaft and past
//!   innovations explain them. Innovations are white, so that these are not correlated with those that follow. What they do not tell is added to the covariance.
//!   The stiffness of the filter is that of the same currents.
//!
//! The gains of the filter follow the force noise, λ times the noise of the currents. Where the search ends and the bench is known exactly, the columns are total
//! sensitivities: they contain what a parameter does through the gains.
//!
//! A bench parameter ([`parameters`]) is one more column. Known with a tolerance it has a Gaussian prior; known exactly it is not estimated,
//! but its column says what an error of it would do to λ (the budget) and whether the residuals ask for it (the suspects).
//!
//! Deterministic to the bit, whatever the number of threads: recordings are cut into pieces of fixed length, whose sums are added in
//! order.

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
pub use crate::estimation::Hold;
use crate::machine::Bearing;
use crate::studies::identify::tolerance::plain;
use crate::studies::identify::units::significant;

/// One recording, sampled at equal distances.
#[derive(Clone, Debug)]
pub struct Recording {
    /// Time between two samples, s.
    pub step_s: f64,
    /// Positions by coordinate, m.
    pub position_m: Vec<Vec<f64>>,
    /// Currents by magnet, A.
    pub current_a: Vec<Vec<f64>>,
    /// Angle of the shaft, rad; may be wrapped.
    pub theta_rad: Vec<f64>,
    /// Speed of the shaft, rad/s.
    pub omega_rad_s: Vec<f64>,
    /// Which samples may be used; empty for all of them. What is not usable separates segments, each with a state of its own.
    pub usable: Vec<bool>,
    /// By how much positions may be off that were not recorded, m, standard deviations by coordinate: 0 for those that were; empty if all were.
    pub position_error_m: Vec<Vec<f32>>,
    /// The same of squared currents, A², by magnet; infinite where nothing tells.
    pub square_error_a2: Vec<Vec<f32>>,
    /// Meaning of a sample of a current.
    pub hold: Hold,
    /// Standard deviation of the position noise, m, if known.
    pub position_noise_m: Option<f64>,
    /// Standard deviation of the current noise, A, if known.
    pub current_noise_a: Option<f64>,
}

impl Recording {
    /// Number of its rows.
    fn rows(&self) -> usize {
        self.theta_rad.len()
    }
}

/// Settings of a part of the motion besides its bench.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Beside {
    /// Loads that are known, N or N·m, by coordinate; empty if none is.
    pub load_n: Vec<Option<f64>>,
    /// Whether κ, the factor between statics and dynamics, is a parameter of the bench. It needs a load that is known.
    pub dynamics: bool,
    /// Whether the lag with which the currents follow their commands is a parameter of the bench.
    pub lag: bool,
    /// Whether the power of the gap with which the noise of the positions grows is estimated.
    pub exponent: bool,
}

impl Beside {
    /// Whether a load is known that tells forces from accelerations.
    #[must_use]
    pub fn is_loaded(&self) -> bool {
        self.load_n.iter().flatten().any(|load_n| *load_n != 0.0)
    }
}

/// A part of the motion that is identified by itself.
#[derive(Clone, Debug)]
pub struct Part {
    /// The body that moves.
    pub body: Body,
    /// Place of its first position in a recording.
    pub positions: usize,
    /// Place of its first magnet.
    pub magnets: usize,
    /// Further settings.
    pub beside: Beside,
    /// The parameters of its bench.
    pub parameters: Vec<BenchParameter>,
}

impl Part {
    /// A part whose bench is exactly as stated.
    #[must_use]
    pub fn new(body: Body, positions: usize, magnets: usize) -> Self {
        let beside = Beside::default();
        let parameters = parameters(&body, &beside);
        Self { body, positions, magnets, beside, parameters }
    }

    /// The same with other settings. What is known of its bench stays.
    #[must_use]
    pub fn with(mut self, change: impl FnOnce(&mut Beside)) -> Self {
        change(&mut self.beside);
        let mut parameters = parameters(&self.body, &self.beside);
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
    /// The parts of its motion.
    pub parts: Vec<Part>,
    /// Whether a slow force that nothing explains is estimated, a random walk along every coordinate.
    pub slow_force: bool,
    /// Whether rows that contradict the rest are left out.
    pub leaves_out: bool,
}

impl Options {
    /// The parameters of the bench.
    pub fn bench(&mut self) -> impl Iterator<Item = &mut BenchParameter> {
        self.parts.iter_mut().flat_map(|part| &mut part.parameters)
    }

    /// The same with positions as late as in a typical bench, where nothing is stated of a delay or a lag.
    pub(super) fn late(mut self) -> Self {
        let parts = self.parts.iter_mut().filter(|part| !part.beside.lag);
        let delays = parts.flat_map(|part| &mut part.parameters).filter(|of| plain(&of.name) == DELAY);
        delays.filter(|of| !of.is_open()).for_each(|of| of.knowledge = Knowledge::Tolerance(of.typical));
        self
    }
}

/// Why nothing was identified.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Failed {
    /// Too few samples follow each other.
    #[error("recording {recording} has no {wanted} usable samples in a row")]
    TooShort {
        /// Number of the recording, from 1.
        recording: usize,
        /// How many are needed.
        wanted: usize,
    },
    /// Some rows contradict the rest, and none is to be left out.
    #[error("some of the rows contradict the rest")]
    Contradicted,
    /// The search left the range of numbers.
    #[error("the search does not converge: {0}")]
    Diverged(String),
}

/// A value with its standard deviations.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Estimate {
    /// The value.
    pub value: f64,
    /// Standard deviation that noise makes.
    pub noise_std: f64,
    /// Standard deviation of noise and tolerances together.
    pub total_std: f64,
}

/// A value that cannot be negative is below 0 by more than so many deviations where the model is wrong.
const CERTAIN: f64 = 3.0;

impl Estimate {
    /// Whether the value is negative, chance excluded.
    pub(super) fn is_negative(&self) -> bool {
        self.value < -CERTAIN * self.total_std
    }

    /// The value with its deviations.
    pub(super) fn json(&self) -> Json {
        json!({"value": self.value, "std": self.noise_std, "stdTotal": self.total_std})
    }

    /// Value, deviation by noise and in all, in a unit of this size, as tables show them.
    pub(super) fn cells(&self, unit: f64) -> [String; 3] {
        [(self.value, 5), (self.noise_std, 2), (self.total_std, 2)].map(|(of, digits)| significant(of / unit, digits))
    }

    /// Of a value that is proportional to this one.
    #[must_use]
    pub fn scaled(&self, factor: f64) -> Self {
        Self { value: factor * self.value, noise_std: factor * self.noise_std, total_std: factor * self.total_std }
    }
}

/// One recording: its conditions, which differ between recordings, and its residuals.
#[derive(Clone, Debug, PartialEq)]
pub struct Conditions {
    /// Constant load by coordinate, N.
    pub load_n: Vec<Estimate>,
    /// By part of the motion.
    pub parts: Vec<OfPart>,
    /// Step of each position sensor, m; 0 unless it is quantised.
    pub resolution_m: Vec<f64>,
    /// Mean of `2 λ_k i_k/gap_k²` over the recording, N/A.
    pub ki_n_a: Vec<Estimate>,
    /// Mean of `2 λ_k i_k²/gap_k³` over the recording, N/m.
    pub ks_n_m: Vec<Estimate>,
    /// χ² with two degrees of freedom of the whitened innovations at harmonics of the shaft angle from the first, by coordinate.
    pub harmonics: Vec<[f64; HARMONICS]>,
    /// Amplitude of the same relative to the noise of one innovation.
    pub amplitudes: Vec<[f64; HARMONICS]>,
    /// Position minus its prediction from the samples before, by coordinate and row, in m; NaN where a row was not used.
    pub prediction_errors_m: Vec<Vec<f64>>,
}

/// A recording as a part of the motion shows it.
#[derive(Clone, Debug, PartialEq)]
pub struct OfPart {
    /// Standard deviation of the position noise, m.
    pub position_noise_m: f64,
    /// Standard deviation of the current noise, A.
    pub current_noise_a: f64,
    /// Level of a slow force along each coordinate, a random walk, N after a second; 0 unless it is estimated.
    pub slow_force_n: f64,
    /// Power of the gap with which the noise of the positions grows, if it is estimated; the level is that at the nominal gap.
    pub noise_exponent: Option<Estimate>,
    /// Rows that were used.
    pub rows: usize,
    /// As how many of them they count: fewer where errors of quantisation repeat with the readings.
    pub counting: usize,
    /// Correlation of neighbouring whitened innovations, mean of all axes; by chance 1/√(axes · rows).
    pub correlation: f64,
}

/// Estimate of a bench parameter, and its line in the budget: its effect on λ.
#[derive(Clone, Debug, PartialEq)]
pub struct BenchEstimate {
    /// The parameter.
    pub parameter: BenchParameter,
    /// Value and standard deviation; 0 for one that is known exactly.
    pub estimate: Estimate,
    /// Whether it was estimated, or has a tolerance that no data tell more of; not if it is known, or could not be separated.
    pub estimated: bool,
    /// Whether it is free, and held as stated because the data do not separate it from the rest.
    pub is_held: bool,
    /// Error of λ̂_k relative to λ_k, per unit by which the parameter differs from what is stated and nobody knows.
    pub sensitivity: Vec<f64>,
    /// The standard deviation with which `contribution` is reckoned, in the parameter's unit: the tolerance stated, or that of a typical bench.
    pub tolerance: f64,
    /// Relative standard deviation of λ_k by this parameter. For an estimated one: what the variance would lose if it were known exactly.
    pub contribution: Vec<f64>,
}

/// The least contribution to ± of λ that shows.
const SHOWN: f64 = 5e-5;

/// A parameter that the residuals ask for.
#[derive(Clone, Debug, PartialEq)]
pub struct Suspect {
    /// Number of the bench parameter that would explain them, in [`Identification::bench`].
    pub parameter: usize,
    /// Its value after one step from the told one, in its unit.
    pub value: f64,
    /// Standard deviation of that value.
    pub std: f64,
    /// By how much the χ² of the innovations would fall (Lagrange multiplier test; 1 by chance).
    pub chi_square: f64,
}

/// A part of a recording that contradicts the rest.
#[derive(Clone, Debug, PartialEq)]
pub struct Contradiction {
    /// Number of the recording, from 0.
    pub recording: usize,
    /// Number of the part of the motion, from 0.
    pub part: usize,
    /// Its rows.
    pub rows: Range<usize>,
    /// Description.
    pub what: Change,
}

/// In which way a part contradicts the rest.
#[derive(Clone, Debug, PartialEq)]
pub enum Change {
    /// The innovations are larger than elsewhere: an impact, a touchdown, a disturbance. The rows were left out.
    Disturbed {
        /// Normalised innovation squared, relative to the rest of the recording.
        ratio: f64,
    },
    /// λ has these values in this part, N·m²/A²: estimates from it alone.
    Lambda(Vec<Estimate>),
    /// The load has other values in this part.
    Load {
        /// χ² of the change, with as many degrees of freedom as there are loads.
        chi_square: f64,
    },
}

/// Unbalance in a plane of the rotor.
#[derive(Clone, Debug, PartialEq)]
pub struct Unbalance {
    /// |U|, kg·m.
    pub magnitude: Estimate,
    /// Angle of U, rad.
    pub phase: Estimate,
}

/// The answer for all recordings.
#[derive(Clone, Debug, PartialEq)]
pub struct Identification {
    /// Force constants, N·m²/A².
    pub lambda: Vec<Estimate>,
    /// Covariance of the force constants, noise and tolerances together.
    pub lambda_covariance: DMatrix<f64>,
    /// By plane.
    pub unbalance: Vec<Unbalance>,
    /// By recording.
    pub conditions: Vec<Conditions>,
    /// By bench parameter.
    pub bench: Vec<BenchEstimate>,
    /// Bench parameters that the residuals ask for, the strongest first.
    pub suspects: Vec<Suspect>,
    /// Parts that contradict the rest.
    pub contradictions: Vec<Contradiction>,
    /// Whether the covariance is that of the scores of blocks of the recording, which vary more than the model says (heteroscedasticity- and
    /// autocorrelation-consistent, Newey and West 1987), and not that of the information matrix.
    pub by_scores: bool,
    /// Iterations of the last search.
    pub iterations: usize,
    /// Whether the last step was smaller than 5 % of a standard deviation.
    pub converged: bool,
    /// By how much a slow force raises the logarithm of the likelihood with everything else as it is; where it is not estimated, before a change of load or λ is
    /// left out.
    pub gain_by_slow_force: f64,
    /// Logarithm of the likelihood of the rows that were used, up to a constant that depends on their number alone.
    pub log_likelihood: f64,
}

/// Shortest segment, in rows: its first ones determine no more than where it starts.
pub const SHORTEST: usize = 16;

/// Identifies force constants, unbalance, loads, and what is not known of the bench from all recordings together. Columns of a recording are equally long, and finite
/// where they are usable.
///
/// # Errors
/// Obstacles to identification, by name.
pub fn identify(recordings: &[Recording], options: &Options) -> Result<Identification, Failed> {
    let mut parts = options.parts.iter();
    let first = parts.next().expect("something moves").identify(recordings, options)?;
    parts.try_fold(first, |all, part| Ok(all.beside(part.identify(recordings, options)?)))
}

impl Identification {
    /// Lines of the budget to show for the magnets of a bearing: of several bearings, those that count.
    pub fn budget_of(&self, bearing: &Bearing, magnets: &Range<usize>) -> impl Iterator<Item = &BenchEstimate> {
        self.bench.iter().filter(|line| {
            let is_usual = line.parameter.is_open() || line.parameter.in_typical_bench;
            let counts = || line.contribution[magnets.clone()].iter().any(|part| *part >= SHOWN);
            is_usual && (bearing.prefix.is_empty() || counts())
        })
    }

    /// Names of the bench parameters that the data do not separate from the rest.
    pub(super) fn held(&self) -> impl Iterator<Item = &str> {
        self.bench.iter().filter(|of| of.is_held).map(|of| of.parameter.name.as_str())
    }

    /// All recordings as all parts of the motion show them.
    pub(super) fn parts(&self) -> impl Iterator<Item = &OfPart> {
        self.conditions.iter().flat_map(|conditions| &conditions.parts)
    }

    /// Adds to the deviations of λ by how much it differs in another identification.
    pub(super) fn widen(&mut self, other: &Self) {
        let moved = DVector::from_fn(self.lambda.len(), |k, _| other.lambda[k].value - self.lambda[k].value);
        self.lambda_covariance += &moved * moved.transpose();
        for (k, moved) in moved.iter().enumerate() {
            let relative = moved / self.lambda[k].value;
            let of_recordings = self.conditions.iter_mut().flat_map(|of| [&mut of.ki_n_a[k], &mut of.ks_n_m[k]]);
            for estimate in of_recordings.chain([&mut self.lambda[k]]) {
                let std = relative * estimate.value;
                estimate.noise_std = estimate.noise_std.hypot(std);
                estimate.total_std = estimate.total_std.hypot(std);
            }
        }
    }

    /// This and another part of the motion, which is independent of it.
    fn beside(mut self, other: Self) -> Self {
        let (parameters, parts) = (self.bench.len(), self.conditions[0].parts.len());
        let [before, after] = [&self, &other].map(|of| of.lambda.len());
        // Neither moves the magnets of the other.
        for line in &mut self.bench {
            for own in [&mut line.sensitivity, &mut line.contribution] {
                own.resize(before + after, 0.0);
            }
        }
        for mut line in other.bench {
            for own in [&mut line.sensitivity, &mut line.contribution] {
                own.splice(..0, std::iter::repeat_n(0.0, before));
            }
            self.bench.push(line);
        }
        self.lambda_covariance.resize_mut(before + after, before + after, 0.0);
        self.lambda_covariance.view_mut((before, before), (after, after)).copy_from(&other.lambda_covariance);
        self.lambda.extend(other.lambda);
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
        let suspects = other.suspects.into_iter();
        self.suspects.extend(suspects.map(|of| Suspect { parameter: of.parameter + parameters, ..of }));
        self.suspects.sort_by(|a, b| b.chi_square.total_cmp(&a.chi_square));
        let contradictions = other.contradictions.into_iter();
        self.contradictions.extend(contradictions.map(|of| Contradiction { part: of.part + parts, ..of }));
        self.by_scores |= other.by_scores;
        self.iterations = self.iterations.max(other.iterations);
        self.converged &= other.converged;
        self.gain_by_slow_force += other.gain_by_slow_force;
        self.log_likelihood += other.log_likelihood;
        self
    }
}
