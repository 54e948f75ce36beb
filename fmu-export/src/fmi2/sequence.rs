//! Which function may be called in which state, as a table (FMI 2.0.4, section 4.2.4).

use super::Fmi2;
pub use crate::interface::sequence::State;
use crate::interface::sequence::{
    ALWAYS, ERROR, INITIALIZATION, INSTANTIATED, NEVER, Rule, STEP, TERMINATED, call_table,
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
    GetReal:                   INITIALIZATION | STEP | TERMINATED | ERROR,
    GetInteger:                INITIALIZATION | STEP | TERMINATED | ERROR,
    GetBoolean:                INITIALIZATION | STEP | TERMINATED | ERROR,
    GetString:                 INITIALIZATION | STEP | TERMINATED | ERROR,
    SetReal:                   INSTANTIATED | INITIALIZATION | STEP,
    SetInteger:                INSTANTIATED | INITIALIZATION | STEP,
    SetBoolean:                INSTANTIATED | INITIALIZATION | STEP,
    SetString:                 INSTANTIATED | INITIALIZATION | STEP,
    GetFMUstate:               ALWAYS,
    SetFMUstate:               ALWAYS,
    FreeFMUstate:              ALWAYS,
    SerializedFMUstateSize:    ALWAYS,
    SerializeFMUstate:         ALWAYS,
    DeSerializeFMUstate:       ALWAYS,
    GetDirectionalDerivative:  INITIALIZATION | STEP | TERMINATED | ERROR,
    SetRealInputDerivatives:   INSTANTIATED | INITIALIZATION | STEP,
    GetRealOutputDerivatives:  STEP | TERMINATED | ERROR,
    DoStep:                    STEP,
    // No step is ever in progress when a call arrives.
    CancelStep:                NEVER,
    GetStatus:                 STEP | TERMINATED | ERROR,
    GetRealStatus:             STEP | TERMINATED | ERROR,
    GetIntegerStatus:          STEP | TERMINATED | ERROR,
    GetBooleanStatus:          STEP | TERMINATED | ERROR,
    GetStringStatus:           STEP | TERMINATED | ERROR,
}
