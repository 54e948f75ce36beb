//! The parts that the C interfaces of FMI 2.0 and FMI 3.0 share.
//!
//! Every call passes one entry guard, which checks the instance and the [`sequence`] of calls, stops panics at the C boundary,
//! and logs errors. `Interface` holds the differences between the standards: statuses, functions, the logger's type.

pub mod sequence;

pub(crate) mod arguments;
pub(crate) mod component;
pub(crate) mod guard;
#[cfg(feature = "package")]
pub(crate) mod load;
pub(crate) mod logger;
pub(crate) mod snapshot;
pub(crate) mod states;

use std::ffi::{CStr, c_void};

use sequence::{Rule, State};

/// One standard, as far as the shared code depends on it.
pub(crate) trait Interface: Sized + 'static {
    /// Result of a call.
    type Status: Copy;
    /// Success.
    const OK: Self::Status;
    /// Success, with a warning.
    const WARNING: Self::Status;
    /// Failure.
    const ERROR: Self::Status;
    /// A step in which the model ended the simulation.
    const ENDED: Self::Status;

    /// The functions that take an instance, with the states in which they may be called.
    type Function: Rule;
    /// The states that occur, by the standard's names.
    const STATES: &'static [(State, &'static str)];
    /// The function that resets an instance, for messages.
    const RESET: &'static str;

    /// Further options that the importer chooses at instantiation.
    type Options;

    /// The importer's function for messages.
    type Callback: Copy;

    /// Passes a message to the importer.
    ///
    /// # Safety
    /// The importer provided callback and environment together, for an instance that still exists.
    unsafe fn send(callback: Self::Callback, environment: *mut c_void, message: Message<'_, Self::Status>);
}

/// A message to the importer.
pub(crate) struct Message<'m, S> {
    /// Name of the instance.
    #[cfg_attr(not(feature = "fmi2"), allow(dead_code, reason = "in FMI 3.0 the importer knows it"))]
    pub instance: &'m CStr,
    /// The status explained by the message.
    pub status: S,
    /// Name of the log category.
    pub category: &'m CStr,
    /// The message.
    pub text: &'m CStr,
}

/// Declares functions for C, and checks at compile time that their types are those of the bindings.
macro_rules! c_functions {
    ($(
        $(#[$attribute:meta])*
        fn $name:ident: $type:ident ($($argument:ident: $of:ty),* $(,)?) -> $result:ty $body:block
    )*) => {$(
        $(#[$attribute])*
        ///
        /// # Safety
        /// As for all functions of this module.
        pub unsafe extern "C" fn $name($($argument: $of),*) -> $result $body

        const _: $type = Some($name);
    )*};
}
pub(crate) use c_functions;
