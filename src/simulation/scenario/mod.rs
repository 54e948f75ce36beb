//! Scenarios: the models of a closed loop, their connections and start values. `read.rs` parses TOML.

mod foreign;
mod read;
mod write;

use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::path::Path;
use std::sync::Arc;

use fmu_export::ModelType;
use fmu_export::variable::{Causality, Value, Variable};

pub use self::read::{ALIKE, from_unit, knows, leaves, likeness, names, number_and_unit, suggestion, text};
use self::read::{permitted, unknown};
use crate::estimation::Method;
use crate::machine::{self, Machine};
use crate::variables::Choice;

/// Scenarios by name, with their texts.
macro_rules! built_in {
    ($($name:literal)*) => { [$(($name, include_str!(concat!("../scenarios/", $name, ".toml")))),*] };
}

/// The built-in scenarios, by name.
pub const BUILT_IN: [(&str, &str); 16] = built_in!(
    "paper" "experiment" "unbalanced" "turned" "run-up" "lift-off" "coil-loss" "circle" "hole" "standstill"
    "spindle" "balance" "planar4" "spindle4" "axial" "levitation"
);

/// The text of a built-in scenario.
pub fn built_in(name: &Path) -> Option<&'static str> {
    BUILT_IN.iter().find(|(built_in, _)| name == Path::new(built_in)).map(|(_, text)| *text)
}

/// The text of a built-in scenario, of the standard input for `-`, or else of a file.
///
/// # Errors
/// The file cannot be read.
pub fn text_of(name: &Path) -> Result<String, ScenarioError> {
    let text = match built_in(name) {
        Some(text) => Ok(text.to_owned()),
        None if name == Path::new("-") => std::io::read_to_string(std::io::stdin()),
        None => std::fs::read_to_string(name),
    };
    text.map_err(|error| {
        let wanted = match error.kind() {
            std::io::ErrorKind::InvalidData => "a text file (importers run FMUs and SSPs)",
            _ => "a file",
        };
        let finding = format!("cannot be read ({error}): expected {wanted}, or one of {}", built_in_names());
        ScenarioError { origin: name.display().to_string(), findings: vec![finding] }
    })
}

/// The names of the built-in scenarios, for messages.
pub fn built_in_names() -> String {
    BUILT_IN.map(|(name, _)| name).join(", ")
}

/// A name and a value, as in `name=value`.
pub type Pair = (String, String);

/// Findings about a scenario, or about a design of many, each on its own line.
#[derive(Debug, thiserror::Error)]
#[error("{origin}:\n  {}", .findings.join("\n  "))]
pub struct ScenarioError {
    /// The file or the built-in scenario.
    pub origin: String,
    /// The findings, each with the name of the key and the expected value.
    pub findings: Vec<String>,
}

/// Values of variables over a run: unconnected inputs and tunable parameters.
///
/// Real values are interpolated linearly between the instants; with `hold`, and for other types, the value is held until the next
/// instant. Before the first instant the first value applies, with `hold` the start value. A communication step uses the value at
/// its beginning.
#[derive(Clone, Debug, PartialEq)]
pub struct Profile {
    /// The variables.
    pub targets: Vec<Place>,
    /// The instants, in seconds, increasing.
    pub time_s: Vec<f64>,
    /// A value for each instant, in the unit of the variables.
    pub values: Vec<Value>,
    /// Whether values are held from one instant to the next.
    pub hold: bool,
}

impl Profile {
    /// The value at an instant in seconds, if there is one.
    pub fn at(&self, time_s: f64) -> Option<Value> {
        // Instants and communication points are computed in floating point.
        const ROUNDING_S: f64 = 1e-9;
        let passed = self.time_s.partition_point(|instant| *instant <= time_s + ROUNDING_S);
        if passed == 0 {
            return (!self.hold).then(|| self.values[0].clone());
        }
        match (&self.values[passed - 1], self.values.get(passed)) {
            (Value::Real(from), Some(Value::Real(to))) if !self.hold => {
                let [begin, end] = [self.time_s[passed - 1], self.time_s[passed]];
                Some(Value::Real(from + (to - from) * ((time_s - begin) / (end - begin)).max(0.0)))
            }
            (value, _) => Some(value.clone()),
        }
    }
}

/// A component of a scenario.
#[derive(Clone)]
pub struct Element {
    /// Name, unique in the scenario.
    pub name: String,
    /// Its model type.
    pub model_type: Arc<ModelType>,
    /// Values that override start values: index in the table of the model, and value in the unit of the variable.
    pub settings: Vec<(usize, Value)>,
}

impl Element {
    /// Index of the variable of this name.
    pub fn index(&self, variable: &str) -> Option<usize> {
        read::position(&self.model_type, variable)
    }

    /// The path of the variable of this index, such as `plant.lambda[1]`.
    pub fn path(&self, index: usize) -> String {
        format!("{}.{}", self.name, self.model_type.variables()[index].name)
    }

    /// The start value of a variable.
    pub fn value(&self, variable: &str) -> Option<Value> {
        let index = self.index(variable)?;
        let set = self.settings.iter().rev().find(|(set, _)| *set == index);
        Some(set.map_or_else(|| self.model_type.variables()[index].start(), |(_, value)| value.clone()))
    }

    /// Sets the start value of a variable, if there is one of this name.
    pub fn set(&mut self, variable: &str, value: impl Into<Value>) {
        self.settings.extend(self.index(variable).map(|index| (index, value.into())));
    }

    /// The settings in the order of the variables; the last one for a variable applies.
    pub fn values(&self) -> Vec<(usize, Value)> {
        self.settings.iter().cloned().collect::<BTreeMap<_, _>>().into_iter().collect()
    }
}

/// A variable: index of its element, and its own index.
pub type Place = (usize, usize);

/// A scenario, checked as far as possible without running it.
#[derive(Clone)]
pub struct Scenario {
    /// One line.
    pub title: String,
    /// A paragraph.
    pub description: String,
    /// The machine.
    pub machine: &'static Machine,
    /// Duration of the run, in seconds.
    pub duration_s: f64,
    /// Communication step, in seconds.
    pub step_s: f64,
    /// The closed loop, `plant`, `controller`, `estimator`, followed by estimators that run beside it on the same data.
    pub elements: Vec<Element>,
    /// Values that change during the run.
    pub profiles: Vec<Profile>,
    /// Time in s at which correction masses for the estimated unbalance are fitted, if at all.
    pub balance_s: Option<f64>,
    /// Uncertainties of a test bench, for `identify`: names and values as for `--tolerance`.
    pub tolerance: Vec<Pair>,
    /// Columns of recordings, for `identify`: signals with one of the endings [`OF_COLUMN`], values as for `--column`, `--unit` and `--zero`.
    pub columns: Vec<Pair>,
    /// The bench for `identify`, machine `axial` only.
    pub identify: toml::Table,
    /// Changes applied on opening, each as `name=value`.
    pub changes: Vec<String>,
}

/// Endings of the keys for the name of the column of a signal, its unit and its zero.
pub const OF_COLUMN: [&str; 3] = [".name", ".unit", ".zero"];

/// Indices of the elements of the closed loop.
const PLANT: usize = 0;
const CONTROLLER: usize = 1;
const ESTIMATOR: usize = 2;

/// Source and sink of each group of connections: outputs and inputs of the same name, and of these pairs of names.
const LOOP: [([usize; 2], &[[&str; 2]]); 4] = [
    ([PLANT, CONTROLLER], &[]),
    ([CONTROLLER, PLANT], &[]),
    ([ESTIMATOR, CONTROLLER], &[["valid", "lambdaValid"]]),
    ([PLANT, ESTIMATOR], &[["omegam", "omega"]]),
];

/// The output that a variable of the element `at` is connected to, if `from` is the source of such a connection: by one of the pairs of names
/// or by its own name.
fn output(from: &Element, renamed: &[[&str; 2]], input: &Variable) -> Option<usize> {
    let name = renamed.iter().find(|[_, name]| *name == input.name).map_or(&*input.name, |[name, _]| name);
    let output = from.index(name)?;
    let is_output = from.model_type.variables()[output].causality == Causality::Output;
    (input.causality == Causality::Input && is_output).then_some(output)
}

/// The output that a variable of an element is connected to.
fn source(elements: &[Element], at: usize, variable: &Variable) -> Option<Place> {
    let mut routes = LOOP.iter().filter(|([_, sink], _)| *sink == at.min(ESTIMATOR));
    routes.find_map(|([from, _], renamed)| Some((*from, output(elements.get(*from)?, renamed, variable)?)))
}

/// Finds a variable that can be set by its path.
fn settable(elements: &[Element], path: &str) -> Result<Place, String> {
    let (name, key) = path.split_once('.').unwrap_or(("", path));
    let Some(at) = elements.iter().position(|element| element.name == name) else {
        let knowing = elements.iter().filter(|element| element.index(path).is_some());
        let paths: Vec<_> = knowing.map(|element| format!("{}.{path}", element.name)).collect();
        let names: Vec<_> = elements.iter().map(|element| element.name.as_str()).collect();
        return Err(match paths.is_empty() {
            true => format!("{path}: expected a path that begins with one of {}", names.join(", ")),
            false => format!("{path}: expected {}", paths.join(", ")),
        });
    };
    let variables = elements[at].model_type.variables();
    let Some(index) = elements[at].index(key) else {
        let settable = variables.iter().filter(|variable| variable.is_settable());
        return Err(unknown(name, key, &settable.map(|variable| &*variable.name).collect::<Vec<_>>()));
    };
    permitted(elements, at, &variables[index]).map_err(|why| format!("{path} is refused: {why}"))?;
    Ok((at, index))
}

impl Scenario {
    /// Reads a built-in scenario by its name, or else a file.
    ///
    /// # Errors
    /// All findings, each with the name of the key and the expected value.
    pub fn open(name: &Path) -> Result<Self, ScenarioError> {
        Self::open_with(name, &[])
    }

    /// As [`Self::open`], with the standard input for `-`, and with changes: pairs of a name and a value. A name is a path such as
    /// `plant.m`, or `m` for every element with such a variable, or `duration`, `step` or `title`; a value is written as in a
    /// scenario, texts with or without quotes.
    ///
    /// # Errors
    /// As for [`Self::open`].
    pub fn open_with(name: &Path, changes: &[Pair]) -> Result<Self, ScenarioError> {
        Self::open_requiring(name, &read::REQUIRED, changes)
    }

    /// As [`Self::open_with`], but only for the parameters: title, duration and step may be missing.
    ///
    /// # Errors
    /// As for [`Self::open`].
    pub fn open_parameters(name: &Path, changes: &[Pair]) -> Result<Self, ScenarioError> {
        Self::open_requiring(name, &[], changes)
    }

    fn open_requiring(name: &Path, required: &[&str], changes: &[Pair]) -> Result<Self, ScenarioError> {
        read::scenario(&name.display().to_string(), &text_of(name)?, required, changes)
    }

    /// The machine named in a scenario, built-in or a file; none if it names none or cannot be read.
    pub fn machine_of(name: &Path) -> Option<&'static Machine> {
        let text = text_of(Some(name).filter(|name| *name != Path::new("-"))?).ok()?;
        machine::find(text.parse::<toml::Table>().ok()?.get("machine")?.as_str()?)
    }

    /// A scenario of a machine with all variables at their start values.
    pub fn plain(machine: &Machine) -> Self {
        let text = format!("machine = \"{}\"", machine.name);
        read::scenario(machine.name, &text, &[], &[]).expect("a scenario without values is sound")
    }

    /// Parses a scenario. `origin` names its source in messages.
    ///
    /// # Errors
    /// As for [`Self::open`].
    pub fn parse(origin: &str, text: &str) -> Result<Self, ScenarioError> {
        read::scenario(origin, text, &read::REQUIRED, &[])
    }

    /// The plant.
    pub fn plant(&self) -> &Element {
        &self.elements[PLANT]
    }

    /// The controller.
    pub fn controller(&self) -> &Element {
        &self.elements[CONTROLLER]
    }

    /// The estimator in the loop.
    pub fn estimator(&self) -> &Element {
        &self.elements[ESTIMATOR]
    }

    /// Plant, controller and estimator.
    pub fn in_loop(&self) -> &[Element] {
        &self.elements[..3]
    }

    /// Estimators that run beside the loop on the same data.
    pub fn compared_estimators(&self) -> &[Element] {
        self.elements.get(3..).unwrap_or_default()
    }

    /// Removes the estimators beside the loop.
    pub fn remove_compared(&mut self) {
        self.elements.truncate(3);
    }

    /// The element of this name.
    fn element(&self, name: &str) -> Option<&Element> {
        self.elements.iter().find(|element| element.name == name)
    }

    /// The path of a variable, such as `plant.lambda[1]`.
    pub fn path(&self, (element, variable): Place) -> String {
        self.elements[element].path(variable)
    }

    /// The connections, each from an output to an input, including those of the estimators beside the loop.
    pub fn connections(&self) -> Vec<[Place; 2]> {
        let mut connections = Vec::new();
        for ([from, sink], renamed) in LOOP {
            let Some(source) = self.elements.get(from) else { continue };
            for (to, element) in self.elements.iter().enumerate().filter(|(to, _)| ESTIMATOR.min(*to) == sink) {
                for (input, variable) in element.model_type.variables().iter().enumerate() {
                    let output = output(source, renamed, variable);
                    connections.extend(output.map(|output| [(from, output), (to, input)]));
                }
            }
        }
        connections
    }

    /// Speed of the rotor at the start, rpm, to a thousandth, if it turns about an axis.
    pub fn speed_rpm(&self) -> Option<f64> {
        let omega = self.value("plant", "omega")?.as_f64();
        Some((omega * 60e3 / TAU).round() / 1e3)
    }

    /// Whether magnet k, counted from 0, is used: an axial bearing may use only one.
    pub fn uses(&self, k: usize) -> bool {
        let used = self.value("controller", "magnets.used").map_or(1.0, Value::as_f64);
        used == 1.0 || used == 2.0 + k as f64
    }

    /// The magnets that are used.
    pub fn used(&self) -> Vec<usize> {
        (0..self.machine.magnets()).filter(|k| self.uses(*k)).collect()
    }

    /// Finds the variable of a path such as `plant.lambda[1]`.
    ///
    /// # Errors
    /// There is no such variable, or it cannot be set.
    pub fn settable(&self, path: &str) -> Result<Place, String> {
        settable(&self.elements, path)
    }

    /// Sets the variable of a path from a text: a number with or without a unit, a name, `true` or `false`.
    ///
    /// # Errors
    /// An invalid path or value.
    pub fn assign(&mut self, path: &str, text: &str) -> Result<(), String> {
        let ((at, index), value) = self.converted(path, text)?;
        self.elements[at].settings.push((index, value));
        Ok(())
    }

    /// Checks that the variable of a path may have this value, as [`Self::assign`] and also against its limits.
    ///
    /// # Errors
    /// An invalid path or value.
    pub fn admits(&self, path: &str, text: &str) -> Result<(), String> {
        let ((at, index), value) = self.converted(path, text)?;
        let variable = &self.elements[at].model_type.variables()[index];
        variable.accepts(&value).map_err(|why| format!("{}.{why}", self.elements[at].name))
    }

    /// The variable of a path, and its value from a text.
    fn converted(&self, path: &str, text: &str) -> Result<(Place, Value), String> {
        let (at, index) = self.settable(path)?;
        let data_type = &self.elements[at].model_type.variables()[index].data_type;
        let value = read::convert(data_type, &read::value_of(text.trim()));
        Ok(((at, index), value.map_err(|why| format!("{path} = {text} is refused: {why}"))?))
    }

    /// Sets the start value of a variable, if there are such an element and variable.
    pub fn set(&mut self, element: &str, variable: &str, value: impl Into<Value>) {
        if let Some(element) = self.elements.iter_mut().find(|candidate| candidate.name == element) {
            element.set(variable, value);
        }
    }

    /// As [`Self::set`], in every element.
    pub fn set_everywhere(&mut self, variable: &str, value: impl Into<Value> + Clone) {
        self.elements.iter_mut().for_each(|element| element.set(variable, value.clone()));
    }

    /// Adds a [`Profile`] for the variables of these paths, with times in s.
    ///
    /// # Panics
    /// If a path is not that of a settable variable.
    pub fn follow(&mut self, paths: &[&str], time_s: &[f64], values: impl IntoIterator<Item: Into<Value>>, hold: bool) {
        let targets = paths.iter().map(|path| self.settable(path).expect("a variable of the loop")).collect();
        let values = values.into_iter().map(Into::into).collect();
        self.profiles.push(Profile { targets, time_s: time_s.to_vec(), values, hold });
    }

    /// Whether the scenario sets a variable.
    pub fn is_stated(&self, element: &str, variable: &str) -> bool {
        self.element(element).is_some_and(|element| {
            let index = element.index(variable);
            element.settings.iter().any(|(set, _)| Some(*set) == index)
        })
    }

    /// The start value of a variable.
    pub fn value(&self, element: &str, variable: &str) -> Option<Value> {
        self.element(element)?.value(variable)
    }

    /// The start value of a numeric variable; NaN if there is none of this name.
    pub fn number(&self, element: &str, variable: &str) -> f64 {
        self.value(element, variable).map_or(f64::NAN, Value::as_f64)
    }

    /// The method of an estimator, if it has several.
    pub fn method(&self, estimator: &str) -> Option<&'static str> {
        Method::of_number(self.value(estimator, "method")?.as_f64() as i32).map(Method::name)
    }

    /// The start value of a numeric variable of the plant.
    pub fn real(&self, variable: &str) -> Option<f64> {
        self.value("plant", variable).map(Value::as_f64)
    }

    /// The true λ of all magnets, in N·m²/A².
    pub fn truth(&self) -> Vec<f64> {
        self.machine.of_magnets("lambda").iter().map(|name| self.number("plant", name)).collect()
    }
}
