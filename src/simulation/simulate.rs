//! Runs a scenario as an importer would run the FMUs.
//!
//! At every communication point all outputs are read, then all connected inputs are set, then every instance does its step. No
//! instance sees the results of another's step before the next point, so their order does not matter.

use fmu_export::log::{Log, Topic};
use fmu_export::variable::{Causality, Value};
use fmu_export::{Instance, Step};

use crate::invalid::Short;
use crate::progress::Progress;
use crate::simulation::recording::{Column, Recording};
use crate::simulation::scenario::{Element, Profile, Scenario, Setting};

/// A run, complete or ended early.
#[derive(Clone, Debug, Default)]
pub struct Run {
    /// All outputs of all instances at every communication point reached.
    pub recording: Recording,
    /// Why the run ended early, if it did.
    pub error: Option<String>,
    /// Messages of the instances, each line with the name of the instance.
    pub messages: Vec<String>,
}

/// Why a run could not begin: every refused parameter.
#[derive(Clone, Debug, thiserror::Error)]
#[error("the scenario cannot be run:\n  {}", .0.join("\n  "))]
pub struct Refused(pub Vec<String>);

/// Memory that a recording may take, in bytes.
const MOST_BYTES: f64 = 8e9;

struct Running {
    name: String,
    instance: Box<dyn Instance>,
}

/// An output and the input connected to it, by index.
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
/// Every parameter that a model refuses. A run that ends early is no error: its results are kept, and [`Run::error`] gives the
/// reason.
pub fn run(scenario: &Scenario) -> Result<Run, Refused> {
    let progress = Progress::new("simulating", steps(scenario) as u64);
    run_for(scenario, |_| true, |step| progress.set(step as u64))
}

/// As [`run`], recording only the outputs whose paths are `wanted`; reports every step done.
///
/// # Errors
/// As for [`run`].
pub fn run_for(scenario: &Scenario, wanted: impl Fn(&str) -> bool, tell: impl FnMut(usize)) -> Result<Run, Refused> {
    run_altered(scenario, wanted, |_, _| (), tell)
}

/// As [`run_for`]; at each communication point `alter` may change the values on their way to the inputs, in the order of
/// [`Scenario::connections`]. It also gets the time in s.
///
/// # Errors
/// As for [`run`].
pub fn run_altered(
    scenario: &Scenario,
    wanted: impl Fn(&str) -> bool,
    mut alter: impl FnMut(f64, &mut [Value]),
    mut tell: impl FnMut(usize),
) -> Result<Run, Refused> {
    let mut instances = instances(scenario).map_err(Refused)?;
    let wires = wires(scenario);
    let mut run = Run::default();
    let outputs = outputs(scenario, wanted, &mut run.recording);
    fits(scenario, outputs.len())?;
    let mut carried = Vec::with_capacity(wires.len());

    let mut balance_s = scenario.balance_s;

    let steps = steps(scenario);
    for step in 0..=steps {
        let time_s = step as f64 * scenario.step_s;
        run.recording.time_s.push(time_s);
        for (column, (element, index)) in run.recording.columns.iter_mut().zip(&outputs) {
            column.values.push(read(&mut instances, (*element, *index)).as_f64());
        }
        if step == steps {
            break;
        }
        for profile in &scenario.profiles {
            if let Err(error) = apply(profile, time_s, &mut instances) {
                run.error = Some(error);
            }
        }
        if balance_s.is_some_and(|balance_s| time_s >= balance_s * (1.0 - 1e-9)) {
            balance_s = None;
            for (of_plant, of_estimator) in unbalances(scenario) {
                if let Err(error) = balance(&mut instances, &of_plant, &of_estimator) {
                    run.error = Some(error);
                }
            }
        }
        // Reading an instance after one of its inputs was set would compute its outputs again, so all outputs are read first.
        carried.clear();
        carried.extend(wires.iter().map(|wire| read(&mut instances, wire.from)));
        alter(time_s, &mut carried);
        for (wire, value) in wires.iter().zip(&carried) {
            let set = instances[wire.to.0].instance.set(wire.to.1, value.clone());
            debug_assert!(set.is_ok(), "an input takes any value");
        }
        for Running { name, instance } in &mut instances {
            let mut messages = Messages { name, lines: &mut run.messages };
            if let Err(error) = instance.step(Step { time_s, length_s: scenario.step_s }, &mut messages) {
                run.error = Some(format!("{name}: {error}"));
            }
        }
        if run.error.is_some() {
            break;
        }
        tell(step);
    }
    Ok(run)
}

/// Every parameter of a scenario that a model refuses.
pub fn refused(scenario: &Scenario) -> Vec<String> {
    instances(scenario).err().unwrap_or_default()
}

/// Starts an instance of every element, or returns every parameter that a model refuses.
fn instances(scenario: &Scenario) -> Result<Vec<Running>, Vec<String>> {
    let mut instances = Vec::new();
    let mut refused = Vec::new();
    for (at, element) in scenario.elements.iter().enumerate() {
        // A profile's value at time 0 is set before the instance starts.
        let at_start = scenario.profiles.iter().flat_map(|profile| {
            let given = profile.targets.iter().filter(move |target| target.0 == at);
            profile.at(0.0).into_iter().flat_map(move |value| {
                given.clone().map(move |(_, index)| Setting { index: *index, value: value.clone() })
            })
        });
        let mut element = element.clone();
        element.settings.extend(at_start);
        match start(&element) {
            Ok(instance) => instances.push(Running { name: element.name.clone(), instance }),
            Err(findings) => refused.extend(findings),
        }
    }
    if refused.is_empty() { Ok(instances) } else { Err(refused) }
}

/// Magnitude and phase of an unbalance, by element and variable.
type Unbalance = [(usize, usize); 2];

/// The unbalances of the plant and of the estimator in its loop, plane by plane.
fn unbalances(scenario: &Scenario) -> Vec<(Unbalance, Unbalance)> {
    let names = ["magnitude", "phase"].map(|what| scenario.machine.of_planes(what));
    let one = |element: usize, name: &str| Some((element, scenario.elements[element].index(name)?));
    let of = |element: usize, plane: usize| Some([one(element, &names[0][plane])?, one(element, &names[1][plane])?]);
    (0..scenario.machine.planes).filter_map(|plane| Some((of(0, plane)?, of(2, plane)?))).collect()
}

/// Fits a correction mass: the estimated unbalance is subtracted from that of the plant.
fn balance(instances: &mut [Running], of_plant: &Unbalance, of_estimator: &Unbalance) -> Result<(), String> {
    let mut vector = |[magnitude, phase]: &Unbalance| {
        let (magnitude, phase) = (read(instances, *magnitude).as_f64(), read(instances, *phase).as_f64());
        [magnitude * libm::cos(phase), magnitude * libm::sin(phase)]
    };
    let ([y, z], [y_hat, z_hat]) = (vector(of_plant), vector(of_estimator));
    let left = [y - y_hat, z - z_hat];
    let values = [libm::hypot(left[0], left[1]), libm::atan2(left[1], left[0])];
    for ((element, index), value) in of_plant.iter().zip(values) {
        let Running { name, instance } = &mut instances[*element];
        instance.set(*index, Value::Real(value)).map_err(|error| format!("{name}: {error}"))?;
    }
    Ok(())
}

/// Sets the targets of a profile; the error names the element that refuses the value.
fn apply(profile: &Profile, time_s: f64, instances: &mut [Running]) -> Result<(), String> {
    let Some(value) = profile.at(time_s) else { return Ok(()) };
    for (element, index) in &profile.targets {
        let Running { name, instance } = &mut instances[*element];
        instance.set(*index, value.clone()).map_err(|error| format!("{name}: {error}"))?;
    }
    Ok(())
}

/// Number of communication steps of a run.
fn steps(scenario: &Scenario) -> usize {
    (scenario.duration_s / scenario.step_s).round() as usize
}

/// Refuses a run whose recording would not fit into memory.
fn fits(scenario: &Scenario, outputs: usize) -> Result<(), Refused> {
    let samples = (scenario.duration_s / scenario.step_s).round() + 1.0;
    let bytes = samples * (outputs + 1) as f64 * size_of::<f64>() as f64;
    if bytes <= MOST_BYTES {
        return Ok(());
    }
    Err(Refused(vec![format!(
        "duration = {} s with step = {} s is refused: {} samples of {outputs} outputs take {} GB of memory, the limit is {} GB, \
         which is a duration of {} s",
        Short(scenario.duration_s),
        Short(scenario.step_s),
        Short(samples),
        Short(1e-9 * bytes),
        1e-9 * MOST_BYTES,
        Short((scenario.duration_s * MOST_BYTES / bytes).floor()),
    )]))
}

fn read(instances: &mut [Running], (element, index): (usize, usize)) -> Value {
    instances[element].instance.get(index).expect("indices come from the model's table")
}

/// Starts an instance of an element.
///
/// # Errors
/// Every value that the model refuses.
pub(crate) fn start(element: &Element) -> Result<Box<dyn Instance>, Vec<String>> {
    let mut instance = element.model_type.instantiate();
    for setting in &element.settings {
        instance
            .set(setting.index, setting.value.clone())
            .map_err(|error| vec![format!("[{}] {error}", element.name)])?;
    }
    match instance.start() {
        Ok(()) => Ok(instance),
        Err(findings) => Err(findings.iter().map(|finding| format!("[{}] {finding}", element.name)).collect()),
    }
}

fn wires(scenario: &Scenario) -> Vec<Wire> {
    let find = |[element, variable]: &[String; 2]| {
        let at = scenario.elements.iter().position(|candidate| candidate.name == *element)?;
        Some((at, scenario.elements[at].index(variable)?))
    };
    let wire = |connection: crate::simulation::scenario::Connection| {
        let (from, to) = (find(&connection.from), find(&connection.to));
        Wire { from: from.expect("an output of the model"), to: to.expect("an input of the model") }
    };
    scenario.connections().into_iter().map(wire).collect()
}

/// Makes a column for every wanted output and returns where to read each.
fn outputs(scenario: &Scenario, wanted: impl Fn(&str) -> bool, recording: &mut Recording) -> Vec<(usize, usize)> {
    let mut found = Vec::new();
    for (at, element) in scenario.elements.iter().enumerate() {
        for (index, variable) in element.model_type.variables().iter().enumerate() {
            let name = format!("{}.{}", element.name, variable.name);
            if variable.causality == Causality::Output && wanted(&name) {
                found.push((at, index));
                recording.columns.push(Column { name, unit: variable.unit_name().into(), values: Vec::new() });
            }
        }
    }
    found
}
