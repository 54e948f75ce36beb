//! The sequence of calls: every function in every state.

use std::ffi::c_char;
use std::ptr::{null, null_mut};

use fmu_export::fmi2::bindings::*;
use fmu_export::fmi2::sequence::Function;

use super::ffi::{Expect, Fmu};
use crate::call;

/// States by letter, as in the table below, with their names in messages.
pub const STATES: [(char, &str); 5] =
    [('i', "instantiated"), ('m', "initialization mode"), ('s', "step complete"), ('t', "terminated"), ('e', "error")];

/// The tested model.
#[derive(Clone, Copy)]
pub struct Subject {
    /// Its name.
    pub model: &'static str,
    /// A Real variable that can be read at any time.
    pub real: &'static str,
    /// A parameter, and a value refused at the start.
    pub refused: (&'static str, f64),
    /// Length of a step, in s.
    pub step_s: f64,
}

/// An instance in a state.
pub fn in_state(subject: Subject, state: char) -> Fmu {
    let fmu = Fmu::new(subject.model);
    match state {
        'i' => {}
        'm' => {
            fmu.setup(0.0, None).ok(&fmu);
            fmu.enter_initialization().ok(&fmu);
        }
        's' => fmu.start(0.0, None),
        't' => {
            fmu.start(0.0, None);
            fmu.terminate().ok(&fmu);
        }
        'e' => {
            fmu.set(subject.refused.0, subject.refused.1).ok(&fmu);
            fmu.enter_initialization().ok(&fmu);
            fmu.exit_initialization().error(&fmu);
        }
        other => panic!("there is no state {other}"),
    }
    fmu
}

/// The state of an instance, from the message of fmi2CancelStep, which is refused in any state.
pub fn state_of(fmu: &Fmu) -> char {
    // SAFETY: the instance is live.
    let text = unsafe { call!(fmi2CancelStep: fmi2CancelStepTYPE(fmu.component())) }.error(fmu);
    let found = STATES.into_iter().find(|(_, words)| text.contains(&format!("in the state `{words}`")));
    found.unwrap_or_else(|| panic!("no state is named in: {text}")).0
}

/// A call with valid arguments. Its snapshots are freed.
fn call(subject: Subject, fmu: &Fmu, function: &str) -> fmi2Status {
    let c = fmu.component();
    let real = [fmu.reference(subject.real)];
    let mut values = [0.0];
    let mut bytes: [c_char; 1] = [0];
    let mut state: fmi2FMUstate = null_mut();
    let (mut status, mut size, mut whole) = (fmi2Status::fmi2OK, 0, 0);
    let mut word: fmi2String = null();
    let one = [1];
    // SAFETY: the instance is live or null; arrays have the stated length, or the length is 0; a null snapshot is refused.
    let answer = unsafe {
        match function {
            "SetDebugLogging" => call!(fmi2SetDebugLogging: fmi2SetDebugLoggingTYPE(c, fmi2True, 0, null())),
            "SetupExperiment" => fmu.setup(0.0, None),
            "EnterInitializationMode" => fmu.enter_initialization(),
            "ExitInitializationMode" => fmu.exit_initialization(),
            "Terminate" => fmu.terminate(),
            "Reset" => fmu.reset(),
            "GetReal" => call!(fmi2GetReal: fmi2GetRealTYPE(c, real.as_ptr(), 1, values.as_mut_ptr())),
            "GetInteger" => call!(fmi2GetInteger: fmi2GetIntegerTYPE(c, null(), 0, null_mut())),
            "GetBoolean" => call!(fmi2GetBoolean: fmi2GetBooleanTYPE(c, null(), 0, null_mut())),
            "GetString" => call!(fmi2GetString: fmi2GetStringTYPE(c, null(), 0, null_mut())),
            "SetReal" => call!(fmi2SetReal: fmi2SetRealTYPE(c, real.as_ptr(), 1, values.as_ptr())),
            "SetInteger" => call!(fmi2SetInteger: fmi2SetIntegerTYPE(c, null(), 0, null())),
            "SetBoolean" => call!(fmi2SetBoolean: fmi2SetBooleanTYPE(c, null(), 0, null())),
            "SetString" => call!(fmi2SetString: fmi2SetStringTYPE(c, null(), 0, null())),
            "GetFMUstate" => {
                let status = fmu.get_state(&mut state);
                if !state.is_null() {
                    fmu.free_state(&mut state).ok(fmu);
                }
                status
            }
            "SetFMUstate" => fmu.set_state(null_mut()),
            "FreeFMUstate" => fmu.free_state(&mut state),
            "SerializedFMUstateSize" => {
                call!(fmi2SerializedFMUstateSize: fmi2SerializedFMUstateSizeTYPE(c, null_mut(), &raw mut size))
            }
            "SerializeFMUstate" => {
                call!(fmi2SerializeFMUstate: fmi2SerializeFMUstateTYPE(c, null_mut(), bytes.as_mut_ptr(), 1))
            }
            "DeSerializeFMUstate" => {
                call!(fmi2DeSerializeFMUstate: fmi2DeSerializeFMUstateTYPE(c, bytes.as_ptr(), 1, &raw mut state))
            }
            "GetDirectionalDerivative" => call!(
                fmi2GetDirectionalDerivative:
                    fmi2GetDirectionalDerivativeTYPE(c, null(), 0, null(), 0, null(), null_mut())
            ),
            "SetRealInputDerivatives" => call!(
                fmi2SetRealInputDerivatives:
                    fmi2SetRealInputDerivativesTYPE(c, real.as_ptr(), 1, one.as_ptr(), values.as_ptr())
            ),
            "GetRealOutputDerivatives" => call!(
                fmi2GetRealOutputDerivatives: fmi2GetRealOutputDerivativesTYPE(c, null(), 0, null(), null_mut())
            ),
            "DoStep" => fmu.step(0.0, subject.step_s),
            "CancelStep" => call!(fmi2CancelStep: fmi2CancelStepTYPE(c)),
            "GetStatus" => {
                call!(fmi2GetStatus: fmi2GetStatusTYPE(c, fmi2StatusKind::fmi2DoStepStatus, &raw mut status))
            }
            "GetRealStatus" => call!(
                fmi2GetRealStatus:
                    fmi2GetRealStatusTYPE(c, fmi2StatusKind::fmi2LastSuccessfulTime, values.as_mut_ptr())
            ),
            "GetIntegerStatus" => call!(
                fmi2GetIntegerStatus: fmi2GetIntegerStatusTYPE(c, fmi2StatusKind::fmi2DoStepStatus, &raw mut whole)
            ),
            "GetBooleanStatus" => call!(
                fmi2GetBooleanStatus: fmi2GetBooleanStatusTYPE(c, fmi2StatusKind::fmi2Terminated, &raw mut whole)
            ),
            "GetStringStatus" => call!(
                fmi2GetStringStatus: fmi2GetStringStatusTYPE(c, fmi2StatusKind::fmi2PendingStatus, &raw mut word)
            ),
            other => panic!("{other} is not swept"),
        }
    };
    assert!(!c.is_null() || values == [0.0], "fmi2{function} returns a value of no instance");
    answer
}

/// The states in which each function is allowed, from FMI 2.0.4, section 4.2.4, with liberties that importers take: logging settings
/// at any time, and termination after an error.
const SEQUENCE: [(&str, &str); 30] = [
    ("SetDebugLogging", "imste"),
    ("SetupExperiment", "i"),
    ("EnterInitializationMode", "i"),
    ("ExitInitializationMode", "m"),
    ("Terminate", "se"),
    ("Reset", "imste"),
    ("GetReal", "mste"),
    ("GetInteger", "mste"),
    ("GetBoolean", "mste"),
    ("GetString", "mste"),
    ("SetReal", "ims"),
    ("SetInteger", "ims"),
    ("SetBoolean", "ims"),
    ("SetString", "ims"),
    ("GetFMUstate", "imste"),
    ("SetFMUstate", "imste"),
    ("FreeFMUstate", "imste"),
    ("SerializedFMUstateSize", "imste"),
    ("SerializeFMUstate", "imste"),
    ("DeSerializeFMUstate", "imste"),
    ("GetDirectionalDerivative", "mste"),
    ("SetRealInputDerivatives", "ims"),
    ("GetRealOutputDerivatives", "ste"),
    ("DoStep", "s"),
    ("CancelStep", ""),
    ("GetStatus", "ste"),
    ("GetRealStatus", "ste"),
    ("GetIntegerStatus", "ste"),
    ("GetBooleanStatus", "ste"),
    ("GetStringStatus", "ste"),
];

/// Fails if the sequence of calls is not checked, if any row of it allows too much, or if a message does not state where the
/// function is allowed.
pub fn every_function_is_refused_in_all_other_states(subject: Subject) {
    for (function, allowed) in SEQUENCE {
        for (state, words) in STATES {
            let fmu = in_state(subject, state);
            assert_eq!(state_of(&fmu), state);
            let status = call(subject, &fmu, function);
            if allowed.contains(state) {
                // It may be refused for other reasons than the sequence.
                let messages = fmu.take_messages();
                assert!(
                    messages.iter().all(|message| !message.text.contains("not allowed in the state")),
                    "fmi2{function} in `{words}`: {messages:?}"
                );
                continue;
            }
            let text = status.error(&fmu);
            for part in [format!("fmi2{function}: "), format!("in the state `{words}`"), "allowed in".into()] {
                assert!(text.contains(&part), "`{part}` is not said in: {text}");
            }
            for (letter, words) in STATES {
                let named = text.split("allowed in: ").last().expect("a list").contains(words);
                assert_eq!(named, allowed.contains(letter), "`{words}` in: {text}");
            }
            assert_eq!(state_of(&fmu), state, "fmi2{function} in `{words}` changed the state");
        }
    }
}

/// Fails if a call without an instance returns fmi2OK or a value.
pub fn every_function_needs_an_instance(subject: Subject) {
    let mut fmu = Fmu::new(subject.model);
    fmu.free();
    for (function, _) in SEQUENCE.iter().filter(|(function, _)| *function != "FreeFMUstate") {
        assert_eq!(call(subject, &fmu, function), fmi2Status::fmi2Error, "fmi2{function}");
    }
}

/// Fails if the table above lacks a function other than fmi2FreeInstance, which returns nothing.
pub fn every_function_is_swept() {
    let swept: Vec<_> = SEQUENCE.iter().map(|(function, _)| format!("fmi2{function}")).collect();
    for function in Function::ALL {
        let name = function.name();
        assert!(swept.iter().any(|known| known == name) || name == "fmi2FreeInstance", "{name} is not swept");
    }
}
