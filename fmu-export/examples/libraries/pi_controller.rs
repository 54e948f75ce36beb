//! The example `pi_controller` as the library that goes into its FMU.

#[path = "../pi_controller.rs"]
#[allow(dead_code, reason = "`main` belongs to the program")]
mod pi_controller;
