//! The controller: reference trajectory, observer, tracking law, force allocation, current loop.
//!
//! In reading order:
//!
//! - [`mod@reference`]: the trajectory of the flat output and its derivatives;
//! - [`observer`]: position, velocity and perturbation from sampled positions;
//! - [`controller`]: the tracking law, for current and for voltage drive.

pub mod controller;
pub mod observer;
pub mod reference;
