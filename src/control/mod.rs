//! The controller: reference trajectory, observer, tracking law, force allocation, current loop.
//!
//! In reading order:
//!
//! - `phase`: angles that grow at a constant rate between samples;
//! - [`mod@reference`]: the trajectory of the flat output and its derivatives;
//! - [`observer`]: position, velocity and perturbation from sampled positions;
//! - [`tracking`]: the control law, for current and voltage drive, and the excitation, for any number of coordinates and magnets;
//! - [`controller`]: the controller of any machine.

pub mod controller;
pub mod observer;
mod phase;
pub mod reference;
pub mod tracking;
