//! Equations of the bearing, its controller and its estimator.
//!
//! SI units throughout, axis order (y, z), magnets in the order 1, 2, 3. Nothing here knows of FMI, reads or
//! writes files, or allocates while stepping. Configuration and state are two types: a configuration is checked
//! once, when it is made, and a step takes it by shared reference and changes the state alone.
//!
//! Elementary functions come from the crate `libm`, so that all platforms compute the same bits.

mod invalid;

pub mod coil;
pub mod controller;
pub mod estimation;
pub mod integration;
pub mod linearisation;
pub mod magnet;
pub mod noise;
pub mod observer;
pub mod plant;
pub mod reference;
pub mod scalar;
pub mod sensitivity;
pub mod sensor;
pub mod touchdown;

pub use invalid::{Checks, Invalid};
