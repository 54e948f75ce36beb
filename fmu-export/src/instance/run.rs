//! An instance of any model: values, run, snapshots, derivatives.

use std::any::Any;
use std::sync::Arc;

use serde::de::DeserializeOwned;

use super::{AccessError, Derivatives, Instance, MAX_BASE_STEPS};
use crate::input::{HIGHEST_ORDER, InputDerivatives, InputTrajectory};
use crate::log::Log;
use crate::model::{Invalid, Model, Step, StepError};
use crate::resources::Resources;
use crate::state::{HiddenState, write_to};
use crate::variable::{Causality, Table, Type, Value, Variability, Variable};

/// An instance of one model: its values, and its run once it has begun. Values and state can be large, and the threads of
/// importers have small stacks, so they are on the heap.
pub(super) struct ModelInstance<M: Model> {
    table: Arc<Table<M::Values>>,
    resources: Resources,
    values: Box<M::Values>,
    /// Before the run: the values with outputs as a start would compute them.
    trial: Option<Box<M::Values>>,
    run: Option<Run<M>>,
    /// Start of the run before it has begun, then the end of the last step.
    time_s: f64,
    /// Whether outputs need an update because values were set.
    stale: bool,
    /// Derivatives of inputs at the begin of the next step.
    moving: Vec<InputDerivatives>,
    /// Derivatives of inputs at the end of the last step.
    moved: Vec<InputDerivatives>,
}

/// A run in progress; its copies share the model.
struct Run<M: Model> {
    model: Arc<M>,
    state: Box<M::State>,
}

/// The model's own findings, which are more specific, and those of others on which it has none.
fn joined(own: Option<Vec<Invalid>>, others: Vec<Invalid>) -> Vec<Invalid> {
    let mut findings = own.unwrap_or_default();
    let new = others.into_iter().filter(|other| findings.iter().all(|own| own.name != other.name)).collect::<Vec<_>>();
    findings.extend(new);
    findings
}

impl<M: Model> ModelInstance<M> {
    pub(super) fn new(table: Arc<Table<M::Values>>, resources: Resources) -> Self {
        let values = Box::new(table.values(&[]));
        let (moving, moved) = (Vec::new(), Vec::new());
        Self { table, resources, values, trial: None, run: None, time_s: 0.0, stale: true, moving, moved }
    }

    /// A copy, unless the state cannot be copied.
    fn copy(&self) -> Option<Self> {
        let run = match &self.run {
            Some(Run { model, state }) => Some(Run { model: model.clone(), state: Box::new(state.copy()?) }),
            None => None,
        };
        Some(Self {
            table: self.table.clone(),
            resources: self.resources.clone(),
            values: self.values.clone(),
            trial: self.trial.clone(),
            run,
            time_s: self.time_s,
            stale: self.stale,
            moving: self.moving.clone(),
            moved: self.moved.clone(),
        })
    }

    fn variable(&self, index: usize) -> Result<&Variable, AccessError> {
        self.table.variables.get(index).ok_or(AccessError::Unknown(index))
    }

    /// Constructs the model from the parameters and begins a run with these values.
    fn begin(&self, values: &mut M::Values) -> Result<Run<M>, Vec<Invalid>> {
        let outside = self.outside_limits();
        match M::new(values, &self.resources) {
            Ok(model) if outside.is_empty() => {
                let state = Box::new(model.start(values, self.time_s));
                Ok(Run { model: Arc::new(model), state })
            }
            made => Err(joined(made.err(), outside)),
        }
    }

    /// Applies tunable parameters.
    fn retune(&mut self) -> Result<(), Vec<Invalid>> {
        let outside = self.outside_limits();
        match &mut self.run {
            Some(run) if outside.is_empty() => {
                Arc::make_mut(&mut run.model).retune(&mut run.state, &self.values, &self.resources)
            }
            _ => Err(joined(M::new(&self.values, &self.resources).err(), outside)),
        }
    }

    /// Parameters, and start values that can be set, that are not finite or outside their limits.
    fn outside_limits(&self) -> Vec<Invalid> {
        let settable = self.table.variables.iter().enumerate();
        let settable = settable.filter(|(_, variable)| variable.causality != Causality::Input && variable.has_start());
        let found = settable.filter_map(|(index, variable)| match self.table.get(index, &self.values) {
            // Once the run has begun, a computed variable has left its start value.
            _ if variable.exact && self.run.is_some() => None,
            Value::Real(value) if !value.is_finite() => {
                Some(Invalid::new(variable.name.clone(), value, "a finite number"))
            }
            value => variable.admits(&value).err(),
        });
        found.collect()
    }

    /// Outputs are updated when read, and only if a value was set since. Before the run they come from a trial start on a copy of
    /// the values; invalid parameters are reported by the start itself, and until then the last valid outputs remain.
    fn update_outputs(&mut self) {
        if !std::mem::take(&mut self.stale) {
            return;
        }
        match &self.run {
            Some(run) => run.model.refresh(&run.state, &mut self.values, self.time_s),
            None => {
                let mut trial = self.values.clone();
                if self.begin(&mut trial).is_ok() || self.trial.is_none() {
                    self.trial = Some(trial);
                }
            }
        }
    }

    /// Whether it is an input that admits this value; nothing else has to be checked then.
    #[inline]
    fn takes_at_any_time(&self, index: usize, value: &Value) -> bool {
        self.table.variables.get(index).is_some_and(|variable| {
            variable.causality == Causality::Input && self.table.takes(index, value) && variable.holds(value)
        })
    }

    /// Whether a variable may be set to a value of that type now.
    fn check(&self, index: usize, value: &Value) -> Result<(), AccessError> {
        let variable = self.variable(index)?;
        let refuse = |reason| Err(AccessError::NotSettable { name: variable.name.to_string(), reason });
        match (variable.causality, variable.variability, &self.run) {
            (Causality::Input, ..) | (Causality::Parameter, _, None) => {}
            (Causality::Parameter, Variability::Tunable, Some(_)) => {}
            (Causality::Parameter, _, Some(_)) => return refuse("it is fixed once the run has begun"),
            (Causality::Output | Causality::Local, _, None) if variable.exact => {}
            (Causality::Output | Causality::Local, _, Some(_)) if variable.exact => {
                return refuse("it is computed once the run has begun");
            }
            (_, Variability::Constant, _) => return refuse("it is constant"),
            (Causality::Independent, ..) => return refuse("it is the time"),
            (Causality::CalculatedParameter | Causality::Output | Causality::Local, ..) => {
                return refuse("it is computed");
            }
        }
        if !self.table.takes(index, value) {
            return Err(AccessError::WrongType { name: variable.name.to_string(), asked: value.type_name() });
        }
        // Limits of parameters are checked when they are used, all at once.
        let checked = variable.causality == Causality::Input || self.table.holds_items_only(index);
        if checked && !variable.holds(value) {
            return Err(AccessError::Refused(variable.admits(value).err().into_iter().collect()));
        }
        Ok(())
    }

    /// Whether an input may have a derivative of that order.
    fn check_derivative(&self, index: usize, order: i32) -> Result<(), AccessError> {
        let variable = self.variable(index)?;
        if !M::CAPABILITIES.interpolates_inputs {
            let reason = "the model holds its inputs over a step, as the model description says";
            return Err(AccessError::NoDerivative { name: variable.name.to_string(), reason });
        }
        if variable.causality != Causality::Input || !variable.is_continuous() {
            let reason = "expected a continuous input of type Real";
            return Err(AccessError::NoDerivative { name: variable.name.to_string(), reason });
        }
        if !usize::try_from(order).is_ok_and(|order| (1..=HIGHEST_ORDER).contains(&order)) {
            return Err(AccessError::Order { name: variable.name.to_string(), order, highest: HIGHEST_ORDER });
        }
        Ok(())
    }

    /// Whether derivatives read from outside could have been set.
    fn are_sound(&self, inputs: &[InputDerivatives]) -> bool {
        let known = inputs.iter().all(|input| self.check_derivative(input.index, 1).is_ok());
        // In the order in which they were set, each input once.
        let once = (1..inputs.len()).all(|at| inputs[..at].iter().all(|input| input.index != inputs[at].index));
        known && once && inputs.iter().all(|input| input.derivatives.iter().all(|value| value.is_finite()))
    }
}

impl<M: Model> Instance for ModelInstance<M> {
    fn get(&mut self, index: usize) -> Result<Value, AccessError> {
        let variable = self.variable(index)?;
        if variable.is_settable() || (variable.exact && self.run.is_none()) {
            return Ok(self.table.get(index, &self.values));
        }
        if variable.causality == Causality::Independent {
            return Ok(Value::Real(self.time_s));
        }
        self.update_outputs();
        let values = self.trial.as_ref().filter(|_| self.run.is_none()).unwrap_or(&self.values);
        Ok(self.table.get(index, values))
    }

    fn set(&mut self, index: usize, value: Value) -> Result<(), AccessError> {
        // A loop sets its inputs one by one at every step.
        if self.moved.is_empty() && self.takes_at_any_time(index, &value) {
            self.stale = true;
            let _ = self.table.set(index, &mut self.values, value);
            return Ok(());
        }
        self.set_all(1, &|_| (index, value.clone()))
    }

    fn set_all(&mut self, count: usize, settings: &dyn Fn(usize) -> (usize, Value)) -> Result<(), AccessError> {
        let mut tunes = false;
        for at in 0..count {
            let (index, value) = settings(at);
            self.check(index, &value)?;
            tunes |= self.run.is_some() && self.table.variables[index].causality == Causality::Parameter;
        }
        // From here on only retuning can fail.
        let former = tunes.then(|| (self.values.clone(), self.run.as_ref().map(|run| run.model.clone())));
        for at in 0..count {
            let (index, value) = settings(at);
            let fits = self.table.set(index, &mut self.values, value);
            debug_assert!(fits, "the type of {} was checked", self.table.variables[index].name);
        }
        if let Some((former, model)) = former
            && let Err(findings) = self.retune()
        {
            self.values = former;
            if let (Some(run), Some(model)) = (&mut self.run, model) {
                run.model = model;
            }
            return Err(AccessError::Refused(findings));
        }
        if !self.moved.is_empty() {
            // An input that is set no longer continues as at the end of the step.
            self.moved.retain(|input| (0..count).all(|at| settings(at).0 != input.index));
        }
        self.stale |= count > 0;
        Ok(())
    }

    fn get_reals(&mut self, indices: &[u32], values: &mut [f64]) -> usize {
        // Before the run, outputs come from a trial start.
        if self.run.is_none() {
            return 0;
        }
        for (at, (index, value)) in indices.iter().zip(&mut *values).enumerate() {
            let index = *index as usize;
            match self.table.variables.get(index) {
                Some(variable) if variable.is_settable() => {}
                Some(variable) if variable.causality != Causality::Independent => self.update_outputs(),
                _ => return at,
            }
            match self.table.get(index, &self.values) {
                Value::Real(number) if number.is_finite() => *value = number,
                _ => return at,
            }
        }
        indices.len().min(values.len())
    }

    fn set_reals(&mut self, indices: &[u32], values: &[f64]) -> bool {
        let settings = || indices.iter().zip(values).map(|(index, value)| (*index as usize, Value::Real(*value)));
        if !self.moved.is_empty() || !settings().all(|(index, value)| self.takes_at_any_time(index, &value)) {
            return false;
        }
        for (index, value) in settings() {
            let _ = self.table.set(index, &mut self.values, value);
        }
        self.stale |= !indices.is_empty();
        true
    }

    fn set_start(&mut self, start_s: f64) {
        self.time_s = start_s;
        self.stale = true;
    }

    fn start(&mut self) -> Result<(), Vec<Invalid>> {
        let mut values = self.values.clone();
        self.run = Some(self.begin(&mut values)?);
        self.values = values;
        (self.trial, self.stale) = (None, false);
        Ok(())
    }

    fn step(&mut self, step: Step, log: &mut dyn Log) -> Result<(), StepError> {
        let run = self.run.as_mut().ok_or_else(|| StepError::of("the run has not begun"))?;
        let inputs = InputTrajectory::new(step.time_s, &self.table, &self.values, &self.moving);
        let outcome = run.model.step(&mut run.state, &mut self.values, step, &inputs, log);
        let end_s = match &outcome {
            Ok(()) => step.end_s(),
            Err(StepError::Terminated { time_s, .. }) if (step.time_s..=step.end_s()).contains(time_s) => *time_s,
            Err(StepError::Terminated { time_s, .. }) => {
                let (begin_s, end_s) = (step.time_s, step.end_s());
                let why = format!("the model ends at {time_s} s, outside the step from {begin_s} s to {end_s} s");
                return Err(StepError::Failed(why));
            }
            Err(StepError::Failed(_)) => return outcome,
        };
        inputs.apply(&mut self.values, end_s);
        self.moved.clear();
        self.moved.extend(self.moving.drain(..).map(|input| input.after(end_s - step.time_s)));
        self.time_s = end_s;
        self.stale = false;
        outcome
    }

    fn longest_step_s(&self) -> f64 {
        self.run.as_ref().map_or(0.0, |run| MAX_BASE_STEPS * run.model.base_step_s())
    }

    fn reset(&mut self) {
        *self = Self::new(self.table.clone(), self.resources.clone());
    }

    fn set_input_derivatives(
        &mut self,
        count: usize,
        settings: &dyn Fn(usize) -> (usize, i32, f64),
    ) -> Result<(), AccessError> {
        for at in 0..count {
            let (index, order, _) = settings(at);
            self.check_derivative(index, order)?;
        }
        for at in 0..count {
            let (index, order, value) = settings(at);
            let known = self.moving.iter().position(|input| input.index == index);
            let place = known.unwrap_or_else(|| {
                self.moving.push(InputDerivatives::of(index));
                self.moving.len() - 1
            });
            self.moving[place].derivatives[order as usize - 1] = value;
        }
        Ok(())
    }

    fn output_derivative(&mut self, index: usize, order: i32) -> Result<f64, AccessError> {
        let variable = self.variable(index)?;
        let name = || variable.name.to_string();
        let highest = M::CAPABILITIES.output_derivative_order;
        let refuse = |reason| Err(AccessError::NoDerivative { name: name(), reason });
        if variable.causality != Causality::Output || !matches!(variable.data_type, Type::Real { .. }) {
            return refuse("expected an output of type Real");
        }
        let Some(run) = &self.run else { return refuse("the run has not begun") };
        if highest == 0 {
            return refuse("derivatives of outputs are not offered, as the model description says");
        }
        let Some(order) = usize::try_from(order).ok().filter(|order| (1..=highest).contains(order)) else {
            return Err(AccessError::Order { name: name(), order, highest });
        };
        if !variable.is_continuous() {
            // It is piecewise constant.
            return Ok(0.0);
        }
        let inputs = InputTrajectory::new(self.time_s, &self.table, &self.values, &self.moved);
        let derivatives = std::array::from_fn(|lower| {
            let mut derivatives = self.table.zeros();
            inputs.apply_derivatives(&mut derivatives, lower + 1);
            derivatives
        });
        let found = run.model.output_derivatives(&run.state, &self.values, &derivatives, self.time_s, order);
        match self.table.get(index, &found) {
            Value::Real(value) => Ok(value),
            _ => refuse("expected an output of type Real"),
        }
    }

    fn differentiate(
        &mut self,
        count: usize,
        knowns: &dyn Fn(usize) -> (usize, f64),
    ) -> Result<Box<dyn Derivatives>, AccessError> {
        if !M::CAPABILITIES.directional_derivatives {
            let reason = "not offered, as the model description says";
            return Err(AccessError::NoDerivative { name: "directional derivatives".into(), reason });
        }
        let started = self.run.is_some();
        let mut direction = self.table.zeros();
        for at in 0..count {
            let (index, value) = knowns(at);
            let variable = self.variable(index)?;
            let parameter = variable.causality == Causality::Parameter && !started;
            let known = variable.state || parameter || (variable.causality == Causality::Input);
            let Value::Real(former) = self.table.get(index, &direction) else { return Err(no_known(variable)) };
            if !known {
                return Err(no_known(variable));
            }
            let _ = self.table.set(index, &mut direction, Value::Real(former + value));
        }
        let mut values;
        let trial;
        let (run, values) = match &self.run {
            Some(run) => (run, &self.values),
            None => {
                values = self.values.clone();
                trial = self.begin(&mut values).map_err(AccessError::Refused)?;
                (&trial, &values)
            }
        };
        let derivatives = run.model.differentiate(&run.state, values, &direction, self.time_s, started);
        Ok(Box::new(Direction { table: self.table.clone(), derivatives, started }))
    }

    fn duplicate(&self) -> Option<Box<dyn Instance>> {
        if M::State::SAVED { Some(Box::new(self.copy()?)) } else { None }
    }

    fn copy_from(&mut self, other: &dyn Instance) -> bool {
        let copy = other.as_any().downcast_ref::<Self>().and_then(Self::copy);
        let there = copy.is_some();
        if let Some(copy) = copy {
            let resources = std::mem::take(&mut self.resources);
            *self = Self { resources, ..copy };
        }
        there
    }

    fn write(&self) -> Option<Vec<u8>> {
        let mut bytes = Vec::new();
        write_to(&mut bytes, &*self.values);
        write_to(&mut bytes, &(self.stale, &self.moving, &self.moved, self.run.is_some()));
        if let Some(run) = &self.run {
            run.state.write(&mut bytes)?;
        }
        M::State::SAVED.then_some(bytes)
    }

    fn read(&mut self, bytes: &[u8], time_s: f64, stepping: bool) -> Result<(), String> {
        let (values, rest): (Box<M::Values>, _) = take(bytes)?;
        let ((stale, moving, moved, has_begun), rest): ((bool, Vec<_>, Vec<_>, bool), _) = take(rest)?;
        let (state, rest) = if has_begun {
            let (state, rest) = M::State::read(rest)?;
            (Some(Box::new(state)), rest)
        } else {
            (None, rest)
        };
        if !rest.is_empty() {
            return Err(format!("{} bytes are left over", rest.len()));
        }
        if !(self.are_sound(&moving) && self.are_sound(&moved)) {
            return Err("the derivatives of inputs are not valid".into());
        }
        // An input may be missing, like a sensor; the step decides what that means.
        for (index, variable) in self.table.variables.iter().enumerate().filter(|(_, variable)| variable.is_settable())
        {
            let value = self.table.get(index, &values);
            variable.admits(&value).map_err(|finding| finding.to_string())?;
            if variable.causality == Causality::Parameter
                && let Value::Real(value) = value
                && !value.is_finite()
            {
                return Err(format!("{} = {value} is not finite", variable.name));
            }
        }
        let run = match state {
            Some(state) => {
                let model = Arc::new(M::new(&values, &self.resources).map_err(|findings| Invalid::list(&findings))?);
                model.accepts(&state, &values, stepping.then_some(time_s))?;
                Some(Run { model, state })
            }
            None => None,
        };
        let (table, resources) = (self.table.clone(), self.resources.clone());
        // Before the run outputs are computed anew.
        let stale = stale || run.is_none();
        *self = Self { table, resources, values, trial: None, run, time_s, stale, moving, moved };
        Ok(())
    }

    fn has_begun(&self) -> bool {
        self.run.is_some()
    }

    fn as_any(&self) -> &dyn Any {
        self
    }
}

/// Reads a value and the bytes after it.
fn take<T: DeserializeOwned>(bytes: &[u8]) -> Result<(T, &[u8]), String> {
    postcard::take_from_bytes(bytes).map_err(|error| error.to_string())
}

fn no_known(variable: &Variable) -> AccessError {
    let reason = "expected a state or an input of type Real, in initialization also a parameter";
    AccessError::NoDerivative { name: variable.name.to_string(), reason }
}

/// The derivatives of all variables in one direction, in the places of the variables.
struct Direction<D> {
    table: Arc<Table<D>>,
    derivatives: D,
    started: bool,
}

impl<D> Derivatives for Direction<D> {
    fn of(&self, index: usize) -> Result<f64, AccessError> {
        let variable = self.table.variables.get(index).ok_or(AccessError::Unknown(index))?;
        let refuse = |reason| Err(AccessError::NoDerivative { name: variable.name.to_string(), reason });
        let unknown = variable.causality == Causality::Output
            || variable.derivative_of.is_some()
            || (variable.state && !self.started);
        if !unknown {
            return refuse("expected an output or the derivative of a state, in initialization also a state");
        }
        match self.table.get(index, &self.derivatives) {
            // Sampled variables are constant between samples.
            Value::Real(_) if self.started && !variable.is_continuous() => Ok(0.0),
            Value::Real(derivative) => Ok(derivative),
            _ => refuse("expected a variable of type Real"),
        }
    }
}
