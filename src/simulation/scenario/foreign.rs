//! Scenarios whose names are those of another machine: one finding instead of one for each name.

use std::sync::Arc;

use fmu_export::ModelType;
use fmu_export::variable::element;

use super::read::{flatten, position};
use crate::fmu;
use crate::machine::{MACHINES, Machine};

/// As many names are listed.
const LISTED: usize = 3;

/// A variable that a scenario sets: the element, or `all`; the name; the length of the value if it is a list.
pub type Key = (&'static str, String, Option<usize>);

/// The keys of the table of an element.
pub fn keys(element: &'static str, table: &toml::Table) -> Vec<Key> {
    let length = |value: &toml::Value| value.as_array().map(Vec::len);
    flatten(table).into_iter().map(|(name, value)| (element, name, length(value))).collect()
}

/// Whether a model has a variable of that name, or as many of an array.
fn has(model: &ModelType, name: &str, length: Option<usize>) -> bool {
    let elements = || (0..).take_while(|k| position(model, &element(name, *k)).is_some()).count();
    position(model, name).is_some() || length.map_or_else(|| elements() > 0, |length| elements() == length)
}

/// The keys that a machine does not have.
fn missing<'k>(machine: &Machine, keys: &'k [Key]) -> Vec<&'k Key> {
    let models: [Arc<ModelType>; 3] = machine.models.map(|(name, _)| fmu::find(name).expect("a model of this project"));
    let elements = ["plant", "controller", "estimator"];
    let knows = |(owner, name, length): &Key| {
        let own = elements.iter().zip(&models).filter(|(element, _)| *owner == "all" || owner == *element);
        own.into_iter().any(|(_, model)| has(model, name, *length))
    };
    keys.iter().filter(|key| !knows(key)).collect()
}

/// A finding if another machine has more of the names than that of the scenario, whose name is empty if it names none.
pub fn finding(given: &str, keys: &[Key]) -> Option<String> {
    let own = if given.is_empty() { Some(&MACHINES[0]) } else { MACHINES.iter().find(|machine| machine.name == given) };
    let here = missing(own?, keys);
    if here.is_empty() {
        return None;
    }
    let others: Vec<_> = MACHINES.iter().map(|machine| (machine.name, missing(machine, keys))).collect();
    let (_, there) = others.iter().min_by_key(|(_, missing)| missing.len())?;
    if there.len() == here.len() {
        return None;
    }
    let best: Vec<&str> = others.iter().filter(|(_, missing)| missing == there).map(|(name, _)| *name).collect();
    let names: Vec<&str> = here.iter().filter(|key| !there.contains(key)).map(|(_, name, _)| name.as_str()).collect();
    let more = names.len().saturating_sub(LISTED);
    Some(format!(
        "{}{}: these are names of the machine {}: {} machine = \"{}\"{}",
        names[..names.len() - more].join(", "),
        if more > 0 { format!(" and {more} more") } else { String::new() },
        best.join(" or "),
        if given.is_empty() { "add" } else { "say" },
        best[0],
        if given.is_empty() { String::new() } else { format!(" instead of \"{given}\"") },
    ))
}
