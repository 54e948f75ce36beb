//! What is wrong with a parameter, and a collector of such findings.

use std::borrow::Cow;
use std::fmt;

/// One parameter that cannot be accepted.
#[derive(Clone, Debug, PartialEq)]
pub struct Invalid {
    /// Name of the parameter as in the interface, for instance `coil.R` or `alpha[2]`.
    pub name: Cow<'static, str>,
    /// The value refused, as text, with its unit where it has one.
    pub value: String,
    /// What would have been accepted, with the reason where it is not obvious.
    pub wanted: Cow<'static, str>,
}

impl fmt::Display for Invalid {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} = {} is refused: {} is wanted", self.name, self.value, self.wanted)
    }
}

/// Collects every finding, so that a user sees all of them at once.
#[derive(Debug, Default)]
pub struct Checks {
    found: Vec<Invalid>,
}

impl Checks {
    /// Notes a finding unless `holds`.
    pub fn require(
        &mut self,
        holds: bool,
        name: impl Into<Cow<'static, str>>,
        value: impl fmt::Display,
        wanted: impl Into<Cow<'static, str>>,
    ) {
        if !holds {
            self.found.push(Invalid { name: name.into(), value: value.to_string(), wanted: wanted.into() });
        }
    }

    /// Requires a finite number above zero.
    pub fn positive(&mut self, name: impl Into<Cow<'static, str>>, value: f64, unit: &'static str) {
        self.require(value.is_finite() && value > 0.0, name, format_args!("{value} {unit}"), "a finite number above 0");
    }

    /// Requires a finite number that is not negative.
    pub fn not_negative(&mut self, name: impl Into<Cow<'static, str>>, value: f64, unit: &'static str) {
        self.require(
            value.is_finite() && value >= 0.0,
            name,
            format_args!("{value} {unit}"),
            "a finite number, 0 or above",
        );
    }

    /// Requires a finite number.
    pub fn finite(&mut self, name: impl Into<Cow<'static, str>>, value: f64, unit: &'static str) {
        self.require(value.is_finite(), name, format_args!("{value} {unit}"), "a finite number");
    }

    /// The end of the checks.
    ///
    /// # Errors
    /// All findings, in the order in which they were noted.
    pub fn finish(self) -> Result<(), Vec<Invalid>> {
        if self.found.is_empty() { Ok(()) } else { Err(self.found) }
    }
}
