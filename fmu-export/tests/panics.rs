//! A panic inside a model stays inside its FMU: it becomes fmi2Error or fmi3Error, and a reset recovers.

mod support;

/// A model that panics on demand.
mod library {
    use std::cell::Cell;

    use fmu_export::prelude::*;

    thread_local! {
        static WHERE: Cell<Option<&'static str>> = const { Cell::new(None) };
    }

    /// Makes the next call of this thread that passes the given place panic.
    pub fn plant(place: &'static str) {
        WHERE.set(Some(place));
    }

    fn pass(place: &str) {
        if WHERE.get() == Some(place) {
            WHERE.set(None);
            panic!("planted in `{place}`");
        }
    }

    #[derive(Clone, Default, Serialize, Deserialize, Variables)]
    pub struct Values {
        #[input(unit = unit::ONE)]
        x: f64,
        #[output(unit = unit::ONE)]
        y: f64,
    }

    #[derive(Serialize, Deserialize)]
    pub struct Sum(f64);

    impl Clone for Sum {
        fn clone(&self) -> Self {
            pass("copy");
            Self(self.0)
        }
    }

    #[derive(Clone)]
    pub struct Fragile;

    impl Model for Fragile {
        const INFO: Info = Info::new("Fragile", "Sum of its inputs");
        const CAPABILITIES: Capabilities = Capabilities::NONE.directional_derivatives();
        type Values = Values;
        type State = Sum;

        fn table() -> Vec<Row<Values>> {
            Values::rows()
        }

        fn new(_: &Values, _: &Resources) -> Result<Self, Vec<Invalid>> {
            Ok(Self)
        }

        fn start(&self, _: &mut Values, start_s: f64) -> Sum {
            pass("start");
            Sum(start_s)
        }

        fn step(
            &self,
            state: &mut Sum,
            values: &mut Values,
            to: Step,
            _: &InputTrajectory<Values>,
            _: &mut dyn Log,
        ) -> Stepped {
            pass("step");
            state.0 += to.length_s + values.x;
            values.y = state.0;
            Ok(())
        }

        fn refresh(&self, state: &Sum, values: &mut Values, _: f64) {
            pass("refresh");
            values.y = state.0;
        }

        fn differentiate(&self, _: &Sum, _: &Values, along: &Values, _: f64, _: bool) -> Values {
            pass("differentiate");
            along.clone()
        }
    }

    export_fmus!(Fragile);
}

use std::ptr::null_mut;

use fmu_export::fmi2::bindings::fmi2Status;
use fmu_export::fmi3::bindings::fmi3Status;
use library::plant;
use support::ffi::{Expect, Fmu};
use support::ffi3::{Fmu3, no_state};

const MODEL: &str = "Fragile";
const STEP_S: f64 = 0.01;

/// Checks the message of a call that panicked in this place.
#[track_caller]
fn assert_reported(text: &str, function: &str, place: &str, reset: &str) {
    assert!(text.starts_with(&format!("{function}: a defect of this FMU")), "{text}");
    assert!(text.contains(&format!("planted in `{place}`")) && text.contains(reset), "{text}");
}

/// Fails, by the end of this process, if the entry guard does not catch panics.
#[test]
fn a_panic_becomes_an_error_and_a_reset_recovers() {
    std::panic::set_hook(Box::new(|_| {}));
    /// Place of the panic, the function and its call, and whether the run has begun.
    type Case = (&'static str, &'static str, fn(&Fmu) -> fmi2Status, bool);
    let cases: [Case; 6] = [
        ("start", "fmi2GetReal", |fmu| fmu.try_get("y").expect_err("an error"), false),
        ("start", "fmi2ExitInitializationMode", Fmu::exit_initialization, false),
        ("step", "fmi2DoStep", |fmu| fmu.step(0.0, STEP_S), true),
        ("refresh", "fmi2GetReal", |fmu| fmu.try_get("y").expect_err("an error"), true),
        ("copy", "fmi2GetFMUstate", |fmu| fmu.get_state(&mut null_mut()), true),
        (
            "differentiate",
            "fmi2GetDirectionalDerivative",
            |fmu| fmu.directional_derivative(&[], &[], &[]).expect_err("an error"),
            true,
        ),
    ];
    let (fresh, fmu) = (Fmu::new(MODEL), Fmu::new(MODEL));
    for (place, function, call, begun) in cases {
        if begun {
            fmu.start(0.0, None);
        } else {
            fmu.enter_initialization().ok(&fmu);
        }
        fmu.set("x", 2.0).ok(&fmu);
        plant(place);
        assert_reported(&call(&fmu).error(&fmu), function, place, "after fmi2Reset");
        // The run has ended.
        let text = fmu.step(0.0, STEP_S).error(&fmu);
        assert!(text.contains("not allowed in the state `error`"), "{text}");
        fmu.reset().ok(&fmu);
    }
    // The instance equals a fresh one.
    for fmu in [&fresh, &fmu] {
        fmu.start(0.0, None);
        (0..30).for_each(|step| fmu.step(f64::from(step) * STEP_S, STEP_S).ok(fmu));
    }
    assert_eq!(fmu.all_bits(), fresh.all_bits());
}

/// As above, through FMI 3.0.
#[test]
fn a_panic_becomes_an_error_of_fmi_3_and_a_reset_recovers() {
    std::panic::set_hook(Box::new(|_| {}));
    type Case = (&'static str, &'static str, fn(&Fmu3) -> fmi3Status, bool);
    let cases: [Case; 6] = [
        ("start", "fmi3GetFloat64", |fmu| fmu.try_get("y").expect_err("an error"), false),
        ("start", "fmi3ExitInitializationMode", Fmu3::exit_initialization, false),
        ("step", "fmi3DoStep", |fmu| fmu.step(0.0, STEP_S), true),
        ("refresh", "fmi3GetFloat64", |fmu| fmu.try_get("y").expect_err("an error"), true),
        ("copy", "fmi3GetFMUState", |fmu| fmu.get_state(&mut no_state()), true),
        (
            "differentiate",
            "fmi3GetDirectionalDerivative",
            |fmu| fmu.directional_derivative(&[], &[], &[], 0).expect_err("an error"),
            true,
        ),
    ];
    let (fresh, fmu) = (Fmu3::new(MODEL, false), Fmu3::new(MODEL, false));
    for (place, function, call, begun) in cases {
        if begun {
            fmu.start(0.0);
        } else {
            fmu.ok(fmu.enter_initialization(0.0, None));
        }
        fmu.ok(fmu.set("x", 2.0));
        plant(place);
        assert_reported(&fmu.error(call(&fmu)), function, place, "after fmi3Reset");
        let text = fmu.error(fmu.step(0.0, STEP_S));
        assert!(text.contains("not allowed in the state `error`"), "{text}");
        fmu.ok(fmu.reset());
    }
    for fmu in [&fresh, &fmu] {
        fmu.start(0.0);
        (0..30).for_each(|step| fmu.ok(fmu.step(f64::from(step) * STEP_S, STEP_S)));
    }
    assert_eq!(fmu.all_bits(), fresh.all_bits());
}

/// Other instances are not affected. Fails if the entry guard does not catch panics.
#[test]
fn a_panic_in_one_instance_does_not_affect_another() {
    std::panic::set_hook(Box::new(|_| {}));
    let [fmu, neighbour, alone] = [0, 1, 2].map(|_| Fmu::started(MODEL, &[]));
    for step in 0..20 {
        let time_s = f64::from(step) * STEP_S;
        if step == 10 {
            plant("step");
            assert_eq!(fmu.step(time_s, STEP_S), fmi2Status::fmi2Error);
        } else if step < 10 {
            fmu.step(time_s, STEP_S).ok(&fmu);
        }
        neighbour.step(time_s, STEP_S).ok(&neighbour);
        alone.step(time_s, STEP_S).ok(&alone);
    }
    assert_eq!(neighbour.all_bits(), alone.all_bits());
    fmu.terminate().ok(&fmu);
}
