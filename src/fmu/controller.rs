//! `FlatnessController`, `SpindleController` and those of the other machines: reference, tracking law, perturbation observers, force
//! allocation and current loop.

use fmu_export::log::{Digits, Log, Topic};
use fmu_export::variable::Row;
use fmu_export::{Info, Invalid, Resources, SampledModel, StepError};
use serde::{Deserialize, Serialize};

use super::common::{Values, info, sampled};
use crate::bearing::Rotor;
use crate::control::controller::{
    Controller, ControllerConfigOf, ControllerInput, ControllerOutput, ControllerState, UpdateMode,
};
use crate::variables::Saved;

/// Logs a change of the force constants in use.
fn log_update<const K: usize>(log: &mut dyn Log, instant_s: f64, old: &[f64; K], new: &[f64; K]) {
    let list = |values: &[f64; K]| values.map(|value| Digits::<6>(value).to_string()).join(", ");
    let (at_s, old, new) = (Digits::<9>(instant_s), list(old), list(new));
    log.message(
        Topic::Event,
        format_args!("at {at_s} s the force constants ({old}) N.m2/A2 are replaced by ({new}) N.m2/A2"),
    );
}

/// The state of a controller, with the outputs that take effect with the next sample.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(bound = "ControllerState<N, K, G>: Saved, ControllerOutput<N, K>: Saved")]
pub struct State<const N: usize, const K: usize, const G: usize> {
    controller: ControllerState<N, K, G>,
    next: Option<ControllerOutput<N, K>>,
}

/// The trait's methods take `Values`; calls without them go to the controller's own.
impl<const N: usize, const K: usize, const B: usize, const G: usize> SampledModel for Controller<N, K, B, G>
where
    // Holds for every length in use; serde does not implement it for generic lengths.
    ControllerConfigOf<N, K, B, G>: Saved,
    ControllerInput<N, K>: Saved,
    ControllerOutput<N, K>: Saved,
    ControllerState<N, K, G>: Saved,
    State<N, K, G>: Saved + Send + Sync + 'static,
{
    const INFO: Info = info(&Rotor::<N, K, B>::MACHINE.models[1]);
    type Values = Values<ControllerConfigOf<N, K, B, G>, ControllerInput<N, K>, ControllerOutput<N, K>>;
    type State = State<N, K, G>;

    fn table() -> Vec<Row<Self::Values>> {
        sampled(Rotor::<N, K, B>::MACHINE)
    }

    fn new(values: &Self::Values, _: &Resources) -> Result<Self, Vec<Invalid>> {
        Self::new(values.config.clone())
    }

    fn period_s(&self) -> f64 {
        self.config().law.step_s
    }

    fn start(&self, values: &mut Self::Values, start_s: f64) -> Self::State {
        values.output = self.output_at_start();
        State { controller: self.start(start_s), next: None }
    }

    fn sample(
        &self,
        state: &mut Self::State,
        values: &mut Self::Values,
        instant_s: f64,
        log: &mut dyn Log,
    ) -> Result<(), StepError> {
        let old = values.output.lambda_used_nm2_a2;
        let next = self.sample(&mut state.controller, &values.input).map_err(StepError::of)?;
        let new = next.lambda_used_nm2_a2;
        state.next = Some(next);
        if old != new && self.config().law.update == UpdateMode::AtTime && log.wants(Topic::Event) {
            log_update(log, instant_s, &old, &new);
        }
        Ok(())
    }

    fn take_effect(&self, state: &mut Self::State, values: &mut Self::Values) {
        if let Some(next) = state.next.take() {
            values.output = next;
        }
    }

    fn retune(&mut self, _: &mut Self::State, values: &Self::Values, _: &Resources) -> Result<(), Vec<Invalid>> {
        let law = &values.config.law;
        self.retune(law.modulation, law.modulation_hz)
    }

    fn accepts(&self, state: &Self::State) -> Result<(), String> {
        let accepted = self.accepts(&state.controller);
        accepted.then_some(()).ok_or_else(|| "the state is not one that this controller can have".into())
    }
}
