//! The C interface of FMI 3.0: the example `van_der_pol`, against the same model through FMI 2.0.

#[path = "../examples/van_der_pol.rs"]
#[allow(dead_code, reason = "`main` belongs to the program")]
mod library;
mod support;

use std::ffi::CStr;
use std::ptr::{null, null_mut};

use fmu_export::fmi3::bindings::*;
use support::abuse3::Abuse3;
use support::ffi::{Expect, Fmu};
use support::ffi3::{Fmu3, Request3, no_state};
use support::random::Random;
use support::sequence::Subject;
use support::sequence3;

const MODEL: &str = "VanDerPol";
const STEP_S: f64 = 0.01;

fn advance(fmu: &Fmu3, steps: std::ops::Range<u32>) {
    for step in steps {
        fmu.ok(fmu.step(f64::from(step) * STEP_S, STEP_S));
    }
}

/// Fails if a row of the table in `fmi3/sequence.rs` allows too much.
#[test]
fn calls_out_of_sequence_are_refused() {
    let subject = Subject { model: MODEL, real: "x", refused: ("mu", f64::NAN), step_s: STEP_S };
    sequence3::every_function_is_refused_in_all_other_states(subject);
}

/// Fails if the two interfaces do not work on the same model.
#[test]
fn the_run_is_that_of_fmi_2_bit_for_bit() {
    let (new, old) = (Fmu3::started(MODEL, &[("mu", 1.5)]), Fmu::started(MODEL, &[("mu", 1.5)]));
    for step in 0..500 {
        let time = f64::from(step) * STEP_S;
        let (status, done) = new.try_step(time, STEP_S);
        new.ok(status);
        assert_eq!((done.flags, done.time), ([0; 3], time + STEP_S));
        old.step(time, STEP_S).ok(&old);
        assert_eq!(new.all_bits(), old.all_bits(), "at {time} s");
        let last = new.reference("time");
        assert_eq!(new.get_floats(&[last], 1), Ok(vec![time + STEP_S]));
    }
    let [x, v, a] = ["x", "v", "a"].map(|name| new.reference(name));
    assert_eq!(
        new.directional_derivative(&[v, a], &[x, v], &[0.3, -0.7], 2),
        old.directional_derivative(&[v, a], &[x, v], &[0.3, -0.7]).map_err(|_| fmi3Status::fmi3Error),
    );
}

/// The serialized form is the same in both standards. Fails if a value is missing.
#[test]
fn snapshots_restore_every_bit_also_in_the_other_standard() {
    let fmu = Fmu3::started(MODEL, &[("mu", 1.5)]);
    advance(&fmu, 0..100);
    let mut state = no_state();
    fmu.ok(fmu.get_state(&mut state));
    let bytes = fmu.serialize(state).expect("bytes");
    advance(&fmu, 100..200);
    let wanted = fmu.all_bits();

    fmu.ok(fmu.set_state(state));
    advance(&fmu, 100..200);
    assert_eq!(fmu.all_bits(), wanted);
    let other = Fmu3::new(MODEL, false);
    let mut read = no_state();
    other.ok(other.deserialize(&bytes, &mut read));
    other.ok(other.set_state(read));
    advance(&other, 100..200);
    assert_eq!(other.all_bits(), wanted);
    assert_eq!(other.serialize(read).expect("bytes"), bytes);
    fmu.ok(fmu.free_state(&mut state));
    fmu.ok(fmu.free_state(&mut read));

    let old = Fmu::new(MODEL);
    let mut read = null_mut();
    old.deserialize(&bytes, &mut read).ok(&old);
    old.set_state(read).ok(&old);
    for step in 100..200 {
        old.step(f64::from(step) * STEP_S, STEP_S).ok(&old);
    }
    assert_eq!(old.all_bits(), wanted);
    old.free_state(&mut read).ok(&old);
}

/// Fails if FMI 2.0 restores event mode, which no function of it can leave.
#[test]
fn event_mode_is_unknown_to_the_other_standard() {
    let request = Request3 { logging: true, event_mode: true, ..Request3::of(MODEL, false) };
    let fmu = request.instantiate(MODEL, false).expect("an instance");
    fmu.start(0.0);
    let mut state = no_state();
    fmu.ok(fmu.get_state(&mut state));
    let bytes = fmu.serialize(state).expect("bytes");
    fmu.ok(fmu.free_state(&mut state));
    let old = Fmu::new(MODEL);
    let mut read = null_mut();
    old.deserialize(&bytes, &mut read).ok(&old);
    assert!(old.set_state(read).error(&old).contains("of another version of FMI"));
    old.free_state(&mut read).ok(&old);
}

/// Fails if initialization does not lead to event mode, or if event mode is entered though it was not requested.
#[test]
fn event_mode_is_used_if_it_was_requested() {
    let request = Request3 { logging: true, event_mode: true, ..Request3::of(MODEL, false) };
    let fmu = request.instantiate(MODEL, false).expect("an instance");
    fmu.start(0.0);
    assert!(fmu.error(fmu.step(0.0, STEP_S)).contains("in the state `event mode`"));
    fmu.ok(fmu.update_discrete_states());
    fmu.ok(fmu.enter_step_mode());
    fmu.ok(fmu.step(0.0, STEP_S));
    fmu.ok(fmu.enter_event_mode());
    fmu.ok(fmu.update_discrete_states());
    fmu.ok(fmu.enter_step_mode());
    fmu.ok(fmu.step(STEP_S, STEP_S));
    let without = Fmu3::started(MODEL, &[]);
    assert!(without.error(without.enter_event_mode()).contains("eventModeUsed = fmi3False"));
    // The request survives a reset.
    fmu.ok(fmu.reset());
    fmu.start(0.0);
    assert!(fmu.error(fmu.step(0.0, STEP_S)).contains("in the state `event mode`"));
}

unsafe extern "C" fn keep(environment: fmi3InstanceEnvironment, status: fmi3Status, _: fmi3String, text: fmi3String) {
    assert_eq!(status, fmi3Status::fmi3Error);
    // SAFETY: the environment is the list of the test below; the text ends with a zero byte.
    let (list, text) = unsafe { (&mut *environment.cast::<Vec<String>>(), CStr::from_ptr(text)) };
    list.push(text.to_string_lossy().into_owned());
}

/// Fails if another interface type gives an instance, or if there is no message.
#[test]
fn other_interface_types_are_refused_with_a_message() {
    let mut messages: Vec<String> = Vec::new();
    let (name, token) = (c"it", support::ffi::text(&support::ffi3::token(MODEL, false)));
    let environment = (&raw mut messages).cast();
    // SAFETY: the texts live until the calls return; the environment belongs to the logger.
    let made = unsafe {
        [
            call3!(fmi3InstantiateModelExchange: fmi3InstantiateModelExchangeTYPE(
                name.as_ptr(), token.as_ptr(), null(), 0, 0, environment, Some(keep)
            )),
            call3!(fmi3InstantiateScheduledExecution: fmi3InstantiateScheduledExecutionTYPE(
                name.as_ptr(), token.as_ptr(), null(), 0, 0, environment, Some(keep), None, None, None
            )),
        ]
    };
    assert!(made.iter().all(|instance| instance.is_null()));
    let [exchange, scheduled] = &messages[..] else { panic!("{messages:?}") };
    assert!(exchange.starts_with("fmi3InstantiateModelExchange: ") && exchange.contains("fmi3InstantiateCoSimulation"));
    assert!(scheduled.starts_with("fmi3InstantiateScheduledExecution: "));
}

/// Fails if a token of FMI 2.0 is accepted, or if the message does not list the accepted ones.
#[test]
fn a_foreign_token_is_refused() {
    let guid = support::ffi::guid(MODEL);
    let request = Request3 { token: Some(support::ffi::text(&guid)), ..Request3::of(MODEL, false) };
    let Err(messages) = request.instantiate(MODEL, false) else { panic!("it was accepted") };
    let [message] = &messages[..] else { panic!("{messages:?}") };
    assert!(message.text.contains(&guid) && message.text.contains(&support::ffi3::token(MODEL, false)));
}

/// Random calls with random arguments; see `support/abuse3.rs`.
#[test]
fn random_calls_never_break_an_instance() {
    let mut served = 0;
    for seed in 1..=50 {
        let mut abuse = Abuse3::new(Random::new(seed));
        while abuse.calls < 2000 {
            abuse.step().expect("random bytes do not end");
        }
        served += abuse.served;
    }
    assert!(served > 30_000, "{served} of 100,000 calls were served");
}
