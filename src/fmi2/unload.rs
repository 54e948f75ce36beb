//! What the library gives back when it is unloaded.
//!
//! Tables of variables and model descriptions are made once per load and serve all instances. Rust drops no statics, so that
//! every load of the library would leave some hundred kilobytes behind; a function that the system calls when it unloads the
//! library drops them. On Linux it stands in the library's table of such functions: the C library's `atexit` would depend on what
//! the linker puts around a shared library, and where that is missing, it calls functions that are gone. Elsewhere it is
//! `atexit`, which Windows keeps for each library and macOS tells apart by the address of the function.

use std::any::Any;
use std::sync::Once;

use super::registry;
use crate::slave::catalogue;

static PREPARED: Once = Once::new();

/// Sees to it, once per load, that what is made once per load is dropped when the library is unloaded.
pub(super) fn prepare() {
    PREPARED.call_once(|| {
        #[cfg(not(all(unix, not(target_vendor = "apple"))))]
        {
            unsafe extern "C" {
                fn atexit(handler: extern "C" fn()) -> std::ffi::c_int;
            }
            // SAFETY: the handler is part of this library, whose C library calls it before the code is gone. Without a
            // place for it memory is not given back, and nothing else happens.
            let _ = unsafe { atexit(give_back) };
        }
    });
}

#[cfg(all(unix, not(target_vendor = "apple")))]
#[used]
// SAFETY: the section holds pointers to functions without arguments, which are called once, before the library goes.
#[unsafe(link_section = ".fini_array")]
static AT_UNLOAD: extern "C" fn() = give_back;

/// Nothing is there to be given back, nor touched, in a program that has the library inside and never made an instance.
extern "C" fn give_back() {
    if !PREPARED.is_completed() {
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
/// The static is a `LazyLock`, whose content may change, and nobody uses it again: the importer has freed all instances
/// and makes no further calls once it unloads the library.
unsafe fn drop_static(shelf: &'static (dyn Any + Send + Sync)) {
    // SAFETY: by this function's contract.
    unsafe { std::ptr::drop_in_place(std::ptr::from_ref(shelf).cast_mut()) }
}
