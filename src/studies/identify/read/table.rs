//! The rows of a recording: the wanted columns as numbers in SI units.

use std::fmt::Display;
use std::io::{self, Read};

use super::header::{self, Column, Kind, Place, Signals, TIME_AT};
use super::stamps::Stamps;
use super::{Reading, text};
use crate::machine::Machine;

/// The header is sought among so many lines.
const BEFORE_HEADER: usize = 200;

const NO_HEADER: &str =
    "no header was found: a line with the names of the columns is wanted, separated by comma, semicolon or tab";

/// So many cells that are no numbers are listed.
const SHOWN: usize = 5;

/// The columns of a recording, in SI units.
pub(super) struct Table {
    pub signals: Signals,
    /// In the order of the signals; empty where there is none.
    pub columns: Vec<Vec<f64>>,
    /// The line of the file in which each row stands.
    pub lines: Vec<u32>,
    /// In which unit each signal was taken to be.
    pub units: Vec<Option<&'static str>>,
    /// How the time stamps are written; none if there are none.
    pub stamps: Option<Stamps>,
    /// Findings, in sentences.
    pub notes: Vec<String>,
}

fn broken(error: &dyn Display) -> Vec<String> {
    vec![format!("the text cannot be read: {error}")]
}

impl Table {
    /// Reads the signals that are `wanted`.
    ///
    /// # Errors
    /// All that is wrong with the header, or with the rows.
    pub(super) fn read(
        from: &mut dyn Read,
        reading: &Reading,
        wanted: &dyn Fn(Kind) -> bool,
    ) -> Result<Self, Vec<String>> {
        let signals = Signals::of(reading.machine);
        let (head, mut text) = text::open(from).map_err(|error| broken(&error))?;
        let header = find_header(&head, &signals, reading).ok_or_else(|| vec![NO_HEADER.to_owned()])?;
        io::copy(&mut text.by_ref().take(header.start as u64), &mut io::sink()).map_err(|error| broken(&error))?;
        let mut reader = csv::ReaderBuilder::new()
            .delimiter(header.separator as u8)
            .flexible(true)
            .has_headers(false)
            .trim(csv::Trim::All)
            .comment(Some(b'#'))
            .from_reader(text);
        let mut record = csv::ByteRecord::new();
        let mut next = |record: &mut csv::ByteRecord| reader.read_byte_record(record).map_err(|error| broken(&error));
        let line_of =
            |record: &csv::ByteRecord| header.line + record.position().map_or(1, csv::Position::line) as u32 - 1;
        next(&mut record)?;
        let mut columns: Vec<Column> = owned(&record).iter().map(|cell| header::column(cell)).collect();
        let mut findings = Vec::new();
        let mut more = next(&mut record)?;
        if more && header::take_units(&mut columns, &owned(&record), &mut findings) {
            more = next(&mut record)?;
        }
        let places = header::places(&signals, &columns, reading, wanted, &mut findings);
        let count = signals.list.len();
        let mut table = Self {
            signals,
            columns: vec![Vec::new(); count],
            lines: Vec::new(),
            units: vec![None; count],
            stamps: None,
            notes: Vec::new(),
        };
        let is_larger = |other: &&Machine| other.magnets() > reading.machine.magnets();
        if let Some(other) = header::other_machine(&columns, reading.machine).filter(is_larger) {
            table.notes.push(format!("There are also columns of the machine {0}: --machine {0}?", other.name));
        }
        if let (Some(Place { column, unit }), true) = (places[TIME_AT], more) {
            match Stamps::of(record.get(column).unwrap_or_default(), header.separator, unit) {
                Ok((stamps, note)) => {
                    table.notes.extend(note);
                    table.units[TIME_AT] = stamps.unit();
                    table.stamps = Some(stamps);
                }
                Err(why) => findings.push(format!("time, line {}: {why}", line_of(&record))),
            }
        }
        if !findings.is_empty() {
            return Err(findings);
        }
        for (at, place) in places.iter().enumerate().skip(TIME_AT + 1) {
            let Some(Place { unit, .. }) = place else { continue };
            let (name, si) = (&table.signals.list[at].name, table.signals.list[at].quantity[0].0[0]);
            table.units[at] = Some(unit.map_or(si, |unit| unit.0));
            if unit.is_none() {
                table.notes.push(format!("{name} has no unit; it is taken to be in {si}."));
            }
        }
        // Rows with cells missing at their end; the last one may not have been written to its end.
        let (mut short, mut last_is_short) = (0, None);
        while more && findings.len() < SHOWN {
            if !record.iter().all(<[u8]>::is_empty) {
                findings.extend(last_is_short.take().into_iter().flatten());
                let wrong = table.push(&record, line_of(&record), &places, header.separator, columns.len());
                if record.len() < columns.len() {
                    short += 1;
                    last_is_short = Some(wrong);
                } else {
                    findings.extend(wrong);
                }
            }
            more = next(&mut record)?;
        }
        if findings.len() >= SHOWN {
            findings.push("reading stopped here".into());
        }
        if last_is_short.is_some()
            && let Some(line) = table.lines.pop()
        {
            short -= 1;
            table.columns.iter_mut().for_each(|column| column.truncate(table.lines.len()));
            table.notes.push(format!("The last row (line {line}) is incomplete and was left out."));
        }
        if short > 0 {
            table
                .notes
                .push(format!("{short} rows have fewer cells than the header; the missing ones count as empty."));
        }
        if findings.is_empty() { Ok(table) } else { Err(findings) }
    }

    /// Takes over a row; what is wrong with it is returned.
    fn push(
        &mut self,
        record: &csv::ByteRecord,
        line: u32,
        places: &[Option<Place>],
        separator: char,
        expected: usize,
    ) -> Vec<String> {
        let mut wrong = Vec::new();
        if record.iter().skip(expected).any(|cell| !cell.is_empty()) {
            let commas = if separator == ',' { "; decimal commas need another separator" } else { "" };
            wrong.push(format!("line {line}: {} cells, the header has {expected}{commas}", record.len()));
        }
        for (at, place) in places.iter().enumerate() {
            let Some(Place { column, unit }) = place else { continue };
            let cell = record.get(*column).unwrap_or_default();
            let value = match &self.stamps {
                Some(stamps) if at == TIME_AT => stamps.seconds(cell, separator),
                _ => text::number(cell, separator).map(|value| value * unit.map_or(1.0, |unit| unit.1)),
            };
            if value.is_none() {
                let cell = String::from_utf8_lossy(cell);
                let wanted = if at == TIME_AT { "time" } else { "number" };
                wrong.push(format!("line {line}, {}: {cell:?} is no {wanted}", self.signals.list[at].name));
            }
            self.columns[at].push(value.unwrap_or(f64::NAN));
        }
        self.lines.push(line);
        wrong
    }

    /// The origin of the times, in ns of the clock.
    pub(super) fn origin_ns(&self) -> i128 {
        self.stamps.as_ref().map_or(0, Stamps::origin_ns)
    }

    /// Refuses times that go back from one of these rows to the next.
    pub(super) fn check_rising(&self, rows: &[usize]) -> Result<(), String> {
        let time = &self.columns[TIME_AT];
        let back = rows.windows(2).find(|pair| time[pair[1]] < time[pair[0]]);
        let from_to = |pair: &[usize]| (self.lines[pair[0]], self.lines[pair[1]]);
        back.map(from_to).map_or(Ok(()), |(from, to)| Err(format!("time goes back from line {from} to line {to}")))
    }

    /// Numbers of the rows in which all of these signals are known.
    pub(super) fn known(&self, signals: impl IntoIterator<Item = usize> + Clone) -> Vec<usize> {
        let known = |row: &usize| {
            signals.clone().into_iter().all(|at| self.columns[at].get(*row).is_some_and(|value| value.is_finite()))
        };
        (0..self.lines.len()).filter(known).collect()
    }
}

fn owned(record: &csv::ByteRecord) -> Vec<String> {
    record.iter().map(|cell| String::from_utf8_lossy(cell).into_owned()).collect()
}

struct Header {
    /// Byte at which it starts, and its line in the file.
    start: usize,
    line: u32,
    separator: char,
}

/// The header: the line that names the most signals, since data loggers write remarks and settings before it.
fn find_header(head: &str, signals: &Signals, reading: &Reading) -> Option<Header> {
    let mut best: Option<(usize, Header)> = None;
    let mut start = 0;
    for (number, line) in head.split_inclusive('\n').enumerate().take(BEFORE_HEADER) {
        let header = |separator| Header { start, line: number as u32 + 1, separator };
        if let Some(separator) = text::separator(line).filter(|_| !line.trim_start().starts_with(['#', '%'])) {
            let columns: Vec<Column> = line.split(separator).map(header::column).collect();
            let recognised = signals.recognised(&columns, reading);
            if best.as_ref().is_none_or(|(most, _)| recognised > *most) {
                best = Some((recognised, header(separator)));
            }
        }
        start += line.len();
    }
    best.map(|(_, header)| header)
}
