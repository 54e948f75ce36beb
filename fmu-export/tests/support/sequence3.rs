//! The sequence of calls of FMI 3.0: every function in every state.

use std::ptr::{null, null_mut};

use fmu_export::fmi3::bindings::*;
use fmu_export::fmi3::sequence::Function;

use super::ffi3::{Fmu3, Request3, no_state};
use super::sequence::Subject;
use crate::call3;

/// States by letter, as in the table below, with their names in messages.
const STATES: [(char, &str); 6] = [
    ('i', "instantiated"),
    ('m', "initialization mode"),
    ('v', "event mode"),
    ('s', "step mode"),
    ('t', "terminated"),
    ('e', "error"),
];

/// An instance in a state.
fn in_state(subject: Subject, state: char) -> Fmu3 {
    let request = Request3 { logging: true, event_mode: true, ..Request3::of(subject.model, false) };
    let fmu = request.instantiate(subject.model, false).expect("an instance");
    match state {
        'i' => {}
        'm' => fmu.ok(fmu.enter_initialization(0.0, None)),
        'v' => fmu.start(0.0),
        's' | 't' => {
            fmu.start(0.0);
            fmu.ok(fmu.enter_step_mode());
            if state == 't' {
                fmu.ok(fmu.terminate());
            }
        }
        'e' => {
            fmu.ok(fmu.set(subject.refused.0, subject.refused.1));
            fmu.ok(fmu.enter_initialization(0.0, None));
            fmu.error(fmu.exit_initialization());
        }
        other => panic!("there is no state {other}"),
    }
    fmu
}

/// The state of an instance, from a message; the instance is unchanged.
fn state_of(fmu: &Fmu3) -> char {
    let mut state = no_state();
    fmu.ok(fmu.get_state(&mut state));
    let status = fmu.update_discrete_states();
    let text = if status == fmi3Status::fmi3OK { "in the state `event mode`".into() } else { fmu.error(status) };
    fmu.ok(fmu.set_state(state));
    fmu.ok(fmu.free_state(&mut state));
    let found = STATES.into_iter().find(|(_, words)| text.contains(&format!("in the state `{words}`")));
    found.unwrap_or_else(|| panic!("no state is named in: {text}")).0
}

/// A call with valid arguments where possible. Its snapshots are freed.
fn call(subject: Subject, fmu: &Fmu3, function: &str) -> fmi3Status {
    let c = fmu.instance();
    let mut state = no_state();
    // SAFETY: the instance is live; pointers are null, and the lengths of arrays 0.
    unsafe {
        match function {
            "EnterInitializationMode" => fmu.enter_initialization(0.0, None),
            "ExitInitializationMode" => fmu.exit_initialization(),
            "EnterEventMode" => fmu.enter_event_mode(),
            "EnterStepMode" => fmu.enter_step_mode(),
            "UpdateDiscreteStates" => fmu.update_discrete_states(),
            "Terminate" => fmu.terminate(),
            "Reset" => fmu.reset(),
            "DoStep" => fmu.step(0.0, subject.step_s),
            "GetFMUState" => {
                let status = fmu.get_state(&mut state);
                if !state.is_null() {
                    fmu.ok(fmu.free_state(&mut state));
                }
                status
            }
            "SetDebugLogging" => call3!(fmi3SetDebugLogging: fmi3SetDebugLoggingTYPE(c, 0, 0, null())),
            "SetFMUState" => call3!(fmi3SetFMUState: fmi3SetFMUStateTYPE(c, no_state())),
            "FreeFMUState" => call3!(fmi3FreeFMUState: fmi3FreeFMUStateTYPE(c, null_mut())),
            "SerializedFMUStateSize" => {
                call3!(fmi3SerializedFMUStateSize: fmi3SerializedFMUStateSizeTYPE(c, no_state(), null_mut()))
            }
            "SerializeFMUState" => {
                call3!(fmi3SerializeFMUState: fmi3SerializeFMUStateTYPE(c, no_state(), null_mut(), 0))
            }
            "DeserializeFMUState" => {
                call3!(fmi3DeserializeFMUState: fmi3DeserializeFMUStateTYPE(c, null(), 0, null_mut()))
            }
            "GetDirectionalDerivative" => {
                call3!(fmi3GetDirectionalDerivative: fmi3GetDirectionalDerivativeTYPE(c, null(), 0, null(), 0, null(), 0, null_mut(), 0))
            }
            "GetOutputDerivatives" => {
                call3!(fmi3GetOutputDerivatives: fmi3GetOutputDerivativesTYPE(c, null(), 0, null(), null_mut(), 0))
            }
            "GetFloat32" => call3!(fmi3GetFloat32: fmi3GetFloat32TYPE(c, null(), 0, null_mut(), 0)),
            "GetFloat64" => call3!(fmi3GetFloat64: fmi3GetFloat64TYPE(c, null(), 0, null_mut(), 0)),
            "GetInt8" => call3!(fmi3GetInt8: fmi3GetInt8TYPE(c, null(), 0, null_mut(), 0)),
            "GetUInt8" => call3!(fmi3GetUInt8: fmi3GetUInt8TYPE(c, null(), 0, null_mut(), 0)),
            "GetInt16" => call3!(fmi3GetInt16: fmi3GetInt16TYPE(c, null(), 0, null_mut(), 0)),
            "GetUInt16" => call3!(fmi3GetUInt16: fmi3GetUInt16TYPE(c, null(), 0, null_mut(), 0)),
            "GetInt32" => call3!(fmi3GetInt32: fmi3GetInt32TYPE(c, null(), 0, null_mut(), 0)),
            "GetUInt32" => call3!(fmi3GetUInt32: fmi3GetUInt32TYPE(c, null(), 0, null_mut(), 0)),
            "GetInt64" => call3!(fmi3GetInt64: fmi3GetInt64TYPE(c, null(), 0, null_mut(), 0)),
            "GetUInt64" => call3!(fmi3GetUInt64: fmi3GetUInt64TYPE(c, null(), 0, null_mut(), 0)),
            "GetBoolean" => call3!(fmi3GetBoolean: fmi3GetBooleanTYPE(c, null(), 0, null_mut(), 0)),
            "GetString" => call3!(fmi3GetString: fmi3GetStringTYPE(c, null(), 0, null_mut(), 0)),
            "GetBinary" => call3!(fmi3GetBinary: fmi3GetBinaryTYPE(c, null(), 0, null_mut(), null_mut(), 0)),
            "GetClock" => call3!(fmi3GetClock: fmi3GetClockTYPE(c, null(), 0, null_mut())),
            "SetFloat32" => call3!(fmi3SetFloat32: fmi3SetFloat32TYPE(c, null(), 0, null(), 0)),
            "SetFloat64" => call3!(fmi3SetFloat64: fmi3SetFloat64TYPE(c, null(), 0, null(), 0)),
            "SetInt8" => call3!(fmi3SetInt8: fmi3SetInt8TYPE(c, null(), 0, null(), 0)),
            "SetUInt8" => call3!(fmi3SetUInt8: fmi3SetUInt8TYPE(c, null(), 0, null(), 0)),
            "SetInt16" => call3!(fmi3SetInt16: fmi3SetInt16TYPE(c, null(), 0, null(), 0)),
            "SetUInt16" => call3!(fmi3SetUInt16: fmi3SetUInt16TYPE(c, null(), 0, null(), 0)),
            "SetInt32" => call3!(fmi3SetInt32: fmi3SetInt32TYPE(c, null(), 0, null(), 0)),
            "SetUInt32" => call3!(fmi3SetUInt32: fmi3SetUInt32TYPE(c, null(), 0, null(), 0)),
            "SetInt64" => call3!(fmi3SetInt64: fmi3SetInt64TYPE(c, null(), 0, null(), 0)),
            "SetUInt64" => call3!(fmi3SetUInt64: fmi3SetUInt64TYPE(c, null(), 0, null(), 0)),
            "SetBoolean" => call3!(fmi3SetBoolean: fmi3SetBooleanTYPE(c, null(), 0, null(), 0)),
            "SetString" => call3!(fmi3SetString: fmi3SetStringTYPE(c, null(), 0, null(), 0)),
            "SetBinary" => call3!(fmi3SetBinary: fmi3SetBinaryTYPE(c, null(), 0, null(), null(), 0)),
            "SetClock" => call3!(fmi3SetClock: fmi3SetClockTYPE(c, null(), 0, null())),
            "GetNumberOfVariableDependencies" => {
                call3!(fmi3GetNumberOfVariableDependencies: fmi3GetNumberOfVariableDependenciesTYPE(c, 0, null_mut()))
            }
            "GetVariableDependencies" => {
                call3!(fmi3GetVariableDependencies: fmi3GetVariableDependenciesTYPE(c, 0, null_mut(), null_mut(), null_mut(), null_mut(), 0))
            }
            "GetAdjointDerivative" => {
                call3!(fmi3GetAdjointDerivative: fmi3GetAdjointDerivativeTYPE(c, null(), 0, null(), 0, null(), 0, null_mut(), 0))
            }
            "EnterConfigurationMode" => call3!(fmi3EnterConfigurationMode: fmi3EnterConfigurationModeTYPE(c)),
            "ExitConfigurationMode" => call3!(fmi3ExitConfigurationMode: fmi3ExitConfigurationModeTYPE(c)),
            "GetIntervalDecimal" => {
                call3!(fmi3GetIntervalDecimal: fmi3GetIntervalDecimalTYPE(c, null(), 0, null_mut(), null_mut()))
            }
            "GetIntervalFraction" => {
                call3!(fmi3GetIntervalFraction: fmi3GetIntervalFractionTYPE(c, null(), 0, null_mut(), null_mut(), null_mut()))
            }
            "GetShiftDecimal" => call3!(fmi3GetShiftDecimal: fmi3GetShiftDecimalTYPE(c, null(), 0, null_mut())),
            "GetShiftFraction" => {
                call3!(fmi3GetShiftFraction: fmi3GetShiftFractionTYPE(c, null(), 0, null_mut(), null_mut()))
            }
            "SetIntervalDecimal" => call3!(fmi3SetIntervalDecimal: fmi3SetIntervalDecimalTYPE(c, null(), 0, null())),
            "SetIntervalFraction" => {
                call3!(fmi3SetIntervalFraction: fmi3SetIntervalFractionTYPE(c, null(), 0, null(), null()))
            }
            "SetShiftDecimal" => call3!(fmi3SetShiftDecimal: fmi3SetShiftDecimalTYPE(c, null(), 0, null())),
            "SetShiftFraction" => call3!(fmi3SetShiftFraction: fmi3SetShiftFractionTYPE(c, null(), 0, null(), null())),
            "EvaluateDiscreteStates" => call3!(fmi3EvaluateDiscreteStates: fmi3EvaluateDiscreteStatesTYPE(c)),
            "EnterContinuousTimeMode" => call3!(fmi3EnterContinuousTimeMode: fmi3EnterContinuousTimeModeTYPE(c)),
            "CompletedIntegratorStep" => {
                call3!(fmi3CompletedIntegratorStep: fmi3CompletedIntegratorStepTYPE(c, 0, null_mut(), null_mut()))
            }
            "SetTime" => call3!(fmi3SetTime: fmi3SetTimeTYPE(c, 0.0)),
            "SetContinuousStates" => call3!(fmi3SetContinuousStates: fmi3SetContinuousStatesTYPE(c, null(), 0)),
            "GetContinuousStateDerivatives" => {
                call3!(fmi3GetContinuousStateDerivatives: fmi3GetContinuousStateDerivativesTYPE(c, null_mut(), 0))
            }
            "GetEventIndicators" => call3!(fmi3GetEventIndicators: fmi3GetEventIndicatorsTYPE(c, null_mut(), 0)),
            "GetContinuousStates" => call3!(fmi3GetContinuousStates: fmi3GetContinuousStatesTYPE(c, null_mut(), 0)),
            "GetNominalsOfContinuousStates" => {
                call3!(fmi3GetNominalsOfContinuousStates: fmi3GetNominalsOfContinuousStatesTYPE(c, null_mut(), 0))
            }
            "GetNumberOfEventIndicators" => {
                call3!(fmi3GetNumberOfEventIndicators: fmi3GetNumberOfEventIndicatorsTYPE(c, null_mut()))
            }
            "GetNumberOfContinuousStates" => {
                call3!(fmi3GetNumberOfContinuousStates: fmi3GetNumberOfContinuousStatesTYPE(c, null_mut()))
            }
            "ActivateModelPartition" => call3!(fmi3ActivateModelPartition: fmi3ActivateModelPartitionTYPE(c, 0, 0.0)),
            other => panic!("{other} is not swept"),
        }
    }
}

/// Functions that are allowed only in some states, from FMI 3.0.2, sections 2.3 and 4.2, with liberties that importers take:
/// logging settings at any time, and termination after an error.
const SEQUENCE: [(&str, &str); 11] = [
    ("EnterInitializationMode", "i"),
    ("ExitInitializationMode", "m"),
    ("EnterEventMode", "s"),
    ("EnterStepMode", "v"),
    ("UpdateDiscreteStates", "v"),
    ("Terminate", "vse"),
    ("DoStep", "s"),
    ("GetDirectionalDerivative", "mvste"),
    ("GetOutputDerivatives", "vste"),
    // For all types.
    ("Get", "mvste"),
    ("Set", "imvs"),
];

const TYPES: [&str; 14] = [
    "Float32", "Float64", "Int8", "UInt8", "Int16", "UInt16", "Int32", "UInt32", "Int64", "UInt64", "Boolean",
    "String", "Binary", "Clock",
];

/// Functions that are refused in any state.
const REFUSED: [&str; 25] = [
    "GetNumberOfVariableDependencies",
    "GetVariableDependencies",
    "GetAdjointDerivative",
    "EnterConfigurationMode",
    "ExitConfigurationMode",
    "GetIntervalDecimal",
    "GetIntervalFraction",
    "GetShiftDecimal",
    "GetShiftFraction",
    "SetIntervalDecimal",
    "SetIntervalFraction",
    "SetShiftDecimal",
    "SetShiftFraction",
    "EvaluateDiscreteStates",
    "EnterContinuousTimeMode",
    "CompletedIntegratorStep",
    "SetTime",
    "SetContinuousStates",
    "GetContinuousStateDerivatives",
    "GetEventIndicators",
    "GetContinuousStates",
    "GetNominalsOfContinuousStates",
    "GetNumberOfEventIndicators",
    "GetNumberOfContinuousStates",
    "ActivateModelPartition",
];

/// The states in which a function may be called.
fn allowed(function: &str) -> &'static str {
    let of_type =
        TYPES.iter().find_map(|name| function.strip_suffix(name).filter(|rest| ["Get", "Set"].contains(rest)));
    let row = SEQUENCE.iter().find(|(name, _)| *name == of_type.unwrap_or(function));
    row.map_or("imvste", |(_, states)| states)
}

/// Fails if the sequence of calls is not checked, if any row of it allows too much, or if a message does not state where the
/// function is allowed.
pub fn every_function_is_refused_in_all_other_states(subject: Subject) {
    for function in Function::ALL.iter().map(|function| &function.name()["fmi3".len()..]) {
        if function == "FreeInstance" {
            continue;
        }
        let allowed = allowed(function);
        for (state, words) in STATES {
            let fmu = in_state(subject, state);
            assert_eq!(state_of(&fmu), state);
            let status = call(subject, &fmu, function);
            if allowed.contains(state) {
                let messages = fmu.take_messages();
                // It may be refused for other reasons than the sequence.
                assert!(
                    messages.iter().all(|message| !message.text.contains("not allowed in the state")),
                    "fmi3{function} in `{words}`: {messages:?}"
                );
                if REFUSED.contains(&function) {
                    assert_eq!((status, messages.len()), (fmi3Status::fmi3Error, 1), "fmi3{function} in `{words}`");
                    assert!(messages[0].text.starts_with(&format!("fmi3{function}: ")), "{messages:?}");
                    assert_eq!(state_of(&fmu), state, "fmi3{function} in `{words}` changed the state");
                }
                continue;
            }
            let text = fmu.error(status);
            for part in [format!("fmi3{function}: "), format!("in the state `{words}`"), "allowed in".into()] {
                assert!(text.contains(&part), "`{part}` is not said in: {text}");
            }
            for (letter, words) in STATES {
                let named = text.split("allowed in: ").last().expect("a list").contains(words);
                assert_eq!(named, allowed.contains(letter), "`{words}` in: {text}");
            }
            assert_eq!(state_of(&fmu), state, "fmi3{function} in `{words}` changed the state");
        }
    }
}
