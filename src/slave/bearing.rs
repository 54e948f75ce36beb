//! Rows that several slaves of this project have in common.

use super::unit::{HENRY, KILOGRAM, LAMBDA, METRE, OHM, RADIAN, SECOND, VOLT};
use super::variable::{Access, Enumeration, Row};
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

/// What drives the coils.
pub static DRIVE: Enumeration = Enumeration {
    name: "Drive",
    description: "What drives the coils",
    items: &[("current", "Currents, held over the step"), ("voltage", "Voltages of amplifiers, held over the step")],
    renamed: &[],
};

/// Drive, resistance, leakage and limit of the voltage of the coils.
pub(super) fn coils<D>(
    drive: Access<D, i32>,
    resistance: Access<D, f64>,
    leakage: Access<D, f64>,
    limit: Access<D, f64>,
) -> impl Iterator<Item = Row<D>> {
    [
        Row::choice("drive", drive, &DRIVE, 1).says("What drives the coils"),
        Row::real("coil.R", resistance, OHM, 1.0).min(0.0).says("Resistance of each coil, with drive = voltage"),
        Row::real("coil.Lleak", leakage, HENRY, 0.0)
            .min(0.0)
            .nominal(1e-3)
            .says("Leakage inductance of each coil, beside the 2 lambda/gap of its magnet, with drive = voltage"),
        Row::real("coil.uMax", limit, VOLT, 100.0)
            .min(0.0)
            .nominal(100.0)
            .says("Voltage limit of the amplifiers, either way, with drive = voltage"),
    ]
    .into_iter()
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
