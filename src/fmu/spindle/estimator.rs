//! `SpindleEstimator`: the force constants of a spindle's eight magnets and its unbalance in two planes, on line.

use fmu_export::log::Log;
use fmu_export::variable::{Row, Table, Value};
use fmu_export::{Info, Invalid, Resources, SampledModel, StepError};
use serde::{Deserialize, Serialize};

use crate::estimation::spindle::{
    self, SpindleEstimatorConfig, SpindleEstimatorInput, SpindleEstimatorOutput, SpindleEstimatorState,
};
use crate::fmu::common::{info, refused, sampled};
use crate::fmu::estimator::log_verdict;
use crate::machine::{Machine, SPINDLE};
use crate::variables::Variables;

/// The values of all variables of the estimator.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, Variables)]
#[variables(context = Machine)]
pub struct Values {
    #[nested(prefix = "")]
    config: SpindleEstimatorConfig,
    #[nested(prefix = "")]
    input: SpindleEstimatorInput,
    #[nested(prefix = "")]
    output: SpindleEstimatorOutput,
}

/// The configuration of an estimator with the given values by index, and start values elsewhere.
pub fn configuration(settings: &[(usize, Value)]) -> SpindleEstimatorConfig {
    Table::new(SpindleEstimator::table()).values(settings).config
}

/// The estimator.
#[derive(Clone)]
pub struct SpindleEstimator(spindle::SpindleEstimator);

impl SampledModel for SpindleEstimator {
    const INFO: Info = info(
        "SpindleEstimator",
        "On-line estimator of the force constants and the two-plane unbalance of a spindle in magnetic bearings",
    );
    type Values = Values;
    type State = SpindleEstimatorState;

    fn table() -> Vec<Row<Values>> {
        sampled(Values::rows_in(&SPINDLE), &SPINDLE)
    }

    fn new(values: &Values, _: &Resources) -> Result<Self, Vec<Invalid>> {
        spindle::SpindleEstimator::new(values.config.clone()).map(Self).map_err(refused)
    }

    fn period_s(&self) -> f64 {
        self.0.config().step_s
    }

    fn start(&self, values: &mut Values, _: f64) -> SpindleEstimatorState {
        let state = self.0.start();
        values.output = state.output().clone();
        state
    }

    fn sample(
        &self,
        state: &mut SpindleEstimatorState,
        values: &mut Values,
        instant_s: f64,
        log: &mut dyn Log,
    ) -> Result<(), StepError> {
        let former = values.output.verdict;
        values.output = self.0.sample(state, &values.input);
        log_verdict(log, instant_s, former, values.output.verdict);
        Ok(())
    }

    fn accepts(&self, state: &SpindleEstimatorState) -> Result<(), String> {
        self.0.accepts(state).then_some(()).ok_or_else(|| "the state does not belong to these parameters".into())
    }
}
