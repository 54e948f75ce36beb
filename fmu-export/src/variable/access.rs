//! Access to the value of a variable within the values of a model.

use super::{Row, Value};

/// Access to a value in the structure `D`; the index is that of an array element. Made by [`place!`](crate::place).
pub struct Access<D, T: ?Sized> {
    /// The element with that index.
    pub at: fn(&D, usize) -> &T,
    /// The element with that index, to write.
    pub at_mut: fn(&mut D, usize) -> &mut T,
}

/// A field of type f64, i32, bool, String, or of a Rust enum.
#[doc(hidden)]
pub trait Slot: 'static {
    fn get(&self) -> Value;
    /// Writes it; `false` if the value has another type. Numbers without an item have been refused before.
    fn set(&mut self, value: Value) -> bool;
    /// The row of a variable of that name with this start value.
    fn row(&self, name: String) -> Row<()>;
    /// A Real number: a fast path, since importers read and write many at every step.
    fn real(&self) -> Option<&f64> {
        None
    }
    /// As `real`, to write.
    fn real_mut(&mut self) -> Option<&mut f64> {
        None
    }
}

/// Access to a value of any type.
pub(crate) enum Place<D> {
    Real(Access<D, f64>),
    Integer(Access<D, i32>),
    Boolean(Access<D, bool>),
    String(Access<D, String>),
    /// By index among all variables of a structure with [`derive@crate::Variables`].
    Field(Access<D, dyn Slot>),
    /// The time, kept by the instance.
    Time,
}

impl<D> Place<D> {
    /// The value with an index; none for the time.
    pub fn at<'d>(&self, values: &'d D, index: usize) -> Option<&'d dyn Slot> {
        Some(match self {
            Self::Real(place) => (place.at)(values, index),
            Self::Integer(place) => (place.at)(values, index),
            Self::Boolean(place) => (place.at)(values, index),
            Self::String(place) => (place.at)(values, index),
            Self::Field(place) => (place.at)(values, index),
            Self::Time => return None,
        })
    }

    /// As `at`, to write.
    pub fn at_mut<'d>(&self, values: &'d mut D, index: usize) -> Option<&'d mut dyn Slot> {
        Some(match self {
            Self::Real(place) => (place.at_mut)(values, index),
            Self::Integer(place) => (place.at_mut)(values, index),
            Self::Boolean(place) => (place.at_mut)(values, index),
            Self::String(place) => (place.at_mut)(values, index),
            Self::Field(place) => (place.at_mut)(values, index),
            Self::Time => return None,
        })
    }
}

/// Makes an [`Access`](crate::variable::Access) from a type and the path of one of its fields; `[k]` at the end denotes the
/// element of an array.
///
/// ```
/// # use fmu_export::{place, variable::Access};
/// struct Sensor { gain: f64 }
/// struct Values { sensor: Sensor, current: [f64; 3] }
/// let gain: Access<Values, f64> = place!(Values.sensor.gain);
/// let current: Access<Values, f64> = place!(Values.current[k]);
/// ```
#[macro_export]
macro_rules! place {
    ($values:ident . $($field:ident).+) => {
        $crate::variable::Access {
            at: |values: &$values, _| &values.$($field).+,
            at_mut: |values: &mut $values, _| &mut values.$($field).+,
        }
    };
    ($values:ident . $($field:ident).+ [$index:ident]) => {
        $crate::variable::Access {
            at: |values: &$values, $index| &values.$($field).+[$index],
            at_mut: |values: &mut $values, $index| &mut values.$($field).+[$index],
        }
    };
}
