//! `AlgebraicEstimator`: the force constants from positions and currents, on line.

use fmu_export::log::{Digits, Log, Topic};
use fmu_export::variable::{Enumeration, Row, Table, Value};
use fmu_export::{Info, Invalid, Resources, SampledModel, StepError};
use serde::{Deserialize, Serialize};

use super::common::{info, refused, sampled};
use crate::estimation::{Estimator, EstimatorConfig, EstimatorInput, EstimatorOutput, EstimatorState, Method, Verdict};
use crate::machine::{Machine, PLANAR};
use crate::variables::{Choice, Variables};

/// How the force constants are computed.
pub const METHOD: &Enumeration = Method::ENUMERATION;

/// Why an estimate is valid or not.
pub const VERDICT: &Enumeration = Verdict::ENUMERATION;

/// The values of all variables of the estimator.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, Variables)]
#[variables(context = Machine)]
pub struct Values {
    #[nested(prefix = "")]
    config: EstimatorConfig,
    #[nested(prefix = "", context = ())]
    input: EstimatorInput,
    #[nested(prefix = "", context = ())]
    output: EstimatorOutput,
}

/// The configuration of an estimator with the given values by index, and start values elsewhere.
pub fn configuration(settings: &[(usize, Value)]) -> EstimatorConfig {
    Table::new(AlgebraicEstimator::table()).values(settings).config
}

/// Reports a verdict that has changed.
pub(super) fn log_verdict(log: &mut dyn Log, instant_s: f64, former: Verdict, verdict: Verdict) {
    let topic = if verdict == Verdict::Singular { Topic::SingularLinearSystem } else { Topic::Event };
    if former != verdict && log.wants(topic) {
        log.message(topic, format_args!("at {} s the estimate is {verdict}", Digits::<9>(instant_s)));
    }
}

/// The estimator.
#[derive(Clone)]
pub struct AlgebraicEstimator(Estimator);

impl SampledModel for AlgebraicEstimator {
    const INFO: Info =
        info("AlgebraicEstimator", "On-line estimator of the force constants of a three-phase magnetic bearing");
    type Values = Values;
    type State = EstimatorState;

    fn table() -> Vec<Row<Values>> {
        sampled(Values::rows_in(&PLANAR), &PLANAR)
    }

    fn new(values: &Values, _: &Resources) -> Result<Self, Vec<Invalid>> {
        Estimator::new(values.config.clone()).map(Self).map_err(refused)
    }

    fn period_s(&self) -> f64 {
        self.0.config().step_s
    }

    fn start(&self, values: &mut Values, _: f64) -> EstimatorState {
        let state = self.0.start();
        values.output = state.output().clone();
        state
    }

    fn sample(
        &self,
        state: &mut EstimatorState,
        values: &mut Values,
        instant_s: f64,
        log: &mut dyn Log,
    ) -> Result<(), StepError> {
        let former = values.output.verdict;
        values.output = self.0.sample(state, &values.input);
        log_verdict(log, instant_s, former, values.output.verdict);
        Ok(())
    }

    fn accepts(&self, state: &EstimatorState) -> Result<(), String> {
        self.0.accepts(state).then_some(()).ok_or_else(|| "the state does not belong to these parameters".into())
    }
}
