//! The C interface of FMI 2.0 for co-simulation.
//!
//! Everything that is unsafe lives here. A call from an importer goes through one `door`, which checks the instance and
//! the [`sequence`] of calls, keeps panics from crossing the border, and logs what went wrong; [`exports`] holds the 34
//! functions of the standard, each as short as its meaning. Which slaves there are is the [`registry`]'s affair, and
//! [`description`] writes their `modelDescription.xml` by way of [`xml`]. Nothing here knows of bearings.

pub mod description;
pub mod exports;
pub mod registry;
pub mod sequence;
pub mod xml;

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
mod door;
mod logger;
mod snapshot;
mod unload;
