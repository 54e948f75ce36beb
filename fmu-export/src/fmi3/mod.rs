//! The C interface of FMI 3.0 for co-simulation.
//!
//! [`functions`] holds the 75 functions of the standard, [`sequence`] the states in which they may be called. A library exports
//! them by [`export_fmus!`](crate::export_fmus). Features beyond co-simulation are refused with a message: other interface
//! types, clocks, structural parameters, adjoint derivatives.

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
use std::sync::Arc;

use crate::interface::sequence::State;
use crate::interface::{Interface, Message};
use bindings::{fmi3LogMessageCallback, fmi3Status};

/// FMI 3.0.
pub(crate) enum Fmi3 {}

/// The function in `fmi3LogMessageCallback`.
type Callback = <fmi3LogMessageCallback as IntoIterator>::Item;

/// Options that the importer chose at instantiation.
pub(crate) struct Options {
    /// Whether events are handled in event mode.
    event_mode: bool,
    /// Whether a step may end early.
    early_return: bool,
    /// With arrays: the number of elements of each value reference, 0 within an array.
    elements: Option<Arc<[u32]>>,
}

impl Interface for Fmi3 {
    type Status = fmi3Status;
    const OK: fmi3Status = fmi3Status::fmi3OK;
    const WARNING: fmi3Status = fmi3Status::fmi3Warning;
    const ERROR: fmi3Status = fmi3Status::fmi3Error;
    const ENDED: fmi3Status = fmi3Status::fmi3OK;
    type Function = sequence::Function;
    const STATES: &'static [(State, &'static str)] = sequence::STATES;
    const RESET: &'static str = "fmi3Reset";
    type Options = Options;
    type Callback = Callback;

    unsafe fn send(callback: Callback, environment: *mut c_void, message: Message<'_, fmi3Status>) {
        let Message { status, category, text, .. } = message;
        // SAFETY: by this function's contract; both texts end with a zero byte and live until the call returns.
        unsafe { callback(environment, status, category.as_ptr(), text.as_ptr()) }
    }
}
