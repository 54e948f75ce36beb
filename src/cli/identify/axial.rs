//! `identify` for the machine `axial`: one axis between one or two magnets.

use std::path::Path;

use serde_json::json;

use super::machine::without_element;
use super::{Arguments, Result, report_errors};
use crate::bearing::Used;
use crate::machine::AXIAL;
use crate::report::identification::Results;
use crate::simulation::scenario::{Scenario, suggestion, text};
use crate::studies::identify::axial::{self, Answer, Axis, PARAMETERS};
use crate::studies::identify::{self, Samples, Stated, Statement, quantity};
use crate::variables::Choice;

/// Parameters that are always stated: the levitated mass, the magnets in use, and the position of the operating point.
const MASS: &str = "m";
const USED: &str = "magnets.used";
const AT: &str = "at";
/// Gap and load.
const GAP: &str = "s";
const LOAD: &str = "pX";

/// The axis as the scenario and the arguments describe it, and the errors in that description.
struct Bench {
    axis: Axis,
    errors: Vec<String>,
}

/// Identifies an axis from each recording. Also returns the scenario.
pub(super) fn identify(arguments: &Arguments) -> Result<(Results, Scenario)> {
    // A scenario of another machine is ignored.
    let scenario = match &arguments.scenario {
        Some(path) if Scenario::machine_of(path) == Some(&AXIAL) => Scenario::open_parameters(path, &[])?,
        _ => Scenario::plain(&AXIAL),
    };
    let axis = Axis { m_kg: f64::NAN, used: vec![0, 1], hold: arguments.hold(), ..Axis::default() };
    let mut bench = Bench { axis, errors: arguments.unused(&AXIAL) };
    for (name, value) in &scenario.identify {
        match value {
            toml::Value::Array(names) if name == "estimate" => {
                names.iter().for_each(|name| bench.state("[identify] estimate ", &text(name), None));
            }
            value => bench.state("[identify] ", name, Some(&text(value))),
        }
    }
    arguments.changes.iter().for_each(|(name, value)| bench.state("--set ", name, Some(value)));
    arguments.estimates.iter().for_each(|name| bench.state("--estimate ", name, None));
    let noise = [("noise.position", arguments.position_noise), ("noise.current", arguments.current_noise)];
    for (name, std) in noise.into_iter().filter_map(|(name, std)| Some((name, std.filter(|std| *std > 0.0)?))) {
        bench.state("", name, Some(&std.to_string()));
    }
    match &arguments.at {
        Some((name, value)) if name == "Xm" => bench.state("--at ", AT, Some(value)),
        Some((name, _)) => {
            bench.errors.push(format!("--at {name}: expected a position along the axis, as in Xm=10mm"));
        }
        None => {}
    }
    let changed = arguments.changes.iter().map(|(name, _)| without_element(name));
    if !changed.chain(scenario.identify.keys().map(String::as_str)).any(|name| name == MASS) {
        bench.errors.push("m is missing: the mass of what levitates, --set m=…".into());
    }
    for (name, value) in scenario.tolerance.iter().chain(&arguments.tolerances) {
        let tolerated = bench.tolerate(&scenario, name, value);
        bench.errors.extend(tolerated.err());
    }
    report_errors(&bench.errors)?;
    Ok((results(arguments, bench.axis, &scenario)?, scenario))
}

impl Bench {
    /// Sets a parameter, or has it estimated if there is no value.
    fn state(&mut self, from: &str, name: &str, value: Option<&str>) {
        let stated = self.stated(without_element(name), value);
        self.errors.extend(stated.err().map(|why| format!("{from}{why}")));
    }

    fn stated(&mut self, name: &str, value: Option<&str>) -> Result<(), String> {
        let Some(value) = value else {
            if matches!(name, MASS | USED) {
                return Err(format!("{name}: it cannot be estimated; expected --set {name}=…"));
            }
            let at = parameter(name)?;
            if axial::BENCH_ERRORS.contains(&at) {
                return Err(format!("{name}: one axis does not show it; expected a --tolerance {name}=…"));
            }
            self.axis.estimated[at] = true;
            return Ok(());
        };
        let positive = |number: f64| {
            if number > 0.0 { Ok(number) } else { Err(format!("{name}={value}: expected a value above 0")) }
        };
        match name {
            MASS => self.axis.m_kg = positive(quantity(name, value, "kg")?)?,
            USED => {
                let used = Used::all().find(|used| used.name() == value);
                self.axis.used =
                    used.ok_or_else(|| format!("{name}={value}: expected first, second or both"))?.magnets();
            }
            AT => self.axis.at_m = Some(quantity("Xm", value, "m")?),
            _ => {
                let at = parameter(name)?;
                let number = quantity(name, value, PARAMETERS[at].1)?;
                let is_signed = axial::BENCH_ERRORS.contains(&at)
                    || matches!(name, LOAD | "noise.exponent" | "delay" | "force.slow" | "current.feedback");
                self.axis.known[at] = Some(if is_signed { number } else { positive(number)? });
            }
        }
        Ok(())
    }

    /// Adds a tolerance: of the load, or of a bench parameter as on the other machines.
    fn tolerate(&mut self, scenario: &Scenario, name: &str, value: &str) -> Result<(), String> {
        let axis = &mut self.axis;
        let known = |name: &str| Ok::<_, String>(axis.known[parameter(name)?].filter(|value| value.is_finite()));
        if name == "gap.iron" {
            return Err(format!("tolerance {name}: on one axis an iron path is a wider gap; expected s=…"));
        }
        if matches!(name, GAP | LOAD) && known(name)?.is_none() {
            return Err(format!("tolerance {name}={value}: the value itself is missing, --set {name}=…"));
        }
        if name == LOAD {
            let std_n = quantity(LOAD, value, "N").map_err(|why| format!("tolerance {why}"))?;
            axis.tolerance[parameter(LOAD)?] = std_n.abs();
            return Ok(());
        }
        let (gap_m, mut estimator) = (known(GAP)?, scenario.estimator().clone());
        estimator.set(MASS, axis.m_kg);
        estimator.set(GAP, gap_m.unwrap_or(f64::NAN));
        let stated = Stated::of(&AXIAL, &estimator);
        let parameters = stated.parameters();
        for (at, std) in identify::tolerance(name, value, &stated)? {
            let own = parameters[at].name.as_str();
            let is_unused = (0..2).any(|k| !axis.used.contains(&k) && own.ends_with(&format!("[{}]", k + 1)));
            let at = match parameter(own) {
                // Of all parameters, one axis shows some.
                Err(_) if name == identify::ALL => continue,
                found => found?,
            };
            if !is_unused {
                axis.tolerance[at] = if own == GAP { gap_m.unwrap_or(0.0) * std } else { std };
            }
        }
        Ok(())
    }
}

/// Index of a parameter of the axis.
fn parameter(name: &str) -> Result<usize, String> {
    PARAMETERS.iter().position(|(known, ..)| *known == name).ok_or_else(|| {
        let names = [MASS, USED].into_iter().chain(PARAMETERS.map(|(name, ..)| name));
        let suggestion = suggestion(name, &names.map(str::to_owned).collect::<Vec<_>>());
        format!("{name} is no parameter of this machine; {suggestion}")
    })
}

/// Identifies the axis from each recording, linearised at the position of the first.
fn results(arguments: &Arguments, mut axis: Axis, scenario: &Scenario) -> Result<Results> {
    let reading = arguments.reading(scenario, Some(axis.used.clone()));
    let gap_m = [axis.gap_m()];
    let (recordings, checked) = arguments.read_all(&reading, &gap_m)?;
    let answer = |axis: &Axis, path: &Path, samples: &Samples| {
        axial::answer(axis, samples).map_err(|why| arguments.refused(vec![(path, vec![why])]))
    };
    let mut axes = Vec::new();
    for (path, samples) in arguments.recordings.iter().zip(&recordings) {
        let identified = answer(&axis, path, samples)?;
        axis.at_m = Some(identified.at_m);
        axes.push(identified);
    }
    let differ = axial::agreement(&axes);
    let statements: Vec<Statement> = axes.iter().map(Answer::statement).collect();
    let refused = statements.iter().find(|statement| statement.valid == Some(false));
    let not_valid = refused.map(|statement| statement.verdict.clone()).or(differ.clone());
    let (mut summary, mut document) = (Vec::new(), statements[0].json.clone());
    if statements.len() > 1 {
        let all: Vec<_> = statements.iter().map(|statement| &statement.json).collect();
        document = json!({"valid": not_valid.is_none(), "differ": differ, "recordings": all});
        summary.push(differ.unwrap_or_else(|| "The recordings agree.".into()));
    }
    let mut results = Results { recordings, axes, statements, summary, document, not_valid, ..Results::default() };
    if let (Some(path), Some(samples)) = (&arguments.check, checked) {
        let own = answer(&axis, path, &samples)?;
        let check = results.axes[0].check(&own);
        arguments.add_check(&mut results, Ok(check));
    }
    Ok(results)
}
