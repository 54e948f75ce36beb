//! What most tests of the equations use.

pub use std::f64::consts::{PI, TAU};

pub use crate::support::{Random, SpindleConfig, assert_contains, below, between, poles_are_at};
pub use magnetic_bearing::bearing::coil::{Coil, CoilConfig, Drive};
pub use magnetic_bearing::bearing::{Rotor, RotorConfig, Scalar};
pub use magnetic_bearing::control::controller::*;
pub use magnetic_bearing::control::reference::*;
pub use magnetic_bearing::estimation::*;
pub use magnetic_bearing::invalid::{Checks, Invalid, NotFinite};
pub use magnetic_bearing::machine::{PLANAR, PLANAR4, SPINDLE};
pub use magnetic_bearing::plant::linearisation::{Point, Taylor};
pub use magnetic_bearing::plant::noise::Noise;
pub use magnetic_bearing::plant::*;

/// The sample time, s.
pub const STEP_S: f64 = 1e-4;
