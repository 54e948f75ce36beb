//! The rows of a recording: the wanted columns as numbers in SI units.

use std::io::Read;
use std::iter::Peekable;

use csv::{StringRecord, Terminator};

use super::header::{self, CALIBRATED, Column, Place, Signals, TIME_AT};
use super::pace::{Times, listed};
use super::stamps::Stamps;
use super::{Reading, Unusable, text};

const NO_HEADER: &str =
    "no header was found: expected a line with the names of the columns, separated by comma, semicolon or tab";

/// The form of a cell, for messages.
const EXPECTED: &str = "; expected digits without separators of thousands; leave it empty if it is missing";

/// Reading stops after this many findings.
const SHOWN: usize = 5;

/// The columns of a recording, in SI units.
pub(super) struct Table {
    pub signals: Signals,
    /// In the order of the signals; empty for a signal without a column. Without time stamps, the time is the number of the row.
    pub columns: Vec<Vec<f64>>,
    /// Line of each row in the file.
    pub lines: Vec<u32>,
    /// Format of the time stamps, if there are any.
    pub stamps: Option<Stamps>,
    /// Findings, in sentences.
    pub notes: Vec<String>,
    /// Columns and units of the signals.
    places: Vec<Option<Place>>,
    separator: char,
}

impl Table {
    /// Reads the signals that are `wanted`.
    ///
    /// # Errors
    /// All errors in the header, or else in the rows.
    pub(super) fn read(
        from: &mut dyn Read,
        reading: &Reading,
        wanted: &dyn Fn(&Signals, usize) -> bool,
    ) -> Result<Self, Unusable> {
        let signals = Signals::of(reading.machine);
        let bytes = text::bytes(from)?;
        let text = text::decoded(&bytes);
        let (start, line, separator) = header::find(&text, &signals, reading).ok_or_else(|| NO_HEADER.to_owned())?;
        let mut builder = csv::ReaderBuilder::new();
        builder.delimiter(separator as u8).flexible(true).has_headers(false).comment(Some(b'#'));
        // With \r\n for an end the reader counts lines one too low; cells are trimmed of \r.
        builder.terminator(if text.contains('\n') { Terminator::Any(b'\n') } else { Terminator::CRLF });
        // Text in memory with rows of any length has no errors.
        let rows = builder.from_reader(text[start..].as_bytes()).into_records().map_while(Result::ok);
        let mut rows = rows.filter(|row| row.iter().any(|cell| !cell.trim().is_empty())).peekable();
        let mut columns: Vec<Column> = rows.next().iter().flatten().map(header::column).collect();
        let (mut findings, mut notes) = (Vec::new(), Vec::new());
        rows.next_if(|units| header::take_units(&mut columns, units, &mut findings));
        let mut places =
            header::places(&signals, &columns, reading, &|at| wanted(&signals, at), &mut findings, &mut notes);
        let line = |row: &StringRecord| line - 1 + row.position().map_or(1, csv::Position::line) as u32;
        let mut stamps = None;
        if let (Some(place), Some(first)) = (&mut places[TIME_AT], rows.peek()) {
            match Stamps::of(cell(first, place.column), separator, place.unit) {
                Ok((found, note)) => {
                    place.unit = found.unit;
                    stamps = Some(found);
                    notes.splice(..0, note);
                }
                Err(why) => findings.push(format!("time, line {}: {why}", line(first))),
            }
        }
        if !findings.is_empty() {
            return Err(Unusable(findings));
        }
        let data = vec![Vec::new(); signals.list.len()];
        let mut table = Self { signals, columns: data, lines: Vec::new(), stamps, notes, places, separator };
        table.add_rows(rows, line, columns.len())?;
        table.leave_out_repeated();
        table.leave_out_lost();
        if table.places[TIME_AT].is_none() {
            table.columns[TIME_AT] = (0..table.lines.len()).map(|row| row as f64).collect();
        }
        Ok(table)
    }

    /// Adds rows.
    fn add_rows(
        &mut self,
        mut rows: Peekable<impl Iterator<Item = StringRecord>>,
        line: impl Fn(&StringRecord) -> u32,
        width: usize,
    ) -> Result<(), Unusable> {
        let (mut findings, mut short) = (Vec::new(), 0);
        while findings.len() < SHOWN
            && let Some(row) = rows.next()
        {
            let line = line(&row);
            if row.len() < width {
                if rows.peek().is_none() {
                    // It may have been written only in part.
                    self.notes.push(format!("The last row (line {line}) is incomplete and was left out."));
                    break;
                }
                short += 1;
            }
            self.push(&row, line, width, &mut findings);
        }
        if short > 0 {
            self.notes.push(format!("{short} rows have fewer cells than the header; the missing ones count as empty."));
        }
        if findings.len() >= SHOWN {
            findings.push("reading stopped here".into());
        }
        if findings.is_empty() { Ok(()) } else { Err(Unusable(findings)) }
    }

    /// Leaves out rows that repeat the previous row, including its stamp, if no other stamps are equal, as rounded ones would be.
    fn leave_out_repeated(&mut self) {
        let time_s = &self.columns[TIME_AT];
        let equal: Vec<usize> = (1..time_s.len()).filter(|row| time_s[*row] == time_s[*row - 1]).collect();
        let is_repeated =
            |row: &usize| self.columns.iter().all(|of| of.is_empty() || of[*row].total_cmp(&of[*row - 1]).is_eq());
        if equal.iter().all(is_repeated) {
            self.leave_out(&equal, "they repeat the previous row with its time", |_, _| true);
        }
    }

    /// Leaves out the readings of rows after the first readings in which all positions and currents are 0: the logger has lost them.
    fn leave_out_lost(&mut self) {
        let readings = &self.columns[self.signals.positions.start..self.signals.currents.end];
        let is_zero = |row: &usize| readings.iter().all(|of| of.is_empty() || of[*row] == 0.0);
        let lost: Vec<usize> = (0..self.lines.len()).skip_while(is_zero).filter(is_zero).collect();
        if 2 * lost.len() <= self.lines.len() {
            // The angle may come from elsewhere.
            let is_lost = |at, value| at != TIME_AT && value == 0.0;
            self.leave_out(&lost, "all positions and currents are 0", is_lost);
        }
    }

    /// Leaves out those values of these rows, by signal, that are to be left out.
    fn leave_out(&mut self, rows: &[usize], why: &str, is_left_out: fn(usize, f64) -> bool) {
        if rows.is_empty() {
            return;
        }
        for (at, column) in self.columns.iter_mut().enumerate().filter(|(_, column)| !column.is_empty()) {
            for row in rows {
                column[*row] = if is_left_out(at, column[*row]) { f64::NAN } else { column[*row] };
            }
        }
        let lines: Vec<u32> = rows.iter().map(|row| self.lines[*row]).collect();
        self.notes.push(format!("Rows left out because {why}: {}.", listed(&lines)));
    }

    /// Adds a row; its errors go to the findings.
    fn push(&mut self, record: &StringRecord, line: u32, width: usize, findings: &mut Vec<String>) {
        if record.iter().skip(width).any(|cell| !cell.trim().is_empty()) {
            let commas = if self.separator == ',' { "; decimal commas need another separator" } else { "" };
            findings.push(format!("line {line}: {} cells, the header has {width}{commas}", record.len()));
        }
        for (at, place) in self.places.iter().enumerate() {
            let Some(Place { column, unit, zero }) = place else { continue };
            let cell = cell(record, *column);
            let (value, wanted) = match &self.stamps {
                Some(stamps) if at == TIME_AT => (stamps.seconds(cell, self.separator), "time"),
                _ => {
                    let number = text::number(cell, self.separator);
                    (number.map(|number| (number - zero) * unit.map_or(1.0, |unit| unit.1)), "number")
                }
            };
            if value.is_none() {
                let (name, hint) = (&self.signals.list[at].name, if findings.is_empty() { EXPECTED } else { "" });
                findings.push(format!("line {line}, {name}: {cell:?} is no {wanted}{hint}"));
            }
            self.columns[at].push(value.unwrap_or(f64::NAN));
        }
        self.lines.push(line);
    }

    /// Unit assumed for each signal, unless it was calibrated.
    pub(super) fn units(&self) -> Vec<Option<&'static str>> {
        let unit = |place: &Option<Place>| Some(place.as_ref()?.unit?.0).filter(|unit| *unit != CALIBRATED);
        self.places.iter().map(unit).collect()
    }

    /// The time stamps of these rows.
    pub(super) fn times(&self, rows: &[usize]) -> Times {
        let time_s = rows.iter().map(|row| self.columns[TIME_AT][*row]).collect();
        Times { time_s, lines: rows.iter().map(|row| self.lines[*row]).collect() }
    }

    /// Rows in which all of these signals are known.
    pub(super) fn known(&self, signals: impl IntoIterator<Item = usize> + Clone) -> Vec<usize> {
        let known = |row: &usize| {
            signals.clone().into_iter().all(|at| self.columns[at].get(*row).is_some_and(|value| value.is_finite()))
        };
        (0..self.lines.len()).filter(known).collect()
    }
}

/// A cell of a row; empty if the row ends before it.
fn cell(record: &StringRecord, column: usize) -> &str {
    record.get(column).unwrap_or_default().trim()
}
