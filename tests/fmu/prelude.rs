//! What most tests of the FMUs use.

pub use std::path::Path;
pub use std::ptr::{null, null_mut};

pub use crate::support::ffi::{Expect, Fmu, Request};
pub use crate::support::named::{self, Named};
pub use crate::support::{MODELS, Random, assert_contains, below, is_plant};
pub use crate::{drive, inputs};
pub use fmu_export::fmi2::bindings::*;
pub use fmu_export::variable::*;
pub use sha2::{Digest, Sha256};

/// The sample time, s.
pub const TS: f64 = 1e-4;

/// The models of the planar rotor.
pub const PLANT: &str = "MagneticBearing";
pub const CONTROLLER: &str = "FlatnessController";
pub const ESTIMATOR: &str = "AlgebraicEstimator";
