//! The example `van_der_pol` through the C interface: sequence of calls, snapshots, derivatives, abuse.

#[path = "../examples/van_der_pol.rs"]
#[allow(dead_code, reason = "`main` belongs to the program")]
mod library;
mod support;

use std::ptr::null_mut;

use fmu_export::fmi2::bindings::fmi2Status;
use support::abuse::Abuse;
use support::ffi::{Expect, Fmu};
use support::random::Random;
use support::sequence::{self, Subject};

const MODEL: &str = "VanDerPol";
const STEP_S: f64 = 0.01;

fn advance(fmu: &Fmu, steps: std::ops::Range<u32>) {
    for step in steps {
        fmu.step(f64::from(step) * STEP_S, STEP_S).ok(fmu);
    }
}

/// Fails if a row of the table in `fmi2/sequence.rs` allows too much, or if a parameter accepts NaN.
#[test]
fn calls_out_of_sequence_are_refused() {
    let subject = Subject { model: MODEL, real: "x", refused: ("mu", f64::NAN), step_s: STEP_S };
    sequence::every_function_is_refused_in_all_other_states(subject);
}

/// Without damping the oscillator is `x = 2 cos t`. Fails if a step is lost or doubled.
#[test]
fn the_solution_without_damping_is_a_cosine() {
    let fmu = Fmu::started(MODEL, &[("mu", 0.0)]);
    advance(&fmu, 0..2000);
    // The method is of order 4: 20 s × (1 ms)⁴ / 120 × 2 is 3e-13, rounding over 20,000 steps some 1e-12.
    assert!((fmu.get("x") - 2.0 * 20.0_f64.cos()).abs() < 1e-11, "{}", fmu.get("x"));
    assert!((fmu.get("v") + 2.0 * 20.0_f64.sin()).abs() < 1e-11, "{}", fmu.get("v"));
}

/// The same bits from a snapshot in memory, from bytes, in another instance, and after a reset. Fails if a value is missing.
#[test]
fn snapshots_and_resets_restore_every_bit() {
    let fmu = Fmu::started(MODEL, &[("mu", 1.5)]);
    advance(&fmu, 0..100);
    let mut state = null_mut();
    fmu.get_state(&mut state).ok(&fmu);
    let bytes = fmu.serialize(state).expect("bytes");
    advance(&fmu, 100..200);
    let wanted = fmu.all_bits();

    fmu.set_state(state).ok(&fmu);
    advance(&fmu, 100..200);
    assert_eq!(fmu.all_bits(), wanted);
    let other = Fmu::new(MODEL);
    let mut read = null_mut();
    other.deserialize(&bytes, &mut read).ok(&other);
    other.set_state(read).ok(&other);
    advance(&other, 100..200);
    assert_eq!(other.all_bits(), wanted);
    assert_eq!(other.serialize(read).expect("bytes"), bytes);

    fmu.reset().ok(&fmu);
    fmu.set("mu", 1.5).ok(&fmu);
    fmu.start(0.0, None);
    advance(&fmu, 0..200);
    assert_eq!(fmu.all_bits(), wanted);
    fmu.free_state(&mut state).ok(&fmu);
    fmu.free_state(&mut read).ok(&fmu);
}

/// Two threads restore one snapshot at the same time, which the interface allows.
#[test]
fn one_snapshot_serves_several_threads() {
    let fmu = Fmu::started(MODEL, &[]);
    advance(&fmu, 0..10);
    let mut state = null_mut();
    fmu.get_state(&mut state).ok(&fmu);
    let (wanted, address) = (fmu.all_bits(), state as usize);
    std::thread::scope(|scope| {
        for _ in 0..4 {
            scope.spawn(|| {
                let other = Fmu::new(MODEL);
                for _ in 0..1000 {
                    other.set_state(address as _).ok(&other);
                    assert_eq!(other.all_bits(), wanted);
                }
            });
        }
    });
    fmu.free_state(&mut state).ok(&fmu);
}

/// `(f(x + h) − f(x − h)) / 2h` against the exact derivative. Fails if a term is missing.
#[test]
fn directional_derivatives_are_those_of_the_equation() {
    const H: f64 = 1e-5;
    let fmu = Fmu::started(MODEL, &[]);
    advance(&fmu, 0..150);
    let [x, v, a] = ["x", "v", "a"].map(|name| fmu.reference(name));
    let [x_0, v_0] = ["x", "v"].map(|name| fmu.get(name));
    let at = |x0: f64, v0: f64| Fmu::started(MODEL, &[("x0", x0), ("v0", v0)]).get("a");
    for [dx, dv] in [[1.0, 0.0], [0.0, 1.0], [0.3, -0.7]] {
        let found = fmu.directional_derivative(&[v, a], &[x, v], &[dx, dv]).expect("derivatives");
        let difference = (at(x_0 + H * dx, v_0 + H * dv) - at(x_0 - H * dx, v_0 - H * dv)) / (2.0 * H);
        assert_eq!(found[0], dv);
        assert!((found[1] - difference).abs() < 1e-8, "{} and {difference}", found[1]);
    }
    // Before the run the parameters are knowns too.
    let fresh = Fmu::new(MODEL);
    fresh.enter_initialization().ok(&fresh);
    let mu = fresh.reference("mu");
    let found = fresh.directional_derivative(&[a], &[mu, fresh.reference("x0")], &[1.0, 1.0]).expect("derivatives");
    assert_eq!(found, [-1.0], "a = mu (1 - x²) v - x with v = 0");
}

/// Never ends if a step may have any length.
#[test]
fn excessively_long_steps_are_refused() {
    let fmu = Fmu::started(MODEL, &[]);
    assert!(fmu.step(0.0, 1e6).error(&fmu).contains("expected at most 1000"));
}

/// Random calls with random arguments; see `support/abuse.rs`.
#[test]
fn random_calls_never_break_an_instance() {
    let mut served = 0;
    for seed in 1..=50 {
        let mut abuse = Abuse::new(Random::new(seed));
        while abuse.calls < 2000 {
            abuse.step().expect("random bytes do not end");
        }
        served += abuse.served;
    }
    assert!(served > 30_000, "{served} of 100,000 calls were served");
}

/// Instances hold a share of their table. Fails if two instances of the library have different tables.
#[test]
fn models_are_shared() {
    let [one, other] = [library::FMUS.find(MODEL), library::FMUS.find(MODEL)].map(|model| model.expect("the model"));
    assert!(std::sync::Arc::ptr_eq(&one, &other));
    let mut instance = one.instantiate();
    drop((one, other));
    assert!(instance.start().is_ok());
    assert_eq!(Fmu::new(MODEL).step(0.0, STEP_S), fmi2Status::fmi2Error);
}
