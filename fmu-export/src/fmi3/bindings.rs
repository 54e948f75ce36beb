// Made by `scripts/bindings` with bindgen 0.73.2 from `fmu-export/src/fmi3/fmi3.h`. Do not edit: change the header and run it again.
// SHA-256 of the header: b6b3e7e68d57e8df89e91b092fb2a29559b99924495cecfdf8cb60ed6f531b0b

/// fmi3True or fmi3False.
pub type fmi3Boolean = u8;
/// Whether a clock ticks: fmi3ClockActive or fmi3ClockInactive.
pub type fmi3Clock = u8;

pub const fmi3Version: &::core::ffi::CStr = c"3.0";
pub const fmi3True: i32 = 1;
pub const fmi3False: i32 = 0;
pub const fmi3ClockActive: i32 = 1;
pub const fmi3ClockInactive: i32 = 0;
#[doc = " One instance of the FMU; opaque to the importer."]
pub type fmi3Instance = *mut ::core::ffi::c_void;
#[doc = " A pointer of the importer, passed back with every callback; opaque to the FMU."]
pub type fmi3InstanceEnvironment = *mut ::core::ffi::c_void;
#[doc = " A snapshot of one instance; opaque to the importer."]
pub type fmi3FMUState = *mut ::core::ffi::c_void;
#[doc = " The number that identifies a variable in calls, unique within the FMU."]
pub type fmi3ValueReference = u32;
#[doc = " A real number in single precision."]
pub type fmi3Float32 = f32;
#[doc = " A real number in double precision, in the variable's unit."]
pub type fmi3Float64 = f64;
#[doc = " A whole number of 8 bits."]
pub type fmi3Int8 = i8;
#[doc = " A whole number of 8 bits, 0 or above."]
pub type fmi3UInt8 = u8;
#[doc = " A whole number of 16 bits."]
pub type fmi3Int16 = i16;
#[doc = " A whole number of 16 bits, 0 or above."]
pub type fmi3UInt16 = u16;
#[doc = " A whole number of 32 bits."]
pub type fmi3Int32 = i32;
#[doc = " A whole number of 32 bits, 0 or above."]
pub type fmi3UInt32 = u32;
#[doc = " A whole number of 64 bits, or the value of an enumeration."]
pub type fmi3Int64 = i64;
#[doc = " A whole number of 64 bits, 0 or above."]
pub type fmi3UInt64 = u64;
#[doc = " One byte of a text in UTF-8."]
pub type fmi3Char = ::core::ffi::c_char;
#[doc = " A zero-terminated text in UTF-8; the receiver copies it before the call returns."]
pub type fmi3String = *const fmi3Char;
#[doc = " One byte of binary data."]
pub type fmi3Byte = u8;
#[doc = " Binary data, whose size is passed separately."]
pub type fmi3Binary = *const fmi3Byte;
impl fmi3Status {
    #[doc = " All is well."]
    pub const fmi3OK: fmi3Status = fmi3Status(0);
    #[doc = " Something is unusual; the simulation can continue."]
    pub const fmi3Warning: fmi3Status = fmi3Status(1);
    #[doc = " The call had no effect."]
    pub const fmi3Discard: fmi3Status = fmi3Status(2);
    #[doc = " The instance cannot continue; other instances can."]
    pub const fmi3Error: fmi3Status = fmi3Status(3);
    #[doc = " No instance of this FMU can continue."]
    pub const fmi3Fatal: fmi3Status = fmi3Status(4);
}
#[repr(transparent)]
#[doc = " How a call ended."]
#[derive(Debug, Copy, Clone, Hash, PartialEq, Eq)]
pub struct fmi3Status(pub ::core::ffi::c_uint);
impl fmi3DependencyKind {
    #[doc = " Not at all."]
    pub const fmi3Independent: fmi3DependencyKind = fmi3DependencyKind(0);
    #[doc = " By a constant factor."]
    pub const fmi3Constant: fmi3DependencyKind = fmi3DependencyKind(1);
    #[doc = " By a factor that is constant after initialization."]
    pub const fmi3Fixed: fmi3DependencyKind = fmi3DependencyKind(2);
    #[doc = " By a factor that changes with tunable parameters."]
    pub const fmi3Tunable: fmi3DependencyKind = fmi3DependencyKind(3);
    #[doc = " By a factor that changes at events."]
    pub const fmi3Discrete: fmi3DependencyKind = fmi3DependencyKind(4);
    #[doc = " In any way."]
    pub const fmi3Dependent: fmi3DependencyKind = fmi3DependencyKind(5);
}
#[repr(transparent)]
#[doc = " How an unknown depends on a known."]
#[derive(Debug, Copy, Clone, Hash, PartialEq, Eq)]
pub struct fmi3DependencyKind(pub ::core::ffi::c_uint);
impl fmi3IntervalQualifier {
    #[doc = " Not yet."]
    pub const fmi3IntervalNotYetKnown: fmi3IntervalQualifier = fmi3IntervalQualifier(0);
    #[doc = " Unchanged."]
    pub const fmi3IntervalUnchanged: fmi3IntervalQualifier = fmi3IntervalQualifier(1);
    #[doc = " New."]
    pub const fmi3IntervalChanged: fmi3IntervalQualifier = fmi3IntervalQualifier(2);
}
#[repr(transparent)]
#[doc = " Whether the interval of a clock is known."]
#[derive(Debug, Copy, Clone, Hash, PartialEq, Eq)]
pub struct fmi3IntervalQualifier(pub ::core::ffi::c_uint);
#[doc = " Receives a message."]
pub type fmi3LogMessageCallback = ::core::option::Option<
    unsafe extern "C" fn(
        instanceEnvironment: fmi3InstanceEnvironment,
        status: fmi3Status,
        category: fmi3String,
        message: fmi3String,
    ),
>;
#[doc = " Is called when clocks tick."]
pub type fmi3ClockUpdateCallback =
    ::core::option::Option<unsafe extern "C" fn(instanceEnvironment: fmi3InstanceEnvironment)>;
#[doc = " Is called within a step, where inputs and outputs may be exchanged."]
pub type fmi3IntermediateUpdateCallback = ::core::option::Option<
    unsafe extern "C" fn(
        instanceEnvironment: fmi3InstanceEnvironment,
        intermediateUpdateTime: fmi3Float64,
        intermediateVariableSetRequested: fmi3Boolean,
        intermediateVariableGetAllowed: fmi3Boolean,
        intermediateStepFinished: fmi3Boolean,
        canReturnEarly: fmi3Boolean,
        earlyReturnRequested: *mut fmi3Boolean,
        earlyReturnTime: *mut fmi3Float64,
    ),
>;
#[doc = " Locks preemption of a model partition."]
pub type fmi3LockPreemptionCallback = ::core::option::Option<unsafe extern "C" fn()>;
#[doc = " Unlocks preemption of a model partition."]
pub type fmi3UnlockPreemptionCallback = ::core::option::Option<unsafe extern "C" fn()>;
#[doc = " Returns the version of the standard."]
pub type fmi3GetVersionTYPE = ::core::option::Option<unsafe extern "C" fn() -> *const ::core::ffi::c_char>;
#[doc = " Turns messages of the named categories on or off; no categories named means all of them."]
pub type fmi3SetDebugLoggingTYPE = ::core::option::Option<
    unsafe extern "C" fn(
        instance: fmi3Instance,
        loggingOn: fmi3Boolean,
        nCategories: usize,
        categories: *const fmi3String,
    ) -> fmi3Status,
>;
#[doc = " Makes an instance for model exchange, or returns a null pointer."]
pub type fmi3InstantiateModelExchangeTYPE = ::core::option::Option<
    unsafe extern "C" fn(
        instanceName: fmi3String,
        instantiationToken: fmi3String,
        resourcePath: fmi3String,
        visible: fmi3Boolean,
        loggingOn: fmi3Boolean,
        instanceEnvironment: fmi3InstanceEnvironment,
        logMessage: fmi3LogMessageCallback,
    ) -> fmi3Instance,
>;
#[doc = " Makes an instance for co-simulation, or returns a null pointer."]
pub type fmi3InstantiateCoSimulationTYPE = ::core::option::Option<
    unsafe extern "C" fn(
        instanceName: fmi3String,
        instantiationToken: fmi3String,
        resourcePath: fmi3String,
        visible: fmi3Boolean,
        loggingOn: fmi3Boolean,
        eventModeUsed: fmi3Boolean,
        earlyReturnAllowed: fmi3Boolean,
        requiredIntermediateVariables: *const fmi3ValueReference,
        nRequiredIntermediateVariables: usize,
        instanceEnvironment: fmi3InstanceEnvironment,
        logMessage: fmi3LogMessageCallback,
        intermediateUpdate: fmi3IntermediateUpdateCallback,
    ) -> fmi3Instance,
>;
#[doc = " Makes an instance for scheduled execution, or returns a null pointer."]
pub type fmi3InstantiateScheduledExecutionTYPE = ::core::option::Option<
    unsafe extern "C" fn(
        instanceName: fmi3String,
        instantiationToken: fmi3String,
        resourcePath: fmi3String,
        visible: fmi3Boolean,
        loggingOn: fmi3Boolean,
        instanceEnvironment: fmi3InstanceEnvironment,
        logMessage: fmi3LogMessageCallback,
        clockUpdate: fmi3ClockUpdateCallback,
        lockPreemption: fmi3LockPreemptionCallback,
        unlockPreemption: fmi3UnlockPreemptionCallback,
    ) -> fmi3Instance,
>;
#[doc = " Frees an instance; a null pointer is allowed."]
pub type fmi3FreeInstanceTYPE = ::core::option::Option<unsafe extern "C" fn(instance: fmi3Instance)>;
#[doc = " Begins initialization, with tolerance, start and stop time, in seconds."]
pub type fmi3EnterInitializationModeTYPE = ::core::option::Option<
    unsafe extern "C" fn(
        instance: fmi3Instance,
        toleranceDefined: fmi3Boolean,
        tolerance: fmi3Float64,
        startTime: fmi3Float64,
        stopTimeDefined: fmi3Boolean,
        stopTime: fmi3Float64,
    ) -> fmi3Status,
>;
#[doc = " Ends initialization; event mode follows if it is used, else step mode."]
pub type fmi3ExitInitializationModeTYPE =
    ::core::option::Option<unsafe extern "C" fn(instance: fmi3Instance) -> fmi3Status>;
#[doc = " Begins the handling of an event."]
pub type fmi3EnterEventModeTYPE = ::core::option::Option<unsafe extern "C" fn(instance: fmi3Instance) -> fmi3Status>;
#[doc = " Ends the simulation; results can still be read."]
pub type fmi3TerminateTYPE = ::core::option::Option<unsafe extern "C" fn(instance: fmi3Instance) -> fmi3Status>;
#[doc = " Resets an instance to its initial state."]
pub type fmi3ResetTYPE = ::core::option::Option<unsafe extern "C" fn(instance: fmi3Instance) -> fmi3Status>;
#[doc = " Reads Float32 variables."]
pub type fmi3GetFloat32TYPE = ::core::option::Option<
    unsafe extern "C" fn(
        instance: fmi3Instance,
        valueReferences: *const fmi3ValueReference,
        nValueReferences: usize,
        values: *mut fmi3Float32,
        nValues: usize,
    ) -> fmi3Status,
>;
#[doc = " Reads Float64 variables."]
pub type fmi3GetFloat64TYPE = ::core::option::Option<
    unsafe extern "C" fn(
        instance: fmi3Instance,
        valueReferences: *const fmi3ValueReference,
        nValueReferences: usize,
        values: *mut fmi3Float64,
        nValues: usize,
    ) -> fmi3Status,
>;
#[doc = " Reads Int8 variables."]
pub type fmi3GetInt8TYPE = ::core::option::Option<
    unsafe extern "C" fn(
        instance: fmi3Instance,
        valueReferences: *const fmi3ValueReference,
        nValueReferences: usize,
        values: *mut fmi3Int8,
        nValues: usize,
    ) -> fmi3Status,
>;
#[doc = " Reads UInt8 variables."]
pub type fmi3GetUInt8TYPE = ::core::option::Option<
    unsafe extern "C" fn(
        instance: fmi3Instance,
        valueReferences: *const fmi3ValueReference,
        nValueReferences: usize,
        values: *mut fmi3UInt8,
        nValues: usize,
    ) -> fmi3Status,
>;
#[doc = " Reads Int16 variables."]
pub type fmi3GetInt16TYPE = ::core::option::Option<
    unsafe extern "C" fn(
        instance: fmi3Instance,
        valueReferences: *const fmi3ValueReference,
        nValueReferences: usize,
        values: *mut fmi3Int16,
        nValues: usize,
    ) -> fmi3Status,
>;
#[doc = " Reads UInt16 variables."]
pub type fmi3GetUInt16TYPE = ::core::option::Option<
    unsafe extern "C" fn(
        instance: fmi3Instance,
        valueReferences: *const fmi3ValueReference,
        nValueReferences: usize,
        values: *mut fmi3UInt16,
        nValues: usize,
    ) -> fmi3Status,
>;
#[doc = " Reads Int32 variables."]
pub type fmi3GetInt32TYPE = ::core::option::Option<
    unsafe extern "C" fn(
        instance: fmi3Instance,
        valueReferences: *const fmi3ValueReference,
        nValueReferences: usize,
        values: *mut fmi3Int32,
        nValues: usize,
    ) -> fmi3Status,
>;
#[doc = " Reads UInt32 variables."]
pub type fmi3GetUInt32TYPE = ::core::option::Option<
    unsafe extern "C" fn(
        instance: fmi3Instance,
        valueReferences: *const fmi3ValueReference,
        nValueReferences: usize,
        values: *mut fmi3UInt32,
        nValues: usize,
    ) -> fmi3Status,
>;
#[doc = " Reads Int64 variables."]
pub type fmi3GetInt64TYPE = ::core::option::Option<
    unsafe extern "C" fn(
        instance: fmi3Instance,
        valueReferences: *const fmi3ValueReference,
        nValueReferences: usize,
        values: *mut fmi3Int64,
        nValues: usize,
    ) -> fmi3Status,
>;
#[doc = " Reads UInt64 variables."]
pub type fmi3GetUInt64TYPE = ::core::option::Option<
    unsafe extern "C" fn(
        instance: fmi3Instance,
        valueReferences: *const fmi3ValueReference,
        nValueReferences: usize,
        values: *mut fmi3UInt64,
        nValues: usize,
    ) -> fmi3Status,
>;
#[doc = " Reads Boolean variables."]
pub type fmi3GetBooleanTYPE = ::core::option::Option<
    unsafe extern "C" fn(
        instance: fmi3Instance,
        valueReferences: *const fmi3ValueReference,
        nValueReferences: usize,
        values: *mut fmi3Boolean,
        nValues: usize,
    ) -> fmi3Status,
>;
#[doc = " Reads String variables; the texts stay valid until the next call on the same instance."]
pub type fmi3GetStringTYPE = ::core::option::Option<
    unsafe extern "C" fn(
        instance: fmi3Instance,
        valueReferences: *const fmi3ValueReference,
        nValueReferences: usize,
        values: *mut fmi3String,
        nValues: usize,
    ) -> fmi3Status,
>;
#[doc = " Reads Binary variables."]
pub type fmi3GetBinaryTYPE = ::core::option::Option<
    unsafe extern "C" fn(
        instance: fmi3Instance,
        valueReferences: *const fmi3ValueReference,
        nValueReferences: usize,
        valueSizes: *mut usize,
        values: *mut fmi3Binary,
        nValues: usize,
    ) -> fmi3Status,
>;
#[doc = " Reads whether clocks are active."]
pub type fmi3GetClockTYPE = ::core::option::Option<
    unsafe extern "C" fn(
        instance: fmi3Instance,
        valueReferences: *const fmi3ValueReference,
        nValueReferences: usize,
        values: *mut fmi3Clock,
    ) -> fmi3Status,
>;
#[doc = " Writes Float32 variables."]
pub type fmi3SetFloat32TYPE = ::core::option::Option<
    unsafe extern "C" fn(
        instance: fmi3Instance,
        valueReferences: *const fmi3ValueReference,
        nValueReferences: usize,
        values: *const fmi3Float32,
        nValues: usize,
    ) -> fmi3Status,
>;
#[doc = " Writes Float64 variables."]
pub type fmi3SetFloat64TYPE = ::core::option::Option<
    unsafe extern "C" fn(
        instance: fmi3Instance,
        valueReferences: *const fmi3ValueReference,
        nValueReferences: usize,
        values: *const fmi3Float64,
        nValues: usize,
    ) -> fmi3Status,
>;
#[doc = " Writes Int8 variables."]
pub type fmi3SetInt8TYPE = ::core::option::Option<
    unsafe extern "C" fn(
        instance: fmi3Instance,
        valueReferences: *const fmi3ValueReference,
        nValueReferences: usize,
        values: *const fmi3Int8,
        nValues: usize,
    ) -> fmi3Status,
>;
#[doc = " Writes UInt8 variables."]
pub type fmi3SetUInt8TYPE = ::core::option::Option<
    unsafe extern "C" fn(
        instance: fmi3Instance,
        valueReferences: *const fmi3ValueReference,
        nValueReferences: usize,
        values: *const fmi3UInt8,
        nValues: usize,
    ) -> fmi3Status,
>;
#[doc = " Writes Int16 variables."]
pub type fmi3SetInt16TYPE = ::core::option::Option<
    unsafe extern "C" fn(
        instance: fmi3Instance,
        valueReferences: *const fmi3ValueReference,
        nValueReferences: usize,
        values: *const fmi3Int16,
        nValues: usize,
    ) -> fmi3Status,
>;
#[doc = " Writes UInt16 variables."]
pub type fmi3SetUInt16TYPE = ::core::option::Option<
    unsafe extern "C" fn(
        instance: fmi3Instance,
        valueReferences: *const fmi3ValueReference,
        nValueReferences: usize,
        values: *const fmi3UInt16,
        nValues: usize,
    ) -> fmi3Status,
>;
#[doc = " Writes Int32 variables."]
pub type fmi3SetInt32TYPE = ::core::option::Option<
    unsafe extern "C" fn(
        instance: fmi3Instance,
        valueReferences: *const fmi3ValueReference,
        nValueReferences: usize,
        values: *const fmi3Int32,
        nValues: usize,
    ) -> fmi3Status,
>;
#[doc = " Writes UInt32 variables."]
pub type fmi3SetUInt32TYPE = ::core::option::Option<
    unsafe extern "C" fn(
        instance: fmi3Instance,
        valueReferences: *const fmi3ValueReference,
        nValueReferences: usize,
        values: *const fmi3UInt32,
        nValues: usize,
    ) -> fmi3Status,
>;
#[doc = " Writes Int64 variables."]
pub type fmi3SetInt64TYPE = ::core::option::Option<
    unsafe extern "C" fn(
        instance: fmi3Instance,
        valueReferences: *const fmi3ValueReference,
        nValueReferences: usize,
        values: *const fmi3Int64,
        nValues: usize,
    ) -> fmi3Status,
>;
#[doc = " Writes UInt64 variables."]
pub type fmi3SetUInt64TYPE = ::core::option::Option<
    unsafe extern "C" fn(
        instance: fmi3Instance,
        valueReferences: *const fmi3ValueReference,
        nValueReferences: usize,
        values: *const fmi3UInt64,
        nValues: usize,
    ) -> fmi3Status,
>;
#[doc = " Writes Boolean variables."]
pub type fmi3SetBooleanTYPE = ::core::option::Option<
    unsafe extern "C" fn(
        instance: fmi3Instance,
        valueReferences: *const fmi3ValueReference,
        nValueReferences: usize,
        values: *const fmi3Boolean,
        nValues: usize,
    ) -> fmi3Status,
>;
#[doc = " Writes String variables."]
pub type fmi3SetStringTYPE = ::core::option::Option<
    unsafe extern "C" fn(
        instance: fmi3Instance,
        valueReferences: *const fmi3ValueReference,
        nValueReferences: usize,
        values: *const fmi3String,
        nValues: usize,
    ) -> fmi3Status,
>;
#[doc = " Writes Binary variables."]
pub type fmi3SetBinaryTYPE = ::core::option::Option<
    unsafe extern "C" fn(
        instance: fmi3Instance,
        valueReferences: *const fmi3ValueReference,
        nValueReferences: usize,
        valueSizes: *const usize,
        values: *const fmi3Binary,
        nValues: usize,
    ) -> fmi3Status,
>;
#[doc = " Activates clocks."]
pub type fmi3SetClockTYPE = ::core::option::Option<
    unsafe extern "C" fn(
        instance: fmi3Instance,
        valueReferences: *const fmi3ValueReference,
        nValueReferences: usize,
        values: *const fmi3Clock,
    ) -> fmi3Status,
>;
#[doc = " Counts the dependencies of a variable."]
pub type fmi3GetNumberOfVariableDependenciesTYPE = ::core::option::Option<
    unsafe extern "C" fn(
        instance: fmi3Instance,
        valueReference: fmi3ValueReference,
        nDependencies: *mut usize,
    ) -> fmi3Status,
>;
#[doc = " Reads the dependencies of a variable."]
pub type fmi3GetVariableDependenciesTYPE = ::core::option::Option<
    unsafe extern "C" fn(
        instance: fmi3Instance,
        dependent: fmi3ValueReference,
        elementIndicesOfDependent: *mut usize,
        independents: *mut fmi3ValueReference,
        elementIndicesOfIndependents: *mut usize,
        dependencyKinds: *mut fmi3DependencyKind,
        nDependencies: usize,
    ) -> fmi3Status,
>;
#[doc = " Takes a snapshot: a new one if the pointer is null, else into the existing one."]
pub type fmi3GetFMUStateTYPE =
    ::core::option::Option<unsafe extern "C" fn(instance: fmi3Instance, FMUState: *mut fmi3FMUState) -> fmi3Status>;
#[doc = " Restores a snapshot, which stays valid."]
pub type fmi3SetFMUStateTYPE =
    ::core::option::Option<unsafe extern "C" fn(instance: fmi3Instance, FMUState: fmi3FMUState) -> fmi3Status>;
#[doc = " Frees a snapshot and sets its pointer to null; a null pointer is allowed."]
pub type fmi3FreeFMUStateTYPE =
    ::core::option::Option<unsafe extern "C" fn(instance: fmi3Instance, FMUState: *mut fmi3FMUState) -> fmi3Status>;
#[doc = " Returns the size of a serialized snapshot, in bytes."]
pub type fmi3SerializedFMUStateSizeTYPE = ::core::option::Option<
    unsafe extern "C" fn(instance: fmi3Instance, FMUState: fmi3FMUState, size: *mut usize) -> fmi3Status,
>;
#[doc = " Writes a snapshot as bytes."]
pub type fmi3SerializeFMUStateTYPE = ::core::option::Option<
    unsafe extern "C" fn(
        instance: fmi3Instance,
        FMUState: fmi3FMUState,
        serializedState: *mut fmi3Byte,
        size: usize,
    ) -> fmi3Status,
>;
#[doc = " Makes a snapshot from bytes."]
pub type fmi3DeserializeFMUStateTYPE = ::core::option::Option<
    unsafe extern "C" fn(
        instance: fmi3Instance,
        serializedState: *const fmi3Byte,
        size: usize,
        FMUState: *mut fmi3FMUState,
    ) -> fmi3Status,
>;
#[doc = " Returns the product of the Jacobian of the unknowns with respect to the knowns and a vector."]
pub type fmi3GetDirectionalDerivativeTYPE = ::core::option::Option<
    unsafe extern "C" fn(
        instance: fmi3Instance,
        unknowns: *const fmi3ValueReference,
        nUnknowns: usize,
        knowns: *const fmi3ValueReference,
        nKnowns: usize,
        seed: *const fmi3Float64,
        nSeed: usize,
        sensitivity: *mut fmi3Float64,
        nSensitivity: usize,
    ) -> fmi3Status,
>;
#[doc = " Returns the product of a vector and the Jacobian of the unknowns with respect to the knowns."]
pub type fmi3GetAdjointDerivativeTYPE = ::core::option::Option<
    unsafe extern "C" fn(
        instance: fmi3Instance,
        unknowns: *const fmi3ValueReference,
        nUnknowns: usize,
        knowns: *const fmi3ValueReference,
        nKnowns: usize,
        seed: *const fmi3Float64,
        nSeed: usize,
        sensitivity: *mut fmi3Float64,
        nSensitivity: usize,
    ) -> fmi3Status,
>;
#[doc = " Starts the change of structural parameters."]
pub type fmi3EnterConfigurationModeTYPE =
    ::core::option::Option<unsafe extern "C" fn(instance: fmi3Instance) -> fmi3Status>;
#[doc = " Ends the change of structural parameters."]
pub type fmi3ExitConfigurationModeTYPE =
    ::core::option::Option<unsafe extern "C" fn(instance: fmi3Instance) -> fmi3Status>;
#[doc = " Reads the intervals of clocks, in seconds."]
pub type fmi3GetIntervalDecimalTYPE = ::core::option::Option<
    unsafe extern "C" fn(
        instance: fmi3Instance,
        valueReferences: *const fmi3ValueReference,
        nValueReferences: usize,
        intervals: *mut fmi3Float64,
        qualifiers: *mut fmi3IntervalQualifier,
    ) -> fmi3Status,
>;
#[doc = " Reads the intervals of clocks, as fractions."]
pub type fmi3GetIntervalFractionTYPE = ::core::option::Option<
    unsafe extern "C" fn(
        instance: fmi3Instance,
        valueReferences: *const fmi3ValueReference,
        nValueReferences: usize,
        counters: *mut fmi3UInt64,
        resolutions: *mut fmi3UInt64,
        qualifiers: *mut fmi3IntervalQualifier,
    ) -> fmi3Status,
>;
#[doc = " Reads the delays of clocks, in seconds."]
pub type fmi3GetShiftDecimalTYPE = ::core::option::Option<
    unsafe extern "C" fn(
        instance: fmi3Instance,
        valueReferences: *const fmi3ValueReference,
        nValueReferences: usize,
        shifts: *mut fmi3Float64,
    ) -> fmi3Status,
>;
#[doc = " Reads the delays of clocks, as fractions."]
pub type fmi3GetShiftFractionTYPE = ::core::option::Option<
    unsafe extern "C" fn(
        instance: fmi3Instance,
        valueReferences: *const fmi3ValueReference,
        nValueReferences: usize,
        counters: *mut fmi3UInt64,
        resolutions: *mut fmi3UInt64,
    ) -> fmi3Status,
>;
#[doc = " Sets the intervals of clocks, in seconds."]
pub type fmi3SetIntervalDecimalTYPE = ::core::option::Option<
    unsafe extern "C" fn(
        instance: fmi3Instance,
        valueReferences: *const fmi3ValueReference,
        nValueReferences: usize,
        intervals: *const fmi3Float64,
    ) -> fmi3Status,
>;
#[doc = " Sets the intervals of clocks, as fractions."]
pub type fmi3SetIntervalFractionTYPE = ::core::option::Option<
    unsafe extern "C" fn(
        instance: fmi3Instance,
        valueReferences: *const fmi3ValueReference,
        nValueReferences: usize,
        counters: *const fmi3UInt64,
        resolutions: *const fmi3UInt64,
    ) -> fmi3Status,
>;
#[doc = " Sets the delays of clocks, in seconds."]
pub type fmi3SetShiftDecimalTYPE = ::core::option::Option<
    unsafe extern "C" fn(
        instance: fmi3Instance,
        valueReferences: *const fmi3ValueReference,
        nValueReferences: usize,
        shifts: *const fmi3Float64,
    ) -> fmi3Status,
>;
#[doc = " Sets the delays of clocks, as fractions."]
pub type fmi3SetShiftFractionTYPE = ::core::option::Option<
    unsafe extern "C" fn(
        instance: fmi3Instance,
        valueReferences: *const fmi3ValueReference,
        nValueReferences: usize,
        counters: *const fmi3UInt64,
        resolutions: *const fmi3UInt64,
    ) -> fmi3Status,
>;
#[doc = " Computes discrete states without ending the event."]
pub type fmi3EvaluateDiscreteStatesTYPE =
    ::core::option::Option<unsafe extern "C" fn(instance: fmi3Instance) -> fmi3Status>;
#[doc = " Computes discrete states, and reports the consequences of the event."]
pub type fmi3UpdateDiscreteStatesTYPE = ::core::option::Option<
    unsafe extern "C" fn(
        instance: fmi3Instance,
        discreteStatesNeedUpdate: *mut fmi3Boolean,
        terminateSimulation: *mut fmi3Boolean,
        nominalsOfContinuousStatesChanged: *mut fmi3Boolean,
        valuesOfContinuousStatesChanged: *mut fmi3Boolean,
        nextEventTimeDefined: *mut fmi3Boolean,
        nextEventTime: *mut fmi3Float64,
    ) -> fmi3Status,
>;
#[doc = " Ends the handling of an event in model exchange."]
pub type fmi3EnterContinuousTimeModeTYPE =
    ::core::option::Option<unsafe extern "C" fn(instance: fmi3Instance) -> fmi3Status>;
#[doc = " Reports a completed step of the importer's integrator."]
pub type fmi3CompletedIntegratorStepTYPE = ::core::option::Option<
    unsafe extern "C" fn(
        instance: fmi3Instance,
        noSetFMUStatePriorToCurrentPoint: fmi3Boolean,
        enterEventMode: *mut fmi3Boolean,
        terminateSimulation: *mut fmi3Boolean,
    ) -> fmi3Status,
>;
#[doc = " Sets the time."]
pub type fmi3SetTimeTYPE =
    ::core::option::Option<unsafe extern "C" fn(instance: fmi3Instance, time: fmi3Float64) -> fmi3Status>;
#[doc = " Sets the continuous states."]
pub type fmi3SetContinuousStatesTYPE = ::core::option::Option<
    unsafe extern "C" fn(
        instance: fmi3Instance,
        continuousStates: *const fmi3Float64,
        nContinuousStates: usize,
    ) -> fmi3Status,
>;
#[doc = " Reads the derivatives of the continuous states."]
pub type fmi3GetContinuousStateDerivativesTYPE = ::core::option::Option<
    unsafe extern "C" fn(instance: fmi3Instance, derivatives: *mut fmi3Float64, nContinuousStates: usize) -> fmi3Status,
>;
#[doc = " Reads the event indicators."]
pub type fmi3GetEventIndicatorsTYPE = ::core::option::Option<
    unsafe extern "C" fn(
        instance: fmi3Instance,
        eventIndicators: *mut fmi3Float64,
        nEventIndicators: usize,
    ) -> fmi3Status,
>;
#[doc = " Reads the continuous states."]
pub type fmi3GetContinuousStatesTYPE = ::core::option::Option<
    unsafe extern "C" fn(
        instance: fmi3Instance,
        continuousStates: *mut fmi3Float64,
        nContinuousStates: usize,
    ) -> fmi3Status,
>;
#[doc = " Reads the nominal values of the continuous states."]
pub type fmi3GetNominalsOfContinuousStatesTYPE = ::core::option::Option<
    unsafe extern "C" fn(instance: fmi3Instance, nominals: *mut fmi3Float64, nContinuousStates: usize) -> fmi3Status,
>;
#[doc = " Counts the event indicators."]
pub type fmi3GetNumberOfEventIndicatorsTYPE =
    ::core::option::Option<unsafe extern "C" fn(instance: fmi3Instance, nEventIndicators: *mut usize) -> fmi3Status>;
#[doc = " Counts the continuous states."]
pub type fmi3GetNumberOfContinuousStatesTYPE =
    ::core::option::Option<unsafe extern "C" fn(instance: fmi3Instance, nContinuousStates: *mut usize) -> fmi3Status>;
#[doc = " Ends the handling of an event in co-simulation."]
pub type fmi3EnterStepModeTYPE = ::core::option::Option<unsafe extern "C" fn(instance: fmi3Instance) -> fmi3Status>;
#[doc = " Reads time derivatives of outputs, of the given orders (1 is the first derivative)."]
pub type fmi3GetOutputDerivativesTYPE = ::core::option::Option<
    unsafe extern "C" fn(
        instance: fmi3Instance,
        valueReferences: *const fmi3ValueReference,
        nValueReferences: usize,
        orders: *const fmi3Int32,
        values: *mut fmi3Float64,
        nValues: usize,
    ) -> fmi3Status,
>;
#[doc = " Steps from a time by a step size, both in seconds."]
pub type fmi3DoStepTYPE = ::core::option::Option<
    unsafe extern "C" fn(
        instance: fmi3Instance,
        currentCommunicationPoint: fmi3Float64,
        communicationStepSize: fmi3Float64,
        noSetFMUStatePriorToCurrentPoint: fmi3Boolean,
        eventHandlingNeeded: *mut fmi3Boolean,
        terminateSimulation: *mut fmi3Boolean,
        earlyReturn: *mut fmi3Boolean,
        lastSuccessfulTime: *mut fmi3Float64,
    ) -> fmi3Status,
>;
#[doc = " Computes the model partition of a clock."]
pub type fmi3ActivateModelPartitionTYPE = ::core::option::Option<
    unsafe extern "C" fn(
        instance: fmi3Instance,
        clockReference: fmi3ValueReference,
        activationTime: fmi3Float64,
    ) -> fmi3Status,
>;
