//! A model as its importer sees it: values behind a table, a run, and rules for when values may change.
//!
//! [`ModelType`] makes instances of a model; code that depends on the model's type is in `run.rs`.

mod model_type;
mod run;

use std::any::Any;
use std::sync::Arc;

use crate::input::{HIGHEST_ORDER, InputDerivatives, InputPolynomials};
use crate::log::Log;
use crate::model::{Capabilities, Invalid, Step, StepError};
use crate::resources::Resources;
use crate::state::{HiddenState, write_to};
use crate::variable::{Causality, Type, Value, Variability, Variable};
use run::{Begin, ByIndex, Core};

pub use model_type::ModelType;
#[doc(hidden)]
pub use model_type::kind;

/// The longest communication step, in units of [`Model::base_step_s`](crate::Model::base_step_s).
pub const MAX_BASE_STEPS: f64 = 1e6;

/// Why a variable could not be read or written.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum AccessError {
    /// There is no variable with that index.
    #[error("there is no variable with value reference {0}")]
    Unknown(usize),
    /// The variable has another type.
    #[error("{name} is not of type {asked}")]
    WrongType {
        /// The variable.
        name: String,
        /// The requested type.
        asked: &'static str,
    },
    /// The variable cannot be set now or at all.
    #[error("{name} cannot be set: {reason}")]
    NotSettable {
        /// The variable.
        name: String,
        /// Reason.
        reason: &'static str,
    },
    /// The value was refused.
    #[error("{}", Invalid::list(.0))]
    Refused(Vec<Invalid>),
    /// A derivative is not available, or cannot be set.
    #[error("{name}: {reason}")]
    NoDerivative {
        /// The variable.
        name: String,
        /// Reason.
        reason: &'static str,
    },
    /// The order of a derivative is out of range.
    #[error("{name}: a derivative of order {order} is refused: expected an order from 1 to {highest}")]
    Order {
        /// The variable.
        name: String,
        /// The requested order.
        order: i32,
        /// The highest order available.
        highest: usize,
    },
}

/// One instance of any model.
pub struct Instance {
    variables: Arc<[Variable]>,
    capabilities: Capabilities,
    core: Box<dyn Core>,
    resources: Resources,
    has_begun: bool,
    /// Start of the run before it has begun, then the end of the last step.
    time_s: f64,
    start_s: f64,
    /// Whether the model has ended the simulation.
    has_ended: bool,
    /// Whether outputs need an update because values were set.
    stale: bool,
    /// Derivatives of inputs at the start of the next step.
    next_derivatives: Vec<InputDerivatives>,
    /// Derivatives of inputs at the end of the last step.
    last_derivatives: Vec<InputDerivatives>,
}

impl Instance {
    fn new(variables: Arc<[Variable]>, capabilities: Capabilities, core: Box<dyn Core>, resources: Resources) -> Self {
        Self {
            variables,
            capabilities,
            core,
            resources,
            has_begun: false,
            time_s: 0.0,
            start_s: 0.0,
            has_ended: false,
            stale: true,
            next_derivatives: Vec::new(),
            last_derivatives: Vec::new(),
        }
    }

    /// The value of the variable with that index, counted from 0 in the order of the table.
    ///
    /// # Errors
    /// [`AccessError::Unknown`].
    pub fn get(&mut self, index: usize) -> Result<Value, AccessError> {
        let variable = self.variable(index)?;
        if variable.is_settable() || (variable.exact && !self.has_begun) {
            return Ok(self.core.get(index));
        }
        if variable.causality == Causality::Independent {
            return Ok(Value::Real(self.time_s));
        }
        self.update_outputs();
        Ok(self.core.computed(index))
    }

    /// Sets the variable with that index.
    ///
    /// # Errors
    /// If the value is refused, see [`AccessError`]; the former value stays.
    pub fn set(&mut self, index: usize, value: Value) -> Result<(), AccessError> {
        // Fast path: a loop sets its inputs one by one at every step.
        if self.last_derivatives.is_empty() && self.is_valid_input(index, &value) {
            self.stale = true;
            self.core.set(index, value);
            return Ok(());
        }
        self.set_all(1, &|_| (index, value.clone()))
    }

    /// Sets several variables, or none if one value is refused: `settings(n)` returns index and value of setting n.
    ///
    /// # Errors
    /// If one of them is refused, see [`AccessError`]; all former values stay.
    pub fn set_all(&mut self, count: usize, settings: &dyn Fn(usize) -> (usize, Value)) -> Result<(), AccessError> {
        let mut tunes = false;
        for at in 0..count {
            let (index, value) = settings(at);
            self.check(index, &value)?;
            tunes |= self.has_begun && self.variables[index].causality == Causality::Parameter;
        }
        // From here on only retuning can fail.
        let mut former = Vec::new();
        for at in 0..count {
            let (index, value) = settings(at);
            if tunes {
                former.push((index, self.core.get(index)));
            }
            self.core.set(index, value);
        }
        if tunes {
            let outside = self.outside_limits();
            if let Err(findings) = self.core.retune(Begin { resources: &self.resources, time_s: self.time_s, outside })
            {
                former.into_iter().rev().for_each(|(index, value)| self.core.set(index, value));
                return Err(AccessError::Refused(findings));
            }
        }
        if !self.last_derivatives.is_empty() {
            // Setting an input ends its continuation from the last step.
            self.last_derivatives.retain(|input| (0..count).all(|at| settings(at).0 != input.index));
        }
        self.stale |= count > 0;
        Ok(())
    }

    /// Reads variables of type Real in a run up to the first that is unknown, of another type, the time, or not finite. Returns the
    /// number of values read; [`get`](Self::get) reads the next one or states the reason.
    pub fn get_reals(&mut self, indices: &[u32], values: &mut [f64]) -> usize {
        // Before the run, outputs come from a trial start.
        if !self.has_begun {
            return 0;
        }
        let mut known = 0;
        for index in indices {
            match self.variables.get(*index as usize) {
                Some(variable) if variable.is_settable() => {}
                Some(variable) if variable.causality != Causality::Independent => self.update_outputs(),
                _ => break,
            }
            known += 1;
        }
        self.core.get_reals(&indices[..known], values)
    }

    /// Sets variables like [`set_all`](Self::set_all) if all of them are inputs of type Real within their limits; otherwise
    /// returns `false` and changes nothing.
    pub fn set_reals(&mut self, indices: &[u32], values: &[f64]) -> bool {
        let mut settings = indices.iter().zip(values);
        let takes = |(index, value): (&u32, &f64)| self.is_valid_input(*index as usize, &Value::Real(*value));
        if !self.last_derivatives.is_empty() || !settings.all(takes) {
            return false;
        }
        self.core.set_reals(indices, values);
        self.stale |= !indices.is_empty();
        true
    }

    /// Sets the time at which the run will begin, in seconds; 0 by default.
    pub fn set_start(&mut self, start_s: f64) {
        (self.time_s, self.start_s) = (start_s, start_s);
        self.stale = true;
    }

    /// Begins the run.
    ///
    /// # Errors
    /// Every invalid parameter.
    pub fn start(&mut self) -> Result<(), Vec<Invalid>> {
        let outside = self.outside_limits();
        self.core.start(Begin { resources: &self.resources, time_s: self.time_s, outside })?;
        (self.has_begun, self.stale) = (true, false);
        Ok(())
    }

    /// Whether a step may be made: it begins where the last one ended, and its length is a number that is neither negative nor too large.
    ///
    /// # Errors
    /// Why not.
    pub fn check_step(&self, step: Step) -> Result<(), String> {
        let Step { time_s, length_s } = step;
        if !length_s.is_finite() || length_s < 0.0 {
            return Err(format!("communicationStepSize = {length_s} is refused: expected a finite number, 0 or above"));
        }
        if self.has_ended {
            return Err(format!("refused: the model has ended the simulation at {} s", self.time_s));
        }
        // NaN is refused as well.
        let follows = (time_s - self.time_s).abs() <= self.tolerance_s() && step.end_s().is_finite();
        if !follows {
            return Err(format!(
                "currentCommunicationPoint = {time_s} is refused: expected {}, the end of the last step",
                self.time_s
            ));
        }
        let longest_s = MAX_BASE_STEPS * self.core.base_step_s();
        if self.has_begun && length_s > longest_s {
            return Err(format!(
                "communicationStepSize = {length_s} is refused: expected at most {longest_s}, since it would take too long"
            ));
        }
        Ok(())
    }

    /// Difference up to which two instants count as equal: importers add up steps in floating point, with errors that grow with
    /// the length of the run, and times far from 0 have a coarse resolution.
    pub(crate) fn tolerance_s(&self) -> f64 {
        1e-9 * (self.time_s - self.start_s).abs().max(1.0) + 4096.0 * f64::EPSILON * self.time_s.abs()
    }

    /// Does one communication step. Derivatives of inputs hold for this step only; after it the inputs keep their final values.
    ///
    /// # Errors
    /// Why the run cannot continue, or why [`check_step`](Self::check_step) refuses the step, which then changes nothing.
    pub fn step(&mut self, step: Step, log: &mut dyn Log) -> Result<(), StepError> {
        self.check_step(step).map_err(StepError::Failed)?;
        self.checked_step(step, log)
    }

    /// Does a step that [`check_step`](Self::check_step) has accepted.
    pub(crate) fn checked_step(&mut self, step: Step, log: &mut dyn Log) -> Result<(), StepError> {
        let inputs = InputPolynomials::new(step.time_s, &self.next_derivatives, |index| self.core.get(index));
        let outcome = self.core.step(step, &inputs, log);
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
        inputs.at(end_s, &mut |index, value| self.core.set(index, value));
        self.last_derivatives.clear();
        self.last_derivatives.extend(self.next_derivatives.drain(..).map(|input| input.after(end_s - step.time_s)));
        (self.time_s, self.has_ended) = (end_s, outcome.is_err());
        self.stale = false;
        outcome
    }

    /// Resets this instance to its initial state.
    pub fn reset(&mut self) {
        *self = self.fresh();
    }

    fn fresh(&self) -> Self {
        Self::new(self.variables.clone(), self.capabilities, self.core.fresh(), self.resources.clone())
    }

    /// Sets derivatives of inputs with respect to time at the start of the next step, or none if one is refused; `settings(n)`
    /// returns index, order and value of setting n.
    ///
    /// # Errors
    /// If one of them is refused.
    pub fn set_input_derivatives(
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
            let known = self.next_derivatives.iter().position(|input| input.index == index);
            let place = known.unwrap_or_else(|| {
                self.next_derivatives.push(InputDerivatives::of(index));
                self.next_derivatives.len() - 1
            });
            self.next_derivatives[place].derivatives[order as usize - 1] = value;
        }
        Ok(())
    }

    /// The derivative of an output with respect to time, at the end of the last step.
    ///
    /// # Errors
    /// If the variable has no derivative of this order.
    pub fn output_derivative(&mut self, index: usize, order: i32) -> Result<f64, AccessError> {
        let variable = self.variable(index)?;
        let highest = self.capabilities.output_derivative_order;
        if variable.causality != Causality::Output || !matches!(variable.data_type, Type::Real { .. }) {
            return Err(no_derivative(variable, "expected an output of type Real"));
        }
        if !self.has_begun {
            return Err(no_derivative(variable, "the run has not begun"));
        }
        if highest == 0 {
            let reason = "derivatives of outputs are not offered, as the model description says";
            return Err(no_derivative(variable, reason));
        }
        let Some(order) = usize::try_from(order).ok().filter(|order| (1..=highest).contains(order)) else {
            return Err(AccessError::Order { name: variable.name.to_string(), order, highest });
        };
        if !variable.is_continuous() {
            // Piecewise constant.
            return Ok(0.0);
        }
        let inputs = InputPolynomials::new(self.time_s, &self.last_derivatives, |index| self.core.get(index));
        let found = self.core.output_derivatives(&inputs, self.time_s, order);
        found.map(|of| of(index).as_f64()).ok_or_else(|| no_derivative(variable, "the run has not begun"))
    }

    /// Prepares a directional derivative: `knowns(n)` returns index and direction of the n-th known variable.
    ///
    /// # Errors
    /// If an unknown or a known is refused.
    pub fn differentiate(
        &mut self,
        count: usize,
        knowns: &dyn Fn(usize) -> (usize, f64),
    ) -> Result<Derivatives, AccessError> {
        if !self.capabilities.directional_derivatives {
            let reason = "not offered, as the model description says";
            return Err(AccessError::NoDerivative { name: "directional derivatives".into(), reason });
        }
        let started = self.has_begun;
        let mut direction: Vec<(usize, f64)> = Vec::new();
        for at in 0..count {
            let (index, value) = knowns(at);
            let variable = self.variable(index)?;
            let parameter = variable.causality == Causality::Parameter && !started;
            let known = variable.state || parameter || variable.causality == Causality::Input;
            if !known || !matches!(variable.data_type, Type::Real { .. }) {
                let reason = "expected a state or an input of type Real, in initialization also a parameter";
                return Err(no_derivative(variable, reason));
            }
            let former = direction.iter().rev().find(|(known, _)| *known == index).map_or(0.0, |(_, former)| *former);
            direction.push((index, former + value));
        }
        let outside = if started { Vec::new() } else { self.outside_limits() };
        let begin = Begin { resources: &self.resources, time_s: self.time_s, outside };
        let found = self.core.differentiate(&direction, begin);
        let derivatives = found.map_err(AccessError::Refused)?;
        Ok(Derivatives { variables: self.variables.clone(), derivatives, started })
    }

    /// A copy that serves as snapshot: cheap, and independent of this instance; `None` if the model has no snapshots.
    pub fn duplicate(&self) -> Option<Self> {
        if !self.capabilities.snapshots {
            return None;
        }
        Some(Self {
            core: self.core.copy()?,
            next_derivatives: self.next_derivatives.clone(),
            last_derivatives: self.last_derivatives.clone(),
            variables: self.variables.clone(),
            resources: self.resources.clone(),
            ..*self
        })
    }

    /// Makes this instance a copy of another of the same model; `false` if the model differs or has no snapshots.
    pub fn copy_from(&mut self, other: &Self) -> bool {
        let model = |instance: &Self| (&*instance.core as &dyn Any).type_id();
        let Some(copy) = other.duplicate().filter(|_| model(self) == model(other)) else { return false };
        *self = Self { resources: self.resources.clone(), ..copy };
        true
    }

    /// The instance in postcard's format; `None` if the model has no snapshots, or its state cannot be written. Equal bits give equal bytes.
    pub fn write(&self) -> Option<Vec<u8>> {
        let mut bytes = Vec::new();
        self.core.write_values(&mut bytes)?;
        let times = (self.time_s, self.start_s, self.has_ended);
        write_to(&mut bytes, &(times, self.stale, &self.next_derivatives, &self.last_derivatives, self.has_begun))?;
        self.core.write_state(&mut bytes)?;
        self.capabilities.snapshots.then_some(bytes)
    }

    /// Restores a serialized instance, to continue if `stepping`.
    ///
    /// # Errors
    /// Why the bytes are invalid; this instance is then unchanged. Whatever the bytes, nothing panics, and no more memory is
    /// allocated than the instance needs.
    pub fn read(&mut self, bytes: &[u8], stepping: bool) -> Result<(), String> {
        let mut read = self.fresh();
        let mut rest = read.core.read_values(bytes)?;
        let times;
        ((times, read.stale, read.next_derivatives, read.last_derivatives, read.has_begun), rest) =
            HiddenState::read(rest)?;
        (read.time_s, read.start_s, read.has_ended) = times;
        if !(read.time_s.is_finite() && read.start_s.is_finite()) {
            return Err("the times are not finite".into());
        }
        if !(self.are_valid(&read.next_derivatives) && self.are_valid(&read.last_derivatives)) {
            return Err("the derivatives of inputs are not valid".into());
        }
        // An input may be missing, like a sensor; the step handles that. One with derivatives may have left its limits. Before the run, limits are
        // checked as when a value is set.
        let is_checked = |(index, variable): &(usize, &Variable)| match read.has_begun {
            true => self.check_derivative(*index, 1).is_err(),
            false => variable.is_checked_when_set(),
        };
        let settable = self.variables.iter().enumerate().filter(|(_, variable)| variable.is_settable());
        for (index, variable) in settable.filter(is_checked) {
            let value = read.core.get(index);
            variable.admits(&value).map_err(|finding| finding.to_string())?;
            if variable.causality == Causality::Parameter
                && let Value::Real(value) = value
                && !value.is_finite()
            {
                return Err(format!("{} = {value} is not finite", variable.name));
            }
        }
        if read.has_begun {
            rest = read.core.read_state(rest, &self.resources, stepping.then_some(read.time_s))?;
        }
        if !rest.is_empty() {
            return Err(format!("{} bytes are left over", rest.len()));
        }
        // Before the run outputs are recomputed.
        read.stale |= !read.has_begun;
        *self = read;
        Ok(())
    }

    /// Whether the run has begun.
    pub fn has_begun(&self) -> bool {
        self.has_begun
    }

    /// The end of the last step, or the start of the run, in seconds.
    pub fn time_s(&self) -> f64 {
        self.time_s
    }

    /// Whether the model has ended the simulation.
    pub fn has_ended(&self) -> bool {
        self.has_ended
    }

    fn variable(&self, index: usize) -> Result<&Variable, AccessError> {
        self.variables.get(index).ok_or(AccessError::Unknown(index))
    }

    /// Parameters and settable start values that are not finite or outside their limits.
    fn outside_limits(&self) -> Vec<Invalid> {
        let settable = self.variables.iter().enumerate();
        let settable = settable.filter(|(_, variable)| variable.causality != Causality::Input && variable.has_start());
        // Once the run has begun, a computed variable has left its start value.
        let settable = settable.filter(|(_, variable)| !(variable.exact && self.has_begun));
        settable.filter_map(|(index, variable)| variable.accepts(&self.core.get(index)).err()).collect()
    }

    /// Updates the outputs if a value was set since the last update. Before the run they come from a trial start; the start itself
    /// reports invalid parameters.
    fn update_outputs(&mut self) {
        if !std::mem::take(&mut self.stale) {
            return;
        }
        if self.has_begun {
            self.core.refresh(self.time_s);
        } else {
            let outside = self.outside_limits();
            self.core.try_start(Begin { resources: &self.resources, time_s: self.time_s, outside });
        }
    }

    /// Whether it is an input that admits this value, so that no other check is needed.
    #[inline]
    fn is_valid_input(&self, index: usize, value: &Value) -> bool {
        self.variables.get(index).is_some_and(|variable| {
            variable.causality == Causality::Input && variable.takes(value) && variable.holds(value)
        })
    }

    /// Whether a variable may be set to a value of that type now.
    fn check(&self, index: usize, value: &Value) -> Result<(), AccessError> {
        let variable = self.variable(index)?;
        let refuse = |reason| Err(AccessError::NotSettable { name: variable.name.to_string(), reason });
        match (variable.causality, variable.variability, self.has_begun) {
            (Causality::Input, ..) | (Causality::Parameter, _, false) => {}
            (Causality::Parameter, Variability::Tunable, true) => {}
            (Causality::Parameter, _, true) => return refuse("it is fixed once the run has begun"),
            (Causality::Output | Causality::Local, _, false) if variable.exact => {}
            (Causality::Output | Causality::Local, _, true) if variable.exact => {
                return refuse("it is computed once the run has begun");
            }
            (_, Variability::Constant, _) => return refuse("it is constant"),
            (Causality::Independent, ..) => return refuse("it is the time"),
            (Causality::CalculatedParameter | Causality::Output | Causality::Local, ..) => {
                return refuse("it is computed");
            }
        }
        if !variable.takes(value) {
            return Err(AccessError::WrongType { name: variable.name.to_string(), asked: value.type_name() });
        }
        if variable.is_checked_when_set() {
            variable.admits(value).map_err(|finding| AccessError::Refused(vec![finding]))?;
        }
        Ok(())
    }

    /// Whether an input may have a derivative of that order.
    fn check_derivative(&self, index: usize, order: i32) -> Result<(), AccessError> {
        let variable = self.variable(index)?;
        if !self.capabilities.interpolates_inputs {
            let reason = "the model holds its inputs over a step, as the model description says";
            return Err(no_derivative(variable, reason));
        }
        if variable.causality != Causality::Input || !variable.is_continuous() {
            return Err(no_derivative(variable, "expected a continuous input of type Real"));
        }
        if !usize::try_from(order).is_ok_and(|order| (1..=HIGHEST_ORDER).contains(&order)) {
            return Err(AccessError::Order { name: variable.name.to_string(), order, highest: HIGHEST_ORDER });
        }
        Ok(())
    }

    /// Whether derivatives read from a snapshot could have been set.
    fn are_valid(&self, inputs: &[InputDerivatives]) -> bool {
        let known = inputs.iter().all(|input| self.check_derivative(input.index, 1).is_ok());
        // In the order in which they were set, each input once.
        let once = (1..inputs.len()).all(|at| inputs[..at].iter().all(|input| input.index != inputs[at].index));
        known && once && inputs.iter().all(|input| input.derivatives.iter().all(|value| value.is_finite()))
    }
}

fn no_derivative(variable: &Variable, reason: &'static str) -> AccessError {
    AccessError::NoDerivative { name: variable.name.to_string(), reason }
}

/// Directional derivatives in one direction.
pub struct Derivatives {
    variables: Arc<[Variable]>,
    derivatives: ByIndex,
    started: bool,
}

impl Derivatives {
    /// The derivative of the unknown variable with that index.
    ///
    /// # Errors
    /// [`AccessError::Unknown`], [`AccessError::NoDerivative`].
    pub fn of(&self, index: usize) -> Result<f64, AccessError> {
        let variable = self.variables.get(index).ok_or(AccessError::Unknown(index))?;
        let unknown = variable.causality == Causality::Output
            || variable.derivative_of.is_some()
            || (variable.state && !self.started);
        if !unknown {
            let wanted = "expected an output or the derivative of a state, in initialization also a state";
            return Err(no_derivative(variable, wanted));
        }
        match (self.derivatives)(index) {
            // Sampled variables are constant between samples.
            Value::Real(_) if self.started && !variable.is_continuous() => Ok(0.0),
            Value::Real(derivative) => Ok(derivative),
            _ => Err(no_derivative(variable, "expected a variable of type Real")),
        }
    }
}
