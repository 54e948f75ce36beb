//! Invalid parameters, and a collector for them.

use std::borrow::Cow;
use std::fmt;

pub use crate::variables::Invalid;
use crate::variables::{Variables, outside};

/// A computed number in a message, with at most five significant digits.
pub struct Short(pub f64);

impl fmt::Display for Short {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let rounded: f64 = format!("{:.4e}", self.0).parse().unwrap_or(self.0);
        let size = rounded.abs();
        if size != 0.0 && !(1e-3..1e6).contains(&size) { write!(f, "{rounded:e}") } else { write!(f, "{rounded}") }
    }
}

/// An input that is not finite.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("the input {name} is not finite: {value}")]
pub struct NotFinite {
    /// Name in the interface.
    pub name: String,
    /// Value.
    pub value: f64,
}

impl NotFinite {
    /// Rejects inputs that are not finite.
    pub(crate) fn check(names: &dyn Fn() -> Vec<String>, values: &[f64]) -> Result<(), Self> {
        match values.iter().position(|value| !value.is_finite()) {
            Some(at) => Err(Self { name: names().swap_remove(at), value: values[at] }),
            None => Ok(()),
        }
    }
}

/// Whether all these numbers are finite.
pub(crate) fn are_finite(numbers: &[&[f64]]) -> bool {
    numbers.iter().all(|numbers| numbers.iter().all(|number| number.is_finite()))
}

/// A name or an expectation in a finding.
type Text = Cow<'static, str>;

/// Collects all findings, so that the user sees them at once: [`Checks::all`].
#[derive(Debug, Default)]
pub struct Checks {
    found: Vec<Invalid>,
}

impl Checks {
    /// Adds a finding unless `holds`.
    pub fn require(&mut self, holds: bool, name: impl Into<Text>, value: impl fmt::Display, wanted: impl Into<Text>) {
        if !holds {
            self.found.push(Invalid { name: name.into(), value: value.to_string(), wanted: wanted.into() });
        }
    }

    /// The same for a number with its unit.
    pub fn number(&mut self, holds: bool, name: impl Into<Text>, (value, unit): (f64, &str), wanted: impl Into<Text>) {
        self.require(holds, name, format_args!("{value} {unit}"), wanted);
    }

    /// Runs `check` and prepends `prefix`, for instance `A.`, to the names in its findings.
    pub fn of<T>(&mut self, prefix: &str, check: impl FnOnce(&mut Self) -> T) -> T {
        let before = self.found.len();
        let checked = check(self);
        for finding in &mut self.found[before..] {
            finding.name = format!("{prefix}{}", finding.name).into();
        }
        checked
    }

    /// Checks that the described variables of a structure are finite and within their limits, then runs `make` with its own checks.
    ///
    /// # Errors
    /// All variables outside their limits, or else all findings of `make`, in order.
    pub fn described<V: Variables, T>(
        of: &V,
        context: &V::Context,
        make: impl FnOnce(&mut Self) -> T,
    ) -> Result<T, Vec<Invalid>> {
        let found = outside(of, context);
        if found.is_empty() { Self::all(make) } else { Err(found) }
    }

    /// Runs `make`, which builds a value and checks its parameters.
    ///
    /// # Errors
    /// All findings, in order.
    pub fn all<T>(make: impl FnOnce(&mut Self) -> T) -> Result<T, Vec<Invalid>> {
        let mut checks = Self::default();
        let made = make(&mut checks);
        if checks.found.is_empty() { Ok(made) } else { Err(checks.found) }
    }
}
