//! The header of a recording: which column is which signal, and in what unit.

use std::ops::Range;

use crate::machine::{MACHINES, Machine, Reading};
use crate::studies::identify::units::{self, ANGLE, CURRENT, LENGTH, Quantity, SPEED, TIME};

/// The time is the first signal of every machine.
pub(super) const TIME_AT: usize = 0;

/// Which signal it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Time,
    Position,
    /// Of a magnet, counted from 0.
    Current(usize),
    Theta,
    Omega,
}

/// A signal that a recording may have.
#[derive(Clone, Debug)]
pub(super) struct Signal {
    pub kind: Kind,
    /// Name as in the interface.
    pub name: String,
    /// Other names it goes by.
    others: Vec<String>,
    pub quantity: Quantity,
    /// The user's name for it.
    meaning: String,
}

/// The signals of a machine: time, positions, currents, angle and speed. Positions and currents are needed, the time if no rate is given.
#[derive(Clone, Debug)]
pub(super) struct Signals {
    pub list: Vec<Signal>,
    pub positions: Range<usize>,
    pub currents: Range<usize>,
    pub theta: usize,
    pub omega: usize,
}

impl Signals {
    pub fn of(machine: &Machine) -> Self {
        let signal = |kind, name: &str, others: &[&str], quantity, meaning: &str| {
            let others = others.iter().map(|name| (*name).to_owned()).collect();
            Signal { kind, name: name.into(), others, quantity, meaning: meaning.into() }
        };
        let time = ["t", "Time", "TIME", "zeit", "Zeit", "timestamp", "Timestamp"];
        let mut list = vec![signal(Kind::Time, "time", &time, TIME, "the time of the sample")];
        for Reading { name, place, .. } in machine.readings {
            let plain = name.trim_end_matches('m');
            let (bearing, axis) = plain.split_at(plain.len() - 1);
            let small = bearing.to_owned() + &axis.to_lowercase();
            list.push(signal(Kind::Position, name, &[plain, &small], LENGTH, &format!("the position {place}")));
        }
        let positions = 1..list.len();
        for (k, name) in machine.of_magnets("im").iter().enumerate() {
            let plain = |name: &str| name.replace(['[', ']'], "");
            let ideal = name.replace("im[", "i[");
            let meaning = machine.describe("the current of {magnet}", k);
            list.push(signal(Kind::Current(k), name, &[&plain(name), &ideal, &plain(&ideal)], CURRENT, &meaning));
        }
        let currents = positions.end..list.len();
        list.push(signal(Kind::Theta, "theta", &["theta_m"], ANGLE, "the angle of the rotor"));
        list.push(signal(Kind::Omega, "omega", &["omegam", "plant.omegam"], SPEED, "the speed of the rotor"));
        Self { positions, theta: currents.end, omega: currents.end + 1, currents, list }
    }

    /// How many signals a line names, to find the header among the lines before it.
    pub fn recognised(&self, columns: &[Column], reading: &super::Reading) -> usize {
        let is_named = |signal: &&Signal| candidates(columns, signal, given(&reading.columns, signal)).len() == 1;
        self.list.iter().filter(is_named).count()
    }

    /// Whether a header has all positions and currents under their own names.
    fn are_all_in(&self, columns: &[Column]) -> bool {
        self.list[self.positions.start..self.currents.end]
            .iter()
            .all(|signal| candidates(columns, signal, None).len() == 1)
    }
}

/// The machine with the most magnets whose positions and currents all stand in the header, if it is another than this one.
pub(super) fn other_machine(columns: &[Column], machine: &Machine) -> Option<&'static Machine> {
    let fits = |machine: &&Machine| Signals::of(machine).are_all_in(columns);
    MACHINES.iter().filter(fits).max_by_key(|machine| machine.magnets()).filter(|most| *most != machine)
}

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

/// The last option for a signal.
fn given<'a>(options: &'a [(String, String)], signal: &Signal) -> Option<&'a String> {
    options.iter().rev().find(|(name, _)| *name == signal.name).map(|(_, value)| value)
}

/// Finds the wanted signals, in the order of the list; all that is wrong goes to the findings.
pub(super) fn places(
    signals: &Signals,
    columns: &[Column],
    reading: &super::Reading,
    wanted: &dyn Fn(Kind) -> bool,
    findings: &mut Vec<String>,
) -> Vec<Option<Place>> {
    let options = [("--column", &reading.columns), ("--unit", &reading.units)];
    for (option, name) in
        options.into_iter().flat_map(|(option, pairs)| pairs.iter().map(move |pair| (option, &pair.0)))
    {
        if !signals.list.iter().any(|known| known.name == *name) {
            let names = signals.list.iter().map(|known| known.name.as_str()).collect::<Vec<_>>().join(", ");
            findings.push(format!("{option} {name}: {name} is no signal of a recording; known are {names}"));
        }
    }
    let mut is_absent = false;
    let before = findings.len();
    let mut places: Vec<Option<Place>> = vec![None; signals.list.len()];
    for (at, signal) in signals.list.iter().enumerate().filter(|(_, signal)| wanted(signal.kind)) {
        let name = &signal.name;
        let is_rotation = matches!(signal.kind, Kind::Theta | Kind::Omega);
        let column = given(&reading.columns, signal);
        let needed = !is_rotation && (at != TIME_AT || reading.rate_s.is_none());
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
                ([_, ..], _) if !is_rotation || column.is_some() => findings.push(format!(
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
                signals.list[other].name, columns[*found].name
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
    let other = other_machine(columns, reading.machine).filter(|_| findings.len() > before);
    findings.extend(other.map(|other| format!("these are columns of the machine {0}: --machine {0}", other.name)));
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
        let element = name.strip_suffix(&signal.name).and_then(|element| element.strip_suffix('.'));
        match element {
            _ if name == signal.name => Some(0),
            Some("plant") => Some(1),
            _ if name.starts_with("plant.") && signal.others.iter().any(|other| other == name) => Some(2),
            Some(_) => Some(3),
            None => signal.others.iter().position(|other| *other == name).map(|at| 4 + at),
        }
    };
    let ranks: Vec<Option<usize>> = columns.iter().map(|column| rank(&column.name)).collect();
    let best = ranks.iter().flatten().min();
    (0..columns.len()).filter(|at| ranks[*at].is_some() && ranks[*at].as_ref() == best).collect()
}
