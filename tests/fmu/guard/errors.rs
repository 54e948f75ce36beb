//! Errors that end the initialization or a run.

use super::*;

/// Fails if only the first finding is reported, or if the run can begin nevertheless.
#[test]
fn refused_parameters_end_the_initialization_with_all_their_names() {
    let bad: [(&str, &[(&str, f64)]); 3] = [
        (PLANT, &[("m", 0.0), ("s", -1.0), ("lambda[2]", -1e-6), ("sensor.Ts", 0.0)]),
        (CONTROLLER, &[("m", -1.0), ("Ts", 0.0), ("bandwidth.observer", -1.0)]),
        ("AlgebraicEstimator", &[("m", -1.0), ("tolerance.s", -1e-6)]),
    ];
    for (model, values) in bad {
        let fmu = Fmu::new(model);
        for (name, value) in values {
            fmu.set(name, *value).ok(&fmu);
        }
        let text = fmu.initialize(0.0, None).error(&fmu);
        assert_contains(&text, &["fmi2ExitInitializationMode", "expected"]);
        for (name, _) in values {
            assert_contains(&text, &[&format!("{name} = ")]);
        }
        assert_eq!(state_of(&fmu), 'e', "{model}");
        fmu.reset().ok(&fmu);
        fmu.start(0.0, None);
        fmu.step(0.0, TS).ok(&fmu);
    }
}

/// Drives the rotor into a magnet; returns the time of the failed step, and the message.
fn crash(fmu: &Fmu) -> (f64, String) {
    fmu.set("pZ", -1e5).ok(fmu);
    for step in 0..100 {
        let time_s = f64::from(step) * TS;
        let status = fmu.step(time_s, TS);
        if status != fmi2Status::fmi2OK {
            return (time_s, status.error(fmu));
        }
    }
    panic!("the rotor stays in the gap");
}

/// Fails if the run continues after the error, or if a reset leaves any state.
#[test]
fn an_error_in_a_step_ends_the_run_and_a_reset_allows_another() {
    let fmu = Fmu::started(PLANT, &[]);
    let (time_s, text) = crash(&fmu);
    assert_contains(&text, &["fmi2DoStep", "leaves the gap", "magnet 1"]);
    assert_eq!(state_of(&fmu), 'e');
    let (mut status, kind) = (fmi2Status::fmi2OK, fmi2StatusKind::fmi2DoStepStatus);
    // SAFETY: the instance is live; the status outlives the call.
    unsafe { call!(fmi2GetStatus: fmi2GetStatusTYPE(fmu.component(), kind, &raw mut status)) }.ok(&fmu);
    assert_eq!(status, fmi2Status::fmi2Error);
    assert_eq!(fmu.real_status(fmi2StatusKind::fmi2LastSuccessfulTime), Ok(time_s));
    // Computed values can still be read and are finite.
    assert!(fmu.all_bits().into_iter().all(|bits| f64::from_bits(bits).is_finite()));
    fmu.step(time_s, TS).error(&fmu);

    fmu.reset().ok(&fmu);
    fmu.start(0.0, None);
    let fresh = Fmu::started(PLANT, &[]);
    for step in 0..20 {
        for fmu in [&fmu, &fresh] {
            fmu.set("i[2]", 0.3).ok(fmu);
            fmu.step(f64::from(step) * TS, TS).ok(fmu);
        }
    }
    assert_eq!(fmu.all_bits(), fresh.all_bits());
}

/// Fails if fmi2Terminate is refused after an error.
#[test]
fn instances_can_be_ended_after_an_error() {
    let terminated = Fmu::started(PLANT, &[]);
    crash(&terminated);
    terminated.terminate().ok(&terminated);
    terminated.terminate().error(&terminated);
    drop(terminated);
    let freed = Fmu::started(PLANT, &[]);
    crash(&freed);
    drop(freed);
    // Freed in every other state.
    for (state, _) in STATES {
        drop(in_state(SUBJECT, state));
    }
}

/// A missing sensor is no error for the estimator; plant and controller cannot continue without their inputs.
/// Fails if plant and controller compute with non-finite inputs.
#[test]
fn non_finite_inputs_fail_the_step_or_invalidate_the_estimate() {
    for (model, name) in [(PLANT, "i[2]"), (PLANT, "omega"), ("FlatnessController", "Zm")] {
        let fmu = Fmu::started(model, &[]);
        fmu.set(name, f64::NAN).ok(&fmu);
        assert_contains(&fmu.step(0.0, TS).error(&fmu), &["fmi2DoStep", name, "NaN"]);
    }
    let fmu = Fmu::started("AlgebraicEstimator", &[]);
    for name in ["Ym", "im[3]", "theta"] {
        fmu.set(name, f64::NAN).ok(&fmu);
    }
    fmu.step(0.0, TS).ok(&fmu);
    assert_eq!(fmu.get("valid"), 0.0, "a missing sample gives no valid estimate");
    assert_eq!(fmu.get("lambdaHat[1]"), 4e-6);
}
