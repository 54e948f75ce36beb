//! The page `documentation/index.html` of an FMU: description, the author's text, variables.

use maud::{DOCTYPE, PreEscaped, html};

use super::Extras;
use crate::variable::{Causality, Type, Variability, Variable};
use crate::{ModelType, Standard, description};

const STYLE: &str = "body{font:16px/1.5 system-ui,sans-serif;max-width:60rem;margin:2rem auto;padding:0 1rem;color:#1c2430}\
table{border-collapse:collapse;width:100%;font-size:.9rem;margin:.5rem 0 1.5rem}\
th,td{text-align:left;vertical-align:top;padding:.25rem .6rem;border-bottom:1px solid #d5dae1}\
th{border-bottom:2px solid #8a94a3}td:first-child{white-space:nowrap}\
code,pre{font-family:ui-monospace,monospace;font-size:.9em}pre{background:#f4f6f8;padding:.8rem;overflow-x:auto}\
h1{margin-bottom:.2rem}h2{margin-top:2rem}.lead{font-size:1.1rem;color:#465264;margin-top:0}";

/// Whether a variable belongs to a group.
type Belongs = fn(&Variable) -> bool;

/// Groups of variables, with the heading of their table.
const GROUPS: [(&str, Belongs); 6] = [
    ("Inputs", |variable| variable.causality == Causality::Input),
    ("Outputs", |variable| variable.causality == Causality::Output),
    ("Parameters", |variable| is_parameter(variable, Variability::Fixed)),
    ("Tunable parameters", |variable| is_parameter(variable, Variability::Tunable)),
    ("Calculated parameters", |variable| variable.causality == Causality::CalculatedParameter),
    ("Local variables", |variable| matches!(variable.causality, Causality::Local | Causality::Independent)),
];

fn is_parameter(variable: &Variable, variability: Variability) -> bool {
    variable.causality == Causality::Parameter && variable.variability == variability
}

/// The groups of a model that are not empty, with the headings of their tables.
fn groups(model: &ModelType) -> impl Iterator<Item = (&'static str, Vec<&Variable>)> {
    let group = |belongs: Belongs| model.variables().iter().filter(|variable| belongs(variable)).collect::<Vec<_>>();
    GROUPS.into_iter().map(move |(title, belongs)| (title, group(belongs))).filter(|(_, group)| !group.is_empty())
}

/// The content of the page, from the heading on.
pub(super) fn body(model: &ModelType, standard: Standard, extras: &Extras) -> String {
    let info = &model.info;
    let token = match standard {
        Standard::Fmi2 => "guid",
        Standard::Fmi3 { .. } => "instantiation token",
    };
    let body = html! {
        main.document {
            h1 { (info.name) }
            p.lead { (info.description) "." }
            p.soft { "FMI " (standard.version()) " for co-simulation, " (info.tool) ", "
                (token) " " code { (model.description(standard).token) } "." }
            (PreEscaped(&extras.text))
            h2 { "Variables" }
            @for (title, group) in groups(model) {
                h3 { (title) }
                (table(&group))
            }
            @if !info.license.is_empty() {
                h2 { "Licence" }
                p {
                    (info.license)
                    @if !extras.licenses.is_empty() {
                        "; the texts, and those of the libraries in the binary, are in the folder "
                        a href="licenses" { "licenses" }
                    }
                    "."
                }
            }
        }
    };
    body.into_string()
}

/// A page with that title and content, in a plain style.
pub fn page(title: &str, body: &str) -> String {
    let page = html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                title { (title) }
                style { (PreEscaped(STYLE)) }
            }
            body { (PreEscaped(body)) }
        }
    };
    page.into_string()
}

/// The variables of models as Markdown, one section per model.
pub fn markdown<'m>(models: impl IntoIterator<Item = &'m ModelType>) -> String {
    let mut text = String::new();
    for model in models {
        text += &format!("\n## {}\n\n{}.\n", model.info.name, model.info.description);
        for (title, group) in groups(model) {
            text += &format!("\n### {title}\n\n| Name | Unit | Start | Description |\n|---|---|---|---|\n");
            for variable in group {
                let (unit, start, description) = (unit(variable), start(variable), description(variable));
                text += &format!("| `{}` | {unit} | {start} | {description} |\n", variable.name);
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
                        td { (description(variable)) }
                    }
                }
            }
        }
    }
}

fn unit(variable: &Variable) -> String {
    match &variable.data_type {
        Type::Real { unit, display: Some(display), .. } if *display != unit.name => {
            format!("{} ({display})", unit.name)
        }
        _ => variable.unit_name().into(),
    }
}

fn start(variable: &Variable) -> String {
    if !variable.has_start() {
        return String::new();
    }
    match &variable.data_type {
        Type::String { start } => format!("\"{start}\""),
        Type::Enumeration { start, items } => items.item(*start).unwrap_or_default().into(),
        _ => description::start(variable),
    }
}

/// The description of a variable, with the items of an enumeration.
fn description(variable: &Variable) -> String {
    let description = &variable.description;
    let Type::Enumeration { items, .. } = &variable.data_type else { return description.to_string() };
    let items = items.items.iter().zip(1..).map(|((item, text), value)| format!("{value} {item}: {text}"));
    format!("{description}. {}", items.collect::<Vec<_>>().join("; "))
}
