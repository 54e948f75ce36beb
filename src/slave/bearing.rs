//! Rows that several slaves of this project have in common.

use super::unit::{KILOGRAM, LAMBDA, METRE, RADIAN, SECOND};
use super::variable::{Access, Row};
use crate::model::Invalid;

/// Rotor mass, nominal air gap and angles of the magnets, with the paper's values.
pub(super) fn geometry<D>(m: Access<D, f64>, s: Access<D, f64>, alpha: Access<D, f64>) -> impl Iterator<Item = Row<D>> {
    use std::f64::consts::{FRAC_PI_3, PI};
    [
        Row::real("m", m, KILOGRAM, 6.7).min(0.0).says("Mass of the rotor"),
        Row::real("s", s, METRE, 5e-4).min(0.0).nominal(1e-4).shown_in("mm").says("Nominal air gap"),
    ]
    .into_iter()
    .chain(
        Row::reals("alpha", alpha, RADIAN, [PI, -FRAC_PI_3, FRAC_PI_3])
            .map(|row| row.says("Angle of magnet {k}, its direction being (sin alpha, cos alpha) in the y-z plane")),
    )
    .map(Row::fixed)
}

/// First guess of the force constants.
pub(super) fn lambda0<D>(lambda0: Access<D, f64>) -> impl Iterator<Item = Row<D>> {
    Row::reals("lambda0", lambda0, LAMBDA, [4e-6; 3])
        .map(|row| row.fixed().min(0.0).nominal(1e-6).says("First guess of the force constant of magnet {k}"))
}

/// Sample time of a sampled slave.
pub(super) fn sample_time<D>(ts: Access<D, f64>) -> Row<D> {
    Row::real("Ts", ts, SECOND, 1e-4)
        .fixed()
        .min(0.0)
        .nominal(1e-4)
        .shown_in("µs")
        .says("Sample time; samples are at the start time plus whole multiples of it")
}

/// What was made, unless there were findings before or in the making.
pub(super) fn together<T>(mut findings: Vec<Invalid>, made: Result<T, Vec<Invalid>>) -> Result<T, Vec<Invalid>> {
    match made {
        Ok(made) if findings.is_empty() => Ok(made),
        Ok(_) => Err(findings),
        Err(others) => {
            findings.extend(others);
            Err(findings)
        }
    }
}

/// The names `name[1]`, `name[2]`, `name[3]`.
pub(super) fn of_magnets(name: &str) -> [String; 3] {
    std::array::from_fn(|k| super::variable::element(name, k))
}
