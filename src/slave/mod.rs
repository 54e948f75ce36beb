//! Co-simulation slaves, whatever the standard.
//!
//! A slave is short and reads from top to bottom: its values, its table of variables, its step. The table is the one
//! place where a variable exists: start value, reference, unit, access, model description and reset all derive from it.
//!
//! [`mod@unit`], [`variable`], [`instance`], [`clock`], [`course`] and [`log`] know nothing of bearings; [`plant`],
//! [`controller`] and [`estimator`] are the slaves of this project, listed in [`catalogue`].

pub mod clock;
pub mod controller;
pub mod course;
pub mod estimator;
pub mod instance;
pub mod log;
pub mod plant;
#[cfg(feature = "planted-panics")]
pub mod planted;
pub mod unit;
pub mod variable;

mod bearing;

pub use instance::{AnySlave, Capabilities, Kind};

/// All slaves of this project, in the order in which they are presented.
pub fn catalogue() -> [&'static Kind; 3] {
    [&plant::KIND, &controller::KIND, &estimator::KIND]
}

/// The slave of that model name, for instance `MagneticBearing`.
pub fn find(name: &str) -> Option<&'static Kind> {
    catalogue().into_iter().find(|kind| kind.name == name)
}
