//! Messages to the importer.

use std::ffi::{CStr, CString, c_void};
use std::fmt;

use super::{Interface, Message};
use crate::log::{Log, Topic};

/// A log category, as declared in the model description.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Category {
    /// Events in the model.
    Events,
    /// A linear system could not be solved.
    SingularLinearSystems,
    /// Messages with a warning.
    StatusWarning,
    /// Messages with an error.
    StatusError,
    /// Messages with a fatal error.
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

    /// Description of the category; `prefix` begins the names of statuses.
    pub fn description(self, prefix: &str) -> String {
        match self {
            Self::Events => "Events in the model".into(),
            Self::SingularLinearSystems => "Linear systems that could not be solved".into(),
            Self::StatusWarning => format!("Messages with {prefix}Warning"),
            Self::StatusError => format!("Messages with {prefix}Error; passed on even while logging is off"),
            Self::StatusFatal => format!("Messages with {prefix}Fatal; passed on even while logging is off"),
            Self::All => "All messages".into(),
        }
    }

    fn bit(self) -> u8 {
        1 << self as u8
    }
}

/// Passes messages to the importer's callback, if it wants them.
pub(crate) struct Logger<I: Interface> {
    instance: CString,
    callback: Option<I::Callback>,
    environment: *mut c_void,
    /// Categories switched on.
    wanted: u8,
    /// Categories switched off by name.
    unwanted: u8,
}

impl<I: Interface> Logger<I> {
    /// A logger for one instance, with all categories on or off.
    pub(crate) fn new(instance: &CStr, callback: Option<I::Callback>, environment: *mut c_void, on: bool) -> Self {
        Self {
            instance: instance.to_owned(),
            callback,
            environment,
            wanted: if on { Category::All.bit() } else { 0 },
            unwanted: 0,
        }
    }

    /// Switches categories on or off; an empty list means all of them.
    ///
    /// # Errors
    /// The name that is not a category; nothing is switched then.
    pub(crate) fn switch<'n>(&mut self, on: bool, names: &[&'n CStr]) -> Result<(), &'n CStr> {
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
                // All except these remain on.
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
        // Errors are sent even with logging off, unless switched off by name: otherwise the reason for the end of a simulation
        // would be lost.
        let serious = matches!(category, Category::StatusError | Category::StatusFatal);
        self.wanted & (Category::All.bit() | category.bit()) != 0 || serious && self.unwanted & category.bit() == 0
    }

    /// Sends one message.
    pub(crate) fn send(&self, status: I::Status, category: Category, message: fmt::Arguments<'_>) {
        let Some(callback) = self.callback.filter(|_| self.passes(category)) else { return };
        // A text from the importer contains a zero byte only if damaged; a blank keeps the remainder readable.
        let text = message.to_string().replace('\0', " ");
        let Ok(text) = CString::new(text) else { return };
        let message = Message { instance: &self.instance, status, category: category.name(), text: &text };
        // SAFETY: the importer provided callback and environment for this instance and keeps them valid until it is freed.
        unsafe { I::send(callback, self.environment, message) }
    }
}

impl<I: Interface> Log for Logger<I> {
    fn wants(&self, topic: Topic) -> bool {
        self.callback.is_some() && self.passes(category_of::<I>(topic).0)
    }

    fn message(&mut self, topic: Topic, message: fmt::Arguments<'_>) {
        let (category, status) = category_of::<I>(topic);
        self.send(status, category, message);
    }
}

fn category_of<I: Interface>(topic: Topic) -> (Category, I::Status) {
    match topic {
        Topic::Event => (Category::Events, I::OK),
        Topic::SingularLinearSystem => (Category::SingularLinearSystems, I::OK),
        Topic::Warning => (Category::StatusWarning, I::WARNING),
    }
}
