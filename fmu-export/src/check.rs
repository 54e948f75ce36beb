//! Errors in a model's table that would make importers reject or misread its description.

use std::collections::HashMap;
use std::collections::hash_map::Entry;

use crate::model::Info;
use crate::unit::{Display, Unit};
use crate::variable::{Causality, Enumeration, Type, Variability, Variable};

/// Errors in a model's name and table, one sentence each.
pub fn problems(info: &Info, variables: &[Variable]) -> Vec<String> {
    let mut found = Vec::new();
    let part_of_identifier = |letter: char| letter.is_ascii_alphanumeric() || letter == '_';
    if info.name.is_empty() || !info.name.chars().all(part_of_identifier) || info.name.starts_with(char::is_numeric) {
        found.push(format!(
            "the name `{}` cannot be part of a C identifier: expected letters, digits, and underscores",
            info.name
        ));
    }
    for (what, value) in [("stop_s", info.stop_s), ("step_s", info.step_s), ("tolerance", info.tolerance)] {
        if !(value.is_finite() && value > 0.0) {
            found.push(format!("{what} = {value} of the typical run is refused: expected a number above 0"));
        }
    }
    if variables.is_empty() {
        found.push("there is no variable: expected one at least".into());
    }
    for (what, text) in [
        ("description", info.description),
        ("version", info.version),
        ("author", info.author),
        ("license", info.license),
        ("tool", info.tool),
    ] {
        check_text(&format!("the {what}"), text, &mut found);
    }
    if variables.iter().any(|variable| variable.name == "time" && variable.causality != Causality::Independent) {
        found.push("the name `time` is that of the independent variable in FMI 3.0: expected another one".into());
    }
    let mut first: HashMap<&str, &Variable> = HashMap::new();
    for variable in variables {
        if first.insert(&variable.name, variable).is_some() {
            found.push(format!("{} occurs twice", variable.name));
        }
    }
    for variable in variables {
        check_name(variable, &mut found);
        check_references(variable, &first, &mut found);
        check_numbers(variable, &mut found);
    }
    if variables.iter().filter(|variable| variable.causality == Causality::Independent).count() > 1 {
        found.push("there is more than one independent variable".into());
    }
    for state in variables.iter().filter(|variable| variable.state) {
        let name = &state.name;
        if !state.is_continuous() {
            found.push(format!("the state {name} is not a continuous variable of type Real"));
        }
        match variables.iter().filter(|variable| variable.derivative_of.as_ref() == Some(name)).count() {
            0 => found.push(format!("the state {name} has no derivative among the variables")),
            1 => (),
            several => found.push(format!("the state {name} has {several} derivatives among the variables")),
        }
    }
    check_definitions(variables, &mut found);
    found
}

/// Names must follow the structured naming convention of FMI 2.0.4, section 2.2.9, which the description declares.
fn check_name(variable: &Variable, found: &mut Vec<String>) {
    let name = &variable.name;
    if !is_structured(name) {
        found.push(format!(
            "the name `{name}` is not allowed: expected ASCII letters, digits and underscores, not beginning with a digit, in \
             parts divided by points, with indices such as [1] or [2,3]; other characters of ASCII between apostrophes"
        ));
    }
    if variable.description.contains(char::is_control) {
        found.push(format!("the description of {name} contains a control character"));
    }
    check_text(&format!("the description of {name}"), &variable.description, found);
    if let Type::String { start } = &variable.data_type {
        check_text(&format!("the start value of {name}"), start, found);
    }
}

/// A text must consist of characters that XML can hold.
fn check_text(what: &str, text: &str, found: &mut Vec<String>) {
    let is_foreign = |letter: char| {
        (letter.is_ascii_control() && !matches!(letter, '\t' | '\n' | '\r'))
            || matches!(letter, '\u{fffe}' | '\u{ffff}')
    };
    if let Some(letter) = text.chars().find(|letter| is_foreign(*letter)) {
        found.push(format!("{what} contains the character {}, which XML cannot hold", letter.escape_unicode()));
    }
}

fn is_structured(name: &str) -> bool {
    let inside = name.strip_prefix("der(").and_then(|rest| rest.strip_suffix(')'));
    let mut rest = match inside.map(|inside| inside.rsplit_once(',').unwrap_or((inside, "1"))) {
        Some((_, order)) if !is_number(order) => return false,
        Some((identifier, _)) => identifier,
        None => name,
    };
    loop {
        let Some(after) = after_part(rest) else { return false };
        match after.strip_prefix('.') {
            Some(next) => rest = next,
            None => return after.is_empty(),
        }
    }
}

/// Text after the first part of a name and its indices.
fn after_part(text: &str) -> Option<&str> {
    let rest = if let Some(quoted) = text.strip_prefix('\'') {
        after_quoted(quoted)?
    } else {
        let end = text.find(|letter: char| !(letter.is_ascii_alphanumeric() || letter == '_')).unwrap_or(text.len());
        (end > 0 && !text.starts_with(|letter: char| letter.is_ascii_digit())).then_some(&text[end..])?
    };
    let Some(indices) = rest.strip_prefix('[') else { return Some(rest) };
    let (indices, rest) = indices.split_once(']')?;
    indices.split(',').all(is_number).then_some(rest)
}

/// Text after the apostrophe that ends a quoted name: ASCII characters, some of them after a backslash.
fn after_quoted(text: &str) -> Option<&str> {
    let mut rest = text;
    loop {
        let letter = rest.chars().next()?;
        rest = match letter {
            '\'' => return (rest.len() < text.len()).then_some(&rest[1..]),
            '\\' => rest[1..].strip_prefix(['\'', '"', '?', '\\', 'a', 'b', 'f', 'n', 'r', 't', 'v'])?,
            ' '..='~' if !matches!(letter, '"' | '`') => &rest[1..],
            _ => return None,
        };
    }
}

fn is_number(text: &str) -> bool {
    !text.is_empty() && text.bytes().all(|digit| digit.is_ascii_digit())
}

/// References to other variables.
fn check_references(variable: &Variable, known: &HashMap<&str, &Variable>, found: &mut Vec<String>) {
    let name = &variable.name;
    let depends_on = variable.depends_on.iter().flatten().map(|(name, _)| name.as_ref());
    let starts_from = variable.starts_from.iter().flatten().map(AsRef::as_ref);
    let mut refer = |other: &str, suits: fn(&Variable) -> bool, wanted: &str| match known.get(other) {
        None => found.push(format!("{name} refers to {other}, which is not a variable")),
        Some(other) if !suits(other) => found.push(format!("{name} refers to {}, which is {wanted}", other.name)),
        Some(_) => {}
    };
    let is_known =
        |other: &Variable| other.state || matches!(other.causality, Causality::Input | Causality::Independent);
    let mut seen: Vec<&str> = Vec::new();
    for other in depends_on {
        refer(other, is_known, "neither an input nor a state");
        seen.push(other);
    }
    for other in starts_from {
        refer(other, |known| known.has_start() || known.causality == Causality::Independent, "computed at the start");
    }
    if let Some(state) = &variable.derivative_of {
        refer(state, |state| state.state, "not a state");
        if !variable.is_continuous() {
            found.push(format!("{name} is the derivative of a state, but not a continuous variable of type Real"));
        }
    }
    seen.sort_unstable();
    for twice in seen.windows(2).filter(|pair| pair[0] == pair[1]) {
        found.push(format!("{name} depends twice on {}", twice[0]));
    }
}

/// Start values, limits, and nominal values.
fn check_numbers(variable: &Variable, found: &mut Vec<String>) {
    let name = &variable.name;
    let mut limits = |min: Option<f64>, max: Option<f64>| {
        for (what, limit) in [("min", min), ("max", max)] {
            if limit.is_some_and(|limit| !limit.is_finite()) {
                found.push(format!("the {what} of {name} is not a finite number"));
            }
        }
        if let (Some(min), Some(max)) = (min, max)
            && min > max
        {
            found.push(format!("the limits of {name} are in the wrong order: min = {min}, max = {max}"));
        }
    };
    match &variable.data_type {
        Type::Real { start, nominal, min, max, unit, display } => {
            limits(*min, *max);
            if !start.is_finite() {
                found.push(format!("the start value of {name} is not a finite number"));
            }
            if !(nominal.is_finite() && *nominal > 0.0) {
                found.push(format!("the nominal value of {name} is {nominal}: expected a number above 0"));
            }
            if let Some(display) = display
                && !unit.names().any(|known| known == *display)
            {
                let names: Vec<_> = unit.names().collect();
                found.push(format!("{name} has the display unit {display}: expected one of {}", names.join(", ")));
            }
        }
        Type::Integer { min, max, .. } => limits(min.map(f64::from), max.map(f64::from)),
        Type::Boolean { .. } | Type::Enumeration { .. } | Type::String { .. } => {}
    }
    if variable.has_start() && variable.admits(&variable.start()).is_err() {
        found.push(format!("the start value of {name} is outside its limits"));
    }
    if variable.variability == Variability::Continuous && !matches!(variable.data_type, Type::Real { .. }) {
        found.push(format!("{name} is not of type Real, and cannot be continuous"));
    }
}

/// Units and enumerations, which tools identify by name.
fn check_definitions(variables: &[Variable], found: &mut Vec<String>) {
    let mut units: HashMap<&str, &Unit> = HashMap::new();
    let mut enumerations: HashMap<&str, &Enumeration> = HashMap::new();
    for variable in variables {
        match &variable.data_type {
            Type::Real { unit, .. } => match units.entry(unit.name) {
                Entry::Vacant(place) => check_unit(place.insert(unit), found),
                Entry::Occupied(first) if *first.get() != unit => {
                    found.push(format!("there are two units named {}; {} has the second", unit.name, variable.name));
                }
                Entry::Occupied(_) => {}
            },
            Type::Enumeration { items, .. } => match enumerations.entry(items.name) {
                Entry::Vacant(place) => {
                    check_enumeration(place.insert(items), found);
                    if variables.iter().any(|other| other.name == items.name) {
                        found.push(format!(
                            "the enumeration {} has the name of a variable: expected another one, as by `#[choice(name = \"…\")]`",
                            items.name
                        ));
                    }
                }
                Entry::Occupied(first) if *first.get() != *items => {
                    found.push(format!("there are two enumerations named {}", items.name));
                }
                Entry::Occupied(_) => {}
            },
            _ => {}
        }
    }
    found.dedup();
}

/// An enumeration: texts that XML can hold, and distinct names of items.
fn check_enumeration(enumeration: &Enumeration, found: &mut Vec<String>) {
    let name = enumeration.name;
    check_text(&format!("the name of the enumeration {name}"), name, found);
    check_text(&format!("the description of the enumeration {name}"), enumeration.description, found);
    for (at, (item, meaning)) in enumeration.items.iter().enumerate() {
        check_text(&format!("an item of the enumeration {name}"), item, found);
        check_text(&format!("the description of {item}"), meaning, found);
        if enumeration.items[..at].iter().any(|(other, _)| other == item) {
            found.push(format!("the enumeration {name} has the item {item} twice"));
        }
    }
}

/// A unit: base units of the standard, and display units that can be converted.
fn check_unit(unit: &Unit, found: &mut Vec<String>) {
    const BASE: [&str; 8] = ["kg", "m", "s", "A", "K", "mol", "cd", "rad"];
    let name = unit.name;
    check_text(&format!("the name of the unit {name}"), name, found);
    for (at, (base, _)) in unit.base.iter().enumerate() {
        if !BASE.contains(base) {
            found.push(format!("the unit {name} has the base unit {base}: expected one of {}", BASE.join(", ")));
        }
        if unit.base[..at].iter().any(|(other, _)| other == base) {
            found.push(format!("the unit {name} has the base unit {base} twice"));
        }
    }
    for (at, display) in unit.displays.iter().enumerate() {
        check_text(&format!("a display unit of {name}"), display.name, found);
        if !(display.factor.is_finite() && display.factor != 0.0 && display.offset.is_finite()) {
            let Display { name: shown, factor, offset } = display;
            let wanted = "expected a factor that is not 0, and finite numbers";
            found.push(format!(
                "the display unit {shown} of {name} has the factor {factor} and the offset {offset}: {wanted}"
            ));
        }
        if unit.displays[..at].iter().any(|other| other.name == display.name) {
            found.push(format!("the unit {name} has the display unit {} twice", display.name));
        }
    }
}
