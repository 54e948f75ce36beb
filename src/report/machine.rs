//! The results of a run of any machine: tables, and the report page.

use maud::{Markup, html};
use serde_json::json;

use super::experiment::parameters;
use super::figures::{Figure, INDEX, Signals, lambda_plot, sensitivity};
use super::plot::{self, Line, Plot, PlotUnit, colour};
use super::{Event, Report, after_colon, evaluation, page_with, percent};
use crate::fmu::estimator::VERDICT;
use crate::machine::{Bearing, Kind, Machine};
use crate::simulation::scenario::Scenario;
use crate::simulation::simulate::Run;
use crate::simulation::synchronous::{self, INTERVAL_S};
use crate::table::Table;
use fmu_export::variable::Value;

/// Length of the intervals before the update and at the end over which errors are taken, in seconds.
const STRETCH_S: f64 = 0.04;

fn real(scenario: &Scenario, name: &str) -> Option<f64> {
    scenario.value("plant", name).map(Value::as_f64)
}

/// λ of the magnets of a bearing, in N·m²/A².
fn truth(scenario: &Scenario, bearing: &Bearing) -> Vec<f64> {
    (1..=bearing.magnets)
        .map(|k| real(scenario, &format!("{}lambda[{k}]", bearing.prefix)).unwrap_or(f64::NAN))
        .collect()
}

/// `A ` for the prefix `A.`, nothing where there is but one.
fn name_of(bearing: &Bearing) -> String {
    bearing.prefix.strip_suffix('.').map(|name| format!("{name} ")).unwrap_or_default()
}

/// `Bearing A`, or `Bearing` where there is but one.
fn title_of(bearing: &Bearing) -> String {
    format!("Bearing {}", name_of(bearing)).trim_end().to_owned()
}

/// The last value of a column.
fn last(run: &Run, name: &str) -> f64 {
    run.recording.get(name).and_then(|values| values.last().copied()).unwrap_or(f64::NAN)
}

/// The tables of results.
pub fn tables(scenario: &Scenario, run: &Run) -> Vec<Table> {
    let mut tables = vec![constants(scenario, run)];
    tables.extend(unbalance(scenario, run));
    tables.extend(balance(scenario, run));
    tables.extend(tracking(scenario, run));
    tables
}

fn constants(scenario: &Scenario, run: &Run) -> Table {
    let mut rows = Vec::new();
    for bearing in scenario.machine.bearings {
        for (k, truth) in truth(scenario, bearing).into_iter().enumerate().filter(|(k, _)| scenario.uses(*k)) {
            let of = |name: &str| last(run, &format!("estimator.{}{name}[{}]", bearing.prefix, k + 1));
            let hat = of("lambdaHat");
            rows.push(vec![
                format!("{}λ{}", name_of(bearing), k + 1),
                format!("{:.4}", truth * 1e6),
                format!("{:.4}", hat * 1e6),
                percent(hat / truth - 1.0),
                format!("{:.2} %", 200.0 * of("lambdaStdTotal") / hat),
                format!("{:.1}", of("ki")),
                format!("{:.0}", of("ks")),
            ]);
        }
    }
    let valid = if last(run, "estimator.valid") == 1.0 { "Valid" } else { "Not valid" };
    Table {
        title: "Estimated force constants, 10⁻⁶ N·m²/A²".into(),
        note: format!(
            "{valid} at the end of the run. ± is two standard deviations; ki in N/A and ks in N/m at the operating point."
        ),
        head: ["", "truth", "estimate", "error", "±", "ki", "ks"].map(String::from).into(),
        rows,
    }
}

fn unbalance(scenario: &Scenario, run: &Run) -> Option<Table> {
    if scenario.machine.planes == 0 {
        return None;
    }
    let mut rows = Vec::new();
    let machine = scenario.machine;
    for plane in 0..machine.planes {
        let name = |what: &str| machine.of_planes(what).swap_remove(plane);
        let of = |what: &str| {
            let found = run.recording.get(&format!("estimator.{}", name(what)))?;
            let before = |balance_s| run.recording.time_s.partition_point(|time_s| *time_s < balance_s - 1e-9);
            let at = scenario.balance_s.map_or(found.len(), before);
            Some((real(scenario, &name(what))?, *found.get(at.checked_sub(1)?)?))
        };
        let ((size, size_hat), (phase, phase_hat)) = (of("magnitude")?, of("phase")?);
        rows.push(vec![
            real(scenario, &name("position"))
                .map_or_else(String::new, |at_m| format!("plane {}, {} mm", plane + 1, 1e3 * at_m)),
            format!("{:.2}", 1e6 * size),
            format!("{:.2}", 1e6 * size_hat),
            format!("{:.4}", phase),
            format!("{:.4}", phase_hat),
        ]);
    }
    Some(Table {
        title: (if machine.planes > 1 { "Unbalance in two planes" } else { "Unbalance" }).into(),
        note: match scenario.balance_s {
            Some(balance_s) => {
                format!("Magnitude in g·mm, angle on the rotor in rad, before the correction masses at {balance_s} s.")
            }
            None => "Magnitude in g·mm, angle on the rotor in rad.".into(),
        },
        head: ["", "truth", "estimate", "angle", "estimate"].map(String::from).into(),
        rows,
    })
}

fn balance(scenario: &Scenario, run: &Run) -> Option<Table> {
    let before = synchronous::forces(&run.recording, scenario.balance_s?)?;
    let after = synchronous::forces(&run.recording, *run.recording.time_s.last()?)?;
    let rows = ["A, y", "A, z", "B, y", "B, z"].into_iter().zip(before.into_iter().zip(after));
    let row = |(name, (before, after)): (&str, (f64, f64))| {
        vec![
            name.into(),
            format!("{before:.3}"),
            format!("{after:.3}"),
            format!("{:.1} %", 100.0 * (1.0 - after / before)),
        ]
    };
    Some(Table {
        title: "Synchronous force of the magnets, N".into(),
        note: format!(
            "Amplitude at the frequency of the rotor, over {INTERVAL_S} s before the correction masses and at the end."
        ),
        head: ["", "before", "after", "removed"].map(String::from).into(),
        rows: rows.map(row).collect(),
    })
}

fn tracking(scenario: &Scenario, run: &Run) -> Option<Table> {
    let time_s = &run.recording.time_s;
    let end_s = *time_s.last()?;
    let update_s =
        evaluation::update_s(&run.recording).filter(|update_s| *update_s > STRETCH_S && *update_s < end_s - STRETCH_S);
    let mut stretches = Vec::new();
    stretches.extend(update_s.map(|update_s| ("before the update", update_s - STRETCH_S, update_s)));
    stretches.push(("end of the run", end_s - STRETCH_S, end_s));
    let mut rows = Vec::new();
    let machine = scenario.machine;
    for (name, reading) in machine.of_readings("e").into_iter().zip(machine.readings) {
        let error = run.recording.get(&format!("controller.{name}"))?;
        let largest = |from_s: f64, to_s: f64| {
            let within = time_s.iter().zip(error).filter(|(time_s, _)| (from_s..=to_s).contains(*time_s));
            1e6 * within.map(|(_, error)| error.abs()).fold(0.0, f64::max)
        };
        let cells = stretches.iter().map(|(_, from_s, to_s)| format!("{:.3}", largest(*from_s, *to_s)));
        rows.push([reading.axis.to_owned()].into_iter().chain(cells).collect());
    }
    Some(Table {
        title: "Largest tracking error as measured, µm".into(),
        note: format!("Over {:.0} ms each; the noise of the sensors is in it.", 1e3 * STRETCH_S),
        head: [String::new()].into_iter().chain(stretches.iter().map(|(name, ..)| (*name).to_owned())).collect(),
        rows,
    })
}

/// The report page, made by that command.
pub fn page(command: &str, scenario: &Scenario, run: &Run) -> String {
    let update = evaluation::update_s(&run.recording).map(|at_s| Event { at_s, label: "update".into() });
    let balance = scenario.balance_s.map(|at_s| Event { at_s, label: "correction masses".into() });
    let sensitivities = evaluation::sensitivities(scenario, run);
    let mut tables = tables(scenario, run);
    tables.extend(evaluation::table_of_peaks(scenario, &sensitivities));
    let report = Report {
        description: scenario.description.clone(),
        command: command.into(),
        message: run.error.clone(),
        tables,
        sensitivities,
        parameters: parameters(scenario),
        events: update.into_iter().chain(balance).collect(),
        ..Report::new(&scenario.title, &run.recording)
    };
    let signals = Signals::new(&report);
    page_with(&report, &answer(scenario, run, &signals), &figures(scenario, &signals))
}

/// The verdict, the estimates by bearing, the animation, and λ̂ over time.
fn answer(scenario: &Scenario, run: &Run, signals: &Signals) -> Markup {
    let valid = last(run, "estimator.valid") == 1.0;
    let verdict = last(run, "estimator.verdict") as usize;
    let words = VERDICT.items.get(verdict.wrapping_sub(1)).map_or("", |(_, words)| *words);
    html! {
        p class=(if valid { "verdict good" } else { "verdict bad" }) {
            strong { (if valid { "Valid" } else { "Not valid" }) } " at the end: " (after_colon(words)) "."
        }
        @if let Some(table) = balance(scenario, run) {
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
        }
        @if scenario.balance_s.is_some() { h2 { "Force constants" } }
        div.cards {
            @for bearing in scenario.machine.bearings {
                @for (k, truth) in truth(scenario, bearing).into_iter().enumerate().filter(|(k, _)| scenario.uses(*k)) {
                    @let of = |name: &str| last(run, &format!("estimator.{}{name}[{}]", bearing.prefix, k + 1));
                    div.card style={ "border-color:var(--magnet" (k + 1) ")" } {
                        span.name { (name_of(bearing)) "λ̂" sub { (k + 1) } }
                        span.value { (format!("{:.4} ± {:.4}", 1e6 * of("lambdaHat"), 2e6 * of("lambdaStdTotal"))) }
                        span.truth { (format!("truth {:.4}, error ", 1e6 * truth)) (percent(of("lambdaHat") / truth - 1.0)) }
                    }
                }
            }
        }
        p.soft { "In 10⁻⁶ N·m²/A², at the end of the run; ± is two standard deviations as stated by the estimator." }
        div.first {
            @let animation = animation(scenario, signals);
            @if let Some(data) = &animation {
                div #shaft-animation .animation { (plot::data_element(data)) }
            }
            div #lambda {
                @let bearing = &scenario.machine.bearings[0];
                (lambda_plot(signals, "estimator", bearing.prefix, Some(&truth(scenario, bearing)), 460.0).html())
                p.soft {
                    (title_of(bearing)) ": solid where the estimate is valid, with a band of two standard deviations; dotted and shaded where it is not; dashed: the \
                     true value."
                    @if animation.is_some() { " Click to go to an instant." }
                }
            }
        }
    }
}

/// Data of the animation at equidistant instants.
fn animation(scenario: &Scenario, run: &Signals) -> Option<serde_json::Value> {
    let column = |name: &str, factor: f64| run.frames_of(name, factor);
    let bearings = [real(scenario, "A.position")?, real(scenario, "B.position")?];
    Some(json!({
        "t": run.frames(run.time_s, 1.0), "theta": column("plant.theta", 1.0)?, "x": column("plant.X", 1e6)?,
        "orbits": [
            [column("plant.A.Y", 1e6)?, column("plant.A.Z", 1e6)?],
            [column("plant.B.Y", 1e6)?, column("plant.B.Z", 1e6)?],
        ],
        "valid": column("estimator.valid", 1.0),
        "bearings": bearings,
        "sensors": [real(scenario, "A.sensorPosition")?, real(scenario, "B.sensorPosition")?],
        "extent": [real(scenario, "shaft.begin")?, real(scenario, "shaft.end")?],
        "clearance": 1e6 * real(scenario, "A.touchdown.clearance").or(real(scenario, "touchdown.clearance"))?,
        "timeFactor": run.time_unit().factor,
    }))
}

fn figures(scenario: &Scenario, run: &Signals) -> Vec<Figure> {
    let mut figures = vec![
        estimates(scenario, run),
        orbits(scenario.machine, run),
        tracking_errors(scenario.machine, run),
        loads(scenario.machine, run),
    ];
    figures.extend((scenario.machine.planes > 0).then(|| unbalances(scenario, run)));
    figures.push(currents(scenario.machine, run));
    figures.extend(sensitivity(run));
    figures
}

fn estimates(scenario: &Scenario, run: &Signals) -> Figure {
    let plot = |bearing: &Bearing| {
        let truth = truth(scenario, bearing);
        (title_of(bearing), lambda_plot(run, "estimator", bearing.prefix, Some(&truth), 300.0))
    };
    let caption = "Estimates over time. Solid where valid, with a band of two standard deviations; dotted and shaded where not; dashed: the truth.";
    let plots = scenario.machine.bearings.iter().map(plot).collect();
    run.figure("estimates", "Estimates of the force constants", plots, caption)
}

fn orbits(machine: &Machine, run: &Signals) -> Figure {
    let mut plots = Vec::new();
    for bearing in machine.bearings.iter().filter(|bearing| bearing.kind == Kind::Radial) {
        let mut plot = Plot::new(("y", PlotUnit::MICROMETRE), ("z", PlotUnit::MICROMETRE)).equal().height(380.0);
        let of = |element: &str, what: &str| run.get(&format!("{element}.{}{what}", bearing.prefix));
        for (stretch, colour) in run.stretches.iter().zip([colour::MAGNETS[1], colour::MAGNETS[0]]) {
            if let (Some(y), Some(z)) = (of("plant", "Y"), of("plant", "Z")) {
                plot.line(Line::new(stretch.title(), colour), stretch.of(y), stretch.of(z));
            }
        }
        if let (Some(y), Some(z), Some(last)) =
            (of("controller", "reference.Y"), of("controller", "reference.Z"), run.stretches.last())
        {
            plot.line(Line::new("reference", colour::INK).dashed().width(1.0), last.of(y), last.of(z));
        }
        plots.push((format!("Orbit in bearing {}", name_of(bearing)).trim_end().to_owned(), plot));
    }
    let mut axial = run.plot("x", PlotUnit::MICROMETRE).height(260.0);
    if let Some(x) = run.get("plant.X") {
        run.line(&mut axial, Line::new("position", colour::MAGNETS[0]), x);
        if let Some(name) = machine.of_references().last() {
            let line = Line::new("reference", colour::INK).dashed().width(1.0);
            run.column(&mut axial, line, &format!("controller.{name}"));
        }
        plots.push(("Axial position".into(), axial));
    }
    let caption = "Orbits over two revolutions, axial position over time.";
    run.figure("orbit", "Motion", plots, caption)
}

/// A plot over time of columns with their names in the legend.
fn over_time(
    run: &Signals,
    title: &str,
    (quantity, unit): (&str, PlotUnit),
    columns: &[(String, String)],
) -> (String, Plot) {
    let mut plot = run.plot(quantity, unit).height(260.0);
    for ((name, column), colour) in columns.iter().zip(colour::MAGNETS) {
        run.column(&mut plot, Line::new(name, colour), column);
    }
    (title.to_owned(), plot)
}

fn tracking_errors(machine: &Machine, run: &Signals) -> Figure {
    let errors = machine.of_readings("e").into_iter().zip(machine.readings);
    let errors: Vec<_> = errors.map(|(name, reading)| (reading.axis, format!("controller.{name}"))).collect();
    let plot = |bearing: &Bearing| {
        let own = |column: &str| column.starts_with(&format!("controller.{}", bearing.prefix));
        let own = errors.iter().filter(|(_, column)| own(column));
        let columns: Vec<_> = own.map(|(axis, column)| (axis[..1].to_owned(), column.clone())).collect();
        over_time(run, &title_of(bearing), ("error", PlotUnit::MICROMETRE), &columns)
    };
    let caption = "Measured position minus reference; the noise of the sensors is in it.";
    run.figure("tracking", "Tracking errors", machine.bearings.iter().map(plot).collect(), caption)
}

fn loads(machine: &Machine, run: &Signals) -> Figure {
    const MOMENT: PlotUnit = PlotUnit { name: "N·m", factor: 1.0 };
    let of = |angle: bool| -> Vec<_> {
        let loads = machine.of_loads("p", "Hat").into_iter().enumerate();
        let own = loads.filter(|(n, _)| machine.coordinates[*n].is_angle == angle);
        own.map(|(n, name)| (machine.direction(n), format!("controller.{name}"))).collect()
    };
    let mut plots = vec![over_time(run, "Forces", ("force", PlotUnit::NEWTON), &of(false))];
    if !of(true).is_empty() {
        plots.push(over_time(run, "Moments", ("moment", MOMENT), &of(true)));
    }
    let caption = "Loads as the observers see them. Wrong force constants and unbalance are loads to them.";
    run.figure("loads", "Loads", plots, caption)
}

fn unbalances(scenario: &Scenario, run: &Signals) -> Figure {
    const GRAM_MILLIMETRE: PlotUnit = PlotUnit { name: "g·mm", factor: 1e6 };
    let names = scenario.machine.of_planes("magnitude");
    let columns: Vec<_> = names
        .iter()
        .enumerate()
        .map(|(plane, name)| (format!("plane {}", plane + 1), format!("estimator.{name}")))
        .collect();
    let (title, mut plot) = over_time(run, "Magnitude", ("unbalance", GRAM_MILLIMETRE), &columns);
    for truth in names.iter().filter_map(|name| real(scenario, name)) {
        plot.level(truth, "");
    }
    run.figure("unbalance", "Unbalance", vec![(title, plot)], "Identified unbalance; dashed: the truth.")
}

fn currents(machine: &Machine, run: &Signals) -> Figure {
    let plot = |bearing: &Bearing| {
        let name = |k: usize| (format!("i{}", INDEX[k]), format!("plant.{}im[{}]", bearing.prefix, k + 1));
        let columns: Vec<_> = (0..bearing.magnets).map(name).collect();
        over_time(run, &title_of(bearing), ("i", PlotUnit::AMPERE), &columns)
    };
    let caption = "The magnets only pull: the sign of a current has no meaning.";
    run.figure("currents", "Measured currents", machine.bearings.iter().map(plot).collect(), caption)
}
