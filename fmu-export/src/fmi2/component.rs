//! What a call operates on: an instance, its state in the sequence of calls, and its logger.

use std::ffi::CString;
use std::sync::Arc;

use super::bindings::{fmi2Status, fmi2ValueReference};
use super::logger::Logger;
use super::sequence::State;
use super::snapshot::{Snapshot, Stage};
use crate::instance::{Instance, ModelType};
use crate::model::{Invalid, Step, StepError};
use crate::resources::Resources;

/// Why a call returns fmi2Error.
pub(super) enum Problem {
    /// The call was wrong; the instance is unchanged.
    Call(String),
    /// The run cannot continue.
    Run(String),
    /// The model ends the simulation.
    End(String),
}

impl Problem {
    /// A wrong call, with a message.
    pub(super) fn call(text: impl std::fmt::Display) -> Self {
        Self::Call(text.to_string())
    }
}

/// Result of a call.
pub(super) type Outcome = Result<(), Problem>;

/// The latest start time: beyond it double precision does not resolve the instants of fast samples. The time of day in seconds
/// since 1970 is below it.
const LATEST_START_S: f64 = 1e10;

/// What a call operates on.
pub(super) struct Component {
    pub(super) model: Arc<ModelType>,
    pub(super) instance: Box<dyn Instance>,
    pub(super) resources: Resources,
    pub(super) stage: Stage,
    pub(super) logger: Logger,
    /// The strings last returned to the importer, valid until its next call.
    pub(super) texts: Vec<CString>,
}

impl Component {
    pub(super) fn new(model: Arc<ModelType>, resources: Resources, logger: Logger) -> Self {
        let instance = model.instantiate_with(resources.clone());
        Self { instance, resources, model, stage: Stage::BEGIN, logger, texts: Vec::new() }
    }

    /// The name of a variable for messages, or its value reference if there is none.
    pub(super) fn name_of(&self, reference: fmi2ValueReference) -> String {
        let found = self.model.variables().get(reference as usize).map(|variable| variable.name.to_string());
        found.unwrap_or_else(|| format!("value reference {reference}"))
    }

    pub(super) fn setup(&mut self, start_s: f64, stop_s: Option<f64>) -> Outcome {
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
        (self.stage.time_s, self.stage.start_s, self.stage.stop_s) = (start_s, start_s, stop_s);
        self.instance.set_start(start_s);
        Ok(())
    }

    pub(super) fn exit_initialization(&mut self) -> Outcome {
        self.instance.start().map_err(|findings| Problem::Run(Invalid::list(&findings)))?;
        self.stage.state = State::StepComplete;
        Ok(())
    }

    /// Difference up to which two instants count as equal: importers add up steps in floating point, with errors that grow with
    /// the length of the run, and far from 0 the last bits of a time are coarse.
    fn tolerance_s(&self) -> f64 {
        let Stage { time_s, start_s, .. } = self.stage;
        1e-9 * (time_s - start_s).abs().max(1.0) + 4096.0 * f64::EPSILON * time_s.abs()
    }

    pub(super) fn step(&mut self, step: Step) -> Outcome {
        let Step { time_s, length_s } = step;
        let refuse = |why: String| Err(Problem::Call(why));
        if !length_s.is_finite() || length_s < 0.0 {
            return refuse(format!(
                "communicationStepSize = {length_s} is refused: expected a finite number, 0 or above"
            ));
        }
        if self.stage.last_step == fmi2Status::fmi2Discard {
            return refuse(format!("refused: the model has ended the simulation at {} s", self.stage.time_s));
        }
        // NaN is refused as well.
        let follows = (time_s - self.stage.time_s).abs() <= self.tolerance_s() && step.end_s().is_finite();
        if !follows {
            return refuse(format!(
                "currentCommunicationPoint = {time_s} is refused: expected {}, the end of the last step",
                self.stage.time_s
            ));
        }
        if let Some(stop_s) = self.stage.stop_s.filter(|stop_s| step.end_s() > stop_s + self.tolerance_s()) {
            return refuse(format!(
                "a step from {time_s} over {length_s} is refused: it ends beyond stopTime = {stop_s}"
            ));
        }
        let longest_s = self.instance.longest_step_s();
        if length_s > longest_s {
            return refuse(format!(
                "communicationStepSize = {length_s} is refused: expected at most {longest_s}, since it would take too long"
            ));
        }
        self.stage.last_step = fmi2Status::fmi2Error;
        self.instance.step(step, &mut self.logger).map_err(|error| match error {
            StepError::Terminated { time_s, .. } => {
                (self.stage.last_step, self.stage.time_s) = (fmi2Status::fmi2Discard, time_s);
                Problem::End(error.to_string())
            }
            StepError::Failed(text) => Problem::Run(text),
        })?;
        self.stage.last_step = fmi2Status::fmi2OK;
        self.stage.time_s = step.end_s();
        Ok(())
    }

    pub(super) fn reset(&mut self) {
        self.instance.reset();
        self.stage = Stage::BEGIN;
    }

    /// A snapshot of this instance.
    pub(super) fn save(&self) -> Result<Snapshot, Problem> {
        let instance = self.instance.duplicate().ok_or_else(no_snapshots)?;
        Ok(Snapshot { model: self.model.clone(), instance, stage: self.stage })
    }

    /// Takes a snapshot of this instance into an existing one of the same model.
    pub(super) fn save_over(&self, snapshot: &mut Snapshot) -> Outcome {
        // Of a model without snapshots there is none to write into.
        if !snapshot.instance.copy_from(self.instance.as_ref()) {
            return Err(foreign(snapshot, &self.model));
        }
        snapshot.stage = self.stage;
        Ok(())
    }

    /// Restores the state of this, or another instance of the same model. Name, callbacks and log categories stay.
    pub(super) fn restore(&mut self, snapshot: &Snapshot) -> Outcome {
        if !self.instance.copy_from(snapshot.instance.as_ref()) {
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
