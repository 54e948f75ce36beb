//! On-line identification of the magnet constants λ.
//!
//! In reading order: `config` holds parameters, inputs and outputs; `readings` detects missing samples and stuck sensors, `angle` filters the rotation,
//! `motion` propagates states and covariances, `innovations` is the whitening filter, `sums` holds the normal equations and their solution, `models`
//! compares models of change, `noise` estimates the noise, `validation` tests the result, and `prediction_error` combines them; `paper` holds the paper's
//! two methods; `rotor` builds the parts of a motion from parameters, `parts` combines them, `planar` selects the method. This file runs the method.

mod angle;
mod config;
mod innovations;
mod models;
mod motion;
mod noise;
pub mod paper;
mod parts;
mod planar;
mod prediction_error;
mod readings;
mod rotor;
mod sums;
mod validation;

use std::fmt::Debug;
use std::ops::Range;

use serde::{Deserialize, Serialize};

pub use self::angle::angle_difference;
use self::config::stiffness_std;
pub use self::config::{
    Bearings, EstimatorConfig, EstimatorConfigOf, EstimatorInput, EstimatorInputOf, EstimatorOutput, EstimatorOutputOf,
    Hold, Method, Tolerance, Verdict,
};
pub use self::innovations::Machine;
use self::innovations::Sample;
pub use self::models::VERY_STRONG;
pub use self::noise::START_CURRENT_NOISE_A;
pub use self::prediction_error::STD_LIMIT;
pub use self::readings::STUCK_SAMPLES;
use self::readings::{Readings, SampleStatus};
pub use self::validation::chi_square;
use crate::bearing::RotorConfig;
use crate::invalid::Invalid;
use crate::machine::Machine as Names;
use crate::variables::{Saved, is_finite};

/// Upper limit of condition numbers; a singular system has this value.
pub const CONDITION_CAP: f64 = 1.0e12;

/// Rotor and bearings of a machine with N coordinates, K magnets and P parts, and its method of estimation.
pub trait Body<const N: usize, const K: usize, const P: usize>: Bearings + Debug + PartialEq {
    /// Its method of estimation.
    type Method: Estimation<N, K, P> + Clone + Debug + PartialEq;

    /// Checks the parameters and prepares the method.
    ///
    /// # Errors
    /// Invalid parameters, by their names in the interface.
    fn method(config: &EstimatorConfigOf<Self, K>) -> Result<Self::Method, Vec<Invalid>>;
}

/// A sample for a method, with the results of its checks.
#[derive(Debug)]
pub struct CheckedSample<'a, const N: usize, const K: usize> {
    input: &'a EstimatorInputOf<N, K>,
    status: SampleStatus<N>,
    /// Whether more samples are missing than a gap may have.
    is_lost: bool,
    rotation: angle::Rotation,
    identify_unbalance: bool,
}

impl<const N: usize, const K: usize> CheckedSample<'_, N, K> {
    /// Why a part with these positions cannot use the sample, if so; `verdict` is that on its estimate, which a gap does not change.
    fn rejection(&self, positions: Range<usize>, verdict: Verdict) -> Option<Verdict> {
        match self.status {
            _ if !self.input.enable => Some(Verdict::Disabled),
            _ if self.input.contact => Some(Verdict::Contact),
            SampleStatus::Usable { wrong_speed: true, .. } if self.identify_unbalance => Some(Verdict::Speed),
            SampleStatus::Usable { settling: true, .. } if self.identify_unbalance => Some(Verdict::Collecting),
            SampleStatus::Usable { stuck, .. } => stuck[positions].iter().any(|stuck| *stuck).then_some(Verdict::Stuck),
            _ if self.is_lost => Some(Verdict::BadSample),
            SampleStatus::Missing | SampleStatus::Repeated => Some(verdict),
        }
    }
}

/// A method of estimation.
pub trait Estimation<const N: usize, const K: usize, const P: usize> {
    /// State between samples.
    type State: Clone + Debug + PartialEq + Saved;

    /// A new state, with all the memory that stepping needs.
    fn start(&self) -> Self::State;

    /// Whether a state has the shape this method needs.
    fn has_shape(&self, state: &Self::State) -> bool;

    /// Whether the rotor is within the gaps of all magnets at these positions, in m.
    fn is_in_gap(&self, position_m: [f64; N]) -> bool;

    /// Processes a sample and updates the output; returns the verdicts on the parts.
    fn advance(
        &self,
        state: &mut Self::State,
        sample: &CheckedSample<'_, N, K>,
        output: &mut EstimatorOutputOf<N, K, P>,
    ) -> [Verdict; P];
}

/// State between samples. Made by [`Estimator::start`]; valid only for estimators with the same parameters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(bound = "S: Saved, EstimatorOutputOf<N, K, P>: Saved")]
pub struct EstimatorState<S = planar::PlanarState, const N: usize = 2, const K: usize = 3, const P: usize = 1> {
    reset_was_high: bool,
    readings: Readings<N, K>,
    method: S,
    output: EstimatorOutputOf<N, K, P>,
}

impl<S, const N: usize, const K: usize, const P: usize> EstimatorState<S, N, K, P> {
    /// The estimates after the last sample.
    pub fn output(&self) -> &EstimatorOutputOf<N, K, P> {
        &self.output
    }
}

/// The state of the estimator of a machine.
pub type StateOf<G, const N: usize, const K: usize, const P: usize> =
    EstimatorState<<<G as Body<N, K, P>>::Method as Estimation<N, K, P>>::State, N, K, P>;

/// The estimator: a checked configuration.
#[derive(Clone, Debug, PartialEq)]
pub struct Estimator<G: Body<N, K, P> = RotorConfig, const N: usize = 2, const K: usize = 3, const P: usize = 1> {
    config: EstimatorConfigOf<G, K>,
    method: G::Method,
}

impl<G: Body<N, K, P>, const N: usize, const K: usize, const P: usize> Estimator<G, N, K, P> {
    /// Checks the parameters and prepares the method.
    ///
    /// # Errors
    /// Every invalid parameter, under its name in the interface: not finite, or not positive where it must be; a geometry in which the rotor has no room,
    /// or with magnets or sensors that cannot be distinguished. With one of the paper's methods also a tolerance other than `tolerance.backwardForce`,
    /// `identify.unbalance` false, `Tf` less than 8 or more than 10⁵ sample times or not a whole number of them, and `epsilon` shorter than `Tf`.
    pub fn new(config: EstimatorConfigOf<G, K>) -> Result<Self, Vec<Invalid>> {
        let method = G::method(&config)?;
        Ok(Self { config, method })
    }

    /// The configuration.
    pub fn config(&self) -> &EstimatorConfigOf<G, K> {
        &self.config
    }

    /// A new state, with all the memory that stepping needs.
    pub fn start(&self) -> StateOf<G, N, K, P> {
        let EstimatorConfigOf { lambda0_nm2_a2: lambda0, position_noise_m, current_noise_a, .. } = self.config;
        let output = EstimatorOutputOf {
            lambda_hat: lambda0,
            lambda_raw: lambda0,
            lambda_std: lambda0,
            lambda_std_total: lambda0,
            condition: CONDITION_CAP,
            residual: 1.0,
            position_noise_m: [position_noise_m; P],
            current_noise_a: [current_noise_a; P],
            ..EstimatorOutputOf::default()
        };
        EstimatorState { reset_was_high: false, readings: Readings::start(), method: self.method.start(), output }
    }

    /// Whether a state, for instance one read from a file, has the shape this estimator needs and only finite numbers.
    pub fn accepts(&self, state: &StateOf<G, N, K, P>) -> bool
    where
        StateOf<G, N, K, P>: Serialize,
    {
        is_finite(state) && self.method.has_shape(&state.method)
    }

    /// Processes one sample; call it once every T_s.
    ///
    /// The result is finite for any input, and nothing panics. After a long gap in the data (bad samples, or `enable` false), with the paper's methods after
    /// any, the motion is unknown, but the information on λ is kept. A rising edge of `reset` discards everything, λ̂ included, and allocates a fresh state.
    pub fn sample(
        &self,
        state: &mut StateOf<G, N, K, P>,
        input: &EstimatorInputOf<N, K>,
    ) -> EstimatorOutputOf<N, K, P> {
        if input.reset && !state.reset_was_high {
            *state = self.start();
        }
        state.reset_was_high = input.reset;
        let EstimatorConfigOf { step_s, method, identify_unbalance, .. } = self.config;
        // The paper's methods do not use the angle, and an axial bearing has no unbalance.
        let identify_unbalance =
            identify_unbalance && Names::of::<N, K>().planes > 0 && method == Method::PredictionError;
        let (readings, angle_and_speed) = (&mut state.readings, [input.theta_rad, input.omega_rad_s]);
        let in_gap = self.method.is_in_gap(input.position_m);
        let status = readings.update(input.position_m, input.current_a, angle_and_speed, step_s, in_gap);
        let (is_lost, rotation) = (readings.missing > STUCK_SAMPLES, readings.rotation());
        let sample = CheckedSample { input, status, is_lost, rotation, identify_unbalance };
        let output = &mut state.output;
        let verdicts = self.method.advance(&mut state.method, &sample, output);
        output.axial_verdict = verdicts[P - 1];
        output.verdict = verdicts.into_iter().find(|verdict| *verdict != Verdict::Valid).unwrap_or(Verdict::Valid);
        output.valid = output.verdict == Verdict::Valid;
        output.ki_std = stiffness_std(output.ki, output.lambda_std_total, output.lambda_hat);
        output.ks_std = stiffness_std(output.ks, output.lambda_std_total, output.lambda_hat);
        output.clone()
    }
}
