//! Runs a scenario like an importer of the FMUs.
//!
//! At every communication point all outputs are read, then all connected inputs are set, then every instance performs its step.
//! Results of a step are only visible at the next point, so the order of the instances does not matter.

use fmu_export::log::{Log, Topic};
use fmu_export::variable::{Causality, Value};
use fmu_export::{Instance, Step};

use crate::invalid::Short;
use crate::progress::Progress;
use crate::simulation::{Column, Element, Place, Recording, Scenario};

/// A run, complete or ended early.
#[derive(Clone, Debug, Default)]
pub struct Run {
    /// The recorded outputs at every communication point reached.
    pub recording: Recording,
    /// Why the run ended early, if it did.
    pub error: Option<String>,
    /// Messages of the instances, each line with the name of the instance.
    pub messages: Vec<String>,
}

/// Why a run could not start: every rejected parameter.
#[derive(Clone, Debug, thiserror::Error)]
#[error("the scenario cannot be run:\n  {}", .0.join("\n  "))]
pub struct Refused(pub Vec<String>);

/// Why a study stops.
#[derive(Clone, Debug, thiserror::Error)]
pub enum Stopped {
    /// Its scenario cannot be run.
    #[error(transparent)]
    Refused(#[from] Refused),
    /// A run ended early, for this reason.
    #[error("{0}")]
    Ended(String),
}

/// Memory limit of a recording, in bytes.
const MOST_BYTES: f64 = 8e9;

/// Gets the time in s, and may change the values sent to the inputs.
pub type Alter<'a> = &'a mut dyn FnMut(f64, &mut [Value]);

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
/// Every parameter that a model rejects. A run that ends early is no error: its results are kept, and [`Run::error`] gives the
/// reason.
pub fn run(scenario: &Scenario) -> Result<Run, Refused> {
    let progress = Progress::new("simulating", steps(scenario) as u64);
    let mut step = 0;
    let mut tell = |_: f64, _: &mut [Value]| {
        // Reading the clock may cost more than a step.
        if step % 1024 == 0 {
            progress.tell(step);
        }
        step += 1;
    };
    run_altered(scenario, &|_| true, &mut tell)
}

/// As [`run`], without a progress bar, recording only the outputs whose paths are `wanted`.
///
/// # Errors
/// As for [`run`].
pub fn run_for(scenario: &Scenario, wanted: impl Fn(&str) -> bool) -> Result<Run, Refused> {
    run_altered(scenario, &wanted, &mut |_, _| ())
}

/// As [`run_for`]; at each communication point `alter` gets the time in s and may change the values sent to the inputs, in the order
/// of [`Scenario::connections`].
///
/// # Errors
/// As for [`run`].
pub fn run_altered(scenario: &Scenario, wanted: &dyn Fn(&str) -> bool, alter: Alter<'_>) -> Result<Run, Refused> {
    let mut instances = instances(scenario)?;
    let wires = scenario.connections();
    let mut run = Run::default();
    let outputs = outputs(scenario, wanted, &mut run.recording);
    check_memory(scenario, outputs.len())?;
    let mut transferred = Vec::with_capacity(wires.len());
    let mut balance_s = scenario.balance_s;
    let steps = steps(scenario);
    for step in 0..=steps {
        let time_s = step as f64 * scenario.step_s;
        run.recording.time_s.push(time_s);
        for (column, place) in run.recording.columns.iter_mut().zip(&outputs) {
            column.values.push(read(&mut instances, *place).as_f64());
        }
        if step == steps {
            break;
        }
        for profile in &scenario.profiles {
            let value = profile.at(time_s);
            let values = profile.targets.iter().filter_map(|target| Some((*target, value.clone()?)));
            set(scenario, &mut instances, values).unwrap_or_else(|error| run.error = Some(error));
        }
        if balance_s.take_if(|balance_s| time_s >= *balance_s * (1.0 - 1e-9)).is_some() {
            balance(scenario, &mut instances).unwrap_or_else(|error| run.error = Some(error));
        }
        // Reading an instance after setting one of its inputs would recompute its outputs, so all outputs are read first.
        transferred.clear();
        transferred.extend(wires.iter().map(|[from, _]| read(&mut instances, *from)));
        alter(time_s, &mut transferred);
        for ([_, (element, index)], value) in wires.iter().zip(&transferred) {
            let set = instances[*element].set(*index, value.clone());
            debug_assert!(set.is_ok(), "an input takes any value");
        }
        for (Element { name, .. }, instance) in scenario.elements.iter().zip(&mut instances) {
            let mut messages = Messages { name, lines: &mut run.messages };
            if let Err(error) = instance.step(Step { time_s, length_s: scenario.step_s }, &mut messages) {
                run.error = Some(format!("{name}: {error}"));
            }
        }
        if run.error.is_some() {
            break;
        }
    }
    Ok(run)
}

/// Checks that every model accepts its parameters.
///
/// # Errors
/// Every parameter that a model rejects.
pub fn check(scenario: &Scenario) -> Result<(), Refused> {
    instances(scenario).map(drop)
}

/// Starts an instance of every element, or returns every rejected parameter with the elements that reject it.
fn instances(scenario: &Scenario) -> Result<Vec<Instance>, Refused> {
    let mut instances = Vec::new();
    let mut refused: Vec<(String, Vec<&str>)> = Vec::new();
    for (at, element) in scenario.elements.iter().enumerate() {
        let mut element = element.clone();
        // A profile's value at time 0 is set before the instance starts.
        for profile in &scenario.profiles {
            let (value, own) = (profile.at(0.0), profile.targets.iter().filter(|target| target.0 == at));
            element.settings.extend(own.filter_map(|(_, index)| Some((*index, value.clone()?))));
        }
        let name = scenario.elements[at].name.as_str();
        match start(&element) {
            Ok(instance) => instances.push(instance),
            Err(findings) => {
                findings.into_iter().for_each(|finding| match refused.iter_mut().find(|(known, _)| *known == finding) {
                    Some((_, names)) => names.push(name),
                    None => refused.push((finding, vec![name])),
                })
            }
        }
    }
    if refused.is_empty() {
        return Ok(instances);
    }
    Err(Refused(refused.iter().map(|(finding, names)| format!("[{}] {finding}", names.join(", "))).collect()))
}

/// Checks that the sensors and the exchange of values are as fast as the elements that read them: an estimator that gets every sample twice is never valid.
///
/// # Errors
/// The names of those that are too slow.
pub fn check_rates(scenario: &Scenario) -> Result<(), Refused> {
    let elements = || scenario.elements.iter();
    let time_s = |of: &Element, variable: &str| of.value(variable).map(Value::as_f64);
    let sensors = elements().filter_map(|of| Some((format!("{}.sensor.Ts", of.name), time_s(of, "sensor.Ts")?)));
    let too_slow = |(source, source_s): (String, f64)| {
        let faster = elements().filter_map(|of| Some((of.name.as_str(), time_s(of, "Ts")?)));
        let faster: Vec<_> = faster.filter(|(_, own_s)| source_s > own_s * (1.0 + 1e-9)).collect();
        let least_s = faster.iter().map(|(_, own_s)| *own_s).reduce(f64::min)?;
        let names = faster.iter().map(|(name, _)| *name).collect::<Vec<_>>().join(", ");
        Some(format!(
            "{source} = {source_s} s: expected at most Ts = {least_s} s, or {names} would read samples several times"
        ))
    };
    let found: Vec<_> =
        [("step".to_owned(), scenario.step_s)].into_iter().chain(sensors).filter_map(too_slow).collect();
    if found.is_empty() { Ok(()) } else { Err(Refused(found)) }
}

/// Fits correction masses: subtracts the estimated unbalance of each plane from that of the plant.
fn balance(scenario: &Scenario, instances: &mut [Instance]) -> Result<(), String> {
    let planes = scenario.machine.of_planes("magnitude").into_iter().zip(scenario.machine.of_planes("phase"));
    for (magnitude, phase) in planes {
        let place = |element: usize, name: &str| {
            (element, scenario.elements[element].index(name).expect("plant and estimator have the unbalance"))
        };
        let places = |element: usize| [place(element, &magnitude), place(element, &phase)];
        let mut vector = |element: usize| {
            let [magnitude, phase] = places(element).map(|place| read(instances, place).as_f64());
            [magnitude * libm::cos(phase), magnitude * libm::sin(phase)]
        };
        let ([y, z], [y_hat, z_hat]) = (vector(0), vector(2));
        let (y, z) = (y - y_hat, z - z_hat);
        set(scenario, instances, places(0).into_iter().zip([libm::hypot(y, z), libm::atan2(z, y)].map(Value::Real)))?;
    }
    Ok(())
}

/// Sets variables; the error names the element that rejects its value.
fn set(
    scenario: &Scenario,
    instances: &mut [Instance],
    values: impl IntoIterator<Item = (Place, Value)>,
) -> Result<(), String> {
    for ((element, index), value) in values {
        let refused = |error| format!("{}: {error}", scenario.elements[element].name);
        instances[element].set(index, value).map_err(refused)?;
    }
    Ok(())
}

/// Number of communication steps of a run.
fn steps(scenario: &Scenario) -> usize {
    (scenario.duration_s / scenario.step_s).round() as usize
}

/// Rejects a run whose recording would not fit into memory.
fn check_memory(scenario: &Scenario, outputs: usize) -> Result<(), Refused> {
    let samples = (scenario.duration_s / scenario.step_s).round() + 1.0;
    let bytes = samples * (outputs + 1) as f64 * size_of::<f64>() as f64;
    if bytes <= MOST_BYTES {
        return Ok(());
    }
    let (limit_s, limit_gb) = (scenario.duration_s * MOST_BYTES / bytes, 1e-9 * MOST_BYTES);
    let limit_s = if limit_s < 1.0 { limit_s } else { limit_s.floor() };
    let [duration, step, samples, gb, limit] =
        [scenario.duration_s, scenario.step_s, samples, 1e-9 * bytes, limit_s].map(Short);
    Err(Refused(vec![format!(
        "duration = {duration} s with step = {step} s is refused: {samples} samples of {outputs} outputs take {gb} GB of memory, the limit \
         is {limit_gb} GB, which is a duration of {limit} s"
    )]))
}

fn read(instances: &mut [Instance], (element, index): Place) -> Value {
    instances[element].get(index).expect("indices come from the model's table")
}

/// Starts an instance of an element.
///
/// # Errors
/// Every value that the model rejects.
pub fn start(element: &Element) -> Result<Instance, Vec<String>> {
    let mut instance = element.model_type.instantiate();
    for (index, value) in &element.settings {
        instance.set(*index, value.clone()).map_err(|error| vec![error.to_string()])?;
    }
    match instance.start() {
        Ok(()) => Ok(instance),
        Err(findings) => Err(findings.iter().map(ToString::to_string).collect()),
    }
}

/// Adds a column for every wanted output and returns their variables.
fn outputs(scenario: &Scenario, wanted: &dyn Fn(&str) -> bool, recording: &mut Recording) -> Vec<Place> {
    let mut found = Vec::new();
    for (at, element) in scenario.elements.iter().enumerate() {
        for (index, variable) in element.model_type.variables().iter().enumerate() {
            let name = element.path(index);
            if variable.causality == Causality::Output && wanted(&name) {
                found.push((at, index));
                recording.columns.push(Column { name, unit: variable.unit_name().into(), values: Vec::new() });
            }
        }
    }
    found
}
