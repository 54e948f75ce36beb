//! The rows of a recording: the wanted columns as numbers in SI units.

use std::io::{self, Read};

use csv::StringRecord;

use super::header::{self, Column, Header, Place, Signals, TIME_AT};
use super::pace::{Times, listed};
use super::stamps::Stamps;
use super::{Reading, Unusable, text};

const NO_HEADER: &str =
    "no header was found: expected a line with the names of the columns, separated by comma, semicolon or tab";

/// Reading stops after this many findings.
const SHOWN: usize = 5;

/// The columns of a recording, in SI units.
pub(super) struct Table {
    pub signals: Signals,
    /// In the order of the signals; empty for a signal without a column.
    pub columns: Vec<Vec<f64>>,
    /// Line of each row in the file.
    pub lines: Vec<u32>,
    /// Unit assumed for each signal.
    pub units: Vec<Option<&'static str>>,
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
        let (head, mut text) = text::open(from)?;
        let Header { start, line, separator } =
            Header::find(&head, &signals, reading).ok_or_else(|| NO_HEADER.to_owned())?;
        io::copy(&mut text.by_ref().take(start as u64), &mut io::sink())?;
        let mut builder = csv::ReaderBuilder::new();
        builder.delimiter(separator as u8).flexible(true).has_headers(false).comment(Some(b'#'));
        let mut rows = builder.from_reader(text).into_records();
        let mut next = || rows.next().transpose().map_err(io::Error::from);
        let mut columns: Vec<Column> = next()?.iter().flatten().map(header::column).collect();
        let mut findings = Vec::new();
        // The row below the header, or the one below the units.
        let mut first = next()?;
        if first.as_ref().is_some_and(|units| header::take_units(&mut columns, units, &mut findings)) {
            first = next()?;
        }
        let places = header::places(&signals, &columns, reading, &|at| wanted(&signals, at), &mut findings);
        let count = signals.list.len();
        let (data, units) = (vec![Vec::new(); count], vec![None; count]);
        let (lines, notes) = (Vec::new(), Vec::new());
        let mut table = Self { signals, columns: data, lines, units, stamps: None, notes, places, separator };
        let line = |row: &StringRecord| line - 1 + row.position().map_or(1, csv::Position::line) as u32;
        if let Some(first) = &first
            && let Err(why) = table.find_stamps(first)
        {
            findings.push(format!("time, line {}: {why}", line(first)));
        }
        if !findings.is_empty() {
            return Err(Unusable(findings));
        }
        table.set_units();
        let rows = first.map(Ok).into_iter().chain(std::iter::from_fn(|| next().transpose()));
        table.add_rows(rows.map(|row| row.map(|row| (line(&row), row))), columns.len())?;
        table.leave_out_repeated();
        table.leave_out_lost();
        Ok(table)
    }

    /// Determines the format of the time stamps from the first row.
    fn find_stamps(&mut self, first: &StringRecord) -> Result<(), String> {
        let Some(Place { column, unit }) = self.places[TIME_AT] else { return Ok(()) };
        let (stamps, note) = Stamps::of(cell(first, column), self.separator, unit)?;
        self.units[TIME_AT] = stamps.unit.map(|(name, _)| name);
        self.stamps = Some(stamps);
        self.notes.extend(note);
        Ok(())
    }

    /// Sets the units; SI where none is stated.
    fn set_units(&mut self) {
        for (at, place) in self.places.iter().enumerate().skip(TIME_AT + 1) {
            let Some(Place { unit, .. }) = place else { continue };
            let (name, si) = (&self.signals.list[at].name, self.signals.list[at].quantity[0].0[0]);
            self.units[at] = Some(unit.map_or(si, |unit| unit.0));
            if unit.is_none() {
                self.notes.push(format!("{name} has no unit; it is taken to be in {si}."));
            }
        }
    }

    /// Adds rows, given with their lines.
    fn add_rows(
        &mut self,
        mut rows: impl Iterator<Item = io::Result<(u32, StringRecord)>>,
        width: usize,
    ) -> Result<(), Unusable> {
        let (mut findings, mut short) = (Vec::new(), 0);
        // Whether the last row lacks cells, and how many findings there were before it.
        let mut last = (false, 0);
        while findings.len() < SHOWN
            && let Some(row) = rows.next()
        {
            let (line, row) = row?;
            if row.iter().any(|cell| !cell.trim().is_empty()) {
                last = (row.len() < width, findings.len());
                short += usize::from(last.0);
                self.push(&row, line, width, &mut findings);
            }
        }
        let (is_short, before) = last;
        if is_short
            && rows.next().is_none()
            && let Some(line) = self.lines.pop()
        {
            // It may have been written only in part.
            short -= 1;
            findings.truncate(before);
            self.columns.iter_mut().for_each(|column| column.truncate(self.lines.len()));
            self.notes.push(format!("The last row (line {line}) is incomplete and was left out."));
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
        let is_repeated = |row: &usize| {
            let mut columns = self.columns.iter().filter(|column| !column.is_empty());
            columns.all(|column| column[*row].total_cmp(&column[*row - 1]).is_eq())
        };
        if equal.is_empty() || !equal.iter().all(is_repeated) {
            return;
        }
        let lines: Vec<u32> = equal.iter().map(|row| self.lines[*row]).collect();
        let kept: Vec<usize> = (0..self.lines.len()).filter(|row| equal.binary_search(row).is_err()).collect();
        for column in self.columns.iter_mut().filter(|column| !column.is_empty()) {
            *column = kept.iter().map(|row| column[*row]).collect();
        }
        self.lines = kept.iter().map(|row| self.lines[*row]).collect();
        self.notes
            .push(format!("Rows left out because they repeat the previous row with its time: {}.", listed(&lines)));
    }

    /// Leaves out the readings of rows after the first readings in which all positions and currents are 0: the logger has lost them.
    fn leave_out_lost(&mut self) {
        let of = self.signals.positions.start..self.signals.currents.end;
        let is_zero = |row: &usize| {
            let mut columns = self.columns[of.clone()].iter().filter(|column| !column.is_empty());
            columns.all(|column| column[*row] == 0.0)
        };
        let lost: Vec<usize> = (0..self.lines.len()).skip_while(is_zero).filter(is_zero).collect();
        if lost.is_empty() || 2 * lost.len() > self.lines.len() {
            return;
        }
        for column in self.columns.iter_mut().skip(TIME_AT + 1).filter(|column| !column.is_empty()) {
            for row in &lost {
                // The angle may come from elsewhere.
                column[*row] = if column[*row] == 0.0 { f64::NAN } else { column[*row] };
            }
        }
        let lines: Vec<u32> = lost.iter().map(|row| self.lines[*row]).collect();
        self.notes.push(format!("Rows left out because all positions and currents are 0: {}.", listed(&lines)));
    }

    /// Adds a row; its errors go to the findings.
    fn push(&mut self, record: &StringRecord, line: u32, width: usize, findings: &mut Vec<String>) {
        if record.iter().skip(width).any(|cell| !cell.trim().is_empty()) {
            let commas = if self.separator == ',' { "; decimal commas need another separator" } else { "" };
            findings.push(format!("line {line}: {} cells, the header has {width}{commas}", record.len()));
        }
        for (at, place) in self.places.iter().enumerate() {
            let Some(Place { column, unit }) = place else { continue };
            let cell = cell(record, *column);
            let (value, wanted) = match &self.stamps {
                Some(stamps) if at == TIME_AT => (stamps.seconds(cell, self.separator), "time"),
                _ => {
                    (text::number(cell, self.separator).map(|value| value * unit.map_or(1.0, |unit| unit.1)), "number")
                }
            };
            if value.is_none() {
                findings.push(format!("line {line}, {}: {cell:?} is no {wanted}", self.signals.list[at].name));
            }
            self.columns[at].push(value.unwrap_or(f64::NAN));
        }
        self.lines.push(line);
    }

    /// The origin of the times, in ns of the clock.
    pub(super) fn origin_ns(&self) -> i128 {
        self.stamps.as_ref().map_or(0, Stamps::origin_ns)
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
