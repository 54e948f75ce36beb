//! Snapshots: restored across instances and processes, and refused if damaged.

use crate::prelude::*;
use std::process::Command;

/// Settings that make every part of a state change: noise, delay, voltage drive, unbalance, a short window.
fn active_settings(model: &str) -> Vec<(&'static str, f64)> {
    let of_sensors =
        [("sensor.positionNoise", 1e-7), ("sensor.currentNoise", 1e-2), ("sensor.delay", 1.5e-4), ("drive", 2.0)];
    let planes = [("unbalance[1].magnitude", 1e-4), ("unbalance[2].magnitude", 5e-5)];
    let update = [("update.mode", 3.0), ("lambdaValid", 1.0)];
    match model.trim_end_matches('4') {
        "AxialBearing" => of_sensors.to_vec(),
        "MagneticBearing" => [&of_sensors[..], &[("unbalance.magnitude", 1e-4)]].concat(),
        "MagneticSpindle" => [&of_sensors[..], &planes].concat(),
        "FlatnessController" | "AxialController" => update.to_vec(),
        "SpindleController" => {
            let moving = [("F0.modulation", 0.5), ("X.reference.amplitude", 2e-5), ("reference.rampTime", 0.01)];
            [&update[..], &moving].concat()
        }
        _ if model == "AlgebraicEstimator" => vec![("Tf", 2e-3), ("epsilon", 2e-3)],
        _ => Vec::new(),
    }
}

fn running(model: &str, steps: u32) -> Fmu {
    let fmu = Fmu::started(model, &active_settings(model));
    drive(&fmu, 0..steps);
    fmu
}

fn snapshot(fmu: &Fmu) -> fmi2FMUstate {
    let mut state = null_mut();
    fmu.get_state(&mut state).ok(fmu);
    assert!(!state.is_null());
    state
}

fn free(fmu: &Fmu, mut state: fmi2FMUstate) {
    fmu.free_state(&mut state).ok(fmu);
    assert!(state.is_null());
    fmu.free_state(&mut state).ok(fmu);
}

pub fn bytes(fmu: &Fmu) -> Vec<u8> {
    let state = snapshot(fmu);
    let bytes = fmu.serialize(state).expect("bytes");
    free(fmu, state);
    bytes
}

/// Restores the state that these bytes hold.
pub fn restore(fmu: &Fmu, written: &[u8]) {
    let mut state = null_mut();
    fmu.deserialize(written, &mut state).ok(fmu);
    fmu.set_state(state).ok(fmu);
    free(fmu, state);
}

/// Importers restore although they have declared, as the harness does with every step, that they would not.
/// Fails if only the values are restored, but not, for instance, the noise or the window.
#[test]
fn a_run_replays_bit_for_bit_from_any_snapshot_in_any_order() {
    for model in MODELS {
        let fmu = running(model, 35);
        let mut snapshots = Vec::new();
        let mut traces = Vec::new();
        for step in 35..75 {
            snapshots.push(snapshot(&fmu));
            drive(&fmu, step..step + 1);
            traces.push(fmu.all_bits());
        }
        let other = Fmu::new(model);
        for from in [39_usize, 0, 17, 3, 17, 38] {
            // Into the same instance, and into one that was never started.
            for fmu in [&fmu, &other] {
                fmu.set_state(snapshots[from]).ok(fmu);
                for (step, trace) in traces.iter().enumerate().skip(from) {
                    drive(fmu, 35 + step as u32..36 + step as u32);
                    assert_eq!(fmu.all_bits(), *trace, "{model}: from {from} to {step}");
                }
            }
        }
        // A snapshot outlives its instance. Another instance can free it, even after its run has ended.
        drop(fmu);
        let another = Fmu::new(model);
        for fmu in [&other, &another] {
            fmu.set_state(snapshots[39]).ok(fmu);
            drive(fmu, 74..75);
            assert_eq!(fmu.all_bits(), traces[39], "{model}: after the end of the first instance");
        }
        other.terminate().ok(&other);
        snapshots.into_iter().for_each(|state| free(&other, state));
    }
}

/// Parameters may be outside their limits until they are used.
#[test]
fn a_snapshot_before_the_run_restores_all_parameters() {
    let fmu = Fmu::new("MagneticBearing");
    fmu.set("m", -1.0).ok(&fmu);
    let written = bytes(&fmu);
    let other = Fmu::new("MagneticBearing");
    restore(&other, &written);
    assert_eq!(bytes(&other), written);
    let text = other.initialize(0.0, None).error(&other);
    assert!(text.contains("m = -1 kg is refused"), "{text}");
}

/// Fails if the state in the sequence of calls is not part of the snapshot.
#[test]
fn the_state_in_the_sequence_of_calls_is_restored() {
    let fmu = Fmu::new("MagneticBearing");
    fmu.set("Y0", 1e-5).ok(&fmu);
    let instantiated = snapshot(&fmu);
    fmu.setup(0.5, Some(1.0)).ok(&fmu);
    fmu.enter_initialization().ok(&fmu);
    let initializing = snapshot(&fmu);
    fmu.exit_initialization().ok(&fmu);
    fmu.step(0.5, 1e-3).ok(&fmu);
    let stepped = snapshot(&fmu);
    fmu.terminate().ok(&fmu);
    let terminated = snapshot(&fmu);

    fmu.set_state(stepped).ok(&fmu);
    assert!(fmu.step(0.5, 1e-3).error(&fmu).contains("0.501"));
    fmu.step(0.501, 1e-3).ok(&fmu);
    assert!(fmu.step(0.502, 0.6).error(&fmu).contains("stopTime = 1"));
    fmu.set_state(terminated).ok(&fmu);
    assert!(fmu.step(0.501, 1e-3).error(&fmu).contains("terminated"));
    fmu.set_state(initializing).ok(&fmu);
    fmu.set("Y0", 2e-5).ok(&fmu);
    fmu.exit_initialization().ok(&fmu);
    assert_eq!(fmu.get("Y"), 2e-5);
    fmu.step(0.5, 1e-3).ok(&fmu);
    fmu.set_state(instantiated).ok(&fmu);
    fmu.setup(0.0, None).ok(&fmu);
    fmu.enter_initialization().ok(&fmu);
    assert_eq!(fmu.get("Y"), 1e-5);
    for state in [instantiated, initializing, stepped, terminated] {
        free(&fmu, state);
    }
}

/// A failed run continues from before the failure. Fails if the state `error` survives fmi2SetFMUstate.
#[test]
fn a_snapshot_from_before_an_error_recovers() {
    let fmu = Fmu::started("MagneticBearing", &[]);
    fmu.step(0.0, 1e-4).ok(&fmu);
    let state = snapshot(&fmu);
    fmu.set("pZ", 1e9).ok(&fmu);
    assert_eq!(fmu.step(1e-4, 1.0), fmi2Status::fmi2Error);
    fmu.take_messages();
    assert!(fmu.step(1e-4, 1e-4).error(&fmu).contains("state `error`"));
    // A snapshot of the failed instance restores the failure.
    let failed = snapshot(&fmu);
    fmu.set_state(failed).ok(&fmu);
    assert!(fmu.step(1e-4, 1e-4).error(&fmu).contains("state `error`"));
    fmu.set_state(state).ok(&fmu);
    fmu.step(1e-4, 1e-4).ok(&fmu);
    free(&fmu, state);
    free(&fmu, failed);
}

#[test]
fn null_and_foreign_snapshots_are_refused() {
    let plant = Fmu::started("MagneticBearing", &[]);
    assert!(plant.set_state(null_mut()).error(&plant).contains("fmi2SetFMUstate: FMUstate is null"));
    assert!(plant.serialize(null_mut()).expect_err("an error").error(&plant).contains("FMUstate is null"));
    let controller = Fmu::started("FlatnessController", &[]);
    let mut state = snapshot(&controller);
    let text = plant.set_state(state).error(&plant);
    assert!(text.contains("a snapshot of FlatnessController: expected one of MagneticBearing"), "{text}");
    assert_eq!(plant.get_state(&mut state), fmi2Status::fmi2Error);
    plant.take_messages();
    controller.set_state(state).ok(&controller);
    free(&plant, state);
}

/// Fails if a snapshot lacks the input derivatives set for the next step, or those at the end of the last one, on which the
/// derivatives of outputs depend.
#[test]
fn input_derivatives_are_saved() {
    let fmu = Fmu::started("MagneticBearing", &[]);
    fmu.set_input_derivatives(&[fmu.reference("pZ")], &[1], &[5e3]).ok(&fmu);
    let written = bytes(&fmu);
    fmu.step(0.0, 1e-3).ok(&fmu);
    let other = Fmu::new("MagneticBearing");
    restore(&other, &written);
    other.step(0.0, 1e-3).ok(&other);
    assert_eq!(fmu.all_bits(), other.all_bits());
    assert_eq!(fmu.get("pZ"), 5.0);
    let rate = |fmu: &Fmu| fmu.output_derivatives(&[fmu.reference("perturbation.Z")], &[1]).expect("a derivative");
    assert_eq!(rate(&fmu), [5e3]);
    restore(&other, &bytes(&fmu));
    assert_eq!(rate(&other), [5e3], "the load moves on as it did");
}

const CHILD: &str = "MAGNETIC_BEARING_STATE_TEST";

/// The other process of the test below: continues from the files in the folder named by the environment and prints the results.
#[test]
fn another_process() {
    let Ok(folder) = std::env::var(CHILD) else { return };
    for model in MODELS {
        let written = std::fs::read(Path::new(&folder).join(model)).expect("the bytes");
        let fmu = Fmu::new(model);
        restore(&fmu, &written);
        assert_eq!(bytes(&fmu), written, "{model}");
        drive(&fmu, 33..60);
        println!("{:?}", fmu.all_bits());
    }
}

/// Fails if anything that a run needs is not serialized, or if the bytes depend on the process, such as an address.
#[test]
fn bytes_restore_the_run_in_another_process() {
    let folder = std::env::temp_dir().join(format!("magnetic-bearing-state-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a temporary folder");
    let wanted = MODELS.map(|model| {
        let fmu = running(model, 33);
        let written = bytes(&fmu);
        assert_eq!(written, bytes(&fmu), "{model}: the same snapshot, the same bytes");
        std::fs::write(folder.join(model), written).expect("a temporary file");
        drive(&fmu, 33..60);
        format!("{:?}", fmu.all_bits())
    });
    let program = std::env::current_exe().expect("this program");
    let child =
        Command::new(program).args(["state::another_process", "--exact", "--nocapture"]).env(CHILD, &folder).output();
    std::fs::remove_dir_all(folder).expect("the temporary folder");
    let child = child.expect("another process");
    let printed = String::from_utf8_lossy(&child.stdout);
    assert!(child.status.success(), "{printed}\n{}", String::from_utf8_lossy(&child.stderr));
    for (model, wanted) in MODELS.into_iter().zip(wanted) {
        assert!(printed.contains(&wanted), "{model}: another run in another process");
    }
}

#[track_caller]
fn refused(fmu: &Fmu, bytes: &[u8]) -> String {
    let mut state = null_mut();
    let text = fmu.deserialize(bytes, &mut state).error(fmu);
    assert!(state.is_null());
    text
}

/// Fails if the hash or the length is not checked.
#[test]
fn damaged_bytes_are_refused_with_a_reason() {
    let fmu = running("MagneticBearing", 5);
    let written = bytes(&fmu);
    assert!(refused(&fmu, b"").contains("end too early"));
    assert!(refused(&fmu, b"PK\x03\x04 this is something else").contains("do not begin with FMU2SNAP"));
    for length in 0..written.len() {
        assert!(refused(&fmu, &written[..length]).contains("end too early"), "{length} bytes");
    }
    let mut longer = written.clone();
    longer.push(0);
    assert!(refused(&fmu, &longer).contains("1 bytes are left over"));
    for at in 0..written.len() {
        for bit in [1, 0x80] {
            let mut changed = written.clone();
            changed[at] ^= bit;
            let text = refused(&fmu, &changed);
            assert!(!text.contains("defect"), "byte {at}: {text}");
        }
    }
    let mut version = written.clone();
    version[8] = 2;
    assert!(refused(&fmu, &version).contains("version 2 of the format: expected version 5"));
    let estimator = Fmu::new("AlgebraicEstimator");
    let text = refused(&estimator, &written);
    assert!(text.contains("the model MagneticBearing: expected AlgebraicEstimator"), "{text}");
    // The instance is unharmed.
    drive(&fmu, 5..6);
}

/// The bytes before the length of the content, and the content.
fn split<'w>(model: &str, written: &'w [u8]) -> (&'w [u8], &'w [u8]) {
    let head = 8 + 2 + 1 + model.len() + 1 + 38;
    (&written[..head], &written[head + 8..written.len() - 32])
}

/// A content in a valid frame.
fn sealed(head: &[u8], content: &[u8]) -> Vec<u8> {
    let framed = [head, &(content.len() as u64).to_le_bytes(), content].concat();
    [&framed[..], &Sha256::digest(&framed)].concat()
}

/// An invalid content in a valid frame must not cause panics, hangs, or excessive memory.
/// Fails if the window, the sample count, the state of the rotor, or the derivatives of inputs are accepted unchecked.
#[test]
fn a_hostile_content_in_a_valid_frame_does_no_harm() {
    for model in MODELS {
        let fmu = running(model, 25);
        fmu.set_input_derivatives(&inputs(&fmu)[..1], &[1], &[1e-3]).ok(&fmu);
        let written = bytes(&fmu);
        let (head, content) = split(model, &written);
        assert_eq!(sealed(head, content), written);
        let mut accepted = 0;
        let mut attack = |changed: &[u8]| {
            let mut state = null_mut();
            let status = fmu.deserialize(&sealed(head, changed), &mut state);
            let messages = fmu.take_messages();
            assert!(messages.iter().all(|message| !message.text.contains("defect")), "{messages:?}");
            if status == fmi2Status::fmi2OK {
                accepted += 1;
                let other = Fmu::new(model);
                other.set_state(state).ok(&other);
                for step in 25..28 {
                    let _ = other.step(f64::from(step) * 1e-4, 1e-4);
                }
                let messages = other.take_messages();
                assert!(messages.iter().all(|message| !message.text.contains("defect")), "{messages:?}");
                free(&fmu, state);
            }
        };
        // Times and parameters come first, the run last: every byte of these, and some of those between.
        let every = 1 + content.len() / 500;
        for at in (0..content.len()).filter(|at| at % every == 0 || *at < 600 || *at + 600 > content.len()) {
            for value in [0, 1, 0x7f, 0x80, 0xff] {
                let mut changed = content.to_vec();
                changed[at] = value;
                attack(&changed);
            }
            // The largest length: ten bytes of seven bits each.
            let mut changed = content.to_vec();
            let end = (at + 10).min(content.len());
            changed[at..end].copy_from_slice(&[0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0x01][..end - at]);
            attack(&changed);
            attack(&content[..at]);
        }
        assert!(accepted > 0, "{model}: some changes make another run, which only the hash can detect");
    }
}

/// A valid frame whose state contradicts the run. Fails if the state is accepted unchecked.
#[test]
fn a_state_that_contradicts_the_run_is_refused() {
    for (model, begun) in MODELS.into_iter().flat_map(|model| [(model, false), (model, true)]) {
        let fmu = if begun { running(model, 5) } else { Fmu::new(model) };
        let written = bytes(&fmu);
        let (head, content) = split(model, &written);
        // The content begins with the state, one of five bits: instantiated, initialization, step complete, terminated, error.
        assert_eq!(content[0], if begun { 0b100 } else { 1 }, "{model}");
        for (state, wants) in [(1, Some(false)), (2, Some(false)), (4, Some(true)), (8, None), (16, None)] {
            let changed = sealed(head, &[&[state], &content[1..]].concat());
            let mut found = null_mut();
            let status = fmu.deserialize(&changed, &mut found);
            if wants.is_some_and(|wants| wants != begun) {
                assert!(status.error(&fmu).contains("does not belong to the state"), "{model}: {begun}, {state}");
            } else {
                status.ok(&fmu);
                free(&fmu, found);
            }
        }
        assert!(fmu.take_messages().is_empty());
    }
}

/// Fails if a reset misses anything: a value, the flag for stale outputs, the derivatives of inputs, the stop time.
#[test]
fn a_reset_instance_equals_a_fresh_one_to_the_last_byte() {
    for model in MODELS {
        let fresh = bytes(&Fmu::new(model));
        let fmu = Fmu::new(model);
        for variable in fmu.variables().to_vec().iter().filter(|variable| variable.is_settable()) {
            let value = match &variable.data_type {
                Type::Real { start, .. } => start + 1.0,
                Type::Boolean { start } => f64::from(u8::from(!start)),
                _ if variable.start().as_f64() == 1.0 => 2.0,
                _ => 1.0,
            };
            fmu.set(&variable.name, value).ok(&fmu);
        }
        assert_ne!(bytes(&fmu), fresh, "{model}");
        fmu.reset().ok(&fmu);
        assert_eq!(bytes(&fmu), fresh, "{model}, with other values");
        let fmu = running(model, 30);
        fmu.reset().ok(&fmu);
        assert_eq!(bytes(&fmu), fresh, "{model}");
        fmu.setup(0.3, Some(1.0)).ok(&fmu);
        fmu.enter_initialization().ok(&fmu);
        fmu.all_bits();
        fmu.reset().ok(&fmu);
        assert_eq!(bytes(&fmu), fresh, "{model}, out of the initialization");
        fmu.start(0.0, None);
        fmu.set_input_derivatives(&inputs(&fmu)[..1], &[2], &[1.0]).ok(&fmu);
        fmu.reset().ok(&fmu);
        assert_eq!(bytes(&fmu), fresh, "{model}, with a derivative of an input");
    }
}
