//! `FlatnessController`: reference, tracking law, perturbation observer, force allocation and current loop.

use std::fmt;

use fmu_export::log::{Digits, Log, Topic};
use fmu_export::variable::Row;
use fmu_export::variable::{Table, Value};
use fmu_export::{Info, Invalid, Resources, SampledModel, StepError};
use serde::{Deserialize, Serialize};

use super::common::{info, refused, sampled};
use crate::control::controller::{
    Controller, ControllerConfig, ControllerInput, ControllerOutput, ControllerState, UpdateMode,
};
use crate::machine::{Machine, PLANAR};
use crate::variables::Variables;

/// The values of all variables of the controller.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, Variables)]
#[variables(context = Machine)]
pub struct Values {
    #[nested(prefix = "")]
    config: ControllerConfig,
    #[nested(prefix = "", context = ())]
    input: ControllerInput,
    #[nested(prefix = "", context = ())]
    output: ControllerOutput,
}

impl Values {
    /// The configuration with the speed, which may change during a run.
    fn config(&self) -> ControllerConfig {
        let mut config = self.config.clone();
        config.reference.omega_rad_s = self.input.omega_rad_s;
        config
    }
}

/// The configuration of a controller with the given values by index, and start values elsewhere.
pub fn configuration(settings: &[(usize, Value)]) -> ControllerConfig {
    Table::new(FlatnessController::table()).values(settings).config()
}

/// Logs that force constants have been replaced.
pub(super) fn log_update<const K: usize>(log: &mut dyn Log, instant_s: f64, used: &[f64; K], now: &[f64; K]) {
    let (at_s, used, now) = (Digits::<9>(instant_s), List(used), List(now));
    log.message(
        Topic::Event,
        format_args!("at {at_s} s the force constants {used} N.m2/A2 are replaced by {now} N.m2/A2"),
    );
}

/// Numbers with six digits, for messages.
struct List<'a>(&'a [f64]);

impl fmt::Display for List<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (k, value) in self.0.iter().enumerate() {
            write!(f, "{}{}", if k == 0 { "(" } else { ", " }, Digits::<6>(*value))?;
        }
        write!(f, ")")
    }
}

/// The controller.
#[derive(Clone)]
pub struct FlatnessController(Controller);

impl SampledModel for FlatnessController {
    const INFO: Info = info(
        "FlatnessController",
        "Flatness-based tracking controller with perturbation observer for a three-phase magnetic bearing",
    );
    type Values = Values;
    type State = ControllerState;

    fn table() -> Vec<Row<Values>> {
        sampled(Values::rows_in(&PLANAR), &PLANAR)
    }

    fn new(values: &Values, _: &Resources) -> Result<Self, Vec<Invalid>> {
        Controller::new(values.config()).map(Self).map_err(refused)
    }

    fn period_s(&self) -> f64 {
        self.0.config().law.step_s
    }

    fn start(&self, values: &mut Values, start_s: f64) -> ControllerState {
        values.output = self.0.output_at_start();
        self.0.start(start_s)
    }

    fn sample(
        &self,
        state: &mut ControllerState,
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

    fn retune(&mut self, _: &mut ControllerState, values: &Values, _: &Resources) -> Result<(), Vec<Invalid>> {
        let law = &values.config.law;
        self.0.retune(law.modulation, law.modulation_hz[0]).map_err(refused)
    }

    fn accepts(&self, state: &ControllerState) -> Result<(), String> {
        self.0.accepts(state).then_some(()).ok_or_else(|| "the state is not one that this controller can have".into())
    }
}
