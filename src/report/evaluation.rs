//! Key figures of a run for bearing engineers: displacement and clearance, harmonics of the speed, currents, voltages, loads,
//! sensitivity.

use std::f64::consts::TAU;

use super::titled;
use crate::machine::{Bearing, Machine, Reading};
use crate::simulation::synchronous::harmonic;
use crate::simulation::{Column, Recording, Run, Scenario};
use crate::studies::sensitivity::{Sensitivity, peak, zone};
use crate::studies::statistics::{mean, range, rms};
use crate::table::Table;

/// Revolutions over which the figures are evaluated, and positions are drawn beside their predictions.
pub(super) const REVOLUTIONS: f64 = 2.0;
/// The length of this interval in s if the rotor hardly turns.
pub(super) const WITHOUT_TURNING_S: f64 = 0.05;
/// Figures of two intervals are compared only if their speeds differ by no more than this fraction.
const SAME_SPEED: f64 = 0.01;

/// An interval of the run, by sample index.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Stretch {
    /// `before` or `after` the update, or `end of the run`.
    pub name: &'static str,
    /// The name as a heading.
    pub(super) title: &'static str,
    /// First sample.
    pub from: usize,
    /// One past the last sample.
    pub to: usize,
}

impl Stretch {
    /// The part of a signal in the interval.
    pub(super) fn of<'v>(&self, values: &'v [f64]) -> &'v [f64] {
        &values[self.from..self.to]
    }
}

/// The largest magnitude.
pub(super) fn largest(values: &[f64]) -> f64 {
    values.iter().fold(0.0, |largest, value| f64::max(largest, value.abs()))
}

/// The largest value minus the smallest one.
pub(super) fn peak_to_peak(values: &[f64]) -> f64 {
    let [low, high] = range(values);
    high - low
}

/// Distances of a point with these coordinates from the centre.
pub(super) fn lengths<'v>(coordinates: impl IntoIterator<Item = &'v [f64]>) -> Vec<f64> {
    let coordinates: Vec<_> = coordinates.into_iter().collect();
    let length = |at: usize| coordinates.iter().map(|values| values[at] * values[at]).sum::<f64>().sqrt();
    (0..coordinates[0].len()).map(length).collect()
}

/// Signals along the axis of a reading, in m.
pub(super) struct Axis<'r> {
    pub reading: &'static Reading,
    /// The true position.
    pub position: &'r [f64],
    pub reference: &'r [f64],
    /// Position minus reference.
    pub error: Vec<f64>,
}

/// The signals along the axes of all readings.
pub(super) fn axes<'r>(machine: &Machine, recording: &'r Recording) -> Vec<Axis<'r>> {
    let names = machine.positions().into_iter().zip(machine.of_references());
    let axis = |(reading, (position, reference)): (&'static Reading, (String, String))| {
        let [position, reference] =
            [&recording[format!("plant.{position}")], &recording[format!("controller.{reference}")]];
        let error = position.iter().zip(reference).map(|(position, reference)| position - reference).collect();
        Axis { reading, position, reference, error }
    };
    machine.readings.iter().zip(names).map(axis).collect()
}

/// The first sample that shows an estimate in use by the controller, if any; it is in use since the sample before.
pub fn update(recording: &Recording) -> Option<usize> {
    let is_used = |column: &&Column| column.name.starts_with("controller.") && column.name.contains("lambdaUsed[");
    let used = recording.columns.iter().filter(is_used);
    let changed = used.filter_map(|column| column.values.iter().position(|value| *value != column.values[0]));
    changed.min().filter(|update| *update > 1)
}

/// The last whole revolutions before the update and of the run; only the latter if there was no update, or if the final speed
/// differs too much for a comparison.
pub fn stretches(recording: &Recording) -> Vec<Stretch> {
    let time_s = &recording.time_s;
    let end = time_s.len();
    if end < 2 {
        return Vec::new();
    }
    let theta = &recording["plant.theta"];
    let begin = |to: usize| {
        let turned = |from: &usize| has_turned(theta[to - 1] - theta[*from]);
        let by_time = || time_s.partition_point(|time| *time < time_s[to - 1] - WITHOUT_TURNING_S).min(to - 1);
        (0..to).rev().find(turned).unwrap_or_else(by_time)
    };
    let speed = |stretch: &Stretch| {
        let last = stretch.to - 1;
        (theta[last] - theta[stretch.from]) / (time_s[last] - time_s[stretch.from])
    };
    let after = Stretch { name: "after", title: "After the update", from: begin(end), to: end };
    let before = |to: usize| Stretch { name: "before", title: "Before the update", from: begin(to), to };
    let comparable = |before: &Stretch| {
        let speeds = [speed(before), speed(&after)];
        before.to <= after.from && (speeds[0] - speeds[1]).abs() <= SAME_SPEED * speeds[0].abs()
    };
    match update(recording).map(before).filter(comparable) {
        Some(before) => vec![before, after],
        None => vec![Stretch { name: "end of the run", title: "End of the run", ..after }],
    }
}

/// Whether an angle in rad makes up the whole revolutions.
fn has_turned(angle_rad: f64) -> bool {
    angle_rad.abs() >= TAU * REVOLUTIONS * (1.0 - 1e-9)
}

/// The length of each of the [`stretches`] in words.
pub(super) fn interval(recording: &Recording, stretches: &[Stretch]) -> String {
    let Some(last) = stretches.last() else { return String::new() };
    let length = |values: &[f64]| values[last.to - 1] - values[last.from];
    if has_turned(length(&recording["plant.theta"])) {
        format!("{REVOLUTIONS} revolutions")
    } else {
        format!("{} ms", (1e4 * length(&recording.time_s)).round() / 10.0)
    }
}

/// The table of figures; `None` if the run is too short.
pub fn table(scenario: &Scenario, run: &Run, sensitivities: &Sensitivities) -> Option<Table> {
    let (machine, recording) = (scenario.machine, &run.recording);
    let stretches = Some(stretches(recording)).filter(|stretches| !stretches.is_empty())?;
    let theta = &recording["plant.theta"];
    let axes = axes(machine, recording);
    let mut rows: Vec<Vec<String>> = Vec::new();
    let mut row = |name: String, unit: &str, value: &dyn Fn(&Stretch) -> String| {
        let cells = stretches.iter().map(value);
        rows.push(std::iter::once(name).chain(cells).chain([unit.to_owned()]).collect());
    };
    let limit_v = scenario.number("plant", "coil.uMax");
    for (b, bearing) in machine.bearings.iter().enumerate() {
        let (Bearing { prefix, magnets, .. }, axes) = (bearing, &axes[machine.readings_of(b)]);
        let at = titled("", bearing);
        let radius = lengths(axes.iter().map(|axis| axis.position));
        row(format!("largest displacement from the centre{at}"), "µm", &|s| {
            format!("{:.2}", largest(s.of(&radius)) * 1e6)
        });
        let clearance_m = clearance_m(scenario, bearing);
        row(format!("largest displacement / clearance of {:.0} µm{at}", 1e6 * clearance_m), "%", &|s| {
            format!("{:.1}", 100.0 * largest(s.of(&radius)) / clearance_m)
        });
        let error = lengths(axes.iter().map(|axis| &axis.error[..]));
        row(format!("largest tracking error{at}"), "µm", &|s| format!("{:.3}", 1e6 * largest(s.of(&error))));
        row(format!("tracking error{at}, rms"), "µm", &|s| format!("{:.3}", 1e6 * rms(s.of(&error))));
        for axis in axes {
            row(format!("1× / 2× / 3× components of {}", axis.reading.axis), "µm", &|s| {
                let part = |n| 1e6 * harmonic(s.of(axis.position), s.of(theta), n);
                format!("{:.2} / {:.3} / {:.3}", part(1.0), part(2.0), part(3.0))
            });
        }
        for k in 1..=*magnets {
            let current = &recording[format!("plant.{prefix}im[{k}]")];
            row(format!("current of magnet {k}{at}, peak / rms"), "A", &|s| {
                format!("{:.3} / {:.3}", largest(s.of(current)), rms(s.of(current)))
            });
            // A current controller commands no voltage.
            let voltage = &recording[format!("controller.{prefix}u[{k}]")];
            if largest(voltage) > 0.0 {
                row(format!("voltage of amplifier {k}{at}, peak / headroom"), "V / %", &|s| {
                    let most = largest(s.of(voltage));
                    format!("{most:.1} / {:.0}", 100.0 * (1.0 - most / limit_v))
                });
            }
            let force = &recording[format!("plant.{prefix}F[{k}]")];
            row(format!("static load of magnet {k}{at}"), "N", &|s| format!("{:.1}", mean(s.of(force))));
        }
    }
    rows.extend(peaks(scenario, sensitivities));
    let names = stretches.iter().map(|stretch| stretch.name);
    let note = format!(
        "Over the last {}, and over those before the update if the speed is the same. Zones of ISO 14839-3: A below \
         3, B below 4, C below 5.",
        interval(recording, &stretches)
    );
    Some(Table::new("Figures of the bearing", note, [""].into_iter().chain(names).chain(["unit"]), rows))
}

/// Clearance of the backup bearing at a bearing, in m.
pub(super) fn clearance_m(scenario: &Scenario, bearing: &Bearing) -> f64 {
    scenario.number("plant", &format!("{}touchdown.clearance", bearing.prefix))
}

/// Sensitivity functions of the loop in each stretch, by its name: `[ω, |S|]` of each reading, ω in rad/s, or why they are missing.
pub type Sensitivities = Vec<(&'static str, Result<Vec<Vec<[f64; 2]>>, String>)>;

/// The sensitivity functions with the λ of the controller before and after the update, or at the end.
pub fn sensitivities(scenario: &Scenario, run: &Run) -> Sensitivities {
    let one = |stretch: &Stretch| {
        let used = |name: &String| run.recording[format!("controller.{name}")][stretch.to - 1];
        let lambda: Vec<f64> = scenario.machine.of_magnets("lambdaUsed").iter().map(used).collect();
        let curves = |found: Sensitivity| (0..scenario.machine.readings.len()).map(|n| found.curve(n)).collect();
        (stretch.name, Sensitivity::new(scenario, &lambda).map(curves))
    };
    stretches(&run.recording).iter().map(one).collect()
}

/// The peaks: a row for each axis with its name, a cell for each set of λ, and an empty unit.
fn peaks(scenario: &Scenario, sensitivities: &Sensitivities) -> Vec<Vec<String>> {
    let row = |(n, reading): (usize, &Reading)| {
        let cells = sensitivities.iter().map(|(_, curves)| match curves.as_ref().ok().and_then(|all| peak(&all[n])) {
            Some([omega, peak]) => format!("{peak:.2} at {:.0} Hz, zone {}", omega / TAU, zone(peak)),
            None => "none".into(),
        });
        let name = format!("peak of the sensitivity function of {}", reading.axis);
        [name].into_iter().chain(cells).chain([String::new()]).collect()
    };
    scenario.machine.readings.iter().enumerate().map(row).collect()
}
