//! Threads of importers have small stacks: 1 MiB on Windows, 512 KiB on macOS.

use crate::prelude::*;
use crate::session::session;

/// Half of the smallest of them.
const STACK_BYTES: usize = 256 << 10;

/// A stack overflow ends the process. Fails if values or a state are moved by value through many calls.
#[test]
fn every_fmu_runs_in_a_thread_with_a_small_stack() {
    for model in MODELS {
        let size = std::env::var("STACK_KIB").map_or(STACK_BYTES, |kib| kib.parse::<usize>().expect("a number") << 10);
        let thread = std::thread::Builder::new().stack_size(size).spawn(move || session(model, 300)).expect("a thread");
        thread.join().unwrap_or_else(|_| panic!("{model}: the session does not end well"));
    }
}
