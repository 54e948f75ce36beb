//! The 34 functions of FMI 2.0 for co-simulation.
//!
//! Names, arguments and results are the standard's, except for [`instantiate`], which gets the list of models. All functions
//! that take an instance share one safety contract: the instance came from [`instantiate`] and was not freed since; an array
//! has the given length; an `fmi2FMUstate` is null or came from [`fmi2GetFMUstate`] or [`fmi2DeSerializeFMUstate`], was not
//! freed since, and no other call writes or frees it meanwhile. Null pointers are refused, and so is a call on an instance
//! during another one, for instance from its logger.

#![allow(non_snake_case, reason = "the names are those of the standard")]

mod values;

use std::ffi::c_char;
use std::panic::catch_unwind;

pub use values::*;

use super::Fmi2;
use super::bindings::*;
use super::sequence::{Function, State};
use crate::Standard;
use crate::fmus::Fmus;
use crate::interface::arguments::{elements, elements_mut, finite, finite_result, text};
use crate::interface::component::Problem;
use crate::interface::guard::{enter, hand_out, take_back};
use crate::interface::logger::Category;
use crate::interface::{c_functions, component, logger, states};
use crate::model::Step;
use crate::resources::Resources;

type Component = component::Component<Fmi2>;
type Logger = logger::Logger<Fmi2>;

/// Answers a query about the last step.
///
/// # Safety
/// As for all functions of this module.
unsafe fn status<T>(
    component: fmi2Component,
    function: Function,
    kind: fmi2StatusKind,
    value: *mut T,
    answer: impl Fn(&Component, fmi2StatusKind) -> Option<T>,
) -> fmi2Status {
    let body = |component: &mut Component| {
        // SAFETY: the pointer meets the contract of the exported function.
        let value = unsafe { elements_mut("value", value, 1)? };
        value[0] = answer(component, kind)
            .ok_or_else(|| Problem::Call(format!("the status kind {} does not have this type", kind.0)))?;
        Ok(())
    };
    // SAFETY: the component meets the contract of the exported function.
    unsafe { enter(component, function, body) }
}

/// `fmi2Instantiate` for a list of models: makes an instance of the model with that GUID, or sends the reason and returns null.
///
/// # Safety
/// As for all functions of [this module](self).
pub unsafe fn instantiate(
    fmus: &'static Fmus,
    name: fmi2String,
    kind: fmi2Type,
    guid: fmi2String,
    location: fmi2String,
    functions: *const fmi2CallbackFunctions,
    logging_on: fmi2Boolean,
) -> fmi2Component {
    let made = catch_unwind(|| {
        // SAFETY: the importer keeps the callbacks and the texts valid for the length of the call, the callbacks' content for the life of
        // the instance; null is checked.
        let (callbacks, name, guid, location) =
            unsafe { (functions.as_ref()?, text(name), text(guid), text(location)) };
        let name = name.filter(|name| !name.is_empty());
        let shown = name.unwrap_or(c"(no name)");
        let logger = Logger::new(shown, callbacks.logger, callbacks.componentEnvironment, logging_on != fmi2False);
        let model = || {
            name.ok_or("instanceName is empty: expected a name")?;
            if kind != fmi2Type::fmi2CoSimulation {
                return Err(format!("fmuType = {} is refused: expected fmi2CoSimulation (1)", kind.0));
            }
            let guid = guid.ok_or("fmuGUID is null: expected the GUID of the model description")?;
            fmus.by_token(&[Standard::Fmi2], "fmuGUID", guid)
        };
        match model() {
            Ok((model, _)) => {
                let resources = location.map(|uri| Resources::from_uri(&uri.to_string_lossy())).unwrap_or_default();
                Some(hand_out(Component::new(model, resources, logger, ())))
            }
            Err(why) => {
                logger.send(fmi2Status::fmi2Error, Category::StatusError, format_args!("fmi2Instantiate: {why}"));
                None
            }
        }
    });
    // A panic has printed its message to standard error; there is no instance with a logger.
    made.ok().flatten().unwrap_or(std::ptr::null_mut())
}

c_functions! {
    /// The platform type of the interface, `default`.
    fn fmi2GetTypesPlatform: fmi2GetTypesPlatformTYPE() -> *const c_char {
        fmi2TypesPlatform.as_ptr()
    }

    /// The version of the interface, `2.0`.
    fn fmi2GetVersion: fmi2GetVersionTYPE() -> *const c_char {
        fmi2Version.as_ptr()
    }

    /// Switches categories of messages on or off.
    fn fmi2SetDebugLogging: fmi2SetDebugLoggingTYPE(
        c: fmi2Component,
        loggingOn: fmi2Boolean,
        nCategories: usize,
        categories: *const fmi2String,
    ) -> fmi2Status {
        // SAFETY: component, array and texts meet this module's contract.
        unsafe {
            enter(c, Function::SetDebugLogging, |component| {
                component.switch_logging(loggingOn != fmi2False, elements("categories", categories, nCategories)?)
            })
        }
    }

    /// Frees an instance.
    fn fmi2FreeInstance: fmi2FreeInstanceTYPE(c: fmi2Component) -> () {
        // SAFETY: by this module's contract the pointer came from `fmi2Instantiate` and is not used again.
        unsafe { take_back::<Fmi2>(c) }
    }

    /// Sets start and stop time. A tolerance is accepted without effect: the models have a fixed accuracy.
    fn fmi2SetupExperiment: fmi2SetupExperimentTYPE(
        c: fmi2Component,
        _toleranceDefined: fmi2Boolean,
        _tolerance: fmi2Real,
        startTime: fmi2Real,
        stopTimeDefined: fmi2Boolean,
        stopTime: fmi2Real,
    ) -> fmi2Status {
        let stop_s = (stopTimeDefined != fmi2False).then_some(stopTime);
        // SAFETY: the component meets this module's contract.
        unsafe { enter(c, Function::SetupExperiment, |component| component.setup(startTime, stop_s)) }
    }

    /// Begins initialization.
    fn fmi2EnterInitializationMode: fmi2EnterInitializationModeTYPE(c: fmi2Component) -> fmi2Status {
        // SAFETY: the component meets this module's contract.
        unsafe { enter(c, Function::EnterInitializationMode, |component| component.change(State::InitializationMode)) }
    }

    /// Ends initialization. The message names every invalid parameter.
    fn fmi2ExitInitializationMode: fmi2ExitInitializationModeTYPE(c: fmi2Component) -> fmi2Status {
        // SAFETY: the component meets this module's contract.
        unsafe { enter(c, Function::ExitInitializationMode, Component::exit_initialization) }
    }

    /// Ends the run.
    fn fmi2Terminate: fmi2TerminateTYPE(c: fmi2Component) -> fmi2Status {
        // SAFETY: the component meets this module's contract.
        unsafe { enter(c, Function::Terminate, |component| component.change(State::Terminated)) }
    }

    /// Resets the instance to its state after `fmi2Instantiate`.
    fn fmi2Reset: fmi2ResetTYPE(c: fmi2Component) -> fmi2Status {
        // SAFETY: the component meets this module's contract.
        unsafe { enter(c, Function::Reset, Component::reset) }
    }

    /// Takes a snapshot, into an existing one if there is one.
    fn fmi2GetFMUstate: fmi2GetFMUstateTYPE(c: fmi2Component, FMUstate: *mut fmi2FMUstate) -> fmi2Status {
        // SAFETY: component and pointers meet this module's contract.
        unsafe { enter(c, Function::GetFMUstate, |component| states::get(component, FMUstate)) }
    }

    /// Restores a snapshot of this or another instance of the same model, including the state in the sequence of calls and the
    /// time. The snapshot remains valid.
    fn fmi2SetFMUstate: fmi2SetFMUstateTYPE(c: fmi2Component, FMUstate: fmi2FMUstate) -> fmi2Status {
        // SAFETY: component and pointers meet this module's contract.
        unsafe { enter(c, Function::SetFMUstate, |component| states::set(component, FMUstate)) }
    }

    /// Frees a snapshot and sets the pointer to null; a null pointer is ignored. Any instance of this library may be used.
    fn fmi2FreeFMUstate: fmi2FreeFMUstateTYPE(c: fmi2Component, FMUstate: *mut fmi2FMUstate) -> fmi2Status {
        // SAFETY: component and pointers meet this module's contract.
        unsafe { enter(c, Function::FreeFMUstate, |_| states::free(FMUstate)) }
    }

    /// Returns the size of a serialized snapshot in bytes.
    fn fmi2SerializedFMUstateSize: fmi2SerializedFMUstateSizeTYPE(
        c: fmi2Component,
        FMUstate: fmi2FMUstate,
        size: *mut usize,
    ) -> fmi2Status {
        // SAFETY: component and pointers meet this module's contract.
        unsafe { enter(c, Function::SerializedFMUstateSize, |_| states::size(FMUstate, size)) }
    }

    /// Serializes a snapshot. Bytes beyond its size are not changed.
    fn fmi2SerializeFMUstate: fmi2SerializeFMUstateTYPE(
        c: fmi2Component,
        FMUstate: fmi2FMUstate,
        serializedState: *mut fmi2Byte,
        size: usize,
    ) -> fmi2Status {
        // SAFETY: component and pointers meet this module's contract.
        unsafe { enter(c, Function::SerializeFMUstate, |_| states::serialize(FMUstate, serializedState.cast(), size)) }
    }

    /// Makes a new snapshot from bytes serialized by this process or another. Bytes of another model or version, and truncated or
    /// changed bytes, are refused.
    fn fmi2DeSerializeFMUstate: fmi2DeSerializeFMUstateTYPE(
        c: fmi2Component,
        serializedState: *const fmi2Byte,
        size: usize,
        FMUstate: *mut fmi2FMUstate,
    ) -> fmi2Status {
        // SAFETY: component and pointers meet this module's contract.
        unsafe { enter(c, Function::DeSerializeFMUstate, |component| states::deserialize(component, serializedState.cast(), size, FMUstate)) }
    }

    /// Directional derivatives of outputs and of derivatives of states with respect to inputs and states, during initialization
    /// also with respect to parameters; exact.
    fn fmi2GetDirectionalDerivative: fmi2GetDirectionalDerivativeTYPE(
        c: fmi2Component,
        vUnknown_ref: *const fmi2ValueReference,
        nUnknown: usize,
        vKnown_ref: *const fmi2ValueReference,
        nKnown: usize,
        dvKnown: *const fmi2Real,
        dvUnknown: *mut fmi2Real,
    ) -> fmi2Status {
        let body = |component: &mut Component| {
            // SAFETY: all arrays meet this module's contract.
            let (unknowns, knowns, direction, derivatives) = unsafe {
                (
                    elements("vUnknown_ref", vUnknown_ref, nUnknown)?,
                    elements("vKnown_ref", vKnown_ref, nKnown)?,
                    elements("dvKnown", dvKnown, nKnown)?,
                    elements_mut("dvUnknown", dvUnknown, nUnknown)?,
                )
            };
            component.differentiate((knowns, direction), (unknowns, derivatives))
        };
        // SAFETY: the component meets this module's contract.
        unsafe { enter(c, Function::GetDirectionalDerivative, body) }
    }

    /// Sets derivatives of continuous inputs with respect to time, valid at the start of the next step and for that step only:
    /// all of them, or none if one is refused.
    ///
    /// With derivatives d the input is `u(t) = u + Σ_j d_j (t − t_0)^j / j!` over the step from t_0, where u is the value set
    /// by `fmi2SetReal`, before or after this call. A continuous model integrates along it; a sampled model uses its value at
    /// the sample instants. After the step the input keeps its final value and all derivatives are 0.
    fn fmi2SetRealInputDerivatives: fmi2SetRealInputDerivativesTYPE(
        c: fmi2Component,
        vr: *const fmi2ValueReference,
        nvr: usize,
        order: *const fmi2Integer,
        value: *const fmi2Real,
    ) -> fmi2Status {
        let body = |component: &mut Component| {
            // SAFETY: all arrays meet this module's contract.
            let (references, orders, values) =
                unsafe { (elements("vr", vr, nvr)?, elements("order", order, nvr)?, elements("value", value, nvr)?) };
            for (reference, value) in references.iter().zip(values) {
                finite(*value).map_err(|why| Problem::Call(format!("{}: {why}", component.name_of(*reference))))?;
            }
            let setting = |at: usize| (references[at] as usize, orders[at], values[at]);
            component.instance.set_input_derivatives(nvr, &setting).map_err(Problem::call)
        };
        // SAFETY: the component meets this module's contract.
        unsafe { enter(c, Function::SetRealInputDerivatives, body) }
    }

    /// Derivatives of outputs with respect to time at the end of the last step, with the inputs continuing as at its end; inputs
    /// set since then are held. Exact; 0 for sampled outputs, which are piecewise constant.
    fn fmi2GetRealOutputDerivatives: fmi2GetRealOutputDerivativesTYPE(
        c: fmi2Component,
        vr: *const fmi2ValueReference,
        nvr: usize,
        order: *const fmi2Integer,
        value: *mut fmi2Real,
    ) -> fmi2Status {
        let body = |component: &mut Component| {
            // SAFETY: all arrays meet this module's contract.
            let (references, orders, values) = unsafe {
                (elements("vr", vr, nvr)?, elements("order", order, nvr)?, elements_mut("value", value, nvr)?)
            };
            for ((reference, order), value) in references.iter().zip(orders).zip(values) {
                let found = component.instance.output_derivative(*reference as usize, *order).map_err(Problem::call)?;
                *value = finite_result(component, *reference, found)?;
            }
            Ok(())
        };
        // SAFETY: the component meets this module's contract.
        unsafe { enter(c, Function::GetRealOutputDerivatives, body) }
    }

    /// Does one communication step; fmi2Discard if the model ends the simulation within it.
    fn fmi2DoStep: fmi2DoStepTYPE(
        c: fmi2Component,
        currentCommunicationPoint: fmi2Real,
        communicationStepSize: fmi2Real,
        _noSetFMUStatePriorToCurrentPoint: fmi2Boolean,
    ) -> fmi2Status {
        let step = Step { time_s: currentCommunicationPoint, length_s: communicationStepSize };
        // SAFETY: the component meets this module's contract.
        unsafe { enter(c, Function::DoStep, |component| component.step(step)) }
    }

    /// A step is never in progress when this is called.
    fn fmi2CancelStep: fmi2CancelStepTYPE(c: fmi2Component) -> fmi2Status {
        // SAFETY: the component meets this module's contract.
        unsafe { enter(c, Function::CancelStep, |_| Ok(())) }
    }

    /// The status of the last step.
    fn fmi2GetStatus: fmi2GetStatusTYPE(c: fmi2Component, s: fmi2StatusKind, value: *mut fmi2Status) -> fmi2Status {
        let answer = |component: &Component, kind| {
            (kind == fmi2StatusKind::fmi2DoStepStatus).then_some(match component {
                _ if component.stage.failed => fmi2Status::fmi2Error,
                _ if component.instance.has_ended() => fmi2Status::fmi2Discard,
                _ => fmi2Status::fmi2OK,
            })
        };
        // SAFETY: all arguments meet this module's contract.
        unsafe { status(c, Function::GetStatus, s, value, answer) }
    }

    /// The time up to which the run has been completed.
    fn fmi2GetRealStatus: fmi2GetRealStatusTYPE(c: fmi2Component, s: fmi2StatusKind, value: *mut fmi2Real) -> fmi2Status {
        let answer = |component: &Component, kind| {
            (kind == fmi2StatusKind::fmi2LastSuccessfulTime).then_some(component.instance.time_s())
        };
        // SAFETY: all arguments meet this module's contract.
        unsafe { status(c, Function::GetRealStatus, s, value, answer) }
    }

    /// The standard has no status of this type.
    fn fmi2GetIntegerStatus: fmi2GetIntegerStatusTYPE(
        c: fmi2Component,
        s: fmi2StatusKind,
        value: *mut fmi2Integer,
    ) -> fmi2Status {
        // SAFETY: all arguments meet this module's contract.
        unsafe { status(c, Function::GetIntegerStatus, s, value, |_, _| None) }
    }

    /// Whether the model has ended the simulation in the last step.
    fn fmi2GetBooleanStatus: fmi2GetBooleanStatusTYPE(
        c: fmi2Component,
        s: fmi2StatusKind,
        value: *mut fmi2Boolean,
    ) -> fmi2Status {
        let answer = |component: &Component, kind| {
            (kind == fmi2StatusKind::fmi2Terminated).then_some(fmi2Boolean::from(component.instance.has_ended()))
        };
        // SAFETY: all arguments meet this module's contract.
        unsafe { status(c, Function::GetBooleanStatus, s, value, answer) }
    }

    /// The state of a pending step: no step is ever pending, so the string is empty.
    fn fmi2GetStringStatus: fmi2GetStringStatusTYPE(
        c: fmi2Component,
        s: fmi2StatusKind,
        value: *mut fmi2String,
    ) -> fmi2Status {
        let answer = |_: &Component, kind| (kind == fmi2StatusKind::fmi2PendingStatus).then_some(c"".as_ptr());
        // SAFETY: all arguments meet this module's contract.
        unsafe { status(c, Function::GetStringStatus, s, value, answer) }
    }
}
