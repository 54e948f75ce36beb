//! The C interface of FMI 2.0 for co-simulation.
//!
//! Every call passes one entry guard, which checks the instance and the [`sequence`] of calls, stops panics at the C boundary,
//! and logs errors; [`functions`] holds the 34 functions of the standard. A library exports them by
//! [`export_fmus!`](crate::export_fmus).

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

mod component;
mod guard;
mod logger;
mod snapshot;

pub(crate) use logger::Category;
