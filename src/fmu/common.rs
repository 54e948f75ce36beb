//! Properties common to all models of this project.

use fmu_export::Info;
use fmu_export::variable::{Causality, Row};

use serde::{Deserialize, Serialize};

use crate::machine::Machine;
use crate::variables::Variables;

/// Values of all variables of a sampled model.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, Variables)]
#[variables(context = Machine)]
pub struct Values<C: OfMachine, I: OfMachine, O: OfMachine> {
    #[nested(prefix = "")]
    pub config: C,
    #[nested(prefix = "")]
    pub input: I,
    #[nested(prefix = "")]
    pub output: O,
}

/// Variables of a machine.
pub trait OfMachine: Variables<Context = Machine> {}

impl<V: Variables<Context = Machine>> OfMachine for V {}

/// Version, licence, and the paper's experiment of 0.4 s in steps of 0.1 ms.
pub(super) const fn info((name, description): &(&'static str, &'static str)) -> Info {
    Info::new(name, description)
        .version(env!("CARGO_PKG_VERSION"))
        .license(env!("CARGO_PKG_LICENSE"))
        .tool(concat!(env!("CARGO_PKG_NAME"), " ", env!("CARGO_PKG_VERSION")))
        .experiment(0.4, 1e-4)
        // The models have a fixed accuracy better than this: without noise the errors of the estimates are smaller
        // (tests/app/closed_loop.rs), those of the plant's motion much smaller (tests/model/plant.rs).
        .tolerance(1e-4)
}

/// The rows of a model as seen by the user: descriptions worded for the machine, and quantities with display units in the first of these.
pub(super) fn described(rows: Vec<Row<()>>, machine: &Machine) -> Vec<Row<()>> {
    let rows = rows.into_iter().map(|row| {
        let description = machine.describe(&row.variable.description, &row.variable.name, row.index());
        row.description(description).display_in_first()
    });
    rows.collect()
}

/// The table of a sampled model, whose outputs at the start depend on the parameters only.
pub(super) fn sampled<V: OfMachine + Default>(machine: &Machine) -> Vec<Row<V>> {
    let is_output = |row: &Row<()>| row.variable.causality == Causality::Output;
    let rows = V::described(machine).into_iter();
    let rows = rows.map(|row| if is_output(&row) { row.starts_from_parameters() } else { row });
    V::placed(described(rows.collect(), machine))
}
