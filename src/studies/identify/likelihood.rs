//! Maximum likelihood over whole recordings, with the imperfections of a bench.
//!
//! # Method
//!
//! Positions and currents are measured with white noise. Gauss–Newton on the innovations of a Kalman filter for (y, z, ẏ, ż), the negative
//! stiffness of the field included, with the noise of the currents as process noise. Every iteration linearises anew about the smoothed trajectory.
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
//! A bench parameter ([`PARAMETERS`]) is one more column. Known with a tolerance it has a Gaussian prior; known exactly it is not estimated,
//! but its column says what an error of it would do to λ (the budget) and whether the residuals ask for it (the suspects).
//!
//! Deterministic to the bit, whatever the number of threads: recordings are cut into pieces of fixed length, whose sums are added in
//! order.

mod bench;
mod case;
mod changes;
mod data;
mod equations;
mod expected;
mod filter;
mod missing;
mod outcome;
mod resolution;
mod search;
mod solve;

use std::fmt;
use std::ops::Range;

pub(super) use self::bench::DELAY;
pub use self::bench::{BENCH, BenchParameter, Knowledge, PARAMETERS, Told, by_name};
pub use crate::estimation::Hold;

/// One recording, sampled at equal distances.
#[derive(Clone, Copy, Debug)]
pub struct Recording<'a> {
    /// Time between two samples, s.
    pub step_s: f64,
    /// Positions (Y, Z), m.
    pub position_m: &'a [[f64; 2]],
    /// Currents, A.
    pub current_a: &'a [[f64; 3]],
    /// Angle of the shaft, rad; may be wrapped.
    pub theta_rad: &'a [f64],
    /// Speed of the shaft, rad/s.
    pub omega_rad_s: &'a [f64],
    /// Which samples may be used; empty for all of them. What is not usable separates segments, each with a state of its own.
    pub usable: &'a [bool],
    /// Samples that were not recorded and are filled from their neighbours; empty if there are none. The filter predicts across them.
    pub missing: &'a [Missing],
    /// Meaning of a sample of a current.
    pub hold: Hold,
    /// Standard deviation of the position noise, m, if known.
    pub position_noise_m: Option<f64>,
    /// Standard deviation of the current noise, A, if known.
    pub current_noise_a: Option<f64>,
}

/// Whether a current was recorded.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum Origin {
    /// It was.
    #[default]
    Recorded,
    /// It was not, and is filled from its neighbours.
    Filled,
    /// It was not for a long time: the force of the magnet is not known.
    Unknown,
}

/// Signals that were not recorded in a row.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Missing {
    /// A position was not.
    pub position: bool,
    /// The currents.
    pub current: [Origin; 3],
}

/// Prior knowledge of the bearing.
#[derive(Clone, Debug)]
pub struct Options {
    /// Mass of the rotor, kg.
    pub m_kg: f64,
    /// Nominal gap, m.
    pub gap_m: f64,
    /// Angles of the magnets, rad; magnet k pulls along `(sin α_k, cos α_k)` in (y, z).
    pub alpha_rad: [f64; 3],
    /// Stated values of the bench, by the order of [`PARAMETERS`].
    pub bench: [Told; BENCH],
    /// Whether a slow force that nothing explains is estimated, a random walk in y and z.
    pub slow_force: bool,
}

impl Options {
    /// A bearing whose bench is exactly as stated.
    #[must_use]
    pub fn new(m_kg: f64, gap_m: f64, alpha_rad: [f64; 3]) -> Self {
        Self { m_kg, gap_m, alpha_rad, bench: [Told::default(); BENCH], slow_force: false }
    }
}

/// Why nothing was identified.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Failed {
    /// There is no recording.
    #[error("there is no recording to identify from")]
    Nothing,
    /// Columns of a recording differ in length.
    #[error("recording {recording}: {column} has {got} samples, the positions have {wanted}")]
    Lengths {
        /// Number of the recording, from 1.
        recording: usize,
        /// Which column.
        column: &'static str,
        /// Its samples.
        got: usize,
        /// Samples of the positions.
        wanted: usize,
    },
    /// A usable sample is not a finite number.
    #[error("recording {recording}: sample {row} is not finite; mark it as not usable")]
    NotFinite {
        /// Number of the recording, from 1.
        recording: usize,
        /// Row, from 0.
        row: usize,
    },
    /// A parameter is out of its range.
    #[error("{name} is {value}; wanted: {wanted}")]
    Invalid {
        /// Name of the parameter.
        name: String,
        /// The stated value.
        value: f64,
        /// Admissible values.
        wanted: &'static str,
    },
    /// Too few samples follow each other.
    #[error("recording {recording} has no {wanted} usable samples in a row")]
    TooShort {
        /// Number of the recording, from 1.
        recording: usize,
        /// How many are needed.
        wanted: usize,
    },
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

/// Where the covariance comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Covariance {
    /// The information matrix of the likelihood.
    Information,
    /// Scores of blocks of the recording, which vary more than the model says (heteroscedasticity- and
    /// autocorrelation-consistent, Newey and West 1987).
    Scores,
}

impl fmt::Display for Covariance {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Information => "information matrix",
            Self::Scores => "scores",
        })
    }
}

/// Differences between recordings.
#[derive(Clone, Debug, PartialEq)]
pub struct Conditions {
    /// Constant load (y, z), N.
    pub load_n: [Estimate; 2],
    /// Standard deviation of the position noise, m.
    pub position_noise_m: f64,
    /// Standard deviation of the current noise, A.
    pub current_noise_a: f64,
    /// Level of a slow force in y and z, a random walk, N after a second; 0 unless it is estimated.
    pub slow_force_n: f64,
    /// Rows that were used.
    pub rows: usize,
    /// As how many of them they count: fewer where errors of quantisation repeat with the readings.
    pub counting: usize,
    /// Step of each position sensor, m; 0 unless it is quantised.
    pub resolution_m: [f64; 2],
    /// Mean of the normalised innovations squared per axis; 1 where the model holds.
    pub nis: f64,
    /// Mean of `2 λ_k i_k/gap_k²` over the recording, N/A.
    pub ki_n_a: [Estimate; 3],
    /// Mean of `2 λ_k i_k²/gap_k³` over the recording, N/m.
    pub ks_n_m: [Estimate; 3],
}

/// Estimate of a bench parameter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BenchEstimate {
    /// The stated value.
    pub told: Told,
    /// Value and standard deviation; the told value and 0 for one that is known exactly.
    pub estimate: Estimate,
    /// Whether it was estimated; not if it is known, or could not be separated.
    pub estimated: bool,
}

/// Effect of one bench parameter on λ.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BudgetLine {
    /// Number of the parameter in [`PARAMETERS`].
    pub parameter: usize,
    /// Error of λ̂_k relative to λ_k, per unit by which the parameter differs from its told value and nobody knows.
    pub sensitivity: [f64; 3],
    /// The standard deviation with which `contribution` is reckoned, in the parameter's unit: the tolerance told, or that of a typical bench.
    pub tolerance: f64,
    /// Whether `tolerance` is stated.
    pub told: bool,
    /// Relative standard deviation of λ_k by this parameter. For an estimated one: what the variance would lose if it were known exactly.
    pub contribution: [f64; 3],
}

/// A parameter that the residuals ask for.
#[derive(Clone, Debug, PartialEq)]
pub struct Suspect {
    /// The bench parameter that would explain them.
    pub parameter: usize,
    /// Its value after one step from the told one, in its unit.
    pub value: f64,
    /// Standard deviation of that value.
    pub std: f64,
    /// By how much the χ² of the innovations would fall (Lagrange multiplier test; 1 by chance).
    pub chi_square: f64,
}

/// Residuals of one recording.
#[derive(Clone, Debug, PartialEq)]
pub struct Residuals {
    /// χ² with two degrees of freedom of the whitened innovations at harmonics 1–4 of the shaft angle; per harmonic y, z.
    pub harmonics: [[f64; 2]; 4],
    /// Amplitude of the same relative to the noise of one innovation.
    pub amplitudes: [[f64; 2]; 4],
    /// Autocorrelation of the whitened innovations at lags 1–4, mean of both axes; by chance 1/√(2 rows).
    pub lags: [f64; 4],
}

/// A part of a recording that contradicts the rest.
#[derive(Clone, Debug, PartialEq)]
pub struct Contradiction {
    /// Number of the recording, from 0.
    pub recording: usize,
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
    /// λ has other values in this part: estimates from it alone.
    Lambda {
        /// Values, N·m²/A².
        lambda: [Estimate; 3],
        /// χ² of the change (3 degrees of freedom).
        chi_square: f64,
    },
    /// The load has other values in this part.
    Load {
        /// χ² of the change (2 degrees of freedom).
        chi_square: f64,
    },
}

/// The answer for all recordings.
#[derive(Clone, Debug, PartialEq)]
pub struct Identification {
    /// Force constants, N·m²/A².
    pub lambda: [Estimate; 3],
    /// Covariance of the force constants, noise and tolerances together.
    pub lambda_covariance: [[f64; 3]; 3],
    /// U cos φ and U sin φ, kg·m.
    pub unbalance: [Estimate; 2],
    /// |U|, kg·m.
    pub unbalance_magnitude: Estimate,
    /// Angle of U, rad.
    pub unbalance_phase: Estimate,
    /// By recording.
    pub conditions: Vec<Conditions>,
    /// By bench parameter.
    pub bench: [BenchEstimate; BENCH],
    /// Bench parameters that the data do not separate from the rest, by number; they were held at their told values.
    pub not_separated: Vec<usize>,
    /// Effects of bench parameters on λ.
    pub budget: Vec<BudgetLine>,
    /// Residuals by recording.
    pub residuals: Vec<Residuals>,
    /// Position minus its prediction from the samples before, by recording and row, in m; NaN where a row was not used.
    pub prediction_errors_m: Vec<Vec<[f64; 2]>>,
    /// Bench parameters that the residuals ask for, the strongest first.
    pub suspects: Vec<Suspect>,
    /// Parts that contradict the rest.
    pub contradictions: Vec<Contradiction>,
    /// Where the covariance comes from.
    pub covariance: Covariance,
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

/// Identifies force constants, unbalance, loads, and what is not known of the bench from all recordings together.
///
/// # Errors
/// Obstacles to identification, by name.
pub fn identify(recordings: &[Recording<'_>], options: &Options) -> Result<Identification, Failed> {
    check(recordings, options)?;
    search::identify(recordings, options)
}

fn check(recordings: &[Recording<'_>], options: &Options) -> Result<(), Failed> {
    let invalid = |name: &str, value: f64, wanted| Failed::Invalid { name: name.to_owned(), value, wanted };
    let positive = |name: &str, value: f64| {
        if value.is_finite() && value > 0.0 { Ok(()) } else { Err(invalid(name, value, "a finite number above 0")) }
    };
    positive("m", options.m_kg)?;
    positive("s", options.gap_m)?;
    for (k, alpha) in options.alpha_rad.into_iter().enumerate() {
        if !alpha.is_finite() {
            return Err(invalid(&format!("alpha[{}]", k + 1), alpha, "a finite angle in rad"));
        }
    }
    for (told, parameter) in options.bench.iter().zip(&PARAMETERS) {
        let relative = parameter.unit == "1";
        if !told.value.is_finite() || (relative && told.value.abs() >= 1.0) {
            return Err(invalid(parameter.name, told.value, "a finite number, a relative error between -1 and 1"));
        }
        if let Knowledge::Tolerance(std) = told.knowledge {
            positive(&format!("tolerance of {}", parameter.name), std)?;
        }
    }
    if recordings.is_empty() {
        return Err(Failed::Nothing);
    }
    for (at, recording) in recordings.iter().enumerate() {
        check_recording(at + 1, recording)?;
    }
    Ok(())
}

fn check_recording(number: usize, recording: &Recording<'_>) -> Result<(), Failed> {
    let wanted = recording.position_m.len();
    for (column, got) in [
        ("current", recording.current_a.len()),
        ("theta", recording.theta_rad.len()),
        ("omega", recording.omega_rad_s.len()),
        ("usable", if recording.usable.is_empty() { wanted } else { recording.usable.len() }),
        ("missing", if recording.missing.is_empty() { wanted } else { recording.missing.len() }),
    ] {
        if got != wanted {
            return Err(Failed::Lengths { recording: number, column, got, wanted });
        }
    }
    let invalid = |name: &str, value: f64, wanted| {
        Err(Failed::Invalid { name: format!("{name} of recording {number}"), value, wanted })
    };
    if !(recording.step_s.is_finite() && recording.step_s > 0.0) {
        return invalid("step", recording.step_s, "a finite time above 0, in s");
    }
    for (name, noise) in [("position noise", recording.position_noise_m), ("current noise", recording.current_noise_a)]
    {
        if let Some(noise) = noise.filter(|noise| !(noise.is_finite() && *noise >= 0.0)) {
            return invalid(name, noise, "a finite standard deviation, 0 or above");
        }
    }
    for row in 0..wanted {
        let values = recording.position_m[row].into_iter().chain(recording.current_a[row]);
        let mut values = values.chain([recording.theta_rad[row], recording.omega_rad_s[row]]);
        if recording.usable.get(row).copied().unwrap_or(true) && !values.all(f64::is_finite) {
            return Err(Failed::NotFinite { recording: number, row });
        }
    }
    Ok(())
}
