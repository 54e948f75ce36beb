//! The fuzzer's bytes as an importer's calls: see fmu-export/tests/support/abuse.rs.

#![no_main]

#[path = "../../tests/support/mod.rs"]
mod support;

use libfuzzer_sys::fuzz_target;
use support::abuse::{Abuse, Given};

fuzz_target!(|bytes: &[u8]| {
    let mut abuse = Abuse::new(Given(bytes));
    while abuse.step().is_some() {}
});
