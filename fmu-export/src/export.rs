//! The macro that defines the C functions of a library.

/// Defines all functions of FMI 2.0 for co-simulation in a library of the crate type `cdylib` with these models, and a static
/// [`Fmus`](crate::Fmus) named `FMUS` that lists them. Each model is a type that implements [`Model`](crate::Model) or
/// [`SampledModel`](crate::SampledModel).
///
/// The functions have the standard's names, so that a binary can have them once: use the macro once per crate, and in no crate
/// that another one with it depends on, or the linker reports duplicate symbols. Models of several crates go into one library by
/// naming them all in one call, in a crate that depends on the others.
///
/// ```ignore
/// fmu_export::export_fmus!(Pump, Valve, Tank);
/// ```
#[macro_export]
macro_rules! export_fmus {
    ($($model:ty),+ $(,)?) => {
        // No panic may reach the importer, and with `panic = "abort"` none could be stopped.
        #[cfg(not(panic = "unwind"))]
        ::core::compile_error!(
            "an FMU must be built with `panic = \"unwind\"`: with `panic = \"abort\"` a panic would end the program that \
             imports it; remove that line from the profile in Cargo.toml"
        );

        /// The models of this library.
        pub static FMUS: $crate::Fmus =
            $crate::Fmus::new(::core::env!("CARGO_CRATE_NAME"), || {
                // A type is one or the other kind of model; the method of the one that it implements is found.
                #[allow(unused_imports, reason = "which kind of model there is depends on the crate")]
                use $crate::instance::kind::{Continuous as _, Sampled as _};
                ::std::vec![$((&$crate::instance::kind::Of::<$model>::NEW).model_type()),+]
            });

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

            $crate::__export_functions! {
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

/// Exports functions under their standard names; each forwards the call.
#[doc(hidden)]
#[macro_export]
macro_rules! __export_functions {
    ($($name:ident($($argument:ident: $of:ty),*) -> $result:ty;)*) => {$(
        #[unsafe(no_mangle)]
        pub unsafe extern "C" fn $name($($argument: $of),*) -> $result {
            // SAFETY: the contract is the same.
            unsafe { $crate::fmi2::functions::$name($($argument),*) }
        }
    )*};
}
