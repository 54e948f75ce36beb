//! `identify` for the machine `axial`: one axis between one or two magnets.

use std::path::Path;

use serde_json::json;

use super::machine::without_element;
use super::{Arguments, Pairs, Result, refused};
use crate::bearing::magnet::Used;
use crate::machine::AXIAL;
use crate::report::identification::Results;
use crate::simulation::scenario::{Scenario, suggestion, text};
use crate::studies::identify::axial::{self, Answer, Axis, PARAMETERS};
use crate::studies::identify::{Samples, Statement, quantity};
use crate::variables::Choice;

/// Parameters that are always known: the levitated mass, and the magnets in use.
const MASS: &str = "m";
const USED: &str = "magnets.used";

/// The axis as the scenario and the arguments describe it, and the errors in that description.
struct Bench {
    axis: Axis,
    errors: Vec<String>,
}

/// Identifies an axis from each recording. Also returns the columns and the scenario, for the twin.
pub(super) fn identify(arguments: &Arguments) -> Result<(Results, Pairs, Scenario)> {
    // A scenario of another machine is ignored.
    let scenario = match &arguments.scenario {
        Some(path) if Scenario::machine_of(path) == Some(&AXIAL) => Scenario::open_parameters(path, &[])?,
        _ => Scenario::plain(&AXIAL),
    };
    let columns: Pairs = scenario.columns.iter().chain(&arguments.column).cloned().collect();
    let mut bench = Bench { axis: Axis::new(f64::NAN, vec![0, 1]), errors: arguments.unused(&AXIAL) };
    bench.read(&scenario.identify);
    for (name, value) in &arguments.changes {
        bench.set(name, value, "--set ");
    }
    for name in &arguments.estimates {
        bench.estimate(name, "--estimate ");
    }
    if let Some((name, value)) = &arguments.at {
        bench.set_position(name, value);
    }
    let changed = arguments.changes.iter().map(|(name, _)| without_element(name));
    let mut given = changed.chain(scenario.identify.keys().map(String::as_str));
    if !given.any(|name| name == MASS) {
        bench.errors.push("m is missing: the mass of what levitates, --set m=…".into());
    }
    if !bench.errors.is_empty() {
        return Err(refused(bench.errors.join("\n  ")));
    }
    Ok((results(arguments, &bench.axis, &columns)?, columns, scenario))
}

impl Bench {
    /// Reads the table `[identify]` of a scenario.
    fn read(&mut self, table: &toml::Table) {
        for (name, value) in table {
            match (name.as_str(), value) {
                ("estimate", toml::Value::Array(names)) => {
                    names.iter().for_each(|name| self.estimate(&text(name), "[identify] estimate "));
                }
                ("at", value) => self.set_position("Xm", &text(value)),
                (name, value) => self.set(name, &text(value), "[identify] "),
            }
        }
    }

    fn set(&mut self, name: &str, value: &str, from: &str) {
        let name = without_element(name);
        let positive = |number: f64| {
            if number > 0.0 { Ok(number) } else { Err(format!("{name}={value}: expected a value above 0")) }
        };
        let result = match name {
            MASS => quantity(name, value, "kg").and_then(positive).map(|m_kg| self.axis.m_kg = m_kg),
            USED => Used::all()
                .find(|used| used.name() == value)
                .map(|used| self.axis.used = used.magnets())
                .ok_or_else(|| format!("magnets.used={value}: expected first, second or both")),
            _ => match parameter(name) {
                Some(at) => {
                    let number = quantity(name, value, PARAMETERS[at].1);
                    let signed = matches!(name, "pX" | "noise.exponent" | "delay" | "force.slow" | "current.feedback");
                    let number = if signed { number } else { number.and_then(positive) };
                    number.map(|number| self.axis.known[at] = Some(number))
                }
                None => Err(no_parameter(name)),
            },
        };
        self.errors.extend(result.err().map(|why| format!("{from}{why}")));
    }

    fn estimate(&mut self, name: &str, from: &str) {
        match parameter(name) {
            Some(at) => self.axis.estimated[at] = true,
            None if matches!(name, MASS | USED) => {
                self.errors.push(format!("{from}{name}: it cannot be estimated; expected --set {name}=…"));
            }
            None => self.errors.push(format!("{from}{}", no_parameter(name))),
        }
    }

    fn set_position(&mut self, name: &str, value: &str) {
        match quantity(name, value, "m") {
            Ok(at_m) if name == "Xm" => self.axis.at_m = Some(at_m),
            Ok(_) => self.errors.push(format!("--at {name}: expected a position along the axis, as in Xm=10mm")),
            Err(why) => self.errors.push(format!("--at {why}")),
        }
    }
}

fn parameter(name: &str) -> Option<usize> {
    PARAMETERS.iter().position(|(known, ..)| *known == name)
}

fn no_parameter(name: &str) -> String {
    let names = [MASS, USED].into_iter().chain(PARAMETERS.map(|(name, _)| name));
    let suggestion = suggestion(name, &names.map(str::to_owned).collect::<Vec<_>>());
    format!("{name} is no parameter of this machine; {suggestion}")
}

/// Identifies the axis from each recording.
fn results(arguments: &Arguments, axis: &Axis, columns: &Pairs) -> Result<Results> {
    let reading = arguments.reading(columns, &AXIAL, Some(axis.used.clone()));
    let implausible = |samples: &Samples| samples.implausible_axis(&axis.used, axis.gap_m());
    let recordings = arguments.read_all(&reading, implausible)?;
    let mut axes: Vec<Answer> = Vec::new();
    for (path, samples) in arguments.recordings.iter().zip(&recordings) {
        axes.push(answer(arguments, axis, path, samples, axes.first())?);
    }
    let differ = axial::agreement(&axes);
    let statements: Vec<Statement> = axes.iter().map(Answer::statement).collect();
    let mut summary = Vec::new();
    let document = match statements.as_slice() {
        [statement] => statement.json.clone(),
        all => {
            summary.push(differ.clone().unwrap_or_else(|| "The recordings agree.".into()));
            let valid = all.iter().all(|statement| statement.valid != Some(false)) && differ.is_none();
            let documents: Vec<_> = all.iter().map(|statement| &statement.json).collect();
            json!({"valid": valid, "differ": differ, "recordings": documents})
        }
    };
    let why =
        statements.iter().find(|statement| statement.valid == Some(false)).map(|statement| statement.verdict.clone());
    let not_valid = why.or(differ);
    let mut results = Results { recordings, axes, statements, summary, document, not_valid, ..Results::default() };
    if let Some(path) = &arguments.check {
        let samples = arguments.read(path, &reading, implausible)?;
        let first = &results.axes[0];
        let check = first.check(&answer(arguments, axis, path, &samples, Some(first))?);
        arguments.add_check(&mut results, Ok(check));
    }
    Ok(results)
}

/// Identifies the axis from a recording, linearised at the position of the first.
fn answer(
    arguments: &Arguments,
    axis: &Axis,
    path: &Path,
    samples: &Samples,
    first: Option<&Answer>,
) -> Result<Answer> {
    let axis = Axis { at_m: axis.at_m.or(first.map(|first| first.at_m)), ..axis.clone() };
    axial::answer(&axis, samples).map_err(|why| arguments.refused(path, vec![why]))
}
