//! Loads the library of an FMU and initializes an instance, as an importer does.

use std::ffi::{CStr, CString};
use std::path::Path;
#[cfg(feature = "fmi3")]
use std::ptr::null;
use std::ptr::null_mut;

use libloading::{Library, Symbol};

use crate::Standard;

const UNKNOWN: &str = "the library does not know the model; was it built from the same source as this program?";
const NOT_INITIALIZED: &str = "the model cannot be initialized";

/// Makes an instance of the model with that token, initializes it, and frees it.
///
/// # Errors
/// If any of this fails, with the reason.
pub(crate) fn initialize(library: &Path, standard: Standard, token: &str, resources: &Path) -> Result<(), String> {
    // SAFETY: the library was made with this crate, and loading it has no side effects.
    let library = unsafe { Library::new(library) }.map_err(|error| error.to_string())?;
    let text = |text: String| CString::new(text).map_err(|error| error.to_string());
    let (name, token) = (text("trial".into())?, text(token.into())?);
    let folder = resources.to_string_lossy().replace('\\', "/");
    match standard {
        #[cfg(feature = "fmi2")]
        Standard::Fmi2 => {
            let location =
                text(format!("file:///{}", folder.trim_start_matches('/').replace('%', "%25").replace(' ', "%20")))?;
            initialize2(&library, &name, &token, &location)
        }
        #[cfg(feature = "fmi3")]
        Standard::Fmi3 { .. } => initialize3(&library, &name, &token, &text(folder)?),
        #[cfg(not(all(feature = "fmi2", feature = "fmi3")))]
        _ => Err(format!("the functions of {standard:?} are not there")),
    }
}

#[cfg(feature = "fmi2")]
fn initialize2(library: &Library, name: &CStr, token: &CStr, location: &CStr) -> Result<(), String> {
    use crate::fmi2::bindings::*;
    let callbacks = fmi2CallbackFunctions {
        logger: None,
        allocateMemory: None,
        freeMemory: None,
        stepFinished: None,
        componentEnvironment: null_mut(),
    };
    // SAFETY: the functions have the standard's types, as this crate exports them; all texts and the callbacks live as long as the
    // instance, which is used according to the standard and freed once.
    unsafe {
        let make = function::<fmi2InstantiateTYPE>(library, "fmi2Instantiate")?;
        let free = function::<fmi2FreeInstanceTYPE>(library, "fmi2FreeInstance")?;
        let enter = function::<fmi2EnterInitializationModeTYPE>(library, "fmi2EnterInitializationMode")?;
        let exit = function::<fmi2ExitInitializationModeTYPE>(library, "fmi2ExitInitializationMode")?;
        let (name, token, location) = (name.as_ptr(), token.as_ptr(), location.as_ptr());
        let instance = make(name, fmi2Type::fmi2CoSimulation, token, location, &raw const callbacks, 0, 0);
        if instance.is_null() {
            return Err(UNKNOWN.into());
        }
        let ok = enter(instance) == fmi2Status::fmi2OK && exit(instance) == fmi2Status::fmi2OK;
        free(instance);
        if ok { Ok(()) } else { Err(NOT_INITIALIZED.into()) }
    }
}

#[cfg(feature = "fmi3")]
fn initialize3(library: &Library, name: &CStr, token: &CStr, folder: &CStr) -> Result<(), String> {
    use crate::fmi3::bindings::*;
    // SAFETY: the functions have the standard's types, as this crate exports them; all texts live as long as the instance, which is
    // used according to the standard and freed once.
    unsafe {
        let make = function::<fmi3InstantiateCoSimulationTYPE>(library, "fmi3InstantiateCoSimulation")?;
        let free = function::<fmi3FreeInstanceTYPE>(library, "fmi3FreeInstance")?;
        let enter = function::<fmi3EnterInitializationModeTYPE>(library, "fmi3EnterInitializationMode")?;
        let exit = function::<fmi3ExitInitializationModeTYPE>(library, "fmi3ExitInitializationMode")?;
        let (name, token, folder) = (name.as_ptr(), token.as_ptr(), folder.as_ptr());
        let instance = make(name, token, folder, 0, 0, 0, 0, null(), 0, null_mut(), None, None);
        if instance.is_null() {
            return Err(UNKNOWN.into());
        }
        let ok = enter(instance, 0, 0.0, 0.0, 0, 0.0) == fmi3Status::fmi3OK && exit(instance) == fmi3Status::fmi3OK;
        free(instance);
        if ok { Ok(()) } else { Err(NOT_INITIALIZED.into()) }
    }
}

/// A function of the library.
///
/// # Safety
/// The function has the type `T`, an optional function pointer.
unsafe fn function<T: IntoIterator + Copy>(library: &Library, name: &str) -> Result<T::Item, String> {
    // SAFETY: by this function's contract.
    let symbol: Symbol<'_, T> = unsafe { library.get(name) }.map_err(|error| error.to_string())?;
    (*symbol).into_iter().next().ok_or_else(|| format!("{name} is missing"))
}
