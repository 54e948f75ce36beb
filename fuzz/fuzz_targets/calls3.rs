//! The fuzzer's bytes as an importer's calls through FMI 3.0: see fmu-export/tests/support/abuse3.rs.

#![no_main]

#[path = "../../tests/support/mod.rs"]
mod support;

use libfuzzer_sys::fuzz_target;
use support::abuse::Given;
use support::abuse3::Abuse3;

fuzz_target!(|bytes: &[u8]| {
    let mut abuse = Abuse3::new(Given(bytes));
    while abuse.step().is_some() {}
});
