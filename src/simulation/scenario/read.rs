//! Reads scenarios from TOML. From top to bottom: the document, its values, and the elements that receive them.

use std::borrow::Borrow;
use std::collections::HashSet;
use std::path::Path;

use fmu_export::ModelType;
use fmu_export::variable::{Causality, Type, Value, Variability, Variable, element};
use serde::Deserialize;

use super::{Element, OF_COLUMN, Pair, Profile, Scenario, ScenarioError, foreign, settable, source};
use crate::control::reference::HARMONICS;
use crate::estimation::Method;
use crate::fmu;
use crate::machine::{self, AXIAL, MACHINES, Machine, PLANAR};
use crate::simulation::contour::{self, Fit};
use crate::simulation::simulate;
use crate::variables::{Choice, Unit, numbers};

/// Keys required to run a scenario.
pub const REQUIRED: [&str; 3] = ["title", "duration", "step"];

/// The table of values for all elements.
const ALL: &str = "all";

/// The elements of a closed loop.
pub const ELEMENTS: [&str; 3] = ["plant", "controller", "estimator"];

/// Reads a scenario with these required keys and applies changes. `origin` names its source in messages; paths of contour files
/// are relative to its folder.
///
/// # Errors
/// All findings.
pub fn scenario(origin: &str, text: &str, required: &[&str], changes: &[Pair]) -> Result<Scenario, ScenarioError> {
    let refuse = |findings: Vec<String>| ScenarioError { origin: origin.into(), findings };
    let mut findings = Vec::new();
    let mut table: toml::Table = toml::from_str(text).map_err(|error| {
        let hint = if text.contains("]=") || text.contains("] =") {
            "; a name with brackets needs quotes: \"lambda[1]\" = …"
        } else {
            ""
        };
        refuse(vec![format!("{}{hint}", error.to_string().trim_end())])
    })?;
    let values = changes.iter().map(|(name, text)| (name.clone(), value_of(text)));
    let (of_run, of_elements): (Vec<_>, Vec<_>) = values.partition(|(name, _)| REQUIRED.contains(&name.as_str()));
    table.extend(of_run);
    let document = Document::new(table, text, required, &mut findings);
    let machine = if document.machine.is_empty() { Some(&MACHINES[0]) } else { machine::find(&document.machine) };
    // Further findings would refer to the wrong machine.
    if let Some(finding) = machine.and_then(|own| foreign::finding(own, &document.machine, &document.keys())) {
        findings.push(finding);
        return Err(refuse(findings));
    }
    let folder = Path::new(origin).parent().unwrap_or(Path::new(""));
    let mut scenario = read(document, machine, folder, &of_elements, &mut findings);
    scenario.changes = changes.iter().map(|(name, value)| format!("{name}={value}")).collect();
    if findings.is_empty() {
        return Ok(scenario);
    }
    // The findings of the models are added, so that the user sees all at once.
    findings.extend(simulate::check(&scenario).err().map_or_else(Vec::new, |refused| refused.0));
    Err(refuse(findings))
}

/// The document of a scenario, deserialised key by key, so that one error does not hide others.
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
    profile: Vec<toml::Value>, "tables [[profile]]";
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
        let spanned = toml::de::DeTable::parse(text).ok();
        for key in table.keys() {
            let found = spanned.as_ref().and_then(|spanned| spanned.get_ref().get_key_value(key.as_str()));
            let line = found.map_or(0, |(key, _)| text[..key.span().start].matches('\n').count() + 1);
            let suggestion = suggestion(key, Self::KEYS);
            findings.push(format!("{key} in line {line}: there is no key of this name; {suggestion}"));
        }
        document
    }

    /// The variables that the document sets.
    fn keys(&self) -> Vec<foreign::Key<'static>> {
        let names = |(element, table)| flatten(table).into_iter().map(move |(name, _)| (element, name));
        self.tables().into_iter().flat_map(names).collect()
    }

    /// The tables with values for all elements, then for each.
    fn tables(&self) -> [(&'static str, &toml::Table); 4] {
        let [plant, controller, estimator] = ELEMENTS;
        [(ALL, &self.all), (plant, &self.plant), (controller, &self.controller), (estimator, &self.estimator)]
    }
}

/// Takes the value of a key out of a table; an invalid one is reported and, like a missing one, becomes the default.
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

/// A `[[profile]]` of the document.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ProfileText {
    of: Vec<String>,
    time: Vec<toml::Value>,
    value: Vec<toml::Value>,
    #[serde(default)]
    hold: bool,
}

/// The type of times.
const SECOND: Type =
    Type::Real { start: 0.0, unit: fmu_export::unit::SECOND, display: None, nominal: 1.0, min: None, max: None };

/// The contour of a built-in scenario: file name and text.
const BUILT_IN_CONTOUR: (&str, &str) = ("hole.csv", include_str!("../scenarios/hole.csv"));

/// Limit of the deviation of the reference trajectory from the points of its contour, relative to its size.
const CONTOUR_TOLERANCE: f64 = 0.01;

/// A value as written after `--set`: TOML, or a text without quotes.
pub fn value_of(text: &str) -> toml::Value {
    let parsed = toml::from_str::<toml::Table>(&format!("value = {text}"));
    let value = parsed.ok().filter(|table| table.len() == 1).and_then(|mut table| table.remove("value"));
    value.unwrap_or_else(|| toml::Value::String(text.into()))
}

fn read(
    document: Document,
    machine: Option<&'static Machine>,
    folder: &Path,
    changes: &[(String, toml::Value)],
    findings: &mut Vec<String>,
) -> Scenario {
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
    // A missing time has been reported or is not needed; a valid value in its place avoids a second finding.
    let [duration, step] =
        [&document.duration, &document.step].map(|time| time.clone().unwrap_or(toml::Value::Float(1.0)));
    let (duration_s, step_s) = (time("duration", &duration), time("step", &step));
    let balance_s = document.balance.as_ref().map(|value| time("balance", value));
    if findings.is_empty() && step_s > duration_s {
        findings.push(format!("step = {step} is refused: expected at most the duration, {duration_s} s"));
    }

    let machine = machine.unwrap_or_else(|| {
        let names = MACHINES.map(|machine| machine.name);
        let (given, suggestion) = (&document.machine, suggestion(&document.machine, &names));
        findings.push(format!("machine = \"{given}\" is refused: expected one of {}; {suggestion}", names.join(", ")));
        &MACHINES[0]
    });
    if let Some(value) = &document.balance {
        if machine.planes == 0 {
            findings.push(format!("balance = {value} is refused: the machine {} has no unbalance", machine.name));
        } else if findings.is_empty() && document.duration.is_some() && balance_s >= Some(duration_s) {
            findings.push(format!("balance = {value} is refused: expected a time before the end, {duration_s} s"));
        }
    }
    let element = |(name, (model, _)): (&str, (&str, &str))| {
        let model_type = fmu::find(model).expect("a model of this project");
        Element { name: name.into(), model_type, settings: Vec::new() }
    };
    let elements: Vec<_> = ELEMENTS.into_iter().zip(machine.models).map(element).collect();
    let mut assignment = Assignment { elements, findings };
    for (table, values) in document.tables() {
        let values = flatten(values);
        let is_listed =
            |key: &str| key.split_once('[').is_some_and(|(array, _)| values.iter().any(|(listed, _)| listed == array));
        for (key, value) in &values {
            if is_listed(key) {
                assignment.findings.push(format!("[{table}] {key} is given twice: in the list of all as well"));
            }
            assignment.assign(table, table, key, key, value);
        }
    }
    if let Some(file) = &document.contour {
        match contour_settings(file, folder, &assignment.elements[1].model_type) {
            Ok(settings) => assignment.elements[1].settings.extend(settings),
            Err(why) => assignment.findings.push(format!("contour = \"{file}\" is refused: {why}")),
        }
    }
    for (path, value) in changes {
        if Document::KEYS.contains(&path.as_str()) {
            let keys = REQUIRED.join(", ");
            let finding = format!("[--set] {path}: it is a key of the file; --set changes {keys} and variables");
            assignment.findings.push(finding);
            continue;
        }
        let owned = path.split_once('.').filter(|(owner, _)| ELEMENTS.contains(owner));
        let (owner, key) = owned.unwrap_or((ALL, path));
        assignment.assign("--set", owner, path, key, value);
    }
    assignment.compare(&document.compare);
    let mut profiles = Vec::new();
    let mut followed = HashSet::new();
    for (number, profile) in (1..).zip(document.profile) {
        let text = profile.try_into::<ProfileText>().map_err(|error| {
            let wanted = "of = [names], time = [instants], value = [values]";
            vec![format!("expected {wanted}, and hold = true if wanted ({})", error.message())]
        });
        match text.and_then(|text| assignment.profile(&text)) {
            Ok(profile) => {
                for &(at, index) in &profile.targets {
                    if !followed.insert((at, index)) {
                        let path = assignment.elements[at].path(index);
                        let finding = format!("[[profile]] number {number}: {path} follows a profile already");
                        assignment.findings.push(finding);
                    }
                }
                profiles.push(profile);
            }
            Err(all) => assignment.findings.extend(all.iter().map(|why| format!("[[profile]] number {number}: {why}"))),
        }
    }
    let Assignment { elements, findings, .. } = assignment;
    if !document.identify.is_empty() && machine.name != AXIAL.name {
        findings.push(format!("[identify] is refused: it describes the bench of the machine {} alone", AXIAL.name));
    }
    let readings = [machine.measured(), machine.of_magnets("im")].concat();
    let signals: Vec<&str> = readings.iter().map(String::as_str).chain(["time", "theta", "omega"]).collect();
    let mut columns = texts(&document.columns);
    for (name, _) in &mut columns {
        let signal = OF_COLUMN.iter().find_map(|end| name.strip_suffix(end)).unwrap_or(name);
        if !signals.contains(&signal) {
            findings
                .push(format!("[columns] {name}: there is no signal of this name; {}", suggestion(signal, &signals)));
        } else if signal == name {
            // A text alone is the name of the column.
            name.push_str(OF_COLUMN[0]);
        }
    }
    Scenario {
        title: document.title,
        description: document.description,
        machine,
        duration_s,
        step_s,
        elements,
        profiles,
        balance_s,
        tolerance: texts(&document.tolerance),
        columns,
        identify: document.identify,
        changes: Vec::new(),
    }
}

/// The elements of a loop while values are assigned.
struct Assignment<'f> {
    elements: Vec<Element>,
    findings: &'f mut Vec<String>,
}

impl Assignment<'_> {
    /// Assigns the value of a key to the element at this index; `table` names its source in messages.
    fn set(&mut self, at: usize, table: &str, key: &str, value: &toml::Value) {
        let model_type = self.elements[at].model_type.clone();
        let (indices, values) = match position(&model_type, key) {
            Some(index) => (vec![index], std::slice::from_ref(value)),
            None => (
                (0..).map_while(|k| position(&model_type, &element(key, k))).collect(),
                value.as_array().map_or(&[][..], Vec::as_slice),
            ),
        };
        let mut refuse = |name: &str, value: &toml::Value, why: String| {
            let finding = format!("[{table}] {name} = {value} is refused: {why}");
            // A change may affect several elements.
            if !self.findings.contains(&finding) {
                self.findings.push(finding);
            }
        };
        if values.len() != indices.len() {
            refuse(key, value, format!("expected a list of {}", indices.len()));
            return;
        }
        for (index, value) in indices.into_iter().zip(values) {
            let variable = &model_type.variables()[index];
            match permitted(&self.elements, at, variable).and_then(|()| convert(&variable.data_type, value)) {
                Ok(value) => self.elements[at].settings.push((index, value)),
                Err(why) => refuse(&variable.name, value, why),
            }
        }
    }

    /// Assigns the value of a key to the element `owner`, or to all elements that have such a variable. `table` and `path` name the source in
    /// messages.
    fn assign(&mut self, table: &str, owner: &str, path: &str, key: &str, value: &toml::Value) {
        let concerned: Vec<usize> = (0..ELEMENTS.len()).filter(|at| [ALL, ELEMENTS[*at]].contains(&owner)).collect();
        let model = |at: &usize| &*self.elements[*at].model_type;
        let known: Vec<usize> = concerned.iter().copied().filter(|at| knows(model(at), key)).collect();
        if known.is_empty() {
            let mut known = names(&concerned.iter().map(model).collect::<Vec<_>>());
            if table != owner && owner == ALL {
                for at in &concerned {
                    known.extend(names(&[model(at)]).iter().map(|name| format!("{}.{name}", ELEMENTS[*at])));
                }
            }
            let hint = likely(key, &known).or_else(|| foreign::owners(owner, key));
            let hint = hint.unwrap_or_else(|| suggestion(key, &known));
            self.findings.push(format!("[{table}] {path}: there is no variable of this name; {hint}"));
        }
        // Without an element, the name applies to all elements in which the variable can be set: the speed is an input of plant and
        // estimator, but that of the estimator is connected.
        let is_open = |at: &usize| {
            let variable = first(model(at), key).map(|index| &model(at).variables()[index]);
            variable.is_some_and(|variable| permitted(&self.elements, *at, variable).is_ok())
        };
        let open: Vec<usize> = known.iter().copied().filter(is_open).collect();
        for at in if open.is_empty() { known } else { open } {
            self.set(at, table, key, value);
        }
    }

    /// Adds estimators with other methods beside the loop.
    fn compare(&mut self, methods: &[String]) {
        let estimator = self.elements[2].clone();
        let Some(index) = estimator.index("method") else {
            if !methods.is_empty() {
                let model = estimator.model_type.info.name;
                self.findings.push(format!("compare = {methods:?} is refused: {model} has one method"));
            }
            return;
        };
        for method in methods {
            let is_new = self.elements.iter().all(|element| element.name != *method);
            match Method::ENUMERATION.find(method) {
                Err(wanted) => self.findings.push(format!("compare = \"{method}\" is refused: {wanted}")),
                Ok(_) if !is_new => {
                    self.findings.push(format!("compare = \"{method}\" is refused: it is listed twice"));
                }
                Ok(value) => {
                    let mut added = Element { name: method.clone(), ..estimator.clone() };
                    added.settings.push((index, Value::Integer(value)));
                    self.elements.push(added);
                }
            }
        }
    }

    /// Parses a `[[profile]]`, or returns all findings.
    fn profile(&self, text: &ProfileText) -> Result<Profile, Vec<String>> {
        let mut refused: Vec<String> = Vec::new();
        let mut targets = Vec::new();
        let is_fixed = |variable: &Variable| {
            variable.causality == Causality::Parameter && variable.variability != Variability::Tunable
        };
        for path in &text.of {
            match settable(&self.elements, path) {
                Err(why) => refused.push(why),
                Ok((at, index)) if is_fixed(&self.elements[at].model_type.variables()[index]) => {
                    let wanted = "expected an input or a tunable parameter";
                    refused.push(format!("{path} is fixed once the run has begun; {wanted}"));
                }
                Ok(target) => targets.push(target),
            }
        }
        let Some(&(at, variable)) = targets.first() else {
            if text.of.is_empty() {
                refused.push("of = [] names no variable".into());
            }
            return Err(refused);
        };
        let data_type = &self.elements[at].model_type.variables()[variable].data_type;
        let mut all = |data_type: &Type, values: &[toml::Value]| -> Vec<Value> {
            let mut found = Vec::new();
            for value in values {
                match convert(data_type, value) {
                    Ok(Value::Real(number)) if !number.is_finite() => {
                        refused.push(format!("{value} is refused: expected a finite number"));
                    }
                    Ok(value) => found.push(value),
                    Err(why) => refused.push(format!("{value} is refused: {why}")),
                }
            }
            found
        };
        let time_s: Vec<f64> = all(&SECOND, &text.time).into_iter().map(Value::as_f64).collect();
        let values = all(data_type, &text.value);
        // All targets must interpret the values alike.
        for &(at, index) in &targets[1..] {
            let Element { name, model_type, .. } = &self.elements[at];
            let other = &model_type.variables()[index];
            let differs = |value: &&toml::Value| convert(&other.data_type, value) != convert(data_type, value);
            if let Some(value) = text.value.iter().find(differs) {
                let (other, wanted) = (&other.name, "expected a [[profile]] of its own");
                refused.push(format!("{value} is not the same for {name}.{other} as for {}: {wanted}", text.of[0]));
            }
        }
        for &(at, index) in &targets {
            let variable = &self.elements[at].model_type.variables()[index];
            refused.extend(values.iter().filter_map(|value| variable.admits(value).err()).map(|why| why.to_string()));
        }
        let rises = time_s.is_sorted_by(|one, next| one < next);
        if text.time.is_empty() || text.time.len() != text.value.len() || !rises {
            refused.push("expected as many values as times, at least one, with increasing times".into());
        }
        let hold = text.hold || !matches!(data_type, Type::Real { .. });
        if refused.is_empty() { Ok(Profile { targets, time_s, values, hold }) } else { Err(refused) }
    }
}

/// The settings of the controller for a contour file, with its path relative to `folder`.
fn contour_settings(file: &str, folder: &Path, controller: &ModelType) -> Result<Vec<(usize, Value)>, String> {
    let path = folder.join(file);
    let Fit { contour, largest_m } = match BUILT_IN_CONTOUR {
        (name, text) if name == file && !path.exists() => contour::read(text)?,
        _ => contour::read(&std::fs::read_to_string(path).map_err(|error| error.to_string())?)?,
    };
    let series = [contour.cos_y_m, contour.sin_y_m, contour.cos_z_m, contour.sin_z_m].concat();
    let size_m = series.iter().fold(0.0f64, |size, value| size.max(value.abs()));
    if largest_m > CONTOUR_TOLERANCE * size_m {
        return Err(format!(
            "the Fourier series with {HARMONICS} harmonics misses a point by {:.3} µm, more than {} % of the contour's size",
            largest_m * 1e6,
            CONTOUR_TOLERANCE * 100.0
        ));
    }
    numbers("reference.", &contour, &PLANAR)
        .into_iter()
        .map(|(name, value, _)| (name, Value::Real(value)))
        .chain([("reference.shape".to_owned(), Value::Integer(4))])
        .map(|(name, value)| Ok((position(controller, &name).ok_or("this machine follows no contours")?, value)))
        .collect()
}

/// The leaves of a table with their keys joined by dots, so that `reference.rY` may be a dotted key in TOML.
pub fn flatten(table: &toml::Table) -> Vec<(String, &toml::Value)> {
    leaves(table, &|_| false)
}

/// The same, but tables for which `is_leaf` holds are leaves as well.
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

/// A value as text, without quotes.
pub fn text(value: &toml::Value) -> String {
    value.as_str().map_or_else(|| value.to_string(), str::to_owned)
}

/// Names and values of a table as texts.
pub fn texts(table: &toml::Table) -> Vec<Pair> {
    flatten(table).into_iter().map(|(name, value)| (name, text(value))).collect()
}

/// The index of the variable of this name.
pub fn position(model_type: &ModelType, name: &str) -> Option<usize> {
    model_type.variables().iter().position(|variable| variable.name == name)
}

/// Whether a model has a variable, or an array, of this name.
pub fn knows(model_type: &ModelType, key: &str) -> bool {
    first(model_type, key).is_some()
}

/// The index of the variable, or of the first element of the array, of this name.
fn first(model_type: &ModelType, key: &str) -> Option<usize> {
    position(model_type, key).or_else(|| position(model_type, &element(key, 0)))
}

/// The names of the settable variables of these models, arrays by their common name.
pub fn names(models: &[&ModelType]) -> Vec<String> {
    let mut names: Vec<String> = Vec::new();
    let variables = models.iter().flat_map(|model_type| model_type.variables());
    for variable in variables.filter(|variable| variable.is_settable()) {
        let name = variable.name.split('[').next().unwrap_or_default().to_owned();
        if !names.contains(&name) {
            names.push(name);
        }
    }
    names
}

/// The finding about an unknown variable.
pub fn unknown(table: &str, key: &str, known: &[impl Borrow<str>]) -> String {
    format!("[{table}] {key}: there is no variable of this name; {}", suggestion(key, known))
}

/// Likeness above which a name is probably meant by another one.
pub const ALIKE: f64 = 0.8;

/// Number of names up to which a message lists all.
const LISTED: usize = 20;

/// Number of names that it lists of more.
const NEAREST: usize = 3;

/// Likeness of two names in any case (Jaro and Winkler), from 0 to 1.
pub fn likeness(one: &str, other: &str) -> f64 {
    strsim::jaro_winkler(&one.to_lowercase(), &other.to_lowercase())
}

/// The known name that an unknown one probably means.
fn likely(key: &str, known: &[impl Borrow<str>]) -> Option<String> {
    if let Some((array, _)) = key.split_once('[')
        && known.iter().any(|name| name.borrow() == array)
    {
        return Some(format!("{array} has no such element"));
    }
    let nearest = known.iter().map(|name| (likeness(name.borrow(), key), name.borrow()));
    let nearest = nearest.max_by(|one, other| one.0.total_cmp(&other.0));
    nearest.filter(|(likeness, _)| *likeness > ALIKE).map(|(_, name)| format!("did you mean {name}?"))
}

/// Suggests known names for an unknown one: all, or the nearest if they are many.
pub fn suggestion(key: &str, known: &[impl Borrow<str>]) -> String {
    likely(key, known).unwrap_or_else(|| {
        let mut names: Vec<&str> = known.iter().map(Borrow::borrow).collect();
        if names.len() <= LISTED {
            return format!("known are {}", names.join(", "));
        }
        names.sort_by(|one, other| likeness(other, key).total_cmp(&likeness(one, key)));
        format!("the nearest are {}", names[..NEAREST].join(", "))
    })
}

/// Checks that a variable of an element can be set.
pub fn permitted(elements: &[Element], at: usize, variable: &Variable) -> Result<(), String> {
    if !variable.is_settable() {
        return Err("it is computed; only parameters and inputs can be set".into());
    }
    match source(elements, at, variable) {
        Some((from, output)) => Err(format!("it is connected to {}", elements[from].path(output))),
        None => Ok(()),
    }
}

/// A number and the text after it.
pub fn number_and_unit(text: &str) -> Option<(f64, &str)> {
    let text = text.trim();
    // The longest prefix that is a number, so that an exponent is not mistaken for a unit.
    let ends = text.char_indices().map(|(at, _)| at).chain([text.len()]);
    ends.rev().find_map(|end| Some((text[..end].trim().parse().ok()?, text[end..].trim())))
}

/// Converts a number in the unit `name` to another unit.
pub fn from_unit(number: f64, name: &str, unit: &Unit) -> Result<f64, String> {
    let wanted = || unit.names().collect::<Vec<_>>().join(", ");
    unit.convert(number, &name.replace('°', "deg")).ok_or_else(|| match name.starts_with(',') {
        true => "expected a point instead of the decimal comma".into(),
        false => format!("the unit {name} is not one of {}", wanted()),
    })
}

/// Converts a TOML value to the value of a variable. Numbers are in the unit of the interface; texts include their unit.
pub fn convert(data_type: &Type, value: &toml::Value) -> Result<Value, String> {
    match (data_type, value) {
        (Type::Real { .. }, toml::Value::Float(value)) => Ok(Value::Real(*value)),
        (Type::Real { .. }, toml::Value::Integer(value)) => Ok(Value::Real(*value as f64)),
        (Type::Real { unit, .. }, toml::Value::String(text)) => {
            let first = text.split_whitespace().next().unwrap_or_default();
            let (number, name) = number_and_unit(text).ok_or_else(|| match first {
                "" => format!("expected a number in {}", unit.name),
                _ => format!("{first} is not a number"),
            })?;
            from_unit(number, if name.is_empty() { unit.name } else { name }, unit).map(Value::Real)
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
