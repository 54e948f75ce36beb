// Made by `scripts/bindings` with bindgen 0.73.2 from `fmu-export/src/fmi2/fmi2.h`. Do not edit: change the header and run it again.
// SHA-256 of the header: 753cbb332c82e00f7cc2c8725f1863aeaba658c85182a31aefa256a563654902

pub const fmi2TypesPlatform: &::core::ffi::CStr = c"default";
pub const fmi2Version: &::core::ffi::CStr = c"2.0";
pub const fmi2True: i32 = 1;
pub const fmi2False: i32 = 0;
#[doc = " One instance of the FMU; opaque to the importer."]
pub type fmi2Component = *mut ::core::ffi::c_void;
#[doc = " A pointer of the importer, passed back with every callback; opaque to the FMU."]
pub type fmi2ComponentEnvironment = *mut ::core::ffi::c_void;
#[doc = " A snapshot of one instance; opaque to the importer."]
pub type fmi2FMUstate = *mut ::core::ffi::c_void;
#[doc = " The number that identifies a variable in calls, unique within one base type."]
pub type fmi2ValueReference = ::core::ffi::c_uint;
#[doc = " A value of a Real variable, in the variable's unit."]
pub type fmi2Real = f64;
#[doc = " A value of an Integer or an Enumeration variable."]
pub type fmi2Integer = ::core::ffi::c_int;
#[doc = " A value of a Boolean variable: fmi2True or fmi2False."]
pub type fmi2Boolean = ::core::ffi::c_int;
#[doc = " One byte of a text in UTF-8."]
pub type fmi2Char = ::core::ffi::c_char;
#[doc = " A zero-terminated text in UTF-8; the receiver copies it before the call returns."]
pub type fmi2String = *const fmi2Char;
#[doc = " One byte of a serialized snapshot."]
pub type fmi2Byte = ::core::ffi::c_char;
impl fmi2Status {
    #[doc = " All is well."]
    pub const fmi2OK: fmi2Status = fmi2Status(0);
    #[doc = " Something is unusual; the simulation can continue."]
    pub const fmi2Warning: fmi2Status = fmi2Status(1);
    #[doc = " The call had no effect; a step was not completed."]
    pub const fmi2Discard: fmi2Status = fmi2Status(2);
    #[doc = " The instance cannot continue; other instances can."]
    pub const fmi2Error: fmi2Status = fmi2Status(3);
    #[doc = " No instance of this FMU can continue."]
    pub const fmi2Fatal: fmi2Status = fmi2Status(4);
    #[doc = " The step was started and will be reported by stepFinished."]
    pub const fmi2Pending: fmi2Status = fmi2Status(5);
}
#[repr(transparent)]
#[doc = " How a call ended."]
#[derive(Debug, Copy, Clone, Hash, PartialEq, Eq)]
pub struct fmi2Status(pub ::core::ffi::c_uint);
impl fmi2Type {
    #[doc = " The importer integrates the equations."]
    pub const fmi2ModelExchange: fmi2Type = fmi2Type(0);
    #[doc = " The FMU integrates its own equations."]
    pub const fmi2CoSimulation: fmi2Type = fmi2Type(1);
}
#[repr(transparent)]
#[doc = " The interface type of an instance."]
#[derive(Debug, Copy, Clone, Hash, PartialEq, Eq)]
pub struct fmi2Type(pub ::core::ffi::c_uint);
impl fmi2StatusKind {
    #[doc = " Outcome of the pending step, or fmi2Pending: for fmi2GetStatus."]
    pub const fmi2DoStepStatus: fmi2StatusKind = fmi2StatusKind(0);
    #[doc = " A text on the pending step: for fmi2GetStringStatus."]
    pub const fmi2PendingStatus: fmi2StatusKind = fmi2StatusKind(1);
    #[doc = " The time up to which the last step succeeded, in seconds: for fmi2GetRealStatus."]
    pub const fmi2LastSuccessfulTime: fmi2StatusKind = fmi2StatusKind(2);
    #[doc = " Whether the FMU wants the simulation to end: for fmi2GetBooleanStatus."]
    pub const fmi2Terminated: fmi2StatusKind = fmi2StatusKind(3);
}
#[repr(transparent)]
#[doc = " The query of fmi2GetStatus and its companions."]
#[derive(Debug, Copy, Clone, Hash, PartialEq, Eq)]
pub struct fmi2StatusKind(pub ::core::ffi::c_uint);
#[doc = " Receives a message: environment, instance name, status, category, then a format and its arguments as for printf."]
pub type fmi2CallbackLogger = ::core::option::Option<
    unsafe extern "C" fn(
        componentEnvironment: fmi2ComponentEnvironment,
        instanceName: fmi2String,
        status: fmi2Status,
        category: fmi2String,
        message: fmi2String,
        ...
    ),
>;
#[doc = " Allocates zeroed memory for a number of objects of a size in bytes, or returns a null pointer."]
pub type fmi2CallbackAllocateMemory =
    ::core::option::Option<unsafe extern "C" fn(nobj: usize, size: usize) -> *mut ::core::ffi::c_void>;
#[doc = " Frees memory from fmi2CallbackAllocateMemory; a null pointer is allowed."]
pub type fmi2CallbackFreeMemory = ::core::option::Option<unsafe extern "C" fn(obj: *mut ::core::ffi::c_void)>;
#[doc = " Is called when a pending step has ended, with its status."]
pub type fmi2StepFinished =
    ::core::option::Option<unsafe extern "C" fn(componentEnvironment: fmi2ComponentEnvironment, status: fmi2Status)>;
#[doc = " The callbacks and their environment; they live as long as the instance."]
#[repr(C)]
#[derive(Debug, Copy, Clone)]
pub struct fmi2CallbackFunctions {
    #[doc = " Receives messages."]
    pub logger: fmi2CallbackLogger,
    #[doc = " Allocates memory."]
    pub allocateMemory: fmi2CallbackAllocateMemory,
    #[doc = " Frees memory."]
    pub freeMemory: fmi2CallbackFreeMemory,
    #[doc = " Is called at the end of a pending step; null if the importer wants no such steps."]
    pub stepFinished: fmi2StepFinished,
    #[doc = " Passed back with every message and every end of a step."]
    pub componentEnvironment: fmi2ComponentEnvironment,
}
#[doc = " Returns the types platform of the interface."]
pub type fmi2GetTypesPlatformTYPE = ::core::option::Option<unsafe extern "C" fn() -> *const ::core::ffi::c_char>;
#[doc = " Returns the version of the standard."]
pub type fmi2GetVersionTYPE = ::core::option::Option<unsafe extern "C" fn() -> *const ::core::ffi::c_char>;
#[doc = " Turns messages of the named categories on or off; no categories named means all of them."]
pub type fmi2SetDebugLoggingTYPE = ::core::option::Option<
    unsafe extern "C" fn(
        c: fmi2Component,
        loggingOn: fmi2Boolean,
        nCategories: usize,
        categories: *const fmi2String,
    ) -> fmi2Status,
>;
#[doc = " Makes an instance, or returns a null pointer."]
pub type fmi2InstantiateTYPE = ::core::option::Option<
    unsafe extern "C" fn(
        instanceName: fmi2String,
        fmuType: fmi2Type,
        fmuGUID: fmi2String,
        fmuResourceLocation: fmi2String,
        functions: *const fmi2CallbackFunctions,
        visible: fmi2Boolean,
        loggingOn: fmi2Boolean,
    ) -> fmi2Component,
>;
#[doc = " Frees an instance; a null pointer is allowed."]
pub type fmi2FreeInstanceTYPE = ::core::option::Option<unsafe extern "C" fn(c: fmi2Component)>;
#[doc = " Sets tolerance, start and stop time, in seconds, before initialization."]
pub type fmi2SetupExperimentTYPE = ::core::option::Option<
    unsafe extern "C" fn(
        c: fmi2Component,
        toleranceDefined: fmi2Boolean,
        tolerance: fmi2Real,
        startTime: fmi2Real,
        stopTimeDefined: fmi2Boolean,
        stopTime: fmi2Real,
    ) -> fmi2Status,
>;
#[doc = " Begins initialization."]
pub type fmi2EnterInitializationModeTYPE = ::core::option::Option<unsafe extern "C" fn(c: fmi2Component) -> fmi2Status>;
#[doc = " Ends initialization; steps may follow."]
pub type fmi2ExitInitializationModeTYPE = ::core::option::Option<unsafe extern "C" fn(c: fmi2Component) -> fmi2Status>;
#[doc = " Ends the simulation; results can still be read."]
pub type fmi2TerminateTYPE = ::core::option::Option<unsafe extern "C" fn(c: fmi2Component) -> fmi2Status>;
#[doc = " Resets an instance to its initial state."]
pub type fmi2ResetTYPE = ::core::option::Option<unsafe extern "C" fn(c: fmi2Component) -> fmi2Status>;
#[doc = " Reads Real variables."]
pub type fmi2GetRealTYPE = ::core::option::Option<
    unsafe extern "C" fn(
        c: fmi2Component,
        vr: *const fmi2ValueReference,
        nvr: usize,
        value: *mut fmi2Real,
    ) -> fmi2Status,
>;
#[doc = " Reads Integer variables."]
pub type fmi2GetIntegerTYPE = ::core::option::Option<
    unsafe extern "C" fn(
        c: fmi2Component,
        vr: *const fmi2ValueReference,
        nvr: usize,
        value: *mut fmi2Integer,
    ) -> fmi2Status,
>;
#[doc = " Reads Boolean variables."]
pub type fmi2GetBooleanTYPE = ::core::option::Option<
    unsafe extern "C" fn(
        c: fmi2Component,
        vr: *const fmi2ValueReference,
        nvr: usize,
        value: *mut fmi2Boolean,
    ) -> fmi2Status,
>;
#[doc = " Reads String variables; the texts stay valid until the next call on the same instance."]
pub type fmi2GetStringTYPE = ::core::option::Option<
    unsafe extern "C" fn(
        c: fmi2Component,
        vr: *const fmi2ValueReference,
        nvr: usize,
        value: *mut fmi2String,
    ) -> fmi2Status,
>;
#[doc = " Writes Real variables."]
pub type fmi2SetRealTYPE = ::core::option::Option<
    unsafe extern "C" fn(
        c: fmi2Component,
        vr: *const fmi2ValueReference,
        nvr: usize,
        value: *const fmi2Real,
    ) -> fmi2Status,
>;
#[doc = " Writes Integer variables."]
pub type fmi2SetIntegerTYPE = ::core::option::Option<
    unsafe extern "C" fn(
        c: fmi2Component,
        vr: *const fmi2ValueReference,
        nvr: usize,
        value: *const fmi2Integer,
    ) -> fmi2Status,
>;
#[doc = " Writes Boolean variables."]
pub type fmi2SetBooleanTYPE = ::core::option::Option<
    unsafe extern "C" fn(
        c: fmi2Component,
        vr: *const fmi2ValueReference,
        nvr: usize,
        value: *const fmi2Boolean,
    ) -> fmi2Status,
>;
#[doc = " Writes String variables."]
pub type fmi2SetStringTYPE = ::core::option::Option<
    unsafe extern "C" fn(
        c: fmi2Component,
        vr: *const fmi2ValueReference,
        nvr: usize,
        value: *const fmi2String,
    ) -> fmi2Status,
>;
#[doc = " Takes a snapshot: a new one if the pointer is null, else into the existing one."]
pub type fmi2GetFMUstateTYPE =
    ::core::option::Option<unsafe extern "C" fn(c: fmi2Component, FMUstate: *mut fmi2FMUstate) -> fmi2Status>;
#[doc = " Restores a snapshot, which stays valid."]
pub type fmi2SetFMUstateTYPE =
    ::core::option::Option<unsafe extern "C" fn(c: fmi2Component, FMUstate: fmi2FMUstate) -> fmi2Status>;
#[doc = " Frees a snapshot and sets its pointer to null; a null pointer is allowed."]
pub type fmi2FreeFMUstateTYPE =
    ::core::option::Option<unsafe extern "C" fn(c: fmi2Component, FMUstate: *mut fmi2FMUstate) -> fmi2Status>;
#[doc = " Returns the size of a serialized snapshot, in bytes."]
pub type fmi2SerializedFMUstateSizeTYPE = ::core::option::Option<
    unsafe extern "C" fn(c: fmi2Component, FMUstate: fmi2FMUstate, size: *mut usize) -> fmi2Status,
>;
#[doc = " Writes a snapshot as bytes."]
pub type fmi2SerializeFMUstateTYPE = ::core::option::Option<
    unsafe extern "C" fn(
        c: fmi2Component,
        FMUstate: fmi2FMUstate,
        serializedState: *mut fmi2Byte,
        size: usize,
    ) -> fmi2Status,
>;
#[doc = " Makes a snapshot from bytes."]
pub type fmi2DeSerializeFMUstateTYPE = ::core::option::Option<
    unsafe extern "C" fn(
        c: fmi2Component,
        serializedState: *const fmi2Byte,
        size: usize,
        FMUstate: *mut fmi2FMUstate,
    ) -> fmi2Status,
>;
#[doc = " Returns the product of the Jacobian of the unknowns with respect to the knowns and a direction."]
pub type fmi2GetDirectionalDerivativeTYPE = ::core::option::Option<
    unsafe extern "C" fn(
        c: fmi2Component,
        vUnknown_ref: *const fmi2ValueReference,
        nUnknown: usize,
        vKnown_ref: *const fmi2ValueReference,
        nKnown: usize,
        dvKnown: *const fmi2Real,
        dvUnknown: *mut fmi2Real,
    ) -> fmi2Status,
>;
#[doc = " Sets time derivatives of inputs, of the given orders (1 is the first derivative)."]
pub type fmi2SetRealInputDerivativesTYPE = ::core::option::Option<
    unsafe extern "C" fn(
        c: fmi2Component,
        vr: *const fmi2ValueReference,
        nvr: usize,
        order: *const fmi2Integer,
        value: *const fmi2Real,
    ) -> fmi2Status,
>;
#[doc = " Reads time derivatives of outputs, of the given orders (1 is the first derivative)."]
pub type fmi2GetRealOutputDerivativesTYPE = ::core::option::Option<
    unsafe extern "C" fn(
        c: fmi2Component,
        vr: *const fmi2ValueReference,
        nvr: usize,
        order: *const fmi2Integer,
        value: *mut fmi2Real,
    ) -> fmi2Status,
>;
#[doc = " Steps from a time by a step size, both in seconds."]
pub type fmi2DoStepTYPE = ::core::option::Option<
    unsafe extern "C" fn(
        c: fmi2Component,
        currentCommunicationPoint: fmi2Real,
        communicationStepSize: fmi2Real,
        noSetFMUStatePriorToCurrentPoint: fmi2Boolean,
    ) -> fmi2Status,
>;
#[doc = " Cancels a pending step."]
pub type fmi2CancelStepTYPE = ::core::option::Option<unsafe extern "C" fn(c: fmi2Component) -> fmi2Status>;
#[doc = " Answers a query about the step with a status."]
pub type fmi2GetStatusTYPE = ::core::option::Option<
    unsafe extern "C" fn(c: fmi2Component, s: fmi2StatusKind, value: *mut fmi2Status) -> fmi2Status,
>;
#[doc = " Answers a query about the step with a Real."]
pub type fmi2GetRealStatusTYPE = ::core::option::Option<
    unsafe extern "C" fn(c: fmi2Component, s: fmi2StatusKind, value: *mut fmi2Real) -> fmi2Status,
>;
#[doc = " Answers a query about the step with an Integer."]
pub type fmi2GetIntegerStatusTYPE = ::core::option::Option<
    unsafe extern "C" fn(c: fmi2Component, s: fmi2StatusKind, value: *mut fmi2Integer) -> fmi2Status,
>;
#[doc = " Answers a query about the step with a Boolean."]
pub type fmi2GetBooleanStatusTYPE = ::core::option::Option<
    unsafe extern "C" fn(c: fmi2Component, s: fmi2StatusKind, value: *mut fmi2Boolean) -> fmi2Status,
>;
#[doc = " Answers a query about the step with a text."]
pub type fmi2GetStringStatusTYPE = ::core::option::Option<
    unsafe extern "C" fn(c: fmi2Component, s: fmi2StatusKind, value: *mut fmi2String) -> fmi2Status,
>;
