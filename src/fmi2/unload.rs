//! What the library gives back when it is unloaded.
//!
//! Tables of variables and model descriptions are made once per load and serve all instances. Rust drops no statics, so that
//! every load of the library would leave some hundred kilobytes behind; a function that the system calls when it unloads the
//! library drops them. On Linux it stands in the library's table of such functions: the C library's `atexit` would depend on what
//! the linker puts around a shared library, and where that is missing, it calls functions that are gone. Elsewhere it is
//! `atexit`, which Windows keeps for each library and macOS tells apart by the address of the function.
//!
//! The same function runs when the process ends, and then perhaps before what the importer does at its end: a static object
//! in C++, which still terminates and frees its instances, or a thread that is in the middle of a step. So the tables stay as
//! long as there is an instance.

use std::any::Any;
use std::sync::Once;
use std::sync::atomic::{AtomicUsize, Ordering};

use super::registry;
use crate::slave::catalogue;

/// Completed once there is something to be given back.
static PREPARED: Once = Once::new();

/// How many users the tables have, or [`GONE`].
static USERS: AtomicUsize = AtomicUsize::new(0);

/// The tables were given back.
const GONE: usize = usize::MAX;

/// Keeps the tables for a user of theirs: an instance, or the making of one.
pub(super) struct Presence(());

impl Presence {
    /// Begins to use the tables; `None` if they were given back, after which the library serves nobody.
    pub(super) fn begin() -> Option<Self> {
        PREPARED.call_once(prepare);
        let more = |users: usize| (users != GONE).then(|| users + 1);
        USERS.fetch_update(Ordering::AcqRel, Ordering::Acquire, more).ok().map(|_| Self(()))
    }
}

impl Drop for Presence {
    fn drop(&mut self) {
        USERS.fetch_sub(1, Ordering::AcqRel);
    }
}

#[cfg(all(unix, not(target_vendor = "apple"), not(miri)))]
#[used]
// SAFETY: the section holds pointers to functions without arguments, which are called once, before the library goes.
#[unsafe(link_section = ".fini_array")]
static AT_UNLOAD: extern "C" fn() = give_back;

#[cfg(any(all(unix, not(target_vendor = "apple")), miri))]
fn prepare() {}

#[cfg(not(any(all(unix, not(target_vendor = "apple")), miri)))]
fn prepare() {
    unsafe extern "C" {
        fn atexit(handler: extern "C" fn()) -> std::ffi::c_int;
    }
    // SAFETY: the handler is part of this library, whose C library calls it before the code is gone. Without a place for
    // it memory is not given back, and nothing else happens.
    let _ = unsafe { atexit(give_back) };
}

/// Nothing is touched in a program that has the library inside and never made an instance.
#[cfg_attr(miri, allow(dead_code))]
extern "C" fn give_back() {
    if !PREPARED.is_completed() || USERS.compare_exchange(0, GONE, Ordering::AcqRel, Ordering::Acquire).is_err() {
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
