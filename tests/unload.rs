//! The end of the process: an instance that is there can still be used, and none is made when the tables are gone.

mod support;

use std::ffi::c_int;
use std::process::Command;
use std::sync::Mutex;

use magnetic_bearing::fmi2::bindings::fmi2Status;
use support::ffi::{Fmu, Request};

const MODELS: [&str; 3] = ["MagneticBearing", "FlatnessController", "AlgebraicEstimator"];
const CHILD: &str = "MAGNETIC_BEARING_UNLOAD_TEST";

unsafe extern "C" {
    fn atexit(handler: extern "C" fn()) -> c_int;
}

/// What a static object of an importer still holds when the process ends.
static HELD: Mutex<Vec<(Fmu, Vec<u64>)>> = Mutex::new(Vec::new());
/// A request that was put together before.
static LATE: Mutex<Option<Request>> = Mutex::new(None);

/// Uses the instances, ends and frees them.
extern "C" fn use_them() {
    for (fmu, wanted) in HELD.lock().expect("no panic").drain(..) {
        let sound = fmu.all_bits() == wanted
            && fmu.step(30e-4, 1e-4) == fmi2Status::fmi2OK
            && fmu.set("m", 1.0) == fmi2Status::fmi2Error
            && fmu.take_messages().iter().any(|message| message.text.contains("m cannot be set"))
            && fmu.terminate() == fmi2Status::fmi2OK;
        println!("{}", if sound { "held and sound" } else { "spoilt" });
    }
}

extern "C" fn ask_for_another() {
    let request = LATE.lock().expect("no panic").take().expect("a request");
    println!("{}", if request.instantiate(MODELS[0]).is_err() { "refused" } else { "made" });
}

/// The other process of the tests below. Handlers run in the reverse of the order in which they are registered, so these
/// two follow that of the library, which it registers with its first instance.
#[test]
fn another_process() {
    let Ok(what) = std::env::var(CHILD) else { return };
    // SAFETY: the handlers are functions of this program.
    assert_eq!(unsafe { atexit(if what == "held" { use_them } else { ask_for_another }) }, 0);
    for model in MODELS {
        let fmu = Fmu::started(model, &[]);
        for step in 0..30 {
            assert_eq!(fmu.step(f64::from(step) * 1e-4, 1e-4), fmi2Status::fmi2OK);
        }
        let bits = fmu.all_bits();
        if what == "held" {
            HELD.lock().expect("no panic").push((fmu, bits));
        }
    }
    *LATE.lock().expect("no panic") = Some(Request::of(MODELS[0]));
    std::process::exit(0);
}

fn printed(what: &str) -> String {
    let program = std::env::current_exe().expect("this program");
    let child = Command::new(program).args(["another_process", "--exact", "--nocapture"]).env(CHILD, what).output();
    let child = child.expect("another process");
    let printed = String::from_utf8_lossy(&child.stdout).into_owned();
    assert!(child.status.success(), "{}: {printed}\n{}", child.status, String::from_utf8_lossy(&child.stderr));
    printed
}

/// Fails if the handler drops the tables whatever there is: the instances then look for their variables in freed memory.
#[test]
fn instances_can_be_used_after_the_handler_has_run() {
    let printed = printed("held");
    assert_eq!(printed.matches("held and sound").count(), MODELS.len(), "{printed}");
}

/// Fails if an instance is made of tables that are gone.
#[test]
fn no_instance_is_made_after_the_tables_are_gone() {
    assert!(printed("late").contains("refused"));
}
