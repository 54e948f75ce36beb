//! A panic planted by a test, to check that none crosses the C boundary. Only builds with the feature `planted-panics` contain
//! it, and no FMU is built with that.

use std::cell::Cell;

thread_local! {
    static WHERE: Cell<Option<&'static str>> = const { Cell::new(None) };
}

/// Makes the next call of this thread that passes the given place panic, once. The places: `get`, `start`, `step`, `save`,
/// `differentiate`.
pub fn plant(place: &'static str) {
    WHERE.set(Some(place));
}

/// A place where a panic may be planted.
pub(crate) fn pass(place: &str) {
    if WHERE.get() == Some(place) {
        WHERE.set(None);
        panic!("planted in `{place}`");
    }
}
