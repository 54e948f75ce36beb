//! What a slave is to its importer: values behind a table, a run, and the rules of when they may change.

use std::any::Any;
use std::fmt;

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use super::course::{Course, HIGHEST_ORDER, Slope};
use super::log::Log;
use super::variable::{Causality, Row, Value, Variability, Variable};
use crate::model::Invalid;

/// A step that could not be completed, in words for the user.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{0}")]
pub struct Fault(pub String);

impl Fault {
    /// The fault that any error describes.
    pub fn of(error: impl fmt::Display) -> Self {
        Self(error.to_string())
    }
}

/// All findings in one line.
pub fn all(findings: &[Invalid]) -> String {
    findings.iter().map(Invalid::to_string).collect::<Vec<_>>().join("; ")
}

/// A communication step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Step {
    /// Where it begins, in seconds.
    pub time_s: f64,
    /// How long it is, in seconds.
    pub length_s: f64,
}

impl Step {
    /// Where it ends, in seconds.
    pub fn end_s(&self) -> f64 {
        self.time_s + self.length_s
    }
}

/// The longest communication step, in units of the shortest step inside it: longer ones are refused, because nobody
/// could tell them from a slave that hangs.
pub const LONGEST_STEP: f64 = 1e6;

/// What a sort of slave can do beyond stepping.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Capabilities {
    /// Directional derivatives of outputs and of derivatives of states.
    pub directional_derivatives: bool,
    /// The highest order of derivatives of outputs with respect to time; 0 if there are none.
    pub output_derivative_order: usize,
}

impl Capabilities {
    /// Nothing beyond stepping.
    pub const PLAIN: Self = Self { directional_derivatives: false, output_derivative_order: 0 };
}

/// Equations made a co-simulation slave.
///
/// A value of this type is a run in progress; before the run there are only the values. A copy of it is a snapshot, so
/// what is large and does not change is shared between copies.
pub trait Slave: Clone + Sized + Send + 'static {
    /// The values of all variables.
    type Values: Clone + Default + Serialize + DeserializeOwned + Send + 'static;

    /// What changes while a run goes on. The rest of the run follows from the values.
    type State: Serialize + DeserializeOwned;

    /// What it can do beyond stepping.
    const CAPABILITIES: Capabilities = Capabilities::PLAIN;

    /// The variables.
    fn table() -> &'static [Row<Self::Values>];

    /// Begins a run and fills in the outputs at its start.
    ///
    /// # Errors
    /// Every parameter that cannot be accepted.
    fn start(values: &mut Self::Values, start_s: f64) -> Result<Self, Vec<Invalid>>;

    /// What has to be written down of the run, beside the values, to go on later.
    fn state(&self) -> Self::State;

    /// The run with that state, to go on at `time_s`, or only to be looked at if there is no time.
    ///
    /// Values and state come from outside and were checked for their form alone.
    ///
    /// # Errors
    /// Why values and state do not make a run that can go on.
    fn resume(values: &mut Self::Values, state: Self::State, time_s: Option<f64>) -> Result<Self, String>;

    /// The shortest step that stepping takes inside, in seconds; shorter than that if each is much work.
    fn grain_s(&self) -> f64;

    /// Takes over tunable parameters that have changed.
    ///
    /// # Errors
    /// Every parameter that cannot be accepted; the run goes on with the former ones.
    fn retune(&mut self, values: &Self::Values) -> Result<(), Vec<Invalid>> {
        let _ = values;
        Ok(())
    }

    /// Does one communication step and fills in the outputs at its end. The inputs among the values are those at its
    /// begin; their course says what becomes of them, and the values may be left with the inputs of any instant of it.
    ///
    /// # Errors
    /// Why the run cannot go on. What was computed before stays readable.
    fn step(
        &mut self,
        values: &mut Self::Values,
        step: Step,
        inputs: &Course<Self::Values>,
        log: &mut dyn Log,
    ) -> Result<(), Fault>;

    /// Brings outputs that follow an input at the same instant up to date at the time given.
    fn refresh(&self, values: &mut Self::Values, time_s: f64) {
        let _ = (values, time_s);
    }

    /// The directional derivative at an instant: `direction` holds the direction in the places of the variables that are
    /// known and 0 in all others; the answer holds the derivatives in the places of those that follow from them.
    /// `started` says whether the run has begun; before, parameters are known as well.
    ///
    /// Called only if [`Slave::CAPABILITIES`] promises it.
    fn differentiate(
        &self,
        values: &Self::Values,
        direction: &Self::Values,
        time_s: f64,
        started: bool,
    ) -> Self::Values {
        let _ = (values, time_s, started);
        direction.clone()
    }

    /// The derivatives of that order of the outputs with respect to time, in the places of the outputs. `slopes[j]` holds
    /// the derivatives of order j + 1 of the inputs in their places.
    ///
    /// Called only for orders that [`Slave::CAPABILITIES`] promises.
    fn output_derivatives(
        &self,
        values: &Self::Values,
        slopes: &[Self::Values; HIGHEST_ORDER],
        time_s: f64,
        order: usize,
    ) -> Self::Values {
        let _ = (values, time_s, order);
        slopes[0].clone()
    }
}

/// Why a value was not taken or given.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum AccessError {
    /// There is no variable of that index.
    #[error("there is no variable with value reference {0}")]
    Unknown(usize),
    /// The variable is of another type.
    #[error("{name} is no {asked}")]
    WrongType {
        /// The variable.
        name: String,
        /// The type asked for.
        asked: &'static str,
    },
    /// The variable cannot be set now or at all.
    #[error("{name} cannot be set: {reason}")]
    NotSettable {
        /// The variable.
        name: String,
        /// Why.
        reason: &'static str,
    },
    /// The value was refused.
    #[error("{}", all(.0))]
    Refused(Vec<Invalid>),
    /// A derivative is not to be had, or not to be given.
    #[error("{name}: {reason}")]
    NoDerivative {
        /// The variable.
        name: String,
        /// Why.
        reason: &'static str,
    },
    /// The order of a derivative is out of range.
    #[error("{name}: a derivative of order {order} is refused: an order from 1 to {highest} is wanted")]
    Order {
        /// The variable.
        name: String,
        /// The order asked for.
        order: i32,
        /// The highest order there is.
        highest: usize,
    },
}

/// One instance of any slave.
pub trait AnySlave: Send {
    /// The value of the variable of that index, counted from 0 in the order of the table.
    ///
    /// # Errors
    /// [`AccessError::Unknown`].
    fn get(&mut self, index: usize) -> Result<Value, AccessError>;

    /// Gives the variable of that index a value.
    ///
    /// # Errors
    /// Whatever is wrong with it, see [`AccessError`]; the former value stays.
    fn set(&mut self, index: usize, value: Value) -> Result<(), AccessError> {
        self.set_all(1, &|_| (index, value))
    }

    /// Gives several variables a value each, or, if anything is wrong with one of them, none: `settings` tells the index
    /// and the value of the setting of that number.
    ///
    /// # Errors
    /// Whatever is wrong with one of them, see [`AccessError`]; all former values stay.
    fn set_all(&mut self, count: usize, settings: &dyn Fn(usize) -> (usize, Value)) -> Result<(), AccessError>;

    /// Tells when the run will begin, in seconds; 0 if nothing is told.
    fn set_start(&mut self, start_s: f64);

    /// Begins the run.
    ///
    /// # Errors
    /// Every parameter that cannot be accepted.
    fn start(&mut self) -> Result<(), Vec<Invalid>>;

    /// Does one communication step. Derivatives of inputs that were given hold for this step alone; after it the inputs
    /// stand at the values to which these have led.
    ///
    /// # Errors
    /// Why the run cannot go on.
    fn step(&mut self, step: Step, log: &mut dyn Log) -> Result<(), Fault>;

    /// The longest communication step that is done, in seconds; see [`LONGEST_STEP`].
    fn longest_step_s(&self) -> f64;

    /// Makes this instance what it was when it was made.
    fn reset(&mut self);

    /// Gives inputs derivatives with respect to time at the begin of the next step, or, if anything is wrong with one,
    /// none; `settings` tells index, order and value of the setting of that number.
    ///
    /// # Errors
    /// Whatever is wrong with one of them.
    fn set_slopes(&mut self, count: usize, settings: &dyn Fn(usize) -> (usize, i32, f64)) -> Result<(), AccessError>;

    /// The derivative of an output with respect to time, at the end of the last step.
    ///
    /// # Errors
    /// Whatever is wrong with the request.
    fn output_derivative(&mut self, index: usize, order: i32) -> Result<f64, AccessError>;

    /// Prepares a directional derivative: `knowns` tells index and direction of the known variable of that number.
    ///
    /// # Errors
    /// Whatever is wrong with one of them.
    fn differentiate(
        &mut self,
        count: usize,
        knowns: &dyn Fn(usize) -> (usize, f64),
    ) -> Result<Box<dyn Derivatives>, AccessError>;

    /// A copy, which is a snapshot: cheap, and independent of what becomes of this instance.
    fn duplicate(&self) -> Box<dyn AnySlave>;

    /// Makes this instance a copy of another of the same sort, whose memory it uses again; `false` if it is of another.
    fn copy_from(&mut self, other: &dyn AnySlave) -> bool;

    /// Writes down all that a copy has, in postcard's format. The same bits give the same bytes.
    fn write(&self) -> Vec<u8>;

    /// Makes this instance what was written down, to go on at `time_s` if `stepping`.
    ///
    /// # Errors
    /// Why the bytes make no instance; this one then stays as it was. Whatever the bytes, nothing panics, and no more
    /// memory is taken than the instance needs.
    fn read(&mut self, bytes: &[u8], time_s: f64, stepping: bool) -> Result<(), String>;

    /// Whether the run has begun.
    fn has_begun(&self) -> bool;

    /// For [`AnySlave::copy_from`].
    fn as_any(&self) -> &dyn Any;
}

/// Directional derivatives in one direction.
pub trait Derivatives {
    /// That of the unknown variable of that index.
    ///
    /// # Errors
    /// [`AccessError::Unknown`], [`AccessError::NoDerivative`].
    fn of(&self, index: usize) -> Result<f64, AccessError>;
}

/// A sort of slave that can be instantiated.
pub struct Kind {
    /// Name of the model.
    pub name: &'static str,
    /// What it models, in a sentence.
    pub description: &'static str,
    /// Length of a run that shows what the model is about, in seconds.
    pub stop_s: f64,
    /// Communication step of such a run, in seconds.
    pub step_s: f64,
    /// What it can do beyond stepping.
    pub capabilities: Capabilities,
    /// Where its table is kept: a `LazyLock` that is made once and can be dropped by whoever knows that all is over.
    pub shelf: &'static (dyn Any + Send + Sync),
    /// The variables in the order of the table.
    pub variables: fn() -> Vec<&'static Variable>,
    /// Makes an instance with the start values of the table.
    pub instantiate: fn() -> Box<dyn AnySlave>,
}

/// The variables of a slave in the order of its table.
pub fn variables<S: Slave>() -> Vec<&'static Variable> {
    S::table().iter().map(|row| &row.variable).collect()
}

/// A new instance of a slave.
pub fn instantiate<S: Slave>() -> Box<dyn AnySlave> {
    Box::new(Instance::<S>::new())
}

/// An instance of one slave: its values, and its run once that has begun.
#[derive(Clone)]
struct Instance<S: Slave> {
    values: S::Values,
    run: Option<S>,
    /// Start of the run before it has begun, then the end of the last step.
    time_s: f64,
    /// Outputs may lag behind values that were set.
    stale: bool,
    /// Derivatives of inputs at the begin of the next step.
    slopes: Vec<Slope>,
    /// Derivatives of inputs at the end of the last step.
    left: Vec<Slope>,
}

/// What is written down of an instance.
#[derive(Serialize, Deserialize)]
struct Record<V, S> {
    values: V,
    state: Option<S>,
    stale: bool,
    slopes: Vec<Slope>,
    left: Vec<Slope>,
}

/// A place where a test may have planted a panic.
fn pass(place: &str) {
    #[cfg(feature = "planted-panics")]
    super::planted::pass(place);
    #[cfg(not(feature = "planted-panics"))]
    let _ = place;
}

impl<S: Slave> Instance<S> {
    fn new() -> Self {
        let mut values = S::Values::default();
        for row in S::table() {
            let fits = row.set(&mut values, row.variable.start());
            debug_assert!(fits, "the start value of {} has the type of its place", row.variable.name);
        }
        Self { values, run: None, time_s: 0.0, stale: true, slopes: Vec::new(), left: Vec::new() }
    }

    fn row(index: usize) -> Result<&'static Row<S::Values>, AccessError> {
        S::table().get(index).ok_or(AccessError::Unknown(index))
    }

    /// Values that are all 0, into whose places directions and derivatives are put.
    fn zeros() -> S::Values {
        let mut values = S::Values::default();
        for row in S::table() {
            // Only Reals have derivatives; the others refuse the number.
            let _ = row.set(&mut values, Value::Real(0.0));
        }
        values
    }

    /// Outputs are brought up to date when somebody looks, and only if a value was set since. Before the run they come
    /// from a trial start; parameters that cannot be accepted are reported by the start itself, not here.
    fn freshen(&mut self) {
        if !std::mem::take(&mut self.stale) {
            return;
        }
        pass("get");
        match &self.run {
            Some(run) => run.refresh(&mut self.values, self.time_s),
            None => drop(S::start(&mut self.values, self.time_s)),
        }
    }

    /// Whether a variable may be given a value of that type now.
    fn check(&self, index: usize, value: Value) -> Result<(), AccessError> {
        let row = Self::row(index)?;
        let variable = &row.variable;
        let refuse = |reason| Err(AccessError::NotSettable { name: variable.name.to_string(), reason });
        match (variable.causality, variable.variability, &self.run) {
            (Causality::Input, ..) | (Causality::Parameter, _, None) => {}
            (Causality::Parameter, Variability::Tunable, Some(_)) => {}
            (Causality::Parameter, _, Some(_)) => return refuse("it is fixed once the run has begun"),
            (Causality::Output | Causality::Local, ..) => return refuse("it is computed"),
        }
        if !row.takes(value) {
            return Err(AccessError::WrongType { name: variable.name.to_string(), asked: value.noun() });
        }
        Ok(())
    }

    /// Whether an input may have a derivative of that order.
    fn check_slope(index: usize, order: i32) -> Result<(), AccessError> {
        let variable = &Self::row(index)?.variable;
        if variable.causality != Causality::Input || !variable.is_continuous() {
            let reason = "a continuous input of type Real is wanted";
            return Err(AccessError::NoDerivative { name: variable.name.to_string(), reason });
        }
        if !usize::try_from(order).is_ok_and(|order| (1..=HIGHEST_ORDER).contains(&order)) {
            return Err(AccessError::Order { name: variable.name.to_string(), order, highest: HIGHEST_ORDER });
        }
        Ok(())
    }

    /// Whether slopes that were read from outside are such as could have been set.
    fn are_sound(slopes: &[Slope]) -> bool {
        let known = slopes.iter().all(|slope| Self::check_slope(slope.index, 1).is_ok());
        // Their order is that in which they were given.
        let once = (1..slopes.len()).all(|at| slopes[..at].iter().all(|slope| slope.index != slopes[at].index));
        known && once && slopes.iter().all(|slope| slope.derivatives.iter().all(|value| value.is_finite()))
    }
}

impl<S: Slave> AnySlave for Instance<S> {
    fn get(&mut self, index: usize) -> Result<Value, AccessError> {
        let row = Self::row(index)?;
        if !row.variable.is_settable() {
            self.freshen();
        }
        Ok(row.get(&self.values))
    }

    fn set(&mut self, index: usize, value: Value) -> Result<(), AccessError> {
        // What a loop does at every step, the value of an input, goes without the checks of lists.
        if let Some(row) = S::table().get(index)
            && row.variable.causality == Causality::Input
            && self.left.is_empty()
            && row.set(&mut self.values, value)
        {
            self.stale = true;
            return Ok(());
        }
        self.set_all(1, &|_| (index, value))
    }

    fn set_all(&mut self, count: usize, settings: &dyn Fn(usize) -> (usize, Value)) -> Result<(), AccessError> {
        let mut tunes = false;
        for at in 0..count {
            let (index, value) = settings(at);
            self.check(index, value)?;
            tunes |= self.run.is_some() && S::table()[index].variable.causality == Causality::Parameter;
        }
        // Nothing but tuning can fail from here on.
        let former = tunes.then(|| self.values.clone());
        for at in 0..count {
            let (index, value) = settings(at);
            let row = &S::table()[index];
            let fits = row.set(&mut self.values, value);
            debug_assert!(fits, "the type of {} was checked", row.variable.name);
        }
        if let (Some(former), Some(run)) = (former, &mut self.run)
            && let Err(findings) = run.retune(&self.values)
        {
            self.values = former;
            return Err(AccessError::Refused(findings));
        }
        if !self.left.is_empty() {
            // An input that is set anew no longer moves as it did at the end of the step.
            self.left.retain(|slope| (0..count).all(|at| settings(at).0 != slope.index));
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
        self.run = Some(S::start(&mut self.values, self.time_s)?);
        self.stale = false;
        Ok(())
    }

    fn step(&mut self, step: Step, log: &mut dyn Log) -> Result<(), Fault> {
        pass("step");
        let run = self.run.as_mut().ok_or_else(|| Fault::of("the run has not begun"))?;
        let inputs = Course::new(step.time_s, S::table(), &self.values, &self.slopes);
        run.step(&mut self.values, step, &inputs, log)?;
        inputs.put(&mut self.values, step.end_s());
        self.left.clear();
        self.left.extend(self.slopes.drain(..).map(|slope| slope.after(step.length_s)));
        self.time_s = step.end_s();
        self.stale = false;
        Ok(())
    }

    fn longest_step_s(&self) -> f64 {
        self.run.as_ref().map_or(0.0, |run| LONGEST_STEP * run.grain_s())
    }

    fn reset(&mut self) {
        *self = Self::new();
    }

    fn set_slopes(&mut self, count: usize, settings: &dyn Fn(usize) -> (usize, i32, f64)) -> Result<(), AccessError> {
        for at in 0..count {
            let (index, order, _) = settings(at);
            Self::check_slope(index, order)?;
        }
        for at in 0..count {
            let (index, order, value) = settings(at);
            let known = self.slopes.iter().position(|slope| slope.index == index);
            let place = known.unwrap_or_else(|| {
                self.slopes.push(Slope::of(index));
                self.slopes.len() - 1
            });
            self.slopes[place].derivatives[order as usize - 1] = value;
        }
        Ok(())
    }

    fn output_derivative(&mut self, index: usize, order: i32) -> Result<f64, AccessError> {
        let row = Self::row(index)?;
        let name = || row.variable.name.to_string();
        let highest = S::CAPABILITIES.output_derivative_order;
        let refuse = |reason| Err(AccessError::NoDerivative { name: name(), reason });
        if row.variable.causality != Causality::Output || !row.takes(Value::Real(0.0)) {
            return refuse("an output of type Real is wanted");
        }
        let Some(run) = &self.run else { return refuse("the run has not begun") };
        if highest == 0 {
            return refuse("derivatives of outputs are not offered, as the model description says");
        }
        let Some(order) = usize::try_from(order).ok().filter(|order| (1..=highest).contains(order)) else {
            return Err(AccessError::Order { name: name(), order, highest });
        };
        if !row.variable.is_continuous() {
            // It changes in jumps, between which it stands still.
            return Ok(0.0);
        }
        pass("differentiate");
        let inputs = Course::new(self.time_s, S::table(), &self.values, &self.left);
        let slopes = std::array::from_fn(|lower| {
            let mut slopes = Self::zeros();
            inputs.put_derivative(&mut slopes, lower + 1);
            slopes
        });
        match row.get(&run.output_derivatives(&self.values, &slopes, self.time_s, order)) {
            Value::Real(value) => Ok(value),
            _ => refuse("an output of type Real is wanted"),
        }
    }

    fn differentiate(
        &mut self,
        count: usize,
        knowns: &dyn Fn(usize) -> (usize, f64),
    ) -> Result<Box<dyn Derivatives>, AccessError> {
        pass("differentiate");
        if !S::CAPABILITIES.directional_derivatives {
            let reason = "not offered, as the model description says";
            return Err(AccessError::NoDerivative { name: "directional derivatives".into(), reason });
        }
        let started = self.run.is_some();
        let mut direction = Self::zeros();
        for at in 0..count {
            let (index, value) = knowns(at);
            let row = Self::row(index)?;
            let variable = &row.variable;
            let refuse = |reason| Err(AccessError::NoDerivative { name: variable.name.to_string(), reason });
            let parameter = variable.causality == Causality::Parameter && !started;
            let known = variable.state || parameter || (variable.causality == Causality::Input);
            if !(known && row.takes(Value::Real(value))) {
                return refuse("a state or an input of type Real is wanted, in initialization a parameter as well");
            }
            let Value::Real(former) = row.get(&direction) else { continue };
            let _ = row.set(&mut direction, Value::Real(former + value));
        }
        let derivatives = match &self.run {
            Some(run) => run.differentiate(&self.values, &direction, self.time_s, started),
            None => {
                let run = S::start(&mut self.values, self.time_s).map_err(AccessError::Refused)?;
                run.differentiate(&self.values, &direction, self.time_s, started)
            }
        };
        Ok(Box::new(Direction::<S> { derivatives, started }))
    }

    fn duplicate(&self) -> Box<dyn AnySlave> {
        pass("save");
        Box::new(self.clone())
    }

    fn copy_from(&mut self, other: &dyn AnySlave) -> bool {
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
            state: self.run.as_ref().map(S::state),
            stale: self.stale,
            slopes: self.slopes.clone(),
            left: self.left.clone(),
        };
        postcard::to_stdvec(&record).expect("numbers, texts and lists can be written, and memory grows as needed")
    }

    fn read(&mut self, bytes: &[u8], time_s: f64, stepping: bool) -> Result<(), String> {
        let (record, rest): (Record<S::Values, S::State>, _) =
            postcard::take_from_bytes(bytes).map_err(|error| error.to_string())?;
        if !rest.is_empty() {
            return Err(format!("{} bytes are left over", rest.len()));
        }
        let Record { mut values, state, stale, slopes, left } = record;
        if !(Self::are_sound(&slopes) && Self::are_sound(&left)) {
            return Err("derivatives of inputs are not such as can be set".into());
        }
        // An input may be missing, as a sensor may; what that means is the step's affair.
        for row in S::table().iter().filter(|row| row.variable.causality == Causality::Parameter) {
            if let Value::Real(value) = row.get(&values)
                && !value.is_finite()
            {
                return Err(format!("{} = {value} is not finite", row.variable.name));
            }
        }
        let run = match state {
            Some(state) => Some(S::resume(&mut values, state, stepping.then_some(time_s))?),
            None => None,
        };
        *self = Self { values, run, time_s, stale, slopes, left };
        Ok(())
    }

    fn has_begun(&self) -> bool {
        self.run.is_some()
    }

    fn as_any(&self) -> &dyn Any {
        self
    }
}

/// The derivatives of all variables in one direction, in the places of the variables.
struct Direction<S: Slave> {
    derivatives: S::Values,
    started: bool,
}

impl<S: Slave> Derivatives for Direction<S> {
    fn of(&self, index: usize) -> Result<f64, AccessError> {
        let row = Instance::<S>::row(index)?;
        let variable = &row.variable;
        let refuse = |reason| Err(AccessError::NoDerivative { name: variable.name.to_string(), reason });
        let unknown = variable.causality == Causality::Output
            || variable.derivative_of.is_some()
            || (variable.state && !self.started);
        if !unknown {
            return refuse("an output or the derivative of a state is wanted, in initialization a state as well");
        }
        match row.get(&self.derivatives) {
            // What is sampled stands still between samples.
            Value::Real(_) if self.started && !variable.is_continuous() => Ok(0.0),
            Value::Real(derivative) => Ok(derivative),
            _ => refuse("a variable of type Real is wanted"),
        }
    }
}
