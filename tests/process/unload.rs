//! At process exit existing instances can still be used, and new ones can be made.

use std::process::Command;
use std::sync::Mutex;

use crate::support::MODELS;
use crate::support::ffi::{Fmu, Request};
use fmu_export::fmi2::bindings::fmi2Status;

const CHILD: &str = "MAGNETIC_BEARING_UNLOAD_TEST";

/// Instances held by a static object of an importer until the process ends.
static HELD: Mutex<Vec<(Fmu, Vec<u64>)>> = Mutex::new(Vec::new());
/// A request for an instance at exit.
static LATE: Mutex<Option<Request>> = Mutex::new(None);

/// Uses the instances, ends and frees them.
fn use_them() {
    for (fmu, wanted) in HELD.lock().expect("no panic").drain(..) {
        let sound = fmu.all_bits() == wanted
            && fmu.step(30e-4, 1e-4) == fmi2Status::fmi2OK
            && fmu.set("m", 1.0) == fmi2Status::fmi2Error
            && fmu.take_messages().iter().any(|message| message.text.contains("m cannot be set"))
            && fmu.terminate() == fmi2Status::fmi2OK;
        println!("{}", if sound { "held and sound" } else { "spoilt" });
    }
}

fn ask_for_another() {
    let request = LATE.lock().expect("no panic").take().expect("a request");
    println!("{}", if request.instantiate(MODELS[0]).is_err() { "refused" } else { "made late" });
}

/// The last function of this program.
extern "C" fn at_the_end() {
    match std::env::var(CHILD).as_deref() {
        Ok("held") => use_them(),
        Ok(_) => ask_for_another(),
        Err(_) => (),
    }
}

/// The functions in this table are called from last to first, and those of the program precede those of its
/// libraries: the library's handler has run.
#[used]
// SAFETY: the section holds pointers to functions without arguments, which are called once, at the end of the process.
#[unsafe(link_section = ".fini_array")]
static AT_THE_END: extern "C" fn() = at_the_end;

/// The other process of the tests below.
#[test]
fn another_process() {
    let Ok(what) = std::env::var(CHILD) else { return };
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
    let child =
        Command::new(program).args(["unload::another_process", "--exact", "--nocapture"]).env(CHILD, what).output();
    let child = child.expect("another process");
    let printed = String::from_utf8_lossy(&child.stdout).into_owned();
    assert!(child.status.success(), "{}: {printed}\n{}", child.status, String::from_utf8_lossy(&child.stderr));
    printed
}

/// Fails if the handler drops tables in use: the instances then look for their variables in freed memory.
#[test]
fn instances_can_be_used_after_the_handler_has_run() {
    let printed = printed("held");
    assert_eq!(printed.matches("held and sound").count(), MODELS.len(), "{printed}");
}

/// Fails if the instance uses tables that were dropped instead of creating new ones.
#[test]
fn an_instance_can_still_be_made_after_the_handler_has_run() {
    assert!(printed("late").contains("made late"));
}
