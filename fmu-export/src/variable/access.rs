//! Access to the value of a variable within the values of a model.

/// Access to a value in the structure `D`; the index is that of an array element. Made by [`place!`](crate::place).
pub struct Access<D, T> {
    /// Reads the element with that index.
    pub get: fn(&D, usize) -> T,
    /// Writes the element with that index.
    pub set: fn(&mut D, usize, T),
}

impl<D, T> Clone for Access<D, T> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<D, T> Copy for Access<D, T> {}

/// Access to a value of any type.
#[doc(hidden)]
pub enum Place<D> {
    Real(Access<D, f64>),
    Integer(Access<D, i32>),
    Boolean(Access<D, bool>),
    String(Access<D, String>),
}

impl<D> Clone for Place<D> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<D> Copy for Place<D> {}

/// Makes an [`Access`](crate::variable::Access) from a type and the path of one of its fields; `[k]` at the end stands for the
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
            get: |values: &$values, _| values.$($field).+.clone(),
            set: |values: &mut $values, _, value| values.$($field).+ = value,
        }
    };
    ($values:ident . $($field:ident).+ [$index:ident]) => {
        $crate::variable::Access {
            get: |values: &$values, $index| values.$($field).+[$index].clone(),
            set: |values: &mut $values, $index, value| values.$($field).+[$index] = value,
        }
    };
}
