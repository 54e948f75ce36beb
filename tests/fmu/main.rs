//! The three models as FMUs: their variables and steps, and the C interface that importers call.

#[path = "../support/mod.rs"]
mod support;

mod abuse;
mod bindings;
mod derivatives;
// The documentation page is made by the program.
#[cfg(feature = "app")]
mod description;
mod fmi3;
mod guard;
mod initial;
mod instances;
mod log;
mod session;
mod stack;
mod state;
mod time;
