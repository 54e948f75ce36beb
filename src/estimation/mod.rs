//! On-line identification of the magnet constants λ.
//!
//! In reading order: `config` holds parameters, inputs and outputs; `angle` filters the rotation, `innovations` is the whitening filter, `sums` the
//! normal equations and their solutions, `models` weighs models of what changes, `noise` is the search for the noise, `validation` tests the
//! result, and `prediction_error` is the estimator made of them; `paper` holds the paper's two methods. Here are the checks of a sample, gaps
//! in the data, and the choice of the method.

mod angle;
mod config;
mod innovations;
mod models;
mod noise;
pub mod paper;
mod prediction_error;
mod readings;
pub mod spindle;
mod sums;
mod validation;

use libm::{atan2, sqrt};
use nalgebra::{RowVector2, SMatrix};
use serde::{Deserialize, Serialize};

pub use self::config::{
    EstimatorConfig, EstimatorInput, EstimatorOutput, Hold, MAX_INTERVALS, MIN_INTERVALS, Method, Tolerance, Verdict,
};
use self::config::{check, stiffness_std};
use self::innovations::{Machine, Sample, WhiteningFilter};
use self::paper::{Paper, PaperState};
pub use self::prediction_error::STD_LIMIT;
use self::prediction_error::{Estimate, PredictionError, PredictionErrorState};
pub use self::readings::STUCK_SAMPLES;
use self::readings::{Readings, Taken};
use crate::bearing::magnet::Geometry;
use crate::invalid::Invalid;
use crate::variables::is_finite;

const MAGNETS: usize = 3;

/// Unknowns in the plane: λ of three magnets, U cos φ, U sin φ, B cos φ, −B sin φ, p_y, p_z.
const UNKNOWNS: usize = 9;

/// The first of the backward force.
const BACKWARD: usize = 5;

/// Tolerances in the plane: s, α of three magnets, gain and offset of two positions, offset of three currents.
const TOLERANCES: usize = 11;

type Planar = PredictionError<2, MAGNETS, UNKNOWNS, TOLERANCES>;

/// Where condition numbers end: a singular system shows this value.
pub const CONDITION_CAP: f64 = 1.0e12;

/// State of a method.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
enum MethodState {
    PredictionError(Box<PredictionErrorState<2, MAGNETS, UNKNOWNS, TOLERANCES>>),
    Paper(Box<PaperState>),
}

/// All that changes with a sample. Made by [`Estimator::start`], and good only for estimators with the same parameters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct EstimatorState {
    reset_was_high: bool,
    readings: Readings<2, MAGNETS>,
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
            Method::PredictionError => MethodOf::PredictionError(planar(&config)),
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
            MethodOf::PredictionError(method) => MethodState::PredictionError(Box::new(method.start())),
            MethodOf::Paper(method) => MethodState::Paper(Box::new(method.start())),
        };
        EstimatorState { reset_was_high: false, readings: Readings::start(), method, output }
    }

    /// Whether a state, for instance one read from a file, has the shape this estimator needs and finite numbers alone.
    #[must_use]
    pub fn accepts(&self, state: &EstimatorState) -> bool {
        is_finite(state)
            && match (&self.method, &state.method) {
                (MethodOf::PredictionError(_), MethodState::PredictionError(state)) => state.has_shape(),
                (MethodOf::Paper(method), MethodState::Paper(state)) => method.has_shape(state),
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
        let output = &mut state.output;
        output.ki_std = stiffness_std(output.ki, output.lambda_std_total, output.lambda_hat);
        output.ks_std = stiffness_std(output.ks, output.lambda_std_total, output.lambda_hat);
        state.output.clone()
    }

    fn advance(&self, state: &mut EstimatorState, input: &EstimatorInput) -> Verdict {
        let in_gap = self.geometry.gaps(input.position_m).iter().all(|gap_m| *gap_m > 0.0);
        let rotation = [input.theta_rad, input.omega_rad_s];
        let taken = state.readings.take(input.position_m, input.current_a, rotation, self.config.step_s, in_gap);
        let online = self.config.method == Method::PredictionError;
        let refused = match taken {
            _ if !input.enable => Some(Verdict::Disabled),
            _ if input.contact => Some(Verdict::Contact),
            // The paper's methods have no use for the angle, and none for a gap that is bridged.
            Taken::Usable { contradiction: true, .. } if online && self.config.identify_unbalance => {
                Some(Verdict::Speed)
            }
            Taken::Usable { stuck, .. } => stuck.iter().any(|stuck| *stuck).then_some(Verdict::Stuck),
            Taken::Missing if !online => Some(Verdict::BadSample),
            Taken::Repeated if !online => None,
            Taken::Missing | Taken::Repeated => {
                Some(state.output.verdict).filter(|_| !state.readings.are_lost()).or(Some(Verdict::BadSample))
            }
        };
        match (&self.method, &mut state.method) {
            (MethodOf::PredictionError(method), MethodState::PredictionError(own)) => {
                let rotation = state.readings.rotation();
                let verdict = method.take(own, refused, || Sample::new(input.position_m, input.current_a, rotation));
                if refused.is_none() {
                    state.output.take(&own.estimate, verdict, &self.config);
                }
                verdict
            }
            (MethodOf::Paper(method), MethodState::Paper(own)) if method.has_shape(own) => refused
                .inspect(|_| method.interrupt(own))
                .unwrap_or_else(|| method.sample(own, input, &mut state.output)),
            _ => Verdict::ForeignState,
        }
    }
}

/// The method for the planar rotor, whose coordinates are its position.
fn planar(config: &EstimatorConfig) -> Planar {
    let t = &config.tolerance;
    let machine = |change: [f64; 1 + MAGNETS]| {
        let alpha_rad = std::array::from_fn(|k| config.alpha_rad[k] + change[1 + k]);
        let geometry = Geometry::new(config.gap_m + change[0], alpha_rad);
        let axes = [[1.0, 0.0], [0.0, 1.0]];
        // Magnets, unbalance, backward force, load.
        let forces = geometry.directions.into_iter().chain([axes; 3].into_iter().flatten());
        let rows = forces.map(|force| RowVector2::from(force) / config.m_kg).collect::<Vec<_>>();
        Machine { geometry, accelerations: SMatrix::from_rows(&rows), backward: BACKWARD, gyroscopic: None }
    };
    let backward_n = t.backward_force_n;
    PredictionError {
        filter: WhiteningFilter {
            machine: machine([0.0; 1 + MAGNETS]),
            step_s: config.step_s,
            hold: config.hold,
            identify_unbalance: config.identify_unbalance,
            identify_backward: backward_n > 0.0,
            tolerances: t.columns([t.gap_m, t.alpha_rad, t.alpha_rad, t.alpha_rad], machine),
        },
        lambda0: config.lambda0_nm2_a2,
        prior: models::prior(config.lambda0_nm2_a2, BACKWARD..BACKWARD + 2, backward_n),
        known_noise: [config.position_noise_m, config.current_noise_a],
        scale_variance: t.scale_variance(config.m_kg),
    }
}

impl EstimatorOutput {
    fn take(&mut self, estimate: &Estimate<MAGNETS, UNKNOWNS>, verdict: Verdict, config: &EstimatorConfig) {
        let [std, total] = estimate.variance.map(|variance| variance.map(sqrt).into());
        let [_, _, _, along, across, against, beside, p_y, p_z] = estimate.unknowns.into();
        self.lambda_hat = estimate.lambda().into();
        self.lambda_raw = estimate.lambda_raw.into();
        (self.lambda_std, self.lambda_std_total) = (std, total);
        (self.ki, self.ks) = (estimate.ki.into(), estimate.ks.into());
        (self.condition, self.residual) = (estimate.condition, estimate.residual);
        [self.position_noise_m, self.current_noise_a] = estimate.noise;
        self.load_n = [p_y, p_z];
        if verdict == Verdict::Valid && config.identify_unbalance {
            [self.unbalance_kg_m, self.unbalance_phase_rad] = polar(along, across);
        }
        if verdict == Verdict::Valid {
            [self.backward_force_n, self.backward_force_phase_rad] = polar(against, -beside);
        }
    }
}

/// Magnitude and phase, rad in (−π, π].
fn polar(x: f64, y: f64) -> [f64; 2] {
    [sqrt(x * x + y * y), atan2(y, x)]
}
