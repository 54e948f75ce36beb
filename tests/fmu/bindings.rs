//! The bindings are current, and agree with the standard.
//!
//! The expected values are written by hand after the standard (FMI 2.0, chapters 2.1 and 4.2), not made from the header.
//! `scripts/bindings --check` regenerates the bindings and compares; that needs libclang, these tests do not.

use core::ffi::{c_char, c_int, c_uint, c_void};
use core::mem::{align_of, offset_of, size_of};

use fmu_export::fmi2::bindings::*;
use sha2::{Digest, Sha256};

/// Checks while compiling that each alias has the signature given, and collects the names.
macro_rules! signatures {
    ($($alias:ident = fn($($argument:ty),*) $(-> $result:ty)?;)*) => {
        $(const _: $alias = None::<unsafe extern "C" fn($($argument),*) $(-> $result)?>;)*
        const ALIASES: &[&str] = &[$(stringify!($alias)),*];
    };
}
pub(crate) use signatures;

/// Fails if a header was changed without running `scripts/bindings`, if a function has no type, and if one is declared beside our own definition.
pub fn are_made_from(header: &[u8], bindings: &str, aliases: &[&str], functions: usize) {
    let recorded = bindings.lines().find_map(|line| line.strip_prefix("// SHA-256 of the header: "));
    let digest: String = Sha256::digest(header).iter().map(|byte| format!("{byte:02x}")).collect();
    assert_eq!(recorded, Some(&*digest), "the header was changed without running scripts/bindings");
    let types = bindings.lines().filter_map(|line| line.strip_prefix("pub type ")?.split_whitespace().next());
    let mut found: Vec<&str> = types.filter(|name| name.ends_with("TYPE")).collect();
    let mut expected = aliases.to_vec();
    found.sort_unstable();
    expected.sort_unstable();
    assert_eq!(found, expected);
    assert_eq!(found.len(), functions);
    assert!(!bindings.contains("extern \"C\" {"), "the library defines these functions itself");
}

const HEADER: &[u8] = include_bytes!("../../fmu-export/src/fmi2/fmi2.h");
const BINDINGS: &str = include_str!("../../fmu-export/src/fmi2/bindings.rs");

signatures! {
    fmi2GetTypesPlatformTYPE = fn() -> *const c_char;
    fmi2GetVersionTYPE = fn() -> *const c_char;
    fmi2SetDebugLoggingTYPE = fn(*mut c_void, c_int, usize, *const *const c_char) -> fmi2Status;
    fmi2InstantiateTYPE = fn(*const c_char, fmi2Type, *const c_char, *const c_char, *const fmi2CallbackFunctions,
        c_int, c_int) -> *mut c_void;
    fmi2FreeInstanceTYPE = fn(*mut c_void);
    fmi2SetupExperimentTYPE = fn(*mut c_void, c_int, f64, f64, c_int, f64) -> fmi2Status;
    fmi2EnterInitializationModeTYPE = fn(*mut c_void) -> fmi2Status;
    fmi2ExitInitializationModeTYPE = fn(*mut c_void) -> fmi2Status;
    fmi2TerminateTYPE = fn(*mut c_void) -> fmi2Status;
    fmi2ResetTYPE = fn(*mut c_void) -> fmi2Status;
    fmi2GetRealTYPE = fn(*mut c_void, *const c_uint, usize, *mut f64) -> fmi2Status;
    fmi2GetIntegerTYPE = fn(*mut c_void, *const c_uint, usize, *mut c_int) -> fmi2Status;
    fmi2GetBooleanTYPE = fn(*mut c_void, *const c_uint, usize, *mut c_int) -> fmi2Status;
    fmi2GetStringTYPE = fn(*mut c_void, *const c_uint, usize, *mut *const c_char) -> fmi2Status;
    fmi2SetRealTYPE = fn(*mut c_void, *const c_uint, usize, *const f64) -> fmi2Status;
    fmi2SetIntegerTYPE = fn(*mut c_void, *const c_uint, usize, *const c_int) -> fmi2Status;
    fmi2SetBooleanTYPE = fn(*mut c_void, *const c_uint, usize, *const c_int) -> fmi2Status;
    fmi2SetStringTYPE = fn(*mut c_void, *const c_uint, usize, *const *const c_char) -> fmi2Status;
    fmi2GetFMUstateTYPE = fn(*mut c_void, *mut *mut c_void) -> fmi2Status;
    fmi2SetFMUstateTYPE = fn(*mut c_void, *mut c_void) -> fmi2Status;
    fmi2FreeFMUstateTYPE = fn(*mut c_void, *mut *mut c_void) -> fmi2Status;
    fmi2SerializedFMUstateSizeTYPE = fn(*mut c_void, *mut c_void, *mut usize) -> fmi2Status;
    fmi2SerializeFMUstateTYPE = fn(*mut c_void, *mut c_void, *mut c_char, usize) -> fmi2Status;
    fmi2DeSerializeFMUstateTYPE = fn(*mut c_void, *const c_char, usize, *mut *mut c_void) -> fmi2Status;
    fmi2GetDirectionalDerivativeTYPE = fn(*mut c_void, *const c_uint, usize, *const c_uint, usize,
        *const f64, *mut f64) -> fmi2Status;
    fmi2SetRealInputDerivativesTYPE = fn(*mut c_void, *const c_uint, usize, *const c_int, *const f64) -> fmi2Status;
    fmi2GetRealOutputDerivativesTYPE = fn(*mut c_void, *const c_uint, usize, *const c_int, *mut f64) -> fmi2Status;
    fmi2DoStepTYPE = fn(*mut c_void, f64, f64, c_int) -> fmi2Status;
    fmi2CancelStepTYPE = fn(*mut c_void) -> fmi2Status;
    fmi2GetStatusTYPE = fn(*mut c_void, fmi2StatusKind, *mut fmi2Status) -> fmi2Status;
    fmi2GetRealStatusTYPE = fn(*mut c_void, fmi2StatusKind, *mut f64) -> fmi2Status;
    fmi2GetIntegerStatusTYPE = fn(*mut c_void, fmi2StatusKind, *mut c_int) -> fmi2Status;
    fmi2GetBooleanStatusTYPE = fn(*mut c_void, fmi2StatusKind, *mut c_int) -> fmi2Status;
    fmi2GetStringStatusTYPE = fn(*mut c_void, fmi2StatusKind, *mut *const c_char) -> fmi2Status;
}

const _: fmi2CallbackLogger =
    None::<unsafe extern "C" fn(*mut c_void, *const c_char, fmi2Status, *const c_char, *const c_char, ...)>;
const _: fmi2CallbackAllocateMemory = None::<unsafe extern "C" fn(usize, usize) -> *mut c_void>;
const _: fmi2CallbackFreeMemory = None::<unsafe extern "C" fn(*mut c_void)>;
const _: fmi2StepFinished = None::<unsafe extern "C" fn(*mut c_void, fmi2Status)>;

#[test]
fn the_bindings_were_made_from_this_header() {
    are_made_from(HEADER, BINDINGS, ALIASES, 34);
}

#[test]
fn the_constants_are_those_of_the_standard() {
    assert_eq!((fmi2TypesPlatform, fmi2Version), (c"default", c"2.0"));
    assert_eq!((fmi2False, fmi2True), (0, 1));
    let statuses = [
        fmi2Status::fmi2OK,
        fmi2Status::fmi2Warning,
        fmi2Status::fmi2Discard,
        fmi2Status::fmi2Error,
        fmi2Status::fmi2Fatal,
        fmi2Status::fmi2Pending,
    ];
    assert_eq!(statuses.map(|status| status.0), [0, 1, 2, 3, 4, 5]);
    assert_eq!([fmi2Type::fmi2ModelExchange, fmi2Type::fmi2CoSimulation].map(|kind| kind.0), [0, 1]);
    let questions = [
        fmi2StatusKind::fmi2DoStepStatus,
        fmi2StatusKind::fmi2PendingStatus,
        fmi2StatusKind::fmi2LastSuccessfulTime,
        fmi2StatusKind::fmi2Terminated,
    ];
    assert_eq!(questions.map(|question| question.0), [0, 1, 2, 3]);
}

#[test]
fn the_sizes_are_those_of_the_platform_default() {
    let pointer = size_of::<*const c_void>();
    for (name, size, expected) in [
        ("fmi2Component", size_of::<fmi2Component>(), pointer),
        ("fmi2ComponentEnvironment", size_of::<fmi2ComponentEnvironment>(), pointer),
        ("fmi2FMUstate", size_of::<fmi2FMUstate>(), pointer),
        ("fmi2String", size_of::<fmi2String>(), pointer),
        ("fmi2ValueReference", size_of::<fmi2ValueReference>(), 4),
        ("fmi2Real", size_of::<fmi2Real>(), 8),
        ("fmi2Integer", size_of::<fmi2Integer>(), 4),
        ("fmi2Boolean", size_of::<fmi2Boolean>(), 4),
        ("fmi2Char", size_of::<fmi2Char>(), 1),
        ("fmi2Byte", size_of::<fmi2Byte>(), 1),
        ("fmi2Status", size_of::<fmi2Status>(), 4),
        ("fmi2Type", size_of::<fmi2Type>(), 4),
        ("fmi2StatusKind", size_of::<fmi2StatusKind>(), 4),
    ] {
        assert_eq!(size, expected, "bytes of {name}");
    }
}

#[test]
fn the_callbacks_lie_one_pointer_after_the_other() {
    let pointer = size_of::<*const c_void>();
    let places = [
        offset_of!(fmi2CallbackFunctions, logger),
        offset_of!(fmi2CallbackFunctions, allocateMemory),
        offset_of!(fmi2CallbackFunctions, freeMemory),
        offset_of!(fmi2CallbackFunctions, stepFinished),
        offset_of!(fmi2CallbackFunctions, componentEnvironment),
    ];
    assert_eq!(places, [0, 1, 2, 3, 4].map(|place| place * pointer));
    assert_eq!(size_of::<fmi2CallbackFunctions>(), 5 * pointer);
    assert_eq!(align_of::<fmi2CallbackFunctions>(), align_of::<*const c_void>());
}
