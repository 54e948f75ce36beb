//! The component of a call: an instance, its state in the sequence of calls, and its logger.

use std::ffi::{CStr, CString, c_char};
use std::sync::Arc;

use super::Interface;
use super::arguments::{finite, finite_result, text};
use super::logger::Logger;
use super::sequence::State;
use super::snapshot::{Snapshot, Stage};
use crate::instance::{Instance, ModelType};
use crate::model::{Invalid, Step, StepError};
use crate::resources::Resources;
use crate::variable::Value;

/// Reason for the failure of a call.
pub(crate) enum Problem {
    /// The call was wrong; the instance is unchanged.
    Call(String),
    /// The run cannot continue.
    Run(String),
    /// The model ends the simulation.
    End(String),
}

impl Problem {
    /// A wrong call, with a message.
    pub(crate) fn call(text: impl std::fmt::Display) -> Self {
        Self::Call(text.to_string())
    }
}

/// Result of a call.
pub(crate) type Outcome = Result<(), Problem>;

/// The latest start time: beyond it double precision does not resolve fast sample instants. The time of day in seconds
/// since 1970 is below it.
const LATEST_START_S: f64 = 1e10;

/// An instance with its state in the sequence of calls, its logger and its buffers.
pub(crate) struct Component<I: Interface> {
    pub(crate) model: Arc<ModelType>,
    pub(crate) instance: Instance,
    pub(crate) resources: Resources,
    pub(crate) stage: Stage,
    pub(crate) logger: Logger<I>,
    #[cfg_attr(not(feature = "fmi3"), allow(dead_code, reason = "FMI 2.0 has none"))]
    pub(crate) options: I::Options,
    /// The strings last returned to the importer, valid until its next call.
    pub(crate) texts: Vec<CString>,
}

impl<I: Interface> Component<I> {
    pub(crate) fn new(model: Arc<ModelType>, resources: Resources, logger: Logger<I>, options: I::Options) -> Self {
        let instance = model.instantiate_with(resources.clone());
        Self { instance, resources, model, stage: Stage::BEGIN, logger, options, texts: Vec::new() }
    }

    /// The name of a variable for messages, or its value reference if there is none.
    pub(crate) fn name_of(&self, reference: u32) -> String {
        let found = self.model.variables().get(reference as usize).map(|variable| variable.name.to_string());
        found.unwrap_or_else(|| format!("value reference {reference}"))
    }

    /// The error for reading a variable as another type.
    pub(crate) fn wrong_type(&self, reference: u32, wanted: &str, found: &Value) -> Problem {
        Problem::Call(format!("{} is not of type {wanted} but {}", self.name_of(reference), found.type_name()))
    }

    pub(crate) fn setup(&mut self, start_s: f64, stop_s: Option<f64>) -> Outcome {
        if start_s.is_nan() || start_s.abs() > LATEST_START_S {
            return Err(Problem::Call(format!(
                "startTime = {start_s} is refused: expected a finite number, at most {LATEST_START_S} in magnitude"
            )));
        }
        if let Some(stop_s) = stop_s.filter(|stop_s| stop_s.is_nan() || *stop_s < start_s) {
            return Err(Problem::Call(format!(
                "stopTime = {stop_s} is refused: expected a number not below startTime = {start_s}"
            )));
        }
        self.stage.stop_s = stop_s;
        self.instance.set_start(start_s);
        Ok(())
    }

    pub(crate) fn exit_initialization(&mut self) -> Outcome {
        self.instance.start().map_err(|findings| Problem::Run(Invalid::list(&findings)))?;
        self.stage.state = State::StepMode;
        Ok(())
    }

    pub(crate) fn step(&mut self, step: Step) -> Outcome {
        self.instance.check_step(step).map_err(Problem::Call)?;
        let tolerance_s = self.instance.tolerance_s();
        if let Some(stop_s) = self.stage.stop_s.filter(|stop_s| step.end_s() > stop_s + tolerance_s) {
            let Step { time_s, length_s } = step;
            return Err(Problem::Call(format!(
                "a step from {time_s} over {length_s} is refused: it ends beyond stopTime = {stop_s}"
            )));
        }
        self.stage.failed = true;
        let outcome = self.instance.checked_step(step, &mut self.logger);
        if let Err(StepError::Failed(text)) = outcome {
            return Err(Problem::Run(text));
        }
        self.stage.failed = false;
        outcome.map_err(|ended| Problem::End(ended.to_string()))
    }

    /// Reads texts, which stay valid until the next call.
    pub(crate) fn read_texts(&mut self, indices: &[u32], values: &mut [*const c_char]) -> Outcome {
        let mut texts = Vec::new();
        for index in indices {
            let found = self.instance.get(*index as usize).map_err(Problem::call)?;
            let Value::String(text) = found else { return Err(self.wrong_type(*index, "String", &found)) };
            // A zero byte would end the string for the importer; a blank keeps the remainder readable.
            texts.push(CString::new(text.replace('\0', " ")).expect("zero bytes were replaced"));
        }
        self.texts = texts;
        for (value, text) in values.iter_mut().zip(&self.texts) {
            *value = text.as_ptr();
        }
        Ok(())
    }

    /// Directional derivatives of the unknowns, in the direction in which the knowns change.
    pub(crate) fn differentiate(
        &mut self,
        (knowns, direction): (&[u32], &[f64]),
        (unknowns, derivatives): (&[u32], &mut [f64]),
    ) -> Outcome {
        for (reference, value) in knowns.iter().zip(direction) {
            finite(*value).map_err(|why| Problem::Call(format!("{}: {why}", self.name_of(*reference))))?;
        }
        let known = |at: usize| (knowns[at] as usize, direction[at]);
        let found = self.instance.differentiate(knowns.len(), &known).map_err(Problem::call)?;
        for (reference, derivative) in unknowns.iter().zip(derivatives) {
            *derivative = finite_result(self, *reference, found.of(*reference as usize).map_err(Problem::call)?)?;
        }
        Ok(())
    }

    /// Switches log categories on or off; an empty list means all of them.
    ///
    /// # Safety
    /// Every text is null or ends with a zero byte and stays valid and unchanged until the call returns.
    pub(crate) unsafe fn switch_logging(&mut self, on: bool, categories: &[*const c_char]) -> Outcome {
        // SAFETY: by this function's contract.
        let names = categories.iter().map(|name| unsafe { text(*name) });
        let names: Vec<&CStr> =
            names.collect::<Option<_>>().ok_or_else(|| Problem::call("categories holds a null pointer"))?;
        self.logger.switch(on, &names).map_err(|name| {
            Problem::Call(format!("{} is not a category of the model description", name.to_string_lossy()))
        })
    }

    /// Enters a state of the sequence of calls.
    pub(crate) fn change(&mut self, state: State) -> Outcome {
        self.stage.state = state;
        Ok(())
    }

    pub(crate) fn reset(&mut self) -> Outcome {
        self.instance.reset();
        self.stage = Stage::BEGIN;
        Ok(())
    }

    /// A snapshot of this instance.
    pub(crate) fn save(&self) -> Result<Snapshot, Problem> {
        let instance = self.instance.duplicate().ok_or_else(no_snapshots)?;
        Ok(Snapshot { model: self.model.clone(), instance, stage: self.stage })
    }

    /// Overwrites an existing snapshot of the same model.
    pub(crate) fn save_over(&self, snapshot: &mut Snapshot) -> Outcome {
        if !snapshot.instance.copy_from(&self.instance) {
            return Err(foreign(snapshot, &self.model));
        }
        snapshot.stage = self.stage;
        Ok(())
    }

    /// Restores a snapshot of this or another instance of the same model. Name, callbacks and log categories stay.
    pub(crate) fn restore(&mut self, snapshot: &Snapshot) -> Outcome {
        let state = snapshot.stage.state;
        if I::STATES.iter().all(|(known, _)| *known != state) {
            return Err(Problem::call(
                "FMUstate is a snapshot of another version of FMI, in a state unknown to this one",
            ));
        }
        if !self.instance.copy_from(&snapshot.instance) {
            return Err(foreign(snapshot, &self.model));
        }
        self.stage = snapshot.stage;
        Ok(())
    }
}

fn no_snapshots() -> Problem {
    Problem::call("this model has no snapshots, as the model description says")
}

fn foreign(snapshot: &Snapshot, model: &ModelType) -> Problem {
    let (found, wanted) = (snapshot.model.info.name, model.info.name);
    Problem::Call(format!("FMUstate is a snapshot of {found}: expected one of {wanted}"))
}
