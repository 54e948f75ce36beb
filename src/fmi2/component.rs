//! One instance as the importer sees it: a slave, its state in the sequence of calls, and its logger.

use super::bindings::fmi2Status;
use super::logger::Logger;
use super::sequence::State;
use crate::slave::AnySlave;
use crate::slave::instance::Step;

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

/// What `fmi2Component` points to.
pub(super) struct Component {
    pub(super) slave: Box<dyn AnySlave>,
    pub(super) state: State,
    pub(super) logger: Logger,
    /// End of the last completed step, or the start time.
    time_s: f64,
    stop_s: Option<f64>,
    pub(super) last_step: fmi2Status,
}

impl Component {
    pub(super) fn new(slave: Box<dyn AnySlave>, logger: Logger) -> Self {
        Self { slave, state: State::Instantiated, logger, time_s: 0.0, stop_s: None, last_step: fmi2Status::fmi2OK }
    }

    pub(super) fn time_s(&self) -> f64 {
        self.time_s
    }

    pub(super) fn setup(&mut self, start_s: f64, stop_s: Option<f64>) -> Outcome {
        if !start_s.is_finite() {
            return Err(Problem::Call(format!("startTime = {start_s} is refused: a finite number is wanted")));
        }
        if let Some(stop_s) = stop_s.filter(|stop_s| stop_s.is_nan() || *stop_s < start_s) {
            return Err(Problem::Call(format!(
                "stopTime = {stop_s} is refused: a number not below startTime = {start_s} is wanted"
            )));
        }
        (self.time_s, self.stop_s) = (start_s, stop_s);
        self.slave.set_start(start_s);
        Ok(())
    }

    pub(super) fn exit_initialization(&mut self) -> Outcome {
        self.slave.start().map_err(|findings| Problem::Run(crate::slave::instance::all(&findings)))?;
        self.state = State::StepComplete;
        Ok(())
    }

    /// How far two instants may be apart and still be the same: importers add up steps in floating point.
    fn tolerance_s(&self) -> f64 {
        1e-9 * self.time_s.abs().max(1.0)
    }

    pub(super) fn step(&mut self, step: Step) -> Outcome {
        let Step { time_s, length_s } = step;
        if !length_s.is_finite() || length_s < 0.0 {
            return Err(Problem::Call(format!(
                "communicationStepSize = {length_s} is refused: a finite number, not negative, is wanted"
            )));
        }
        let follows = (time_s - self.time_s).abs() <= self.tolerance_s();
        if !follows {
            return Err(Problem::Call(format!(
                "currentCommunicationPoint = {time_s} is refused: {}, the end of the last step, is wanted",
                self.time_s
            )));
        }
        if let Some(stop_s) = self.stop_s.filter(|stop_s| step.end_s() > stop_s + self.tolerance_s()) {
            return Err(Problem::Call(format!(
                "a step from {time_s} over {length_s} is refused: it ends beyond stopTime = {stop_s}"
            )));
        }
        self.last_step = fmi2Status::fmi2Error;
        self.slave.step(step, &mut self.logger).map_err(|fault| Problem::Run(fault.to_string()))?;
        self.last_step = fmi2Status::fmi2OK;
        self.time_s = step.end_s();
        Ok(())
    }

    pub(super) fn reset(&mut self) {
        self.slave.reset();
        self.state = State::Instantiated;
        (self.time_s, self.stop_s, self.last_step) = (0.0, None, fmi2Status::fmi2OK);
    }
}
