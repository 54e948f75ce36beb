//! Rows shared by the models of this project.

use fmu_export::unit::{KILOGRAM, METRE, RADIAN, SECOND};
use fmu_export::variable::{Access, Causality, Row};
use fmu_export::{Info, Invalid};

use crate::invalid;
use crate::machine::Machine;
use crate::variables::LAMBDA;

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

/// The rows of a model as its users see them: descriptions in the words of the machine, and every quantity with a display unit in
/// the first of them.
pub(super) fn described<D>(rows: impl IntoIterator<Item = Row<D>>, machine: &Machine) -> Vec<Row<D>> {
    let rows = rows.into_iter().map(|row| {
        let description = machine.describe(&row.variable.description, row.index());
        row.description(description).display_in_first()
    });
    rows.collect()
}

/// As [`described`], for a sampled model, whose outputs at the start follow from the parameters alone.
pub(super) fn sampled<D>(rows: Vec<Row<D>>, machine: &Machine) -> Vec<Row<D>> {
    let is_output = |row: &Row<D>| row.variable.causality == Causality::Output;
    let rows = rows.into_iter().map(|row| if is_output(&row) { row.starts_from_parameters() } else { row });
    described(rows, machine)
}

/// The findings of the equations in the type of the interface.
pub(super) fn refused(findings: Vec<invalid::Invalid>) -> Vec<Invalid> {
    let findings = findings.into_iter();
    findings.map(|invalid::Invalid { name, value, wanted }| Invalid { name, value, wanted }).collect()
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
            findings.extend(refused(others));
            Err(findings)
        }
    }
}
