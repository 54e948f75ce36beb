//! The 75 functions of FMI 3.0.
//!
//! Names, arguments and results are the standard's, except for [`instantiate`], which gets the list of models. All functions
//! that take an instance share one safety contract: the instance came from [`instantiate`] and was not freed since; an array
//! has the given length; an `fmi3FMUState` is null or came from [`fmi3GetFMUState`] or [`fmi3DeserializeFMUState`], was not
//! freed since, and no other call writes or frees it meanwhile. Null pointers are refused, and so is a call on an instance
//! during another one, for instance from its logger.

#![allow(non_snake_case, reason = "the names are those of the standard")]

mod refused;
mod values;

use std::ffi::c_char;
use std::iter::repeat_n;
use std::panic::catch_unwind;

pub use refused::*;
pub use values::*;

use super::bindings::*;
use super::sequence::{Function, State};
use super::{Fmi3, Options};
use crate::Standard;
use crate::description::arrays::elements_of;
use crate::fmus::Fmus;
use crate::interface::arguments::{element_mut, elements, elements_mut, finite_result, text};
use crate::interface::component::Problem;
use crate::interface::guard::{enter, hand_out, take_back};
use crate::interface::logger::Category;
use crate::interface::{c_functions, component, logger, states};
use crate::model::Step;
use crate::resources::Resources;

type Component = component::Component<Fmi3>;
type Logger = logger::Logger<Fmi3>;

/// `fmi3InstantiateCoSimulation` for a list of models: makes an instance of the model with that token, or sends the reason and
/// returns null.
///
/// # Safety
/// The texts are null or end with a zero byte; callback and environment belong together and stay valid as long as the instance.
#[allow(clippy::too_many_arguments, reason = "the standard has more")]
pub unsafe fn instantiate(
    fmus: &'static Fmus,
    name: fmi3String,
    token: fmi3String,
    folder: fmi3String,
    logging_on: fmi3Boolean,
    event_mode: fmi3Boolean,
    early_return: fmi3Boolean,
    environment: fmi3InstanceEnvironment,
    log: fmi3LogMessageCallback,
) -> fmi3Instance {
    let made = catch_unwind(|| {
        // SAFETY: the importer keeps the texts valid for the length of the call; null is checked.
        let (name, token, folder) = unsafe { (text(name), text(token), text(folder)) };
        let name = name.filter(|name| !name.is_empty());
        let logger = Logger::new(name.unwrap_or_default(), log, environment, logging_on != 0);
        let model = || {
            name.ok_or("instanceName is empty: expected a name")?;
            let token = token.ok_or("instantiationToken is null: expected the one of the model description")?;
            fmus.by_token(&Standard::OF_FMI3, "instantiationToken", token)
        };
        match model() {
            Ok((model, standard)) => {
                let resources =
                    folder.map(|folder| Resources::in_folder(&*folder.to_string_lossy())).unwrap_or_default();
                let elements = (standard == Standard::Fmi3 { arrays: true }).then(|| elements_of(model.variables()));
                let options = Options { event_mode: event_mode != 0, early_return: early_return != 0, elements };
                Some(hand_out(Component::new(model, resources, logger, options)))
            }
            Err(why) => {
                let function = "fmi3InstantiateCoSimulation";
                logger.send(fmi3Status::fmi3Error, Category::StatusError, format_args!("{function}: {why}"));
                None
            }
        }
    });
    // A panic has printed its message to standard error; there is no instance with a logger.
    made.ok().flatten().unwrap_or(std::ptr::null_mut())
}

c_functions! {
    /// The version of the interface, `3.0`.
    fn fmi3GetVersion: fmi3GetVersionTYPE() -> *const c_char {
        fmi3Version.as_ptr()
    }

    /// Switches categories of messages on or off.
    fn fmi3SetDebugLogging: fmi3SetDebugLoggingTYPE(
        instance: fmi3Instance,
        loggingOn: fmi3Boolean,
        nCategories: usize,
        categories: *const fmi3String,
    ) -> fmi3Status {
        // SAFETY: instance, array and texts meet this module's contract.
        unsafe {
            enter(instance, Function::SetDebugLogging, |component| {
                component.switch_logging(loggingOn != 0, elements("categories", categories, nCategories)?)
            })
        }
    }

    /// Frees an instance.
    fn fmi3FreeInstance: fmi3FreeInstanceTYPE(instance: fmi3Instance) -> () {
        // SAFETY: by this module's contract the pointer came from `fmi3InstantiateCoSimulation` and is not used again.
        unsafe { take_back::<Fmi3>(instance) }
    }

    /// Sets start and stop time, and begins initialization. A tolerance is accepted without effect: the models have a fixed
    /// accuracy.
    fn fmi3EnterInitializationMode: fmi3EnterInitializationModeTYPE(
        instance: fmi3Instance,
        _toleranceDefined: fmi3Boolean,
        _tolerance: fmi3Float64,
        startTime: fmi3Float64,
        stopTimeDefined: fmi3Boolean,
        stopTime: fmi3Float64,
    ) -> fmi3Status {
        let stop_s = (stopTimeDefined != 0).then_some(stopTime);
        // SAFETY: the instance meets this module's contract.
        unsafe {
            enter(instance, Function::EnterInitializationMode, |component| {
                component.setup(startTime, stop_s)?;
                component.change(State::InitializationMode)
            })
        }
    }

    /// Ends initialization. The message names every invalid parameter.
    fn fmi3ExitInitializationMode: fmi3ExitInitializationModeTYPE(instance: fmi3Instance) -> fmi3Status {
        // SAFETY: the instance meets this module's contract.
        unsafe {
            enter(instance, Function::ExitInitializationMode, |component: &mut Component| {
                component.exit_initialization()?;
                component.change(if component.options.event_mode { State::EventMode } else { State::StepMode })
            })
        }
    }

    /// Begins the handling of an event. No model needs it, because models handle their own events within a step.
    fn fmi3EnterEventMode: fmi3EnterEventModeTYPE(instance: fmi3Instance) -> fmi3Status {
        // SAFETY: the instance meets this module's contract.
        unsafe {
            enter(instance, Function::EnterEventMode, |component: &mut Component| {
                if !component.options.event_mode {
                    return Err(Problem::call("the instance was made with eventModeUsed = fmi3False"));
                }
                component.change(State::EventMode)
            })
        }
    }

    /// Ends an iteration of an event; another one is never needed.
    fn fmi3UpdateDiscreteStates: fmi3UpdateDiscreteStatesTYPE(
        instance: fmi3Instance,
        discreteStatesNeedUpdate: *mut fmi3Boolean,
        terminateSimulation: *mut fmi3Boolean,
        nominalsOfContinuousStatesChanged: *mut fmi3Boolean,
        valuesOfContinuousStatesChanged: *mut fmi3Boolean,
        nextEventTimeDefined: *mut fmi3Boolean,
        nextEventTime: *mut fmi3Float64,
    ) -> fmi3Status {
        let flags = [
            ("discreteStatesNeedUpdate", discreteStatesNeedUpdate),
            ("terminateSimulation", terminateSimulation),
            ("nominalsOfContinuousStatesChanged", nominalsOfContinuousStatesChanged),
            ("valuesOfContinuousStatesChanged", valuesOfContinuousStatesChanged),
            ("nextEventTimeDefined", nextEventTimeDefined),
        ];
        // SAFETY: instance and pointers meet this module's contract.
        unsafe {
            enter(instance, Function::UpdateDiscreteStates, |_| {
                let time = element_mut("nextEventTime", nextEventTime)?;
                for (name, flag) in flags {
                    *element_mut(name, flag)? = 0;
                }
                *time = 0.0;
                Ok(())
            })
        }
    }

    /// Ends the handling of an event.
    fn fmi3EnterStepMode: fmi3EnterStepModeTYPE(instance: fmi3Instance) -> fmi3Status {
        // SAFETY: the instance meets this module's contract.
        unsafe { enter(instance, Function::EnterStepMode, |component| component.change(State::StepMode)) }
    }

    /// Ends the run.
    fn fmi3Terminate: fmi3TerminateTYPE(instance: fmi3Instance) -> fmi3Status {
        // SAFETY: the instance meets this module's contract.
        unsafe { enter(instance, Function::Terminate, |component| component.change(State::Terminated)) }
    }

    /// Resets the instance to its state after `fmi3InstantiateCoSimulation`.
    fn fmi3Reset: fmi3ResetTYPE(instance: fmi3Instance) -> fmi3Status {
        // SAFETY: the instance meets this module's contract.
        unsafe { enter(instance, Function::Reset, Component::reset) }
    }

    /// Does one communication step. If the model ends the simulation, `terminateSimulation` is true and `lastSuccessfulTime` is that instant; if it
    /// lies before the end of the step, `earlyReturn` is true too, but only for an importer that allows it: for others, as the standard
    /// demands, it stays false.
    fn fmi3DoStep: fmi3DoStepTYPE(
        instance: fmi3Instance,
        currentCommunicationPoint: fmi3Float64,
        communicationStepSize: fmi3Float64,
        _noSetFMUStatePriorToCurrentPoint: fmi3Boolean,
        eventHandlingNeeded: *mut fmi3Boolean,
        terminateSimulation: *mut fmi3Boolean,
        earlyReturn: *mut fmi3Boolean,
        lastSuccessfulTime: *mut fmi3Float64,
    ) -> fmi3Status {
        let step = Step { time_s: currentCommunicationPoint, length_s: communicationStepSize };
        // SAFETY: instance and pointers meet this module's contract.
        unsafe {
            enter(instance, Function::DoStep, |component: &mut Component| {
                let event = element_mut("eventHandlingNeeded", eventHandlingNeeded)?;
                let terminate = element_mut("terminateSimulation", terminateSimulation)?;
                let early = element_mut("earlyReturn", earlyReturn)?;
                let time = element_mut("lastSuccessfulTime", lastSuccessfulTime)?;
                (*event, *terminate, *early) = (0, 0, 0);
                let outcome = component.step(step);
                *terminate = u8::from(component.instance.has_ended()) as fmi3Boolean;
                *time = component.instance.time_s();
                let is_early = component.instance.has_ended() && *time < step.end_s();
                *early = u8::from(is_early && component.options.early_return) as fmi3Boolean;
                outcome
            })
        }
    }

    /// Takes a snapshot, into an existing one if there is one.
    fn fmi3GetFMUState: fmi3GetFMUStateTYPE(instance: fmi3Instance, FMUState: *mut fmi3FMUState) -> fmi3Status {
        // SAFETY: instance and pointers meet this module's contract.
        unsafe { enter(instance, Function::GetFMUState, |component| states::get(component, FMUState)) }
    }

    /// Restores a snapshot of this or another instance of the same model, including the state in the sequence of calls and the
    /// time. The snapshot remains valid.
    fn fmi3SetFMUState: fmi3SetFMUStateTYPE(instance: fmi3Instance, FMUState: fmi3FMUState) -> fmi3Status {
        // SAFETY: instance and pointer meet this module's contract.
        unsafe { enter(instance, Function::SetFMUState, |component| states::set(component, FMUState)) }
    }

    /// Frees a snapshot and sets the pointer to null; a null pointer is ignored. Any instance of this library may be used.
    fn fmi3FreeFMUState: fmi3FreeFMUStateTYPE(instance: fmi3Instance, FMUState: *mut fmi3FMUState) -> fmi3Status {
        // SAFETY: instance and pointers meet this module's contract.
        unsafe { enter(instance, Function::FreeFMUState, |_| states::free(FMUState)) }
    }

    /// Returns the size of a serialized snapshot in bytes.
    fn fmi3SerializedFMUStateSize: fmi3SerializedFMUStateSizeTYPE(
        instance: fmi3Instance,
        FMUState: fmi3FMUState,
        size: *mut usize,
    ) -> fmi3Status {
        // SAFETY: instance and pointers meet this module's contract.
        unsafe { enter(instance, Function::SerializedFMUStateSize, |_| states::size(FMUState, size)) }
    }

    /// Serializes a snapshot. Bytes beyond its size are not changed.
    fn fmi3SerializeFMUState: fmi3SerializeFMUStateTYPE(
        instance: fmi3Instance,
        FMUState: fmi3FMUState,
        serializedState: *mut fmi3Byte,
        size: usize,
    ) -> fmi3Status {
        // SAFETY: instance, pointer and array meet this module's contract.
        unsafe {
            enter(instance, Function::SerializeFMUState, |_| states::serialize(FMUState, serializedState, size))
        }
    }

    /// Makes a new snapshot from bytes serialized by this process or another. Bytes of another model or version, and truncated or
    /// changed bytes, are refused.
    fn fmi3DeserializeFMUState: fmi3DeserializeFMUStateTYPE(
        instance: fmi3Instance,
        serializedState: *const fmi3Byte,
        size: usize,
        FMUState: *mut fmi3FMUState,
    ) -> fmi3Status {
        // SAFETY: instance, array and pointer meet this module's contract.
        unsafe {
            enter(instance, Function::DeserializeFMUState, |component| {
                states::deserialize(component, serializedState, size, FMUState)
            })
        }
    }

    /// Directional derivatives of outputs and of derivatives of states with respect to inputs and states, during initialization
    /// also with respect to parameters; exact.
    fn fmi3GetDirectionalDerivative: fmi3GetDirectionalDerivativeTYPE(
        instance: fmi3Instance,
        unknowns: *const fmi3ValueReference,
        nUnknowns: usize,
        knowns: *const fmi3ValueReference,
        nKnowns: usize,
        seed: *const fmi3Float64,
        nSeed: usize,
        sensitivity: *mut fmi3Float64,
        nSensitivity: usize,
    ) -> fmi3Status {
        let body = |component: &mut Component| {
            // SAFETY: all arrays meet this module's contract.
            let (unknowns, knowns, seed, sensitivity) = unsafe {
                (
                    elements("unknowns", unknowns, nUnknowns)?,
                    elements("knowns", knowns, nKnowns)?,
                    elements("seed", seed, nSeed)?,
                    elements_mut("sensitivity", sensitivity, nSensitivity)?,
                )
            };
            let knowns = indices_of(component, knowns, "nSeed", seed.len())?;
            let unknowns = indices_of(component, unknowns, "nSensitivity", sensitivity.len())?;
            component.differentiate((&knowns, seed), (&unknowns, sensitivity))
        };
        // SAFETY: the instance meets this module's contract.
        unsafe { enter(instance, Function::GetDirectionalDerivative, body) }
    }

    /// Derivatives of outputs with respect to time at the end of the last step, with the inputs held. Exact; 0 for sampled
    /// outputs, which are piecewise constant.
    fn fmi3GetOutputDerivatives: fmi3GetOutputDerivativesTYPE(
        instance: fmi3Instance,
        valueReferences: *const fmi3ValueReference,
        nValueReferences: usize,
        orders: *const fmi3Int32,
        values: *mut fmi3Float64,
        nValues: usize,
    ) -> fmi3Status {
        let body = |component: &mut Component| {
            // SAFETY: all arrays meet this module's contract.
            let (references, orders, values) = unsafe {
                (
                    elements("valueReferences", valueReferences, nValueReferences)?,
                    elements("orders", orders, nValueReferences)?,
                    elements_mut("values", values, nValues)?,
                )
            };
            let indices = indices_of(component, references, "nValues", nValues)?;
            // The order of a reference applies to all elements of its array.
            let sizes = references.iter().map(|reference| size_of_variable(component, *reference));
            let orders: Vec<_> = orders.iter().zip(sizes).flat_map(|(order, size)| repeat_n(*order, size)).collect();
            for ((index, order), value) in indices.iter().zip(orders).zip(values) {
                let found = component.instance.output_derivative(*index as usize, order).map_err(Problem::call)?;
                *value = finite_result(component, *index, found)?;
            }
            Ok(())
        };
        // SAFETY: the instance meets this module's contract.
        unsafe { enter(instance, Function::GetOutputDerivatives, body) }
    }
}
