//! The estimator of a rotor in one bearing, whose coordinates are its positions.

use nalgebra::SMatrix;
use serde::{Deserialize, Serialize};

use super::config::check;
use super::paper::{Paper, PaperState};
use super::{
    Common, Estimation, EstimatorConfigOf, EstimatorOutputOf, EstimatorParameters, Judged, Machine, Method, Names,
    PredictionError, PredictionErrorState, Sample, Taken, Verdict, prediction_error,
};
use crate::bearing::magnet::Geometry;
use crate::invalid::{Checks, Invalid};

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
    /// Parameters that all estimators have.
    fn shared(&self) -> Common<'_, K> {
        Common {
            m_kg: self.m_kg,
            step_s: self.step_s,
            lambda0_nm2_a2: self.lambda0_nm2_a2,
            hold: self.hold,
            // The paper's methods have no use for the angle, and along the axis there is no unbalance.
            identify_unbalance: self.identify_unbalance && N == 2,
            noise: [self.position_noise_m, self.current_noise_a],
            tolerance: &self.tolerance,
        }
    }

    /// The method with `std.len()` uncertain parameters: the gap, and in the plane the angles.
    fn estimator<const U: usize, const T: usize, const R: usize>(&self) -> PredictionError<N, K, U, T> {
        let machine = |change: [f64; R]| {
            let alpha_rad = std::array::from_fn(|k| self.alpha_rad[k] + change.get(1 + k).copied().unwrap_or_default());
            Machine::of_bearing(self.m_kg, self.gap_m + change[0], alpha_rad)
        };
        let std = std::array::from_fn(|r| if r == 0 { self.tolerance.gap_m } else { self.tolerance.alpha_rad });
        let mut method = prediction_error(machine, std, self.lambda0_nm2_a2, &self.shared());
        if let Some(only) = self.used.only() {
            for k in (0..K).filter(|k| *k != only) {
                let std = HELD * self.lambda0_nm2_a2[k];
                method.prior.precision[k] = 1.0 / (std * std);
            }
        }
        method
    }
}

/// Implements the parameters for the sizes of a machine: coordinates, magnets, unknowns, columns of tolerances, uncertain parameters.
macro_rules! of_sizes {
    ($n:literal, $k:literal, $method:ty, |$config:ident| $make:expr) => {
        impl EstimatorParameters<$n, $k, 1> for EstimatorConfigOf<$n, $k> {
            const MACHINE: &'static Names = Names::of_one_bearing($n, $k);

            type Method = $method;

            fn common(&self) -> Common<'_, $k> {
                Common {
                    identify_unbalance: self.shared().identify_unbalance && self.method == Method::PredictionError,
                    ..self.shared()
                }
            }

            fn check(&self, checks: &mut Checks) {
                check(self, checks);
            }

            fn method(&self) -> Result<$method, Vec<Invalid>> {
                let $config = self;
                Ok($make)
            }
        }
    };
}

of_sizes!(2, 3, Planar, |config| match config.method {
    Method::PredictionError => Planar::PredictionError(config.estimator::<9, 11, 4>()),
    Method::Paper | Method::PaperLiteral => Planar::Paper(Paper::new(config)),
});
of_sizes!(2, 4, PredictionError<2, 4, 10, 13>, |config| config.estimator::<10, 13, 5>());
of_sizes!(1, 2, PredictionError<1, 2, 3, 5>, |config| config.estimator::<3, 5, 1>());

impl<const N: usize, const K: usize, const U: usize, const T: usize> Estimation<N, K, 1> for PredictionError<N, K, U, T>
where
    PredictionErrorState<N, K, U, T>: Serialize + for<'de> Deserialize<'de>,
{
    type State = Box<PredictionErrorState<N, K, U, T>>;

    fn start(&self) -> Self::State {
        Box::new(self.start())
    }

    fn has_shape(&self, state: &Self::State) -> bool {
        PredictionErrorState::has_shape(state)
    }

    fn is_in_gap(&self, position_m: [f64; N]) -> bool {
        self.filter.machine.geometry.gaps(position_m).iter().all(|gap_m| *gap_m > 0.0)
    }

    fn advance(
        &self,
        state: &mut Self::State,
        sample: &Judged<'_, N, K>,
        output: &mut EstimatorOutputOf<N, K, 1>,
    ) -> [Verdict; 1] {
        let refused = sample.refused(0..N, state.estimate.verdict);
        let (input, rotation) = (sample.input, sample.rotation);
        let verdict = self.take(state, refused, || Sample::new(input.position_m, input.current_a, rotation));
        output.write(0, 0, 0..N, self, state, verdict);
        [verdict]
    }
}

/// The methods for the machine of the paper.
#[derive(Clone, Debug, PartialEq)]
#[expect(clippy::large_enum_variant, reason = "there is one of them")]
pub enum Planar {
    PredictionError(PredictionError<2, 3, 9, 11>),
    Paper(Paper),
}

/// State between samples.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum PlanarState {
    PredictionError(Box<PredictionErrorState<2, 3, 9, 11>>),
    Paper(Box<PaperState>),
}

impl Estimation<2, 3, 1> for Planar {
    type State = PlanarState;

    fn start(&self) -> PlanarState {
        match self {
            Planar::PredictionError(method) => PlanarState::PredictionError(Box::new(method.start())),
            Planar::Paper(method) => PlanarState::Paper(Box::new(method.start())),
        }
    }

    fn has_shape(&self, state: &PlanarState) -> bool {
        match (self, state) {
            (Planar::PredictionError(_), PlanarState::PredictionError(state)) => state.has_shape(),
            (Planar::Paper(method), PlanarState::Paper(state)) => method.has_shape(state),
            _ => false,
        }
    }

    fn is_in_gap(&self, position_m: [f64; 2]) -> bool {
        match self {
            Planar::PredictionError(method) => method.is_in_gap(position_m),
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
