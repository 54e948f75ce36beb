//! What the library gives back when it is unloaded.
//!
//! Tables of variables and model descriptions are made once per load and serve all instances. Rust drops no statics, so that
//! every load of the library would leave some hundred kilobytes behind; a handler of the C library's `atexit`, which for a
//! shared library is called when it is unloaded, drops them.
//!
//! The same handler runs when the process ends, and then perhaps before what the importer does at its end: a static object
//! in C++, which still terminates and frees its instances, or a thread that is in the middle of a step. So the tables stay as
//! long as there is an instance.

use std::any::Any;
use std::ffi::c_int;
use std::sync::Once;
use std::sync::atomic::{AtomicUsize, Ordering};

use super::registry;
use crate::slave::catalogue;

unsafe extern "C" {
    fn atexit(handler: extern "C" fn()) -> c_int;
}

/// How many users the tables have, or [`GONE`].
static USERS: AtomicUsize = AtomicUsize::new(0);

/// The tables were given back.
const GONE: usize = usize::MAX;

/// Keeps the tables for a user of theirs: an instance, or the making of one.
pub(super) struct Presence(());

impl Presence {
    /// Begins to use the tables; `None` if they were given back, after which the library serves nobody.
    pub(super) fn begin() -> Option<Self> {
        static PREPARED: Once = Once::new();
        PREPARED.call_once(|| {
            // Miri knows no such function.
            // SAFETY: the handler is part of this library, whose C library calls it before the code is gone. Without a
            // place for it memory is not given back, and nothing else happens.
            #[cfg(not(miri))]
            let _ = unsafe { atexit(give_back) };
        });
        let more = |users: usize| (users != GONE).then(|| users + 1);
        USERS.fetch_update(Ordering::AcqRel, Ordering::Acquire, more).ok().map(|_| Self(()))
    }
}

impl Drop for Presence {
    fn drop(&mut self) {
        USERS.fetch_sub(1, Ordering::AcqRel);
    }
}

extern "C" fn give_back() {
    if USERS.compare_exchange(0, GONE, Ordering::AcqRel, Ordering::Acquire).is_err() {
        return;
    }
    for kind in catalogue() {
        // SAFETY: see `drop_static`.
        unsafe { drop_static(kind.shelf) };
    }
    // SAFETY: see `drop_static`.
    unsafe { drop_static(registry::shelf()) };
}

/// Drops what a static holds.
///
/// # Safety
/// The static is a `LazyLock`, whose content may change, and nobody uses it again: there is no instance, none can be made
/// any more, and all functions that look at the tables want one.
unsafe fn drop_static(shelf: &'static (dyn Any + Send + Sync)) {
    // SAFETY: by this function's contract.
    unsafe { std::ptr::drop_in_place(std::ptr::from_ref(shelf).cast_mut()) }
}
