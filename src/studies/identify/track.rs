//! The on-line estimator of a machine over a recording, run as an importer runs its FMU.

use std::f64::consts::TAU;
use std::ops::Range;

use fmu_export::Step;
use fmu_export::log::Silent;
use fmu_export::variable::Value;
use serde_json::{Map, Value as Json, json};

use super::Statement;
use super::samples::Samples;
use super::units::significant;
use crate::estimation::{Hold, Method, STD_LIMIT, Verdict};
use crate::machine::{Bearing, Machine, PLANAR};
use crate::simulation::{Column, Element, Recording, simulate};
use crate::table::Table;
use crate::variables::Choice;

/// An estimator over a whole recording.
#[derive(Clone)]
pub struct Track {
    /// The machine.
    pub machine: &'static Machine,
    /// The estimator with its parameters.
    pub estimator: Element,
    /// Its outputs by name, after every n-th sample.
    pub outputs: Recording,
}

/// Outputs of each magnet.
const OF_MAGNETS: [&str; 5] = ["lambdaHat", "lambdaStd", "lambdaStdTotal", "ki", "ks"];
/// Note below the estimates over time.
const DRIFT: &str = "± of noise alone. Values that drift from line to line mean that the bearing changes.";

/// Runs an estimator over a recording and keeps the outputs of every n-th sample: those of all samples need more memory than the recording.
///
/// # Errors
/// Parameters that the estimator refuses.
pub fn track(samples: &Samples, estimator: &Element, every: usize) -> Result<Track, String> {
    let (machine, mut estimator) = (samples.machine, estimator.clone());
    estimator.set("Ts", Value::Real(samples.step_s));
    // Without the angle of the rotor, the phase of an unbalance is unknown. The paper's methods use neither this setting nor tolerances.
    if chosen::<Method>(&estimator, "method") == Method::PredictionError {
        if samples.theta_rad.is_empty() {
            estimator.set("identify.unbalance", Value::Boolean(false));
        }
    } else {
        let variables = estimator.model_type.clone();
        estimator.settings.retain(|(at, _)| !variables.variables()[*at].name.starts_with("tolerance."));
        estimator.set("identify.unbalance", Value::Boolean(true));
    }
    let refused = |why: String| format!("the estimator cannot be started: {why}");
    let mut instance = simulate::start(&estimator).map_err(|findings| refused(findings.join("; ")))?;
    let index = |name: &String| estimator.index(name).expect("a variable of the estimator");
    let rotation = ["theta", "omega"].map(str::to_owned);
    let currents = samples.currents(chosen(&estimator, "hold"));
    let recorded = samples.position_m.iter().chain(&currents);
    let inputs = machine.measured().into_iter().chain(machine.of_magnets("im")).chain(rotation);
    let inputs: Vec<usize> = inputs.map(|name| index(&name)).collect();
    let places: Vec<u32> = inputs.iter().map(|index| *index as u32).collect();
    // If the speed is unknown, methods that need one assume a revolution per window.
    let usual_rad_s = estimator.value("Tf").map_or(0.0, |window_s| TAU / window_s.as_f64());
    let (names, every) = (kept(machine), every.max(1));
    let outputs: Vec<usize> = names.iter().map(index).collect();
    let unit = |index: &usize| estimator.model_type.variables()[*index].unit_name().into();
    let column = |(name, index)| Column { name, unit: unit(index), values: Vec::new() };
    let mut columns: Vec<Column> = names.into_iter().zip(&outputs).map(column).collect();
    let (mut time_s, mut values) = (Vec::new(), Vec::with_capacity(inputs.len()));
    // For the planar machine short gaps stay filled: the paper's methods cannot bridge any.
    let has_gaps = *machine != PLANAR;
    instance.set(index(&"enable".into()), Value::Boolean(true)).map_err(|why| refused(why.to_string()))?;
    for j in 0..samples.len() {
        let theta_rad = samples.theta_rad.get(j).copied().unwrap_or(0.0);
        let omega_rad_s = samples.omega_rad_s.get(j).copied().unwrap_or(usual_rad_s);
        let is_gap = has_gaps && samples.missing.get(j).is_some_and(|missing| *missing != 0);
        values.clear();
        values.extend(recorded.clone().map(|column| if is_gap { f64::NAN } else { column[j] }));
        values.extend([theta_rad, omega_rad_s]);
        if !instance.set_reals(&places, &values) {
            let of = |n: usize| (inputs[n], Value::Real(values[n]));
            instance.set_all(inputs.len(), &of).map_err(|why| refused(why.to_string()))?;
        }
        let step = Step { time_s: j as f64 * samples.step_s, length_s: samples.step_s };
        instance.step(step, &mut Silent).map_err(|why| refused(why.to_string()))?;
        if j % every == 0 {
            time_s.push(samples.start_s + j as f64 * samples.step_s);
            for (column, index) in columns.iter_mut().zip(&outputs) {
                column.values.push(instance.get(*index).map_or(f64::NAN, Value::as_f64));
            }
        }
    }
    Ok(Track { machine, estimator, outputs: Recording { time_s, columns } })
}

/// The outputs that are kept.
fn kept(machine: &Machine) -> Vec<String> {
    let of_magnets = OF_MAGNETS.map(|name| machine.of_magnets(name)).concat();
    let states = ["valid", "verdict"].map(str::to_owned);
    [of_magnets, numbers(machine), states.to_vec()].concat()
}

/// Names of the outputs that are not of a magnet.
fn numbers(machine: &Machine) -> Vec<String> {
    let of_parts = ["noise.position", "noise.current"].map(|name| machine.of_parts(name)).concat();
    let motion = [machine.of_loads("p", "Hat"), machine.of_planes("magnitude"), machine.of_planes("phase")].concat();
    [motion, of_parts, ["condition", "residual"].map(str::to_owned).to_vec()].concat()
}

/// The choice that an estimator has for a variable.
pub(super) fn chosen<T: Choice + Default>(estimator: &Element, variable: &str) -> T {
    let number = estimator.value(variable).map(|value| value.as_f64() as i32);
    number.and_then(T::of_number).unwrap_or_default()
}

impl Track {
    /// The method.
    pub fn method(&self) -> Method {
        chosen(&self.estimator, "method")
    }

    /// The name of the method.
    pub fn name(&self) -> &'static str {
        self.method().name()
    }

    /// The values of an output over the recording.
    pub fn of(&self, name: &str) -> &[f64] {
        self.outputs.get(name).unwrap_or_default()
    }

    /// The values of these outputs in a row.
    fn at(&self, names: &[String], row: usize) -> Vec<f64> {
        names.iter().map(|name| self.of(name)[row]).collect()
    }

    /// The verdict on the estimate of each row.
    pub fn verdicts(&self) -> Vec<Verdict> {
        self.of("verdict").iter().map(|number| Verdict::of_number(*number as i32).unwrap_or_default()).collect()
    }

    /// Row of the last valid estimate.
    pub fn last_valid(&self) -> Option<usize> {
        self.of("valid").iter().rposition(|valid| *valid == 1.0)
    }

    /// Whether the estimate is valid at the end.
    pub fn is_valid_at_end(&self) -> bool {
        self.of("valid").last() == Some(&1.0)
    }

    /// The largest relative standard deviation of a force constant in a row; `std` is the name of the output.
    fn largest_deviation(&self, std: &str, row: usize) -> f64 {
        let of = |name: &str| self.at(&self.machine.of_magnets(name), row);
        of(std).into_iter().zip(of("lambdaHat")).map(|(std, lambda)| std / lambda).fold(0.0, f64::max)
    }

    /// How well the recording identifies the bearing, in a sentence or two.
    pub fn verdict(&self) -> String {
        let valid = self.of("valid");
        let share = 100.0 * valid.iter().sum::<f64>() / valid.len().max(1) as f64;
        let mut reasons: Vec<(Verdict, usize)> = Vec::new();
        let verdicts = self.verdicts().into_iter().zip(valid);
        for verdict in verdicts.filter(|(_, valid)| **valid != 1.0).map(|(verdict, _)| verdict) {
            match reasons.iter_mut().find(|(reason, _)| *reason == verdict) {
                Some((_, count)) => *count += 1,
                None => reasons.push((verdict, 1)),
            }
        }
        reasons.sort_by_key(|(_, count)| std::cmp::Reverse(*count));
        let others: Vec<String> =
            reasons.iter().take(3).map(|(reason, count)| format!("{count} samples {reason}")).collect();
        let why = if others.is_empty() { String::new() } else { format!(" Otherwise: {}.", others.join("; ")) };
        match self.last_valid() {
            None => format!("The recording does not identify the force constants.{why}"),
            Some(last) => {
                let worst = self.largest_deviation("lambdaStdTotal", last);
                let word =
                    if worst < 0.2 * STD_LIMIT { "The excitation is sufficient" } else { "The excitation is weak" };
                format!(
                    "{word}: largest standard deviation {:.2} % of its force constant, valid during {share:.0} % of the \
                     recording.{why}",
                    100.0 * worst,
                )
            }
        }
    }

    /// Estimates after each quarter of the recording, a table per bearing.
    pub fn progress(&self) -> Vec<Table> {
        let (valid, verdicts) = (self.of("valid"), self.verdicts());
        let of_bearing = |(_, magnets): (&Bearing, Range<usize>)| {
            let [lambda, std] =
                ["lambdaHat", "lambdaStd"].map(|name| self.machine.of_magnets(name)[magnets.clone()].to_vec());
            let rows = [(1, "1/4"), (2, "1/2"), (3, "3/4"), (4, "end")].into_iter().filter_map(|(quarter, name)| {
                let row = (quarter * self.outputs.time_s.len() / 4).checked_sub(1)?;
                let mut cells = vec![name.to_owned(), format!("{:.4}", self.outputs.time_s[row])];
                if valid[row] == 1.0 {
                    let both = self.at(&lambda, row).into_iter().zip(self.at(&std, row));
                    cells.extend(both.map(|(lambda, std)| format!("{:.4} ± {:.4}", 1e6 * lambda, 1e6 * std)));
                    cells.push("yes".into());
                } else {
                    cells.extend(std::iter::repeat_n("–".to_owned(), magnets.len()));
                    cells.push(verdicts[row].to_string());
                }
                Some(cells)
            });
            let names = self.machine.symbols("λ")[magnets.clone()].to_vec();
            let head = ["", "time, s"].map(String::from).into_iter().chain(names).chain(["valid".to_owned()]);
            let note = if magnets.start > 0 { "" } else { DRIFT };
            Table::new("On-line estimator over time, 10⁻⁶ N·m²/A²", note, head, rows)
        };
        self.machine.magnets_of_bearings().into_iter().map(of_bearing).collect()
    }

    /// The last valid estimate in SI units.
    fn json(&self) -> Json {
        let Some(last) = self.last_valid() else { return Json::Null };
        let mut estimate = Map::new();
        for name in OF_MAGNETS {
            estimate.insert(name.into(), self.at(&self.machine.of_magnets(name), last).into());
        }
        for name in numbers(self.machine) {
            let value = self.of(&name)[last];
            estimate.insert(name, value.into());
        }
        estimate.into()
    }
}

/// Estimates in numbers, one column per method.
fn table(tracks: &[Track]) -> Table {
    let row = |name: String, of: &dyn Fn(&Track, usize) -> Option<String>| -> Vec<String> {
        let cell = |track: &Track| track.last_valid().and_then(|last| of(track, last)).unwrap_or_else(|| "–".into());
        std::iter::once(name).chain(tracks.iter().map(cell)).collect()
    };
    let Some(machine) = tracks.first().map(|track| track.machine) else { return Table::default() };
    let mut rows = Vec::new();
    let of_magnets = |name| machine.of_magnets(name).into_iter();
    let symbols = machine.symbols("λ").into_iter();
    for ((symbol, lambda), std) in symbols.zip(of_magnets("lambdaHat")).zip(of_magnets("lambdaStd")) {
        rows.push(row(symbol, &|track, last| {
            let [lambda, std] = [&lambda, &std].map(|name| 1e6 * track.of(name)[last]);
            Some(format!("{lambda:.4} ± {std:.4}"))
        }));
    }
    for (part, factor, unit) in [("magnitude", 1e6, "g·mm"), ("phase", 1.0, "rad")] {
        for name in machine.of_planes(part) {
            rows.push(row(format!("{name}, {unit}"), &|track, last| {
                let is_known = track.method() == Method::PredictionError;
                is_known.then(|| significant(factor * track.of(&name)[last], 5))
            }));
        }
    }
    for (n, name) in machine.of_loads("p", "Hat").into_iter().enumerate() {
        let unit = machine.either(n, "N", "N·m");
        let title = format!("{}, {unit}", name.trim_end_matches("Hat"));
        rows.push(row(title, &|track, last| Some(significant(track.of(&name)[last], 5))));
    }
    for name in ["residual", "condition"] {
        rows.push(row(name.into(), &|track, last| Some(significant(track.of(name)[last], 4))));
    }
    let valid = |track: &Track| match (track.last_valid(), track.is_valid_at_end()) {
        (None, _) => "never",
        (_, true) => "yes",
        (_, false) => "not at the end",
    };
    rows.push(std::iter::once("valid").chain(tracks.iter().map(valid)).map(String::from).collect());
    let head = [""].into_iter().chain(tracks.iter().map(Track::name));
    let title = "Force constants, 10⁻⁶ N·m²/A², with their standard deviations";
    Table::new(title, "The last valid estimates.", head, rows)
}

/// The estimates over time, with columns named `method.variable`.
pub fn recording(tracks: &[Track]) -> Recording {
    let mut recording = Recording::default();
    for track in tracks {
        recording.time_s.clone_from(&track.outputs.time_s);
        let named = |column: &Column| Column { name: format!("{}.{}", track.name(), column.name), ..column.clone() };
        recording.columns.extend(track.outputs.columns.iter().map(named));
    }
    recording
}

/// The results of the methods for a recording, with the last valid estimate of each as JSON.
pub fn statement(samples: &Samples, tracks: &[Track]) -> Statement {
    let method = |track: &Track| {
        let hold = chosen::<Hold>(&track.estimator, "hold").name();
        json!({
            "method": track.name(), "hold": hold, "Tf": track.estimator.value("Tf").map(Value::as_f64),
            "estimate": track.json(), "validAtEnd": track.is_valid_at_end(), "verdict": track.verdict(),
        })
    };
    Statement {
        valid: None,
        verdict: String::new(),
        findings: tracks.iter().map(|track| format!("{}: {}", track.name(), track.verdict())).collect(),
        assumptions: String::new(),
        tables: vec![table(tracks)],
        json: json!({
            "samples": samples.len(), "start": samples.start_s, "Ts": samples.step_s, "notes": samples.notes,
            "methods": tracks.iter().map(method).collect::<Vec<_>>(),
        }),
    }
}
