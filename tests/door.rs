//! The C interface as an importer meets it, misused as carefully as used.

mod support;

use support::ffi::{Expect, Fmu};

#[test]
fn a_plant_can_be_made_stepped_and_freed() {
    let plant = Fmu::started("MagneticBearing", &[("Y0", 1e-5)]);
    assert_eq!(plant.get("Y"), 1e-5);
    plant.step(0.0, 1e-4).ok(&plant);
    assert!(plant.get("Z") > 0.0);
    plant.terminate().ok(&plant);
}
