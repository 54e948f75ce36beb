//! Detects scenarios written for another machine: one finding instead of one for each name.

use std::sync::Arc;

use fmu_export::ModelType;

use super::read::{ELEMENTS, knows};
use crate::fmu;
use crate::machine::{MACHINES, Machine};

/// Number of names listed in the finding.
const LISTED: usize = 3;

/// A variable set by a scenario: the element, or `all`, and the name.
pub type Key<'k> = (&'k str, String);

/// The machines that have a variable, in words.
pub fn owners(element: &str, name: &str) -> Option<String> {
    let keys = [(element, name.to_owned())];
    let owners = MACHINES.iter().filter(|machine| missing(machine, &keys).is_empty());
    let owners: Vec<&str> = owners.map(|machine| machine.name).collect();
    (!owners.is_empty()).then(|| format!("it is one of the machine {}", owners.join(" or ")))
}

/// The keys that a machine does not have.
fn missing<'k>(machine: &Machine, keys: &'k [Key<'k>]) -> Vec<&'k Key<'k>> {
    let models: [Arc<ModelType>; 3] = machine.models.map(|(name, _)| fmu::find(name).expect("a model of this project"));
    let has = |(owner, name): &Key| {
        let own = ELEMENTS.iter().zip(&models).filter(|(element, _)| *owner == "all" || owner == *element);
        own.into_iter().any(|(_, model)| knows(model, name))
    };
    keys.iter().filter(|key| !has(key)).collect()
}

/// A finding if another machine has more of the names than `own`, that of the scenario; `given` is empty if the scenario names no machine.
pub fn finding(own: &Machine, given: &str, keys: &[Key]) -> Option<String> {
    let here = missing(own, keys);
    if here.is_empty() {
        return None;
    }
    let others: Vec<_> = MACHINES.iter().map(|machine| (machine.name, missing(machine, keys))).collect();
    let (_, there) = others.iter().min_by_key(|(_, missing)| missing.len())?;
    if there.len() == here.len() {
        return None;
    }
    let best: Vec<&str> = others.iter().filter(|(_, missing)| missing == there).map(|(name, _)| *name).collect();
    let names: Vec<&str> = here.iter().filter(|key| !there.contains(key)).map(|(_, name)| name.as_str()).collect();
    let more = names.len().saturating_sub(LISTED);
    Some(format!(
        "{}{}: {} of the machine {}: {} machine = \"{}\"{}",
        names[..names.len() - more].join(", "),
        if more > 0 { format!(" and {more} more") } else { String::new() },
        if names.len() > 1 { "these are names" } else { "there is no variable of this name; it is one" },
        best.join(" or "),
        if given.is_empty() { "add" } else { "say" },
        best[0],
        if given.is_empty() { String::new() } else { format!(" instead of \"{given}\"") },
    ))
}
