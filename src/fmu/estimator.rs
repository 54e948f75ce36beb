//! `AlgebraicEstimator`, `SpindleEstimator` and those of the other machines: on-line estimation of the force constants from positions
//! and currents.

use fmu_export::log::{Digits, Log, Topic};
use fmu_export::variable::Row;
use fmu_export::{Info, Invalid, Resources, SampledModel, StepError};

use super::common::{Values, info, sampled};
use crate::estimation::{Body, Estimator, EstimatorConfigOf, EstimatorInputOf, EstimatorOutputOf, StateOf, Verdict};
use crate::machine::Machine;
use crate::variables::Saved;

/// The trait's methods take `Values`; calls without them go to the estimator's own.
impl<G, const N: usize, const K: usize, const P: usize> SampledModel for Estimator<G, N, K, P>
where
    G: Body<N, K, P, Method: Send + Sync> + Send + Sync,
    // Holds for every length in use; serde does not implement it for generic lengths.
    EstimatorConfigOf<G, K>: Saved,
    EstimatorInputOf<N, K>: Saved,
    EstimatorOutputOf<N, K, P>: Saved,
    StateOf<G, N, K, P>: Saved + Send + Sync + 'static,
{
    const INFO: Info = info(&Machine::of::<N, K>().models[2]);
    type Values = Values<EstimatorConfigOf<G, K>, EstimatorInputOf<N, K>, EstimatorOutputOf<N, K, P>>;
    type State = StateOf<G, N, K, P>;

    fn table() -> Vec<Row<Self::Values>> {
        sampled(Machine::of::<N, K>())
    }

    fn new(values: &Self::Values, _: &Resources) -> Result<Self, Vec<Invalid>> {
        Self::new(values.config.clone())
    }

    fn period_s(&self) -> f64 {
        self.config().step_s
    }

    fn start(&self, values: &mut Self::Values, _: f64) -> Self::State {
        let state = self.start();
        values.output = state.output().clone();
        state
    }

    fn sample(
        &self,
        state: &mut Self::State,
        values: &mut Self::Values,
        instant_s: f64,
        log: &mut dyn Log,
    ) -> Result<(), StepError> {
        let former = values.output.verdict;
        values.output = self.sample(state, &values.input);
        let verdict = values.output.verdict;
        let topic = if verdict == Verdict::Singular { Topic::SingularLinearSystem } else { Topic::Event };
        if former != verdict && log.wants(topic) {
            log.message(topic, format_args!("at {} s the estimate is {verdict}", Digits::<9>(instant_s)));
        }
        Ok(())
    }

    fn accepts(&self, state: &Self::State) -> Result<(), String> {
        self.accepts(state).then_some(()).ok_or_else(|| "the state does not belong to these parameters".into())
    }
}
