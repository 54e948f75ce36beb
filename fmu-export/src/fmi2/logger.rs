//! Messages to the importer.

use std::ffi::{CStr, CString};
use std::fmt;

use super::bindings::{fmi2CallbackFunctions, fmi2CallbackLogger, fmi2ComponentEnvironment, fmi2Status};
use crate::log::{Log, Topic};

/// A category of messages, as the model description declares it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Category {
    /// What happens in the model.
    Events,
    /// A linear system could not be solved.
    SingularLinearSystems,
    /// Messages with fmi2Warning.
    StatusWarning,
    /// Messages with fmi2Error.
    StatusError,
    /// Messages with fmi2Fatal.
    StatusFatal,
    /// All messages.
    All,
}

impl Category {
    /// All categories, in the order of the model description.
    pub const ALL: [Self; 6] = [
        Self::Events,
        Self::SingularLinearSystems,
        Self::StatusWarning,
        Self::StatusError,
        Self::StatusFatal,
        Self::All,
    ];

    /// The name in the standard.
    pub fn name(self) -> &'static CStr {
        match self {
            Self::Events => c"logEvents",
            Self::SingularLinearSystems => c"logSingularLinearSystems",
            Self::StatusWarning => c"logStatusWarning",
            Self::StatusError => c"logStatusError",
            Self::StatusFatal => c"logStatusFatal",
            Self::All => c"logAll",
        }
    }

    /// What the category holds.
    pub fn description(self) -> &'static str {
        match self {
            Self::Events => "What happens in the model",
            Self::SingularLinearSystems => "Linear systems that could not be solved",
            Self::StatusWarning => "Messages with fmi2Warning",
            Self::StatusError => "Messages with fmi2Error; passed on even while logging is off",
            Self::StatusFatal => "Messages with fmi2Fatal; passed on even while logging is off",
            Self::All => "All messages",
        }
    }

    fn bit(self) -> u8 {
        1 << self as u8
    }
}

/// Hands messages to the importer's callback, if it wants them.
pub(super) struct Logger {
    instance: CString,
    callback: fmi2CallbackLogger,
    environment: fmi2ComponentEnvironment,
    /// Categories that were switched on.
    wanted: u8,
    /// Categories that were switched off by their names.
    unwanted: u8,
}

impl Logger {
    /// A logger for one instance. All categories are on when `on` is true, none otherwise.
    pub(super) fn new(instance: CString, callbacks: &fmi2CallbackFunctions, on: bool) -> Self {
        Self {
            instance,
            callback: callbacks.logger,
            environment: callbacks.componentEnvironment,
            wanted: if on { Category::All.bit() } else { 0 },
            unwanted: 0,
        }
    }

    /// Switches categories on or off; an empty list stands for all of them.
    ///
    /// # Errors
    /// The name that is no category; nothing is switched then.
    pub(super) fn switch<'n>(&mut self, on: bool, names: &[&'n CStr]) -> Result<(), &'n CStr> {
        let mut bits = 0;
        for name in names {
            let category = Category::ALL.into_iter().find(|category| category.name() == *name).ok_or(*name)?;
            bits |= category.bit();
        }
        match (on, names.is_empty() || bits & Category::All.bit() != 0) {
            (true, true) => (self.wanted, self.unwanted) = (Category::All.bit(), 0),
            (true, false) => (self.wanted, self.unwanted) = (self.wanted | bits, self.unwanted & !bits),
            (false, true) => self.wanted = 0,
            (false, false) => {
                // What was switched on as a whole goes on without these.
                if self.wanted & Category::All.bit() != 0 {
                    self.wanted = Category::ALL.into_iter().fold(0, |all, category| all | category.bit());
                    self.wanted &= !Category::All.bit();
                }
                self.wanted &= !bits;
                self.unwanted |= bits;
            }
        }
        Ok(())
    }

    fn passes(&self, category: Category) -> bool {
        // Errors are passed on while logging is off, and kept back only if they were switched off by name: without them
        // nobody could tell why a simulation ended.
        let serious = matches!(category, Category::StatusError | Category::StatusFatal);
        self.wanted & (Category::All.bit() | category.bit()) != 0 || serious && self.unwanted & category.bit() == 0
    }

    /// Sends one message.
    pub(super) fn send(&self, status: fmi2Status, category: Category, message: fmt::Arguments<'_>) {
        let Some(callback) = self.callback.filter(|_| self.passes(category)) else { return };
        // A text from the importer may hold a zero byte only after damage; a blank keeps the rest readable.
        let text = message.to_string().replace('\0', " ");
        let Ok(text) = CString::new(text) else { return };
        // SAFETY: the callback and the environment are those that the importer handed over for this instance and keeps
        // valid until it is freed; all texts end with a zero byte and live until the call returns; the format `%s`
        // consumes exactly the one argument that follows it.
        unsafe {
            callback(
                self.environment,
                self.instance.as_ptr(),
                status,
                category.name().as_ptr(),
                c"%s".as_ptr(),
                text.as_ptr(),
            );
        }
    }
}

impl Log for Logger {
    fn wants(&self, topic: Topic) -> bool {
        self.callback.is_some() && self.passes(category_of(topic).0)
    }

    fn message(&mut self, topic: Topic, message: fmt::Arguments<'_>) {
        let (category, status) = category_of(topic);
        self.send(status, category, message);
    }
}

fn category_of(topic: Topic) -> (Category, fmi2Status) {
    match topic {
        Topic::Event => (Category::Events, fmi2Status::fmi2OK),
        Topic::SingularLinearSystem => (Category::SingularLinearSystems, fmi2Status::fmi2OK),
        Topic::Warning => (Category::StatusWarning, fmi2Status::fmi2Warning),
    }
}
