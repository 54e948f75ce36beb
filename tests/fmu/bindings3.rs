//! The bindings of FMI 3.0 are current, and agree with the standard.
//!
//! The expected values follow the standard (FMI 3.0, chapters 2 to 5), not made from the header. `scripts/bindings
//! --check` regenerates the bindings and compares; that needs libclang, these tests do not.

use core::ffi::{c_char, c_void};
use core::mem::size_of;

use crate::bindings::{are_made_from, signatures};
use fmu_export::fmi3::bindings::*;

const HEADER: &[u8] = include_bytes!("../../fmu-export/src/fmi3/fmi3.h");
const BINDINGS: &str = include_str!("../../fmu-export/src/fmi3/bindings.rs");

signatures! {
    fmi3GetVersionTYPE = fn() -> *const c_char;
    fmi3SetDebugLoggingTYPE = fn(*mut c_void, u8, usize, *const *const c_char) -> fmi3Status;
    fmi3InstantiateModelExchangeTYPE = fn(*const c_char, *const c_char, *const c_char, u8, u8, *mut c_void,
        fmi3LogMessageCallback) -> *mut c_void;
    fmi3InstantiateCoSimulationTYPE = fn(*const c_char, *const c_char, *const c_char, u8, u8, u8, u8,
        *const u32, usize, *mut c_void, fmi3LogMessageCallback, fmi3IntermediateUpdateCallback) -> *mut c_void;
    fmi3InstantiateScheduledExecutionTYPE = fn(*const c_char, *const c_char, *const c_char, u8, u8,
        *mut c_void, fmi3LogMessageCallback, fmi3ClockUpdateCallback, fmi3LockPreemptionCallback,
        fmi3UnlockPreemptionCallback) -> *mut c_void;
    fmi3FreeInstanceTYPE = fn(*mut c_void);
    fmi3EnterInitializationModeTYPE = fn(*mut c_void, u8, f64, f64, u8, f64) -> fmi3Status;
    fmi3ExitInitializationModeTYPE = fn(*mut c_void) -> fmi3Status;
    fmi3EnterEventModeTYPE = fn(*mut c_void) -> fmi3Status;
    fmi3TerminateTYPE = fn(*mut c_void) -> fmi3Status;
    fmi3ResetTYPE = fn(*mut c_void) -> fmi3Status;
    fmi3GetFloat32TYPE = fn(*mut c_void, *const u32, usize, *mut f32, usize) -> fmi3Status;
    fmi3GetFloat64TYPE = fn(*mut c_void, *const u32, usize, *mut f64, usize) -> fmi3Status;
    fmi3GetInt8TYPE = fn(*mut c_void, *const u32, usize, *mut i8, usize) -> fmi3Status;
    fmi3GetUInt8TYPE = fn(*mut c_void, *const u32, usize, *mut u8, usize) -> fmi3Status;
    fmi3GetInt16TYPE = fn(*mut c_void, *const u32, usize, *mut i16, usize) -> fmi3Status;
    fmi3GetUInt16TYPE = fn(*mut c_void, *const u32, usize, *mut u16, usize) -> fmi3Status;
    fmi3GetInt32TYPE = fn(*mut c_void, *const u32, usize, *mut i32, usize) -> fmi3Status;
    fmi3GetUInt32TYPE = fn(*mut c_void, *const u32, usize, *mut u32, usize) -> fmi3Status;
    fmi3GetInt64TYPE = fn(*mut c_void, *const u32, usize, *mut i64, usize) -> fmi3Status;
    fmi3GetUInt64TYPE = fn(*mut c_void, *const u32, usize, *mut u64, usize) -> fmi3Status;
    fmi3GetBooleanTYPE = fn(*mut c_void, *const u32, usize, *mut u8, usize) -> fmi3Status;
    fmi3GetStringTYPE = fn(*mut c_void, *const u32, usize, *mut *const c_char, usize) -> fmi3Status;
    fmi3GetBinaryTYPE = fn(*mut c_void, *const u32, usize, *mut usize, *mut *const u8, usize) -> fmi3Status;
    fmi3GetClockTYPE = fn(*mut c_void, *const u32, usize, *mut u8) -> fmi3Status;
    fmi3SetFloat32TYPE = fn(*mut c_void, *const u32, usize, *const f32, usize) -> fmi3Status;
    fmi3SetFloat64TYPE = fn(*mut c_void, *const u32, usize, *const f64, usize) -> fmi3Status;
    fmi3SetInt8TYPE = fn(*mut c_void, *const u32, usize, *const i8, usize) -> fmi3Status;
    fmi3SetUInt8TYPE = fn(*mut c_void, *const u32, usize, *const u8, usize) -> fmi3Status;
    fmi3SetInt16TYPE = fn(*mut c_void, *const u32, usize, *const i16, usize) -> fmi3Status;
    fmi3SetUInt16TYPE = fn(*mut c_void, *const u32, usize, *const u16, usize) -> fmi3Status;
    fmi3SetInt32TYPE = fn(*mut c_void, *const u32, usize, *const i32, usize) -> fmi3Status;
    fmi3SetUInt32TYPE = fn(*mut c_void, *const u32, usize, *const u32, usize) -> fmi3Status;
    fmi3SetInt64TYPE = fn(*mut c_void, *const u32, usize, *const i64, usize) -> fmi3Status;
    fmi3SetUInt64TYPE = fn(*mut c_void, *const u32, usize, *const u64, usize) -> fmi3Status;
    fmi3SetBooleanTYPE = fn(*mut c_void, *const u32, usize, *const u8, usize) -> fmi3Status;
    fmi3SetStringTYPE = fn(*mut c_void, *const u32, usize, *const *const c_char, usize) -> fmi3Status;
    fmi3SetBinaryTYPE = fn(*mut c_void, *const u32, usize, *const usize, *const *const u8, usize) -> fmi3Status;
    fmi3SetClockTYPE = fn(*mut c_void, *const u32, usize, *const u8) -> fmi3Status;
    fmi3GetNumberOfVariableDependenciesTYPE = fn(*mut c_void, u32, *mut usize) -> fmi3Status;
    fmi3GetVariableDependenciesTYPE = fn(*mut c_void, u32, *mut usize, *mut u32, *mut usize,
        *mut fmi3DependencyKind, usize) -> fmi3Status;
    fmi3GetFMUStateTYPE = fn(*mut c_void, *mut *mut c_void) -> fmi3Status;
    fmi3SetFMUStateTYPE = fn(*mut c_void, *mut c_void) -> fmi3Status;
    fmi3FreeFMUStateTYPE = fn(*mut c_void, *mut *mut c_void) -> fmi3Status;
    fmi3SerializedFMUStateSizeTYPE = fn(*mut c_void, *mut c_void, *mut usize) -> fmi3Status;
    fmi3SerializeFMUStateTYPE = fn(*mut c_void, *mut c_void, *mut u8, usize) -> fmi3Status;
    fmi3DeserializeFMUStateTYPE = fn(*mut c_void, *const u8, usize, *mut *mut c_void) -> fmi3Status;
    fmi3GetDirectionalDerivativeTYPE = fn(*mut c_void, *const u32, usize, *const u32, usize, *const f64,
        usize, *mut f64, usize) -> fmi3Status;
    fmi3GetAdjointDerivativeTYPE = fn(*mut c_void, *const u32, usize, *const u32, usize, *const f64, usize,
        *mut f64, usize) -> fmi3Status;
    fmi3EnterConfigurationModeTYPE = fn(*mut c_void) -> fmi3Status;
    fmi3ExitConfigurationModeTYPE = fn(*mut c_void) -> fmi3Status;
    fmi3GetIntervalDecimalTYPE = fn(*mut c_void, *const u32, usize, *mut f64, *mut fmi3IntervalQualifier) -> fmi3Status;
    fmi3GetIntervalFractionTYPE = fn(*mut c_void, *const u32, usize, *mut u64, *mut u64,
        *mut fmi3IntervalQualifier) -> fmi3Status;
    fmi3GetShiftDecimalTYPE = fn(*mut c_void, *const u32, usize, *mut f64) -> fmi3Status;
    fmi3GetShiftFractionTYPE = fn(*mut c_void, *const u32, usize, *mut u64, *mut u64) -> fmi3Status;
    fmi3SetIntervalDecimalTYPE = fn(*mut c_void, *const u32, usize, *const f64) -> fmi3Status;
    fmi3SetIntervalFractionTYPE = fn(*mut c_void, *const u32, usize, *const u64, *const u64) -> fmi3Status;
    fmi3SetShiftDecimalTYPE = fn(*mut c_void, *const u32, usize, *const f64) -> fmi3Status;
    fmi3SetShiftFractionTYPE = fn(*mut c_void, *const u32, usize, *const u64, *const u64) -> fmi3Status;
    fmi3EvaluateDiscreteStatesTYPE = fn(*mut c_void) -> fmi3Status;
    fmi3UpdateDiscreteStatesTYPE = fn(*mut c_void, *mut u8, *mut u8, *mut u8, *mut u8, *mut u8, *mut f64) -> fmi3Status;
    fmi3EnterContinuousTimeModeTYPE = fn(*mut c_void) -> fmi3Status;
    fmi3CompletedIntegratorStepTYPE = fn(*mut c_void, u8, *mut u8, *mut u8) -> fmi3Status;
    fmi3SetTimeTYPE = fn(*mut c_void, f64) -> fmi3Status;
    fmi3SetContinuousStatesTYPE = fn(*mut c_void, *const f64, usize) -> fmi3Status;
    fmi3GetContinuousStateDerivativesTYPE = fn(*mut c_void, *mut f64, usize) -> fmi3Status;
    fmi3GetEventIndicatorsTYPE = fn(*mut c_void, *mut f64, usize) -> fmi3Status;
    fmi3GetContinuousStatesTYPE = fn(*mut c_void, *mut f64, usize) -> fmi3Status;
    fmi3GetNominalsOfContinuousStatesTYPE = fn(*mut c_void, *mut f64, usize) -> fmi3Status;
    fmi3GetNumberOfEventIndicatorsTYPE = fn(*mut c_void, *mut usize) -> fmi3Status;
    fmi3GetNumberOfContinuousStatesTYPE = fn(*mut c_void, *mut usize) -> fmi3Status;
    fmi3EnterStepModeTYPE = fn(*mut c_void) -> fmi3Status;
    fmi3GetOutputDerivativesTYPE = fn(*mut c_void, *const u32, usize, *const i32, *mut f64, usize) -> fmi3Status;
    fmi3DoStepTYPE = fn(*mut c_void, f64, f64, u8, *mut u8, *mut u8, *mut u8, *mut f64) -> fmi3Status;
    fmi3ActivateModelPartitionTYPE = fn(*mut c_void, u32, f64) -> fmi3Status;
}

const _: fmi3LogMessageCallback = None::<unsafe extern "C" fn(*mut c_void, fmi3Status, *const c_char, *const c_char)>;
const _: fmi3IntermediateUpdateCallback =
    None::<unsafe extern "C" fn(*mut c_void, f64, u8, u8, u8, u8, *mut u8, *mut f64)>;
const _: fmi3ClockUpdateCallback = None::<unsafe extern "C" fn(*mut c_void)>;
const _: fmi3LockPreemptionCallback = None::<unsafe extern "C" fn()>;
const _: fmi3UnlockPreemptionCallback = None::<unsafe extern "C" fn()>;

#[test]
fn the_bindings_were_made_from_this_header() {
    are_made_from(HEADER, BINDINGS, ALIASES, 75);
}

/// A Rust `bool` must be 0 or 1, and an importer may pass any byte.
#[test]
fn no_boolean_is_one_of_rust() {
    assert!(!BINDINGS.contains("bool"), "a Boolean of the importer is a byte");
}

#[test]
fn the_constants_are_those_of_the_standard() {
    assert_eq!(fmi3Version, c"3.0");
    assert_eq!([fmi3False, fmi3True, fmi3ClockInactive, fmi3ClockActive], [0, 1, 0, 1]);
    let statuses = [
        fmi3Status::fmi3OK,
        fmi3Status::fmi3Warning,
        fmi3Status::fmi3Discard,
        fmi3Status::fmi3Error,
        fmi3Status::fmi3Fatal,
    ];
    assert_eq!(statuses.map(|status| status.0), [0, 1, 2, 3, 4]);
    assert_eq!([size_of::<fmi3Status>(), size_of::<fmi3Boolean>(), size_of::<fmi3Clock>()], [4, 1, 1]);
}
