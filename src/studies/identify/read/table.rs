//! The rows of a recording: the wanted columns as numbers in SI units.

use std::io::Read;

use super::header::{self, Place, SIGNALS, TIME_AT};
use super::stamps::Stamps;
use super::text::{self, Text};
use super::{Reading, Unusable};

/// The header is sought among so many lines.
const BEFORE_HEADER: usize = 200;

/// So many cells that are no numbers are listed.
const SHOWN: usize = 5;

/// The columns of a recording, in SI units.
pub(super) struct Table {
    /// In the order of [`SIGNALS`]; empty where there is none.
    pub columns: Vec<Vec<f64>>,
    /// The line of the file in which each row stands.
    pub lines: Vec<u32>,
    /// In which unit each signal was taken to be.
    pub units: [Option<&'static str>; SIGNALS.len()],
    /// How the time stamps are written; none if there are none.
    pub stamps: Option<Stamps>,
    /// What was found, in sentences.
    pub notes: Vec<String>,
}

impl Table {
    /// Reads the signals that are `wanted`, by their places in [`SIGNALS`].
    ///
    /// # Errors
    /// All that is wrong with the header, or with the rows.
    pub(super) fn read(from: impl Read, reading: &Reading, wanted: impl Fn(usize) -> bool) -> Result<Self, Unusable> {
        let broken = |error: &dyn std::fmt::Display| Unusable(vec![format!("the text cannot be read: {error}")]);
        let text = Text::open(from).map_err(|error| broken(&error))?;
        let header = find_header(&text, reading).ok_or_else(|| {
            Unusable(vec!["no header was found: a line with the names of the columns is wanted, separated by comma, semicolon or tab".into()])
        })?;
        let mut reader = csv::ReaderBuilder::new()
            .delimiter(header.separator as u8)
            .flexible(true)
            .has_headers(false)
            .trim(csv::Trim::All)
            .comment(Some(b'#'))
            .from_reader(text.from(header.start));
        let mut record = csv::ByteRecord::new();
        let line_of =
            |record: &csv::ByteRecord| header.line + record.position().map_or(1, csv::Position::line) as u32 - 1;
        let mut more = reader.read_byte_record(&mut record).map_err(|error| broken(&error))?;
        let cells = owned(&record);
        let mut columns = header::columns(cells.iter().map(String::as_str));
        // The row below may hold the units.
        let mut findings = Vec::new();
        more = more && reader.read_byte_record(&mut record).map_err(|error| broken(&error))?;
        let cells = owned(&record);
        let cells: Vec<&str> = cells.iter().map(String::as_str).collect();
        if more && header::is_units(&cells) {
            header::take_units(&mut columns, &cells, &mut findings);
            more = reader.read_byte_record(&mut record).map_err(|error| broken(&error))?;
        }
        let places = header::places(&columns, reading, wanted, &mut findings);
        let mut notes = Vec::new();
        let stamps = match (places[TIME_AT], more) {
            (Some(Place { column, unit }), true) => {
                match Stamps::of(record.get(column).unwrap_or_default(), header.separator, unit) {
                    Ok((stamps, note)) => {
                        notes.extend(note);
                        Some(stamps)
                    }
                    Err(why) => {
                        findings.push(format!("time, line {}: {why}", line_of(&record)));
                        None
                    }
                }
            }
            _ => None,
        };
        if !findings.is_empty() {
            return Err(Unusable(findings));
        }
        let mut units = [None; SIGNALS.len()];
        for (at, place) in places.iter().enumerate().filter(|(at, _)| *at != TIME_AT) {
            let Some(Place { unit, .. }) = place else { continue };
            let si = SIGNALS[at].quantity[0].0[0];
            units[at] = Some(unit.map_or(si, |unit| unit.0));
            if unit.is_none() {
                notes.push(format!("{} has no unit; it is taken to be in {si}.", SIGNALS[at].name));
            }
        }
        units[TIME_AT] = stamps.as_ref().and_then(Stamps::unit);
        let mut table = Self { columns: vec![Vec::new(); SIGNALS.len()], lines: Vec::new(), units, stamps, notes };
        // A row with cells missing at its end may be the last one, which was not written to its end.
        let mut short: Option<Vec<String>> = None;
        let mut shorter = 0;
        while more {
            let line = line_of(&record);
            if !record.iter().all(<[u8]>::is_empty) {
                if let Some(wrong) = short.take() {
                    findings.extend(wrong);
                    shorter += 1;
                }
                let wrong = table.push(&record, line, &places, header.separator, columns.len());
                if record.len() < columns.len() {
                    short = Some(wrong);
                } else {
                    findings.extend(wrong);
                }
                if findings.len() >= SHOWN {
                    findings.push("reading stopped here".into());
                    break;
                }
            }
            more = reader.read_byte_record(&mut record).map_err(|error| broken(&error))?;
        }
        if short.is_some() {
            for column in table.columns.iter_mut() {
                column.pop();
            }
            if let Some(line) = table.lines.pop() {
                table.notes.push(format!("The last row (line {line}) is incomplete and was left out."));
            }
        }
        if shorter > 0 {
            table
                .notes
                .push(format!("{shorter} rows have fewer cells than the header; the missing ones count as empty."));
        }
        if findings.is_empty() { Ok(table) } else { Err(Unusable(findings)) }
    }

    /// Takes over a row; what is wrong with it is answered.
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
            let value = match (&self.stamps, at == TIME_AT) {
                (Some(stamps), true) => stamps.seconds(cell, separator),
                _ => text::number(cell, separator).map(|value| value * unit.map_or(1.0, |unit| unit.1)),
            };
            if value.is_none() {
                let cell = String::from_utf8_lossy(cell);
                let wanted = if at == TIME_AT { "time" } else { "number" };
                wrong.push(format!("line {line}, {}: {cell:?} is no {wanted}", SIGNALS[at].name));
            }
            self.columns[at].push(value.unwrap_or(f64::NAN));
        }
        self.lines.push(line);
        wrong
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
fn find_header<R: Read>(text: &Text<R>, reading: &Reading) -> Option<Header> {
    let mut best: Option<(usize, Header)> = None;
    for (number, (start, line)) in text.lines().enumerate().take(BEFORE_HEADER) {
        if line.trim_start().starts_with(['#', '%']) {
            continue;
        }
        let Some(separator) = text::separator(&line) else { continue };
        let columns = header::columns(line.split(separator));
        let recognised = header::recognised(&columns, reading);
        if best.as_ref().is_none_or(|(most, _)| recognised > *most) {
            best = Some((recognised, Header { start, line: number as u32 + 1, separator }));
        }
    }
    best.map(|(_, header)| header)
}
