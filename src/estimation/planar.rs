//! The methods for the paper's machine: prediction errors, as for all machines, and the paper's own.

use serde::{Deserialize, Serialize};

use super::paper::{Paper, PaperState};
use super::parts::{Parts, PartsState};
use super::{CheckedSample, Estimation, EstimatorOutputOf, SampleStatus, Verdict};

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
