//! The C interface of FMI 2.0 for co-simulation.

/// The types and constants of the standard's C header, under the names they have there.
#[allow(missing_docs, non_camel_case_types, non_snake_case, non_upper_case_globals)]
pub mod bindings;
