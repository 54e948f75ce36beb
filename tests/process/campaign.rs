//! Long campaigns: the library is loaded and unloaded many times, and receives many random calls.

use std::ffi::{CStr, c_void};
use std::path::{Path, PathBuf};
use std::ptr::null_mut;
use std::sync::Mutex;

use crate::support::MODELS;
use crate::support::Random;
use crate::support::abuse3::Abuse3;
use crate::support::ffi::{guid, text};
use fmu_export::fmi2::bindings::*;

use magnetic_bearing::package;

/// Number of loads of the library, unless set by the environment.
const ROUNDS: u32 = 500;
/// Permitted growth of memory after the first fifth, in bytes: enough for what an allocator retains, far less than one instance per
/// round.
const GROWTH_BYTES: u64 = 2 << 20;
/// Few steps per round: the test is about loading.
const STEPS: u32 = 20;

/// Serializes the tests of this process, which measure its memory.
static ALONE: Mutex<()> = Mutex::new(());

/// Memory that the process holds, in bytes.
fn resident_bytes() -> u64 {
    let status = std::fs::read_to_string("/proc/self/statm").expect("a system with /proc");
    let pages: u64 = status.split(' ').nth(1).and_then(|pages| pages.parse().ok()).expect("a number of pages");
    pages * 4096
}

/// Asserts that these rounds leave no memory behind after the first fifth.
fn assert_no_growth(rounds: u32, mut round: impl FnMut(u32)) {
    let mut settled = 0;
    for k in 1..=rounds {
        round(k);
        if k == rounds / 5 {
            settled = resident_bytes();
        }
    }
    let grown = resident_bytes().saturating_sub(settled);
    assert!(grown <= GROWTH_BYTES, "{grown} bytes more after {rounds} rounds");
}

fn library() -> PathBuf {
    package::built_library().expect("cargo builds the library together with the tests")
}

/// Loads the library, runs each model for some steps, and unloads it; the bits of all Real values at the end.
fn round(library: &Path) -> Vec<u64> {
    let callbacks = fmi2CallbackFunctions {
        logger: None,
        allocateMemory: None,
        freeMemory: None,
        stepFinished: None,
        componentEnvironment: null_mut(),
    };
    let mut bits = Vec::new();
    // SAFETY: the library was built with this test, and loading runs no code of it. Every symbol has the
    // type of the header, and everything obtained from it is released before it is closed.
    unsafe {
        let loaded = libloading::Library::new(library).expect("the library");
        macro_rules! symbol {
            ($name:ident: $type:ident) => {
                loaded.get::<$type>(concat!(stringify!($name), "\0").as_bytes()).expect("a symbol").expect("a function")
            };
        }
        let instantiate = symbol!(fmi2Instantiate: fmi2InstantiateTYPE);
        let enter = symbol!(fmi2EnterInitializationMode: fmi2EnterInitializationModeTYPE);
        let exit = symbol!(fmi2ExitInitializationMode: fmi2ExitInitializationModeTYPE);
        let step = symbol!(fmi2DoStep: fmi2DoStepTYPE);
        let get = symbol!(fmi2GetReal: fmi2GetRealTYPE);
        let get_state = symbol!(fmi2GetFMUstate: fmi2GetFMUstateTYPE);
        let free_state = symbol!(fmi2FreeFMUstate: fmi2FreeFMUstateTYPE);
        let terminate = symbol!(fmi2Terminate: fmi2TerminateTYPE);
        let free = symbol!(fmi2FreeInstance: fmi2FreeInstanceTYPE);
        for model in MODELS {
            let (name, guid, place) = (text(model), text(&guid(model)), text("file:///tmp"));
            let kind = fmi2Type::fmi2CoSimulation;
            let c = instantiate(name.as_ptr(), kind, guid.as_ptr(), place.as_ptr(), &raw const callbacks, 0, 0);
            assert!(!c.is_null());
            assert_eq!(enter(c), fmi2Status::fmi2OK);
            assert_eq!(exit(c), fmi2Status::fmi2OK);
            let mut state = null_mut();
            for k in 0..STEPS {
                assert_eq!(step(c, f64::from(k) * 1e-4, 1e-4, 1), fmi2Status::fmi2OK);
                if k == STEPS / 2 {
                    assert_eq!(get_state(c, &raw mut state), fmi2Status::fmi2OK);
                }
            }
            for reference in 0..100 {
                let mut value = 0.0;
                if get(c, &raw const reference, 1, &raw mut value) == fmi2Status::fmi2OK {
                    bits.push(value.to_bits());
                }
            }
            assert_eq!(free_state(c, &raw mut state), fmi2Status::fmi2OK);
            assert_eq!(terminate(c), fmi2Status::fmi2OK);
            free(c);
        }
        loaded.close().expect("the library is closed");
    }
    bits
}

/// Fails if fmi2FreeInstance leaks the instance, fmi2FreeFMUstate the snapshot, or the library its tables: many megabytes in these
/// rounds.
#[test]
fn loading_and_unloading_leaves_nothing_behind() {
    let _alone = ALONE.lock();
    let rounds = std::env::var("CAMPAIGN_ROUNDS").ok().and_then(|text| text.parse().ok()).unwrap_or(ROUNDS);
    let library = library();
    let first = round(&library);
    assert!(first.len() > 60);
    assert_no_growth(rounds, |k| assert_eq!(round(&library), first, "round {k}"));
}

/// Fails if a function of a header is missing.
#[test]
fn the_library_exports_every_function_of_the_headers() {
    let _alone = ALONE.lock();
    let headers = [
        (include_str!("../../fmu-export/src/fmi2/fmi2.h"), 34),
        (include_str!("../../fmu-export/src/fmi3/fmi3.h"), 75),
    ];
    // SAFETY: as in `round`.
    unsafe {
        let loaded = libloading::Library::new(library()).expect("the library");
        for (header, count) in headers {
            // Declarations look like `fmi2DoStepTYPE fmi2DoStep;`.
            let words = |line: &'static str| line.strip_suffix(';').and_then(|line| line.split_once("TYPE "));
            let declared: Vec<_> = header.lines().filter_map(words).collect();
            let names: Vec<_> = declared.iter().filter(|(kind, name)| kind == name).map(|(_, name)| *name).collect();
            assert_eq!(names.len(), count);
            for name in names {
                loaded.get::<*const c_void>(format!("{name}\0").as_bytes()).expect("a symbol");
            }
        }
        // Functions without arguments that return a text.
        for (name, wanted) in
            [("fmi2GetVersion\0", c"2.0"), ("fmi2GetTypesPlatform\0", c"default"), ("fmi3GetVersion\0", c"3.0")]
        {
            let text = loaded.get::<fmi2GetVersionTYPE>(name.as_bytes()).expect("a symbol").expect("a function");
            assert_eq!(CStr::from_ptr(text()), wanted, "{name}");
        }
    }
}

/// Fails if fmi3FreeInstance leaks the instance, fmi3FreeFMUState the snapshot, or a call its own memory: many megabytes each.
#[test]
fn random_calls_of_fmi_3_leave_nothing_behind() {
    let _alone = ALONE.lock();
    assert_no_growth(if cfg!(debug_assertions) { 50 } else { 100 }, |seed| {
        let mut abuse = Abuse3::new(Random::new(seed.into()));
        while abuse.calls < 2000 {
            abuse.step().expect("random bytes do not end");
        }
    });
}
