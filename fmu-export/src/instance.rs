//! A model as its importer sees it: values behind a table, a run, and rules for when values may change.

use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, OnceLock};

use serde::de::DeserializeOwned;

use crate::check;
use crate::description::{self, Description, Standard};
use crate::input::{HIGHEST_ORDER, InputDerivatives, InputTrajectory};
use crate::interface::guard::words;
use crate::log::Log;
use crate::model::{Capabilities, Info, Invalid, Model, Step, StepError};
use crate::resources::Resources;
use crate::state::{HiddenState, write_to};
use crate::variable::{Causality, Table, Type, Value, Variability, Variable};

/// The longest communication step, in units of [`Model::base_step_s`].
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

    /// A copy that serves as snapshot: cheap, and independent of this instance; `None` if the model has no snapshots.
    fn duplicate(&self) -> Option<Box<dyn Instance>>;

    /// Makes this instance a copy of another of the same model; `false` if the model differs or has no snapshots.
    fn copy_from(&mut self, other: &dyn Instance) -> bool;

    /// The instance in postcard's format; `None` if the model has no snapshots. Equal bits give equal bytes.
    fn write(&self) -> Option<Vec<u8>>;

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
    new_instance: Box<dyn Fn(Resources) -> Box<dyn Instance> + Send + Sync>,
    shared_places: Box<dyn Fn() -> Vec<String> + Send + Sync>,
    /// In the order of [`Standard::ALL`].
    descriptions: [OnceLock<Description>; 3],
}

impl ModelType {
    /// The model type of a Rust type.
    pub fn of<M: Model>() -> Self {
        let table = Arc::new(Table::new(M::table()));
        let same_table = table.clone();
        Self {
            info: M::INFO,
            capabilities: Capabilities { snapshots: M::State::SAVED, ..M::CAPABILITIES },
            variables: table.variables.clone(),
            new_instance: Box::new(move |resources| Box::new(ModelInstance::<M>::new(table.clone(), resources))),
            shared_places: Box::new(move || same_table.shared_places()),
            descriptions: Default::default(),
        }
    }

    /// The variables in the order of the table. The index of a variable is its value reference.
    pub fn variables(&self) -> &[Variable] {
        &self.variables
    }

    /// Makes an instance with the start values of the table, without a folder `resources`.
    pub fn instantiate(&self) -> Box<dyn Instance> {
        self.instantiate_with(Resources::default())
    }

    /// Makes an instance that finds its files in that folder.
    pub fn instantiate_with(&self, resources: Resources) -> Box<dyn Instance> {
        (self.new_instance)(resources)
    }

    /// Errors in the table, each in a sentence; the packager refuses a model with any.
    pub fn problems(&self) -> Vec<String> {
        let mut found = check::problems(&self.info, &self.variables);
        match catch_unwind(AssertUnwindSafe(|| (self.shared_places)())) {
            Ok(shared) => found.extend(shared),
            Err(panic) => found.push(format!("a row panics when it is read or written: {}", words(panic.as_ref()))),
        }
        found
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

/// How [`export_fmus!`](crate::export_fmus) finds out whether a type is a [`Model`] or a
/// [`SampledModel`](crate::SampledModel): the compiler looks for a method first without a reference, then behind one.
#[doc(hidden)]
pub mod kind {
    use std::marker::PhantomData;

    use super::ModelType;
    use crate::model::{self, Model, SampledModel};

    pub struct Of<M>(PhantomData<M>);

    impl<M> Of<M> {
        pub const NEW: Self = Self(PhantomData);
    }

    pub trait Continuous {
        fn model_type(&self) -> ModelType;
    }

    impl<M: Model> Continuous for Of<M> {
        fn model_type(&self) -> ModelType {
            ModelType::of::<M>()
        }
    }

    pub trait Sampled {
        fn model_type(&self) -> ModelType;
    }

    impl<S: SampledModel> Sampled for &Of<S> {
        fn model_type(&self) -> ModelType {
            ModelType::of::<model::Sampled<S>>()
        }
    }
}

/// An instance of one model: its values, and its run once it has begun. Values and state can be large, and the threads of
/// importers have small stacks, so they are on the heap.
struct ModelInstance<M: Model> {
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

/// A place where a test may plant a panic.
fn pass(place: &str) {
    #[cfg(feature = "planted-panics")]
    crate::planted::pass(place);
    #[cfg(not(feature = "planted-panics"))]
    let _ = place;
}

impl<M: Model> ModelInstance<M> {
    fn new(table: Arc<Table<M::Values>>, resources: Resources) -> Self {
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
        pass("get");
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

    /// Whether a variable may be set to a value of that type now.
    #[inline]
    fn check(&self, index: usize, value: &Value) -> Result<(), AccessError> {
        // An input, which is set at every step.
        let variable = self.table.variables.get(index).filter(|variable| variable.causality == Causality::Input);
        if variable.is_some_and(|variable| self.table.takes(index, value) && variable.holds(value)) {
            return Ok(());
        }
        self.check_any(index, value)
    }

    #[inline(never)]
    fn check_any(&self, index: usize, value: &Value) -> Result<(), AccessError> {
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
        // Fast path for the value of one input, which a loop sets at every step.
        if let Some(variable) = self.table.variables.get(index)
            && variable.causality == Causality::Input
            && self.moved.is_empty()
            && self.table.takes(index, &value)
            && variable.holds(&value)
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

    fn set_start(&mut self, start_s: f64) {
        self.time_s = start_s;
        self.stale = true;
    }

    fn start(&mut self) -> Result<(), Vec<Invalid>> {
        pass("start");
        let mut values = self.values.clone();
        self.run = Some(self.begin(&mut values)?);
        self.values = values;
        (self.trial, self.stale) = (None, false);
        Ok(())
    }

    fn step(&mut self, step: Step, log: &mut dyn Log) -> Result<(), StepError> {
        pass("step");
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
        pass("save");
        if M::State::SAVED { Some(Box::new(self.copy()?)) } else { None }
    }

    fn copy_from(&mut self, other: &dyn Instance) -> bool {
        pass("save");
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
