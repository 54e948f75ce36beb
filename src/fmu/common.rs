//! Rows shared by the models of this project.

use fmu_export::unit::{Display, HENRY, KILOGRAM, METRE, OHM, RADIAN, SECOND, Unit, VOLT};
use fmu_export::variable::{Access, Causality, Enumeration, Row, element};
use fmu_export::{Info, Invalid};

use crate::invalid;

/// Force constant λ of a magnet.
pub(super) const LAMBDA: Unit =
    Unit::new("N.m2/A2", &[("kg", 1), ("m", 3), ("s", -2), ("A", -2)], &[Display::new("N.mm2/A2", 1e6)]);
/// Unbalance, mass times eccentricity.
pub(super) const KILOGRAM_METRE: Unit = Unit::new("kg.m", &[("kg", 1), ("m", 1)], &[Display::new("g.mm", 1e6)]);

/// What the three models share: version, licence, the paper's experiment of 0.4 s in steps of 0.1 ms.
pub(super) const fn info(name: &'static str, description: &'static str) -> Info {
    Info::new(name, description)
        .version(env!("CARGO_PKG_VERSION"))
        .license(env!("CARGO_PKG_LICENSE"))
        .tool(concat!(env!("CARGO_PKG_NAME"), " ", env!("CARGO_PKG_VERSION")))
        .experiment(0.4, 1e-4)
        // The models have a fixed accuracy better than this: without noise the estimates err by less
        // (tests/app/closed_loop.rs), and the motion of the plant by far less (tests/model/plant.rs).
        .tolerance(1e-4)
}

/// Rows for the axes y and z.
pub(super) trait Axes {
    /// Sets a description in which `{axis}` stands for `y` or `z`, by the index of the row.
    fn along(self, description: &str) -> Self;
}

impl<D> Axes for Row<D> {
    fn along(self, description: &str) -> Self {
        let axis = ["y", "z"][self.index()];
        self.description(description.replace("{axis}", axis))
    }
}

/// Rotor mass, nominal air gap and angles of the magnets, with the paper's values.
pub(super) fn geometry<D>(m: Access<D, f64>, s: Access<D, f64>, alpha: Access<D, f64>) -> impl Iterator<Item = Row<D>> {
    use std::f64::consts::{FRAC_PI_3, PI};
    [
        Row::real("m", m, KILOGRAM, 6.7).min(0.0).description("Mass of the rotor"),
        Row::real("s", s, METRE, 5e-4).min(0.0).nominal(1e-4).display_unit("mm").description("Nominal air gap"),
    ]
    .into_iter()
    .chain(
        Row::reals("alpha", alpha, RADIAN, [PI, -FRAC_PI_3, FRAC_PI_3]).map(|row| {
            row.description("Angle of magnet {k}; its direction is (sin alpha, cos alpha) in the y-z plane")
        }),
    )
    .map(Row::fixed)
}

/// What drives the coils.
pub static DRIVE: Enumeration = Enumeration::new(
    "Drive",
    "What drives the coils",
    &[("current", "Currents, held over the step"), ("voltage", "Amplifier voltages, held over the step")],
);

/// Drive, resistance, leakage and limit of the voltage of the coils.
pub(super) fn coils<D>(
    drive: Access<D, i32>,
    resistance: Access<D, f64>,
    leakage: Access<D, f64>,
    limit: Access<D, f64>,
) -> impl Iterator<Item = Row<D>> {
    [
        Row::choice("drive", drive, &DRIVE, 1).description("What drives the coils"),
        Row::real("coil.R", resistance, OHM, 1.0).min(0.0).description("Resistance of each coil, with drive = voltage"),
        Row::real("coil.Lleak", leakage, HENRY, 0.0).min(0.0).nominal(1e-3).description(
            "Leakage inductance of each coil, in addition to the 2 lambda/gap of its magnet, with drive = voltage",
        ),
        Row::real("coil.uMax", limit, VOLT, 100.0)
            .min(0.0)
            .nominal(100.0)
            .description("Voltage limit of the amplifiers, both signs, with drive = voltage"),
    ]
    .into_iter()
    .map(Row::fixed)
}

/// The rows of a model as its users see them: every quantity with a display unit in the first of them.
pub(super) fn displayed<D>(rows: Vec<Row<D>>) -> Vec<Row<D>> {
    rows.into_iter().map(Row::display_in_first).collect()
}

/// As [`displayed`], for a sampled model, whose outputs at the start follow from the parameters alone.
pub(super) fn sampled<D>(rows: Vec<Row<D>>) -> Vec<Row<D>> {
    let is_output = |row: &Row<D>| row.variable.causality == Causality::Output;
    let rows = rows.into_iter().map(|row| if is_output(&row) { row.starts_from_parameters() } else { row });
    displayed(rows.collect())
}

/// First guess of the force constants.
pub(super) fn lambda0<D>(lambda0: Access<D, f64>) -> impl Iterator<Item = Row<D>> {
    Row::reals("lambda0", lambda0, LAMBDA, [4e-6; 3])
        .map(|row| row.fixed().min(0.0).nominal(1e-6).description("First guess of the force constant of magnet {k}"))
}

/// Sample time of a sampled model.
pub(super) fn sample_time<D>(ts: Access<D, f64>) -> Row<D> {
    Row::real("Ts", ts, SECOND, 1e-4)
        .fixed()
        .min(0.0)
        .nominal(1e-4)
        .display_unit("µs")
        .description("Sample time; samples are taken at the start time plus whole multiples of it")
}

/// The result, unless there are findings from before or from making it.
pub(super) fn together<T>(
    mut findings: Vec<Invalid>,
    made: Result<T, Vec<invalid::Invalid>>,
) -> Result<T, Vec<Invalid>> {
    match made {
        Ok(made) if findings.is_empty() => Ok(made),
        Ok(_) => Err(findings),
        Err(others) => {
            findings.extend(others.into_iter().map(|invalid::Invalid { name, value, wanted }| Invalid {
                name,
                value,
                wanted,
            }));
            Err(findings)
        }
    }
}

/// The names `name[1]`, `name[2]`, `name[3]`.
pub(super) fn of_magnets(name: &str) -> [String; 3] {
    std::array::from_fn(|k| element(name, k))
}
