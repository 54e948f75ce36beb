//! The part of an instance that depends on the type of its model: values and run. The remainder is in [`Instance`](super::Instance),
//! which is compiled once for all models.

use std::any::Any;
use std::sync::Arc;

use crate::input::{InputPolynomials, InputTrajectory};
use crate::log::Log;
use crate::model::{Invalid, Model, Step, StepError};
use crate::resources::Resources;
use crate::state::HiddenState;
use crate::variable::{Table, Value};

/// Arguments of a start besides the values.
pub(super) struct Begin<'b> {
    pub resources: &'b Resources,
    pub time_s: f64,
    /// Values outside their limits; if there are any, the run does not begin.
    pub outside: Vec<Invalid>,
}

/// Values of variables by index.
pub(super) type ByIndex = Box<dyn Fn(usize) -> Value>;

/// Values and run of a model of any type.
pub(super) trait Core: Any + Send + Sync {
    /// Start values of the same model, before a run.
    fn fresh(&self) -> Box<dyn Core>;
    /// A copy, unless the state cannot be copied.
    fn copy(&self) -> Option<Box<dyn Core>>;
    fn get(&self, index: usize) -> Value;
    /// As `get`, but before the run with outputs of the last trial start.
    fn computed(&self, index: usize) -> Value;
    /// Reads variables of type Real until one is not, or not finite; returns the number of values read.
    fn get_reals(&self, indices: &[u32], values: &mut [f64]) -> usize;
    /// Writes a value that has the type of the variable.
    fn set(&mut self, index: usize, value: Value);
    /// Writes variables of type Real.
    fn set_reals(&mut self, indices: &[u32], values: &[f64]);
    /// Constructs the model from the parameters and begins a run.
    fn start(&mut self, begin: Begin<'_>) -> Result<(), Vec<Invalid>>;
    /// Starts on a copy of the values, for outputs before the run. If parameters are invalid, the last valid outputs remain.
    fn try_start(&mut self, begin: Begin<'_>);
    /// Updates the outputs of a run.
    fn refresh(&mut self, time_s: f64);
    /// Applies tunable parameters; the run keeps the former model if they are refused, and the former state if it can be copied.
    fn retune(&mut self, begin: Begin<'_>) -> Result<(), Vec<Invalid>>;
    fn step(&mut self, step: Step, polynomials: &InputPolynomials, log: &mut dyn Log) -> Result<(), StepError>;
    /// 0 before the run.
    fn base_step_s(&self) -> f64;
    /// `None` before the run.
    fn output_derivatives(&self, polynomials: &InputPolynomials, time_s: f64, order: usize) -> Option<ByIndex>;
    /// Derivatives in a direction, before the run those at a start.
    fn differentiate(&self, direction: &[(usize, f64)], begin: Begin<'_>) -> Result<ByIndex, Vec<Invalid>>;
    fn write_values(&self, bytes: &mut Vec<u8>) -> Option<()>;
    fn write_state(&self, bytes: &mut Vec<u8>) -> Option<()>;
    /// Reads values and returns the bytes after them.
    fn read_values<'b>(&mut self, bytes: &'b [u8]) -> Result<&'b [u8], String>;
    /// Reads the state of a run with these values, to continue at a time if there is one, and returns the bytes after it.
    fn read_state<'b>(
        &mut self,
        bytes: &'b [u8],
        resources: &Resources,
        time_s: Option<f64>,
    ) -> Result<&'b [u8], String>;
}

/// Values and run of one model, on the heap because they can be large and threads of importers have small stacks.
pub(super) struct Typed<M: Model> {
    table: Arc<Table<M::Values>>,
    values: Box<M::Values>,
    /// Before the run: the values with outputs as a start would compute them.
    trial: Option<Box<M::Values>>,
    run: Option<Run<M>>,
}

/// A run in progress; its copies share the model.
struct Run<M: Model> {
    model: Arc<M>,
    state: Box<M::State>,
}

/// The model's own, more specific findings, and others on variables without one.
fn joined(own: Option<Vec<Invalid>>, others: Vec<Invalid>) -> Vec<Invalid> {
    let mut findings = own.unwrap_or_default();
    let new = others.into_iter().filter(|other| findings.iter().all(|own| own.name != other.name)).collect::<Vec<_>>();
    findings.extend(new);
    findings
}

impl<M: Model> Typed<M> {
    pub(super) fn new(table: Arc<Table<M::Values>>) -> Self {
        let values = Box::new(table.values(&[]));
        Self { table, values, trial: None, run: None }
    }

    fn begin(values: &mut M::Values, begin: Begin<'_>) -> Result<Run<M>, Vec<Invalid>> {
        match M::new(values, begin.resources) {
            Ok(model) if begin.outside.is_empty() => {
                let state = Box::new(model.start(values, begin.time_s));
                Ok(Run { model: Arc::new(model), state })
            }
            made => Err(joined(made.err(), begin.outside)),
        }
    }

    fn by_index(&self, values: M::Values) -> ByIndex {
        let table = self.table.clone();
        Box::new(move |index| table.get(index, &values))
    }
}

impl<M: Model> Core for Typed<M> {
    fn fresh(&self) -> Box<dyn Core> {
        Box::new(Self::new(self.table.clone()))
    }

    fn copy(&self) -> Option<Box<dyn Core>> {
        let run = match &self.run {
            Some(Run { model, state }) => Some(Run { model: model.clone(), state: Box::new(state.copy()?) }),
            None => None,
        };
        let (table, values, trial) = (self.table.clone(), self.values.clone(), self.trial.clone());
        Some(Box::new(Self { table, values, trial, run }))
    }

    fn get(&self, index: usize) -> Value {
        self.table.get(index, &self.values)
    }

    fn computed(&self, index: usize) -> Value {
        self.table.get(index, self.trial.as_ref().unwrap_or(&self.values))
    }

    fn set(&mut self, index: usize, value: Value) {
        let fits = self.table.set(index, &mut self.values, value);
        debug_assert!(fits, "the type of {} was checked", self.table.variables[index].name);
    }

    fn get_reals(&self, indices: &[u32], values: &mut [f64]) -> usize {
        for (at, (index, value)) in indices.iter().zip(&mut *values).enumerate() {
            match self.table.real(*index as usize, &self.values) {
                Some(number) if number.is_finite() => *value = *number,
                _ => return at,
            }
        }
        indices.len()
    }

    fn set_reals(&mut self, indices: &[u32], values: &[f64]) {
        for (index, value) in indices.iter().zip(values) {
            if let Some(number) = self.table.real_mut(*index as usize, &mut self.values) {
                *number = *value;
            }
        }
    }

    fn start(&mut self, begin: Begin<'_>) -> Result<(), Vec<Invalid>> {
        let mut values = self.values.clone();
        self.run = Some(Self::begin(&mut values, begin)?);
        (self.values, self.trial) = (values, None);
        Ok(())
    }

    fn try_start(&mut self, begin: Begin<'_>) {
        let mut trial = self.values.clone();
        if Self::begin(&mut trial, begin).is_ok() || self.trial.is_none() {
            self.trial = Some(trial);
        }
    }

    fn refresh(&mut self, time_s: f64) {
        if let Some(run) = &self.run {
            run.model.refresh(&run.state, &mut self.values, time_s);
        }
    }

    fn retune(&mut self, begin: Begin<'_>) -> Result<(), Vec<Invalid>> {
        match &mut self.run {
            Some(run) if begin.outside.is_empty() => {
                let former = (run.model.clone(), run.state.copy());
                let outcome = Arc::make_mut(&mut run.model).retune(&mut run.state, &self.values, begin.resources);
                if outcome.is_err() {
                    run.model = former.0;
                    if let Some(state) = former.1 {
                        *run.state = state;
                    }
                }
                outcome
            }
            _ => Err(joined(M::new(&self.values, begin.resources).err(), begin.outside)),
        }
    }

    fn step(&mut self, step: Step, polynomials: &InputPolynomials, log: &mut dyn Log) -> Result<(), StepError> {
        let run = self.run.as_mut().ok_or_else(|| StepError::of("the run has not begun"))?;
        let inputs = InputTrajectory { table: &self.table, polynomials };
        run.model.step(&mut run.state, &mut self.values, step, &inputs, log)
    }

    fn base_step_s(&self) -> f64 {
        self.run.as_ref().map_or(0.0, |run| run.model.base_step_s())
    }

    fn output_derivatives(&self, polynomials: &InputPolynomials, time_s: f64, order: usize) -> Option<ByIndex> {
        let run = self.run.as_ref()?;
        let inputs = InputTrajectory { table: &self.table, polynomials };
        let derivatives = std::array::from_fn(|lower| {
            let mut derivatives = self.table.zeros();
            inputs.apply_derivatives(&mut derivatives, lower + 1);
            derivatives
        });
        let found = run.model.output_derivatives(&run.state, &self.values, &derivatives, time_s, order);
        Some(self.by_index(found))
    }

    fn differentiate(&self, direction: &[(usize, f64)], begin: Begin<'_>) -> Result<ByIndex, Vec<Invalid>> {
        let mut towards = self.table.zeros();
        for (index, value) in direction {
            let _ = self.table.set(*index, &mut towards, Value::Real(*value));
        }
        let time_s = begin.time_s;
        let found = if let Some(run) = &self.run {
            run.model.differentiate(&run.state, &self.values, &towards, time_s, true)
        } else {
            let mut values = self.values.clone();
            let trial = Self::begin(&mut values, begin)?;
            trial.model.differentiate(&trial.state, &values, &towards, time_s, false)
        };
        Ok(self.by_index(found))
    }

    fn write_values(&self, bytes: &mut Vec<u8>) -> Option<()> {
        self.values.write(bytes)
    }

    fn write_state(&self, bytes: &mut Vec<u8>) -> Option<()> {
        self.run.as_ref().map_or(Some(()), |run| run.state.write(bytes))
    }

    fn read_values<'b>(&mut self, bytes: &'b [u8]) -> Result<&'b [u8], String> {
        let rest;
        (self.values, rest) = HiddenState::read(bytes)?;
        Ok(rest)
    }

    fn read_state<'b>(
        &mut self,
        bytes: &'b [u8],
        resources: &Resources,
        time_s: Option<f64>,
    ) -> Result<&'b [u8], String> {
        let (state, rest) = M::State::read(bytes)?;
        let state = Box::new(state);
        let model = Arc::new(M::new(&self.values, resources).map_err(|findings| Invalid::list(&findings))?);
        model.accepts(&state, &self.values, time_s)?;
        self.run = Some(Run { model, state });
        Ok(rest)
    }
}
