//! What a slave has to say, and to whom it says it.

use std::fmt;

/// What a message is about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Topic {
    /// Something happened that a user may want to follow: an update, the end of a start-up phase.
    Event,
    /// A linear system could not be solved.
    SingularLinearSystem,
    /// Something is unusual, and the run goes on.
    Warning,
}

/// Takes the messages of a slave.
pub trait Log {
    /// Whether anybody listens to this topic; asked before a message is put together.
    fn wants(&self, topic: Topic) -> bool;
    /// Takes one message.
    fn say(&mut self, topic: Topic, message: fmt::Arguments<'_>);
}

/// Listens to nothing.
#[derive(Clone, Copy, Debug, Default)]
pub struct Silent;

impl Log for Silent {
    fn wants(&self, _: Topic) -> bool {
        false
    }

    fn say(&mut self, _: Topic, _: fmt::Arguments<'_>) {}
}
