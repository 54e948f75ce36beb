//! A run as one page of HTML that needs nothing else: tables, plots, parameters.

use maud::{DOCTYPE, Markup, PreEscaped, html};

use crate::app::recording::Recording;

mod figures;

/// Inline, for the page is to be a single file.
pub(super) const STYLE: &str = include_str!("report/style.css");

/// What the page shows. Start from [`Report::new`] and fill in what there is.
#[derive(Clone, Debug)]
pub struct Report<'a> {
    /// Heading.
    pub title: String,
    /// What the run is about; blank lines part paragraphs.
    pub description: String,
    /// The command that makes this page.
    pub command: String,
    /// Why the run ended early, if it did.
    pub message: Option<String>,
    /// The signals, with columns named `element.variable`.
    pub recording: &'a Recording,
    /// Results in numbers.
    pub tables: Vec<Table>,
    /// Every parameter of the run.
    pub parameters: Vec<Parameter>,
    /// When the controller was to take the estimate, in seconds; `None` where that is not planned by time.
    pub update_s: Option<f64>,
    /// The true λ of the three magnets, in N·m²/A², where it is known.
    pub truth: Option<[f64; 3]>,
    /// The estimators to compare.
    pub methods: Vec<Method>,
    /// Clearance of the backup bearing, in m, where there is one.
    pub clearance_m: Option<f64>,
    /// Sensitivity functions of the loop.
    pub sensitivities: Vec<Sensitivity>,
    /// Whether the run repeats the paper's, so that captions name the figures they redraw.
    pub paper: bool,
}

impl<'a> Report<'a> {
    /// A report on `recording` with nothing but a title.
    pub fn new(title: &str, recording: &'a Recording) -> Report<'a> {
        Report {
            title: title.into(),
            description: String::new(),
            command: String::new(),
            message: None,
            recording,
            tables: Vec::new(),
            parameters: Vec::new(),
            update_s: None,
            truth: None,
            methods: Vec::new(),
            clearance_m: None,
            sensitivities: Vec::new(),
            paper: false,
        }
    }
}

/// An estimator whose λ̂ stands in the columns `element.lambdaHat[1..3]`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Method {
    /// Name of the element, for instance `paperLiteral`.
    pub element: String,
    /// What it is, in words.
    pub label: String,
}

impl From<&str> for Method {
    /// An estimator that goes by the name of its element.
    fn from(element: &str) -> Method {
        Method { element: element.into(), label: element.into() }
    }
}

/// The sensitivity function of both axes for one λ of the controller.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Sensitivity {
    /// When it holds: before or after the update, or at the end of the run.
    pub name: String,
    /// `[ω, |S_y|, |S_z|]` from the linearisation, ω in rad/s.
    pub sweep: Vec<[f64; 3]>,
    /// The same from injection in time.
    pub injected: Vec<[f64; 3]>,
    /// Why there is none, if there is none.
    pub missing: Option<String>,
}

/// A table of results.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Table {
    /// Heading.
    pub title: String,
    /// A sentence or two below it; may be empty.
    pub note: String,
    /// Names of the columns.
    pub head: Vec<String>,
    /// Rows, each as long as `head`; the first cell names the row.
    pub rows: Vec<Vec<String>>,
}

/// A parameter of the run.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Parameter {
    /// The element it belongs to.
    pub group: String,
    /// Name as in the interface.
    pub name: String,
    /// Value with unit.
    pub value: String,
    /// What it is.
    pub description: String,
}

/// The page: one file, without scripts, that loads nothing.
///
/// Whatever is missing from the recording leaves out its figure, with a sentence in its place.
pub fn page(report: &Report) -> String {
    let figures = figures::all(report);
    let run = match (report.recording.time_s.first(), report.recording.time_s.last()) {
        (Some(first), Some(last)) => format!(
            "{} samples from {} to {}.",
            report.recording.time_s.len(),
            figures::instant(*first),
            figures::instant(*last)
        ),
        _ => "The recording is empty.".into(),
    };
    html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                title { (report.title) }
                style { (PreEscaped(STYLE)) }
            }
            body {
                header {
                    h1 { (report.title) }
                    @if let Some(message) = &report.message {
                        p.message role="alert" { strong { "The run ended early. " } (message) }
                    }
                    @for paragraph in report.description.split("\n\n").filter(|text| !text.trim().is_empty()) {
                        p { (paragraph.trim()) }
                    }
                    p.run { (run) }
                    @if !report.command.is_empty() {
                        pre { code { (report.command) } }
                    }
                    nav {
                        ul {
                            @if !report.tables.is_empty() { li { a href="#results" { "Results in numbers" } } }
                            @for figure in &figures { li { a href={ "#" (figure.id) } { (figure.title) } } }
                            @if !report.parameters.is_empty() { li { a href="#parameters" { "Parameters" } } }
                        }
                    }
                }
                main {
                    @if !report.tables.is_empty() {
                        section id="results" {
                            @for table in &report.tables { (table_of(table)) }
                        }
                    }
                    @for (index, figure) in figures.iter().enumerate() { (figure.html(index + 1)) }
                    @if !report.parameters.is_empty() { (parameters_of(&report.parameters)) }
                }
            }
        }
    }
    .into_string()
}

/// A table with its heading and note.
pub(super) fn table_of(table: &Table) -> Markup {
    // A column of numbers reads best flush right.
    let numeric = |column: usize| {
        let mut cells = table.rows.iter().filter_map(|row| row.get(column)).filter(|cell| !cell.is_empty()).peekable();
        column > 0 && cells.peek().is_some() && cells.all(|cell| looks_numeric(cell))
    };
    let columns = table.rows.iter().map(Vec::len).chain([table.head.len()]).max().unwrap_or(0);
    let numeric: Vec<bool> = (0..columns).map(numeric).collect();
    html! {
        div.table {
            @if !table.title.is_empty() { h2 { (table.title) } }
            @if !table.note.is_empty() { p { (table.note) } }
            div.scroll {
                table {
                    @if !table.head.is_empty() {
                        thead {
                            tr {
                                @for (cell, numeric) in table.head.iter().zip(&numeric) {
                                    th scope="col" class=[numeric.then_some("number")] { (cell) }
                                }
                            }
                        }
                    }
                    tbody {
                        @for row in &table.rows {
                            tr {
                                @for (column, cell) in row.iter().enumerate() {
                                    @if column == 0 {
                                        th scope="row" { (cell) }
                                    } @else {
                                        td class=[numeric[column].then_some("number")] { (cell) }
                                    }
                                }
                            }
                        }
                    }
                }
            }
        }
    }
}

/// Whether a cell holds a number, with or without sign, brackets and unit, rather than words.
fn looks_numeric(cell: &str) -> bool {
    let start = cell.trim_start_matches(['+', '-', '−', '±', '<', '>', '≤', '≥', '≈', '(', ' ']);
    let letters = cell.chars().filter(|c| c.is_alphabetic()).count();
    cell == "–" || cell == "—" || (start.starts_with(|c: char| c.is_ascii_digit()) && letters <= 8)
}

/// Every parameter, by group, folded away.
fn parameters_of(parameters: &[Parameter]) -> Markup {
    let mut groups: Vec<(&str, Vec<&Parameter>)> = Vec::new();
    for parameter in parameters {
        match groups.iter_mut().find(|(group, _)| *group == parameter.group) {
            Some((_, members)) => members.push(parameter),
            None => groups.push((&parameter.group, vec![parameter])),
        }
    }
    html! {
        section id="parameters" {
            details {
                summary { "Parameters (" (parameters.len()) ")" }
                @for (group, members) in groups {
                    h3 { (group) }
                    div.scroll {
                        table.parameters {
                            tbody {
                                @for parameter in members {
                                    tr {
                                        th scope="row" { code { (parameter.name) } }
                                        td.value { (parameter.value) }
                                        td { (parameter.description) }
                                    }
                                }
                            }
                        }
                    }
                }
            }
        }
    }
}
