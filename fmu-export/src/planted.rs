//! A panic planted by a test, to see that none crosses the border to C. Only builds with the feature
//! `planted-panics` have it, which no FMU is built with.

use std::cell::Cell;

thread_local! {
    static WHERE: Cell<Option<&'static str>> = const { Cell::new(None) };
}

/// Lets the next call of this thread that comes to that place panic, once. The places: `get`, `start`, `step`, `save`,
/// `differentiate`.
pub fn plant(place: &'static str) {
    WHERE.set(Some(place));
}

/// A place where a panic may have been planted.
pub(crate) fn pass(place: &str) {
    if WHERE.get() == Some(place) {
        WHERE.set(None);
        panic!("planted in `{place}`");
    }
}
