//! Runs a scenario over the slaves, as an importer would run the FMUs.
//!
//! At every communication point all outputs are read, then all connected inputs are set, then every slave does its step.
//! No slave sees the results of another's step before the next point, so the order of the slaves does not matter.

use fmu_export::log::{Log, Topic};
use fmu_export::variable::{Causality, Value};
use fmu_export::{Instance, Invalid, Step};

use crate::progress::Progress;
use crate::simulation::recording::{Column, Recording};
use crate::simulation::scenario::{Element, Profile, Scenario, Setting};

/// A run, complete or cut short.
#[derive(Clone, Debug, Default)]
pub struct Run {
    /// All outputs of all slaves at every communication point that was reached.
    pub recording: Recording,
    /// Why the run ended early, if it did.
    pub fault: Option<String>,
    /// What the slaves had to say, each line with the name of the slave.
    pub messages: Vec<String>,
}

/// Why a run could not begin: every parameter that was refused.
#[derive(Clone, Debug, thiserror::Error)]
#[error("the scenario cannot be run:\n  {}", .0.join("\n  "))]
pub struct Refused(pub Vec<String>);

impl From<Vec<Invalid>> for Refused {
    fn from(findings: Vec<Invalid>) -> Self {
        Self(findings.iter().map(ToString::to_string).collect())
    }
}

struct Slave {
    name: String,
    slave: Box<dyn Instance>,
}

/// An output and the input it feeds, by index.
struct Wire {
    from: (usize, usize),
    to: (usize, usize),
}

struct Messages<'a> {
    name: &'a str,
    lines: &'a mut Vec<String>,
}

impl Log for Messages<'_> {
    fn wants(&self, _: Topic) -> bool {
        true
    }

    fn message(&mut self, _: Topic, message: std::fmt::Arguments<'_>) {
        self.lines.push(format!("{}: {message}", self.name));
    }
}

/// Runs a scenario from time 0.
///
/// # Errors
/// Every parameter that a slave refuses. A run that fails on its way is no error: what was computed is kept and
/// [`Run::fault`] says why it ended.
pub fn run(scenario: &Scenario) -> Result<Run, Refused> {
    let progress = Progress::new("simulating", steps(scenario) as u64);
    run_for(scenario, |_| true, |step| progress.set(step as u64))
}

/// As [`run`], recording the outputs alone that are `wanted` by their paths; tells every step that is done.
///
/// # Errors
/// As for [`run`].
pub fn run_for(
    scenario: &Scenario,
    wanted: impl Fn(&str) -> bool,
    mut tell: impl FnMut(usize),
) -> Result<Run, Refused> {
    let mut slaves = Vec::new();
    let mut refused = Vec::new();
    for (at, element) in scenario.elements.iter().enumerate() {
        // What a profile gives at the start is there when the slave starts.
        let at_start = scenario.profiles.iter().flat_map(|profile| {
            let given = profile.targets.iter().filter(move |target| target.0 == at);
            profile.at(0.0).into_iter().flat_map(move |value| {
                given.clone().map(move |(_, index)| Setting { index: *index, value: value.clone() })
            })
        });
        let mut element = element.clone();
        element.settings.extend(at_start);
        match start(&element) {
            Ok(slave) => slaves.push(Slave { name: element.name.clone(), slave }),
            Err(findings) => refused.extend(findings),
        }
    }
    if !refused.is_empty() {
        return Err(Refused(refused));
    }
    let wires = wires(scenario);
    let mut run = Run::default();
    let outputs = outputs(scenario, wanted, &mut run.recording);
    let mut carried = Vec::with_capacity(wires.len());

    let steps = steps(scenario);
    for step in 0..=steps {
        let time_s = step as f64 * scenario.step_s;
        run.recording.time_s.push(time_s);
        for (column, (element, index)) in run.recording.columns.iter_mut().zip(&outputs) {
            column.values.push(read(&mut slaves, (*element, *index)).as_f64());
        }
        if step == steps {
            break;
        }
        for profile in &scenario.profiles {
            if let Err(error) = apply(profile, time_s, &mut slaves) {
                run.fault = Some(error);
            }
        }
        // A slave that is read after one of its inputs was set computes its outputs anew: all are read first.
        carried.clear();
        carried.extend(wires.iter().map(|wire| read(&mut slaves, wire.from)));
        for (wire, value) in wires.iter().zip(&carried) {
            let set = slaves[wire.to.0].slave.set(wire.to.1, value.clone());
            debug_assert!(set.is_ok(), "an input takes any value");
        }
        for Slave { name, slave } in &mut slaves {
            let mut messages = Messages { name, lines: &mut run.messages };
            if let Err(fault) = slave.step(Step { time_s, length_s: scenario.step_s }, &mut messages) {
                run.fault = Some(format!("{name}: {fault}"));
            }
        }
        if run.fault.is_some() {
            break;
        }
        tell(step);
    }
    Ok(run)
}

/// Gives the targets of a profile their values; the error names the slave that refuses its value.
fn apply(profile: &Profile, time_s: f64, slaves: &mut [Slave]) -> Result<(), String> {
    let Some(value) = profile.at(time_s) else { return Ok(()) };
    for (element, index) in &profile.targets {
        let Slave { name, slave } = &mut slaves[*element];
        slave.set(*index, value.clone()).map_err(|error| format!("{name}: {error}"))?;
    }
    Ok(())
}

/// Number of communication steps of a run.
fn steps(scenario: &Scenario) -> usize {
    (scenario.duration_s / scenario.step_s).round() as usize
}

fn read(slaves: &mut [Slave], (element, index): (usize, usize)) -> Value {
    slaves[element].slave.get(index).expect("indices come from the table of the slave")
}

fn start(element: &Element) -> Result<Box<dyn Instance>, Vec<String>> {
    let mut slave = element.kind.instantiate();
    for setting in &element.settings {
        slave.set(setting.index, setting.value.clone()).map_err(|error| vec![format!("[{}] {error}", element.name)])?;
    }
    match slave.start() {
        Ok(()) => Ok(slave),
        Err(findings) => Err(findings.iter().map(|finding| format!("[{}] {finding}", element.name)).collect()),
    }
}

fn wires(scenario: &Scenario) -> Vec<Wire> {
    let find = |[element, variable]: &[String; 2]| {
        let at = scenario.elements.iter().position(|candidate| candidate.name == *element)?;
        let variables = scenario.elements[at].kind.variables();
        Some((at, variables.iter().position(|candidate| candidate.name == *variable)?))
    };
    let wire = |connection: crate::simulation::scenario::Connection| {
        let (from, to) = (find(&connection.from), find(&connection.to));
        Wire { from: from.expect("an output of a slave"), to: to.expect("an input of a slave") }
    };
    scenario.connections().into_iter().map(wire).collect()
}

/// Makes a column for every output that is wanted and says where each is found.
fn outputs(scenario: &Scenario, wanted: impl Fn(&str) -> bool, recording: &mut Recording) -> Vec<(usize, usize)> {
    let mut found = Vec::new();
    for (at, element) in scenario.elements.iter().enumerate() {
        for (index, variable) in element.kind.variables().iter().enumerate() {
            let name = format!("{}.{}", element.name, variable.name);
            if variable.causality == Causality::Output && wanted(&name) {
                found.push((at, index));
                recording.columns.push(Column { name, unit: variable.unit_name().into(), values: Vec::new() });
            }
        }
    }
    found
}
