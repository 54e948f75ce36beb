//! On-line identification of the magnet constants λ.
//!
//! In reading order: `config` says what the estimator is told and what it tells; `innovations` is the whitening filter, `sums` the normal equations and
//! their solutions, `noise` the search for the noise, `validation` the tests of the result, and `prediction_error` the estimator made of them;
//! `paper` holds the paper's two methods. Here are the checks of a sample, gaps in the data, and the choice of the method.

mod config;
mod innovations;
mod noise;
pub mod paper;
mod prediction_error;
pub mod spindle;
mod sums;
mod validation;

use libm::{atan2, sqrt};
use nalgebra::{RowVector2, SMatrix, SVector, Vector2};
use serde::{Deserialize, Serialize};

use self::config::check;
pub use self::config::{
    EstimatorConfig, EstimatorInput, EstimatorOutput, Hold, MAX_INTERVALS, MIN_INTERVALS, Method, Tolerance, Verdict,
};
use self::innovations::{Machine, Sample, WhiteningFilter};
use self::paper::{Paper, PaperState};
pub use self::prediction_error::STD_LIMIT;
use self::prediction_error::{Estimate, PredictionError, PredictionErrorState};
use crate::bearing::magnet::Geometry;
use crate::invalid::Invalid;

const MAGNETS: usize = 3;

/// Unknowns in the plane: λ of three magnets, U cos φ, U sin φ, p_y, p_z.
const UNKNOWNS: usize = 7;

/// Tolerances in the plane: s, α of three magnets, gain and offset of two positions, offset of three currents.
const TOLERANCES: usize = 11;

type Planar = PredictionError<2, MAGNETS, UNKNOWNS, TOLERANCES>;

/// Where condition numbers end: a singular system shows this value.
pub const CONDITION_CAP: f64 = 1.0e12;

/// As many samples of one position equal to the last bit, while others move, are a sensor that is stuck.
pub const STUCK_SAMPLES: u32 = 25;

/// What a method keeps from sample to sample.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[expect(clippy::large_enum_variant, reason = "there is one of them, and stepping does not allocate")]
enum MethodState {
    PredictionError(PredictionErrorState<2, MAGNETS, UNKNOWNS, TOLERANCES>),
    Paper(PaperState),
}

/// All that changes with a sample. Made by [`Estimator::start`], and good only for estimators with the same parameters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct EstimatorState {
    reset_was_high: bool,
    stuck: Stuck<2>,
    method: MethodState,
    output: EstimatorOutput,
}

impl EstimatorState {
    /// The estimates after the last sample.
    #[must_use]
    pub fn output(&self) -> &EstimatorOutput {
        &self.output
    }
}

#[derive(Clone, Debug, PartialEq)]
#[expect(clippy::large_enum_variant, reason = "there is one of them")]
enum MethodOf {
    PredictionError(Planar),
    Paper(Paper),
}

/// The estimator: a checked configuration.
#[derive(Clone, Debug, PartialEq)]
pub struct Estimator {
    config: EstimatorConfig,
    geometry: Geometry,
    method: MethodOf,
}

impl Estimator {
    /// Checks the parameters and prepares the method.
    ///
    /// # Errors
    /// Every parameter that cannot be accepted, under its name in the interface: not finite, or not positive where it must be; two magnets
    /// on one line; a tolerance, or no unbalance, with one of the paper's methods; with these also `Tf` less than 8 or more than 10⁵
    /// sample times or not a whole number of them, and `epsilon` shorter than `Tf`.
    pub fn new(config: EstimatorConfig) -> Result<Self, Vec<Invalid>> {
        check(&config)?;
        let geometry = Geometry::new(config.gap_m, config.alpha_rad);
        let method = match config.method {
            Method::PredictionError => MethodOf::PredictionError(planar(&config, geometry)),
            Method::Paper | Method::PaperLiteral => MethodOf::Paper(Paper::new(&config)),
        };
        Ok(Self { config, geometry, method })
    }

    /// The configuration.
    #[must_use]
    pub fn config(&self) -> &EstimatorConfig {
        &self.config
    }

    /// A fresh state, with all the memory that stepping needs.
    #[must_use]
    pub fn start(&self) -> EstimatorState {
        let lambda0 = self.config.lambda0_nm2_a2;
        let output = EstimatorOutput {
            lambda_hat: lambda0,
            lambda_raw: lambda0,
            lambda_std: lambda0,
            lambda_std_total: lambda0,
            condition: CONDITION_CAP,
            residual: 1.0,
            position_noise_m: self.config.position_noise_m,
            current_noise_a: self.config.current_noise_a,
            ..EstimatorOutput::default()
        };
        let method = match &self.method {
            MethodOf::PredictionError(method) => MethodState::PredictionError(method.start()),
            MethodOf::Paper(method) => MethodState::Paper(method.start()),
        };
        EstimatorState { reset_was_high: false, stuck: Stuck::start(), method, output }
    }

    /// Whether a state, for instance one read from a file, has the shape this estimator needs and finite numbers alone.
    #[must_use]
    pub fn accepts(&self, state: &EstimatorState) -> bool {
        let finite = state.output.is_finite() && state.stuck.is_finite();
        finite
            && match (&self.method, &state.method) {
                (MethodOf::PredictionError(_), MethodState::PredictionError(state)) => state.is_sound(),
                (MethodOf::Paper(method), MethodState::Paper(state)) => method.accepts(state),
                _ => false,
            }
    }

    /// Takes in one sample; to be called once every T_s.
    ///
    /// Whatever the input, the result is finite and nothing panics. After a gap in the data (a bad sample, or `enable` false) the
    /// motion is unknown, but what the samples before said of λ stays. A rising edge of `reset` forgets everything, λ̂ included.
    pub fn sample(&self, state: &mut EstimatorState, input: &EstimatorInput) -> EstimatorOutput {
        if input.reset && !state.reset_was_high {
            *state = self.start();
        }
        state.reset_was_high = input.reset;
        state.output.verdict = self.advance(state, input);
        state.output.valid = state.output.verdict == Verdict::Valid;
        state.output.clone()
    }

    fn advance(&self, state: &mut EstimatorState, input: &EstimatorInput) -> Verdict {
        let refused = if !input.enable {
            Some(Verdict::Disabled)
        } else if input.contact {
            Some(Verdict::Contact)
        } else if !self.is_usable(input) {
            Some(Verdict::BadSample)
        } else {
            state.stuck.take(input.position_m).then_some(Verdict::Stuck)
        };
        match (&self.method, &mut state.method) {
            (MethodOf::PredictionError(method), MethodState::PredictionError(own)) => match refused {
                Some(verdict) => {
                    method.interrupt(own);
                    verdict
                }
                None => {
                    let (position, current) = (input.position_m, input.current_a);
                    let sample = Sample::new(position, current, input.theta_rad, input.omega_rad_s);
                    let verdict = method.sample(own, sample);
                    state.output.take(&own.estimate, verdict, self.config.identify_unbalance);
                    verdict
                }
            },
            (MethodOf::Paper(method), MethodState::Paper(own)) if method.has_shape(own) => refused
                .inspect(|_| method.interrupt(own))
                .unwrap_or_else(|| method.sample(own, input, &mut state.output)),
            _ => Verdict::ForeignState,
        }
    }

    /// Whether all measurements are finite and the rotor is within the gaps of all magnets.
    fn is_usable(&self, input: &EstimatorInput) -> bool {
        let measured = input.position_m.iter().chain(&input.current_a).chain([&input.theta_rad, &input.omega_rad_s]);
        measured.clone().all(|x| x.is_finite() && x.abs() < MEASUREMENT_LIMIT)
            && self.geometry.gaps(input.position_m).iter().all(|gap_m| *gap_m > 0.0)
    }
}

/// The method for the planar rotor, whose coordinates are its position.
fn planar(config: &EstimatorConfig, geometry: Geometry) -> Planar {
    let t = &config.tolerance;
    let std = [t.gap_m, t.alpha_rad, t.position_gain, t.position_offset_m, t.current_offset_a];
    let forces = geometry.directions.into_iter().chain([[1.0, 0.0], [0.0, 1.0], [1.0, 0.0], [0.0, 1.0]]);
    let rows = forces.map(|force| RowVector2::from(force) / config.m_kg).collect::<Vec<_>>();
    let mass = t.m_kg / config.m_kg;
    PredictionError {
        filter: WhiteningFilter {
            machine: Machine {
                geometry,
                accelerations: SMatrix::from_rows(&rows),
                gyroscopic: None,
                turned: geometry.directions.map(|[y, z]| Vector2::new(z, -y)).map(|e| [e, e / config.m_kg]),
            },
            step_s: config.step_s,
            hold: config.hold,
            identify_unbalance: config.identify_unbalance,
            tolerance: std.iter().any(|std| *std > 0.0).then_some(std),
        },
        lambda0: config.lambda0_nm2_a2,
        told: [config.position_noise_m, config.current_noise_a],
        scale_variance: mass * mass + 4.0 * t.current_gain * t.current_gain,
    }
}

impl EstimatorOutput {
    fn take(&mut self, estimate: &Estimate<MAGNETS, UNKNOWNS>, verdict: Verdict, with_unbalance: bool) {
        let [std, total] = estimate.variance.map(|variance| variance.map(sqrt).into());
        let [_, _, _, along, across, p_y, p_z] = estimate.unknowns.into();
        self.lambda_hat = estimate.lambda().into();
        self.lambda_raw = estimate.lambda_raw.into();
        (self.lambda_std, self.lambda_std_total) = (std, total);
        (self.ki, self.ks) = (estimate.ki.into(), estimate.ks.into());
        (self.condition, self.residual) = (estimate.condition, estimate.residual);
        [self.position_noise_m, self.current_noise_a] = estimate.noise;
        self.load_n = [p_y, p_z];
        if verdict == Verdict::Valid && with_unbalance {
            self.unbalance_kg_m = sqrt(along * along + across * across);
            self.unbalance_phase_rad = atan2(across, along);
        }
    }
}

/// No measurement of a machine is as large as this, whatever its unit; squares of it do not overflow.
const MEASUREMENT_LIMIT: f64 = 1.0e12;

/// The last positions, m, and for how many samples each has read the same.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Stuck<const N: usize> {
    position_m: SVector<f64, N>,
    same: SVector<u32, N>,
}

impl<const N: usize> Stuck<N> {
    fn start() -> Self {
        Self { position_m: SVector::zeros(), same: SVector::zeros() }
    }

    fn is_finite(&self) -> bool {
        self.position_m.iter().all(|x| x.is_finite())
    }

    /// Takes in positions; whether one has read the same for [`STUCK_SAMPLES`] samples while another moved.
    fn take(&mut self, position_m: [f64; N]) -> bool {
        for ((last, now), count) in self.position_m.iter_mut().zip(position_m).zip(&mut self.same) {
            *count = if *last == now { count.saturating_add(1) } else { 0 };
            *last = now;
        }
        self.same.max() >= STUCK_SAMPLES && self.same.min() == 0
    }
}
