//! The C interface as used and misused by importers.

mod errors;
mod messages;

use crate::prelude::*;
use std::ffi::CStr;
use std::thread;

use crate::call;
use crate::state::{bytes, restore};
use crate::support::ffi::{Message, guid, text};
use crate::support::sequence::{self, STATES, Subject, in_state, state_of};

/// The plant, for the sequence of calls.
const SUBJECT: Subject = Subject { model: PLANT, real: "omega", refused: ("m", -1.0), step_s: TS };

#[test]
fn every_function_is_swept() {
    sequence::every_function_is_swept();
}

#[test]
fn null_instances_are_refused_and_freed() {
    sequence::every_function_needs_an_instance(SUBJECT);
}

/// The one message of a refused instantiation.
fn refused(request: Request) -> String {
    let Err(messages) = request.instantiate(PLANT) else { panic!("an instance was made") };
    let [Message { status, category, text, .. }] = &messages[..] else { panic!("expected one message: {messages:?}") };
    assert_eq!((*status, category.as_str()), (fmi2Status::fmi2Error, "logStatusError"));
    assert!(text.starts_with("fmi2Instantiate: "), "{text}");
    text.clone()
}

/// Fails if the name, the type of interface, or the GUID is not checked.
#[test]
fn invalid_instantiation_requests_are_refused() {
    let sound = || Request::of(PLANT);
    assert_contains(&refused(Request { name: None, ..sound() }), &["instanceName", "expected a name"]);
    assert_contains(&refused(Request { name: Some(text("")), ..sound() }), &["instanceName", "expected a name"]);
    let exchange = fmi2Type::fmi2ModelExchange;
    assert_contains(&refused(Request { kind: exchange, ..sound() }), &["fmuType = 0", "fmi2CoSimulation"]);
    assert_contains(&refused(Request { kind: fmi2Type(7), ..sound() }), &["fmuType = 7", "fmi2CoSimulation"]);
    assert_contains(&refused(Request { guid: None, ..sound() }), &["fmuGUID is null"]);
    let refusal = refused(Request { guid: Some(text("{0}")), ..sound() });
    assert_contains(&refusal, &["fmuGUID = {0}", &guid(PLANT), "MagneticBearing", "AlgebraicEstimator"]);
    // Not UTF-8, a format string, long, without braces, in capitals.
    let bytes = std::ffi::CString::new([0xff, 0xfe]).expect("no zero byte");
    assert_contains(&refused(Request { guid: Some(bytes), ..sound() }), &["fmuGUID = \u{fffd}\u{fffd}", &guid(PLANT)]);
    let (long, own) = ("{".repeat(1_000_000), guid(PLANT));
    for given in ["%s%n%s", &long, &own.replace(['{', '}'], ""), &own.to_uppercase()] {
        let refusal = refused(Request { guid: Some(text(given)), ..sound() });
        assert_contains(&refusal, &[&format!("fmuGUID = {}", &given[..6])]);
    }
    // Without callbacks it cannot be reported, which must be harmless.
    assert!(Request { callbacks: false, ..sound() }.instantiate(PLANT).is_err_and(|messages| messages.is_empty()));
    let silent = Request { logger: false, guid: None, ..sound() };
    assert!(silent.instantiate(PLANT).is_err_and(|messages| messages.is_empty()));
}

/// Arguments that importers pass: names with paths, no resources, no logger.
/// Fails if a name with a slash is refused, or the location of the resources in any of its usual forms.
#[test]
fn unusual_instantiation_requests_are_accepted() {
    let long = "a/".repeat(100_000);
    for name in ["/a folder/MagneticBearing.fmu", "loop.plant", "Läufer µ", " ", "%s%n%d", &long] {
        let fmu = Request { name: Some(text(name)), ..Request::of(PLANT) }.instantiate(PLANT).expect("an instance");
        fmu.step(0.0, TS).error(&fmu);
        let again = fmu.step(0.0, TS);
        assert_eq!(again, fmi2Status::fmi2Error);
        assert_eq!(fmu.take_messages()[0].instance, name);
    }
    // A name in another encoding is returned unchanged in messages.
    let latin = std::ffi::CString::new(*b"L\xe4ufer").expect("no zero byte");
    let fmu = Request { name: Some(latin), ..Request::of(PLANT) }.instantiate(PLANT).expect("an instance");
    assert_eq!(fmu.step(0.0, TS), fmi2Status::fmi2Error);
    assert_eq!(fmu.take_messages()[0].instance, "L\u{fffd}ufer");
    let locations = ["file:/a/x", "file:///a/x", "file:////a/x/", "file:///a/b%20c", "nonsense", "", "%s%n"];
    for resources in locations.map(Some).into_iter().chain([None]) {
        let request = Request { resources: resources.map(text), ..Request::of(PLANT) };
        assert!(request.instantiate(PLANT).is_ok(), "{resources:?}");
    }
    let silent =
        Request { logger: false, logging: true, ..Request::of(PLANT) }.instantiate(PLANT).expect("an instance");
    assert_eq!(silent.step(0.0, TS), fmi2Status::fmi2Error);
    assert!(silent.take_messages().is_empty());
}

/// Fails if a reference beyond the table is treated as the last variable.
#[test]
fn unknown_references_are_refused() {
    for model in MODELS {
        let fmu = Fmu::started(model, &[]);
        for unknown in [fmu.variables().len() as u32, 100_000, u32::MAX] {
            let unknown = [unknown];
            let number = unknown[0].to_string();
            let words = ["no variable", number.as_str()];
            assert_contains(&fmu.get_reals(&unknown).expect_err("unknown").error(&fmu), &words);
            assert_contains(&fmu.get_integers(&unknown).expect_err("unknown").error(&fmu), &words);
            assert_contains(&fmu.get_booleans(&unknown).expect_err("unknown").error(&fmu), &words);
            assert_contains(&fmu.set_reals(&unknown, &[1.0]).error(&fmu), &words);
            assert_contains(&fmu.set_integers(&unknown, &[1]).error(&fmu), &words);
            assert_contains(&fmu.set_booleans(&unknown, &[1]).error(&fmu), &words);
        }
        assert_eq!(state_of(&fmu), 's', "{model}: a wrong reference does not end the run");
    }
}

/// Fails if fmi2GetReal converts other types.
#[test]
fn values_have_the_type_of_their_variable() {
    for model in MODELS {
        let fmu = Fmu::new(model);
        fmu.enter_initialization().ok(&fmu);
        for variable in fmu.variables().to_vec() {
            let reference = [fmu.reference(&variable.name)];
            let has_type = [
                matches!(variable.data_type, Type::Real { .. }),
                matches!(variable.data_type, Type::Integer { .. } | Type::Enumeration { .. }),
                matches!(variable.data_type, Type::Boolean { .. }),
            ];
            let read = [
                fmu.get_reals(&reference).is_ok(),
                fmu.get_integers(&reference).is_ok(),
                fmu.get_booleans(&reference).is_ok(),
            ];
            assert_eq!(read, has_type, "{model}.{}", variable.name);
            assert_eq!(fmu.take_messages().len(), 2, "{model}.{}: each refusal is reported", variable.name);
            let set: [(&str, &dyn Fn() -> fmi2Status); 3] = [
                ("Real", &|| fmu.set_reals(&reference, &[1.0])),
                ("Integer", &|| fmu.set_integers(&reference, &[1])),
                ("Boolean", &|| fmu.set_booleans(&reference, &[1])),
            ];
            for ((name, set), has_type) in set.iter().zip(has_type) {
                if variable.is_settable() && !has_type {
                    assert_contains(&set().error(&fmu), &[&variable.name, name]);
                }
            }
        }
    }
}

/// Fails if any non-zero value is treated as true.
#[test]
fn booleans_are_0_or_1() {
    let fmu = Fmu::started(CONTROLLER, &[]);
    let reference = [fmu.reference("lambdaValid")];
    for wrong in [2, -1, i32::MAX] {
        assert_contains(&fmu.set_booleans(&reference, &[wrong]).error(&fmu), &[&wrong.to_string(), "fmi2True"]);
        assert_eq!(fmu.get("lambdaValid"), 0.0);
    }
    fmu.set_booleans(&reference, &[fmi2True]).ok(&fmu);
    assert_eq!(fmu.get("lambdaValid"), 1.0);
}

/// Fails, by the end of this process, if null or an impossible length is accepted.
#[test]
fn null_and_impossible_arrays_are_refused() {
    let fmu = Fmu::started(PLANT, &[]);
    let c = fmu.component();
    let reference = [fmu.reference("omega")];
    let mut value = [1.0];
    // SAFETY: the instance is live; null pointers and impossible lengths are the test, and are checked before anything is read.
    unsafe {
        let get = |vr, n, to| call!(fmi2GetReal: fmi2GetRealTYPE(c, vr, n, to));
        let set = |vr, n, from| call!(fmi2SetReal: fmi2SetRealTYPE(c, vr, n, from));
        assert_contains(&get(null(), 1, value.as_mut_ptr()).error(&fmu), &["fmi2GetReal", "vr is null", "1 elements"]);
        assert_contains(&get(reference.as_ptr(), 1, null_mut()).error(&fmu), &["value is null"]);
        assert_contains(&set(null(), 3, value.as_ptr()).error(&fmu), &["fmi2SetReal", "vr is null", "3 elements"]);
        assert_contains(&set(reference.as_ptr(), 1, null()).error(&fmu), &["value is null"]);
        let impossible = get(reference.as_ptr(), usize::MAX, value.as_mut_ptr());
        assert_contains(&impossible.error(&fmu), &["vr", "more than memory"]);
        get(null(), 0, null_mut()).ok(&fmu);
        set(null(), 0, null()).ok(&fmu);

        let log = |n, names| call!(fmi2SetDebugLogging: fmi2SetDebugLoggingTYPE(c, fmi2True, n, names));
        assert_contains(&log(2, null()).error(&fmu), &["categories is null"]);
        let names: [fmi2String; 1] = [null()];
        assert_contains(&log(1, names.as_ptr()).error(&fmu), &["categories", "null"]);

        let kind = fmi2StatusKind::fmi2LastSuccessfulTime;
        let status = call!(fmi2GetRealStatus: fmi2GetRealStatusTYPE(c, kind, null_mut()));
        assert_contains(&status.error(&fmu), &["value is null"]);
    }
    assert_eq!(state_of(&fmu), 's');
}

/// Fails if values before the refused one are written.
#[test]
fn a_list_with_a_refused_value_writes_nothing() {
    let fmu = Fmu::started(PLANT, &[]);
    let references = ["pY", "m", "pZ"].map(|name| fmu.reference(name));
    let text = fmu.set_reals(&references, &[1.0, 2.0, 3.0]).error(&fmu);
    assert_contains(&text, &["m cannot be set", "fixed once the run has begun"]);
    assert_eq!((fmu.get("pY"), fmu.get("m"), fmu.get("pZ")), (0.0, 6.7, 0.0));
    assert_contains(&fmu.set("Y", 1.0).error(&fmu), &["Y cannot be set", "computed"]);
}

/// Fails if the start time is not checked, or if a stop before the start is accepted.
#[test]
fn invalid_start_and_stop_times_are_refused() {
    let fmu = Fmu::new(PLANT);
    for start in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        assert_contains(&fmu.setup(start, None).error(&fmu), &["startTime = ", "a finite number"]);
    }
    assert_contains(&fmu.setup(1.0, Some(0.5)).error(&fmu), &["stopTime = 0.5", "startTime = 1"]);
    assert_contains(&fmu.setup(1.0, Some(f64::NAN)).error(&fmu), &["stopTime = NaN"]);
    assert_eq!(state_of(&fmu), 'i');
    fmu.start(1.0, Some(f64::INFINITY));
}

/// Fails if a step of 0 s or of 1.1e-16 s is refused.
#[test]
fn steps_of_any_length_are_accepted() {
    for model in MODELS {
        let fmu = Fmu::started(model, &[]);
        let mut time_s = 0.0;
        for length_s in [TS, 1.1e-16, 0.0, TS / 3.0, 2.5 * TS, 0.009999999999999998, 1e-9] {
            fmu.step(time_s, length_s).ok(&fmu);
            time_s += length_s;
            assert!(fmu.take_messages().iter().all(|message| message.status == fmi2Status::fmi2OK), "{model}");
        }
    }
}

/// Fails if fmi2GetRealStatus accepts every status kind.
#[test]
fn status_queries_are_answered() {
    let fmu = Fmu::started(PLANT, &[]);
    fmu.step(0.0, TS).ok(&fmu);
    fmu.step(TS, TS).ok(&fmu);
    let c = fmu.component();
    let (mut status, mut time, mut whole, mut flag) = (fmi2Status::fmi2Pending, -1.0, -1, -1);
    let mut word: fmi2String = null();
    for kind in [0, 1, 2, 3, 9].map(fmi2StatusKind) {
        // SAFETY: the instance is live; the values outlive the calls.
        let answers = unsafe {
            [
                call!(fmi2GetStatus: fmi2GetStatusTYPE(c, kind, &raw mut status)),
                call!(fmi2GetRealStatus: fmi2GetRealStatusTYPE(c, kind, &raw mut time)),
                call!(fmi2GetIntegerStatus: fmi2GetIntegerStatusTYPE(c, kind, &raw mut whole)),
                call!(fmi2GetBooleanStatus: fmi2GetBooleanStatusTYPE(c, kind, &raw mut flag)),
                call!(fmi2GetStringStatus: fmi2GetStringStatusTYPE(c, kind, &raw mut word)),
            ]
        };
        let wanted = [
            kind == fmi2StatusKind::fmi2DoStepStatus,
            kind == fmi2StatusKind::fmi2LastSuccessfulTime,
            false,
            kind == fmi2StatusKind::fmi2Terminated,
            kind == fmi2StatusKind::fmi2PendingStatus,
        ];
        assert_eq!(answers.map(|answer| answer == fmi2Status::fmi2OK), wanted, "status kind {}", kind.0);
        let refusals = wanted.iter().filter(|wanted| !**wanted).count();
        assert_eq!(fmu.take_messages().len(), refusals, "status kind {}: each refusal is reported", kind.0);
    }
    assert_eq!((status, time, whole, flag), (fmi2Status::fmi2OK, 2.0 * TS, -1, fmi2False));
    // SAFETY: the text was returned, and ends with a zero byte.
    assert_eq!(unsafe { CStr::from_ptr(word) }, c"");
}

/// Fails if instances share their step count.
#[test]
fn instances_are_independent() {
    const STEPS: u32 = 120;
    for model in MODELS {
        let alone = Fmu::started(model, &[]);
        drive(&alone, 0..STEPS);
        let wanted = alone.all_bits();

        let one = Fmu::started(model, &[]);
        let other = Fmu::started(model, &[("m", 3.0)]);
        for step in 0..STEPS {
            drive(&one, step..step + 1);
            drive(&other, step..step + 1);
            if step == STEPS / 2 {
                other.reset().ok(&other);
                other.set("m", 4.0).ok(&other);
                other.start(f64::from(step + 1) * TS, None);
            }
        }
        assert_eq!(one.all_bits(), wanted, "{model}: in turn");
        assert_ne!(other.all_bits(), wanted, "{model}: the other one is another");
        assert!(one.take_messages().iter().all(|message| message.status == fmi2Status::fmi2OK));

        let runs: Vec<_> = (0..8)
            .map(|_| {
                let fmu = Fmu::started(model, &[]);
                thread::spawn(move || {
                    for step in 0..STEPS {
                        drive(&fmu, step..step + 1);
                        if step % 50 == 0 {
                            restore(&fmu, &bytes(&fmu));
                        }
                    }
                    fmu.all_bits()
                })
            })
            .collect();
        for run in runs {
            assert_eq!(run.join().expect("no panic"), wanted, "{model}: at the same time");
        }
    }
}
