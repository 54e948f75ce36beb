//! What several tests share. A test takes what it needs of it.

#![allow(dead_code, reason = "every test program uses a part of this")]

#[path = "../../fmu-export/tests/support/abuse.rs"]
pub mod abuse;
#[path = "../../fmu-export/tests/support/ffi.rs"]
pub mod ffi;
pub mod named;
#[path = "../../fmu-export/tests/support/random.rs"]
mod random;
#[path = "../../fmu-export/tests/support/sequence.rs"]
pub mod sequence;

/// The models that the tests in `fmu-export/tests/support` work on.
pub use magnetic_bearing::fmu as library;
#[allow(unused_imports, reason = "not every test program needs it")]
pub use random::Random;

/// Demands a value of at most `limit`; a miss prints both.
#[track_caller]
pub fn below(what: &str, value: f64, limit: f64) {
    assert!(value <= limit, "{what}: {value:e} is above the limit {limit:e}");
}

/// Demands that an error message holds all of these words.
#[track_caller]
pub fn says(message: &str, words: &[&str]) {
    for word in words {
        assert!(message.contains(word), "`{word}` is not said in: {message}");
    }
}
