//! `SpindleController`: reference, tracking law, perturbation observers, force allocation and current loop of a spindle.

use fmu_export::log::{Log, Topic};
use fmu_export::variable::{Row, Table, Value};
use fmu_export::{Info, Invalid, Resources, SampledModel, StepError};
use serde::{Deserialize, Serialize};

use crate::control::spindle::{
    SpindleController as Controller, SpindleControllerConfig, SpindleControllerInput, SpindleControllerOutput,
    SpindleControllerState,
};
use crate::control::tracking::UpdateMode;
use crate::fmu::common::{info, refused, sampled};
use crate::fmu::controller::log_update;
use crate::machine::{Machine, SPINDLE};
use crate::variables::Variables;

/// The values of all variables of the controller.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, Variables)]
#[variables(context = Machine)]
pub struct Values {
    #[nested(prefix = "")]
    config: SpindleControllerConfig,
    #[nested(prefix = "")]
    input: SpindleControllerInput,
    #[nested(prefix = "")]
    output: SpindleControllerOutput,
}

impl Values {
    /// The configuration with the speed, which may change during a run.
    fn config(&self) -> SpindleControllerConfig {
        let mut config = self.config.clone();
        config.path.omega_rad_s = self.input.omega_rad_s;
        config
    }
}

/// The configuration of a controller with the given values by index, and start values elsewhere.
pub fn configuration(settings: &[(usize, Value)]) -> SpindleControllerConfig {
    Table::new(SpindleController::table()).values(settings).config()
}

/// The controller.
#[derive(Clone)]
pub struct SpindleController(Controller);

impl SampledModel for SpindleController {
    const INFO: Info = info(
        "SpindleController",
        "Flatness-based tracking controller with perturbation observers for a spindle in two radial bearings and an axial one",
    );
    type Values = Values;
    type State = SpindleControllerState;

    fn table() -> Vec<Row<Values>> {
        sampled(Values::rows_in(&SPINDLE), &SPINDLE)
    }

    fn new(values: &Values, _: &Resources) -> Result<Self, Vec<Invalid>> {
        Controller::new(values.config()).map(Self).map_err(refused)
    }

    fn period_s(&self) -> f64 {
        self.0.config().law.step_s
    }

    fn start(&self, values: &mut Values, start_s: f64) -> SpindleControllerState {
        values.output = self.0.output_at_start();
        self.0.start(start_s)
    }

    fn sample(
        &self,
        state: &mut SpindleControllerState,
        values: &mut Values,
        instant_s: f64,
        log: &mut dyn Log,
    ) -> Result<(), StepError> {
        let used = values.output.lambda_used_nm2_a2;
        values.output = self.0.sample(state, &values.input).map_err(StepError::of)?;
        let now = values.output.lambda_used_nm2_a2;
        if used != now && self.0.config().law.update == UpdateMode::AtTime && log.wants(Topic::Event) {
            log_update(log, instant_s, &used, &now);
        }
        Ok(())
    }

    fn retune(&mut self, _: &mut SpindleControllerState, values: &Values, _: &Resources) -> Result<(), Vec<Invalid>> {
        let law = &values.config.law;
        self.0.retune(law.modulation, law.modulation_hz).map_err(refused)
    }

    fn accepts(&self, state: &SpindleControllerState) -> Result<(), String> {
        self.0.accepts(state).then_some(()).ok_or_else(|| "the state is not one that this controller can have".into())
    }
}
