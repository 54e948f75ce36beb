//! The C interface of FMI 2.0 for co-simulation.
//!
//! [`functions`] holds the 34 functions of the standard, [`sequence`] the states in which they may be called. A library exports
//! them by [`export_fmus!`](crate::export_fmus).

pub mod functions;
pub mod sequence;

/// The types and constants of the standard's C header, under their standard names.
#[allow(
    missing_docs,
    non_camel_case_types,
    non_snake_case,
    non_upper_case_globals,
    reason = "generated from a C header"
)]
pub mod bindings;

use std::ffi::c_void;

use crate::interface::sequence::State;
use crate::interface::{Interface, Message};
use bindings::{fmi2CallbackLogger, fmi2Status};

/// FMI 2.0.
pub(crate) enum Fmi2 {}

/// The function in `fmi2CallbackLogger`.
type Callback = <fmi2CallbackLogger as IntoIterator>::Item;

impl Interface for Fmi2 {
    type Status = fmi2Status;
    const OK: fmi2Status = fmi2Status::fmi2OK;
    const WARNING: fmi2Status = fmi2Status::fmi2Warning;
    const ERROR: fmi2Status = fmi2Status::fmi2Error;
    const ENDED: fmi2Status = fmi2Status::fmi2Discard;
    type Function = sequence::Function;
    const STATES: &'static [(State, &'static str)] = sequence::STATES;
    const RESET: &'static str = "fmi2Reset";
    type Options = ();
    type Callback = Callback;

    unsafe fn send(callback: Callback, environment: *mut c_void, message: Message<'_, fmi2Status>) {
        let Message { instance, status, category, text } = message;
        // SAFETY: by this function's contract; all texts end with a zero byte and live until the call returns; the format `%s`
        // consumes exactly the one argument that follows it.
        unsafe {
            callback(environment, instance.as_ptr(), status, category.as_ptr(), c"%s".as_ptr(), text.as_ptr());
        }
    }
}
