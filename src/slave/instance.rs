//! What a slave is to its importer: values behind a table, a run, and the rules of when they may change.

use std::fmt;

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

/// Equations made a co-simulation slave.
///
/// A value of this type is a run in progress; before the run there are only the values.
pub trait Slave: Sized + Send + 'static {
    /// The values of all variables.
    type Values: Default + Send + 'static;

    /// The variables.
    fn table() -> &'static [Row<Self::Values>];

    /// Begins a run and fills in the outputs at its start.
    ///
    /// # Errors
    /// Every parameter that cannot be accepted.
    fn start(values: &mut Self::Values, start_s: f64) -> Result<Self, Vec<Invalid>>;

    /// Takes over tunable parameters that have changed.
    ///
    /// # Errors
    /// Every parameter that cannot be accepted; the run goes on with the former ones.
    fn retune(&mut self, values: &Self::Values) -> Result<(), Vec<Invalid>> {
        let _ = values;
        Ok(())
    }

    /// Does one communication step with the inputs as they stand and fills in the outputs at its end.
    ///
    /// # Errors
    /// Why the run cannot go on. What was computed before stays readable.
    fn step(&mut self, values: &mut Self::Values, step: Step, log: &mut dyn Log) -> Result<(), Fault>;

    /// Brings outputs that follow an input at the same instant up to date at the time given.
    fn refresh(&self, values: &mut Self::Values, time_s: f64) {
        let _ = (values, time_s);
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
    fn set(&mut self, index: usize, value: Value) -> Result<(), AccessError>;

    /// Tells when the run will begin, in seconds; 0 if nothing is told.
    fn set_start(&mut self, start_s: f64);

    /// Begins the run.
    ///
    /// # Errors
    /// Every parameter that cannot be accepted.
    fn start(&mut self) -> Result<(), Vec<Invalid>>;

    /// Does one communication step.
    ///
    /// # Errors
    /// Why the run cannot go on.
    fn step(&mut self, step: Step, log: &mut dyn Log) -> Result<(), Fault>;

    /// Makes this instance what it was when it was made.
    fn reset(&mut self);
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
struct Instance<S: Slave> {
    values: S::Values,
    run: Option<S>,
    /// Start of the run before it has begun, then the end of the last step.
    time_s: f64,
    /// Outputs may lag behind values that were set.
    stale: bool,
}

impl<S: Slave> Instance<S> {
    fn new() -> Self {
        let mut values = S::Values::default();
        for row in S::table() {
            let fits = row.set(&mut values, row.variable.start());
            debug_assert!(fits, "the start value of {} has the type of its place", row.variable.name);
        }
        Self { values, run: None, time_s: 0.0, stale: true }
    }

    fn row(index: usize) -> Result<&'static Row<S::Values>, AccessError> {
        S::table().get(index).ok_or(AccessError::Unknown(index))
    }

    /// Outputs are brought up to date when somebody looks, and only if a value was set since. Before the run they come
    /// from a trial start; parameters that cannot be accepted are reported by the start itself, not here.
    fn freshen(&mut self) {
        if !std::mem::take(&mut self.stale) {
            return;
        }
        match &self.run {
            Some(run) => run.refresh(&mut self.values, self.time_s),
            None => drop(S::start(&mut self.values, self.time_s)),
        }
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
        let row = Self::row(index)?;
        let variable = &row.variable;
        let refuse = |reason| Err(AccessError::NotSettable { name: variable.name.to_string(), reason });
        match (variable.causality, variable.variability, &self.run) {
            (Causality::Input, ..) | (Causality::Parameter, _, None) => {}
            (Causality::Parameter, Variability::Tunable, Some(_)) => {}
            (Causality::Parameter, _, Some(_)) => return refuse("it is fixed once the run has begun"),
            (Causality::Output | Causality::Local, ..) => return refuse("it is computed"),
        }
        let former = row.get(&self.values);
        if !row.set(&mut self.values, value) {
            return Err(AccessError::WrongType { name: variable.name.to_string(), asked: value.noun() });
        }
        if variable.causality == Causality::Parameter
            && let Some(run) = &mut self.run
            && let Err(findings) = run.retune(&self.values)
        {
            let _ = row.set(&mut self.values, former);
            return Err(AccessError::Refused(findings));
        }
        self.stale = true;
        Ok(())
    }

    fn set_start(&mut self, start_s: f64) {
        self.time_s = start_s;
        self.stale = true;
    }

    fn start(&mut self) -> Result<(), Vec<Invalid>> {
        self.run = Some(S::start(&mut self.values, self.time_s)?);
        self.stale = false;
        Ok(())
    }

    fn step(&mut self, step: Step, log: &mut dyn Log) -> Result<(), Fault> {
        let run = self.run.as_mut().ok_or_else(|| Fault::of("the run has not begun"))?;
        run.step(&mut self.values, step, log)?;
        self.time_s = step.end_s();
        self.stale = false;
        Ok(())
    }

    fn reset(&mut self) {
        *self = Self::new();
    }
}
