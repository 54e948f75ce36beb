//! A run as one self-contained HTML page: answer, animation, plots, tables, parameters.

use std::borrow::Cow;

use maud::{Markup, html};

use crate::machine::{Bearing, Machine};
use crate::simulation::recording::Recording;
use crate::table::Table;

pub mod campbell;
pub mod evaluation;
pub mod experiment;
pub mod frame;
pub mod identification;
pub mod plot;

mod figures;
mod tables;

use figures::Figure;

/// Content of the page. Start from [`Report::new`] and fill in the rest.
#[derive(Clone, Debug, Default)]
pub struct Report<'a> {
    /// Heading.
    pub title: String,
    /// Description of the run; blank lines separate paragraphs.
    pub description: String,
    /// The command that makes this page.
    pub command: String,
    /// Why the run ended early, if it did.
    pub message: Option<String>,
    /// The best answer, and after it that of the estimator which the controller uses, if it is another.
    pub answers: Vec<Answer>,
    /// Forces before and after correction masses, for the first screen.
    pub balance: Option<Table>,
    /// The signals, with columns named `element.variable`.
    pub recording: Cow<'a, Recording>,
    /// Tables of results.
    pub tables: Vec<Table>,
    /// All parameters of the run.
    pub parameters: Vec<Parameter>,
    /// Events of the run, to mark in the plots.
    pub events: Vec<Event>,
    /// The machine, by which columns are found.
    pub machine: &'static Machine,
    /// The true λ of all magnets, in N·m²/A², if known.
    pub truth: Option<Vec<f64>>,
    /// The true unbalance of each plane, in kg·m, if known.
    pub unbalance_kgm: Vec<f64>,
    /// The estimators to compare.
    pub methods: Vec<ComparedEstimator>,
    /// Clearance of the backup bearing at each bearing, in m, if known.
    pub clearance_m: Vec<f64>,
    /// The scene of the animation.
    pub scene: Option<Scene>,
    /// Sensitivity functions of the loop.
    pub sensitivities: Vec<SensitivityCurves>,
    /// Which section of the paper the run repeats, so that captions name the paper's figures.
    pub paper: Option<Paper>,
}

impl<'a> Report<'a> {
    /// A report on `recording` with nothing but a title.
    pub fn new(title: &str, recording: &'a Recording) -> Report<'a> {
        Report { title: title.into(), recording: Cow::Borrowed(recording), ..Report::default() }
    }
}

/// The sections of the paper that a run may repeat.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Paper {
    /// Section IV.A.
    Simulation,
    /// Section IV.B.
    Experiment,
}

/// The final estimate of an estimator.
#[derive(Clone, Debug, PartialEq)]
pub struct Answer {
    /// Name of the element whose λ̂ it is.
    pub element: String,
    /// Its method.
    pub method: String,
    /// Whether the estimate is valid at the end of the run.
    pub valid: bool,
    /// The verdict in words, and since when it holds.
    pub verdict: String,
    /// λ̂ of each magnet that is used and its standard deviation with tolerances, in N·m²/A².
    pub lambda: Vec<Option<[f64; 2]>>,
    /// The relative standard deviation below which an estimate of this method becomes valid.
    pub limit: f64,
    /// The expected value if it differs from the true one, with the reason; may be empty.
    pub expectation: String,
}

/// An event of the run.
#[derive(Clone, Debug, PartialEq)]
pub struct Event {
    /// When, in s.
    pub at_s: f64,
    /// The event in a few words.
    pub label: String,
}

/// The scene of an animation, in which the rotor moves.
#[derive(Clone, Debug, PartialEq)]
pub enum Scene {
    /// The rotor in the plane of its bearing.
    Bearing {
        /// Angles of the magnets, in rad.
        alpha_rad: Vec<f64>,
        /// Nominal air gap, in m.
        gap_m: f64,
    },
    /// A shaft in two radial bearings and an axial one; positions along it in m.
    Shaft {
        /// The radial bearings.
        bearings_m: [f64; 2],
        /// Their sensors.
        sensors_m: [f64; 2],
        /// Its ends.
        ends_m: [f64; 2],
    },
}

/// An estimator whose λ̂ is in the columns `element.lambdaHat[1]`, ….
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ComparedEstimator {
    /// Name of the element, for instance `paperLiteral`.
    pub element: String,
    /// Label in the legend.
    pub label: String,
}

/// The sensitivity functions of a loop for one set of λ of the controller.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SensitivityCurves {
    /// When they hold: before or after the update, or at the end of the run.
    pub name: String,
    /// The axis of each sensor, and its `[ω, |S|]`, ω in rad/s.
    pub axes: Vec<(String, Vec<[f64; 2]>)>,
    /// Why they are missing, if they are.
    pub missing: Option<String>,
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
    /// Description.
    pub description: String,
}

/// The page as one file that loads nothing.
///
/// It contains the compressed script that draws the plots, so that it can be mailed. A figure whose signals are missing is
/// replaced by a sentence.
pub fn page(report: &Report) -> String {
    let answer = html! {
        @for (place, answer) in report.answers.iter().enumerate() {
            @if place == 1 { h2 { "Beside it: the estimate that the controller uses" } }
            (answer_of(answer, report))
            @if place == 0 { (figures::first(report)) }
        }
        @if report.answers.is_empty() { (figures::first(report)) }
    };
    page_with(report, &answer, &figures::all(report))
}

/// The page with another answer and other figures.
fn page_with(report: &Report, answer: &Markup, figures: &[Figure]) -> String {
    let main = html! {
        section #answer { (answer) }
        section {
            @for paragraph in report.description.split("\n\n").filter(|text| !text.trim().is_empty()) {
                p { (prose(paragraph.trim())) }
            }
            p.soft { (run_of(&report.recording)) }
            @if !report.command.is_empty() {
                p.soft { "This page is made by" }
                pre { code { (report.command) } }
            }
        }
        nav {
            ul {
                @for figure in figures { li { a href={ "#" (figure.id) } { (figure.title) } } }
                @if !report.tables.is_empty() { li { a href="#results" { "Results in numbers" } } }
                @if !report.parameters.is_empty() { li { a href="#parameters" { "Parameters" } } }
            }
        }
        (figures::views(report))
        @for (index, figure) in figures.iter().enumerate() { (figure.html(index + 1)) }
        @if !report.tables.is_empty() {
            section #results {
                @for table in &report.tables { (table_of(table)) }
            }
        }
        @if !report.parameters.is_empty() { (parameters_of(&report.parameters)) }
    };
    framed(&report.title, report.message.as_deref(), &main)
}

/// A page with plots: its title, why the run ended early, and the rest.
fn framed(title: &str, message: Option<&str>, main: &Markup) -> String {
    let body = html! {
        header {
            h1 { (title) }
            @if let Some(message) = message {
                p.message role="alert" { strong { "The run ended early. " } (message) }
            }
            (plot::notice())
        }
        main { (main) }
        footer.soft { "Plots: plotly.js (MIT). Drag to zoom, double-click for all, click a name in a legend to switch its line." }
        (plot::scripts())
    };
    frame::page(title, &body)
}

/// The words of a verdict after a colon.
pub(super) fn after_colon(words: &str) -> String {
    let mut letters = words.chars();
    letters.next().map_or_else(String::new, |first| first.to_lowercase().chain(letters).collect())
}

/// A text with the names between backticks as code.
fn prose(text: &str) -> Markup {
    html! {
        @for (at, part) in text.split('`').enumerate() {
            @if at % 2 == 0 { (part) } @else { code { (part) } }
        }
    }
}

/// The length of the recording, and how much of it is drawn.
fn run_of(recording: &Recording) -> String {
    let (Some(first), Some(last)) = (recording.time_s.first(), recording.time_s.last()) else {
        return "The recording is empty.".into();
    };
    let samples = recording.time_s.len();
    let thinned = if samples <= plot::WHOLE {
        "each of them is drawn"
    } else {
        "of which the plots show the smallest and the largest value of short intervals"
    };
    format!("{samples} samples from {} to {}, {thinned}.", instant(*first), instant(*last))
}

/// An instant to a tenth of a millisecond, without trailing zeros.
pub(super) fn instant(at_s: f64) -> String {
    format!("{} s", (at_s * 1e4).round() / 1e4)
}

/// λ̂ ± beside the true value, and whether it is valid.
fn answer_of(answer: &Answer, report: &Report) -> Markup {
    html! {
        p class=(if answer.valid { "verdict good" } else { "verdict bad" }) {
            strong { (if answer.valid { "Valid" } else { "Not valid" }) } " " (answer.verdict)
        }
        @if let Some(table) = &report.balance {
            h2 { (table.title) }
            div.cards {
                @for row in &table.rows {
                    div.card {
                        span.name { (row[0]) }
                        span.value { (row[1]) " → " (row[2]) }
                        span.truth { (row[3]) " removed" }
                    }
                }
            }
            p.soft { (table.note) }
            h2 { "Force constants" }
        }
        (cards(report.machine, &answer.lambda, report.truth.as_deref()))
        p.soft {
            "In 10⁻⁶ N·m²/A², at the end of the run"
            @if !answer.method.is_empty() { ", by the method " code { (answer.method) } }
            "; ± is two standard deviations as stated by the \
             estimator. It becomes valid when its tests pass and one standard deviation is below " (format!("{:.0}", 100.0 * answer.limit))
            " % of each λ. " (answer.expectation)
        }
    }
}

/// λ̂ of the magnets in use with twice their standard deviations, in 10⁻⁶ N·m²/A², beside the true values if known.
pub(super) fn cards(machine: &Machine, estimates: &[Option<[f64; 2]>], truth: Option<&[f64]>) -> Markup {
    // Two significant digits of the deviation, and as many decimals of the estimate.
    let places = |std: f64| (2.0 - (2e6 * std).log10().floor() - 1.0).clamp(3.0, 7.0) as usize;
    let number_of = |value: f64, std: f64| format!("{:.*}", places(std), value * 1e6);
    html! {
        div.cards {
            @for (bearing, magnets) in machine.magnets_of_bearings() {
                @for (number, k) in magnets.enumerate() {
                    @if let Some([lambda, std]) = estimates[k] {
                        div.card style={ "border-color:var(" (plot::colour::MAGNETS[number]) ")" } {
                            span.name { (bearing.prefix) "λ̂" sub { (number + 1) } }
                            span.value { (number_of(lambda, std)) " ± " (number_of(2.0 * std, std)) }
                            @if let Some(truth) = truth {
                                span.truth {
                                    "truth " (number_of(truth[k], std)) ", error " (percent(lambda / truth[k] - 1.0))
                                }
                            }
                        }
                    }
                }
            }
        }
    }
}

/// A title, with the bearing if there are several: `Forces, bearing A`.
fn titled(title: &str, bearing: &Bearing) -> String {
    if bearing.prefix.is_empty() { title.to_owned() } else { format!("{title}, bearing {}", bearing.name()) }
}

/// `Bearing A`, or `Bearing` where there is but one.
fn title_of(bearing: &Bearing) -> String {
    format!("Bearing {}", bearing.name()).trim_end().to_owned()
}

/// A ratio in per cent with its sign.
fn percent(ratio: f64) -> String {
    let percent = 100.0 * ratio;
    let text = match percent.abs() {
        size if !size.is_finite() => return "unknown".into(),
        size if size >= 1000.0 => format!("{percent:+.1e}"),
        size if size >= 0.1 => format!("{percent:+.2}"),
        _ => format!("{percent:+.4}"),
    };
    format!("{} %", text.replace('-', "−"))
}

/// A table with its heading and note.
pub(super) fn table_of(table: &Table) -> Markup {
    // Columns of numbers are right-aligned.
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

/// Whether a cell holds a number, with or without sign, brackets and unit.
fn looks_numeric(cell: &str) -> bool {
    let start = cell.trim_start_matches(['+', '-', '−', '±', '<', '>', '≤', '≥', '≈', '(', ' ']);
    let letters = cell.chars().filter(|c| c.is_alphabetic()).count();
    cell == "–" || cell == "—" || (start.starts_with(|c: char| c.is_ascii_digit()) && letters <= 8)
}

/// All parameters by group, folded.
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
