//! Scenarios as TOML has them, from top to bottom: the document, its values, and the elements that take them.

use std::path::Path;

use fmu_export::ModelType;
use fmu_export::variable::{Causality, Type, Value, Variability, Variable, element};
use serde::Deserialize;

use super::{Connection, Element, Profile, Scenario, Setting, connected, foreign};
use crate::control::reference::HARMONICS;
use crate::estimation::Method;
use crate::fmu;
use crate::machine::{self, AXIAL, MACHINES, PLANAR};
use crate::simulation::contour::Fit;
use crate::simulation::simulate;
use crate::variables::{Choice, numbers};

/// Keys that a scenario must have in order to run.
pub const REQUIRED: [&str; 3] = ["title", "duration", "step"];

/// The elements of a closed loop.
pub const ELEMENTS: [&str; 3] = ["plant", "controller", "estimator"];

/// Reads a scenario with these required keys and with changes; contour files are named relative to the folder.
///
/// # Errors
/// All findings.
pub fn scenario(
    text: &str,
    folder: &Path,
    required: &[&str],
    changes: &[(String, String)],
) -> Result<Scenario, Vec<String>> {
    let mut findings = Vec::new();
    let mut table: toml::Table = toml::from_str(text).map_err(|error| vec![error.to_string()])?;
    let (of_run, of_elements): (Vec<_>, Vec<_>) = changes
        .iter()
        .map(|(name, text)| (name.clone(), value_of(text)))
        .partition(|(name, _)| REQUIRED.contains(&name.as_str()));
    table.extend(of_run);
    let document = Document::new(table, text, required, &mut findings);
    // Other findings would be about the wrong machine.
    if let Some(finding) = foreign::finding(&document.machine, &document.keys()) {
        findings.push(finding);
        return Err(findings);
    }
    let mut scenario = read(document, folder, &of_elements, &mut findings);
    scenario.changes = changes.iter().map(|(name, value)| format!("{name}={value}")).collect();
    if findings.is_empty() {
        return Ok(scenario);
    }
    // The models refuse values as well; a user sees all findings at once.
    findings.extend(simulate::refused(&scenario));
    Err(findings)
}

/// The text of a scenario as TOML has it, taken apart key by key, so that one error does not hide others.
macro_rules! document {
    ($($key:ident: $kind:ty, $wanted:literal;)*) => {
        struct Document {
            $($key: $kind,)*
        }

        impl Document {
            const KEYS: &[&str] = &[$(stringify!($key)),*];

            fn of(table: &mut toml::Table, findings: &mut Vec<String>) -> Self {
                Self { $($key: take(table, stringify!($key), $wanted, findings),)* }
            }
        }
    };
}

document! {
    title: String, "a text";
    description: String, "a text";
    machine: String, "a text";
    duration: Option<toml::Value>, "a time";
    step: Option<toml::Value>, "a time";
    compare: Vec<String>, "a list of methods";
    contour: Option<String>, "the name of a file";
    balance: Option<toml::Value>, "a time";
    profile: Vec<ProfileText>, "of = [names], time = [instants], value = [values]";
    all: toml::Table, "a table";
    plant: toml::Table, "a table";
    controller: toml::Table, "a table";
    estimator: toml::Table, "a table";
    tolerance: toml::Table, "a table";
    columns: toml::Table, "a table";
    identify: toml::Table, "a table";
}

impl Document {
    fn new(mut table: toml::Table, text: &str, required: &[&str], findings: &mut Vec<String>) -> Self {
        for key in required.iter().filter(|key| !table.contains_key(**key)) {
            findings.push(format!("{key} is missing"));
        }
        let document = Self::of(&mut table, findings);
        let places = toml::de::DeTable::parse(text).ok();
        let known: Vec<_> = Self::KEYS.iter().map(|key| (*key).to_owned()).collect();
        for key in table.keys() {
            let place = places.as_ref().and_then(|places| places.get_ref().get_key_value(key.as_str()));
            let line = place.map_or(0, |(key, _)| text[..key.span().start].matches('\n').count() + 1);
            let suggestion = suggestion(key, &known);
            findings.push(format!("{key} in line {line}: there is no key of this name; {suggestion}"));
        }
        document
    }

    /// The variables that it sets.
    fn keys(&self) -> Vec<foreign::Key> {
        let tables = [("all", &self.all)].into_iter().chain(self.elements());
        let names = |(element, table)| flatten(table).into_iter().map(move |(name, _)| (element, name));
        tables.flat_map(names).collect()
    }

    /// The elements and their tables.
    fn elements(&self) -> [(&'static str, &toml::Table); 3] {
        let [plant, controller, estimator] = ELEMENTS;
        [(plant, &self.plant), (controller, &self.controller), (estimator, &self.estimator)]
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

/// The type of a time.
const SECOND: Type =
    Type::Real { start: 0.0, unit: fmu_export::unit::SECOND, display: None, nominal: 1.0, min: None, max: None };

/// The contours used by built-in scenarios.
const BUILT_IN_CONTOURS: [(&str, &str); 1] = [("hole.csv", include_str!("../scenarios/hole.csv"))];

/// Largest deviation of the reference trajectory from the points of its contour, relative to its size.
const CONTOUR_MISS: f64 = 0.01;

/// A value as written after `--set`: TOML, or a text without quotes.
fn value_of(text: &str) -> toml::Value {
    let parsed = toml::from_str::<toml::Table>(&format!("value = {text}"));
    let value = parsed.ok().filter(|table| table.len() == 1).and_then(|mut table| table.remove("value"));
    value.unwrap_or_else(|| toml::Value::String(text.into()))
}

/// Applies changes to the elements, after the scenario itself.
fn change(
    changes: &[(String, toml::Value)],
    elements: &mut [Element],
    connected: &[Connection],
    findings: &mut Vec<String>,
) {
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
            let variable = first(&element.model_type, key).map(|index| &element.model_type.variables()[index]);
            variable.is_some_and(|variable| permitted(&element.name, variable, connected).is_ok())
        };
        let is_open_anywhere = known.iter().any(|element| is_open(element));
        for element in known {
            if is_open(element) || !is_open_anywhere {
                set(element, connected, "--set", key, value, findings);
            }
        }
    }
}

fn read(document: Document, folder: &Path, changes: &[(String, toml::Value)], findings: &mut Vec<String>) -> Scenario {
    let mut time = |key: &str, value: &toml::Value| {
        let time_s = convert(&SECOND, value).map(Value::as_f64).and_then(|time_s| {
            let is_possible = time_s.is_finite() && time_s > 0.0;
            is_possible.then_some(time_s).ok_or_else(|| "expected a finite time above 0".into())
        });
        time_s.unwrap_or_else(|why| {
            findings.push(format!("{key} = {value} is refused: {why}"));
            1.0
        })
    };
    // A missing time has been reported or is not used; a valid one in its place raises no second finding.
    let [duration, step] =
        [&document.duration, &document.step].map(|time| time.clone().unwrap_or(toml::Value::Float(1.0)));
    let (duration_s, step_s) = (time("duration", &duration), time("step", &step));
    let balance_s = document.balance.as_ref().map(|value| time("balance", value));
    if findings.is_empty() && step_s > duration_s {
        findings.push(format!("step = {step} is refused: expected at most the duration, {duration_s} s"));
    }

    let machine = if document.machine.is_empty() { Some(&MACHINES[0]) } else { machine::find(&document.machine) };
    let machine = machine.unwrap_or_else(|| {
        let names = MACHINES.map(|machine| machine.name.to_owned());
        let (given, suggestion) = (&document.machine, suggestion(&document.machine, &names));
        findings.push(format!("machine = \"{given}\" is refused: expected one of {}; {suggestion}", names.join(", ")));
        &MACHINES[0]
    });
    let element = |(name, (model, _)): (&str, (&str, &str))| {
        let model_type = fmu::find(model).expect("a model of this project");
        Element { name: name.into(), model_type, settings: Vec::new() }
    };
    let mut elements: Vec<_> = ELEMENTS.into_iter().zip(machine.models).map(element).collect();
    let connected = connected(&elements);
    let all = flatten(&document.all);
    for (element, (_, table)) in elements.iter_mut().zip(document.elements()) {
        // Keys of other elements are skipped; names that no element knows are reported below.
        let (name, model_type) = (element.name.clone(), element.model_type.clone());
        for (key, value) in all.iter().filter(|(key, _)| knows(&model_type, key)) {
            set(element, &connected, "all", key, value, findings);
        }
        for (key, value) in flatten(table) {
            if knows(&model_type, &key) {
                set(element, &connected, &name, &key, value, findings);
            } else {
                findings.push(unknown(&name, &key, &names(&[&model_type])));
            }
        }
    }
    let models: Vec<_> = elements.iter().map(|element| &*element.model_type).collect();
    for (key, _) in all.iter().filter(|(key, _)| !models.iter().any(|model_type| knows(model_type, key))) {
        findings.push(unknown("all", key, &names(&models)));
    }
    if let Some(file) = &document.contour {
        match contour(file, folder, &elements[1].model_type) {
            Ok(settings) => elements[1].settings.extend(settings),
            Err(why) => findings.push(format!("contour = \"{file}\" is refused: {why}")),
        }
    }
    change(changes, &mut elements, &connected, findings);
    beside(&document.compare, &mut elements, findings);
    let profiles = document
        .profile
        .iter()
        .enumerate()
        .filter_map(|(index, text)| profile(index, text, &elements, &connected, findings));
    let profiles = profiles.collect();
    if !document.identify.is_empty() && machine.name != AXIAL.name {
        findings.push(format!("[identify] is refused: it describes the bench of the machine {} alone", AXIAL.name));
    }
    Scenario {
        title: document.title,
        description: document.description,
        machine,
        duration_s,
        step_s,
        elements,
        connected,
        profiles,
        balance_s,
        tolerance: texts(&document.tolerance),
        columns: texts(&document.columns),
        identify: document.identify,
        changes: Vec::new(),
    }
}

/// The settings of the controller for a contour file, named relative to the scenario.
fn contour(file: &str, folder: &Path, controller: &ModelType) -> Result<Vec<Setting>, String> {
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
    numbers("reference.", &contour, &PLANAR)
        .into_iter()
        .map(|(name, value, _)| (name, Value::Real(value)))
        .chain([("reference.shape".to_owned(), Value::Integer(4))])
        .map(|(name, value)| {
            let index = position(controller, &name).ok_or("this machine follows no contours")?;
            Ok(Setting { index, value })
        })
        .collect()
}

/// Parses a `[[profile]]`; each finding names it by its number.
fn profile(
    index: usize,
    text: &ProfileText,
    elements: &[Element],
    connected: &[Connection],
    findings: &mut Vec<String>,
) -> Option<Profile> {
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
        match permitted(&elements[at].name, known, connected) {
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
    let time_s: Vec<f64> = all(&SECOND, &text.time).into_iter().map(Value::as_f64).collect();
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
    let Some(index) = position(&model_type, "method") else {
        if !methods.is_empty() {
            findings.push(format!("compare = {methods:?} is refused: {} has one method", model_type.info.name));
        }
        return;
    };
    for method in methods {
        let value = match Method::ENUMERATION.find(method) {
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
pub fn flatten(table: &toml::Table) -> Vec<(String, &toml::Value)> {
    leaves(table, &|_| false)
}

/// As `flatten`, where some tables are leaves.
pub fn leaves<'t>(table: &'t toml::Table, is_leaf: &dyn Fn(&toml::Table) -> bool) -> Vec<(String, &'t toml::Value)> {
    let mut found = Vec::new();
    for (key, value) in table {
        match value {
            toml::Value::Table(inner) if !is_leaf(inner) => {
                let inner = leaves(inner, is_leaf).into_iter();
                found.extend(inner.map(|(rest, value)| (format!("{key}.{rest}"), value)));
            }
            value => found.push((key.clone(), value)),
        }
    }
    found
}

/// A value without the quotes of a text.
pub fn text(value: &toml::Value) -> String {
    value.as_str().map_or_else(|| value.to_string(), str::to_owned)
}

/// Names and values of a table as texts.
pub fn texts(table: &toml::Table) -> Vec<(String, String)> {
    flatten(table).into_iter().map(|(name, value)| (name, text(value))).collect()
}

/// The index of the variable of a name.
pub fn position(model_type: &ModelType, name: &str) -> Option<usize> {
    model_type.variables().iter().position(|variable| variable.name == name)
}

/// Whether a model has a variable, or an array, of that name.
pub fn knows(model_type: &ModelType, key: &str) -> bool {
    first(model_type, key).is_some()
}

/// The index of the variable, or of the first element of the array, of that name.
fn first(model_type: &ModelType, key: &str) -> Option<usize> {
    position(model_type, key).or_else(|| position(model_type, &element(key, 0)))
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

/// There is no variable of this name.
pub fn unknown(table: &str, key: &str, known: &[String]) -> String {
    format!("[{table}] {key}: there is no variable of this name; {}", suggestion(key, known))
}

/// Suggests a name for an unknown one.
pub fn suggestion(key: &str, known: &[String]) -> String {
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
    element: &mut Element,
    connected: &[Connection],
    table: &str,
    key: &str,
    value: &toml::Value,
    findings: &mut Vec<String>,
) {
    let Element { name, model_type, settings } = element;
    let variables = model_type.variables();
    let mut one = |index: usize, value: &toml::Value| {
        let variable = &variables[index];
        match permitted(name, variable, connected).and_then(|()| convert(&variable.data_type, value)) {
            Ok(value) => settings.push(Setting { index, value }),
            Err(why) => findings.push(format!("[{table}] {} = {value} is refused: {why}", variable.name)),
        }
    };
    if let Some(index) = position(model_type, key) {
        return one(index, value);
    }
    let indices: Vec<usize> = (0..).map_while(|k| position(model_type, &self::element(key, k))).collect();
    match value.as_array() {
        Some(values) if values.len() == indices.len() => {
            for (index, value) in indices.into_iter().zip(values) {
                one(index, value);
            }
        }
        _ => findings.push(format!("[{table}] {key} = {value} is refused: expected a list of {}", indices.len())),
    }
}

/// Whether a variable of an element can be set.
pub fn permitted(element: &str, variable: &Variable, connected: &[Connection]) -> Result<(), String> {
    if !variable.is_settable() {
        return Err("it is computed; only parameters and inputs can be set".into());
    }
    match connected.iter().find(|connection| connection.to[0] == element && connection.to[1] == variable.name) {
        Some(Connection { from, .. }) => Err(format!("it is connected to {}", from.join("."))),
        None => Ok(()),
    }
}

/// A TOML value as the value of a variable. Numbers are in the unit of the interface; texts carry their unit.
pub fn convert(data_type: &Type, value: &toml::Value) -> Result<Value, String> {
    match (data_type, value) {
        (Type::Real { .. }, toml::Value::Float(value)) => Ok(Value::Real(*value)),
        (Type::Real { .. }, toml::Value::Integer(value)) => Ok(Value::Real(*value as f64)),
        (Type::Real { unit, .. }, toml::Value::String(text)) => {
            let text = text.trim();
            // With or without a blank between them; 1e-3 is a number, not 1 of a unit e-3.
            let ends = (1..=text.len()).rev().filter(|end| text.is_char_boundary(*end));
            let number_and_unit = |end| Some((text[..end].trim_end().parse::<f64>().ok()?, text[end..].trim_start()));
            let first = text.split_whitespace().next().unwrap_or_default();
            let (number, name) =
                ends.filter_map(number_and_unit).next().ok_or_else(|| format!("{first} is not a number"))?;
            let name = if name.is_empty() { unit.name } else { name };
            unit.convert(number, name).map(Value::Real).ok_or_else(|| {
                let names: Vec<_> = unit.names().collect();
                format!("the unit {name} is not one of {}", names.join(", "))
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
        _ => Err("variables of this type cannot be set in a scenario".into()),
    }
}
