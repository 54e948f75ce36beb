//! The results of a run as tables.

use super::evaluation;
use super::experiment::{PAPER_LAMBDA, coherence_note, methods};
use super::percent;
use crate::simulation::synchronous::{self, INTERVAL_S};
use crate::simulation::{Run, Scenario};
use crate::table::Table;

/// Reduction of the perturbation estimates that the paper reports.
const PAPER_RATIO: &str = "at least 3";
/// Instants at which estimates of several methods are compared.
const INSTANTS_S: [f64; 2] = [0.1, 0.2];

/// All tables; with `paper` the scenario is the paper's, and its numbers are added for comparison.
pub fn all(scenario: &Scenario, run: &Run, paper: bool) -> Vec<Table> {
    let compared = scenario.compared_estimators().len() > 1;
    let mut tables = vec![if compared { comparison(scenario, run, paper) } else { constants(scenario, run) }];
    tables.extend(unbalance(scenario, run));
    tables.extend(balance(scenario, run));
    tables.extend(tracking(scenario, run, paper));
    tables
}

/// λ̂ of every method at the instants, beside the true values and the paper's.
fn comparison(scenario: &Scenario, run: &Run, paper: bool) -> Table {
    let truth = scenario.truth();
    let of_magnets = |symbol: &str| scenario.machine.symbols(symbol);
    let values = |lambda: &[f64]| lambda.iter().map(|value| format!("{:.4}", value * 1e6)).collect::<Vec<_>>();
    let row = |name: String, lambda: &[f64], valid: &str| {
        let errors = lambda.iter().zip(&truth).map(|(lambda, truth)| short_percent(100.0 * (lambda / truth - 1.0)));
        [vec![name], values(lambda), errors.collect(), vec![valid.to_owned()]].concat()
    };
    let mut rows = vec![[vec!["truth".to_owned()], values(&truth), vec![String::new(); truth.len() + 1]].concat()];
    if paper {
        rows.push(row("paper, figure 2".into(), &PAPER_LAMBDA, ""));
    }
    let end_s = run.recording.time_s.last().copied().filter(|end_s| !paper && *end_s > INSTANTS_S[1]);
    for instant_s in INSTANTS_S.into_iter().chain(end_s) {
        let Some(at) = run.recording.time_s.iter().position(|time_s| *time_s >= instant_s - 1e-9) else { continue };
        for [element, label] in methods(scenario) {
            let value = |name: &str| run.recording[format!("{element}.{name}")][at];
            let lambda: Vec<f64> = scenario.machine.of_magnets("lambdaHat").iter().map(|name| value(name)).collect();
            let valid = if value("valid") == 1.0 { "yes" } else { "no" };
            rows.push(row(format!("{label} at {instant_s} s"), &lambda, valid));
        }
    }
    let head = [vec![String::new()], of_magnets("λ"), of_magnets("error "), vec!["valid".to_owned()]];
    let note = coherence_note(scenario, run) + &literal_note(scenario, run, &truth);
    Table::new("Estimated force constants, 10⁻⁶ N·m²/A², and their errors", note, head.concat(), rows)
}

/// The greatest error of P(20) taken literally, if it was run.
fn literal_note(scenario: &Scenario, run: &Run, truth: &[f64]) -> String {
    if !scenario.compared_estimators().iter().any(|element| element.name == "paperLiteral") {
        return String::new();
    }
    let of_magnet = |(k, truth): (usize, &f64)| {
        let column = &run.recording[format!("paperLiteral.lambdaHat[{}]", k + 1)];
        let late = run.recording.time_s.iter().zip(column).filter(|(time_s, _)| **time_s >= INSTANTS_S[0]);
        late.map(|(time_s, value)| ((value / truth - 1.0).abs(), *time_s)).collect::<Vec<_>>()
    };
    let errors = truth.iter().enumerate().flat_map(of_magnet);
    let worst = errors.filter(|error| error.0 > 0.0).reduce(|one, other| if other.0 > one.0 { other } else { one });
    let Some((worst, at_s)) = worst else { return String::new() };
    let (from_s, percent) = (INSTANTS_S[0], 100.0 * worst);
    format!(
        "Equation (20) to the letter (paperLiteral) divides by a signed determinant that passes through zero: its greatest \
         error after {from_s} s is {percent:.0} %, at {at_s:.4} s."
    )
}

fn short_percent(value: f64) -> String {
    match value.abs() {
        size if size < 0.005 => "0.00 %".into(),
        size if size < 1000.0 => format!("{value:+.2} %"),
        _ => format!("{value:+.1e} %"),
    }
}

/// The final estimates with ±, and the k_i and k_s that follow from them.
fn constants(scenario: &Scenario, run: &Run) -> Table {
    let machine = scenario.machine;
    let symbols = machine.symbols("λ");
    let names = ["lambdaHat", "lambdaStdTotal", "ki", "ks"].map(|name| machine.of_magnets(name));
    let row = |(k, truth): (usize, f64)| {
        let last = |names: &Vec<String>| run.recording[format!("estimator.{}", names[k])].last().copied();
        let [hat, std, ki, ks] = names.each_ref().map(|names| last(names).unwrap_or(f64::NAN));
        vec![
            symbols[k].clone(),
            format!("{:.4}", truth * 1e6),
            format!("{:.4}", hat * 1e6),
            percent(hat / truth - 1.0),
            format!("{:.2} %", 100.0 * std / hat),
            format!("{ki:.1}"),
            format!("{ks:.0}"),
        ]
    };
    let valid = match &run.recording["estimator.valid"] {
        [.., 1.0] => "Valid at the end of the run",
        valid if valid.contains(&1.0) => "Not valid at the end of the run",
        _ => "Never valid: these are the first guesses",
    };
    let note = format!("{valid}. ± is one standard deviation; ki in N/A and ks in N/m at the operating point.");
    let head = ["", "truth", "estimate", "error", "±", "ki", "ks"];
    let rows = scenario.truth().into_iter().enumerate().filter(|(k, _)| scenario.uses(*k)).map(row);
    Table::new("Estimated force constants, 10⁻⁶ N·m²/A²", note, head, rows)
}

fn unbalance(scenario: &Scenario, run: &Run) -> Option<Table> {
    let machine = scenario.machine;
    let end_s = scenario.balance_s.unwrap_or(f64::INFINITY) - 1e-9;
    let last = run.recording.time_s.partition_point(|time_s| *time_s < end_s).saturating_sub(1);
    let row = |plane: usize| {
        let name = |what: &str| machine.of_planes(what).swap_remove(plane);
        let of = |what: &str| {
            (scenario.number("plant", &name(what)), run.recording[format!("estimator.{}", name(what))][last])
        };
        let ((size, size_hat), (phase, phase_hat)) = (of("magnitude"), of("phase"));
        let position = scenario.real(&name("position"));
        (size > 0.0).then_some(vec![
            position.map_or_else(String::new, |at_m| format!("plane {}, {} mm", plane + 1, 1e3 * at_m)),
            format!("{:.2}", 1e6 * size),
            format!("{:.2}", 1e6 * size_hat),
            format!("{phase:.4}"),
            format!("{phase_hat:.4}"),
        ])
    };
    let rows: Vec<_> = (0..machine.planes).map_while(row).collect();
    let before = scenario.balance_s.map(|balance_s| format!(", before the correction masses at {balance_s} s"));
    let title = if machine.planes > 1 { "Unbalance in two planes" } else { "Unbalance" };
    let note = format!("Magnitude in g·mm, angle on the rotor in rad{}.", before.unwrap_or_default());
    (!rows.is_empty()).then(|| Table::new(title, note, ["", "truth", "estimate", "angle", "estimate"], rows))
}

/// Synchronous forces before and after the correction masses.
pub fn balance(scenario: &Scenario, run: &Run) -> Option<Table> {
    let (balance_s, end_s) = (scenario.balance_s?, *run.recording.time_s.last()?);
    if end_s - balance_s < INTERVAL_S - 1e-9 {
        return None;
    }
    let [before, after] = [balance_s, end_s].map(|end_s| synchronous::forces(&run.recording, end_s));
    let (before, after) = (before?, after?);
    let rows = ["A, y", "A, z", "B, y", "B, z"].into_iter().zip(before.into_iter().zip(after));
    let row = |(name, (before, after)): (&str, (f64, f64))| {
        let removed = if before > 0.0 { format!("{:.1} %", 100.0 * (1.0 - after / before)) } else { "–".into() };
        vec![name.into(), format!("{before:.3}"), format!("{after:.3}"), removed]
    };
    let note = format!(
        "Amplitude at the frequency of the rotor, over {INTERVAL_S} s before the correction masses and at the end."
    );
    let head = ["", "before", "after", "removed"];
    Some(Table::new("Synchronous force of the magnets, N", note, head, rows.map(row)))
}

/// Tracking errors and peak-to-peak values of the perturbation estimates, before and after the update or at the end of the run.
fn tracking(scenario: &Scenario, run: &Run, is_paper: bool) -> Option<Table> {
    let machine = scenario.machine;
    let stretches = evaluation::stretches(&run.recording);
    let is_update = stretches.len() > 1;
    let mut rows = Vec::new();
    let mut row = |name: String, factor: f64, unit: &str, paper: &str, signal: &[f64], size: fn(&[f64]) -> f64| {
        let values: Vec<f64> = stretches.iter().map(|stretch| factor * size(stretch.of(signal))).collect();
        let mut cells = vec![name];
        cells.extend(values.iter().map(|value| format!("{value:.3}")));
        cells.push(unit.into());
        if let [before, after] = values[..] {
            cells.push(if after > 0.0 { format!("{:.1}", before / after) } else { String::new() });
            // The paper's numbers belong to its own scenario only.
            cells.extend(is_paper.then(|| paper.to_owned()));
        }
        rows.push(cells);
    };
    for axis in evaluation::axes(machine, &run.recording) {
        let name = format!("largest tracking error, {}", axis.reading.axis);
        row(name, 1e6, "µm", "slightly smaller after", &axis.error, evaluation::largest);
    }
    let observed = machine.of_loads("p", "Hat").into_iter().map(|name| format!("controller.{name}"));
    let truth = machine.coordinates.iter().map(|coordinate| format!("plant.{}", coordinate.perturbation));
    for (n, (observed, truth)) in observed.zip(truth).enumerate() {
        for (name, column, paper) in [("estimated", observed, PAPER_RATIO), ("true", truth, "")] {
            let name =
                format!("{name} perturbation, peak to peak, {}", machine.direction(n).trim_start_matches("along "));
            row(name, 1.0, machine.either(n, "N", "N·m"), paper, &run.recording[column], evaluation::peak_to_peak);
        }
    }
    let names = stretches.iter().map(|stretch| stretch.name);
    let compared = [Some("before : after"), is_paper.then_some("paper")].into_iter().flatten().filter(|_| is_update);
    let head = [""].into_iter().chain(names).chain(["unit"]).chain(compared);
    let update_s = evaluation::update(&run.recording).map_or(0.0, |update| run.recording.time_s[update - 1]);
    let interval = evaluation::interval(&run.recording, &stretches);
    let (title, note) = match is_update {
        true => (
            "Tracking before and after the update",
            format!(
                "Over the last {interval} before the update at {update_s} s, and over those at the end of the run."
            ),
        ),
        false => ("Tracking at the end of the run", format!("Over the last {interval}.")),
    };
    (!stretches.is_empty()).then(|| Table::new(title, note, head, rows))
}
