//! Properties that the models of this project share.

use fmu_export::Info;
use fmu_export::variable::{Causality, Row};

use crate::machine::Machine;

/// Shared by all models: version, licence, the paper's experiment of 0.4 s in steps of 0.1 ms.
pub(super) const fn info((name, description): &(&'static str, &'static str)) -> Info {
    Info::new(name, description)
        .version(env!("CARGO_PKG_VERSION"))
        .license(env!("CARGO_PKG_LICENSE"))
        .tool(concat!(env!("CARGO_PKG_NAME"), " ", env!("CARGO_PKG_VERSION")))
        .experiment(0.4, 1e-4)
        // The models have a fixed accuracy better than this: without noise the estimates err by less
        // (tests/app/closed_loop.rs), and the motion of the plant by far less (tests/model/plant.rs).
        .tolerance(1e-4)
}

/// The rows of a model as its users see them: descriptions in the words of the machine, and every quantity with a display unit in
/// the first of them.
pub(super) fn described(rows: Vec<Row<()>>, machine: &Machine) -> Vec<Row<()>> {
    let rows = rows.into_iter().map(|row| {
        let description = machine.describe(&row.variable.description, &row.variable.name, row.index());
        row.description(description).display_in_first()
    });
    rows.collect()
}

/// As [`described`], for a sampled model, whose outputs at the start follow from the parameters alone.
pub(super) fn sampled(rows: Vec<Row<()>>, machine: &Machine) -> Vec<Row<()>> {
    let is_output = |row: &Row<()>| row.variable.causality == Causality::Output;
    let rows = rows.into_iter().map(|row| if is_output(&row) { row.starts_from_parameters() } else { row });
    described(rows.collect(), machine)
}
