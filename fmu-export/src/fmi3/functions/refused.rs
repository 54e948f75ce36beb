//! Functions that co-simulation does not need, defined because importers look for all functions of the standard.

use super::{Component, Logger};
use crate::fmi3::bindings::*;
use crate::fmi3::sequence::Function;
use crate::interface::c_functions;
use crate::interface::component::Problem;
use crate::interface::guard::enter;
use crate::interface::logger::Category;

const DEPENDENCIES: &str = "the dependencies are those of the model description";
const ADJOINT: &str = "adjoint derivatives are not offered, as the model description says";
const CONFIGURATION: &str = "there are no structural parameters";
const CLOCKS: &str = "there are no clocks";
const MODEL_EXCHANGE: &str = "it belongs to model exchange; this FMU is for co-simulation";
const SCHEDULED: &str = "it belongs to scheduled execution; this FMU is for co-simulation";

/// Refuses a call, with a message.
///
/// # Safety
/// As for all functions of this module.
unsafe fn refuse(instance: fmi3Instance, function: Function, why: &str) -> fmi3Status {
    // SAFETY: the instance meets the contract of the exported function.
    unsafe { enter(instance, function, |_: &mut Component| Err(Problem::call(why))) }
}

/// Refuses to make an instance, with a message.
fn no_instance(function: &str, environment: fmi3InstanceEnvironment, log: fmi3LogMessageCallback) -> fmi3Instance {
    let logger = Logger::new(c"", log, environment, false);
    let why = "this FMU is for co-simulation: expected fmi3InstantiateCoSimulation";
    logger.send(fmi3Status::fmi3Error, Category::StatusError, format_args!("{function}: {why}"));
    std::ptr::null_mut()
}

/// Functions that are refused, each with a reason.
macro_rules! refused {
    ($($name:ident: $type:ident = $function:ident($($argument:ident: $of:ty),*), $why:ident;)*) => {
        c_functions! {$(
            /// Not offered.
            fn $name: $type(instance: fmi3Instance, $($argument: $of),*) -> fmi3Status {
                // SAFETY: the instance meets this module's contract.
                unsafe { refuse(instance, Function::$function, $why) }
            }
        )*}
    };
}

refused! {
    fmi3GetNumberOfVariableDependencies: fmi3GetNumberOfVariableDependenciesTYPE = GetNumberOfVariableDependencies(_valueReference: fmi3ValueReference, _nDependencies: *mut usize), DEPENDENCIES;
    fmi3GetVariableDependencies: fmi3GetVariableDependenciesTYPE = GetVariableDependencies(_dependent: fmi3ValueReference, _elementIndicesOfDependent: *mut usize, _independents: *mut fmi3ValueReference, _elementIndicesOfIndependents: *mut usize, _dependencyKinds: *mut fmi3DependencyKind, _nDependencies: usize), DEPENDENCIES;
    fmi3GetAdjointDerivative: fmi3GetAdjointDerivativeTYPE = GetAdjointDerivative(_unknowns: *const fmi3ValueReference, _nUnknowns: usize, _knowns: *const fmi3ValueReference, _nKnowns: usize, _seed: *const fmi3Float64, _nSeed: usize, _sensitivity: *mut fmi3Float64, _nSensitivity: usize), ADJOINT;
    fmi3EnterConfigurationMode: fmi3EnterConfigurationModeTYPE = EnterConfigurationMode(), CONFIGURATION;
    fmi3ExitConfigurationMode: fmi3ExitConfigurationModeTYPE = ExitConfigurationMode(), CONFIGURATION;
    fmi3GetIntervalDecimal: fmi3GetIntervalDecimalTYPE = GetIntervalDecimal(_valueReferences: *const fmi3ValueReference, _nValueReferences: usize, _intervals: *mut fmi3Float64, _qualifiers: *mut fmi3IntervalQualifier), CLOCKS;
    fmi3GetIntervalFraction: fmi3GetIntervalFractionTYPE = GetIntervalFraction(_valueReferences: *const fmi3ValueReference, _nValueReferences: usize, _counters: *mut fmi3UInt64, _resolutions: *mut fmi3UInt64, _qualifiers: *mut fmi3IntervalQualifier), CLOCKS;
    fmi3GetShiftDecimal: fmi3GetShiftDecimalTYPE = GetShiftDecimal(_valueReferences: *const fmi3ValueReference, _nValueReferences: usize, _shifts: *mut fmi3Float64), CLOCKS;
    fmi3GetShiftFraction: fmi3GetShiftFractionTYPE = GetShiftFraction(_valueReferences: *const fmi3ValueReference, _nValueReferences: usize, _counters: *mut fmi3UInt64, _resolutions: *mut fmi3UInt64), CLOCKS;
    fmi3SetIntervalDecimal: fmi3SetIntervalDecimalTYPE = SetIntervalDecimal(_valueReferences: *const fmi3ValueReference, _nValueReferences: usize, _intervals: *const fmi3Float64), CLOCKS;
    fmi3SetIntervalFraction: fmi3SetIntervalFractionTYPE = SetIntervalFraction(_valueReferences: *const fmi3ValueReference, _nValueReferences: usize, _counters: *const fmi3UInt64, _resolutions: *const fmi3UInt64), CLOCKS;
    fmi3SetShiftDecimal: fmi3SetShiftDecimalTYPE = SetShiftDecimal(_valueReferences: *const fmi3ValueReference, _nValueReferences: usize, _shifts: *const fmi3Float64), CLOCKS;
    fmi3SetShiftFraction: fmi3SetShiftFractionTYPE = SetShiftFraction(_valueReferences: *const fmi3ValueReference, _nValueReferences: usize, _counters: *const fmi3UInt64, _resolutions: *const fmi3UInt64), CLOCKS;
    fmi3EvaluateDiscreteStates: fmi3EvaluateDiscreteStatesTYPE = EvaluateDiscreteStates(), CLOCKS;
    fmi3EnterContinuousTimeMode: fmi3EnterContinuousTimeModeTYPE = EnterContinuousTimeMode(), MODEL_EXCHANGE;
    fmi3CompletedIntegratorStep: fmi3CompletedIntegratorStepTYPE = CompletedIntegratorStep(_noSetFMUStatePriorToCurrentPoint: fmi3Boolean, _enterEventMode: *mut fmi3Boolean, _terminateSimulation: *mut fmi3Boolean), MODEL_EXCHANGE;
    fmi3SetTime: fmi3SetTimeTYPE = SetTime(_time: fmi3Float64), MODEL_EXCHANGE;
    fmi3SetContinuousStates: fmi3SetContinuousStatesTYPE = SetContinuousStates(_continuousStates: *const fmi3Float64, _nContinuousStates: usize), MODEL_EXCHANGE;
    fmi3GetContinuousStateDerivatives: fmi3GetContinuousStateDerivativesTYPE = GetContinuousStateDerivatives(_derivatives: *mut fmi3Float64, _nContinuousStates: usize), MODEL_EXCHANGE;
    fmi3GetEventIndicators: fmi3GetEventIndicatorsTYPE = GetEventIndicators(_eventIndicators: *mut fmi3Float64, _nEventIndicators: usize), MODEL_EXCHANGE;
    fmi3GetContinuousStates: fmi3GetContinuousStatesTYPE = GetContinuousStates(_continuousStates: *mut fmi3Float64, _nContinuousStates: usize), MODEL_EXCHANGE;
    fmi3GetNominalsOfContinuousStates: fmi3GetNominalsOfContinuousStatesTYPE = GetNominalsOfContinuousStates(_nominals: *mut fmi3Float64, _nContinuousStates: usize), MODEL_EXCHANGE;
    fmi3GetNumberOfEventIndicators: fmi3GetNumberOfEventIndicatorsTYPE = GetNumberOfEventIndicators(_nEventIndicators: *mut usize), MODEL_EXCHANGE;
    fmi3GetNumberOfContinuousStates: fmi3GetNumberOfContinuousStatesTYPE = GetNumberOfContinuousStates(_nContinuousStates: *mut usize), MODEL_EXCHANGE;
    fmi3ActivateModelPartition: fmi3ActivateModelPartitionTYPE = ActivateModelPartition(_clockReference: fmi3ValueReference, _activationTime: fmi3Float64), SCHEDULED;
}

c_functions! {
    /// Returns null, with a message.
    fn fmi3InstantiateModelExchange: fmi3InstantiateModelExchangeTYPE(
        _instanceName: fmi3String,
        _instantiationToken: fmi3String,
        _resourcePath: fmi3String,
        _visible: fmi3Boolean,
        _loggingOn: fmi3Boolean,
        instanceEnvironment: fmi3InstanceEnvironment,
        logMessage: fmi3LogMessageCallback,
    ) -> fmi3Instance {
        no_instance("fmi3InstantiateModelExchange", instanceEnvironment, logMessage)
    }

    /// Returns null, with a message.
    fn fmi3InstantiateScheduledExecution: fmi3InstantiateScheduledExecutionTYPE(
        _instanceName: fmi3String,
        _instantiationToken: fmi3String,
        _resourcePath: fmi3String,
        _visible: fmi3Boolean,
        _loggingOn: fmi3Boolean,
        instanceEnvironment: fmi3InstanceEnvironment,
        logMessage: fmi3LogMessageCallback,
        _clockUpdate: fmi3ClockUpdateCallback,
        _lockPreemption: fmi3LockPreemptionCallback,
        _unlockPreemption: fmi3UnlockPreemptionCallback,
    ) -> fmi3Instance {
        no_instance("fmi3InstantiateScheduledExecution", instanceEnvironment, logMessage)
    }
}
