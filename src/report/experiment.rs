//! The results of a run in numbers, and its report page.

use std::path::Path;

use super::{after_colon, evaluation, machine};
use crate::bearing::rotor::BearingConfig;
use crate::estimation::{STD_LIMIT, paper};
use crate::fmu::estimator::{METHOD, VERDICT};
use crate::machine::PLANAR;
use crate::report::{self, Answer, Bearing, ComparedEstimator, Event, Paper, Parameter, Report};
use crate::simulation::closed_loop::Loop;
use crate::simulation::scenario::Scenario;
use crate::simulation::simulate::Run;
use crate::table::Table;
use fmu_export::variable::{Type, Value, Variable};

/// Estimates in the paper: figure 2, simulation, after less than 0.1 s.
const PAPER_LAMBDA: [f64; 3] = [1.786e-6, 2.072e-6, 2.199e-6];
/// Reduction of the perturbation estimates that the paper reports.
const PAPER_RATIO: &str = "at least 3";
/// Instants at which estimates are compared.
const INSTANTS_S: [f64; 2] = [0.1, 0.2];
/// Length of the intervals before and after the update over which errors are taken, in seconds.
const STRETCH_S: f64 = 0.04;
/// Lengths from here on, in m, are shown in mm: dimensions of a machine, not displacements.
const LONG_M: f64 = 1e-3;

/// Whether the scenario is the paper's, so that its numbers can be compared with ours.
fn is_paper(name: &Path, scenario: &Scenario) -> bool {
    name == Path::new("paper") && scenario.changes.is_empty()
}

/// The configurations of a scenario that has been run, or could be.
fn closed_loop(scenario: &Scenario) -> Loop {
    scenario.closed_loop().expect("a scenario that can be run has configurations")
}

/// The estimators of a scenario: those beside the loop, or that of the loop if there are none.
fn methods(scenario: &Scenario) -> Vec<ComparedEstimator> {
    let beside = scenario.observers();
    if beside.is_empty() {
        let method = scenario.value("estimator", "method");
        let label = method.and_then(|value| METHOD.item(value.as_f64() as i32)).unwrap_or("estimator");
        return vec![ComparedEstimator { element: "estimator".into(), label: label.into() }];
    }
    beside.iter().map(|element| ComparedEstimator::from(element.name.as_str())).collect()
}

/// The tables of results of a scenario.
pub fn tables(name: &Path, scenario: &Scenario, run: &Run) -> Vec<Table> {
    if *scenario.machine != PLANAR {
        return machine::tables(scenario, run);
    }
    let mut tables = vec![estimates(scenario, run, is_paper(name, scenario))];
    tables.extend(tracking(run, is_paper(name, scenario)));
    tables
}

/// λ̂ of every method at the instants, beside the true values and the paper's.
fn estimates(scenario: &Scenario, run: &Run, paper: bool) -> Table {
    let truth = closed_loop(scenario).plant.lambda_nm2_a2;
    let head = ["", "λ1", "λ2", "λ3", "error 1", "error 2", "error 3", "valid"];
    let mut rows = Vec::new();
    let values = |lambda: [f64; 3]| lambda.map(|value| format!("{:.4}", value * 1e6));
    let errors =
        |lambda: [f64; 3]| std::array::from_fn::<String, 3, _>(|k| percent(100.0 * (lambda[k] / truth[k] - 1.0)));
    let row = |name: String, lambda: [f64; 3], valid: &str| {
        let cells = values(lambda).into_iter().chain(errors(lambda));
        std::iter::once(name).chain(cells).chain([valid.to_owned()]).collect::<Vec<_>>()
    };
    let truth_row = ["truth".to_owned()].into_iter().chain(values(truth));
    rows.push(truth_row.chain(std::iter::repeat_n(String::new(), 4)).collect::<Vec<_>>());
    if paper {
        rows.push(row("paper, figure 2".into(), PAPER_LAMBDA, ""));
    }
    let end_s = run.recording.time_s.last().copied().filter(|end_s| !paper && *end_s > INSTANTS_S[1]);
    for instant_s in INSTANTS_S.into_iter().chain(end_s) {
        for method in methods(scenario) {
            let lambda = at(run, instant_s, |k| format!("{}.lambdaHat[{k}]", method.element));
            let valid = at(run, instant_s, |_| format!("{}.valid", method.element));
            if let (Some(lambda), Some([valid, ..])) = (lambda, valid) {
                let valid = if valid == 1.0 { "yes" } else { "no" };
                rows.push(row(format!("{} at {instant_s} s", method.label), lambda, valid));
            }
        }
    }
    Table {
        title: "Estimated force constants, 10⁻⁶ N·m²/A², and their errors".into(),
        note: [coherence_note(scenario), literal_note(scenario, run, &truth)].concat(),
        head: head.map(String::from).into(),
        rows,
    }
}

/// The error that a harmonic perturbation in phase with the reference trajectory causes in any estimator that does not model
/// it.
fn coherence_note(scenario: &Scenario) -> String {
    let Loop { plant, controller, .. } = closed_loop(scenario);
    let force_n = plant.harmonic.amplitude_n[1];
    let omega = plant.harmonic.omega_rad_s;
    let path_omega = controller.reference.omega_rad_s;
    // The two come from different conversions of the same speed.
    if force_n == 0.0 || (omega / path_omega - 1.0).abs() > 1e-9 {
        return String::new();
    }
    let inertia_n = plant.rotor.shaft.m_kg * omega * omega * controller.reference.paths[0].r_z_m;
    format!(
        "The perturbation along z is in phase with the reference trajectory: {force_n} N beside m ω² r_Z = \
         {inertia_n:.1} N look like magnets weaker by {:.2} %. No filter removes that; the paper's method attributes it to λ. ",
        100.0 * force_n / (inertia_n + force_n)
    )
}

/// How large the estimates of the literal P(20) become, if it was run.
fn literal_note(scenario: &Scenario, run: &Run, truth: &[f64; 3]) -> String {
    if !scenario.observers().iter().any(|element| element.name == "paperLiteral") {
        return String::new();
    }
    let of_magnet = |(k, truth): (usize, &f64)| {
        let column = run.recording.get(&format!("paperLiteral.lambdaHat[{}]", k + 1)).unwrap_or(&[]);
        let late = run.recording.time_s.iter().zip(column).filter(|(time_s, _)| **time_s >= INSTANTS_S[0]);
        late.map(|(time_s, value)| ((value / truth - 1.0).abs(), *time_s)).collect::<Vec<_>>()
    };
    let errors = truth.iter().enumerate().flat_map(of_magnet);
    let worst = errors.fold((0.0, 0.0), |worst, error| if error.0 > worst.0 { error } else { worst });
    format!(
        "Equation (20) to the letter (paperLiteral) divides by a signed determinant that passes through zero: its greatest \
         error after {} s is {:.0} %, at {:.4} s.",
        INSTANTS_S[0],
        100.0 * worst.0,
        worst.1
    )
}

/// Three signals at an instant; `None` if the run ended before.
fn at(run: &Run, instant_s: f64, name: impl Fn(usize) -> String) -> Option<[f64; 3]> {
    let row = run.recording.time_s.iter().position(|time_s| *time_s >= instant_s - 1e-9)?;
    three(|k| run.recording.get(&name(k))?.get(row).copied())
}

/// A value of each of the three magnets, if all have one.
fn three(value: impl Fn(usize) -> Option<f64>) -> Option<[f64; 3]> {
    Some([value(1)?, value(2)?, value(3)?])
}

fn percent(value: f64) -> String {
    if value.abs() < 0.005 {
        "0.00 %".into()
    } else if value.abs() < 1000.0 {
        format!("{value:+.2} %")
    } else {
        format!("{value:+.1e} %")
    }
}

/// Tracking error and peak-to-peak value of the perturbation estimate before and after the update.
fn tracking(run: &Run, paper: bool) -> Option<Table> {
    // If the speed has changed there is nothing to compare.
    if evaluation::stretches(&run.recording).len() < 2 {
        return None;
    }
    let update_s = evaluation::update_s(&run.recording)?;
    let last_s = *run.recording.time_s.last()?;
    if last_s < update_s + STRETCH_S || update_s < STRETCH_S {
        return None;
    }
    let before = (update_s - STRETCH_S, update_s);
    let after = (last_s - STRETCH_S, last_s);
    let mut rows = Vec::new();
    for axis in ["Y", "Z"] {
        let get = |name: String| run.recording.get(&name);
        let (position, reference) = (get(format!("plant.{axis}"))?, get(format!("controller.reference.{axis}"))?);
        let error: Vec<f64> = position.iter().zip(reference).map(|(is, ought)| is - ought).collect();
        let largest = |range| over(run, &error, range).map(|(low, high)| 1e6 * high.max(-low));
        let letter = axis.to_lowercase();
        let name = format!("largest tracking error, {letter}");
        rows.push(row(name, [largest(before)?, largest(after)?], "µm", "slightly smaller after"));
        for (name, column, paper) in [
            ("estimated", format!("controller.p{axis}Hat"), PAPER_RATIO),
            ("true", format!("plant.perturbation.{axis}"), ""),
        ] {
            let signal = get(column)?;
            let peak_to_peak = |range| over(run, signal, range).map(|(low, high)| high - low);
            let name = format!("{name} perturbation, peak to peak, {letter}");
            rows.push(row(name, [peak_to_peak(before)?, peak_to_peak(after)?], "N", paper));
        }
    }
    let mut head = ["", "before", "after", "unit", "before : after", "paper"].map(String::from).to_vec();
    if !paper {
        // The paper's numbers belong to its own scenario only.
        head.pop();
        rows.iter_mut().for_each(|row| drop(row.pop()));
    }
    Some(Table {
        title: "Tracking before and after the update".into(),
        note: format!(
            "Over {:.0} ms before the update at {update_s} s and the last {:.0} ms of the run.",
            STRETCH_S * 1e3,
            STRETCH_S * 1e3
        ),
        head,
        rows,
    })
}

fn row(name: String, [before, after]: [f64; 2], unit: &str, paper: &str) -> Vec<String> {
    let ratio = if after > 0.0 { format!("{:.1}", before / after) } else { String::new() };
    vec![name, format!("{before:.3}"), format!("{after:.3}"), unit.into(), ratio, paper.into()]
}

/// Smallest and largest value over an interval.
fn over(run: &Run, signal: &[f64], (from_s, to_s): (f64, f64)) -> Option<(f64, f64)> {
    let within = run.recording.time_s.iter().zip(signal).filter(|(time_s, _)| (from_s..=to_s).contains(*time_s));
    within.map(|(_, value)| (*value, *value)).reduce(|(low, high), (value, _)| (low.min(value), high.max(value)))
}

/// The best final answer, and that of the estimator which the controller uses if it is another.
fn answers(scenario: &Scenario, run: &Run) -> [Option<Answer>; 2] {
    const BEST: &str = "predictionError";
    let used = answer(scenario, run, "estimator");
    let beside = scenario.observers().iter().any(|element| element.name == BEST);
    match used {
        Some(used) if used.method != BEST && beside => [answer(scenario, run, BEST), Some(used)],
        used => [used, None],
    }
}

/// The final answer of an estimator.
fn answer(scenario: &Scenario, run: &Run, element: &str) -> Option<Answer> {
    let column = |name: &str| run.recording.get(&format!("{element}.{name}"));
    let last = |name: &str| three(|k| column(&format!("{name}[{k}]"))?.last().copied());
    let verdicts = column("verdict")?;
    let verdict = *verdicts.last()?;
    let valid = *column("valid")?.last()? == 1.0;
    let since = verdicts.iter().rposition(|other| *other != verdict).map_or(0, |at| at + 1);
    let since_s = report::instant(run.recording.time_s[since]);
    let words = VERDICT.items.get((verdict as usize).wrapping_sub(1)).map_or("", |(_, words)| *words);
    let mut verdict = format!("since {since_s}: {}.", after_colon(words));
    if !valid {
        verdict += &match column("valid")?.iter().rposition(|valid| *valid == 1.0) {
            Some(at) => {
                let until_s = report::instant(run.recording.time_s[at]);
                format!(" It was valid until {until_s}; what is shown is that estimate.")
            }
            None => " It was never valid.".into(),
        };
    }
    let method = scenario.value(element, "method").and_then(|value| METHOD.item(value.as_f64() as i32));
    let is_paper = method.is_some_and(|method| method.starts_with("paper"));
    Some(Answer {
        element: element.into(),
        method: method.unwrap_or_default().into(),
        valid,
        verdict,
        lambda: last("lambdaHat")?,
        std: last("lambdaStdTotal")?,
        limit: if is_paper { paper::STD_LIMIT } else { STD_LIMIT },
        expectation: if is_paper { coherence_note(scenario) } else { String::new() },
    })
}

/// Events to mark in the plots: updates, coils that open and close, changes of λ, touchdown.
fn events(scenario: &Scenario, run: &Run) -> Vec<Event> {
    let mut events = Vec::new();
    let time_s = &run.recording.time_s;
    let mut mark = |at_s: f64, label: String| events.push(Event { at_s, label });
    if let Some(update) = evaluation::update(&run.recording) {
        let more = run.recording.get("controller.lambdaUsed[1]").unwrap_or(&[]);
        let again = more.last() != more.get(update);
        mark(
            evaluation::update_s(&run.recording).unwrap_or(time_s[update]),
            if again { "first update".into() } else { "update".into() },
        );
    }
    for profile in &scenario.profiles {
        for target in &profile.targets {
            let path = scenario.path(*target);
            let (_, name) = path.split_once('.').unwrap_or_default();
            let magnet = name.trim_end_matches(']').rsplit('[').next().unwrap_or_default();
            for (at_s, value) in profile.time_s.iter().zip(&profile.values).filter(|(at_s, _)| **at_s > 0.0) {
                let on = value.clone().as_f64() != 0.0;
                let label = match name.split('[').next().unwrap_or_default() {
                    "coil.open" if on => format!("coil {magnet} opens"),
                    "coil.open" => format!("coil {magnet} closes"),
                    "lambda" => format!("λ{magnet} changes"),
                    "reset" if on => "estimator reset".into(),
                    _ => continue,
                };
                mark(*at_s, label);
            }
        }
    }
    let contact = run.recording.get("plant.touchdown.contact").unwrap_or(&[]);
    let touches = |pair: &[f64]| pair[0] == 0.0 && pair[1] == 1.0;
    if let Some(at) = contact.windows(2).position(touches) {
        mark(time_s[at + 1], "touchdown".into());
    }
    if let Some(at) = contact.windows(2).rposition(|pair| pair[0] == 1.0 && pair[1] == 0.0) {
        mark(time_s[at + 1], "contact ends".into());
    }
    events
}

/// The report page of a run of a scenario, made by that command.
pub fn page(name: &Path, command: &str, scenario: &Scenario, run: &Run) -> String {
    if *scenario.machine != PLANAR {
        return machine::page(command, scenario, run);
    }
    let sensitivities = evaluation::sensitivities(scenario, run);
    let mut tables = tables(name, scenario, run);
    tables.extend(evaluation::table(scenario, run, &sensitivities));
    let paper = match name.to_str() {
        _ if !scenario.changes.is_empty() => None,
        Some("paper") => Some(Paper::Simulation),
        Some("experiment") => Some(Paper::Experiment),
        _ => None,
    };
    let plant = closed_loop(scenario).plant;
    let BearingConfig { alpha_rad: [a, b, c, ..], gap_m, .. } = plant.rotor.bearings[0];
    let bearing = Bearing { alpha_rad: [a, b, c], gap_m, clearance_m: plant.touchdown[0].clearance_m };
    let [answer, used] = answers(scenario, run);
    let report = Report {
        description: scenario.description.clone(),
        command: command.into(),
        message: run.error.clone(),
        answer,
        used,
        tables,
        sensitivities,
        bearing: Some(bearing),
        parameters: parameters(scenario),
        events: events(scenario, run),
        truth: Some(plant.lambda_nm2_a2),
        methods: methods(scenario),
        paper,
        ..Report::new(&scenario.title, &run.recording)
    };
    report::page(&report)
}

/// All parameters and unconnected inputs of the loop.
pub(super) fn parameters(scenario: &Scenario) -> Vec<Parameter> {
    let connections = scenario.connections();
    let mut parameters = Vec::new();
    for element in scenario.in_loop() {
        for variable in element.model_type.variables() {
            let connected = connections
                .iter()
                .any(|connection| connection.to[0] == element.name && connection.to[1] == variable.name);
            if variable.is_settable() && !connected {
                let value = scenario.value(&element.name, &variable.name).expect("the variable is in the table");
                parameters.push(Parameter {
                    group: element.name.clone(),
                    name: variable.name.to_string(),
                    value: shown(variable, value),
                    description: variable.description.to_string(),
                });
            }
        }
    }
    parameters
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

/// A number without the digits that a unit conversion adds.
fn rounded(value: f64) -> String {
    let rounded: f64 = format!("{value:.11e}").parse().unwrap_or(value);
    rounded.to_string()
}
