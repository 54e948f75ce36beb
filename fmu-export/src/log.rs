//! Messages of a model.

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

/// Takes the messages of a model.
pub trait Log {
    /// Whether anybody wants messages on this topic; asked before one is composed.
    fn wants(&self, topic: Topic) -> bool;
    /// Takes one message.
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

/// A number in a message: N significant digits, without trailing zeros.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Digits<const N: usize>(pub f64);

impl<const N: usize> fmt::Display for Digits<N> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let rounded = format!("{:.*e}", N.saturating_sub(1), self.0).parse().unwrap_or(self.0);
        // Scientific where it is shorter.
        write!(f, "{rounded:?}")
    }
}

#[cfg(test)]
mod tests {
    use super::Digits;

    #[test]
    fn digits_that_rounding_made_are_not_shown() {
        assert_eq!(Digits::<9>(0.036_000_000_000_000_004).to_string(), "0.036");
        assert_eq!(Digits::<9>(0.3).to_string(), "0.3");
        assert_eq!(Digits::<9>(0.0).to_string(), "0.0");
        assert_eq!(Digits::<6>(1.728_129_002_747_755e-6).to_string(), "1.72813e-6");
        assert_eq!(Digits::<6>(f64::NAN).to_string(), "NaN");
    }
}
