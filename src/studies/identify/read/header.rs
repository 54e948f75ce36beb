//! The header of a recording: which column is which signal, and in what unit.

use super::Reading;
use super::units::{self, ANGLE, CURRENT, LENGTH, Quantity, SPEED, TIME};

/// A signal that a recording may have.
pub(super) struct Signal {
    /// Name as in the interface.
    pub name: &'static str,
    /// Other names it goes by.
    others: &'static [&'static str],
    /// The measured quantity.
    pub quantity: Quantity,
    /// The user's name for it.
    meaning: &'static str,
}

const fn signal(
    name: &'static str,
    others: &'static [&'static str],
    quantity: Quantity,
    meaning: &'static str,
) -> Signal {
    Signal { name, others, quantity, meaning }
}

/// All of them. Positions and currents of the machine are needed, the time if no rate is given.
pub(super) const SIGNALS: [Signal; 9] = [
    signal("time", &["t", "Time", "TIME", "zeit", "Zeit", "timestamp", "Timestamp"], TIME, "the time of the sample"),
    signal("Ym", &["Y", "y"], LENGTH, "the position along y"),
    signal("Zm", &["Z", "z"], LENGTH, "the position along z"),
    signal("im[1]", &["im1", "i[1]", "i1"], CURRENT, "the current of magnet 1"),
    signal("im[2]", &["im2", "i[2]", "i2"], CURRENT, "the current of magnet 2"),
    signal("im[3]", &["im3", "i[3]", "i3"], CURRENT, "the current of magnet 3"),
    signal("theta", &["theta_m"], ANGLE, "the angle of the rotor"),
    signal("omega", &["omegam", "plant.omegam"], SPEED, "the speed of the rotor"),
    signal("Xm", &["X", "x"], LENGTH, "the position along the axis"),
];
/// Where they stand.
pub(super) const TIME_AT: usize = 0;
pub(super) const POSITIONS: std::ops::Range<usize> = 1..3;
pub(super) const CURRENTS: std::ops::Range<usize> = 3..6;
pub(super) const THETA: usize = 6;
pub(super) const OMEGA: usize = 7;
pub(super) const AXIAL: usize = 8;

/// Where a signal stands in a row, and in what unit: its name and what one of it is in SI; none if nobody said.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Place {
    pub column: usize,
    pub unit: Option<(&'static str, f64)>,
}

/// A column as the header names it.
pub(super) struct Column {
    name: String,
    unit: Option<String>,
}

/// Reads a cell of a header: `name [unit]`, `name (unit)`, `name / unit` or `name in unit`; an index in brackets is no unit, nor is a dash.
pub(super) fn column(cell: &str) -> Column {
    let cell = cell.trim().trim_matches('"').trim();
    let split = bracketed(cell)
        .filter(|(name, unit)| !name.is_empty() && (unit.is_empty() || !unit.chars().all(|c| c.is_ascii_digit())));
    let split = split.or_else(|| {
        let halves = [" in ", "/"].into_iter().filter_map(|between| cell.split_once(between));
        let mut named = halves.filter(|(name, unit)| !name.trim().is_empty() && units::is_unit(unit));
        named.next().filter(|_| !units::is_unit(cell))
    });
    let (name, unit) = split.unwrap_or((cell, ""));
    Column { name: name.trim().into(), unit: stated(unit) }
}

/// A unit, unless the cell is empty or holds a dash.
fn stated(unit: &str) -> Option<String> {
    let unit = unit.trim();
    (!matches!(unit, "" | "-" | "–")).then(|| unit.to_owned())
}

/// The text before a bracket at the end, and that in it.
fn bracketed(cell: &str) -> Option<(&str, &str)> {
    [('[', ']'), ('(', ')'), ('{', '}'), ('<', '>')].into_iter().find_map(|(open, close)| {
        let (name, unit) = cell.trim().strip_suffix(close)?.rsplit_once(open)?;
        Some((name.trim(), unit.trim()))
    })
}

/// Takes the units from the row below the header, if it holds units: no number, and a unit in one of its cells at least. Returns whether it
/// does. Units in both places must agree.
pub(super) fn take_units(columns: &mut [Column], cells: &[String], findings: &mut Vec<String>) -> bool {
    let unit = |cell: &String| match bracketed(cell) {
        Some(("", unit)) => stated(unit),
        _ => stated(cell),
    };
    let units: Vec<Option<String>> = cells.iter().map(unit).collect();
    let is_unit = |unit: &String| units::is_unit(unit);
    if !units.iter().flatten().any(is_unit) || cells.iter().any(|cell| cell.trim().parse::<f64>().is_ok()) {
        return false;
    }
    for (column, unit) in columns.iter_mut().zip(units) {
        let Some(unit) = unit else { continue };
        match &column.unit {
            Some(before) if *before != unit => findings.push(format!(
                "column {}: the header says {before}, the row below it {unit}; one unit is wanted",
                column.name
            )),
            _ => column.unit = Some(unit),
        }
    }
    true
}

/// How many signals a line names, to find the header among the lines before it.
pub(super) fn recognised(columns: &[Column], reading: &Reading) -> usize {
    SIGNALS.iter().filter(|signal| candidates(columns, signal, given(&reading.columns, signal)).len() == 1).count()
}

/// The last option for a signal.
fn given<'a>(options: &'a [(String, String)], signal: &Signal) -> Option<&'a String> {
    options.iter().rev().find(|(name, _)| name == signal.name).map(|(_, value)| value)
}

/// Finds the wanted signals, in the order of [`SIGNALS`]; all that is wrong goes to the findings.
pub(super) fn places(
    columns: &[Column],
    reading: &Reading,
    wanted: impl Fn(usize) -> bool,
    findings: &mut Vec<String>,
) -> [Option<Place>; SIGNALS.len()] {
    let options = [("--column", &reading.columns), ("--unit", &reading.units)];
    for (option, name) in
        options.into_iter().flat_map(|(option, pairs)| pairs.iter().map(move |pair| (option, &pair.0)))
    {
        let known = (0..SIGNALS.len()).filter(|at| *at != AXIAL || wanted(AXIAL)).map(|at| SIGNALS[at].name);
        if !known.clone().any(|known| known == name) {
            let names = known.collect::<Vec<_>>().join(", ");
            findings.push(format!("{option} {name}: {name} is no signal of a recording; known are {names}"));
        }
    }
    let mut is_absent = false;
    let mut places: [Option<Place>; SIGNALS.len()] = Default::default();
    for (at, signal) in SIGNALS.iter().enumerate().filter(|(at, _)| wanted(*at)) {
        let name = signal.name;
        let column = given(&reading.columns, signal);
        let needed = !matches!(at, THETA | OMEGA) && (at != TIME_AT || reading.rate_s.is_none());
        let found = candidates(columns, signal, column);
        let [found] = found.as_slice() else {
            let names: Vec<&str> = found.iter().map(|at| columns[*at].name.as_str()).collect();
            match (names.as_slice(), column) {
                ([], Some(column)) => findings.push(format!("--column {name}={column}: there is no column {column}")),
                ([], None) if needed => {
                    let mut finding =
                        format!("{name}: no column of this name; {} is wanted: --column {name}=…", signal.meaning);
                    if at == TIME_AT {
                        finding += ", or --rate if there is none";
                    }
                    findings.push(finding);
                }
                ([_, ..], _) if !matches!(at, THETA | OMEGA) || column.is_some() => findings.push(format!(
                    "{name}: several columns go by this name: {}; one is wanted: --column {name}=…",
                    names.join(", ")
                )),
                _ => continue,
            }
            is_absent |= names.is_empty();
            continue;
        };
        if let Some(other) = (0..at).find(|other| places[*other].is_some_and(|place| place.column == *found)) {
            findings.push(format!(
                "{} and {name}: both are column {}; one of its own is wanted for each",
                SIGNALS[other].name, columns[*found].name
            ));
        }
        let stated = given(&reading.units, signal).or(columns[*found].unit.as_ref());
        let unit = stated.and_then(|unit| units::find(signal.quantity, unit));
        if let (Some(stated), None) = (stated, unit) {
            let (column, known) = (&columns[*found].name, units::names(signal.quantity));
            findings.push(format!("{name} (column {column}): the unit {stated} is none of {known}"));
        }
        places[at] = Some(Place { column: *found, unit });
    }
    if is_absent {
        let names: Vec<&str> = columns.iter().map(|column| column.name.as_str()).collect();
        findings.push(format!("the header has the columns {}", names.join(", ")));
    }
    places
}

/// The columns that are the signal, one if all is well: the column that was given, with or without its unit, or those that fit best, by the name,
/// behind the name of an element (that of the plant first), or by another name.
fn candidates(columns: &[Column], signal: &Signal, given: Option<&String>) -> Vec<usize> {
    let rank = |name: &str| -> Option<usize> {
        if let Some(given) = given {
            return [given.as_str(), &column(given).name].iter().position(|given| *given == name);
        }
        let element = name.strip_suffix(signal.name).and_then(|element| element.strip_suffix('.'));
        match element {
            _ if name == signal.name => Some(0),
            Some("plant") => Some(1),
            _ if name.starts_with("plant.") && signal.others.contains(&name) => Some(2),
            Some(_) => Some(3),
            None => signal.others.iter().position(|other| *other == name).map(|at| 4 + at),
        }
    };
    let ranks: Vec<Option<usize>> = columns.iter().map(|column| rank(&column.name)).collect();
    let best = ranks.iter().flatten().min();
    (0..columns.len()).filter(|at| ranks[*at].is_some() && ranks[*at].as_ref() == best).collect()
}
