//! The C interface of FMI 2.0 for co-simulation.
//!
//! A call of an importer passes one entry guard, which checks the instance and the [`sequence`] of calls, keeps panics from
//! crossing the border, and logs what went wrong; [`functions`] holds the 34 functions of the standard, each as short as its
//! meaning. A library exports them by [`export_fmus!`](crate::export_fmus).

pub mod functions;
pub mod sequence;

/// The types and constants of the standard's C header, under the names they have there.
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
