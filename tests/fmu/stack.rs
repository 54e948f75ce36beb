//! The stacks of importers' threads are small: 1 MiB on Windows, 512 KiB on macOS.

use std::ptr::null_mut;

use crate::support::MODELS;
use crate::support::ffi::{Expect, Fmu};

/// Half of what the smallest of them has.
const STACK_BYTES: usize = 256 << 10;

/// Everything that an importer does with an instance, in a small thread. A stack that is too small ends the process.
/// Fails if values or a state are moved by value through many calls.
#[test]
fn every_fmu_lives_in_a_thread_with_a_small_stack() {
    for model in MODELS {
        let all = move || {
            let fmu = Fmu::started(model, &[]);
            for step in 0..300 {
                fmu.step(f64::from(step) * 1e-4, 1e-4).ok(&fmu);
            }
            let (mut state, mut read) = (null_mut(), null_mut());
            fmu.get_state(&mut state).ok(&fmu);
            let bytes = fmu.serialize(state).expect("bytes");
            fmu.deserialize(&bytes, &mut read).ok(&fmu);
            fmu.set_state(read).ok(&fmu);
            fmu.step(0.03, 1e-4).ok(&fmu);
            fmu.get_state(&mut state).ok(&fmu);
            fmu.free_state(&mut state).ok(&fmu);
            fmu.free_state(&mut read).ok(&fmu);
            let wanted = fmu.all_bits();
            fmu.reset().ok(&fmu);
            fmu.start(0.0, None);
            assert_eq!(fmu.all_bits().len(), wanted.len());
        };
        let size = std::env::var("STACK_KIB").map_or(STACK_BYTES, |kib| kib.parse::<usize>().expect("a number") << 10);
        let thread = std::thread::Builder::new().stack_size(size).spawn(all).expect("a thread");
        thread.join().expect("it ends well");
    }
}
