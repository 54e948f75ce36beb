//! Scenarios: connections and start values of the variables.

use std::path::Path;
use std::sync::Arc;

use fmu_export::ModelType;
use fmu_export::variable::{Causality, Type, Value, Variability, Variable, element};
use serde::Deserialize;

use crate::control::reference::HARMONICS;
use crate::fmu::{self, estimator};
use crate::simulation::contour::Fit;

/// The built-in scenarios, by name.
pub const BUILT_IN: [(&str, &str); 10] = [
    ("paper", include_str!("scenarios/paper.toml")),
    ("experiment", include_str!("scenarios/experiment.toml")),
    ("unbalanced", include_str!("scenarios/unbalanced.toml")),
    ("turned", include_str!("scenarios/turned.toml")),
    ("run-up", include_str!("scenarios/run-up.toml")),
    ("lift-off", include_str!("scenarios/lift-off.toml")),
    ("coil-loss", include_str!("scenarios/coil-loss.toml")),
    ("circle", include_str!("scenarios/circle.toml")),
    ("hole", include_str!("scenarios/hole.toml")),
    ("standstill", include_str!("scenarios/standstill.toml")),
];

/// The contours used by built-in scenarios.
const BUILT_IN_CONTOURS: [(&str, &str); 1] = [("hole.csv", include_str!("scenarios/hole.csv"))];

/// What is wrong with a scenario; each finding on its own line.
#[derive(Debug, thiserror::Error)]
#[error("{origin}:\n  {}", .findings.join("\n  "))]
pub struct ScenarioError {
    /// The file or the built-in scenario.
    pub origin: String,
    /// The findings, each with the name of the key and what is expected.
    pub findings: Vec<String>,
}

/// The text of a scenario as TOML has it.
struct Document {
    title: String,
    description: String,
    duration: toml::Value,
    step: toml::Value,
    compare: Vec<String>,
    contour: Option<String>,
    profile: Vec<ProfileText>,
    all: toml::Table,
    plant: toml::Table,
    controller: toml::Table,
    estimator: toml::Table,
    tolerance: toml::Table,
}

impl Document {
    /// The keys.
    const KEYS: [&str; 12] = [
        "title",
        "description",
        "duration",
        "step",
        "compare",
        "contour",
        "profile",
        "all",
        "plant",
        "controller",
        "estimator",
        "tolerance",
    ];

    /// Takes the table apart key by key, so that one error does not hide others.
    fn new(mut table: toml::Table, text: &str, findings: &mut Vec<String>) -> Self {
        for key in ["title", "duration", "step"] {
            if !table.contains_key(key) {
                findings.push(format!("{key} is missing"));
            }
        }
        // A missing time has been reported; a valid one in its place raises no second finding.
        let mut time = |key: &str| table.remove(key).unwrap_or(toml::Value::Float(1.0));
        let (duration, step) = (time("duration"), time("step"));
        let document = Self {
            title: take(&mut table, "title", "a text", findings),
            description: take(&mut table, "description", "a text", findings),
            duration,
            step,
            compare: take(&mut table, "compare", "a list of methods", findings),
            contour: take(&mut table, "contour", "the name of a file", findings),
            profile: take(&mut table, "profile", "of = [names], time = [instants], value = [values]", findings),
            all: take(&mut table, "all", "a table", findings),
            plant: take(&mut table, "plant", "a table", findings),
            controller: take(&mut table, "controller", "a table", findings),
            estimator: take(&mut table, "estimator", "a table", findings),
            tolerance: take(&mut table, "tolerance", "a table", findings),
        };
        let places = toml::de::DeTable::parse(text).ok();
        for key in table.keys() {
            let place = places.as_ref().and_then(|places| places.get_ref().get_key_value(key.as_str()));
            let line = place.map_or(0, |(key, _)| text[..key.span().start].matches('\n').count() + 1);
            let suggestion = suggestion(key, &Self::KEYS.map(String::from));
            findings.push(format!("{key} in line {line}: there is no key of this name; {suggestion}"));
        }
        document
    }
}

/// Takes a key out of a table; an invalid one is reported and gets its default, like a missing one.
fn take<'t, T: Deserialize<'t> + Default>(
    table: &mut toml::Table,
    key: &str,
    wanted: &str,
    findings: &mut Vec<String>,
) -> T {
    let Some(value) = table.remove(key) else { return T::default() };
    value.try_into().unwrap_or_else(|error: toml::de::Error| {
        findings.push(format!("{key} is refused: expected {wanted} ({})", error.message()));
        T::default()
    })
}

/// A `[[profile]]` as TOML has it.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ProfileText {
    of: Vec<String>,
    time: Vec<toml::Value>,
    value: Vec<toml::Value>,
    #[serde(default)]
    hold: bool,
}

/// Values that variables take during a run: unconnected inputs and tunable parameters.
///
/// Real values are interpolated linearly between the instants; with `hold`, and for other types, the value stays until the next
/// instant. Before the first instant it is the first value, with `hold` the start value. A communication step uses the value at
/// its begin.
#[derive(Clone, Debug, PartialEq)]
pub struct Profile {
    /// Element and variable, by index, that take the values.
    pub targets: Vec<(usize, usize)>,
    /// The instants, in seconds, increasing.
    pub time_s: Vec<f64>,
    /// A value for each instant, in the unit of the variables.
    pub values: Vec<Value>,
    /// Whether values stay from one instant to the next.
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

/// A value that a scenario gives to a variable.
#[derive(Clone, Debug, PartialEq)]
pub struct Setting {
    /// Index of the variable in the table of its model.
    pub index: usize,
    /// The value, in the unit of the variable.
    pub value: Value,
}

/// A component of a scenario.
#[derive(Clone)]
pub struct Element {
    /// Name, unique in the scenario.
    pub name: String,
    /// Its model type.
    pub model_type: Arc<ModelType>,
    /// Values that differ from the start values.
    pub settings: Vec<Setting>,
}

/// A scenario, checked as far as possible without running it.
#[derive(Clone)]
pub struct Scenario {
    /// One line.
    pub title: String,
    /// A paragraph.
    pub description: String,
    /// Length of the run, in seconds.
    pub duration_s: f64,
    /// Communication step, in seconds.
    pub step_s: f64,
    /// The closed loop, `plant`, `controller`, `estimator`, followed by estimators that run beside it on the same data.
    pub elements: Vec<Element>,
    /// Values that change during the run.
    pub profiles: Vec<Profile>,
    /// How well a test bench is known, for `identify`: names and values as for `--tolerance`.
    pub tolerance: Vec<(String, String)>,
    /// Changes made when it was opened, each as `name=value`.
    pub changes: Vec<String>,
}

/// Connections of the closed loop, from an output to an input.
const LOOP: [[&str; 2]; 22] = [
    ["plant.Ym", "controller.Ym"],
    ["plant.Zm", "controller.Zm"],
    ["plant.im[1]", "controller.im[1]"],
    ["plant.im[2]", "controller.im[2]"],
    ["plant.im[3]", "controller.im[3]"],
    ["controller.i[1]", "plant.i[1]"],
    ["controller.i[2]", "plant.i[2]"],
    ["controller.i[3]", "plant.i[3]"],
    ["controller.u[1]", "plant.u[1]"],
    ["controller.u[2]", "plant.u[2]"],
    ["controller.u[3]", "plant.u[3]"],
    ["estimator.lambdaHat[1]", "controller.lambdaHat[1]"],
    ["estimator.lambdaHat[2]", "controller.lambdaHat[2]"],
    ["estimator.lambdaHat[3]", "controller.lambdaHat[3]"],
    ["estimator.valid", "controller.lambdaValid"],
    ["plant.Ym", "estimator.Ym"],
    ["plant.Zm", "estimator.Zm"],
    ["plant.im[1]", "estimator.im[1]"],
    ["plant.im[2]", "estimator.im[2]"],
    ["plant.im[3]", "estimator.im[3]"],
    ["plant.theta", "estimator.theta"],
    ["plant.omegam", "estimator.omega"],
];

/// Largest deviation of the reference trajectory from the points of its contour, relative to its size.
const CONTOUR_MISS: f64 = 0.01;

/// An output and the input connected to it, by element and variable name.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Connection {
    /// Element and variable of the output.
    pub from: [String; 2],
    /// Element and variable of the input.
    pub to: [String; 2],
}

impl Scenario {
    /// Reads a built-in scenario by its name, or else a file.
    ///
    /// # Errors
    /// All findings, each with the name of the key and what is expected.
    pub fn open(name: &Path) -> Result<Self, ScenarioError> {
        Self::open_with(name, &[])
    }

    /// As [`Self::open`], with the standard input under the name `-`, and with changes: pairs of a name and a value. A name is
    /// a path such as `plant.m`, or `m` for every element that has such a variable, or `duration`, `step` or `title`; a value
    /// is written as in a scenario, texts with or without quotes.
    ///
    /// # Errors
    /// As for [`Self::open`].
    pub fn open_with(name: &Path, changes: &[(String, String)]) -> Result<Self, ScenarioError> {
        let origin = name.display().to_string();
        if let Some((_, text)) = BUILT_IN.iter().find(|(built_in, _)| name == Path::new(built_in)) {
            return Self::parse_with(&origin, text, changes);
        }
        let read = if name == Path::new("-") {
            std::io::read_to_string(std::io::stdin())
        } else {
            std::fs::read_to_string(name)
        };
        let text = read.map_err(|error| {
            let names: Vec<_> = BUILT_IN.iter().map(|(name, _)| *name).collect();
            let finding = format!("cannot be read ({error}): expected a file, or one of {}", names.join(", "));
            ScenarioError { origin: origin.clone(), findings: vec![finding] }
        })?;
        Self::parse_with(&origin, &text, changes)
    }

    /// Parses a scenario. `origin` names its source in messages.
    ///
    /// # Errors
    /// As for [`Self::open`].
    pub fn parse(origin: &str, text: &str) -> Result<Self, ScenarioError> {
        Self::parse_with(origin, text, &[])
    }

    fn parse_with(origin: &str, text: &str, changes: &[(String, String)]) -> Result<Self, ScenarioError> {
        let mut findings = Vec::new();
        let mut table: toml::Table = match toml::from_str(text) {
            Ok(table) => table,
            Err(error) => {
                return Err(ScenarioError { origin: origin.into(), findings: vec![error.to_string()] });
            }
        };
        let (of_run, of_elements): (Vec<_>, Vec<_>) = changes
            .iter()
            .map(|(name, text)| (name.clone(), value_of(text)))
            .partition(|(name, _)| ["title", "duration", "step"].contains(&name.as_str()));
        table.extend(of_run);
        let document = Document::new(table, text, &mut findings);
        let folder = Path::new(origin).parent().unwrap_or(Path::new(""));
        let mut scenario = read(document, folder, &of_elements, &mut findings);
        scenario.changes = changes.iter().map(|(name, value)| format!("{name}={value}")).collect();
        if findings.is_empty() { Ok(scenario) } else { Err(ScenarioError { origin: origin.into(), findings }) }
    }

    /// The connections, including those of the estimators beside the loop.
    pub fn connections(&self) -> Vec<Connection> {
        let split = |path: &str| {
            let (element, variable) = path.split_once('.').expect("a path has an element and a variable");
            [element.to_owned(), variable.to_owned()]
        };
        let closed = LOOP.iter().map(|[from, to]| Connection { from: split(from), to: split(to) });
        let mut connections: Vec<_> = closed.collect();
        for element in self.elements.iter().skip(3) {
            let beside = LOOP
                .iter()
                .filter(|[_, to]| to.starts_with("estimator."))
                .map(|[from, to]| Connection { from: split(from), to: [element.name.clone(), split(to)[1].clone()] });
            connections.extend(beside);
        }
        connections
    }

    /// Finds the variable of a path such as `plant.lambda[1]`: the index of its element and its own.
    ///
    /// # Errors
    /// There is no such variable, or it cannot be set.
    pub fn settable(&self, path: &str) -> Result<(usize, usize), String> {
        let (name, key) = path.split_once('.').unwrap_or(("", path));
        let Some(at) = self.elements.iter().position(|element| element.name == name) else {
            let names: Vec<_> = self.elements.iter().map(|element| element.name.as_str()).collect();
            return Err(format!("{path}: expected a path that begins with one of {}", names.join(", ")));
        };
        let variables = self.elements[at].model_type.variables();
        let Some(index) = variables.iter().position(|variable| variable.name == key) else {
            let settable = variables.iter().filter(|variable| variable.is_settable());
            return Err(unknown(name, key, &settable.map(|variable| variable.name.to_string()).collect::<Vec<_>>()));
        };
        permitted(name, &variables[index]).map_err(|why| format!("{path} is refused: {why}"))?;
        Ok((at, index))
    }

    /// Sets the variable of a path from a text: a number with or without a unit, a name, `true` or `false`.
    ///
    /// # Errors
    /// What is wrong with the path or the value.
    pub fn assign(&mut self, path: &str, text: &str) -> Result<(), String> {
        let (at, index) = self.settable(path)?;
        let data_type = &self.elements[at].model_type.variables()[index].data_type;
        let text = text.trim();
        let value = match data_type {
            Type::Integer { .. } => text.parse().map(toml::Value::Integer).ok(),
            Type::Boolean { .. } => text.parse().map(toml::Value::Boolean).ok(),
            Type::Real { .. } | Type::Enumeration { .. } | Type::String { .. } => None,
        };
        let value = convert(data_type, &value.unwrap_or_else(|| toml::Value::String(text.into())));
        let value = value.map_err(|why| format!("{path} = {text} is refused: {why}"))?;
        self.elements[at].settings.push(Setting { index, value });
        Ok(())
    }

    /// The start value of a variable.
    pub fn value(&self, element: &str, variable: &str) -> Option<Value> {
        let element = self.elements.iter().find(|candidate| candidate.name == element)?;
        let variables = element.model_type.variables();
        let index = variables.iter().position(|candidate| candidate.name == variable)?;
        let set = element.settings.iter().rev().find(|setting| setting.index == index);
        Some(set.map_or_else(|| variables[index].start(), |setting| setting.value.clone()))
    }
}

/// A value as written after `--set`: TOML, or a text without quotes.
fn value_of(text: &str) -> toml::Value {
    let parsed = toml::from_str::<toml::Table>(&format!("value = {text}"));
    let value = parsed.ok().filter(|table| table.len() == 1).and_then(|mut table| table.remove("value"));
    value.unwrap_or_else(|| toml::Value::String(text.into()))
}

/// Applies changes to the elements, after the scenario itself.
fn change(changes: &[(String, toml::Value)], elements: &mut [Element], findings: &mut Vec<String>) {
    for (path, value) in changes {
        let (owner, key) = match path.split_once('.') {
            Some((name, key)) if elements.iter().any(|element| element.name == name) => (Some(name), key),
            _ => (None, path.as_str()),
        };
        let concerned = elements.iter_mut().filter(|element| owner.is_none_or(|name| element.name == name));
        let (known, others): (Vec<_>, Vec<_>) = concerned.partition(|element| knows(&element.model_type, key));
        if known.is_empty() {
            let models: Vec<_> = others.iter().map(|element| &*element.model_type).collect();
            let suggestion = suggestion(key, &names(&models));
            findings.push(format!("[--set] {path}: there is no variable of this name; {suggestion}"));
        }
        // A name without an element means all elements where the variable can be set: speed is an input of plant and estimator,
        // but that of the estimator is connected.
        let is_open = |element: &Element| {
            let index =
                position(&element.model_type, key).or_else(|| position(&element.model_type, &self::element(key, 0)));
            index.is_some_and(|index| permitted(&element.name, &element.model_type.variables()[index]).is_ok())
        };
        let is_open_anywhere = known.iter().any(|element| is_open(element));
        for element in known {
            if is_open(element) || !is_open_anywhere {
                set(&element.name, &element.model_type, "--set", key, value, &mut element.settings, findings);
            }
        }
    }
}

fn read(document: Document, folder: &Path, changes: &[(String, toml::Value)], findings: &mut Vec<String>) -> Scenario {
    let mut time = |key: &str, value: &toml::Value| {
        let unit = fmu_export::unit::SECOND;
        let data_type = Type::Real { start: 0.0, unit, display: None, nominal: 1.0, min: None, max: None };
        match convert(&data_type, value) {
            Ok(Value::Real(value)) if value.is_finite() && value > 0.0 => value,
            Ok(_) => {
                findings.push(format!("{key} = {value} is refused: expected a finite time above 0"));
                1.0
            }
            Err(why) => {
                findings.push(format!("{key} = {value} is refused: {why}"));
                1.0
            }
        }
    };
    let duration_s = time("duration", &document.duration);
    let step_s = time("step", &document.step);
    if findings.is_empty() && step_s > duration_s {
        findings.push(format!("step = {} is refused: expected at most the duration, {duration_s} s", document.step));
    }

    let [plant, controller, estimator, ..] = &fmu::catalogue()[..] else { unreachable!("there are more models") };
    let tables: [(&str, &Arc<ModelType>, &toml::Table); 3] = [
        ("plant", plant, &document.plant),
        ("controller", controller, &document.controller),
        ("estimator", estimator, &document.estimator),
    ];
    let mut elements: Vec<Element> = Vec::new();
    for (name, model_type, table) in tables {
        let mut settings = Vec::new();
        for (key, value) in flatten(&document.all) {
            // Keys of other elements are skipped; names that no element knows are reported below.
            if knows(model_type, &key) {
                set(name, model_type, "all", &key, value, &mut settings, findings);
            }
        }
        for (key, value) in flatten(table) {
            if knows(model_type, &key) {
                set(name, model_type, name, &key, value, &mut settings, findings);
            } else {
                findings.push(unknown(name, &key, &names(&[model_type])));
            }
        }
        elements.push(Element { name: name.into(), model_type: model_type.clone(), settings });
    }
    for (key, _) in flatten(&document.all) {
        let models = tables.map(|(_, model_type, _)| &**model_type);
        if !models.iter().any(|model_type| knows(model_type, &key)) {
            findings.push(unknown("all", &key, &names(&models)));
        }
    }
    if let Some(file) = &document.contour {
        match contour(file, folder) {
            Ok(settings) => elements[1].settings.extend(settings),
            Err(why) => findings.push(format!("contour = \"{file}\" is refused: {why}")),
        }
    }
    change(changes, &mut elements, findings);
    beside(&document.compare, &mut elements, findings);
    let profiles =
        document.profile.iter().enumerate().filter_map(|(index, text)| profile(index, text, &elements, findings));
    let profiles = profiles.collect();
    let text = |value: toml::Value| value.as_str().map_or_else(|| value.to_string(), str::to_owned);
    let tolerance = flatten(&document.tolerance).into_iter().map(|(name, value)| (name, text(value.clone()))).collect();
    Scenario {
        title: document.title,
        description: document.description,
        duration_s,
        step_s,
        elements,
        profiles,
        tolerance,
        changes: Vec::new(),
    }
}

/// The settings of the controller for a contour file, named relative to the scenario.
fn contour(file: &str, folder: &Path) -> Result<Vec<Setting>, String> {
    let text = match BUILT_IN_CONTOURS.iter().find(|(name, _)| *name == file) {
        Some((_, text)) if !folder.join(file).exists() => (*text).to_owned(),
        _ => std::fs::read_to_string(folder.join(file)).map_err(|error| error.to_string())?,
    };
    let Fit { contour, largest_m } = crate::simulation::contour::read(&text)?;
    let largest_size = |values: &[f64]| values.iter().fold(0.0f64, |size, value| size.max(value.abs()));
    let size_m = largest_size(&contour.cos_y_m).max(largest_size(&contour.sin_z_m));
    if largest_m > CONTOUR_MISS * size_m {
        return Err(format!(
            "the Fourier series with {HARMONICS} harmonics misses a point by {:.3} µm, more than {} % of the contour's size",
            largest_m * 1e6,
            CONTOUR_MISS * 100.0
        ));
    }
    let mut values = vec![
        ("reference.centreY".to_owned(), contour.centre_m[0]),
        ("reference.centreZ".to_owned(), contour.centre_m[1]),
    ];
    for (name, coefficients) in [
        ("reference.cosY", contour.cos_y_m),
        ("reference.sinY", contour.sin_y_m),
        ("reference.cosZ", contour.cos_z_m),
        ("reference.sinZ", contour.sin_z_m),
    ] {
        values.extend(coefficients.into_iter().enumerate().map(|(n, value)| (element(name, n), value)));
    }
    let controller = fmu::find("FlatnessController").expect("a model of this project");
    let settings = values
        .into_iter()
        .map(|(name, value)| (name, Value::Real(value)))
        .chain([("reference.shape".to_owned(), Value::Integer(4))])
        .map(|(name, value)| Setting { index: position(&controller, &name).expect("a path has these"), value })
        .collect();
    Ok(settings)
}

/// Parses a `[[profile]]`; each finding names it by its number.
fn profile(index: usize, text: &ProfileText, elements: &[Element], findings: &mut Vec<String>) -> Option<Profile> {
    let before = findings.len();
    let mut refuse = |why: String| findings.push(format!("[[profile]] number {}: {why}", index + 1));
    let mut targets = Vec::new();
    for path in &text.of {
        let found = path.split_once('.').and_then(|(name, variable)| {
            let at = elements.iter().position(|element| element.name == name)?;
            Some((at, position(&elements[at].model_type, variable)?))
        });
        let Some((at, variable)) = found else {
            refuse(format!("there is no variable {path}; expected element.variable, as in plant.omega"));
            continue;
        };
        let known = &elements[at].model_type.variables()[variable];
        match permitted(&elements[at].name, known) {
            Err(why) => refuse(format!("{path}: {why}")),
            Ok(()) if known.causality == Causality::Parameter && known.variability != Variability::Tunable => {
                refuse(format!("{path} is fixed once the run has begun; expected an input or a tunable parameter"));
            }
            Ok(()) => targets.push((at, variable)),
        }
    }
    let Some(&(at, variable)) = targets.first() else {
        if text.of.is_empty() {
            refuse("of = [] names no variable".into());
        }
        return None;
    };
    let data_type = &elements[at].model_type.variables()[variable].data_type;
    let real = matches!(data_type, Type::Real { .. });
    let second =
        Type::Real { start: 0.0, unit: fmu_export::unit::SECOND, display: None, nominal: 1.0, min: None, max: None };
    let mut all = |data_type: &Type, values: &[toml::Value]| -> Vec<Value> {
        let one = |value| match convert(data_type, value) {
            Ok(value) => Some(value),
            Err(why) => {
                refuse(format!("{value} is refused: {why}"));
                None
            }
        };
        values.iter().filter_map(one).collect()
    };
    let time_s: Vec<f64> = all(&second, &text.time).into_iter().map(Value::as_f64).collect();
    let values = all(data_type, &text.value);
    let rises = time_s.windows(2).all(|pair| pair[0] < pair[1]) && time_s.iter().all(|time| time.is_finite());
    if text.time.is_empty() || text.time.len() != text.value.len() || !rises {
        refuse("expected as many values as times, at least one, with increasing times".into());
    }
    (findings.len() == before).then_some(Profile { targets, time_s, values, hold: text.hold || !real })
}

/// Adds estimators with other methods beside the loop.
fn beside(methods: &[String], elements: &mut Vec<Element>, findings: &mut Vec<String>) {
    let settings = elements[2].settings.clone();
    let model_type = elements[2].model_type.clone();
    let index = model_type
        .variables()
        .iter()
        .position(|variable| variable.name == "method")
        .expect("the estimator has a method");
    for method in methods {
        let value = match estimator::METHOD.find(method) {
            Ok(value) => value,
            Err(wanted) => {
                findings.push(format!("compare = \"{method}\" is refused: {wanted}"));
                continue;
            }
        };
        if elements.iter().any(|element| element.name == *method) {
            findings.push(format!("compare = \"{method}\" is refused: it is listed twice"));
            continue;
        }
        let mut settings = settings.clone();
        settings.push(Setting { index, value: Value::Integer(value) });
        elements.push(Element { name: method.clone(), model_type: model_type.clone(), settings });
    }
}

/// The leaves of a table with their keys joined by dots, so that `reference.rY` may be a dotted key in TOML.
fn flatten(table: &toml::Table) -> Vec<(String, &toml::Value)> {
    let mut leaves = Vec::new();
    for (key, value) in table {
        match value {
            toml::Value::Table(inner) => {
                leaves.extend(flatten(inner).into_iter().map(|(rest, value)| (format!("{key}.{rest}"), value)));
            }
            value => leaves.push((key.clone(), value)),
        }
    }
    leaves
}

fn position(model_type: &ModelType, name: &str) -> Option<usize> {
    model_type.variables().iter().position(|variable| variable.name == name)
}

/// Whether a model has a variable, or an array, of that name.
fn knows(model_type: &ModelType, key: &str) -> bool {
    position(model_type, key).is_some() || position(model_type, &element(key, 0)).is_some()
}

/// The names of the settable variables of these models, arrays by their common name.
fn names(models: &[&ModelType]) -> Vec<String> {
    let mut names: Vec<String> = Vec::new();
    for variable in
        models.iter().flat_map(|model_type| model_type.variables()).filter(|variable| variable.is_settable())
    {
        let name = variable.name.split('[').next().unwrap_or_default().to_owned();
        if !names.contains(&name) {
            names.push(name);
        }
    }
    names
}

fn unknown(table: &str, key: &str, known: &[String]) -> String {
    format!("[{table}] {key}: there is no variable of this name; {}", suggestion(key, known))
}

/// Suggests a name for an unknown one.
fn suggestion(key: &str, known: &[String]) -> String {
    let near = known
        .iter()
        .map(|name| (strsim::jaro_winkler(&name.to_lowercase(), &key.to_lowercase()), name))
        .filter(|(likeness, _)| *likeness > 0.8)
        .max_by(|one, other| one.0.total_cmp(&other.0));
    match near {
        Some((_, name)) => format!("did you mean {name}?"),
        None => format!("known are {}", known.join(", ")),
    }
}

/// Applies one key of a table to one element.
fn set(
    element_name: &str,
    model_type: &ModelType,
    table: &str,
    key: &str,
    value: &toml::Value,
    settings: &mut Vec<Setting>,
    findings: &mut Vec<String>,
) {
    let variables = model_type.variables();
    let mut one = |index: usize, value: &toml::Value| {
        let variable = &variables[index];
        match permitted(element_name, variable).and_then(|()| convert(&variable.data_type, value)) {
            Ok(value) => settings.push(Setting { index, value }),
            Err(why) => findings.push(format!("[{table}] {} = {value} is refused: {why}", variable.name)),
        }
    };
    if let Some(index) = position(model_type, key) {
        return one(index, value);
    }
    let indices: Vec<usize> = (0..).map_while(|k| position(model_type, &element(key, k))).collect();
    match value.as_array() {
        Some(values) if values.len() == indices.len() => {
            for (index, value) in indices.into_iter().zip(values) {
                one(index, value);
            }
        }
        _ => findings.push(format!("[{table}] {key} = {value} is refused: expected a list of {}", indices.len())),
    }
}

fn permitted(element: &str, variable: &Variable) -> Result<(), String> {
    if !variable.is_settable() {
        return Err("it is computed; only parameters and inputs can be set".into());
    }
    let path = format!("{element}.{}", variable.name);
    match LOOP.iter().find(|[_, to]| *to == path) {
        Some([from, _]) => Err(format!("it is connected to {from}")),
        None => Ok(()),
    }
}

/// A TOML value as the value of a variable. Numbers are in the unit of the interface; texts carry their unit.
fn convert(data_type: &Type, value: &toml::Value) -> Result<Value, String> {
    match (data_type, value) {
        (Type::Real { .. }, toml::Value::Float(value)) => Ok(Value::Real(*value)),
        (Type::Real { .. }, toml::Value::Integer(value)) => Ok(Value::Real(*value as f64)),
        (Type::Real { unit, .. }, toml::Value::String(text)) => {
            let text = text.trim();
            let (number, name) = text.split_once(char::is_whitespace).unwrap_or((text, unit.name));
            let number: f64 = number.parse().map_err(|_| format!("{number} is not a number"))?;
            unit.convert(number, name.trim()).map(Value::Real).ok_or_else(|| {
                let names: Vec<_> = unit.names().collect();
                format!("the unit {} is not one of {}", name.trim(), names.join(", "))
            })
        }
        (Type::Real { unit, .. }, _) => Err(format!("expected a number in {}, or a text like \"1 {0}\"", unit.name)),
        (Type::Integer { .. }, toml::Value::Integer(value)) => {
            i32::try_from(*value).map(Value::Integer).map_err(|_| "expected a whole number of 32 bits".into())
        }
        (Type::Integer { .. }, _) => Err("expected a whole number".into()),
        (Type::Boolean { .. }, toml::Value::Boolean(value)) => Ok(Value::Boolean(*value)),
        (Type::Boolean { .. }, _) => Err("expected true or false".into()),
        (Type::Enumeration { items, .. }, toml::Value::String(item)) => items.find(item).map(Value::Integer),
        (Type::String { .. }, toml::Value::String(text)) => Ok(Value::String(text.clone())),
        (Type::String { .. }, _) => Err("expected a text".into()),
        (Type::Enumeration { items, .. }, _) => Err(format!("expected the name of one of {}", items.listed())),
    }
}
