//! States of an instance, and tables of the functions that may be called in them.

/// States of an instance. The standards' states of a pending, cancelled or discarded step do not occur: a step is completed
/// within its call or fails.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum State {
    /// After the instantiation or a reset.
    Instantiated = 0b00_0001,
    /// During initialization.
    InitializationMode = 0b00_0010,
    /// Between steps.
    StepMode = 0b00_0100,
    /// After the end of the run.
    Terminated = 0b00_1000,
    /// After an error that ended the run.
    Error = 0b01_0000,
    /// At an event between steps; in FMI 3.0 only.
    EventMode = 0b10_0000,
}

impl State {
    /// All states.
    pub const ALL: [Self; 6] =
        [Self::Instantiated, Self::InitializationMode, Self::StepMode, Self::Terminated, Self::Error, Self::EventMode];
}

pub(crate) const INSTANTIATED: u8 = State::Instantiated as u8;
pub(crate) const INITIALIZATION: u8 = State::InitializationMode as u8;
pub(crate) const STEP: u8 = State::StepMode as u8;
pub(crate) const TERMINATED: u8 = State::Terminated as u8;
pub(crate) const ERROR: u8 = State::Error as u8;
pub(crate) const EVENT: u8 = State::EventMode as u8;
pub(crate) const ALWAYS: u8 = u8::MAX;
/// States in which values may be read.
pub(crate) const READ: u8 = INITIALIZATION | EVENT | STEP | TERMINATED | ERROR;
/// States in which values may be written.
pub(crate) const WRITE: u8 = INSTANTIATED | INITIALIZATION | EVENT | STEP;
/// States in which the results of the last step may be read.
pub(crate) const RESULT: u8 = EVENT | STEP | TERMINATED | ERROR;
#[cfg(feature = "fmi2")]
pub(crate) const NEVER: u8 = 0;

/// A function that takes an instance.
pub(crate) trait Rule: Copy {
    /// The standard that it belongs to.
    type Standard: super::Interface<Function = Self>;
    /// The name in the standard.
    fn name(self) -> &'static str;
    /// The states in which it may be called, as a set of bits.
    fn states(self) -> u8;
}

/// Defines the functions of a standard that take an instance, with the states in which each may be called.
macro_rules! call_table {
    ($standard:ty, $prefix:literal; $($function:ident: $states:expr,)*) => {
        /// The functions that take an instance.
        #[allow(missing_docs, reason = "the names are those of the standard")]
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum Function {
            $($function,)*
        }

        impl Function {
            /// All functions that take an instance.
            pub const ALL: &[Self] = &[$(Self::$function,)*];

            /// The name in the standard.
            pub fn name(self) -> &'static str {
                match self {
                    $(Self::$function => concat!($prefix, stringify!($function)),)*
                }
            }
        }

        impl Rule for Function {
            type Standard = $standard;

            fn name(self) -> &'static str {
                self.name()
            }

            fn states(self) -> u8 {
                match self {
                    $(Self::$function => $states,)*
                }
            }
        }
    };
}
pub(crate) use call_table;
