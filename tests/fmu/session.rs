//! A session of an importer, short enough for Miri, which checks every memory access of the C interface:
//! `cargo +nightly miri test --no-default-features --test fmu session::`. There is no logger, because Miri supports no variadic
//! calls.

use crate::prelude::*;

/// Every function with a pointer argument, once, after some steps. Fails if an existing snapshot is not overwritten, or is leaked; under
/// Miri also if a snapshot is read after it was freed, if an instance is accessed through two references at once, or if
/// an array is read beyond its end.
pub fn session(model: &str, steps: u32) {
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
    for step in 0..steps {
        fmu.step(f64::from(step) * TS, TS).ok(&fmu);
    }
    let now = f64::from(steps) * TS;
    let references: Vec<u32> = (0..4).collect();
    let _ = fmu.get_reals(&references);
    let input = &inputs(&fmu)[..1];
    fmu.set_input_derivatives(input, &[1], &[1e-3]).ok(&fmu);

    let mut state = null_mut();
    fmu.get_state(&mut state).ok(&fmu);
    let address = state;
    fmu.step(now, 2.5 * TS).ok(&fmu);
    let wanted = fmu.get_reals(input);
    let bytes = fmu.serialize(state).expect("bytes");
    let mut read = null_mut();
    other.deserialize(&bytes, &mut read).ok(&other);
    other.set_state(read).ok(&other);
    assert_eq!(other.deserialize(&bytes[1..], &mut read), fmi2Status::fmi2Error);
    other.step(now, 2.5 * TS).ok(&other);
    assert_eq!(other.get_reals(input), wanted);
    // An existing snapshot is overwritten.
    fmu.get_state(&mut state).ok(&fmu);
    assert_eq!(state, address);
    fmu.step(now + 2.5 * TS, TS).ok(&fmu);
    fmu.set_state(state).ok(&fmu);
    if is_plant(model) {
        let of = if model.contains("Spindle") { "A." } else { "" };
        let [unknown, known] = ["F[1]", "i[1]"].map(|name| fmu.reference(&format!("{of}{name}")));
        fmu.directional_derivative(&[unknown], &[known], &[1.0]).expect("a derivative");
        fmu.output_derivatives(&[unknown], &[1]).expect("a derivative");
    }
    assert_eq!(fmu.real_status(fmi2StatusKind::fmi2LastSuccessfulTime), Ok(now + 2.5 * TS), "{model}");
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
        session(model, 1);
    }
}
