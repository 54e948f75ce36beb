//! The header of a recording: which column is which signal, and in what unit.

use super::Reading;
use super::units::{self, ANGLE, CURRENT, LENGTH, Quantity, SPEED, TIME};

/// A signal that a recording may have.
pub(super) struct Signal {
    /// Name as in the interface.
    pub name: &'static str,
    /// Other names it goes by.
    others: &'static [&'static str],
    /// What it measures.
    pub quantity: Quantity,
    /// What a user would call it.
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

/// All of them. The positions and currents are needed, the time if no rate is told.
pub(super) const SIGNALS: [Signal; 8] = [
    signal("time", &["t", "Time", "TIME", "zeit", "Zeit", "timestamp", "Timestamp"], TIME, "the time of the sample"),
    signal("Ym", &["Y", "y"], LENGTH, "the position along y"),
    signal("Zm", &["Z", "z"], LENGTH, "the position along z"),
    signal("im[1]", &["im1", "i[1]", "i1"], CURRENT, "the current of magnet 1"),
    signal("im[2]", &["im2", "i[2]", "i2"], CURRENT, "the current of magnet 2"),
    signal("im[3]", &["im3", "i[3]", "i3"], CURRENT, "the current of magnet 3"),
    signal("theta", &["theta_m"], ANGLE, "the angle of the rotor"),
    signal("omega", &["omegam"], SPEED, "the speed of the rotor"),
];
/// Where they stand.
pub(super) const TIME_AT: usize = 0;
pub(super) const POSITIONS: std::ops::Range<usize> = 1..3;
pub(super) const CURRENTS: std::ops::Range<usize> = 3..6;
pub(super) const THETA: usize = 6;
pub(super) const OMEGA: usize = 7;

/// Where a signal stands in a row, and in what unit: its name and what one of it is in SI; none if nobody said.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Place {
    pub column: usize,
    pub unit: Option<(&'static str, f64)>,
}

/// A column as the header names it.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Column {
    name: String,
    unit: Option<String>,
}

/// Reads the cells of a header.
pub(super) fn columns<'a>(cells: impl Iterator<Item = &'a str>) -> Vec<Column> {
    cells.map(column).collect()
}

/// `name [unit]`, `name (unit)`, `name / unit` or `name in unit`; an index in brackets is no unit, nor is a dash.
fn column(cell: &str) -> Column {
    let cell = cell.trim().trim_matches('"').trim();
    let of = |name: &str, unit: &str| {
        let none = unit.is_empty() || matches!(unit, "-" | "–");
        Column { name: name.trim().into(), unit: (!none).then(|| unit.into()) }
    };
    if let Some((name, unit)) = bracketed(cell)
        && !name.trim().is_empty()
        && (unit.is_empty() || !unit.chars().all(|c| c.is_ascii_digit()))
    {
        return of(name, unit);
    }
    for between in [" in ", "/"] {
        if let Some((name, unit)) = cell.split_once(between)
            && !name.trim().is_empty()
            && units::is_unit(unit)
            && !units::is_unit(cell)
        {
            return of(name, unit.trim());
        }
    }
    Column { name: cell.into(), unit: None }
}

/// What stands before a bracket at the end, and in it.
fn bracketed(cell: &str) -> Option<(&str, &str)> {
    [('[', ']'), ('(', ')'), ('{', '}'), ('<', '>')].into_iter().find_map(|(open, close)| {
        let (name, unit) = cell.strip_suffix(close)?.rsplit_once(open)?;
        Some((name, unit.trim()))
    })
}

/// A row of units below the header: no number in it, and a unit in one of its cells at least. Units in both places must agree.
pub(super) fn take_units(columns: &mut [Column], cells: &[&str], findings: &mut Vec<String>) {
    for (column, cell) in columns.iter_mut().zip(cells) {
        let cell = cell.trim();
        let unit = bracketed(cell).filter(|(name, _)| name.is_empty()).map_or(cell, |(_, unit)| unit);
        if unit.is_empty() || matches!(unit, "-" | "–") {
            continue;
        }
        match &column.unit {
            Some(before) if before != unit => findings.push(format!(
                "column {}: the header says {before}, the row below it {unit}; one unit is wanted",
                column.name
            )),
            _ => column.unit = Some(unit.into()),
        }
    }
}

/// Whether a row below the header holds units.
pub(super) fn is_units(cells: &[&str]) -> bool {
    let unit = |cell: &&str| {
        let cell = cell.trim();
        units::is_unit(bracketed(cell).filter(|(name, _)| name.is_empty()).map_or(cell, |(_, unit)| unit))
    };
    cells.iter().any(unit) && !cells.iter().any(|cell| cell.trim().parse::<f64>().is_ok())
}

/// How many signals a line names, to find the header among the lines before it.
pub(super) fn recognised(columns: &[Column], reading: &Reading) -> usize {
    SIGNALS.iter().filter(|signal| matches!(find(columns, signal, told(reading, signal)), Ok(Some(_)))).count()
}

fn told<'a>(reading: &'a Reading, signal: &Signal) -> Option<&'a str> {
    reading.columns.iter().rev().find(|(name, _)| name == signal.name).map(|(_, column)| column.as_str())
}

/// Finds the wanted signals, in the order of [`SIGNALS`]; all that is wrong goes to the findings.
pub(super) fn places(
    columns: &[Column],
    reading: &Reading,
    wanted: impl Fn(usize) -> bool,
    findings: &mut Vec<String>,
) -> Vec<Option<Place>> {
    let known = columns.iter().map(|column| column.name.as_str()).collect::<Vec<_>>().join(", ");
    for (option, (signal, _)) in
        reading.columns.iter().map(|pair| ("--column", pair)).chain(reading.units.iter().map(|pair| ("--unit", pair)))
    {
        if !SIGNALS.iter().any(|candidate| candidate.name == signal) {
            let names: Vec<_> = SIGNALS.iter().map(|signal| signal.name).collect();
            findings.push(format!(
                "{option} {signal}: {signal} is no signal of a recording; known are {}",
                names.join(", ")
            ));
        }
    }
    let mut absent = Vec::new();
    let mut places: Vec<Option<Place>> = Vec::new();
    for (at, signal) in SIGNALS.iter().enumerate() {
        places.push(None);
        if !wanted(at) {
            continue;
        }
        let told = told(reading, signal);
        let column = match (find(columns, signal, told), told) {
            (Ok(Some(column)), _) => column,
            (Ok(None), Some(told)) => {
                findings.push(format!("--column {}={told}: there is no column {told}", signal.name));
                absent.push(None);
                continue;
            }
            (Ok(None), None) => {
                if at < THETA && (at != TIME_AT || reading.rate_s.is_none()) {
                    let rate = if at == TIME_AT { ", or --rate if there is none" } else { "" };
                    findings.push(format!(
                        "{}: no column of this name; {} is wanted: --column {}=…{rate}",
                        signal.name, signal.meaning, signal.name
                    ));
                    absent.push(Some(at));
                }
                continue;
            }
            (Err(several), _) => {
                let names: Vec<_> = several.iter().map(|column| columns[*column].name.as_str()).collect();
                if at < THETA || told.is_some() {
                    findings.push(format!(
                        "{}: several columns go by this name: {}; one is wanted: --column {}=…",
                        signal.name,
                        names.join(", "),
                        signal.name
                    ));
                }
                continue;
            }
        };
        if let Some(other) = (0..at).find(|other| places[*other].is_some_and(|place| place.column == column)) {
            findings.push(format!(
                "{} and {}: both are column {}; one of its own is wanted for each",
                SIGNALS[other].name, signal.name, columns[column].name
            ));
        }
        let named = reading.units.iter().rev().find(|(name, _)| name == signal.name).map(|(_, unit)| unit);
        let name = named.or(columns[column].unit.as_ref());
        let unit = name.and_then(|name| units::find(signal.quantity, name));
        if let (Some(name), None) = (name, unit) {
            findings.push(format!(
                "{} (column {}): the unit {name} is none of {}",
                signal.name,
                columns[column].name,
                units::names(signal.quantity)
            ));
        }
        places[at] = Some(Place { column, unit });
    }
    if !absent.is_empty() {
        findings.push(format!("the header has the columns {known}"));
    }
    places
}

/// The column of a signal: the one that was told, or by its name, behind an element's name (that of the plant first), or by
/// another name.
///
/// # Errors
/// Several that would do equally well.
fn find(columns: &[Column], signal: &Signal, told: Option<&str>) -> Result<Option<usize>, Vec<usize>> {
    let by = |fits: &dyn Fn(&str) -> bool| -> Result<Option<usize>, Vec<usize>> {
        let found: Vec<usize> = (0..columns.len()).filter(|at| fits(&columns[*at].name)).collect();
        if found.len() > 1 { Err(found) } else { Ok(found.first().copied()) }
    };
    let exact = |wanted: &str| by(&|name| name == wanted);
    if let Some(told) = told {
        // The name may be told with its unit, as it stands in the header.
        return Ok(exact(told)?.or(exact(&column(told).name)?));
    }
    let plant = |name: &str| exact(&format!("plant.{name}"));
    if let Some(at) = exact(signal.name)?.or(plant(signal.name)?) {
        return Ok(Some(at));
    }
    if signal.name == SIGNALS[OMEGA].name {
        for other in signal.others {
            if let Some(at) = plant(other)? {
                return Ok(Some(at));
            }
        }
    }
    let suffix = format!(".{}", signal.name);
    let behind = by(&|name| name.ends_with(&suffix));
    if let Ok(Some(at)) = behind {
        return Ok(Some(at));
    }
    for other in signal.others {
        if let Some(at) = exact(other)? {
            return Ok(Some(at));
        }
    }
    behind
}
