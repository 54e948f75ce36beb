//! The equations: geometry, force law, coils, backup bearing, plant, controller, estimation.

#[path = "../support/five_axes.rs"]
mod five_axes;
#[path = "../support/rotor.rs"]
mod rotor;
#[path = "../support/mod.rs"]
mod support;

mod coil;
mod controller;
mod estimation;
mod four_axes;
mod four_magnets;
mod kernel;
mod linearisation;
mod magnet;
mod paper;
mod plant;
mod prelude;
mod reference;
mod sensitivity;
mod sensor;
mod spindle;
mod spindle_estimation;
mod touchdown;
