//! Variables as importers see them, and the table of a model: [`Row`]s, with [`Access`] to the values.

mod access;
mod enumeration;
mod row;
mod table;

use std::borrow::Cow;
use std::fmt::Display;

use crate::model::Invalid;
use crate::unit::Unit;

pub use access::Access;
#[doc(hidden)]
pub use access::Slot;
pub use enumeration::Enumeration;
pub use row::{Row, element};
pub use table::Table;

/// Role of a variable.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Causality {
    /// Set before the run; during it only if [`Variability::Tunable`].
    Parameter,
    /// Set by the importer at any time.
    Input,
    /// Computed, to be connected.
    Output,
    /// Computed, to be observed.
    Local,
    /// Computed from parameters.
    CalculatedParameter,
    /// The time.
    Independent,
}

/// When a variable may change.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Variability {
    /// Never.
    Constant,
    /// Never after initialization.
    Fixed,
    /// Between two steps.
    Tunable,
    /// At sample instants or events.
    Discrete,
    /// At any time.
    Continuous,
}

/// How an unknown depends on a known.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Dependency {
    /// In any way.
    Any,
    /// Linearly, with a constant factor.
    Constant,
    /// Linearly, with a factor that depends on fixed parameters only.
    Fixed,
}

/// Type of a variable, with its attributes and start value.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Type {
    /// A real number in SI units.
    Real {
        /// Start value in `unit`.
        start: f64,
        /// Its unit.
        unit: Unit,
        /// Name of the default display unit; its unit if there is none.
        display: Option<&'static str>,
        /// Typical magnitude.
        nominal: f64,
        /// Smallest value accepted.
        min: Option<f64>,
        /// Largest value accepted.
        max: Option<f64>,
    },
    /// A whole number.
    Integer {
        /// Start value.
        start: i32,
        /// Smallest value accepted.
        min: Option<i32>,
        /// Largest value accepted.
        max: Option<i32>,
    },
    /// True or false.
    Boolean {
        /// Start value.
        start: bool,
    },
    /// One of several named items.
    Enumeration {
        /// Start value.
        start: i32,
        /// The items.
        items: &'static Enumeration,
    },
    /// A text.
    String {
        /// Start value.
        start: Cow<'static, str>,
    },
}

impl Type {
    /// A real number without limits.
    pub(crate) fn real(start: f64, unit: Unit) -> Self {
        Self::Real { start, unit, display: None, nominal: 1.0, min: None, max: None }
    }

    /// A whole number without limits.
    pub(crate) fn integer(start: i32) -> Self {
        Self::Integer { start, min: None, max: None }
    }
}

/// A value of any type; enumerations are integers.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Value {
    /// Of a [`Type::Real`].
    Real(f64),
    /// Of a [`Type::Integer`] or [`Type::Enumeration`].
    Integer(i32),
    /// Of a [`Type::Boolean`].
    Boolean(bool),
    /// Of a [`Type::String`].
    String(String),
}

impl Value {
    /// The value as a number for recordings; false and true are 0 and 1, a string is NaN.
    pub fn as_f64(self) -> f64 {
        match self {
            Value::Real(value) => value,
            Value::Integer(value) => f64::from(value),
            Value::Boolean(value) => f64::from(u8::from(value)),
            Value::String(_) => f64::NAN,
        }
    }

    /// The name of its type, for messages.
    pub fn type_name(&self) -> &'static str {
        match self {
            Value::Real(_) => "Real",
            Value::Integer(_) => "Integer",
            Value::Boolean(_) => "Boolean",
            Value::String(_) => "String",
        }
    }
}

macro_rules! values {
    ($($data_type:ty: $kind:ident),*) => {$(
        impl From<$data_type> for Value {
            fn from(value: $data_type) -> Self {
                Self::$kind(value)
            }
        }

        impl TryFrom<Value> for $data_type {
            type Error = Value;

            fn try_from(value: Value) -> Result<Self, Value> {
                if let Value::$kind(value) = value { Ok(value) } else { Err(value) }
            }
        }
    )*};
}

values!(f64: Real, i32: Integer, bool: Boolean, String: String);

/// Description of a variable, independent of the model.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Variable {
    /// Name in structured naming convention, for instance `coil.R` or `lambda[1]`.
    pub name: Cow<'static, str>,
    /// Description, as a phrase without a full stop.
    pub description: Cow<'static, str>,
    /// Its role.
    pub causality: Causality,
    /// When it may change.
    pub variability: Variability,
    /// Type, start value, unit and limits.
    pub data_type: Type,
    /// Whether the smallest value of a Real is itself refused.
    pub excludes_min: bool,
    /// Whether an output or local variable starts from its start value, which importers may set before the run.
    pub exact: bool,
    /// Whether it is a continuous state, which is integrated.
    pub state: bool,
    /// For the derivative of a state: the name of the state.
    pub derivative_of: Option<Cow<'static, str>>,
    /// For outputs and derivatives: the inputs and states with direct feedthrough to it, by name; `None` means all of them.
    pub depends_on: Option<Vec<(Cow<'static, str>, Dependency)>>,
    /// For variables computed at the start: the parameters and inputs that they depend on then, by name; `None` means all of
    /// them.
    pub starts_from: Option<Vec<Cow<'static, str>>>,
    /// Whether its field can hold only numbers of items.
    pub(crate) items_only: bool,
}

impl Variable {
    /// A local variable without a description.
    pub(crate) fn local(name: Cow<'static, str>, data_type: Type) -> Self {
        let is_real = matches!(data_type, Type::Real { .. });
        Self {
            name,
            description: Cow::Borrowed(""),
            causality: Causality::Local,
            variability: if is_real { Variability::Continuous } else { Variability::Discrete },
            data_type,
            excludes_min: false,
            exact: false,
            state: false,
            derivative_of: None,
            depends_on: None,
            starts_from: None,
            items_only: false,
        }
    }

    /// The start value.
    pub fn start(&self) -> Value {
        match &self.data_type {
            Type::Real { start, .. } => Value::Real(*start),
            Type::Integer { start, .. } | Type::Enumeration { start, .. } => Value::Integer(*start),
            Type::Boolean { start } => Value::Boolean(*start),
            Type::String { start } => Value::String(start.to_string()),
        }
    }

    /// The name of the unit; empty if there is none.
    pub fn unit_name(&self) -> &'static str {
        match &self.data_type {
            Type::Real { unit, .. } => unit.name,
            _ => "",
        }
    }

    /// Whether an importer may set it at all.
    pub fn is_settable(&self) -> bool {
        matches!(self.causality, Causality::Parameter | Causality::Input)
    }

    /// Whether it has a start value in the model description. Computed variables have none.
    pub fn has_start(&self) -> bool {
        self.is_settable() || self.exact || self.variability == Variability::Constant
    }

    /// Whether its value at the start is computed.
    pub fn is_computed(&self) -> bool {
        !self.has_start() && self.causality != Causality::Independent
    }

    /// Whether it takes values of that type.
    pub(crate) fn takes(&self, value: &Value) -> bool {
        matches!(
            (&self.data_type, value),
            (Type::Real { .. }, Value::Real(_))
                | (Type::Integer { .. } | Type::Enumeration { .. }, Value::Integer(_))
                | (Type::Boolean { .. }, Value::Boolean(_))
                | (Type::String { .. }, Value::String(_))
        )
    }

    /// Whether it may have this value: an item of its enumeration, or within its limits, which do not refuse NaN.
    ///
    /// # Errors
    /// If the value is refused, with the expected one.
    pub fn admits(&self, value: &Value) -> Result<(), Invalid> {
        if self.holds(value) { Ok(()) } else { Err(self.refusal(value)) }
    }

    /// Whether a parameter may have this value: as [`admits`](Self::admits), but numbers must be finite.
    ///
    /// # Errors
    /// If the value is refused, with the expected one.
    pub fn accepts(&self, value: &Value) -> Result<(), Invalid> {
        match value {
            Value::Real(number) if !number.is_finite() => {
                Err(Invalid::new(self.name.clone(), format!("{number}{}", self.spaced_unit()), "a finite number"))
            }
            _ => self.admits(value),
        }
    }

    /// Whether limits are checked when a value is set. Those of parameters are checked together at the start.
    pub(crate) fn is_checked_when_set(&self) -> bool {
        self.causality == Causality::Input || self.items_only
    }

    /// Whether a value is within the limits, or an item. Called for every value that is set.
    #[inline]
    pub(crate) fn holds(&self, value: &Value) -> bool {
        match (&self.data_type, value) {
            (Type::Real { min, max, .. }, Value::Real(value)) => {
                within(value, min.as_ref(), max.as_ref()) && !(self.excludes_min && *min == Some(*value))
            }
            (Type::Integer { min, max, .. }, Value::Integer(value)) => within(value, min.as_ref(), max.as_ref()),
            (Type::Enumeration { items, .. }, Value::Integer(value)) => items.item(*value).is_some(),
            _ => true,
        }
    }

    /// Refusal of a value outside the limits.
    #[cold]
    fn refusal(&self, value: &Value) -> Invalid {
        let unit = self.spaced_unit();
        match (&self.data_type, value) {
            (Type::Real { min, max, .. }, Value::Real(value)) => self.outside(*value, *min, *max, &unit),
            (Type::Integer { min, max, .. }, Value::Integer(value)) => self.outside(*value, *min, *max, &unit),
            (Type::Enumeration { items, .. }, Value::Integer(value)) => {
                Invalid::new(self.name.clone(), value, format!("one of {}", items.listed()))
            }
            (_, value) => Invalid::new(self.name.clone(), value.type_name(), "a value of its type"),
        }
    }

    /// The unit after a number.
    fn spaced_unit(&self) -> String {
        match self.unit_name() {
            "" | "1" => String::new(),
            unit => format!(" {unit}"),
        }
    }

    fn outside<T: Display>(&self, value: T, min: Option<T>, max: Option<T>, unit: &str) -> Invalid {
        let wanted = match (min, max) {
            (Some(min), Some(max)) => format!("a value from {min} to {max}{unit}"),
            (Some(min), None) if self.excludes_min => format!("a value above {min}{unit}"),
            (Some(min), None) => format!("a value of at least {min}{unit}"),
            (_, Some(max)) => format!("a value of at most {max}{unit}"),
            (None, None) => "a value of its type".into(),
        };
        Invalid::new(self.name.clone(), format!("{value}{unit}"), wanted)
    }

    /// Whether it is a Real that may change at any time.
    pub fn is_continuous(&self) -> bool {
        self.variability == Variability::Continuous && matches!(self.data_type, Type::Real { .. })
    }
}

/// Whether a value is not outside its limits; NaN, which may be a missing input, is checked elsewhere.
#[inline]
fn within<T: PartialOrd>(value: &T, min: Option<&T>, max: Option<&T>) -> bool {
    !(min.is_some_and(|min| value < min) || max.is_some_and(|max| value > max))
}
