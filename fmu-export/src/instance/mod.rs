//! A model as its importer sees it: values behind a table, a run, and rules for when values may change.
//!
//! [`ModelType`] makes instances of a model; `run.rs` implements [`Instance`] for all of them.

mod model_type;
mod run;

use std::any::Any;

use crate::log::Log;
use crate::model::{Invalid, Step, StepError};
use crate::variable::Value;

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
pub trait Instance: Send + Sync {
    /// The value of the variable with that index, counted from 0 in the order of the table.
    ///
    /// # Errors
    /// [`AccessError::Unknown`].
    fn get(&mut self, index: usize) -> Result<Value, AccessError>;

    /// Sets the variable with that index.
    ///
    /// # Errors
    /// If the value is refused, see [`AccessError`]; the former value stays.
    fn set(&mut self, index: usize, value: Value) -> Result<(), AccessError> {
        self.set_all(1, &|_| (index, value.clone()))
    }

    /// Sets several variables, or none if one value is refused: `settings(n)` returns index and value of setting n.
    ///
    /// # Errors
    /// If one of them is refused, see [`AccessError`]; all former values stay.
    fn set_all(&mut self, count: usize, settings: &dyn Fn(usize) -> (usize, Value)) -> Result<(), AccessError>;

    /// Reads variables of type Real in a run, until one of them needs more care: it is unknown, of another type, the time, or not
    /// finite. Returns the number of values read; [`get`](Self::get) reads the next one or gives the reason.
    fn get_reals(&mut self, _indices: &[u32], _values: &mut [f64]) -> usize {
        0
    }

    /// Sets variables as [`set_all`](Self::set_all) does if all of them are inputs of type Real within their limits; otherwise it
    /// returns `false` and changes nothing.
    fn set_reals(&mut self, _indices: &[u32], _values: &[f64]) -> bool {
        false
    }

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
    /// If one of them is refused.
    fn set_input_derivatives(
        &mut self,
        count: usize,
        settings: &dyn Fn(usize) -> (usize, i32, f64),
    ) -> Result<(), AccessError>;

    /// The derivative of an output with respect to time, at the end of the last step.
    ///
    /// # Errors
    /// If the variable has no derivative of this order.
    fn output_derivative(&mut self, index: usize, order: i32) -> Result<f64, AccessError>;

    /// Prepares a directional derivative: `knowns(n)` returns index and direction of the n-th known variable.
    ///
    /// # Errors
    /// If an unknown or a known is refused.
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
