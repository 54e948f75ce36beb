//! What the library gives back when it is unloaded.
//!
//! Tables of variables and model descriptions are made once per load and serve all instances. Rust drops no statics, so that
//! every load of the library would leave some hundred kilobytes behind; a handler of the C library's `atexit`, which for a
//! shared library is called when it is unloaded, drops them.

use std::any::Any;
use std::ffi::c_int;
use std::sync::Once;

use super::registry;
use crate::slave::catalogue;

unsafe extern "C" {
    fn atexit(handler: extern "C" fn()) -> c_int;
}

/// Sees to it, once per load, that what is made once per load is dropped when the library is unloaded.
pub(super) fn prepare() {
    static PREPARED: Once = Once::new();
    PREPARED.call_once(|| {
        // SAFETY: the handler is part of this library, whose C library calls it before the code is gone. Without a
        // place for it memory is not given back, and nothing else happens.
        let _ = unsafe { atexit(give_back) };
    });
}

extern "C" fn give_back() {
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
/// The static is a `LazyLock`, whose content may change, and nobody uses it again: the importer has freed all instances
/// and makes no further calls once it unloads the library.
unsafe fn drop_static(shelf: &'static (dyn Any + Send + Sync)) {
    // SAFETY: by this function's contract.
    unsafe { std::ptr::drop_in_place(std::ptr::from_ref(shelf).cast_mut()) }
}
