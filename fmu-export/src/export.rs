//! The macro that defines the C functions of a library.

/// Defines all functions of FMI 2.0 and FMI 3.0 for co-simulation in a library of the crate type `cdylib` with these models, and a static
/// [`Fmus`](crate::Fmus) named `FMUS` that lists them. Each model is a type that implements [`Model`](crate::Model) or
/// [`SampledModel`](crate::SampledModel).
///
/// The functions have the standard's names, so a binary can have them only once: use the macro once per crate, and not in a crate
/// on which another one with the macro depends, or the linker reports duplicate symbols. To put models of several crates into one
/// library, name them all in one call, in a crate that depends on the others.
///
/// ```ignore
/// fmu_export::export_fmus!(Pump, Valve, Tank);
/// ```
#[macro_export]
macro_rules! export_fmus {
    ($($model:ty),+ $(,)?) => {
        // No panic may reach the importer, and `panic = "abort"` would prevent catching it.
        #[cfg(not(panic = "unwind"))]
        ::core::compile_error!(
            "an FMU must be built with `panic = \"unwind\"`: with `panic = \"abort\"` a panic would end the program that \
             imports it; remove that line from the profile in Cargo.toml"
        );

        /// The models of this library.
        pub static FMUS: $crate::Fmus =
            $crate::Fmus::new(::core::env!("CARGO_CRATE_NAME"), || {
                // Finds the method of the trait that the type implements.
                #[allow(unused_imports, reason = "which kind of model there is depends on the crate")]
                use $crate::instance::kind::{Continuous as _, Sampled as _};
                ::std::vec![$((&$crate::instance::kind::Of::<$model>::NEW).model_type()),+]
            });

        $crate::__export_fmi2! {}
        $crate::__export_fmi3! {}
    };
}

/// Defines the functions of FMI 2.0, if the crate is built with the feature `fmi2`.
#[cfg(feature = "fmi2")]
#[doc(hidden)]
#[macro_export]
macro_rules! __export_fmi2 {
    () => {
        /// The functions of FMI 2.0 for co-simulation for the models of this library.
        #[allow(non_snake_case, missing_docs, clippy::missing_safety_doc, reason = "names and contracts are the standard's")]
        pub mod fmi2 {
            use $crate::fmi2::bindings::*;

            /// `fmi2Instantiate`.
            #[unsafe(no_mangle)]
            pub unsafe extern "C" fn fmi2Instantiate(
                instanceName: fmi2String,
                fmuType: fmi2Type,
                fmuGUID: fmi2String,
                fmuResourceLocation: fmi2String,
                functions: *const fmi2CallbackFunctions,
                _visible: fmi2Boolean,
                loggingOn: fmi2Boolean,
            ) -> fmi2Component {
                // SAFETY: the contract is the same.
                unsafe {
                    $crate::fmi2::functions::instantiate(
                        &super::FMUS, instanceName, fmuType, fmuGUID, fmuResourceLocation, functions, loggingOn,
                    )
                }
            }

            $crate::__export_functions! { fmi2:
                fmi2GetTypesPlatform() -> *const fmi2Char;
                fmi2GetVersion() -> *const fmi2Char;
                fmi2SetDebugLogging(c: fmi2Component, loggingOn: fmi2Boolean, nCategories: usize, categories: *const fmi2String) -> fmi2Status;
                fmi2FreeInstance(c: fmi2Component) -> ();
                fmi2SetupExperiment(c: fmi2Component, toleranceDefined: fmi2Boolean, tolerance: fmi2Real, startTime: fmi2Real, stopTimeDefined: fmi2Boolean, stopTime: fmi2Real) -> fmi2Status;
                fmi2EnterInitializationMode(c: fmi2Component) -> fmi2Status;
                fmi2ExitInitializationMode(c: fmi2Component) -> fmi2Status;
                fmi2Terminate(c: fmi2Component) -> fmi2Status;
                fmi2Reset(c: fmi2Component) -> fmi2Status;
                fmi2GetReal(c: fmi2Component, vr: *const fmi2ValueReference, nvr: usize, value: *mut fmi2Real) -> fmi2Status;
                fmi2GetInteger(c: fmi2Component, vr: *const fmi2ValueReference, nvr: usize, value: *mut fmi2Integer) -> fmi2Status;
                fmi2GetBoolean(c: fmi2Component, vr: *const fmi2ValueReference, nvr: usize, value: *mut fmi2Boolean) -> fmi2Status;
                fmi2GetString(c: fmi2Component, vr: *const fmi2ValueReference, nvr: usize, value: *mut fmi2String) -> fmi2Status;
                fmi2SetReal(c: fmi2Component, vr: *const fmi2ValueReference, nvr: usize, value: *const fmi2Real) -> fmi2Status;
                fmi2SetInteger(c: fmi2Component, vr: *const fmi2ValueReference, nvr: usize, value: *const fmi2Integer) -> fmi2Status;
                fmi2SetBoolean(c: fmi2Component, vr: *const fmi2ValueReference, nvr: usize, value: *const fmi2Boolean) -> fmi2Status;
                fmi2SetString(c: fmi2Component, vr: *const fmi2ValueReference, nvr: usize, value: *const fmi2String) -> fmi2Status;
                fmi2GetFMUstate(c: fmi2Component, FMUstate: *mut fmi2FMUstate) -> fmi2Status;
                fmi2SetFMUstate(c: fmi2Component, FMUstate: fmi2FMUstate) -> fmi2Status;
                fmi2FreeFMUstate(c: fmi2Component, FMUstate: *mut fmi2FMUstate) -> fmi2Status;
                fmi2SerializedFMUstateSize(c: fmi2Component, FMUstate: fmi2FMUstate, size: *mut usize) -> fmi2Status;
                fmi2SerializeFMUstate(c: fmi2Component, FMUstate: fmi2FMUstate, serializedState: *mut fmi2Byte, size: usize) -> fmi2Status;
                fmi2DeSerializeFMUstate(c: fmi2Component, serializedState: *const fmi2Byte, size: usize, FMUstate: *mut fmi2FMUstate) -> fmi2Status;
                fmi2GetDirectionalDerivative(c: fmi2Component, vUnknown_ref: *const fmi2ValueReference, nUnknown: usize, vKnown_ref: *const fmi2ValueReference, nKnown: usize, dvKnown: *const fmi2Real, dvUnknown: *mut fmi2Real) -> fmi2Status;
                fmi2SetRealInputDerivatives(c: fmi2Component, vr: *const fmi2ValueReference, nvr: usize, order: *const fmi2Integer, value: *const fmi2Real) -> fmi2Status;
                fmi2GetRealOutputDerivatives(c: fmi2Component, vr: *const fmi2ValueReference, nvr: usize, order: *const fmi2Integer, value: *mut fmi2Real) -> fmi2Status;
                fmi2DoStep(c: fmi2Component, currentCommunicationPoint: fmi2Real, communicationStepSize: fmi2Real, noSetFMUStatePriorToCurrentPoint: fmi2Boolean) -> fmi2Status;
                fmi2CancelStep(c: fmi2Component) -> fmi2Status;
                fmi2GetStatus(c: fmi2Component, s: fmi2StatusKind, value: *mut fmi2Status) -> fmi2Status;
                fmi2GetRealStatus(c: fmi2Component, s: fmi2StatusKind, value: *mut fmi2Real) -> fmi2Status;
                fmi2GetIntegerStatus(c: fmi2Component, s: fmi2StatusKind, value: *mut fmi2Integer) -> fmi2Status;
                fmi2GetBooleanStatus(c: fmi2Component, s: fmi2StatusKind, value: *mut fmi2Boolean) -> fmi2Status;
                fmi2GetStringStatus(c: fmi2Component, s: fmi2StatusKind, value: *mut fmi2String) -> fmi2Status;
            }
        }
    };
}

/// Defines the functions of FMI 2.0, if the crate is built with the feature `fmi2`.
#[cfg(not(feature = "fmi2"))]
#[doc(hidden)]
#[macro_export]
macro_rules! __export_fmi2 {
    () => {};
}

/// Defines the functions of FMI 3.0, if the crate is built with the feature `fmi3`.
#[cfg(feature = "fmi3")]
#[doc(hidden)]
#[macro_export]
macro_rules! __export_fmi3 {
    () => {
        /// The functions of FMI 3.0 for the models of this library.
        #[allow(non_snake_case, missing_docs, clippy::missing_safety_doc, reason = "names and contracts are the standard's")]
        #[allow(clippy::too_many_arguments, reason = "the standard has that many")]
        pub mod fmi3 {
            use $crate::fmi3::bindings::*;

            /// `fmi3InstantiateCoSimulation`.
            #[unsafe(no_mangle)]
            pub unsafe extern "C" fn fmi3InstantiateCoSimulation(
                instanceName: fmi3String,
                instantiationToken: fmi3String,
                resourcePath: fmi3String,
                _visible: fmi3Boolean,
                loggingOn: fmi3Boolean,
                eventModeUsed: fmi3Boolean,
                earlyReturnAllowed: fmi3Boolean,
                _requiredIntermediateVariables: *const fmi3ValueReference,
                _nRequiredIntermediateVariables: usize,
                instanceEnvironment: fmi3InstanceEnvironment,
                logMessage: fmi3LogMessageCallback,
                _intermediateUpdate: fmi3IntermediateUpdateCallback,
            ) -> fmi3Instance {
                // SAFETY: the contract is the same.
                unsafe {
                    $crate::fmi3::functions::instantiate(
                        &super::FMUS, instanceName, instantiationToken, resourcePath, loggingOn, eventModeUsed, earlyReturnAllowed,
                        instanceEnvironment, logMessage,
                    )
                }
            }

            $crate::__export_functions! { fmi3:
                fmi3GetVersion() -> *const fmi3Char;
                fmi3SetDebugLogging(instance: fmi3Instance, loggingOn: fmi3Boolean, nCategories: usize, categories: *const fmi3String) -> fmi3Status;
                fmi3InstantiateModelExchange(instanceName: fmi3String, instantiationToken: fmi3String, resourcePath: fmi3String, visible: fmi3Boolean, loggingOn: fmi3Boolean, instanceEnvironment: fmi3InstanceEnvironment, logMessage: fmi3LogMessageCallback) -> fmi3Instance;
                fmi3InstantiateScheduledExecution(instanceName: fmi3String, instantiationToken: fmi3String, resourcePath: fmi3String, visible: fmi3Boolean, loggingOn: fmi3Boolean, instanceEnvironment: fmi3InstanceEnvironment, logMessage: fmi3LogMessageCallback, clockUpdate: fmi3ClockUpdateCallback, lockPreemption: fmi3LockPreemptionCallback, unlockPreemption: fmi3UnlockPreemptionCallback) -> fmi3Instance;
                fmi3FreeInstance(instance: fmi3Instance) -> ();
                fmi3EnterInitializationMode(instance: fmi3Instance, toleranceDefined: fmi3Boolean, tolerance: fmi3Float64, startTime: fmi3Float64, stopTimeDefined: fmi3Boolean, stopTime: fmi3Float64) -> fmi3Status;
                fmi3ExitInitializationMode(instance: fmi3Instance) -> fmi3Status;
                fmi3EnterEventMode(instance: fmi3Instance) -> fmi3Status;
                fmi3Terminate(instance: fmi3Instance) -> fmi3Status;
                fmi3Reset(instance: fmi3Instance) -> fmi3Status;
                fmi3GetFloat32(instance: fmi3Instance, valueReferences: *const fmi3ValueReference, nValueReferences: usize, values: *mut fmi3Float32, nValues: usize) -> fmi3Status;
                fmi3GetFloat64(instance: fmi3Instance, valueReferences: *const fmi3ValueReference, nValueReferences: usize, values: *mut fmi3Float64, nValues: usize) -> fmi3Status;
                fmi3GetInt8(instance: fmi3Instance, valueReferences: *const fmi3ValueReference, nValueReferences: usize, values: *mut fmi3Int8, nValues: usize) -> fmi3Status;
                fmi3GetUInt8(instance: fmi3Instance, valueReferences: *const fmi3ValueReference, nValueReferences: usize, values: *mut fmi3UInt8, nValues: usize) -> fmi3Status;
                fmi3GetInt16(instance: fmi3Instance, valueReferences: *const fmi3ValueReference, nValueReferences: usize, values: *mut fmi3Int16, nValues: usize) -> fmi3Status;
                fmi3GetUInt16(instance: fmi3Instance, valueReferences: *const fmi3ValueReference, nValueReferences: usize, values: *mut fmi3UInt16, nValues: usize) -> fmi3Status;
                fmi3GetInt32(instance: fmi3Instance, valueReferences: *const fmi3ValueReference, nValueReferences: usize, values: *mut fmi3Int32, nValues: usize) -> fmi3Status;
                fmi3GetUInt32(instance: fmi3Instance, valueReferences: *const fmi3ValueReference, nValueReferences: usize, values: *mut fmi3UInt32, nValues: usize) -> fmi3Status;
                fmi3GetInt64(instance: fmi3Instance, valueReferences: *const fmi3ValueReference, nValueReferences: usize, values: *mut fmi3Int64, nValues: usize) -> fmi3Status;
                fmi3GetUInt64(instance: fmi3Instance, valueReferences: *const fmi3ValueReference, nValueReferences: usize, values: *mut fmi3UInt64, nValues: usize) -> fmi3Status;
                fmi3GetBoolean(instance: fmi3Instance, valueReferences: *const fmi3ValueReference, nValueReferences: usize, values: *mut fmi3Boolean, nValues: usize) -> fmi3Status;
                fmi3GetString(instance: fmi3Instance, valueReferences: *const fmi3ValueReference, nValueReferences: usize, values: *mut fmi3String, nValues: usize) -> fmi3Status;
                fmi3GetBinary(instance: fmi3Instance, valueReferences: *const fmi3ValueReference, nValueReferences: usize, valueSizes: *mut usize, values: *mut fmi3Binary, nValues: usize) -> fmi3Status;
                fmi3GetClock(instance: fmi3Instance, valueReferences: *const fmi3ValueReference, nValueReferences: usize, values: *mut fmi3Clock) -> fmi3Status;
                fmi3SetFloat32(instance: fmi3Instance, valueReferences: *const fmi3ValueReference, nValueReferences: usize, values: *const fmi3Float32, nValues: usize) -> fmi3Status;
                fmi3SetFloat64(instance: fmi3Instance, valueReferences: *const fmi3ValueReference, nValueReferences: usize, values: *const fmi3Float64, nValues: usize) -> fmi3Status;
                fmi3SetInt8(instance: fmi3Instance, valueReferences: *const fmi3ValueReference, nValueReferences: usize, values: *const fmi3Int8, nValues: usize) -> fmi3Status;
                fmi3SetUInt8(instance: fmi3Instance, valueReferences: *const fmi3ValueReference, nValueReferences: usize, values: *const fmi3UInt8, nValues: usize) -> fmi3Status;
                fmi3SetInt16(instance: fmi3Instance, valueReferences: *const fmi3ValueReference, nValueReferences: usize, values: *const fmi3Int16, nValues: usize) -> fmi3Status;
                fmi3SetUInt16(instance: fmi3Instance, valueReferences: *const fmi3ValueReference, nValueReferences: usize, values: *const fmi3UInt16, nValues: usize) -> fmi3Status;
                fmi3SetInt32(instance: fmi3Instance, valueReferences: *const fmi3ValueReference, nValueReferences: usize, values: *const fmi3Int32, nValues: usize) -> fmi3Status;
                fmi3SetUInt32(instance: fmi3Instance, valueReferences: *const fmi3ValueReference, nValueReferences: usize, values: *const fmi3UInt32, nValues: usize) -> fmi3Status;
                fmi3SetInt64(instance: fmi3Instance, valueReferences: *const fmi3ValueReference, nValueReferences: usize, values: *const fmi3Int64, nValues: usize) -> fmi3Status;
                fmi3SetUInt64(instance: fmi3Instance, valueReferences: *const fmi3ValueReference, nValueReferences: usize, values: *const fmi3UInt64, nValues: usize) -> fmi3Status;
                fmi3SetBoolean(instance: fmi3Instance, valueReferences: *const fmi3ValueReference, nValueReferences: usize, values: *const fmi3Boolean, nValues: usize) -> fmi3Status;
                fmi3SetString(instance: fmi3Instance, valueReferences: *const fmi3ValueReference, nValueReferences: usize, values: *const fmi3String, nValues: usize) -> fmi3Status;
                fmi3SetBinary(instance: fmi3Instance, valueReferences: *const fmi3ValueReference, nValueReferences: usize, valueSizes: *const usize, values: *const fmi3Binary, nValues: usize) -> fmi3Status;
                fmi3SetClock(instance: fmi3Instance, valueReferences: *const fmi3ValueReference, nValueReferences: usize, values: *const fmi3Clock) -> fmi3Status;
                fmi3GetNumberOfVariableDependencies(instance: fmi3Instance, valueReference: fmi3ValueReference, nDependencies: *mut usize) -> fmi3Status;
                fmi3GetVariableDependencies(instance: fmi3Instance, dependent: fmi3ValueReference, elementIndicesOfDependent: *mut usize, independents: *mut fmi3ValueReference, elementIndicesOfIndependents: *mut usize, dependencyKinds: *mut fmi3DependencyKind, nDependencies: usize) -> fmi3Status;
                fmi3GetFMUState(instance: fmi3Instance, FMUState: *mut fmi3FMUState) -> fmi3Status;
                fmi3SetFMUState(instance: fmi3Instance, FMUState: fmi3FMUState) -> fmi3Status;
                fmi3FreeFMUState(instance: fmi3Instance, FMUState: *mut fmi3FMUState) -> fmi3Status;
                fmi3SerializedFMUStateSize(instance: fmi3Instance, FMUState: fmi3FMUState, size: *mut usize) -> fmi3Status;
                fmi3SerializeFMUState(instance: fmi3Instance, FMUState: fmi3FMUState, serializedState: *mut fmi3Byte, size: usize) -> fmi3Status;
                fmi3DeserializeFMUState(instance: fmi3Instance, serializedState: *const fmi3Byte, size: usize, FMUState: *mut fmi3FMUState) -> fmi3Status;
                fmi3GetDirectionalDerivative(instance: fmi3Instance, unknowns: *const fmi3ValueReference, nUnknowns: usize, knowns: *const fmi3ValueReference, nKnowns: usize, seed: *const fmi3Float64, nSeed: usize, sensitivity: *mut fmi3Float64, nSensitivity: usize) -> fmi3Status;
                fmi3GetAdjointDerivative(instance: fmi3Instance, unknowns: *const fmi3ValueReference, nUnknowns: usize, knowns: *const fmi3ValueReference, nKnowns: usize, seed: *const fmi3Float64, nSeed: usize, sensitivity: *mut fmi3Float64, nSensitivity: usize) -> fmi3Status;
                fmi3EnterConfigurationMode(instance: fmi3Instance) -> fmi3Status;
                fmi3ExitConfigurationMode(instance: fmi3Instance) -> fmi3Status;
                fmi3GetIntervalDecimal(instance: fmi3Instance, valueReferences: *const fmi3ValueReference, nValueReferences: usize, intervals: *mut fmi3Float64, qualifiers: *mut fmi3IntervalQualifier) -> fmi3Status;
                fmi3GetIntervalFraction(instance: fmi3Instance, valueReferences: *const fmi3ValueReference, nValueReferences: usize, counters: *mut fmi3UInt64, resolutions: *mut fmi3UInt64, qualifiers: *mut fmi3IntervalQualifier) -> fmi3Status;
                fmi3GetShiftDecimal(instance: fmi3Instance, valueReferences: *const fmi3ValueReference, nValueReferences: usize, shifts: *mut fmi3Float64) -> fmi3Status;
                fmi3GetShiftFraction(instance: fmi3Instance, valueReferences: *const fmi3ValueReference, nValueReferences: usize, counters: *mut fmi3UInt64, resolutions: *mut fmi3UInt64) -> fmi3Status;
                fmi3SetIntervalDecimal(instance: fmi3Instance, valueReferences: *const fmi3ValueReference, nValueReferences: usize, intervals: *const fmi3Float64) -> fmi3Status;
                fmi3SetIntervalFraction(instance: fmi3Instance, valueReferences: *const fmi3ValueReference, nValueReferences: usize, counters: *const fmi3UInt64, resolutions: *const fmi3UInt64) -> fmi3Status;
                fmi3SetShiftDecimal(instance: fmi3Instance, valueReferences: *const fmi3ValueReference, nValueReferences: usize, shifts: *const fmi3Float64) -> fmi3Status;
                fmi3SetShiftFraction(instance: fmi3Instance, valueReferences: *const fmi3ValueReference, nValueReferences: usize, counters: *const fmi3UInt64, resolutions: *const fmi3UInt64) -> fmi3Status;
                fmi3EvaluateDiscreteStates(instance: fmi3Instance) -> fmi3Status;
                fmi3UpdateDiscreteStates(instance: fmi3Instance, discreteStatesNeedUpdate: *mut fmi3Boolean, terminateSimulation: *mut fmi3Boolean, nominalsOfContinuousStatesChanged: *mut fmi3Boolean, valuesOfContinuousStatesChanged: *mut fmi3Boolean, nextEventTimeDefined: *mut fmi3Boolean, nextEventTime: *mut fmi3Float64) -> fmi3Status;
                fmi3EnterContinuousTimeMode(instance: fmi3Instance) -> fmi3Status;
                fmi3CompletedIntegratorStep(instance: fmi3Instance, noSetFMUStatePriorToCurrentPoint: fmi3Boolean, enterEventMode: *mut fmi3Boolean, terminateSimulation: *mut fmi3Boolean) -> fmi3Status;
                fmi3SetTime(instance: fmi3Instance, time: fmi3Float64) -> fmi3Status;
                fmi3SetContinuousStates(instance: fmi3Instance, continuousStates: *const fmi3Float64, nContinuousStates: usize) -> fmi3Status;
                fmi3GetContinuousStateDerivatives(instance: fmi3Instance, derivatives: *mut fmi3Float64, nContinuousStates: usize) -> fmi3Status;
                fmi3GetEventIndicators(instance: fmi3Instance, eventIndicators: *mut fmi3Float64, nEventIndicators: usize) -> fmi3Status;
                fmi3GetContinuousStates(instance: fmi3Instance, continuousStates: *mut fmi3Float64, nContinuousStates: usize) -> fmi3Status;
                fmi3GetNominalsOfContinuousStates(instance: fmi3Instance, nominals: *mut fmi3Float64, nContinuousStates: usize) -> fmi3Status;
                fmi3GetNumberOfEventIndicators(instance: fmi3Instance, nEventIndicators: *mut usize) -> fmi3Status;
                fmi3GetNumberOfContinuousStates(instance: fmi3Instance, nContinuousStates: *mut usize) -> fmi3Status;
                fmi3EnterStepMode(instance: fmi3Instance) -> fmi3Status;
                fmi3GetOutputDerivatives(instance: fmi3Instance, valueReferences: *const fmi3ValueReference, nValueReferences: usize, orders: *const fmi3Int32, values: *mut fmi3Float64, nValues: usize) -> fmi3Status;
                fmi3DoStep(instance: fmi3Instance, currentCommunicationPoint: fmi3Float64, communicationStepSize: fmi3Float64, noSetFMUStatePriorToCurrentPoint: fmi3Boolean, eventHandlingNeeded: *mut fmi3Boolean, terminateSimulation: *mut fmi3Boolean, earlyReturn: *mut fmi3Boolean, lastSuccessfulTime: *mut fmi3Float64) -> fmi3Status;
                fmi3ActivateModelPartition(instance: fmi3Instance, clockReference: fmi3ValueReference, activationTime: fmi3Float64) -> fmi3Status;
            }
        }
    };
}

/// Defines the functions of FMI 3.0, if the crate is built with the feature `fmi3`.
#[cfg(not(feature = "fmi3"))]
#[doc(hidden)]
#[macro_export]
macro_rules! __export_fmi3 {
    () => {};
}

/// Exports functions under their standard names; each forwards the call.
#[doc(hidden)]
#[macro_export]
macro_rules! __export_functions {
    ($standard:ident: $($name:ident($($argument:ident: $of:ty),*) -> $result:ty;)*) => {$(
        #[unsafe(no_mangle)]
        pub unsafe extern "C" fn $name($($argument: $of),*) -> $result {
            // SAFETY: the contract is the same.
            unsafe { $crate::$standard::functions::$name($($argument),*) }
        }
    )*};
}
