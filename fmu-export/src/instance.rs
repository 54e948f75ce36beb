//! A model as its importer sees it: values behind a table, a run, and rules for when values may change.

use std::any::Any;
use std::sync::{Arc, OnceLock};

use serde::{Deserialize, Serialize};

use crate::description::{self, Description, Standard};
use crate::input::{HIGHEST_ORDER, InputDerivatives, InputTrajectory};
use crate::log::Log;
use crate::model::{Capabilities, Info, Invalid, Model, Step, StepError};
use crate::variable::{Causality, Table, Type, Value, Variability, Variable};

/// The longest communication step, in units of [`Model::base_step_s`].
pub const MAX_BASE_STEPS: f64 = 1e6;

/// Why a variable could not be read or written.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
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
pub trait Instance: Send + Sync {
    /// The value of the variable with that index, counted from 0 in the order of the table.
    ///
    /// # Errors
    /// [`AccessError::Unknown`].
    fn get(&mut self, index: usize) -> Result<Value, AccessError>;

    /// Sets the variable with that index.
    ///
    /// # Errors
    /// What is wrong with the value, see [`AccessError`]; the former value stays.
    fn set(&mut self, index: usize, value: Value) -> Result<(), AccessError> {
        self.set_all(1, &|_| (index, value.clone()))
    }

    /// Sets several variables, or none if one value is refused: `settings(n)` returns index and value of setting n.
    ///
    /// # Errors
    /// What is wrong with one of them, see [`AccessError`]; all former values stay.
    fn set_all(&mut self, count: usize, settings: &dyn Fn(usize) -> (usize, Value)) -> Result<(), AccessError>;

    /// Sets the time at which the run will begin, in seconds; 0 by default.
    fn set_start(&mut self, start_s: f64);

    /// Begins the run.
    ///
    /// # Errors
    /// Every invalid parameter.
    fn start(&mut self) -> Result<(), Vec<Invalid>>;

    /// Does one communication step. Derivatives of inputs hold for this step only; after it the inputs keep their final values.
    ///
    /// # Errors
    /// Why the run cannot continue.
    fn step(&mut self, step: Step, log: &mut dyn Log) -> Result<(), StepError>;

    /// The longest communication step accepted, in seconds; see [`MAX_BASE_STEPS`].
    fn longest_step_s(&self) -> f64;

    /// Resets this instance to its initial state.
    fn reset(&mut self);

    /// Sets derivatives of inputs with respect to time at the begin of the next step, or none if one is refused; `settings(n)`
    /// returns index, order and value of setting n.
    ///
    /// # Errors
    /// What is wrong with one of them.
    fn set_input_derivatives(
        &mut self,
        count: usize,
        settings: &dyn Fn(usize) -> (usize, i32, f64),
    ) -> Result<(), AccessError>;

    /// The derivative of an output with respect to time, at the end of the last step.
    ///
    /// # Errors
    /// What is wrong with the request.
    fn output_derivative(&mut self, index: usize, order: i32) -> Result<f64, AccessError>;

    /// Prepares a directional derivative: `knowns(n)` returns index and direction of the n-th known variable.
    ///
    /// # Errors
    /// What is wrong with one of them.
    fn differentiate(
        &mut self,
        count: usize,
        knowns: &dyn Fn(usize) -> (usize, f64),
    ) -> Result<Box<dyn Derivatives>, AccessError>;

    /// A copy that serves as snapshot: cheap, and independent of this instance.
    fn duplicate(&self) -> Box<dyn Instance>;

    /// Makes this instance a copy of another of the same model; `false` if the model differs.
    fn copy_from(&mut self, other: &dyn Instance) -> bool;

    /// Serializes a copy in postcard's format. Equal bits give equal bytes.
    fn write(&self) -> Vec<u8>;

    /// Restores a serialized instance, to continue at `time_s` if `stepping`.
    ///
    /// # Errors
    /// Why the bytes are invalid; this instance is then unchanged. Whatever the bytes, nothing panics, and no more memory is
    /// allocated than the instance needs.
    fn read(&mut self, bytes: &[u8], time_s: f64, stepping: bool) -> Result<(), String>;

    /// Whether the run has begun.
    fn has_begun(&self) -> bool;

    /// For [`Instance::copy_from`].
    fn as_any(&self) -> &dyn Any;
}

/// Directional derivatives in one direction.
pub trait Derivatives {
    /// The derivative of the unknown variable with that index.
    ///
    /// # Errors
    /// [`AccessError::Unknown`], [`AccessError::NoDerivative`].
    fn of(&self, index: usize) -> Result<f64, AccessError>;
}

/// A model that can be instantiated, independent of its Rust type. Instances share its table.
pub struct ModelType {
    /// Name and description.
    pub info: Info,
    /// Optional capabilities.
    pub capabilities: Capabilities,
    variables: Arc<[Variable]>,
    new_instance: Box<dyn Fn() -> Box<dyn Instance> + Send + Sync>,
    /// In the order of [`Standard::ALL`].
    descriptions: [OnceLock<Description>; 3],
}

impl ModelType {
    /// The model type of a Rust type.
    pub fn of<M: Model>() -> Self {
        let table = Arc::new(Table::new(M::table()));
        Self {
            info: M::INFO,
            capabilities: M::CAPABILITIES,
            variables: table.variables.clone(),
            new_instance: Box::new(move || Box::new(ModelInstance::<M>::new(table.clone()))),
            descriptions: Default::default(),
        }
    }

    /// The variables in the order of the table. The index of a variable is its value reference.
    pub fn variables(&self) -> &[Variable] {
        &self.variables
    }

    /// Makes an instance with the start values of the table.
    pub fn instantiate(&self) -> Box<dyn Instance> {
        (self.new_instance)()
    }

    /// The model description by a standard.
    pub fn description(&self, standard: Standard) -> &Description {
        let at = Standard::ALL.iter().position(|known| *known == standard).expect("all standards are listed");
        self.descriptions[at].get_or_init(|| {
            if cfg!(miri) {
                // Under Miri, which checks accesses to memory, texts would take many minutes.
                return Description { token: format!("{{{} {standard:?}}}", self.info.name), xml: String::new() };
            }
            description::write(&self.info, self.capabilities, &self.variables, standard)
        })
    }

    /// GUID of the description by FMI 2.0.
    pub fn guid(&self) -> &str {
        &self.description(Standard::Fmi2).token
    }

    /// The text of `modelDescription.xml` by FMI 2.0.
    pub fn xml(&self) -> &str {
        &self.description(Standard::Fmi2).xml
    }

    /// With arrays: the number of elements that each value reference stands for, 0 within an array.
    #[cfg(feature = "fmi3")]
    pub(crate) fn elements(&self) -> Arc<[u32]> {
        description::arrays::elements(&self.variables)
    }
}

/// An instance of one model: its values, and its run once it has begun.
#[derive(Clone)]
struct ModelInstance<M: Model> {
    table: Arc<Table<M::Values>>,
    values: M::Values,
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
#[derive(Clone)]
struct Run<M: Model> {
    model: Arc<M>,
    state: M::State,
}

/// A serialized instance.
#[derive(Serialize, Deserialize)]
struct Record<V, S> {
    values: V,
    state: Option<S>,
    stale: bool,
    moving: Vec<InputDerivatives>,
    moved: Vec<InputDerivatives>,
}

/// A place where a test may plant a panic.
fn pass(place: &str) {
    #[cfg(feature = "planted-panics")]
    crate::planted::pass(place);
    #[cfg(not(feature = "planted-panics"))]
    let _ = place;
}

impl<M: Model> ModelInstance<M> {
    fn new(table: Arc<Table<M::Values>>) -> Self {
        let values = table.values(&[]);
        Self { table, values, run: None, time_s: 0.0, stale: true, moving: Vec::new(), moved: Vec::new() }
    }

    fn variable(&self, index: usize) -> Result<&Variable, AccessError> {
        self.table.variables.get(index).ok_or(AccessError::Unknown(index))
    }

    /// Constructs the model from the values, and its initial state.
    fn begin(&mut self) -> Result<Run<M>, Vec<Invalid>> {
        let model = Arc::new(M::new(&self.values)?);
        // The model's own findings come first: they are more specific.
        let found = self.not_finite();
        if !found.is_empty() {
            return Err(found);
        }
        let state = model.start(&mut self.values, self.time_s);
        Ok(Run { model, state })
    }

    /// Applies tunable parameters.
    fn retune(&mut self) -> Result<(), Vec<Invalid>> {
        let found = self.not_finite();
        match &mut self.run {
            Some(run) if found.is_empty() => Arc::make_mut(&mut run.model).retune(&mut run.state, &self.values),
            _ => Err(found),
        }
    }

    /// Parameters that are not finite.
    fn not_finite(&self) -> Vec<Invalid> {
        let parameters = self.table.variables.iter().enumerate();
        let parameters = parameters.filter(|(_, variable)| variable.causality == Causality::Parameter);
        let found = parameters.filter_map(|(index, variable)| match self.table.get(index, &self.values) {
            Value::Real(value) if !value.is_finite() => {
                Some(Invalid::new(variable.name.clone(), value, "a finite number"))
            }
            _ => None,
        });
        found.collect()
    }

    /// Outputs are updated when read, and only if a value was set since. Before the run they come from a trial start; invalid
    /// parameters are reported by the start itself, not here.
    fn update_outputs(&mut self) {
        if !std::mem::take(&mut self.stale) {
            return;
        }
        pass("get");
        match &self.run {
            Some(run) => run.model.refresh(&run.state, &mut self.values, self.time_s),
            None => drop(self.begin()),
        }
    }

    /// Whether a variable may be set to a value of that type now.
    fn check(&self, index: usize, value: &Value) -> Result<(), AccessError> {
        let variable = self.variable(index)?;
        let refuse = |reason| Err(AccessError::NotSettable { name: variable.name.to_string(), reason });
        match (variable.causality, variable.variability, &self.run) {
            (Causality::Input, ..) | (Causality::Parameter, _, None) => {}
            (Causality::Parameter, Variability::Tunable, Some(_)) => {}
            (Causality::Parameter, _, Some(_)) => return refuse("it is fixed once the run has begun"),
            (Causality::Output | Causality::Local, ..) => return refuse("it is computed"),
        }
        if !self.table.takes(index, value) {
            return Err(AccessError::WrongType { name: variable.name.to_string(), asked: value.type_name() });
        }
        Ok(())
    }

    /// Whether an input may have a derivative of that order.
    fn check_derivative(&self, index: usize, order: i32) -> Result<(), AccessError> {
        let variable = self.variable(index)?;
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
        if !self.variable(index)?.is_settable() {
            self.update_outputs();
        }
        Ok(self.table.get(index, &self.values))
    }

    fn set(&mut self, index: usize, value: Value) -> Result<(), AccessError> {
        // Fast path for the value of one input, which a loop sets at every step.
        if let Some(variable) = self.table.variables.get(index)
            && variable.causality == Causality::Input
            && self.moved.is_empty()
            && self.table.takes(index, &value)
        {
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
        let former = tunes.then(|| self.values.clone());
        for at in 0..count {
            let (index, value) = settings(at);
            let fits = self.table.set(index, &mut self.values, value);
            debug_assert!(fits, "the type of {} was checked", self.table.variables[index].name);
        }
        if let Some(former) = former
            && let Err(findings) = self.retune()
        {
            self.values = former;
            return Err(AccessError::Refused(findings));
        }
        if !self.moved.is_empty() {
            // An input that is set no longer continues as at the end of the step.
            self.moved.retain(|input| (0..count).all(|at| settings(at).0 != input.index));
        }
        self.stale |= count > 0;
        Ok(())
    }

    fn set_start(&mut self, start_s: f64) {
        self.time_s = start_s;
        self.stale = true;
    }

    fn start(&mut self) -> Result<(), Vec<Invalid>> {
        pass("start");
        self.run = Some(self.begin()?);
        self.stale = false;
        Ok(())
    }

    fn step(&mut self, step: Step, log: &mut dyn Log) -> Result<(), StepError> {
        pass("step");
        let run = self.run.as_mut().ok_or_else(|| StepError::of("the run has not begun"))?;
        let inputs = InputTrajectory::new(step.time_s, &self.table, &self.values, &self.moving);
        run.model.step(&mut run.state, &mut self.values, step, &inputs, log)?;
        inputs.apply(&mut self.values, step.end_s());
        self.moved.clear();
        self.moved.extend(self.moving.drain(..).map(|input| input.after(step.length_s)));
        self.time_s = step.end_s();
        self.stale = false;
        Ok(())
    }

    fn longest_step_s(&self) -> f64 {
        self.run.as_ref().map_or(0.0, |run| MAX_BASE_STEPS * run.model.base_step_s())
    }

    fn reset(&mut self) {
        *self = Self::new(self.table.clone());
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
        pass("differentiate");
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
        pass("differentiate");
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
        let trial;
        let run = match &self.run {
            Some(run) => run,
            None => {
                trial = self.begin().map_err(AccessError::Refused)?;
                &trial
            }
        };
        let derivatives = run.model.differentiate(&run.state, &self.values, &direction, self.time_s, started);
        Ok(Box::new(Direction { table: self.table.clone(), derivatives, started }))
    }

    fn duplicate(&self) -> Box<dyn Instance> {
        pass("save");
        Box::new(self.clone())
    }

    fn copy_from(&mut self, other: &dyn Instance) -> bool {
        pass("save");
        let other = other.as_any().downcast_ref::<Self>();
        if let Some(other) = other {
            self.clone_from(other);
        }
        other.is_some()
    }

    fn write(&self) -> Vec<u8> {
        let record = Record {
            values: self.values.clone(),
            state: self.run.as_ref().map(|run| run.state.clone()),
            stale: self.stale,
            moving: self.moving.clone(),
            moved: self.moved.clone(),
        };
        postcard::to_stdvec(&record).expect("numbers, texts and lists can be written, and memory grows as needed")
    }

    fn read(&mut self, bytes: &[u8], time_s: f64, stepping: bool) -> Result<(), String> {
        let (record, rest): (Record<M::Values, M::State>, _) =
            postcard::take_from_bytes(bytes).map_err(|error| error.to_string())?;
        if !rest.is_empty() {
            return Err(format!("{} bytes are left over", rest.len()));
        }
        let Record { values, state, stale, moving, moved } = record;
        if !(self.are_sound(&moving) && self.are_sound(&moved)) {
            return Err("the derivatives of inputs are not valid".into());
        }
        // An input may be missing, like a sensor; the step decides what that means.
        for (index, variable) in self.table.variables.iter().enumerate() {
            if variable.causality == Causality::Parameter
                && let Value::Real(value) = self.table.get(index, &values)
                && !value.is_finite()
            {
                return Err(format!("{} = {value} is not finite", variable.name));
            }
        }
        let run = match state {
            Some(state) => {
                let model = Arc::new(M::new(&values).map_err(|findings| Invalid::list(&findings))?);
                model.accepts(&state, &values, stepping.then_some(time_s))?;
                Some(Run { model, state })
            }
            None => None,
        };
        *self = Self { table: self.table.clone(), values, run, time_s, stale, moving, moved };
        Ok(())
    }

    fn has_begun(&self) -> bool {
        self.run.is_some()
    }

    fn as_any(&self) -> &dyn Any {
        self
    }
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
