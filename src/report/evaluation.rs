//! The figures of a run that matter to a bearing engineer: displacement and clearance, harmonics of the speed, currents,
//! voltages, loads, sensitivity.

use std::f64::consts::TAU;

use crate::bearing::coil::Drive;
use crate::report::SensitivityCurve;
use crate::simulation::closed_loop::Loop;
use crate::simulation::recording::Recording;
use crate::simulation::scenario::Scenario;
use crate::simulation::simulate::Run;
use crate::simulation::synchronous::harmonic;
use crate::studies::sensitivity::{NoSensitivity, SampledLoop, zone};
use crate::table::Table;

/// Revolutions over which the figures are taken, and the same time in s where the rotor hardly turns.
const REVOLUTIONS: f64 = 2.0;
const WITHOUT_TURNING_S: f64 = 0.05;
/// Figures of two intervals are compared only if their speeds differ by no more than this fraction.
const SAME_SPEED: f64 = 0.01;
/// Amplitude of the sine injected to confirm the sensitivity function, in m.
const INJECTED_M: f64 = 0.02e-6;
/// Samples of an injection, and its number of periods.
const SAMPLES: usize = 2000;
const PERIODS: [usize; 7] = [2, 6, 20, 40, 80, 160, 400];

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
pub fn table(scenario: &Scenario, run: &Run, sensitivities: &[SensitivityCurve]) -> Option<Table> {
    let stretches = Some(stretches(&run.recording)).filter(|stretches| !stretches.is_empty())?;
    let plant = scenario.closed_loop().ok()?.plant;
    let clearance_m = plant.touchdown.clearance_m;
    let get = |name: &str| run.recording.get(name);
    let [y, z, theta] = [get("plant.Y")?, get("plant.Z")?, get("plant.theta")?];
    let mut rows: Vec<Vec<String>> = Vec::new();
    let mut row = |name: String, unit: &str, value: &dyn Fn(&Stretch) -> String| {
        let cells = stretches.iter().map(value);
        rows.push(std::iter::once(name).chain(cells).chain([unit.to_owned()]).collect());
    };
    let peak = |values: &mut dyn Iterator<Item = f64>| values.fold(0.0, f64::max);
    let radius = |s: &Stretch| peak(&mut (s.from..s.to).map(|k| y[k].hypot(z[k])));
    row("largest displacement from the centre".into(), "µm", &|s| format!("{:.2}", radius(s) * 1e6));
    row("largest displacement / clearance".into(), "%", &|s| format!("{:.1}", 100.0 * radius(s) / clearance_m));
    if let (Some(ry), Some(rz)) = (get("controller.reference.Y"), get("controller.reference.Z")) {
        let error = |k: usize| (y[k] - ry[k]).hypot(z[k] - rz[k]);
        row("largest tracking error, radial".into(), "µm", &|s| {
            format!("{:.3}", 1e6 * peak(&mut (s.from..s.to).map(error)))
        });
        row("tracking error, radial, rms".into(), "µm", &|s| {
            let squares: f64 = (s.from..s.to).map(|k| error(k).powi(2)).sum();
            format!("{:.3}", 1e6 * (squares / (s.to - s.from) as f64).sqrt())
        });
    }
    for (axis, signal) in [("y", y), ("z", z)] {
        row(format!("1× / 2× / 3× components of {axis}"), "µm", &|s| {
            let part = |n| 1e6 * harmonic(&signal[s.from..s.to], &theta[s.from..s.to], n);
            format!("{:.2} / {:.3} / {:.3}", part(1.0), part(2.0), part(3.0))
        });
    }
    for k in 1..=3 {
        if let Some(current) = get(&format!("plant.im[{k}]")) {
            row(format!("current of magnet {k}, peak / rms"), "A", &|s| {
                let squares: f64 = current[s.from..s.to].iter().map(|i| i * i).sum();
                let rms = (squares / (s.to - s.from) as f64).sqrt();
                format!("{:.3} / {rms:.3}", peak(&mut current[s.from..s.to].iter().map(|i| i.abs())))
            });
        }
    }
    if plant.coil.drive == Drive::Voltage {
        let limit_v = plant.coil.limit_v;
        for k in 1..=3 {
            if let Some(voltage) = get(&format!("controller.u[{k}]")) {
                let largest = |s: &Stretch| peak(&mut voltage[s.from..s.to].iter().map(|u| u.abs()));
                row(format!("voltage of amplifier {k}, peak / headroom"), "V / %", &|s| {
                    format!("{:.1} / {:.0}", largest(s), 100.0 * (1.0 - largest(s) / limit_v))
                });
            }
        }
    }
    for k in 1..=3 {
        if let Some(force) = get(&format!("plant.F[{k}]")) {
            row(format!("static load of magnet {k}"), "N", &|s| {
                format!("{:.1}", force[s.from..s.to].iter().sum::<f64>() / (s.to - s.from) as f64)
            });
        }
    }
    for (axis, letter) in ["y", "z"].into_iter().enumerate() {
        if sensitivities.len() == stretches.len() {
            let each: Vec<String> = sensitivities.iter().map(|sensitivity| sensitivity.peak_in_words(axis)).collect();
            let mut cells = vec![format!("peak of the sensitivity function of {letter}")];
            cells.extend(each);
            cells.push("".into());
            rows.push(cells);
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
pub fn sensitivities(scenario: &Scenario, run: &Run) -> Vec<SensitivityCurve> {
    let stretches = stretches(&run.recording);
    // A run that could begin has configurations.
    let Ok(Loop { plant, input, controller, .. }) = scenario.closed_loop() else { return Vec::new() };
    let one = |stretch: &Stretch| {
        let mut lambda = [0.0; 3];
        for (k, value) in lambda.iter_mut().enumerate() {
            *value = *run.recording.get(&format!("controller.lambdaUsed[{}]", k + 1))?.get(stretch.to - 1)?;
        }
        let computed = || -> Result<_, NoSensitivity> {
            let sampled = SampledLoop::new(&plant, &controller, lambda, input.perturbation_n)?;
            let sweep = sampled.linearise()?.sweep(TAU, 200);
            let mut injected = Vec::new();
            for periods in PERIODS {
                let (omega, in_y) = sampled.inject(0, INJECTED_M, periods, SAMPLES)?;
                let (_, in_z) = sampled.inject(1, INJECTED_M, periods, SAMPLES)?;
                injected.push([omega, in_y.norm(), in_z.norm()]);
            }
            Ok((sweep, injected))
        };
        let (sweep, injected, missing) = match computed() {
            Ok((sweep, injected)) => (sweep, injected, None),
            Err(error) => (Vec::new(), Vec::new(), Some(error.to_string())),
        };
        Some(SensitivityCurve { name: stretch.name.into(), sweep, injected, missing })
    };
    stretches.iter().filter_map(one).collect()
}

impl SensitivityCurve {
    /// `[ω, |S|]` at the peak of an axis, 0 for y.
    pub fn peak(&self, axis: usize) -> Option<[f64; 2]> {
        let points = self.sweep.iter().map(|point| [point[0], point[1 + axis]]);
        points.max_by(|one, other| one[1].total_cmp(&other[1]))
    }

    fn peak_in_words(&self, axis: usize) -> String {
        match self.peak(axis) {
            Some([omega, peak]) => format!("{peak:.2} at {:.0} Hz, zone {}", omega / TAU, zone(peak)),
            None => "none".into(),
        }
    }
}
