//! A run as one self-contained HTML page: answer, animation, plots, tables, parameters.

use maud::{Markup, html};

use crate::machine::{Bearing, Machine};
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

/// Content of a page other than its answer and figures.
#[derive(Default)]
struct Report<'a> {
    /// Heading.
    title: &'a str,
    /// Description of the run; blank lines separate paragraphs.
    description: &'a str,
    /// The command that makes this page.
    command: &'a str,
    /// Why the run ended early, if it did.
    message: Option<&'a str>,
    /// Instants of the recording, in s, if there is one.
    time_s: Option<&'a [f64]>,
    /// Buttons that choose the interval shown in the plots.
    views: Markup,
    /// Tables of results.
    tables: Vec<Table>,
    /// All parameters of the run by element: name, value with unit, description.
    parameters: Vec<(&'a str, Vec<[String; 3]>)>,
}

impl Report<'_> {
    /// The page as one file that loads nothing.
    ///
    /// It contains the compressed script that draws the plots, so that it can be mailed.
    fn page(&self, answer: &Markup, figures: &[Figure]) -> String {
        let main = html! {
            section #answer { (answer) }
            section {
                @for paragraph in self.description.split("\n\n").filter(|text| !text.trim().is_empty()) {
                    p { (prose(paragraph.trim())) }
                }
                @if let Some(time_s) = self.time_s { p.soft { (summary_of(time_s)) } }
                @if !self.command.is_empty() {
                    p.soft { "Command of this page:" }
                    pre { code { (self.command) } }
                }
            }
            nav {
                ul {
                    @for figure in figures { li { a href={ "#" (figure.id) } { (figure.title) } } }
                    @if !self.tables.is_empty() { li { a href="#results" { "Results in numbers" } } }
                    @if !self.parameters.is_empty() { li { a href="#parameters" { "Parameters" } } }
                }
            }
            (self.views)
            @for (index, figure) in figures.iter().enumerate() { (figure.html(index + 1)) }
            @if !self.tables.is_empty() {
                section #results {
                    @for table in &self.tables { (table_of(table)) }
                }
            }
            @if !self.parameters.is_empty() { (parameters_of(&self.parameters)) }
        };
        let body = html! {
            header {
                h1 { (self.title) }
                @if let Some(message) = self.message {
                    p.message role="alert" { strong { "The run ended early. " } (message) }
                }
                (plot::notice())
            }
            main { (main) }
            footer.soft { "Plots: plotly.js (MIT). Drag to zoom, double-click for all, click a legend entry to hide or show its line." }
            (plot::scripts())
        };
        frame::page(self.title, &body)
    }
}

/// A sentence with its first letter in lower case, to follow a colon.
pub(super) fn after_colon(sentence: &str) -> String {
    let mut letters = sentence.chars();
    letters.next().map_or_else(String::new, |first| first.to_lowercase().chain(letters).collect())
}

/// Text, with code between backticks.
fn prose(text: &str) -> Markup {
    html! {
        @for (at, part) in text.split('`').enumerate() {
            @if at % 2 == 0 { (part) } @else { code { (part) } }
        }
    }
}

/// The length of the recording, and whether all of it is drawn.
fn summary_of(time_s: &[f64]) -> String {
    let [first, last] = [0, time_s.len() - 1].map(|at| instant(time_s[at]));
    let samples = time_s.len();
    let thinned = if samples <= plot::MAX_UNTHINNED {
        "all drawn"
    } else {
        "of which the plots show the smallest and the largest value of short intervals"
    };
    format!("{samples} samples from {first} to {last}, {thinned}.")
}

/// An instant to a tenth of a millisecond, without trailing zeros.
pub(super) fn instant(at_s: f64) -> String {
    format!("{} s", (at_s * 1e4).round() / 1e4)
}

/// λ̂ of the magnets in use with their standard deviations, in 10⁻⁶ N·m²/A², beside the true values if known.
pub(super) fn cards(machine: &Machine, estimates: &[Option<[f64; 2]>], truth: Option<&[f64]>) -> Markup {
    // Two significant digits of the standard deviation, and as many decimals of the estimate.
    let places = |std: f64| (2.0 - (1e6 * std).log10().floor() - 1.0).clamp(3.0, 7.0) as usize;
    let number_of = |value: f64, std: f64| format!("{:.*}", places(std), value * 1e6);
    html! {
        div.cards {
            @for (bearing, magnets) in machine.magnets_of_bearings() {
                @for (number, k) in magnets.enumerate() {
                    @if let Some([lambda, std]) = estimates[k] {
                        div.card style={ "border-color:var(" (plot::colour::MAGNETS[number]) ")" } {
                            span.name { (bearing.prefix) "λ̂" sub { (number + 1) } }
                            span.value { (number_of(lambda, std)) " ± " (number_of(std, std)) }
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

/// `Bearing A`, or `Bearing` if there is only one.
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
    let numeric: Vec<bool> = (0..table.head.len()).map(numeric).collect();
    html! {
        div.table {
            h2 { (table.title) }
            @if !table.note.is_empty() { p { (table.note) } }
            div.scroll {
                table {
                    thead {
                        tr {
                            @for (cell, numeric) in table.head.iter().zip(&numeric) {
                                th scope="col" class=[numeric.then_some("number")] { (cell) }
                            }
                        }
                    }
                    tbody {
                        @for row in &table.rows {
                            tr {
                                @for (column, cell) in row.iter().enumerate() {
                                    @if column == 0 { th scope="row" { (cell) } }
                                    @else { td class=[numeric[column].then_some("number")] { (cell) } }
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

/// All parameters by element, collapsed.
fn parameters_of(parameters: &[(&str, Vec<[String; 3]>)]) -> Markup {
    html! {
        section id="parameters" {
            details {
                summary { "Parameters (" (parameters.iter().map(|(_, own)| own.len()).sum::<usize>()) ")" }
                @for (element, own) in parameters {
                    h3 { (element) }
                    div.scroll {
                        table.parameters {
                            tbody {
                                @for [name, value, description] in own {
                                    tr {
                                        th scope="row" { code { (name) } }
                                        td.value { (value) }
                                        td { (description) }
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
