//! The models of one binary, by GUID.

use std::ffi::CStr;
use std::sync::{Arc, Mutex, Once, PoisonError};

use crate::description::Standard;
use crate::instance::ModelType;

/// The models of one binary. [`export_fmus!`](crate::export_fmus) makes one, named `FMUS`.
///
/// Tables and model descriptions are made on first use and shared by all instances, which hold them as long as needed. The
/// binary drops its own share when unloaded: Rust drops no statics, so every load would leak some hundred kilobytes.
pub struct Fmus {
    library: &'static str,
    make: fn() -> Vec<ModelType>,
    models: Mutex<Option<Arc<[Arc<ModelType>]>>>,
}

impl Fmus {
    /// The models returned by `make`, in the library of that name; for [`export_fmus!`](crate::export_fmus).
    pub const fn new(library: &'static str, make: fn() -> Vec<ModelType>) -> Self {
        Self { library, make, models: Mutex::new(None) }
    }

    /// All models, in the order in which they are exported.
    pub fn models(&'static self) -> Arc<[Arc<ModelType>]> {
        // Even after a panic the list is complete or empty.
        let mut models = self.models.lock().unwrap_or_else(PoisonError::into_inner);
        let made = models.get_or_insert_with(|| {
            at_unload(self);
            (self.make)().into_iter().map(Arc::new).collect()
        });
        made.clone()
    }

    /// The model of a name.
    pub fn find(&'static self, name: &str) -> Option<Arc<ModelType>> {
        self.models().iter().find(|model| model.info.name == name).cloned()
    }

    /// The model and the standard of a GUID or an instantiation token, which is passed as the argument of that name.
    ///
    /// # Errors
    /// Those that there are; of several standards, only those of the first.
    pub(crate) fn by_token(
        &'static self,
        standards: &[Standard],
        argument: &str,
        token: &CStr,
    ) -> Result<(Arc<ModelType>, Standard), String> {
        let models = self.models();
        let token = token.to_string_lossy();
        // Descriptions of a standard are made only if no token of the former one matches.
        for standard in standards {
            if let Some(found) = models.iter().find(|model| model.description(*standard).token == token) {
                return Ok((found.clone(), *standard));
            }
        }
        let listed =
            models.iter().map(|model| format!("{} ({})", model.description(standards[0]).token, model.info.name));
        Err(format!(
            "{argument} = {token} is unknown: model description and binary do not belong together; this binary has {}",
            listed.collect::<Vec<_>>().join(" or ")
        ))
    }

    /// The name of the library as known to cargo, with underscores.
    pub fn library(&self) -> &'static str {
        self.library
    }
}

/// All `Fmus` that hold models when the library is unloaded.
static IN_USE: Mutex<Vec<&'static Fmus>> = Mutex::new(Vec::new());

fn at_unload(fmus: &'static Fmus) {
    static PREPARED: Once = Once::new();
    PREPARED.call_once(register);
    IN_USE.lock().unwrap_or_else(PoisonError::into_inner).push(fmus);
}

// A function that the system calls when it unloads the library. On Linux the library lists it in its section of such
// functions: `atexit` depends on code that the linker adds to a shared library, and without that it would call functions already
// unloaded. Elsewhere it is registered by `atexit`, which Windows keeps per library and macOS distinguishes by function address.
#[cfg(all(unix, not(target_vendor = "apple"), not(miri)))]
#[used]
// SAFETY: the section holds pointers to functions without arguments, called once, before the library is unloaded.
#[unsafe(link_section = ".fini_array")]
static AT_UNLOAD: extern "C" fn() = drop_models;

#[cfg(any(all(unix, not(target_vendor = "apple")), miri))]
fn register() {}

#[cfg(not(any(all(unix, not(target_vendor = "apple")), miri)))]
fn register() {
    unsafe extern "C" {
        fn atexit(handler: extern "C" fn()) -> std::ffi::c_int;
    }
    // SAFETY: the handler is part of this library, whose C library calls it before the code is unloaded. If it cannot be
    // registered, memory is leaked, nothing else.
    let _ = unsafe { atexit(drop_models) };
}

/// It also runs at process exit, perhaps while other threads are in a call, or before an importer steps its instances once
/// more: it does not wait, and drops nothing that an instance holds.
#[cfg_attr(miri, allow(dead_code))]
extern "C" fn drop_models() {
    let Ok(mut in_use) = IN_USE.try_lock() else { return };
    for fmus in std::mem::take(&mut *in_use) {
        if let Ok(mut models) = fmus.models.try_lock() {
            *models = None;
        }
    }
}
