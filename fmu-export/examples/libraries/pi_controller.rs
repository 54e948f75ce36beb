//! The example `pi_controller` as the library that goes into its FMU.

#[path = "../pi_controller.rs"]
pub mod pi_controller;
