//! A panic inside an FMU stays inside it: planted ones become fmi2Error or fmi3Error, and a reset recovers.
//! Run with `cargo test --features planted-panics --test panics --target-dir target/planted`; no other build has a place to plant one.

mod support;

use std::ptr::null_mut;

use fmu_export::fmi2::bindings::fmi2Status;
use fmu_export::fmi3::bindings::fmi3Status;
use fmu_export::planted::plant;
use support::MODELS;
use support::ffi::{Expect, Fmu};
use support::ffi3::{Fmu3, no_state};

#[track_caller]
fn told(fmu: &Fmu, status: fmi2Status, function: &str, place: &str) {
    let text = status.error(fmu);
    assert!(text.starts_with(&format!("{function}: a defect of this FMU")), "{text}");
    assert!(text.contains(&format!("planted in `{place}`")) && text.contains("after fmi2Reset"), "{text}");
    // The run is over, and the instance says so.
    let text = fmu.step(0.0, 1e-4).error(fmu);
    assert!(text.contains("not allowed in the state `error`"), "{text}");
    fmu.reset().ok(fmu);
}

/// Fails if the entry guard does not catch panics: then this process ends.
#[test]
fn a_panic_becomes_an_error_and_a_reset_recovers() {
    std::panic::set_hook(Box::new(|_| {}));
    for model in MODELS {
        let fresh = Fmu::new(model);
        let fmu = Fmu::new(model);
        fmu.enter_initialization().ok(&fmu);
        plant("get");
        let output = fmu.variables().iter().find(|variable| !variable.is_settable()).expect("an output");
        let status = fmu.get_reals(&[fmu.reference(&output.name)]).expect_err("an error");
        told(&fmu, status, "fmi2GetReal", "get");

        fmu.enter_initialization().ok(&fmu);
        plant("start");
        told(&fmu, fmu.exit_initialization(), "fmi2ExitInitializationMode", "start");

        fmu.start(0.0, None);
        plant("step");
        told(&fmu, fmu.step(0.0, 1e-4), "fmi2DoStep", "step");

        fmu.start(0.0, None);
        plant("save");
        let mut state = null_mut();
        told(&fmu, fmu.get_state(&mut state), "fmi2GetFMUstate", "save");
        assert!(state.is_null());

        fmu.start(0.0, None);
        plant("differentiate");
        let found = fmu.directional_derivative(&[], &[], &[]).expect_err("an error");
        told(&fmu, found, "fmi2GetDirectionalDerivative", "differentiate");

        // After all this the instance is a fresh one.
        for fmu in [&fresh, &fmu] {
            fmu.start(0.0, None);
            for step in 0..30 {
                fmu.step(f64::from(step) * 1e-4, 1e-4).ok(fmu);
            }
        }
        assert_eq!(fmu.all_bits(), fresh.all_bits(), "{model}");
    }
}

#[track_caller]
fn told3(fmu: &Fmu3, status: fmi3Status, function: &str, place: &str) {
    let text = fmu.error(status);
    assert!(text.starts_with(&format!("{function}: a defect of this FMU")), "{text}");
    assert!(text.contains(&format!("planted in `{place}`")) && text.contains("after fmi3Reset"), "{text}");
    // The run is over, and the instance says so.
    let text = fmu.error(fmu.step(0.0, 1e-4));
    assert!(text.contains("not allowed in the state `error`"), "{text}");
    fmu.ok(fmu.reset());
}

/// As above, through FMI 3.0.
#[test]
fn a_panic_becomes_an_error_of_fmi_3_and_a_reset_recovers() {
    std::panic::set_hook(Box::new(|_| {}));
    for model in MODELS {
        let (fresh, fmu) = (Fmu3::new(model, false), Fmu3::new(model, false));
        fmu.ok(fmu.enter_initialization(0.0, None));
        plant("get");
        let output = fmu.variables().iter().find(|variable| !variable.is_settable()).expect("an output");
        let status = fmu.get_floats(&[fmu.reference(&output.name)], 1).expect_err("an error");
        told3(&fmu, status, "fmi3GetFloat64", "get");

        fmu.ok(fmu.enter_initialization(0.0, None));
        plant("start");
        told3(&fmu, fmu.exit_initialization(), "fmi3ExitInitializationMode", "start");

        fmu.start(0.0);
        plant("step");
        told3(&fmu, fmu.step(0.0, 1e-4), "fmi3DoStep", "step");

        fmu.start(0.0);
        plant("save");
        let mut state = no_state();
        told3(&fmu, fmu.get_state(&mut state), "fmi3GetFMUState", "save");
        assert!(state.is_null());

        fmu.start(0.0);
        plant("differentiate");
        let found = fmu.directional_derivative(&[], &[], &[], 0).expect_err("an error");
        told3(&fmu, found, "fmi3GetDirectionalDerivative", "differentiate");

        // After all this the instance is a fresh one.
        for fmu in [&fresh, &fmu] {
            fmu.start(0.0);
            for step in 0..30 {
                fmu.ok(fmu.step(f64::from(step) * 1e-4, 1e-4));
            }
        }
        assert_eq!(fmu.all_bits(), fresh.all_bits(), "{model}");
    }
}

/// Other instances are not affected. Fails if the entry guard does not catch panics.
#[test]
fn a_panic_in_one_instance_is_none_in_another() {
    std::panic::set_hook(Box::new(|_| {}));
    for model in MODELS {
        let [fmu, neighbour, alone] = [0, 1, 2].map(|_| Fmu::started(model, &[]));
        for step in 0..20 {
            if step == 10 {
                plant("step");
                assert_eq!(fmu.step(f64::from(step) * 1e-4, 1e-4), fmi2Status::fmi2Error);
            } else if step < 10 {
                fmu.step(f64::from(step) * 1e-4, 1e-4).ok(&fmu);
            }
            neighbour.step(f64::from(step) * 1e-4, 1e-4).ok(&neighbour);
            alone.step(f64::from(step) * 1e-4, 1e-4).ok(&alone);
        }
        assert_eq!(neighbour.all_bits(), alone.all_bits());
        fmu.terminate().ok(&fmu);
    }
}
