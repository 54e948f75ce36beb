//! The estimator of a rotor in one bearing, whose coordinates are its positions.

use nalgebra::SMatrix;
use serde::{Deserialize, Serialize};

use super::paper::{Paper, PaperState};
use super::parts::{Parts, PartsState};
use super::{
    Common, Estimation, EstimatorConfigOf, EstimatorOutputOf, Judged, Machine, Method, Names, Taken, Verdict,
    prediction_error,
};
use crate::bearing::magnet::Geometry;

/// A force constant that is held at its first guess has this standard deviation, relative.
const HELD: f64 = 1.0e-3;

impl<const N: usize, const K: usize, const U: usize> Machine<N, K, U> {
    /// A rotor of this mass in kg in a bearing with this gap in m and magnets at these angles in rad.
    pub fn of_bearing(m_kg: f64, gap_m: f64, alpha_rad: [f64; K]) -> Self {
        let geometry = Geometry::<f64, N, K>::new(gap_m, alpha_rad);
        let axes = std::array::from_fn::<[f64; N], N, _>(|a| std::array::from_fn(|n| f64::from(u8::from(a == n))));
        // Magnets, in the plane unbalance and backward force, load.
        let turning = if N == 2 { 2 } else { 0 };
        let others = (0..=turning).flat_map(|_| axes);
        let forces = geometry.directions.into_iter().chain(others).collect::<Vec<[f64; N]>>();
        let accelerations = SMatrix::from_fn(|force, n| forces[force][n] / m_kg);
        Self { geometry, accelerations, backward: K + turning, gyroscopic: None }
    }
}

impl<const N: usize, const K: usize> EstimatorConfigOf<N, K> {
    /// How its parts are called.
    pub(super) const NAMES: &'static Names = Names::of::<N, K>();

    /// Parameters that all estimators have.
    pub(super) fn shared(&self) -> Common<'_, K> {
        Common {
            m_kg: self.m_kg,
            step_s: self.step_s,
            lambda0_nm2_a2: self.lambda0_nm2_a2,
            hold: self.hold,
            // The paper's methods have no use for the angle, and along the axis there is no unbalance.
            identify_unbalance: self.identify_unbalance && N == 2 && self.method == Method::PredictionError,
            noise: [self.position_noise_m, self.current_noise_a],
            tolerance: &self.tolerance,
        }
    }

    /// The method with `std.len()` uncertain parameters: the gap, and in the plane the angles.
    pub(super) fn parts<const U: usize, const T: usize, const R: usize>(&self) -> Parts<N, K, U, T> {
        let machine = |change: [f64; R]| {
            let alpha_rad = std::array::from_fn(|k| self.alpha_rad[k] + change.get(1 + k).copied().unwrap_or_default());
            Machine::of_bearing(self.m_kg, self.gap_m + change[0], alpha_rad)
        };
        let std = std::array::from_fn(|r| if r == 0 { self.tolerance.gap_m } else { self.tolerance.alpha_rad });
        let mut first = prediction_error(machine, std, self.lambda0_nm2_a2, &self.shared());
        if let Some(only) = self.used.only() {
            for k in (0..K).filter(|k| *k != only) {
                let std = HELD * self.lambda0_nm2_a2[k];
                first.prior.precision[k] = 1.0 / (std * std);
            }
        }
        Parts { first, axial: None }
    }
}

/// The methods for the machine of the paper.
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
        sample: &Judged<'_, 2, 3>,
        output: &mut EstimatorOutputOf<2, 3, 1>,
    ) -> [Verdict; 1] {
        match (self, state) {
            (Planar::PredictionError(method), PlanarState::PredictionError(own)) => method.advance(own, sample, output),
            (Planar::Paper(method), PlanarState::Paper(own)) if method.has_shape(own) => {
                // These methods bridge no gap.
                let refused = match sample.taken {
                    Taken::Repeated if sample.input.enable && !sample.input.contact => None,
                    _ => sample.refused(0..2, Verdict::BadSample),
                };
                let refused = refused.inspect(|_| method.interrupt(own));
                [refused.unwrap_or_else(|| method.sample(own, sample.input, output))]
            }
            _ => [Verdict::ForeignState],
        }
    }
}
