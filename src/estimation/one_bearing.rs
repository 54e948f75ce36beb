//! The estimator of a rotor in one bearing, with its positions as coordinates.

use libm::sin;
use nalgebra::SMatrix;
use serde::{Deserialize, Serialize};

use super::config::{MAX_INTERVALS, MIN_INTERVALS, WHOLE_NUMBER_TOLERANCE};
use super::paper::{Paper, PaperState};
use super::parts::{Parts, PartsState};
use super::{
    CheckedSample, Estimation, EstimatorConfigOf, EstimatorOutputOf, Machine, Method, Names, SampleStatus, Verdict,
};
use crate::bearing::array;
use crate::bearing::magnet::{Geometry, SMALLEST_SINE};
use crate::bearing::rotor::{BearingConfig, RotorConfig};
use crate::invalid::Checks;
use crate::variables::numbers;

/// Relative standard deviation of a force constant that is fixed at its first guess.
const FIXED_STD: f64 = 1.0e-3;

impl<const N: usize, const K: usize, const U: usize> Machine<N, K, U> {
    /// A rotor of this mass in kg in a bearing with this gap in m and magnets at these angles in rad.
    pub fn of_bearing(m_kg: f64, gap_m: f64, alpha_rad: [f64; K]) -> Self {
        let geometry = Geometry::<f64, N, K>::new(gap_m, alpha_rad);
        let axes = array::from_fn::<[f64; N], N, _>(|a| array::from_fn(|n| f64::from(u8::from(a == n))));
        // Magnets; in the plane, unbalance and backward force; load.
        let rotating = if N == 2 { 2 } else { 0 };
        let others = (0..=rotating).flat_map(|_| axes);
        let forces = geometry.directions.into_iter().chain(others).collect::<Vec<[f64; N]>>();
        let accelerations = SMatrix::from_fn(|force, n| forces[force][n] / m_kg);
        Self { geometry, accelerations, backward: K + rotating, gyroscopic: None }
    }
}

impl<const K: usize> EstimatorConfigOf<RotorConfig<f64, 1>, K> {
    /// Reports inconsistent parameters whose values are each within their limits, under their names in the interface.
    pub(super) fn check_bearing<const N: usize>(&self, checks: &mut Checks) {
        let alpha_rad = &self.geometry.bearings[0].alpha_rad[..K];
        for (k, alpha) in alpha_rad.iter().enumerate().filter(|_| N == 2) {
            for (l, other) in alpha_rad.iter().enumerate().take(k) {
                // Of four magnets two may be opposed, since these pull alternately: their currents distinguish them.
                let sine = if K == 3 { sin(alpha - other).abs() } else { 2.0 * sin(0.5 * (alpha - other)).abs() };
                let wanted =
                    format!("an angle off the line of magnet {}: their forces could not be distinguished", l + 1);
                let name = format!("alpha[{}]", k + 1);
                checks.number(sine >= SMALLEST_SINE, name, (*alpha, "rad"), wanted);
            }
        }
        if self.method == Method::PredictionError {
            return;
        }
        for (name, value, unit) in numbers("tolerance.", &self.tolerance, Names::of::<N, K>()) {
            let wanted = "0, or method = predictionError, for the paper's methods have no use for a tolerance";
            let unused = value == 0.0 || name == "tolerance.backwardForce";
            checks.require(unused, name, format_args!("{value} {unit}"), wanted);
        }
        let wanted = "true, or method = predictionError, for the paper's methods identify no unbalance";
        checks.require(self.identify_unbalance, "identify.unbalance", self.identify_unbalance, wanted);
        let (n, slack) = (self.window_s / self.step_s, WHOLE_NUMBER_TOLERANCE);
        for (holds, wanted) in [
            (n >= MIN_INTERVALS * (1.0 - slack), "at least 8 Ts"),
            (n <= MAX_INTERVALS * (1.0 + slack), "at most 100000 Ts"),
            ((n - n.round()).abs() <= slack * n, "a whole number of Ts"),
        ] {
            checks.number(holds, "Tf", (self.window_s, "s"), wanted);
        }
        let is_long = self.epsilon_s >= self.window_s * (1.0 - slack);
        let wanted = "at least Tf, the time to fill the first window";
        checks.number(is_long, "epsilon", (self.epsilon_s, "s"), wanted);
    }

    /// The method, with R uncertain parameters: the gap and, in the plane, the angles.
    pub(super) fn parts<const N: usize, const U: usize, const T: usize, const R: usize>(&self) -> Parts<N, K, U, T> {
        let (m_kg, BearingConfig { gap_m, alpha_rad, .. }) = (self.geometry.shaft.m_kg, self.geometry.bearings[0]);
        let machine = |change: [f64; R]| {
            let alpha_rad = array::from_fn(|k| alpha_rad[k] + change.get(1 + k).copied().unwrap_or_default());
            Machine::of_bearing(m_kg, gap_m + change[0], alpha_rad)
        };
        let std = array::from_fn(|r| if r == 0 { self.tolerance.gap_m } else { self.tolerance.alpha_rad });
        let mut first = self.prediction_error(m_kg, machine, std, self.lambda0_nm2_a2);
        if let Some(only) = self.used.only() {
            for k in (0..K).filter(|k| *k != only) {
                let std = FIXED_STD * self.lambda0_nm2_a2[k];
                first.prior.precision[k] = 1.0 / (std * std);
            }
        }
        Parts { first, axial: None }
    }
}

/// The methods for the paper's machine.
#[derive(Clone, Debug, PartialEq)]
pub enum Planar {
    PredictionError(Parts<2, 3, 9, 11>),
    Paper(Paper),
}

/// State between samples.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum PlanarState {
    PredictionError(PartsState<2, 3, 9, 11>),
    Paper(Box<PaperState>),
}

impl Estimation<2, 3, 1> for Planar {
    type State = PlanarState;

    fn start(&self) -> PlanarState {
        match self {
            Planar::PredictionError(method) => PlanarState::PredictionError(Estimation::<2, 3, 1>::start(method)),
            Planar::Paper(method) => PlanarState::Paper(Box::new(method.start())),
        }
    }

    fn has_shape(&self, state: &PlanarState) -> bool {
        match (self, state) {
            (Planar::PredictionError(method), PlanarState::PredictionError(state)) => {
                Estimation::<2, 3, 1>::has_shape(method, state)
            }
            (Planar::Paper(method), PlanarState::Paper(state)) => method.has_shape(state),
            _ => false,
        }
    }

    fn is_in_gap(&self, position_m: [f64; 2]) -> bool {
        match self {
            Planar::PredictionError(method) => Estimation::<2, 3, 1>::is_in_gap(method, position_m),
            Planar::Paper(method) => method.gaps(position_m).iter().all(|gap_m| *gap_m > 0.0),
        }
    }

    fn advance(
        &self,
        state: &mut PlanarState,
        sample: &CheckedSample<'_, 2, 3>,
        output: &mut EstimatorOutputOf<2, 3, 1>,
    ) -> [Verdict; 1] {
        match (self, state) {
            (Planar::PredictionError(method), PlanarState::PredictionError(own)) => method.advance(own, sample, output),
            (Planar::Paper(method), PlanarState::Paper(own)) if method.has_shape(own) => {
                // The paper's methods use repeated samples and do not bridge gaps.
                let rejection = match sample.status {
                    SampleStatus::Repeated if sample.input.enable && !sample.input.contact => None,
                    _ => sample.rejection(0..2, Verdict::BadSample),
                };
                let rejection = rejection.inspect(|_| method.interrupt(own));
                [rejection.unwrap_or_else(|| method.sample(own, sample.input, output))]
            }
            _ => [Verdict::ForeignState],
        }
    }
}
