//! The figures of a run that matter to a bearing engineer: displacement and clearance, harmonics of the speed, currents,
//! voltages, loads, sensitivity.

use std::f64::consts::TAU;

use crate::bearing::coil::Drive;
use crate::machine::Reading;
use crate::report::SensitivityCurves;
use crate::simulation::recording::Recording;
use crate::simulation::scenario::Scenario;
use crate::simulation::simulate::Run;
use crate::simulation::synchronous::harmonic;
use crate::studies::sensitivity::{Sensitivity, peak, zone};
use crate::table::Table;

/// Revolutions over which the figures are taken, and the same time in s where the rotor hardly turns.
const REVOLUTIONS: f64 = 2.0;
const WITHOUT_TURNING_S: f64 = 0.05;
/// Figures of two intervals are compared only if their speeds differ by no more than this fraction.
const SAME_SPEED: f64 = 0.01;
/// An interval of the run, by sample index.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Stretch {
    /// `before` or `after` the update, or `end of the run`.
    pub name: &'static str,
    /// First sample.
    pub from: usize,
    /// One past the last sample.
    pub to: usize,
}

impl Stretch {
    /// The name as a heading.
    #[must_use]
    pub fn title(&self) -> &'static str {
        match self.name {
            "before" => "Before the update",
            "after" => "After the update",
            _ => "End of the run",
        }
    }

    /// The part of a signal within it.
    pub(super) fn of<'v>(&self, values: &'v [f64]) -> &'v [f64] {
        &values[self.from..self.to]
    }
}

fn largest(values: &[f64]) -> f64 {
    values.iter().fold(0.0, |largest, value| f64::max(largest, value.abs()))
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// The sample at which the controller first used an estimate, if any.
#[must_use]
pub fn update(recording: &Recording) -> Option<usize> {
    let used = recording
        .columns
        .iter()
        .filter(|column| column.name.strip_prefix("controller.").is_some_and(|name| name.contains("lambdaUsed[")));
    let changed = used.filter_map(|column| column.values.iter().position(|value| *value != column.values[0]));
    changed.min().filter(|update| *update > 1)
}

/// When the controller first used an estimate, in s: at the begin of the step after which its output shows it.
#[must_use]
pub fn update_s(recording: &Recording) -> Option<f64> {
    update(recording).map(|update| recording.time_s[update - 1])
}

/// The last whole revolutions before the update and those of the run; only the latter if there was no update, or if the final
/// speed differs, which leaves nothing to compare.
#[must_use]
pub fn stretches(recording: &Recording) -> Vec<Stretch> {
    let time_s = &recording.time_s;
    let end = time_s.len();
    let Some(theta) = recording.get("plant.theta").filter(|theta| theta.len() == end && end > 1) else {
        return Vec::new();
    };
    let begin = |to: usize| {
        let turned = |from: &usize| (theta[to - 1] - theta[*from]).abs() >= TAU * REVOLUTIONS * (1.0 - 1e-9);
        let by_time = || time_s.partition_point(|time| *time < time_s[to - 1] - WITHOUT_TURNING_S).min(to - 1);
        (0..to).rev().find(turned).unwrap_or_else(by_time)
    };
    let speed = |stretch: &Stretch| {
        let last = stretch.to - 1;
        (theta[last] - theta[stretch.from]) / (time_s[last] - time_s[stretch.from])
    };
    let after = Stretch { name: "after", from: begin(end), to: end };
    let before = update(recording).map(|update| Stretch { name: "before", from: begin(update), to: update });
    let alike = |before: &Stretch| {
        let speeds = [speed(before), speed(&after)];
        before.to <= after.from && (speeds[0] - speeds[1]).abs() <= SAME_SPEED * speeds[0].abs()
    };
    match before.filter(alike) {
        Some(before) => vec![before, after],
        None => vec![Stretch { name: "end of the run", ..after }],
    }
}

/// The table of figures; `None` if the recording is too short.
pub fn table(scenario: &Scenario, run: &Run, sensitivities: &[SensitivityCurves]) -> Option<Table> {
    let stretches = Some(stretches(&run.recording)).filter(|stretches| !stretches.is_empty())?;
    let plant = scenario.closed_loop().ok()?.plant;
    let clearance_m = plant.touchdown[0].clearance_m;
    let get = |name: &str| run.recording.get(name);
    let [y, z, theta] = [get("plant.Y")?, get("plant.Z")?, get("plant.theta")?];
    let mut rows: Vec<Vec<String>> = Vec::new();
    let mut row = |name: String, unit: &str, value: &dyn Fn(&Stretch) -> String| {
        let cells = stretches.iter().map(value);
        rows.push(std::iter::once(name).chain(cells).chain([unit.to_owned()]).collect());
    };
    let lengths = |y: &[f64], z: &[f64]| y.iter().zip(z).map(|(y, z)| y.hypot(*z)).collect::<Vec<_>>();
    let rms = |values: &[f64]| mean(&values.iter().map(|value| value * value).collect::<Vec<_>>()).sqrt();
    let radius = lengths(y, z);
    row("largest displacement from the centre".into(), "µm", &|s| format!("{:.2}", largest(s.of(&radius)) * 1e6));
    row("largest displacement / clearance".into(), "%", &|s| {
        format!("{:.1}", 100.0 * largest(s.of(&radius)) / clearance_m)
    });
    if let (Some(ry), Some(rz)) = (get("controller.reference.Y"), get("controller.reference.Z")) {
        let misses = |is: &[f64], ought: &[f64]| is.iter().zip(ought).map(|(is, ought)| is - ought).collect::<Vec<_>>();
        let error = lengths(&misses(y, ry), &misses(z, rz));
        row("largest tracking error, radial".into(), "µm", &|s| format!("{:.3}", 1e6 * largest(s.of(&error))));
        row("tracking error, radial, rms".into(), "µm", &|s| format!("{:.3}", 1e6 * rms(s.of(&error))));
    }
    for (axis, signal) in [("y", y), ("z", z)] {
        row(format!("1× / 2× / 3× components of {axis}"), "µm", &|s| {
            let part = |n| 1e6 * harmonic(s.of(signal), s.of(theta), n);
            format!("{:.2} / {:.3} / {:.3}", part(1.0), part(2.0), part(3.0))
        });
    }
    for k in 1..=3 {
        if let Some(current) = get(&format!("plant.im[{k}]")) {
            row(format!("current of magnet {k}, peak / rms"), "A", &|s| {
                format!("{:.3} / {:.3}", largest(s.of(current)), rms(s.of(current)))
            });
        }
    }
    if plant.coil.drive == Drive::Voltage {
        let limit_v = plant.coil.limit_v;
        for k in 1..=3 {
            if let Some(voltage) = get(&format!("controller.u[{k}]")) {
                row(format!("voltage of amplifier {k}, peak / headroom"), "V / %", &|s| {
                    let most = largest(s.of(voltage));
                    format!("{most:.1} / {:.0}", 100.0 * (1.0 - most / limit_v))
                });
            }
        }
    }
    for k in 1..=3 {
        if let Some(force) = get(&format!("plant.F[{k}]")) {
            row(format!("static load of magnet {k}"), "N", &|s| format!("{:.1}", mean(s.of(force))));
        }
    }
    if sensitivities.len() == stretches.len() {
        for mut row in peaks(scenario, sensitivities) {
            row[0] = format!("peak of the sensitivity function of {}", row[0]);
            row.push(String::new());
            rows.push(row);
        }
    }
    let head = std::iter::once(String::new())
        .chain(stretches.iter().map(|stretch| stretch.name.to_owned()))
        .chain(["unit".to_owned()])
        .collect();
    Some(Table {
        title: "Figures of the bearing".into(),
        note: format!(
            "Over the last {REVOLUTIONS} revolutions; where there was an update, and the speed is the same, also over those before it. The \
             clearance of the backup bearing is {:.0} µm. Zones of ISO 14839-3: A below 3, B below 4, C below 5.",
            clearance_m * 1e6
        ),
        head,
        rows,
    })
}

/// Sensitivity functions before and after the update, or the only one; with the reason where there is none.
pub fn sensitivities(scenario: &Scenario, run: &Run) -> Vec<SensitivityCurves> {
    let one = |stretch: &Stretch| {
        let used = |name: &String| run.recording.get(&format!("controller.{name}"))?.get(stretch.to - 1).copied();
        let lambda = scenario.machine.of_magnets("lambdaUsed").iter().map(used).collect::<Option<Vec<_>>>()?;
        let name = stretch.name.to_owned();
        let readings = scenario.machine.readings.iter().enumerate();
        Some(match Sensitivity::new(scenario, &lambda) {
            Ok(found) => {
                let axes = readings.map(|(n, reading)| (reading.axis.to_owned(), found.curve(n))).collect();
                SensitivityCurves { name, axes, missing: None }
            }
            Err(why) => SensitivityCurves { name, axes: Vec::new(), missing: Some(why.to_string()) },
        })
    };
    stretches(&run.recording).iter().filter_map(one).collect()
}

/// The peaks: a row for each axis, with a column for each set of λ after its name.
fn peaks(scenario: &Scenario, sensitivities: &[SensitivityCurves]) -> Vec<Vec<String>> {
    let peak_in_words =
        |curves: &SensitivityCurves, n: usize| match curves.axes.get(n).and_then(|(_, curve)| peak(curve)) {
            Some([omega, peak]) => format!("{peak:.2} at {:.0} Hz, zone {}", omega / TAU, zone(peak)),
            None => "none".into(),
        };
    let row = |(n, reading): (usize, &Reading)| {
        let cells = sensitivities.iter().map(|curves| peak_in_words(curves, n));
        [reading.axis.to_owned()].into_iter().chain(cells).collect()
    };
    scenario.machine.readings.iter().enumerate().map(row).collect()
}

/// The peaks as a table.
pub fn table_of_peaks(scenario: &Scenario, sensitivities: &[SensitivityCurves]) -> Option<Table> {
    let names = sensitivities.iter().map(|curves| curves.name.clone());
    (!sensitivities.is_empty()).then(|| Table {
        title: "Peak of the sensitivity function".into(),
        note: "Zones of ISO 14839-3: A below 3, B below 4, C below 5.".into(),
        head: [String::new()].into_iter().chain(names).collect(),
        rows: peaks(scenario, sensitivities),
    })
}
