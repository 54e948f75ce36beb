//! The stacks of importers' threads are small: 1 MiB on Windows, 512 KiB on macOS.

use crate::session::session;
use crate::support::MODELS;

/// Half of what the smallest of them has.
const STACK_BYTES: usize = 256 << 10;

/// Everything that an importer does with an instance, in a small thread. A stack that is too small ends the process.
/// Fails if values or a state are moved by value through many calls.
#[test]
fn every_fmu_lives_in_a_thread_with_a_small_stack() {
    for model in MODELS {
        let size = std::env::var("STACK_KIB").map_or(STACK_BYTES, |kib| kib.parse::<usize>().expect("a number") << 10);
        let thread = std::thread::Builder::new().stack_size(size).spawn(move || session(model, 300)).expect("a thread");
        thread.join().unwrap_or_else(|_| panic!("{model}: the session does not end well"));
    }
}
