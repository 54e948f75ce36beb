//! The page `documentation/index.html` of an FMU: what it models, its equations, its variables, an example.

use maud::{PreEscaped, html};

use super::html;
use crate::fmi2::registry::{self, Entry};
use crate::fmi2::xml::real;
use crate::slave::variable::{Causality, Type, Variability, Variable};

/// The parts of the page that are written by hand, one file per model.
fn prose(name: &str) -> &'static str {
    match name {
        "MagneticBearing" => include_str!("../../modelDescription/MagneticBearing.html"),
        "FlatnessController" => include_str!("../../modelDescription/FlatnessController.html"),
        "AlgebraicEstimator" => include_str!("../../modelDescription/AlgebraicEstimator.html"),
        other => unreachable!("{other} has no documentation"),
    }
}

/// Whether a variable belongs to a group.
type Belongs = fn(&Variable) -> bool;

/// Groups of variables, with the heading of their table.
const GROUPS: [(&str, Belongs); 5] = [
    ("Inputs", |variable| variable.causality == Causality::Input),
    ("Outputs", |variable| variable.causality == Causality::Output),
    ("Parameters", |variable| is_parameter(variable, Variability::Fixed)),
    ("Tunable parameters", |variable| is_parameter(variable, Variability::Tunable)),
    ("Local variables", |variable| variable.causality == Causality::Local),
];

fn is_parameter(variable: &Variable, variability: Variability) -> bool {
    variable.causality == Causality::Parameter && variable.variability == variability
}

/// The page.
pub fn page(entry: &Entry) -> String {
    let variables = (entry.kind.variables)();
    let body = html! {
        main.document {
            h1 { (entry.kind.name) }
            p.lead { (entry.kind.description) "." }
            p.soft {
                "FMI 2.0 for co-simulation, " (env!("CARGO_PKG_NAME")) " " (env!("CARGO_PKG_VERSION"))
                ", guid " code { (entry.guid) } "."
            }
            (PreEscaped(prose(entry.kind.name)))
            h2 { "Variables" }
            @for (title, belongs) in GROUPS {
                @let group: Vec<_> = variables.iter().copied().filter(|variable| belongs(variable)).collect();
                @if !group.is_empty() {
                    h3 { (title) }
                    (table(&group))
                }
            }
            h2 { "Licence" }
            p {
                "MIT or Apache-2.0, at your choice; the texts, and those of the libraries in the binary, are in the folder "
                a href="licenses" { "licenses" } "."
            }
        }
    };
    html::page(entry.kind.name, &body)
}

/// The variables of all FMUs as Markdown, for readers of the project.
pub fn markdown() -> String {
    let mut text = String::from(
        "# Variables of the FMUs\n\nWritten by `cargo run --release -- describe` out of the tables in `src/slave/`. The unit in \
         brackets is proposed for display.\n",
    );
    for entry in registry::entries() {
        text += &format!("\n## {}\n\n{}.\n", entry.kind.name, entry.kind.description);
        let variables = (entry.kind.variables)();
        for (title, belongs) in GROUPS {
            let group: Vec<_> = variables.iter().copied().filter(|variable| belongs(variable)).collect();
            if group.is_empty() {
                continue;
            }
            text += &format!("\n### {title}\n\n| Name | Unit | Start | Description |\n|---|---|---|---|\n");
            for variable in group {
                let (unit, start) = (unit(variable), start(variable));
                text += &format!("| `{}` | {unit} | {start} | {} |\n", variable.name, variable.description);
            }
        }
    }
    text
}

fn table(variables: &[&Variable]) -> maud::Markup {
    html! {
        table.variables {
            thead { tr { th { "Name" } th { "Unit" } th { "Start" } th { "Description" } } }
            tbody {
                @for variable in variables {
                    tr {
                        td { code { (variable.name) } }
                        td { (unit(variable)) }
                        td { (start(variable)) }
                        td { (variable.description) }
                    }
                }
            }
        }
    }
}

fn unit(variable: &Variable) -> String {
    match &variable.kind {
        Type::Real { unit, display: Some(display), .. } if *display != unit.name => {
            format!("{} ({display})", unit.name)
        }
        _ => variable.unit_name().into(),
    }
}

fn start(variable: &Variable) -> String {
    if !variable.is_settable() {
        return String::new();
    }
    match &variable.kind {
        Type::Real { start, .. } => real(*start),
        Type::Integer { start, .. } => start.to_string(),
        Type::Boolean { start } => start.to_string(),
        Type::Enumeration { start, items } => {
            format!("{} of {}", items.item(*start).unwrap_or_default(), items.listed())
        }
    }
}
