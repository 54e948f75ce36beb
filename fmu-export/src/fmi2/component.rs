//! What a call works on: an instance, its state in the sequence of calls, and its logger.

use std::ffi::CString;
use std::sync::Arc;

use super::bindings::{fmi2Status, fmi2ValueReference};
use super::logger::Logger;
use super::sequence::State;
use super::snapshot::{Snapshot, Stage};
use crate::instance::{Instance, ModelType};
use crate::model::{Invalid, Step};

/// Why a call is answered with fmi2Error.
pub(super) enum Problem {
    /// The call was wrong; the instance stays as it was.
    Call(String),
    /// The run cannot go on.
    Run(String),
}

impl Problem {
    /// A wrong call, in words.
    pub(super) fn call(text: impl std::fmt::Display) -> Self {
        Self::Call(text.to_string())
    }
}

/// How a call ends.
pub(super) type Outcome = Result<(), Problem>;

/// The latest start: beyond it a double precision number does not tell the instants of fast samples apart.
const LATEST_START_S: f64 = 1e9;

/// What a call works on.
pub(super) struct Component {
    pub(super) model: Arc<ModelType>,
    pub(super) instance: Box<dyn Instance>,
    pub(super) stage: Stage,
    pub(super) logger: Logger,
    /// The texts that the importer was handed last, which stay valid until its next call.
    pub(super) texts: Vec<CString>,
}

impl Component {
    pub(super) fn new(model: Arc<ModelType>, logger: Logger) -> Self {
        Self { instance: model.instantiate(), model, stage: Stage::BEGIN, logger, texts: Vec::new() }
    }

    /// What messages call a variable: its name, or its value reference where there is none of that reference.
    pub(super) fn name_of(&self, reference: fmi2ValueReference) -> String {
        let found = self.model.variables().get(reference as usize).map(|variable| variable.name.to_string());
        found.unwrap_or_else(|| format!("value reference {reference}"))
    }

    pub(super) fn setup(&mut self, start_s: f64, stop_s: Option<f64>) -> Outcome {
        if start_s.is_nan() || start_s.abs() > LATEST_START_S {
            return Err(Problem::Call(format!(
                "startTime = {start_s} is refused: a finite number, at most {LATEST_START_S} either way, is wanted"
            )));
        }
        if let Some(stop_s) = stop_s.filter(|stop_s| stop_s.is_nan() || *stop_s < start_s) {
            return Err(Problem::Call(format!(
                "stopTime = {stop_s} is refused: a number not below startTime = {start_s} is wanted"
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

    /// How far two instants may be apart and still be the same: importers add up steps in floating point, whose errors
    /// grow with the length of the run, and far from 0 the last bits of a time are coarse.
    fn tolerance_s(&self) -> f64 {
        let Stage { time_s, start_s, .. } = self.stage;
        1e-9 * (time_s - start_s).abs().max(1.0) + 4096.0 * f64::EPSILON * time_s.abs()
    }

    pub(super) fn step(&mut self, step: Step) -> Outcome {
        let Step { time_s, length_s } = step;
        let refuse = |why: String| Err(Problem::Call(why));
        if !length_s.is_finite() || length_s < 0.0 {
            return refuse(format!(
                "communicationStepSize = {length_s} is refused: a finite number, not negative, is wanted"
            ));
        }
        // Written so that no number is refused as well.
        let follows = (time_s - self.stage.time_s).abs() <= self.tolerance_s() && step.end_s().is_finite();
        if !follows {
            return refuse(format!(
                "currentCommunicationPoint = {time_s} is refused: {}, the end of the last step, is wanted",
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
                "communicationStepSize = {length_s} is refused: at most {longest_s} is wanted, or it would take too long"
            ));
        }
        self.stage.last_step = fmi2Status::fmi2Error;
        self.instance.step(step, &mut self.logger).map_err(|error| Problem::Run(error.to_string()))?;
        self.stage.last_step = fmi2Status::fmi2OK;
        self.stage.time_s = step.end_s();
        Ok(())
    }

    pub(super) fn reset(&mut self) {
        self.instance.reset();
        self.stage = Stage::BEGIN;
    }

    /// A snapshot of this instance.
    pub(super) fn save(&self) -> Snapshot {
        Snapshot { model: self.model.clone(), instance: self.instance.duplicate(), stage: self.stage }
    }

    /// A snapshot of this instance, in place of another of the same model.
    pub(super) fn save_over(&self, snapshot: &mut Snapshot) -> Outcome {
        if !snapshot.instance.copy_from(self.instance.as_ref()) {
            return Err(foreign(snapshot, &self.model));
        }
        snapshot.stage = self.stage;
        Ok(())
    }

    /// Makes this instance what it, or another of the same model, was. Name, callbacks and log categories stay.
    pub(super) fn restore(&mut self, snapshot: &Snapshot) -> Outcome {
        if !self.instance.copy_from(snapshot.instance.as_ref()) {
            return Err(foreign(snapshot, &self.model));
        }
        self.stage = snapshot.stage;
        Ok(())
    }
}

fn foreign(snapshot: &Snapshot, model: &ModelType) -> Problem {
    let (found, wanted) = (snapshot.model.info.name, model.info.name);
    Problem::Call(format!("FMUstate is a snapshot of {found}: one of {wanted} is wanted"))
}
