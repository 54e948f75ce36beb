//! The header of a recording: which column holds which signal, in which unit.

use std::ops::Range;

use super::{Reading, text};
use crate::machine::{self, MACHINES, Machine};
use crate::simulation::scenario::{ALIKE, Pair, likeness};
use crate::studies::identify::units::{self, ANGLE, CURRENT, LENGTH, Quantity, SPEED, TIME};

/// The time is the first signal of every machine.
pub(in crate::studies::identify) const TIME_AT: usize = 0;

/// Number of lines in which the header is searched for.
const BEFORE_HEADER: usize = 200;

/// A signal that a recording may have.
pub(in crate::studies::identify) struct Signal {
    /// Name as in the interface.
    pub name: String,
    /// Names that its column may have, the best first; one that begins with a point may follow the name of any element.
    names: Vec<String>,
    pub quantity: Quantity,
    /// Description for messages.
    meaning: String,
}

impl Signal {
    fn new(name: &str, others: &[&str], quantity: Quantity, meaning: &str) -> Self {
        let (of_plant, others): (Vec<&str>, Vec<&str>) = others.iter().partition(|other| other.starts_with("plant."));
        let [plant, element] = [format!("plant.{name}"), format!(".{name}")];
        let names = [&[name, &plant], &*of_plant, &[&element], &*others].concat();
        Self {
            name: name.into(),
            names: names.into_iter().map(str::to_owned).collect(),
            quantity,
            meaning: meaning.into(),
        }
    }

    /// The last option given for the signal.
    fn given<'a>(&self, options: &'a [Pair]) -> Option<&'a String> {
        options.iter().rev().find(|(name, _)| *name == self.name).map(|(_, value)| value)
    }

    /// A unit of the signal, or the calibration of its sensor whose readings are in the unit `of_column`.
    fn unit(&self, stated: &str, of_column: Option<&String>) -> Option<Unit> {
        let calibrated = || units::calibrated(self.quantity, stated, of_column).map(|si| (CALIBRATED, si));
        units::find(self.quantity, stated).or_else(|| calibrated().filter(|_| self.quantity != TIME))
    }

    /// Likeness of the name of a column to one of its names, apart from punctuation.
    fn likeness(&self, column: &Column) -> f64 {
        let plain = |name: &str| name.trim_start_matches("plant.").replace(['.', '_', ' ', '[', ']'], "");
        let names = self.names.iter().map(|name| likeness(&plain(name), &plain(&column.name)));
        names.fold(0.0, f64::max)
    }

    /// The columns that match the signal, one if all is well: the given column, with or without its unit, or those with the best name.
    fn candidates(&self, columns: &[Column], given: Option<&String>) -> Vec<usize> {
        let given = given.map(|given| vec![given.clone(), column(given).name]);
        let is = |column: &Column, name: &String| {
            column.name == *name || given.is_none() && name.starts_with('.') && column.name.ends_with(name.as_str())
        };
        let called = |name| (0..columns.len()).filter(|at| is(&columns[*at], name)).collect::<Vec<_>>();
        let names = given.as_ref().unwrap_or(&self.names);
        names.iter().map(called).find(|found| !found.is_empty()).unwrap_or_default()
    }
}

/// The signals of a machine: time, positions, currents, angle and speed. Positions and currents are required, the time if no rate is given.
pub(in crate::studies::identify) struct Signals {
    pub list: Vec<Signal>,
    pub positions: Range<usize>,
    pub currents: Range<usize>,
    pub theta: usize,
    pub omega: usize,
}

impl Signals {
    pub fn of(machine: &Machine) -> Self {
        let others = ["t", "Time", "TIME", "zeit", "Zeit", "timestamp", "Timestamp"];
        let mut list = vec![Signal::new("time", &others, TIME, "the time of the sample")];
        for machine::Reading { name, axis: along, .. } in machine.readings {
            let plain = name.trim_end_matches('m');
            let (bearing, axis) = plain.split_at(plain.len() - 1);
            let small = bearing.to_owned() + &axis.to_lowercase();
            list.push(Signal::new(name, &[plain, &small], LENGTH, &format!("the position along {along}")));
        }
        let positions = 1..list.len();
        for (k, name) in machine.of_magnets("im").iter().enumerate() {
            let ideal = name.replace("im[", "i[");
            let [plain, plain_ideal] = [name, &ideal].map(|name| name.replace(['[', ']'], ""));
            let meaning = machine.describe("the current of {magnet}", "", k);
            list.push(Signal::new(name, &[&plain, &ideal, &plain_ideal], CURRENT, &meaning));
        }
        let currents = positions.end..list.len();
        list.push(Signal::new("theta", &["theta_m"], ANGLE, "the angle of the rotor"));
        list.push(Signal::new("omega", &["omegam", "plant.omegam"], SPEED, "the speed of the rotor"));
        Self { positions, theta: currents.end, omega: currents.end + 1, currents, list }
    }
}

/// The machine with the most magnets whose positions and currents are all in the header, if it differs from this one.
fn other_machine(columns: &[Column], machine: &Machine) -> Option<&'static Machine> {
    let fits = |machine: &&Machine| {
        let Signals { list, positions, currents, .. } = Signals::of(machine);
        list[positions.start..currents.end].iter().all(|signal| signal.candidates(columns, None).len() == 1)
    };
    MACHINES.iter().filter(fits).max_by_key(|machine| machine.magnets()).filter(|most| *most != machine)
}

/// Start byte and line of the header in the text, and the separator of its columns. It is the line that names the most signals, since data loggers
/// write remarks and settings before it; a comment, as written by numpy.savetxt, if no other line names as many.
pub(super) fn find(text: &str, signals: &Signals, reading: &Reading) -> Option<(usize, u32, char)> {
    let mut end = 0;
    let headers = text.split_inclusive('\n').zip(1..).take(BEFORE_HEADER).filter_map(|(text, line)| {
        end += text.len();
        let names = text.trim_start().trim_start_matches(['#', '%']);
        let separator = text::separator(text)?;
        let columns: Vec<Column> = names.split(separator).map(column).collect();
        let is_named = |signal: &&Signal| signal.candidates(&columns, signal.given(&reading.columns)).len() == 1;
        let named = (signals.list.iter().filter(is_named).count(), names.len() == text.trim_start().len());
        Some((named, (end - names.len(), line, separator)))
    });
    headers.reduce(|best, next| if next.0 > best.0 { next } else { best }).map(|(_, header)| header)
}

/// A unit: its name and its size in SI.
pub(super) type Unit = (&'static str, f64);

/// The name of a unit that is the calibration of a sensor.
pub(super) const CALIBRATED: &str = "calibrated";

/// Column of a signal, its unit, if stated, and its reading that stands for 0.
#[derive(Clone, Copy, PartialEq)]
pub(super) struct Place {
    pub column: usize,
    pub unit: Option<Unit>,
    pub zero: f64,
}

/// A column as the header names it.
pub(super) struct Column {
    name: String,
    unit: Option<String>,
}

/// Reads a cell of a header: `name [unit]`, `name (unit)`, `name / unit` or `name in unit`; an index in brackets is not a unit, nor is a dash.
pub(super) fn column(cell: &str) -> Column {
    let cell = cell.trim().trim_matches('"').trim();
    let is_index = |unit: &str| !unit.is_empty() && unit.chars().all(|c| c.is_ascii_digit());
    let halves = || [" in ", "/"].into_iter().filter_map(|between| cell.split_once(between));
    let split = bracketed(cell).filter(|(name, unit)| !name.is_empty() && !is_index(unit)).or_else(|| {
        let named = halves().find(|(name, unit)| !name.trim().is_empty() && units::is_unit(unit));
        named.filter(|_| !units::is_unit(cell))
    });
    let (name, unit) = split.unwrap_or((cell, ""));
    Column { name: name.trim().into(), unit: stated(unit) }
}

/// The unit, unless the cell is empty or a dash.
fn stated(unit: &str) -> Option<String> {
    let unit = unit.trim();
    (!matches!(unit, "" | "-" | "–")).then(|| unit.to_owned())
}

/// The texts before and in brackets at the end of a cell.
fn bracketed(cell: &str) -> Option<(&str, &str)> {
    [('[', ']'), ('(', ')'), ('{', '}'), ('<', '>')].into_iter().find_map(|(open, close)| {
        let (name, unit) = cell.trim().strip_suffix(close)?.rsplit_once(open)?;
        Some((name.trim(), unit.trim()))
    })
}

/// Takes the units from the row below the header if it has no number and at least one unit; returns whether it does. Units in both places
/// must agree.
pub(super) fn take_units(columns: &mut [Column], cells: &csv::StringRecord, findings: &mut Vec<String>) -> bool {
    let unit = |cell| stated(bracketed(cell).filter(|(name, _)| name.is_empty()).map_or(cell, |(_, unit)| unit));
    let units: Vec<Option<String>> = cells.iter().map(unit).collect();
    let has_number = cells.iter().any(|cell| cell.trim().parse::<f64>().is_ok());
    if has_number || !units.iter().flatten().any(|unit| units::is_unit(unit)) {
        return false;
    }
    for (Column { name, unit }, below) in columns.iter_mut().zip(units) {
        let Some(below) = below else { continue };
        let own = unit.get_or_insert_with(|| below.clone());
        if *own != below {
            findings.push(format!("column {name}: the header says {own}, the row below it {below}; expected one unit"));
        }
    }
    true
}

/// List of names for messages.
fn joined<'a>(names: impl Iterator<Item = &'a String>) -> String {
    names.map(String::as_str).collect::<Vec<_>>().join(", ")
}

/// Finds the wanted signals, in the order of the list; errors go to the findings, units that are not stated to the notes.
pub(super) fn places(
    signals: &Signals,
    columns: &[Column],
    reading: &Reading,
    wanted: &dyn Fn(usize) -> bool,
    findings: &mut Vec<String>,
    notes: &mut Vec<String>,
) -> Vec<Option<Place>> {
    let before = findings.len();
    for (option, pairs) in [("--column", &reading.columns), ("--unit", &reading.units), ("--zero", &reading.zeros)] {
        for (name, _) in pairs.iter().filter(|(name, _)| signals.list.iter().all(|known| known.name != *name)) {
            let known = joined(signals.list.iter().map(|known| &known.name));
            findings.push(format!("{option} {name}: {name} is no signal of a recording; known are {known}"));
        }
    }
    let candidates = |(at, signal): (usize, &Signal)| {
        if wanted(at) { signal.candidates(columns, signal.given(&reading.columns)) } else { Vec::new() }
    };
    let candidates: Vec<Vec<usize>> = signals.list.iter().enumerate().map(candidates).collect();
    let nearest = |signal: &Signal| {
        let free = (0..columns.len()).filter(|at| candidates.iter().flatten().all(|taken| taken != at));
        let alike = free.map(|at| (signal.likeness(&columns[at]), &columns[at].name));
        let nearest = alike.filter(|(likeness, _)| *likeness > ALIKE).max_by(|a, b| a.0.total_cmp(&b.0));
        nearest.map_or_else(String::new, |(_, name)| format!("; the nearest name is {name}"))
    };
    let (mut places, mut is_absent) = (vec![None; signals.list.len()], false);
    for (at, signal) in signals.list.iter().enumerate().filter(|(at, _)| wanted(*at)) {
        let Signal { name, quantity, meaning, .. } = signal;
        let (given, stated) = (signal.given(&reading.columns), signal.given(&reading.units));
        let finding = match candidates[at].as_slice() {
            [column] => {
                let Column { name: title, unit: own } = &columns[*column];
                let stated = stated.or(own.as_ref());
                let found = stated.and_then(|stated| signal.unit(stated, own.as_ref()));
                if let (Some(stated), None) = (stated, found) {
                    let (known, some) = (units::names(quantity), quantity[quantity.len() / 2].0[0]);
                    let or = match at {
                        TIME_AT => String::new(),
                        _ => format!(", nor a calibration, as in --unit {name}=25{some}/V"),
                    };
                    findings.push(format!("{name} (column {title}): the unit {stated} is none of {known}{or}"));
                }
                let si = (quantity[0].0[0], quantity[0].1);
                if stated.is_none() && at != TIME_AT {
                    notes.push(format!("{name} has no unit; it is taken to be in {}.", si.0));
                }
                let zero = signal.given(&reading.zeros).map_or(Some(0.0), |zero| zero.trim().parse().ok());
                let is_sensor = |zero: &f64| zero.is_finite() && (at != TIME_AT || *zero == 0.0);
                let zero = zero.filter(is_sensor).unwrap_or_else(|| {
                    findings
                        .push(format!("--zero {name}: expected a number, the reading of a sensor that stands for 0"));
                    0.0
                });
                // The stamps determine the unit of the time.
                let place = Place { column: *column, unit: found.or((at != TIME_AT).then_some(si)), zero };
                if let Some((unit, size)) = place.unit
                    && (unit == CALIBRATED || zero != 0.0)
                {
                    let sign = if zero < 0.0 { '+' } else { '−' };
                    let [size, zero] = [size, zero.abs()].map(|of| units::significant(of, 6));
                    notes.push(format!("{name} is (reading {sign} {zero}) · {size} {}.", si.0));
                }
                // A control current is that of two magnets, with another sign.
                if let Some(other) = places.iter().position(|other| *other == Some(place)) {
                    let other = &signals.list[other].name;
                    findings.push(format!("{other} and {name}: both are column {title}; expected one for each"));
                }
                places[at] = Some(place);
                continue;
            }
            [] if given.or(stated).is_none() && (at >= signals.theta || at == TIME_AT && reading.rate_s.is_some()) => {
                let nearest = nearest(signal);
                if !nearest.is_empty() {
                    notes.push(format!("{name}: no column of this name{nearest} (--column {name}=…)."));
                }
                continue;
            }
            [] => {
                is_absent = true;
                let finding = match given {
                    Some(given) => format!("--column {name}={given}: there is no column {given}"),
                    None => {
                        let or_rate = if at == TIME_AT { ", or --rate if there is none" } else { "" };
                        format!("{name}: no column of this name, expected {meaning}: --column {name}=…{or_rate}")
                    }
                };
                finding + &nearest(signal)
            }
            several => {
                let is_same = several.iter().all(|at| columns[*at].name == columns[several[0]].name);
                let how = if is_same { "rename the others".into() } else { format!("--column {name}=…") };
                let several = joined(several.iter().map(|at| &columns[*at].name));
                format!("{name}: several columns match this name: {several}; choose one: {how}")
            }
        };
        findings.push(finding);
        if let Some(stated) = stated.filter(|stated| signal.unit(stated, None).is_none()) {
            findings.push(format!("--unit {name}={stated}: expected one of {}", units::names(quantity)));
        }
    }
    let is_other = findings.len() > before || !reading.is_stated;
    let other = other_machine(columns, reading.machine).filter(|_| is_other);
    findings.extend(other.map(|other| format!("these are columns of the machine {0}: --machine {0}", other.name)));
    if is_absent {
        findings.push(format!("the header has the columns {}", joined(columns.iter().map(|column| &column.name))));
    }
    places
}
