//! Which function may be called in which state, as a table (FMI 3.0.2, sections 2.3 and 4.2).

use super::Fmi3;
pub use crate::interface::sequence::State;
use crate::interface::sequence::{
    ALWAYS, ERROR, EVENT, INITIALIZATION, INSTANTIATED, Rule, STEP, TERMINATED, call_table,
};

/// The states of this standard, with their names in messages.
pub(super) const STATES: &[(State, &str)] = &[
    (State::Instantiated, "instantiated"),
    (State::InitializationMode, "initialization mode"),
    (State::EventMode, "event mode"),
    (State::StepMode, "step mode"),
    (State::Terminated, "terminated"),
    (State::Error, "error"),
];

/// States in which values may be read.
const READ: u8 = INITIALIZATION | EVENT | STEP | TERMINATED | ERROR;
/// States in which values may be written.
const WRITE: u8 = INSTANTIATED | INITIALIZATION | EVENT | STEP;
/// Refused in any state, with a message that states the reason.
const REFUSED: u8 = ALWAYS;

call_table! { Fmi3, "fmi3";
    SetDebugLogging:                 ALWAYS,
    FreeInstance:                    ALWAYS,
    EnterInitializationMode:         INSTANTIATED,
    ExitInitializationMode:          INITIALIZATION,
    EnterEventMode:                  STEP,
    // After an error the standard allows only reset and free; importers terminate anyway, which is harmless.
    Terminate:                       EVENT | STEP | ERROR,
    Reset:                           ALWAYS,
    GetFloat32:                      READ,
    GetFloat64:                      READ,
    GetInt8:                         READ,
    GetUInt8:                        READ,
    GetInt16:                        READ,
    GetUInt16:                       READ,
    GetInt32:                        READ,
    GetUInt32:                       READ,
    GetInt64:                        READ,
    GetUInt64:                       READ,
    GetBoolean:                      READ,
    GetString:                       READ,
    GetBinary:                       READ,
    GetClock:                        READ,
    SetFloat32:                      WRITE,
    SetFloat64:                      WRITE,
    SetInt8:                         WRITE,
    SetUInt8:                        WRITE,
    SetInt16:                        WRITE,
    SetUInt16:                       WRITE,
    SetInt32:                        WRITE,
    SetUInt32:                       WRITE,
    SetInt64:                        WRITE,
    SetUInt64:                       WRITE,
    SetBoolean:                      WRITE,
    SetString:                       WRITE,
    SetBinary:                       WRITE,
    SetClock:                        WRITE,
    GetNumberOfVariableDependencies: REFUSED,
    GetVariableDependencies:         REFUSED,
    GetFMUState:                     ALWAYS,
    SetFMUState:                     ALWAYS,
    FreeFMUState:                    ALWAYS,
    SerializedFMUStateSize:          ALWAYS,
    SerializeFMUState:               ALWAYS,
    DeserializeFMUState:             ALWAYS,
    GetDirectionalDerivative:        READ,
    GetAdjointDerivative:            REFUSED,
    EnterConfigurationMode:          REFUSED,
    ExitConfigurationMode:           REFUSED,
    GetIntervalDecimal:              REFUSED,
    GetIntervalFraction:             REFUSED,
    GetShiftDecimal:                 REFUSED,
    GetShiftFraction:                REFUSED,
    SetIntervalDecimal:              REFUSED,
    SetIntervalFraction:             REFUSED,
    SetShiftDecimal:                 REFUSED,
    SetShiftFraction:                REFUSED,
    EvaluateDiscreteStates:          REFUSED,
    UpdateDiscreteStates:            EVENT,
    EnterContinuousTimeMode:         REFUSED,
    CompletedIntegratorStep:         REFUSED,
    SetTime:                         REFUSED,
    SetContinuousStates:             REFUSED,
    GetContinuousStateDerivatives:   REFUSED,
    GetEventIndicators:              REFUSED,
    GetContinuousStates:             REFUSED,
    GetNominalsOfContinuousStates:   REFUSED,
    GetNumberOfEventIndicators:      REFUSED,
    GetNumberOfContinuousStates:     REFUSED,
    EnterStepMode:                   EVENT,
    GetOutputDerivatives:            EVENT | STEP | TERMINATED | ERROR,
    DoStep:                          STEP,
    ActivateModelPartition:          REFUSED,
}
