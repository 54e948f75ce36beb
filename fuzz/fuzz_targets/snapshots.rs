//! The fuzzer's bytes as the content of a serialized snapshot in a valid frame: continuing from an accepted snapshot must be safe.

#![no_main]

#[path = "../../tests/support/mod.rs"]
mod support;

use std::ptr::null_mut;

use fmu_export::fmi2::bindings::fmi2Status;
use libfuzzer_sys::fuzz_target;
use sha2::{Digest, Sha256};
use support::MODELS;
use support::ffi::Fmu;

fuzz_target!(|bytes: &[u8]| {
    let Some((first, edits)) = bytes.split_first() else { return };
    let model = MODELS[usize::from(*first) % MODELS.len()];
    let fmu = Fmu::started(model, &[]);
    for step in 0..3 {
        fmu.step(f64::from(step) * 1e-4, 1e-4);
    }
    let mut state = null_mut();
    fmu.get_state(&mut state);
    let written = fmu.serialize(state).expect("bytes");
    fmu.free_state(&mut state);
    let head = 8 + 2 + 1 + model.len() + 1 + 38;
    let mut content = written[head + 8..written.len() - 32].to_vec();
    // Edits of a valid content get further than arbitrary bytes: position (2 bytes), value.
    for edit in edits.chunks_exact(3) {
        let place = usize::from(edit[0]) + 256 * usize::from(edit[1]);
        let length = content.len();
        content[place % length] = edit[2];
    }
    if let [cut] = edits.chunks_exact(3).remainder() {
        content.truncate(content.len().saturating_sub(usize::from(*cut)));
    }
    let mut sealed = written[..head].to_vec();
    sealed.extend((content.len() as u64).to_le_bytes());
    sealed.extend(content);
    let hash = Sha256::digest(&sealed);
    sealed.extend(hash);
    if fmu.deserialize(&sealed, &mut state) == fmi2Status::fmi2OK {
        let other = Fmu::new(model);
        other.set_state(state);
        for step in 3..6 {
            other.step(f64::from(step) * 1e-4, 1e-4);
        }
        let _ = other.get_reals(&[40, 41, 42, 43]);
        fmu.free_state(&mut state);
    }
    for message in fmu.take_messages() {
        assert!(!message.text.contains("a defect of this FMU"), "{message:?}");
    }
});
