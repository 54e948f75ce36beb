// Made by `scripts/bindings` with bindgen 0.73.2 from `fmu-export/src/fmi2/fmi2.h`. Do not edit: change the header and run it again.
// SHA-256 of the header: f84e013b8a03b39e781c1ca641bebb3497553225235ffe8b0bd21f2f39f9623a

pub const fmi2TypesPlatform: &::core::ffi::CStr = c"default";
pub const fmi2Version: &::core::ffi::CStr = c"2.0";
pub const fmi2True: i32 = 1;
pub const fmi2False: i32 = 0;
#[doc = " One instance of the FMU; only the FMU knows what it points to."]
pub type fmi2Component = *mut ::core::ffi::c_void;
#[doc = " A pointer of the importer's, handed back to it with every callback and never looked into."]
pub type fmi2ComponentEnvironment = *mut ::core::ffi::c_void;
#[doc = " A snapshot of one instance; only the FMU knows what it points to."]
pub type fmi2FMUstate = *mut ::core::ffi::c_void;
#[doc = " The number by which a variable is named in calls, unique within one base type."]
pub type fmi2ValueReference = ::core::ffi::c_uint;
#[doc = " A value of a Real variable, in the variable's unit."]
pub type fmi2Real = f64;
#[doc = " A value of an Integer or an Enumeration variable."]
pub type fmi2Integer = ::core::ffi::c_int;
#[doc = " A value of a Boolean variable: fmi2True or fmi2False."]
pub type fmi2Boolean = ::core::ffi::c_int;
#[doc = " One byte of a text in UTF-8."]
pub type fmi2Char = ::core::ffi::c_char;
#[doc = " A text in UTF-8 that ends with a zero byte; whoever receives it copies it before the call returns."]
pub type fmi2String = *const fmi2Char;
#[doc = " One byte of a serialized snapshot."]
pub type fmi2Byte = ::core::ffi::c_char;
impl fmi2Status {
    #[doc = " All is well."]
    pub const fmi2OK: fmi2Status = fmi2Status(0);
    #[doc = " Something is not quite right, and the simulation can go on."]
    pub const fmi2Warning: fmi2Status = fmi2Status(1);
    #[doc = " The call had no effect; for a step, it was not carried out to its end."]
    pub const fmi2Discard: fmi2Status = fmi2Status(2);
    #[doc = " The instance cannot go on; other instances can."]
    pub const fmi2Error: fmi2Status = fmi2Status(3);
    #[doc = " No instance of this FMU can go on."]
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
#[doc = " The kind of interface an instance is made for."]
#[derive(Debug, Copy, Clone, Hash, PartialEq, Eq)]
pub struct fmi2Type(pub ::core::ffi::c_uint);
impl fmi2StatusKind {
    #[doc = " How the pending step ended, or fmi2Pending: asked with fmi2GetStatus."]
    pub const fmi2DoStepStatus: fmi2StatusKind = fmi2StatusKind(0);
    #[doc = " A text on the pending step: asked with fmi2GetStringStatus."]
    pub const fmi2PendingStatus: fmi2StatusKind = fmi2StatusKind(1);
    #[doc = " The time up to which the last step succeeded, in seconds: asked with fmi2GetRealStatus."]
    pub const fmi2LastSuccessfulTime: fmi2StatusKind = fmi2StatusKind(2);
    #[doc = " Whether the FMU wants the simulation to end: asked with fmi2GetBooleanStatus."]
    pub const fmi2Terminated: fmi2StatusKind = fmi2StatusKind(3);
}
#[repr(transparent)]
#[doc = " The question put to fmi2GetStatus and its companions."]
#[derive(Debug, Copy, Clone, Hash, PartialEq, Eq)]
pub struct fmi2StatusKind(pub ::core::ffi::c_uint);
#[doc = " Takes a message: environment, instance name, status, category, then a format and its arguments as for printf."]
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
#[doc = " Gives zeroed memory for a number of objects of a size in bytes, or a null pointer."]
pub type fmi2CallbackAllocateMemory =
    ::core::option::Option<unsafe extern "C" fn(nobj: usize, size: usize) -> *mut ::core::ffi::c_void>;
#[doc = " Takes back memory that fmi2CallbackAllocateMemory gave; a null pointer is allowed."]
pub type fmi2CallbackFreeMemory = ::core::option::Option<unsafe extern "C" fn(obj: *mut ::core::ffi::c_void)>;
#[doc = " Is told that a pending step has ended, and how."]
pub type fmi2StepFinished =
    ::core::option::Option<unsafe extern "C" fn(componentEnvironment: fmi2ComponentEnvironment, status: fmi2Status)>;
#[doc = " The callbacks, and the pointer that goes with them; they live as long as the instance."]
#[repr(C)]
#[derive(Debug, Copy, Clone)]
pub struct fmi2CallbackFunctions {
    #[doc = " Takes messages."]
    pub logger: fmi2CallbackLogger,
    #[doc = " Gives memory."]
    pub allocateMemory: fmi2CallbackAllocateMemory,
    #[doc = " Takes memory back."]
    pub freeMemory: fmi2CallbackFreeMemory,
    #[doc = " Is told of the end of a pending step; null if the importer wants no such steps."]
    pub stepFinished: fmi2StepFinished,
    #[doc = " Handed back with every message and every end of a step."]
    pub componentEnvironment: fmi2ComponentEnvironment,
}
#[doc = " Tells the types on which the two sides agree."]
pub type fmi2GetTypesPlatformTYPE = ::core::option::Option<unsafe extern "C" fn() -> *const ::core::ffi::c_char>;
#[doc = " Tells the version of the standard."]
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
#[doc = " Makes an instance, or answers a null pointer."]
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
#[doc = " Gives back everything an instance holds; a null pointer is allowed."]
pub type fmi2FreeInstanceTYPE = ::core::option::Option<unsafe extern "C" fn(c: fmi2Component)>;
#[doc = " Tells tolerance, start and stop time, in seconds, before initialization."]
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
#[doc = " Puts an instance back to what it was when it was made."]
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
#[doc = " Takes a snapshot: a new one if the pointer is null, else into the one that it points to."]
pub type fmi2GetFMUstateTYPE =
    ::core::option::Option<unsafe extern "C" fn(c: fmi2Component, FMUstate: *mut fmi2FMUstate) -> fmi2Status>;
#[doc = " Puts an instance back to a snapshot, which stays valid."]
pub type fmi2SetFMUstateTYPE =
    ::core::option::Option<unsafe extern "C" fn(c: fmi2Component, FMUstate: fmi2FMUstate) -> fmi2Status>;
#[doc = " Gives a snapshot back and sets its pointer to null; a null pointer is allowed."]
pub type fmi2FreeFMUstateTYPE =
    ::core::option::Option<unsafe extern "C" fn(c: fmi2Component, FMUstate: *mut fmi2FMUstate) -> fmi2Status>;
#[doc = " Tells how many bytes a snapshot takes when serialized."]
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
#[doc = " Gives the product of the Jacobian of the unknowns by the knowns with a direction."]
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
#[doc = " Tells derivatives of inputs by time, of the orders given (1 is the first derivative)."]
pub type fmi2SetRealInputDerivativesTYPE = ::core::option::Option<
    unsafe extern "C" fn(
        c: fmi2Component,
        vr: *const fmi2ValueReference,
        nvr: usize,
        order: *const fmi2Integer,
        value: *const fmi2Real,
    ) -> fmi2Status,
>;
#[doc = " Reads derivatives of outputs by time, of the orders given (1 is the first derivative)."]
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
#[doc = " Gives up a pending step."]
pub type fmi2CancelStepTYPE = ::core::option::Option<unsafe extern "C" fn(c: fmi2Component) -> fmi2Status>;
#[doc = " Answers a question about the step with a status."]
pub type fmi2GetStatusTYPE = ::core::option::Option<
    unsafe extern "C" fn(c: fmi2Component, s: fmi2StatusKind, value: *mut fmi2Status) -> fmi2Status,
>;
#[doc = " Answers a question about the step with a Real."]
pub type fmi2GetRealStatusTYPE = ::core::option::Option<
    unsafe extern "C" fn(c: fmi2Component, s: fmi2StatusKind, value: *mut fmi2Real) -> fmi2Status,
>;
#[doc = " Answers a question about the step with an Integer."]
pub type fmi2GetIntegerStatusTYPE = ::core::option::Option<
    unsafe extern "C" fn(c: fmi2Component, s: fmi2StatusKind, value: *mut fmi2Integer) -> fmi2Status,
>;
#[doc = " Answers a question about the step with a Boolean."]
pub type fmi2GetBooleanStatusTYPE = ::core::option::Option<
    unsafe extern "C" fn(c: fmi2Component, s: fmi2StatusKind, value: *mut fmi2Boolean) -> fmi2Status,
>;
#[doc = " Answers a question about the step with a text."]
pub type fmi2GetStringStatusTYPE = ::core::option::Option<
    unsafe extern "C" fn(c: fmi2Component, s: fmi2StatusKind, value: *mut fmi2String) -> fmi2Status,
>;
