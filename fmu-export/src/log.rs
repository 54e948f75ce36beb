//! Messages of a model.

use std::fmt;

/// Topic of a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Topic {
    /// An event that a user may want to follow: an update, the end of a start-up phase.
    Event,
    /// A linear system could not be solved.
    SingularLinearSystem,
    /// Something unusual that does not end the run.
    Warning,
}

/// Receives the messages of a model.
pub trait Log {
    /// Whether messages on this topic are wanted; called before one is composed.
    fn wants(&self, topic: Topic) -> bool;
    /// Receives one message.
    fn message(&mut self, topic: Topic, message: fmt::Arguments<'_>);
}

/// Discards all messages.
#[derive(Clone, Copy, Debug, Default)]
pub struct Silent;

impl Log for Silent {
    fn wants(&self, _: Topic) -> bool {
        false
    }

    fn message(&mut self, _: Topic, _: fmt::Arguments<'_>) {}
}

/// A number for messages: N significant digits, without trailing zeros.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Digits<const N: usize>(pub f64);

impl<const N: usize> fmt::Display for Digits<N> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let rounded = format!("{:.*e}", N.saturating_sub(1), self.0).parse().unwrap_or(self.0);
        // Scientific notation where it is shorter.
        write!(f, "{rounded:?}")
    }
}
