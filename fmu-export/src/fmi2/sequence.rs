//! Which function may be called in which state, as a table (FMI 2.0.4, section 4.2.4).

use std::fmt;

/// States of an instance. The standard's states of a pending, cancelled or discarded step do not occur: a step is either
/// completed within its call or fails.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum State {
    /// After `fmi2Instantiate` or `fmi2Reset`.
    Instantiated = 0b0_0001,
    /// Between `fmi2EnterInitializationMode` and `fmi2ExitInitializationMode`.
    InitializationMode = 0b0_0010,
    /// Between steps.
    StepComplete = 0b0_0100,
    /// After `fmi2Terminate`.
    Terminated = 0b0_1000,
    /// After an error that ended the run.
    Error = 0b1_0000,
}

impl State {
    /// All states.
    pub const ALL: [Self; 5] =
        [Self::Instantiated, Self::InitializationMode, Self::StepComplete, Self::Terminated, Self::Error];
}

impl fmt::Display for State {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            State::Instantiated => "instantiated",
            State::InitializationMode => "initialization mode",
            State::StepComplete => "step complete",
            State::Terminated => "terminated",
            State::Error => "error",
        })
    }
}

const INSTANTIATED: u8 = State::Instantiated as u8;
const INITIALIZATION: u8 = State::InitializationMode as u8;
const STEP: u8 = State::StepComplete as u8;
const TERMINATED: u8 = State::Terminated as u8;
const ERROR: u8 = State::Error as u8;
const ALWAYS: u8 = INSTANTIATED | INITIALIZATION | STEP | TERMINATED | ERROR;
const NEVER: u8 = 0;

macro_rules! table {
    ($($function:ident: $states:expr,)*) => {
        /// The functions that take an instance.
        #[allow(missing_docs, reason = "the names are those of the standard")]
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum Function {
            $($function,)*
        }

        impl Function {
            /// All functions that take an instance.
            pub const ALL: &[Self] = &[$(Self::$function,)*];

            /// The states in which the function may be called, as a set of bits.
            const fn states(self) -> u8 {
                match self {
                    $(Self::$function => $states,)*
                }
            }

            /// The name in the standard.
            pub fn name(self) -> &'static str {
                match self {
                    $(Self::$function => concat!("fmi2", stringify!($function)),)*
                }
            }
        }
    };
}

table! {
    SetDebugLogging:           ALWAYS,
    FreeInstance:              ALWAYS,
    SetupExperiment:           INSTANTIATED,
    EnterInitializationMode:   INSTANTIATED,
    ExitInitializationMode:    INITIALIZATION,
    // After an error the standard knows only reset and free; importers terminate all the same, and that is harmless.
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
    // A step is never in progress when a call comes in.
    CancelStep:                NEVER,
    GetStatus:                 STEP | TERMINATED | ERROR,
    GetRealStatus:             STEP | TERMINATED | ERROR,
    GetIntegerStatus:          STEP | TERMINATED | ERROR,
    GetBooleanStatus:          STEP | TERMINATED | ERROR,
    GetStringStatus:           STEP | TERMINATED | ERROR,
}

impl Function {
    /// Whether the function may be called in that state.
    pub fn allowed_in(self, state: State) -> bool {
        self.states() & state as u8 != 0
    }

    /// The states in which the function may be called, in words.
    pub fn where_allowed(self) -> String {
        let states: Vec<_> = State::ALL.iter().filter(|state| self.allowed_in(**state)).map(State::to_string).collect();
        if states.is_empty() { "no state that occurs here".into() } else { states.join(", ") }
    }
}
