//! Descriptions of variables: name, unit, limits and meaning, next to the field.
//!
//! `#[derive(Variables)]` builds them from the attributes and doc comments of a structure's fields, `#[derive(Choice)]` from those of
//! an enum's items; see the documentation of fmu-export. Both are independent of FMI, so that the equations can use them; `fmu`
//! turns them into tables of variables.

use serde::Serialize;
use serde::de::DeserializeOwned;

pub use fmu_export::unit;
pub use fmu_export::unit::{Display, Unit};
pub use fmu_export::{Array, Choice, Invalid, Variables, is_finite};

/// Force constant λ of a magnet.
pub const LAMBDA: Unit =
    Unit::new("N.m2/A2", &[("kg", 1), ("m", 3), ("s", -2), ("A", -2)], &[Display::new("N.mm2/A2", 1e6)]);

/// Unbalance: mass times eccentricity.
pub const KILOGRAM_METRE: Unit = Unit::new("kg.m", &[("kg", 1), ("m", 1)], &[Display::new("g.mm", 1e6)]);

/// Speed of the paper's experiments, 3000 rpm.
pub const OMEGA_RAD_S: f64 = 100.0 * std::f64::consts::PI;

/// Name, value and unit of the described numbers of a structure; `prefix` precedes all names.
pub fn numbers<V: Variables>(prefix: &str, of: &V, context: &V::Context) -> Vec<(String, f64, &'static str)> {
    let rows = of.rows_of(context);
    let number =
        rows.iter().filter_map(|row| Some((format!("{prefix}{}", row.variable.name), row.number(of)?, row.unit()?)));
    number.map(|(name, value, unit)| (name, value, if unit == unit::ONE { "" } else { unit.name })).collect()
}

/// The described variables of a structure that are not finite or outside their limits.
pub fn outside<V: Variables>(of: &V, context: &V::Context) -> Vec<Invalid> {
    let rows = of.rows_of(context).into_iter();
    rows.filter_map(|row| row.variable.accepts(&row.value(of)?).err()).collect()
}

/// Values that serde can write and read. For arrays of generic length this must be stated: `#[serde(bound = "[f64; N]: Saved")]`.
pub trait Saved: Serialize + DeserializeOwned {}

impl<T: Serialize + DeserializeOwned> Saved for T {}
