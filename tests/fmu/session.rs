//! A session of an importer in a few calls, short enough for Miri, which looks at every access to memory that the C interface
//! makes: `cargo +nightly miri test --no-default-features --test fmu session::`. There is no logger, because Miri makes no variadic
//! calls.

use std::ptr::null_mut;

use crate::support::ffi::{Expect, Request};
use fmu_export::fmi2::bindings::{fmi2Status, fmi2StatusKind};

const TS: f64 = 1e-4;

/// Everything with a pointer in it, once. Fails, under Miri, if a snapshot is read after it was freed, if an instance is
/// accessed by two references at once, or if an array is taken to be longer than it is.
fn session(model: &str) {
    let make = || Request { logger: false, ..Request::of(model) }.instantiate(model).expect("an instance");
    let (fmu, other) = (make(), make());
    assert!(Request { logger: false, name: None, ..Request::of(model) }.instantiate(model).is_err());
    fmu.set_logging(true, &["logEvents", "logStatusError"]).ok(&fmu);
    assert_eq!(fmu.step(0.0, TS), fmi2Status::fmi2Error);
    if model == "AlgebraicEstimator" {
        fmu.set("Tf", 1e-3).ok(&fmu);
        fmu.set("epsilon", 1e-3).ok(&fmu);
    }
    fmu.start(0.0, Some(1.0));
    fmu.step(0.0, TS).ok(&fmu);
    let references: Vec<u32> = (0..4).collect();
    let _ = fmu.get_reals(&references);
    let input = if model == "MagneticBearing" { "pY" } else { "Ym" };
    fmu.set_input_derivatives(&[fmu.reference(input)], &[1], &[1e-3]).ok(&fmu);

    let mut state = null_mut();
    fmu.get_state(&mut state).ok(&fmu);
    let address = state;
    fmu.step(TS, 2.5 * TS).ok(&fmu);
    let wanted = fmu.get(input);
    let bytes = fmu.serialize(state).expect("bytes");
    let mut read = null_mut();
    other.deserialize(&bytes, &mut read).ok(&other);
    other.set_state(read).ok(&other);
    assert_eq!(other.deserialize(&bytes[1..], &mut read), fmi2Status::fmi2Error);
    other.step(TS, 2.5 * TS).ok(&other);
    assert_eq!(other.get(input), wanted);
    fmu.set_state(state).ok(&fmu);
    fmu.get_state(&mut state).ok(&fmu);
    assert_eq!(state, address);
    if model == "MagneticBearing" {
        let (unknown, known) = (fmu.reference("F[1]"), fmu.reference("i[1]"));
        fmu.directional_derivative(&[unknown], &[known], &[1.0]).expect("a derivative");
        fmu.output_derivatives(&[unknown], &[1]).expect("a derivative");
    }
    assert_eq!(fmu.real_status(fmi2StatusKind::fmi2LastSuccessfulTime), Ok(TS));
    assert!(fmu.real_status(fmi2StatusKind::fmi2Terminated).is_err());
    fmu.terminate().ok(&fmu);
    fmu.reset().ok(&fmu);
    // Any instance may free any snapshot.
    other.free_state(&mut state).ok(&other);
    fmu.free_state(&mut read).ok(&fmu);
    assert!(state.is_null() && read.is_null());
}

#[test]
fn sessions_end_well() {
    for model in ["MagneticBearing", "FlatnessController", "AlgebraicEstimator"] {
        session(model);
    }
}
