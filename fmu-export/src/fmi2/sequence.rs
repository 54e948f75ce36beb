//! Which function may be called in which state, as a table (FMI 2.0.4, section 4.2.4).

use super::Fmi2;
pub use crate::interface::sequence::State;
use crate::interface::sequence::{
    ALWAYS, ERROR, INITIALIZATION, INSTANTIATED, NEVER, READ, RESULT, Rule, STEP, WRITE, call_table,
};

/// The states of this standard, with their names in messages.
pub(super) const STATES: &[(State, &str)] = &[
    (State::Instantiated, "instantiated"),
    (State::InitializationMode, "initialization mode"),
    (State::StepMode, "step complete"),
    (State::Terminated, "terminated"),
    (State::Error, "error"),
];

call_table! { Fmi2, "fmi2";
    SetDebugLogging:           ALWAYS,
    FreeInstance:              ALWAYS,
    SetupExperiment:           INSTANTIATED,
    EnterInitializationMode:   INSTANTIATED,
    ExitInitializationMode:    INITIALIZATION,
    // After an error the standard allows only reset and free; importers terminate anyway, which is harmless.
    Terminate:                 STEP | ERROR,
    Reset:                     ALWAYS,
    GetReal:                   READ,
    GetInteger:                READ,
    GetBoolean:                READ,
    GetString:                 READ,
    SetReal:                   WRITE,
    SetInteger:                WRITE,
    SetBoolean:                WRITE,
    SetString:                 WRITE,
    GetFMUstate:               ALWAYS,
    SetFMUstate:               ALWAYS,
    FreeFMUstate:              ALWAYS,
    SerializedFMUstateSize:    ALWAYS,
    SerializeFMUstate:         ALWAYS,
    DeSerializeFMUstate:       ALWAYS,
    GetDirectionalDerivative:  READ,
    SetRealInputDerivatives:   WRITE,
    GetRealOutputDerivatives:  RESULT,
    DoStep:                    STEP,
    // No step is ever in progress when a call arrives.
    CancelStep:                NEVER,
    GetStatus:                 RESULT,
    GetRealStatus:             RESULT,
    GetIntegerStatus:          RESULT,
    GetBooleanStatus:          RESULT,
    GetStringStatus:           RESULT,
}
