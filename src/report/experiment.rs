//! The results of a run in numbers, and its report page.

use std::f64::consts::TAU;
use std::path::Path;

use maud::{Markup, html};

use super::figures::{self, Signals};
use super::{Report, after_colon, cards, evaluation, instant, tables};
use crate::estimation::{self, STD_LIMIT, Verdict};
use crate::simulation::{Element, Run, Scenario};
use crate::table::Table;
use crate::variables::Choice;
use fmu_export::variable::{Type, Value, Variable};

/// Estimates in the paper: figure 2, simulation, after less than 0.1 s.
pub(super) const PAPER_LAMBDA: [f64; 3] = [1.786e-6, 2.072e-6, 2.199e-6];
/// Lengths of at least this, in m, are shown in mm: they are dimensions of a machine, not displacements.
const LONG_M: f64 = 1e-3;

/// Sections of the paper that a run may reproduce.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Paper {
    /// Section IV.A.
    Simulation,
    /// Section IV.B.
    Experiment,
}

/// The section of the paper that a scenario reproduces, so that its results can be compared with ours.
fn paper(name: &Path, scenario: &Scenario) -> Option<Paper> {
    match name.to_str()? {
        _ if !scenario.changes.is_empty() => None,
        "paper" => Some(Paper::Simulation),
        "experiment" => Some(Paper::Experiment),
        _ => None,
    }
}

/// The estimators of a scenario: those beside the loop, or that of the loop if there are none. Each is the element whose
/// columns are `element.lambdaHat[1]`, …, and its label in legends.
pub(super) fn methods(scenario: &Scenario) -> Vec<[String; 2]> {
    match scenario.compared_estimators() {
        [] => vec![["estimator", scenario.method("estimator").unwrap_or("estimator")].map(String::from)],
        beside => beside.iter().map(|element| [element.name.clone(), element.name.clone()]).collect(),
    }
}

/// The tables of results of a scenario.
pub fn tables(name: &Path, scenario: &Scenario, run: &Run) -> Vec<Table> {
    tables::all(scenario, run, paper(name, scenario) == Some(Paper::Simulation))
}

/// The error that a harmonic perturbation in phase with the reference trajectory causes in an estimator that does not model it.
pub(super) fn coherence_note(scenario: &Scenario, run: &Run) -> String {
    let of = |element: &str, name: &str| scenario.number(element, name);
    let force_n = scenario.real("perturbation.amplitudeZ").unwrap_or_default();
    let omega = of("plant", "perturbation.omega");
    // Both are converted from the same speed, with different rounding.
    let synchronous = (omega / of("controller", "reference.omega") - 1.0).abs() <= 1e-9;
    let turned = (of("plant", "perturbation.phaseZ") - of("plant", "theta0")) / TAU;
    let in_phase = (turned - turned.round()).abs() <= 1e-9;
    if force_n == 0.0 || !synchronous || !in_phase || run.recording.time_s.len() < 2 {
        return String::new();
    }
    let inertia_n = of("plant", "m") * omega * omega * of("controller", "reference.rZ");
    let how = if force_n > 0.0 { "weaker" } else { "stronger" };
    let percent = 100.0 * (force_n / (inertia_n + force_n)).abs();
    format!(
        "The perturbation along z is in phase with the reference trajectory: {force_n} N beside m ω² rZ = \
         {inertia_n:.1} N look like magnets {how} by {percent:.2} %. No filter removes that; the paper's method attributes it to λ. "
    )
}

/// The final answers, each with its element: the best, and that of the controller's estimator if it is another one.
fn answers(scenario: &Scenario, run: &Run) -> Vec<(&'static str, Markup)> {
    const BEST: &str = "predictionError";
    const USED: &str = "estimator";
    let beside = scenario.compared_estimators().iter().any(|element| element.name == BEST);
    let best = (beside && scenario.method(USED) != Some(BEST)).then_some(BEST);
    best.into_iter().chain([USED]).map(|element| (element, answer(scenario, run, element))).collect()
}

/// The final answer of an estimator: λ̂ ± beside the true value, and whether it is valid.
fn answer(scenario: &Scenario, run: &Run, element: &str) -> Markup {
    let machine = scenario.machine;
    let column = |name: &str| &run.recording[format!("{element}.{name}")];
    let end = run.recording.time_s.len() - 1;
    let names = machine.of_magnets("lambdaHat").into_iter().zip(machine.of_magnets("lambdaStdTotal")).enumerate();
    let last = |(k, (hat, std)): (usize, (String, String))| {
        scenario.uses(k).then(|| [hat, std].map(|name| column(&name)[end]))
    };
    let lambda: Vec<_> = names.map(last).collect();
    let valid = column("valid")[end] == 1.0;
    // The verdict on the part of the motion whose tests fail, if any.
    let parts = machine.of_parts("verdict");
    let passed = f64::from(Verdict::Valid.number());
    let verdicts = column(parts.iter().max_by_key(|name| column(name)[end] != passed).expect("a part"));
    let verdict = verdicts[end];
    let since = verdicts.iter().rposition(|other| *other != verdict).map_or(0, |at| at + 1);
    let since_s = instant(run.recording.time_s[since]);
    let description = Verdict::of_number(verdict as i32).map_or("", Verdict::description);
    let mut verdict = format!("since {since_s}: {}.", after_colon(description));
    if !valid {
        verdict += &match column("valid").iter().rposition(|valid| *valid == 1.0) {
            Some(at) => {
                let until_s = instant(run.recording.time_s[at]);
                format!(" It was valid until {until_s}; that estimate is shown.")
            }
            None => " It was never valid.".into(),
        };
    }
    let method = scenario.method(element);
    let is_paper = method.is_some_and(|method| method.starts_with("paper"));
    let limit = if is_paper { estimation::paper::STD_LIMIT } else { STD_LIMIT };
    html! {
        p class=(if valid { "verdict good" } else { "verdict bad" }) {
            strong { (if valid { "Valid" } else { "Not valid" }) } " " (verdict)
        }
        @if let Some(table) = tables::balance(scenario, run) {
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
        (cards(machine, &lambda, Some(&scenario.truth())))
        p.soft {
            "In 10⁻⁶ N·m²/A², at the end of the run"
            @if let Some(method) = method { ", by the method " code { (method) } }
            "; ± is one standard deviation as stated by the \
             estimator. It becomes valid when its tests pass and ± is below " (format!("{:.0}", 100.0 * limit))
            " % of each λ. " @if is_paper { (coherence_note(scenario, run)) }
        }
    }
}

/// Events to mark in the plots, with their times in s.
fn events(scenario: &Scenario, run: &Run) -> Vec<(f64, String)> {
    let mut events = Vec::new();
    let time_s = &run.recording.time_s;
    let mut mark = |at_s: f64, label: String| events.push((at_s, label));
    if let Some(update) = evaluation::update(&run.recording) {
        let first = &run.recording[format!("controller.{}", scenario.machine.of_magnets("lambdaUsed")[0])];
        let again = first.last() != first.get(update);
        mark(time_s[update - 1], if again { "first update".into() } else { "update".into() });
    }
    if let Some(at_s) = scenario.balance_s {
        mark(at_s, "correction masses".into());
    }
    for profile in &scenario.profiles {
        for target in &profile.targets {
            let path = scenario.path(*target);
            let (_, name) = path.split_once('.').unwrap_or_default();
            let (name, magnet) = name.trim_end_matches(']').split_once('[').unwrap_or((name, ""));
            let prefix = scenario.machine.bearing_of(name).prefix;
            for (at_s, value) in profile.time_s.iter().zip(&profile.values).filter(|(at_s, _)| **at_s > 0.0) {
                let on = value.clone().as_f64() != 0.0;
                let label = match name.strip_prefix(prefix).unwrap_or(name) {
                    "coil.open" if on => format!("coil {prefix}{magnet} opens"),
                    "coil.open" => format!("coil {prefix}{magnet} closes"),
                    "lambda" => format!("{prefix}λ{magnet} changes"),
                    "reset" if on => "estimator reset".into(),
                    _ => continue,
                };
                mark(*at_s, label);
            }
        }
    }
    for (bearing, name) in scenario.machine.bearings.iter().zip(scenario.machine.of_contact()) {
        let contact = &run.recording[format!("plant.{name}")];
        let of = bearing.located("at");
        if let Some(at) = contact.windows(2).position(|pair| pair == [0.0, 1.0]) {
            mark(time_s[at + 1], format!("touchdown{of}"));
        }
        if let Some(at) = contact.windows(2).rposition(|pair| pair == [1.0, 0.0]) {
            mark(time_s[at + 1], format!("contact ends{of}"));
        }
    }
    events
}

/// The report page of a run with all its signals, made by `command`. A sentence replaces each figure without usable values.
pub fn page(name: &Path, command: &str, scenario: &Scenario, run: &Run) -> String {
    let sensitivities = evaluation::sensitivities(scenario, run);
    let mut tables = tables(name, scenario, run);
    tables.extend(evaluation::table(scenario, run, &sensitivities));
    let answers = answers(scenario, run);
    let signals = Signals {
        scenario,
        recording: &run.recording,
        methods: methods(scenario),
        best: answers[0].0,
        truth: scenario.truth(),
        stretches: evaluation::stretches(&run.recording),
        axes: evaluation::axes(scenario.machine, &run.recording),
        events: events(scenario, run),
        sensitivities: &sensitivities,
        paper: paper(name, scenario),
    };
    let answer = html! {
        (answers[0].1)
        (figures::first(&signals))
        @if let Some((_, used)) = answers.get(1) {
            h2 { "The estimate that the controller uses" }
            (used)
        }
    };
    let report = Report {
        title: &scenario.title,
        time_s: Some(&run.recording.time_s),
        description: &scenario.description,
        command,
        message: run.error.as_deref(),
        views: figures::views(&signals),
        tables,
        parameters: parameters(scenario),
    };
    report.page(&answer, &figures::all(&signals))
}

/// All parameters and unconnected inputs of the loop.
fn parameters(scenario: &Scenario) -> Vec<(&str, Vec<[String; 3]>)> {
    let of_element = |element: &Element| -> Vec<[String; 3]> {
        let own = element.model_type.variables().iter().enumerate();
        let own = own.filter(|(index, _)| scenario.settable(&element.path(*index)).is_ok());
        own.map(|(_, variable)| {
            let value = element.value(&variable.name).expect("the variable is in the table");
            [variable.name.to_string(), shown(variable, value), variable.description.to_string()]
        })
        .collect()
    };
    scenario.in_loop().iter().map(|element| (element.name.as_str(), of_element(element))).collect()
}

/// A value in its display unit.
fn shown(variable: &Variable, value: Value) -> String {
    match (&variable.data_type, value) {
        (Type::Real { unit, display, .. }, Value::Real(value)) => {
            // Positions along a shaft have the display unit of its displacements.
            let display = if unit.name == "m" && value.abs() >= LONG_M { Some("mm") } else { *display };
            let display = unit.displays.iter().find(|candidate| Some(candidate.name) == display);
            match display {
                Some(display) => format!("{} {}", rounded(value * display.factor + display.offset), display.name),
                None if unit.name == "1" => rounded(value),
                None => format!("{} {}", rounded(value), unit.name),
            }
        }
        (Type::Enumeration { items, .. }, Value::Integer(value)) => items.item(value).unwrap_or("?").into(),
        (_, Value::Integer(value)) => value.to_string(),
        (_, Value::Boolean(value)) => value.to_string(),
        (_, Value::String(value)) => value,
        (_, value) => rounded(value.as_f64()),
    }
}

/// A number without the rounding errors of a unit conversion.
fn rounded(value: f64) -> String {
    let rounded: f64 = format!("{value:.11e}").parse().unwrap_or(value);
    rounded.to_string()
}
