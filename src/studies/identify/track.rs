//! The on-line estimator of a machine over a recording, run as an importer runs its FMU.

use std::f64::consts::TAU;

use fmu_export::Step;
use fmu_export::log::Silent;
use fmu_export::variable::{Causality, Value};
use serde_json::{Map, Value as Json, json};

use super::read::{Samples, significant};
use super::{Failed, HOLDS, METHODS, holds_beside, name_of};
use crate::estimation::{EstimatorConfig, Hold, Method, STD_LIMIT, Verdict};
use crate::fmu;
use crate::machine::{Machine, PLANAR};
use crate::simulation::recording::{Column, Recording};
use crate::simulation::scenario::{Element, Setting};
use crate::simulation::simulate;
use crate::table::Table;
use crate::variables::Choice;

/// An estimator over a whole recording.
#[derive(Clone)]
pub struct Track {
    /// The machine.
    pub machine: &'static Machine,
    /// The estimator with its parameters.
    pub estimator: Element,
    /// Its outputs by their names, after every sample or after every so many.
    pub outputs: Recording,
}

/// Note below the estimates over time.
const DRIFT: &str = "± of noise alone. Values that drift from line to line are a bearing that changes.";

/// Another reading of the currents than the usual one is taken if it makes the largest deviation of λ smaller than this part of it.
const CLEARLY: f64 = 0.8;

/// The estimator of the planar rotor with this configuration.
#[must_use]
pub fn estimator(config: &EstimatorConfig) -> Element {
    let settings = fmu::estimator::settings(config).into_iter().map(|(index, value)| Setting { index, value });
    let model_type = fmu::find(PLANAR.models[2].0).expect("a model of this project");
    Element { name: "estimator".into(), model_type, settings: settings.collect() }
}

/// Runs an estimator over a recording.
///
/// # Errors
/// Parameters that the estimator refuses.
pub fn track(samples: &Samples, estimator: &Element) -> Result<Track, Failed> {
    track_every(samples, estimator, 1)
}

/// The same with the output of every n-th sample alone: those of a long recording take more memory than the recording.
///
/// # Errors
/// Parameters that the estimator refuses.
pub fn track_every(samples: &Samples, estimator: &Element, every: usize) -> Result<Track, Failed> {
    let (machine, mut estimator) = (samples.machine, estimator.clone());
    estimator.set("Ts", Value::Real(samples.step_s));
    // Without the angle of the rotor there is no telling where an unbalance points. The paper's methods have no use for it, nor for tolerances.
    if method(&estimator) == Method::PredictionError {
        if samples.theta_rad.is_empty() {
            estimator.set("identify.unbalance", Value::Boolean(false));
        }
    } else {
        let variables = estimator.model_type.clone();
        estimator.settings.retain(|of| !variables.variables()[of.index].name.starts_with("tolerance."));
        estimator.set("identify.unbalance", Value::Boolean(true));
    }
    let mut instance = simulate::start(&estimator).map_err(Failed::Refused)?;
    let index = |name: &String| estimator.index(name).expect("a variable of the estimator");
    let rotation = ["theta", "omega"].map(str::to_owned);
    let currents = samples.currents(hold(&estimator));
    let recorded = samples.position_m.iter().chain(&currents);
    let inputs = machine.measured().into_iter().chain(machine.of_magnets("im")).chain(rotation);
    let inputs: Vec<usize> = inputs.map(|name| index(&name)).collect();
    let places: Vec<u32> = inputs.iter().map(|index| *index as u32).collect();
    // Methods that need a speed take that of their window where none is known.
    let usual_rad_s = estimator.value("Tf").map_or(0.0, |window_s| TAU / window_s.as_f64());
    let (names, every) = (kept(machine), every.max(1));
    let outputs: Vec<usize> = names.iter().map(index).collect();
    let unit = |index: &usize| estimator.model_type.variables()[*index].unit_name().into();
    let column = |(name, index)| Column { name, unit: unit(index), values: Vec::new() };
    let mut columns: Vec<Column> = names.into_iter().zip(&outputs).map(column).collect();
    let (mut time_s, mut values) = (Vec::new(), Vec::with_capacity(inputs.len()));
    // Short gaps are filled for the paper's methods, which bridge none.
    let has_gaps = *machine != PLANAR;
    let refused = |why: &dyn std::fmt::Display| Failed::Refused(vec![why.to_string()]);
    instance.set(index(&"enable".into()), Value::Boolean(true)).map_err(|why| refused(&why))?;
    for j in 0..samples.len() {
        let theta_rad = samples.theta_rad.get(j).copied().unwrap_or(0.0);
        let omega_rad_s = samples.omega_rad_s.get(j).copied().unwrap_or(usual_rad_s);
        let is_gap = has_gaps && samples.missing.get(j).is_some_and(|missing| *missing != 0);
        values.clear();
        values.extend(recorded.clone().map(|column| if is_gap { f64::NAN } else { column[j] }));
        values.extend([theta_rad, omega_rad_s]);
        if !instance.set_reals(&places, &values) {
            let of = |n: usize| (inputs[n], Value::Real(values[n]));
            instance.set_all(inputs.len(), &of).map_err(|why| refused(&why))?;
        }
        let step = Step { time_s: j as f64 * samples.step_s, length_s: samples.step_s };
        instance.step(step, &mut Silent).map_err(|why| refused(&why))?;
        if j % every == 0 {
            time_s.push(samples.start_s + j as f64 * samples.step_s);
            for (column, index) in columns.iter_mut().zip(&outputs) {
                column.values.push(instance.get(*index).map_or(f64::NAN, Value::as_f64));
            }
        }
    }
    Ok(Track { machine, estimator, outputs: Recording { time_s, columns } })
}

/// The meaning of the samples of currents that leaves the smallest standard deviation of λ at the end of the recording: that of measured
/// currents, unless another one is clearly better. With a table of these.
///
/// # Errors
/// As for [`track`].
pub fn best_hold(samples: &Samples, estimator: &Element) -> Result<(Hold, Table), Failed> {
    let deviation = |hold: Hold| {
        let mut estimator = estimator.clone();
        estimator.set("hold", Value::Integer(hold.number()));
        let track = track_every(samples, &estimator, samples.len().max(2) - 1)?;
        let end = track.last_valid().filter(|_| track.is_valid_at_end());
        Ok(end.map_or(f64::INFINITY, |row| track.largest_deviation("lambdaStd", row)))
    };
    let mut deviations = [f64::INFINITY; HOLDS.len()];
    for (std, (_, hold)) in deviations.iter_mut().zip(HOLDS) {
        *std = deviation(hold)?;
    }
    let best = (0..HOLDS.len()).min_by(|a, b| deviations[*a].total_cmp(&deviations[*b])).unwrap_or(0);
    let (_, chosen) = HOLDS[if deviations[best] < CLEARLY * deviations[0] { best } else { 0 }];
    let number = |std: f64| if std.is_finite() { format!("{:.2} %", 100.0 * std) } else { "not valid".into() };
    let note = "Largest standard deviation of a force constant with each reading.";
    Ok((chosen, holds_beside(note, "± noise", deviations.map(number), chosen)))
}

/// The outputs that are looked at.
fn kept(machine: &Machine) -> Vec<String> {
    let of_magnets = ["lambdaHat", "lambdaStd", "lambdaStdTotal", "ki", "ks"].map(|name| machine.of_magnets(name));
    let of_parts = ["noise.position", "noise.current"].map(|name| machine.of_parts(name));
    let others = ["condition", "residual", "valid", "verdict"].map(str::to_owned);
    [of_magnets.concat(), motion(machine), of_parts.concat(), others.to_vec()].concat()
}

/// Names of loads and unbalances.
fn motion(machine: &Machine) -> Vec<String> {
    [machine.of_loads("p", "Hat"), machine.of_planes("magnitude"), machine.of_planes("phase")].concat()
}

fn method(estimator: &Element) -> Method {
    let number = estimator.value("method").map(|method| method.as_f64() as i32);
    number.and_then(Method::of_number).unwrap_or_default()
}

/// The meaning of a sample of a current.
fn hold(estimator: &Element) -> Hold {
    let number = estimator.value("hold").map(|hold| hold.as_f64() as i32);
    number.and_then(Hold::of_number).unwrap_or_default()
}

impl Track {
    /// Whether this is the answer: the planar rotor has others.
    #[must_use]
    pub fn is_answer(&self) -> bool {
        *self.machine != PLANAR
    }

    /// The method.
    #[must_use]
    pub fn method(&self) -> Method {
        method(&self.estimator)
    }

    /// The name of the method.
    #[must_use]
    pub fn name(&self) -> &'static str {
        METHODS.iter().find(|(_, method)| *method == self.method()).map_or("", |(name, _)| name)
    }

    /// The values of an output over the recording.
    #[must_use]
    pub fn of(&self, name: &str) -> &[f64] {
        self.outputs.get(name).unwrap_or_default()
    }

    /// The values of these outputs in a row.
    fn at(&self, names: &[String], row: usize) -> Vec<f64> {
        names.iter().map(|name| self.of(name)[row]).collect()
    }

    /// The verdict on the estimate of each row.
    #[must_use]
    pub fn verdicts(&self) -> Vec<Verdict> {
        self.of("verdict").iter().map(|number| Verdict::of_number(*number as i32).unwrap_or_default()).collect()
    }

    /// Row of the last valid estimate.
    #[must_use]
    pub fn last_valid(&self) -> Option<usize> {
        self.of("valid").iter().rposition(|valid| *valid == 1.0)
    }

    /// Whether the estimate is valid at the end.
    #[must_use]
    pub fn is_valid_at_end(&self) -> bool {
        self.of("valid").last() == Some(&1.0)
    }

    /// The largest standard deviation of a force constant in a row, relative: of noise, or in all.
    fn largest_deviation(&self, std: &str, row: usize) -> f64 {
        let of = |name: &str| self.at(&self.machine.of_magnets(name), row);
        of(std).into_iter().zip(of("lambdaHat")).map(|(std, lambda)| std / lambda).fold(0.0, f64::max)
    }

    /// Parameters that the estimator takes as known.
    #[must_use]
    pub fn told(&self) -> String {
        const OTHERS: [&str; 3] = ["Ts", "lambda0", "shaft."];
        let variables = self.estimator.model_type.variables().iter();
        let parameters = variables.filter(|of| of.causality == Causality::Parameter && !of.unit_name().is_empty());
        let is_told = |name: &str| !OTHERS.iter().any(|other| name.contains(other));
        let told = parameters.filter(|of| is_told(&of.name)).filter_map(|of| {
            let value = self.estimator.value(&of.name).map_or(0.0, Value::as_f64);
            // Tolerances and noise of 0 are none.
            let is_none = value == 0.0 && (of.name.starts_with("tolerance.") || of.name.starts_with("sensor."));
            let (factor, unit) = shown(of.unit_name());
            (!is_none).then(|| format!("{} = {} {unit}", of.name, significant(factor * value, 4)))
        });
        let told: Vec<String> = told.collect();
        format!("Taken as known: {}; currents {}.", told.join(", "), name_of(hold(&self.estimator)))
    }

    /// The verdict at the end, for a machine whose answer this is.
    #[must_use]
    pub fn verdict_at_end(&self) -> String {
        match self.verdicts().last() {
            Some(last) if !self.is_valid_at_end() => {
                format!("{}. {}", last.to_string().replacen("not valid", "Not valid", 1), self.verdict())
            }
            _ => self.verdict(),
        }
    }

    /// Use of the recording, in a sentence or two.
    #[must_use]
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

    /// Estimates of the magnets, and of what else was estimated: the last valid ones.
    fn tables(&self) -> Vec<Table> {
        let Some(last) = self.last_valid() else { return Vec::new() };
        let of = |name: &str| self.at(&self.machine.of_magnets(name), last);
        let [lambda, std, total, ki, ks] = ["lambdaHat", "lambdaStd", "lambdaStdTotal", "ki", "ks"].map(of);
        let micro = |value: f64| format!("{:.4}", value * 1e6);
        let row = |(k, name): (usize, String)| {
            vec![
                name,
                micro(lambda[k]),
                micro(std[k]),
                micro(total[k]),
                format!("{:.3}", ki[k]),
                format!("{:.0}", ks[k]),
            ]
        };
        let magnets = Table {
            title: "Force constants, 10⁻⁶ N·m²/A²".into(),
            note: format!(
                "At {:.4} s{}. ± of noise, and in all with the tolerances that are stated; ki and ks at the currents of the last revolution.",
                self.outputs.time_s[last],
                if self.is_valid_at_end() { "" } else { ", the last valid estimate" },
            ),
            head: ["", "λ", "± noise", "± in all", "ki, N/A", "ks, N/m"].map(String::from).into(),
            rows: self.machine.of_magnets("λ").into_iter().enumerate().map(row).collect(),
        };
        let parts = ["noise.position", "noise.current"].map(|name| self.machine.of_parts(name)).concat();
        let row = |name: String| {
            let column = self.outputs.columns.iter().find(|column| column.name == name);
            let (factor, unit) = match column.map_or("", |column| column.unit.as_str()) {
                "m" => (1e6, "µm"),
                unit => shown(unit),
            };
            let value = significant(factor * self.of(&name)[last], 4);
            vec![name, value, unit.to_owned()]
        };
        let others = Table {
            title: "Load, unbalance and noise".into(),
            note: "Estimated with the force constants.".into(),
            head: ["", "value", "unit"].map(String::from).into(),
            rows: motion(self.machine).into_iter().chain(parts).map(row).collect(),
        };
        vec![magnets, others]
    }

    /// Estimates after each quarter of the recording, a table per bearing.
    #[must_use]
    pub fn progress(&self) -> Vec<Table> {
        let mut first = 0;
        let (valid, verdicts) = (self.of("valid"), self.verdicts());
        let of_bearing = |bearing: &crate::machine::Bearing| {
            let magnets = first..first + bearing.magnets;
            first = magnets.end;
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
                    cells.extend(std::iter::repeat_n("–".to_owned(), bearing.magnets));
                    cells.push(verdicts[row].to_string());
                }
                Some(cells)
            });
            let names = self.machine.of_magnets("λ")[magnets.clone()].to_vec();
            let names = names
                .into_iter()
                .map(|name| if self.machine.is_planar() { name.replace(['[', ']'], "") } else { name });
            let head = ["", "time, s"].map(String::from).into_iter().chain(names).chain(["valid".to_owned()]);
            Table {
                title: "On-line estimator over time, 10⁻⁶ N·m²/A²".into(),
                note: if magnets.start > 0 { "" } else { DRIFT }.into(),
                head: head.collect(),
                rows: rows.collect(),
            }
        };
        self.machine.bearings.iter().map(of_bearing).collect()
    }

    /// The last valid estimate in SI units.
    fn json(&self) -> Json {
        let Some(last) = self.last_valid() else { return Json::Null };
        let mut estimate = Map::new();
        for name in ["lambdaHat", "lambdaStd", "lambdaStdTotal", "ki", "ks"] {
            estimate.insert(name.into(), self.at(&self.machine.of_magnets(name), last).into());
        }
        let parts = ["noise.position", "noise.current"].map(|name| self.machine.of_parts(name)).concat();
        let others = ["condition", "residual"].map(str::to_owned);
        for name in motion(self.machine).into_iter().chain(parts).chain(others) {
            let value = self.of(&name)[last];
            estimate.insert(name, value.into());
        }
        estimate.into()
    }
}

/// A unit as it is shown, with what one of the interface's is in it.
fn shown(unit: &str) -> (f64, &str) {
    match unit {
        "m" => (1e3, "mm"),
        "A" => (1e3, "mA"),
        "rad" => (180.0 / std::f64::consts::PI, "°"),
        "kg.m" => (1e6, "g·mm"),
        "kg.m2" => (1.0, "kg·m²"),
        "N.m" => (1.0, "N·m"),
        unit => (1.0, unit),
    }
}

/// Estimates in tables: of the methods of the planar rotor beside each other, of other machines in more detail.
#[must_use]
pub fn tables(tracks: &[Track]) -> Vec<Table> {
    match tracks {
        [track] if track.is_answer() => [track.tables(), track.progress()].concat(),
        tracks => vec![table(tracks)],
    }
}

/// Estimates of the planar rotor in numbers, one row per method.
fn table(tracks: &[Track]) -> Table {
    let head = "|λ1|λ2|λ3|± 1|± 2|± 3|U, g·mm|φ, rad|pY, N|pZ, N|residual|condition|valid";
    let head: Vec<String> = head.split('|').map(String::from).collect();
    let row = |track: &Track| {
        let mut row = vec![track.name().to_owned()];
        let Some(last) = track.last_valid() else {
            row.extend(std::iter::repeat_n("–".to_owned(), head.len() - 2));
            row.push("never".into());
            return row;
        };
        let of = |name: &str| track.of(name)[last];
        let magnets = ["lambdaHat", "lambdaStd"].map(|name| track.at(&track.machine.of_magnets(name), last)).concat();
        row.extend(magnets.into_iter().map(|value| format!("{:.4}", value * 1e6)));
        if track.method() == Method::PredictionError {
            row.push(format!("{:.2}", of("unbalance.magnitude") * 1e6));
            row.push(format!("{:.4}", of("unbalance.phase")));
        } else {
            row.extend(["–", "–"].map(String::from));
        }
        row.extend([format!("{:.2}", of("pYHat")), format!("{:.2}", of("pZHat"))]);
        row.extend([format!("{:.4}", of("residual")), format!("{:.1}", of("condition"))]);
        row.push(if track.is_valid_at_end() { "yes" } else { "not at the end" }.into());
        row
    };
    let rows = tracks.iter().map(row).collect();
    Table {
        title: "Force constants, 10⁻⁶ N·m²/A², with their standard deviations".into(),
        note: "The last valid estimates.".into(),
        head,
        rows,
    }
}

/// The estimates over time, with columns named `method.variable`.
#[must_use]
pub fn recording(tracks: &[Track]) -> Recording {
    let mut recording = Recording::default();
    for track in tracks {
        recording.time_s.clone_from(&track.outputs.time_s);
        let of_magnets = ["lambdaHat", "lambdaStd"].map(|name| track.machine.of_magnets(name)).concat();
        let others = ["valid", "condition", "residual"].map(str::to_owned);
        for name in of_magnets.into_iter().chain(others).chain(motion(track.machine)) {
            let column = track.outputs.columns.iter().find(|column| column.name == name);
            let named = |column: &Column| Column { name: format!("{}.{name}", track.name()), ..column.clone() };
            recording.columns.extend(column.map(named));
        }
    }
    recording
}

/// The result as JSON: the data, the stated values, and the last valid estimate of every method in SI units; of other machines than the planar
/// one the estimate itself, if it is valid at the end.
#[must_use]
pub fn json(samples: &Samples, tracks: &[Track]) -> Json {
    if let [track] = tracks
        && track.is_answer()
    {
        let valid = track.is_valid_at_end();
        let mut document = if valid { track.json() } else { json!({}) };
        document["valid"] = valid.into();
        document["verdict"] = track.verdict_at_end().into();
        document["magnets"] = track.machine.of_magnets("lambda").into();
        document["told"] = track.told().into();
        (document["samples"], document["Ts"]) = (samples.len().into(), samples.step_s.into());
        return document;
    }
    let method = |track: &Track| {
        let hold = name_of(hold(&track.estimator));
        json!({
            "method": track.name(), "hold": hold, "Tf": track.estimator.value("Tf").map(Value::as_f64),
            "estimate": track.json(), "validAtEnd": track.is_valid_at_end(), "verdict": track.verdict(),
        })
    };
    json!({
        "samples": samples.len(), "start": samples.start_s, "Ts": samples.step_s, "notes": samples.notes,
        "methods": tracks.iter().map(method).collect::<Vec<_>>(),
    })
}
