//! Recordings of test benches: tables of text with all their imperfections, made into samples at a uniform pace.

mod grid;
mod header;
mod pace;
mod stamps;
mod table;
mod text;

use std::io::{self, Read};
use std::ops::Range;

use self::pace::Pace;
use self::table::Table;
use super::samples::Samples;
use super::signals::Known;
use super::units::{rounded_time, time};
use super::{faults, signals};
use crate::machine::Machine;

pub(super) use self::header::{Signals, TIME_AT};

/// How the columns are to be read.
#[derive(Clone, Debug, Default)]
pub struct Reading {
    /// The machine; its signals are read.
    pub machine: &'static Machine,
    /// Whether the machine was stated. If not, a recording with the columns of a machine with more magnets is refused.
    pub is_stated: bool,
    /// The magnets that are used, counted from 0, if not all are.
    pub magnets: Option<Vec<usize>>,
    /// Names of columns: signal as in the interface, name in the header.
    pub columns: Vec<(String, String)>,
    /// Units: signal as in the interface, unit. What stands in the header counts otherwise, then SI.
    pub units: Vec<(String, String)>,
    /// Speed in rad/s where the recording has neither angle nor speed.
    pub omega_rad_s: Option<f64>,
    /// Sample time in seconds, for recordings without time stamps; where there are some they must agree with it.
    pub rate_s: Option<f64>,
    /// Sample time in seconds to which everything is interpolated, for recordings without a uniform pace.
    pub resample_s: Option<f64>,
}

impl Reading {
    /// Whether the machine has this signal: only a rotor with unbalance is told its rotation.
    fn wants(&self, signals: &Signals, at: usize) -> bool {
        let is_used = |k| self.magnets.as_ref().is_none_or(|used| used.contains(&k));
        match at.checked_sub(signals.currents.start) {
            Some(k) if at < signals.currents.end => is_used(k),
            _ => at < signals.theta || self.machine.planes > 0,
        }
    }
}

/// All findings that keep a recording from being used.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("the recording cannot be used:\n  {}", .0.join("\n  "))]
pub struct Unusable(pub Vec<String>);

impl From<String> for Unusable {
    fn from(finding: String) -> Self {
        Self(vec![finding])
    }
}

impl From<io::Error> for Unusable {
    fn from(error: io::Error) -> Self {
        format!("the text cannot be read: {error}").into()
    }
}

impl Unusable {
    /// The same, of one of two tables.
    fn of(self, table: &str) -> Self {
        Self(self.0.iter().map(|finding| format!("{table}: {finding}")).collect())
    }
}

impl Samples {
    /// Reads a recording, row by row.
    ///
    /// The text may be UTF-8, UTF-16 or Windows-1252, also compressed by gzip. Columns are separated by comma, semicolon or tab, whichever the header
    /// has most of; a decimal comma is understood where they are not separated by commas. Empty cells and `NaN` are missing
    /// values. Time stamps are numbers, Unix times or ISO 8601; the samples are taken to be on the straight line through them.
    ///
    /// # Errors
    /// Everything that keeps the recording from being used.
    pub fn read(mut recording: impl Read, reading: &Reading) -> Result<Self, Unusable> {
        let table = Table::read(&mut recording, reading, &|signals, at| reading.wants(signals, at))?;
        Self::of_tables(&table, None, reading)
    }

    /// Reads a recording whose currents stand in a table of their own, at any rate, by the same clock. What a current sample
    /// stands for decides how they are brought to the pace of the positions ([`Samples::currents`]).
    ///
    /// # Errors
    /// As for [`Samples::read`], of both tables.
    pub fn read_apart(mut motion: impl Read, mut currents: impl Read, reading: &Reading) -> Result<Self, Unusable> {
        let is_motion = |signals: &Signals, at| reading.wants(signals, at) && !signals.currents.contains(&at);
        let motion = Table::read(&mut motion, reading, &is_motion).map_err(|unusable| unusable.of("positions"));
        let currents = table_of_currents(&mut currents, reading).map_err(|unusable| unusable.of("currents"));
        match (motion, currents) {
            (Ok(motion), Ok(currents)) => Self::of_tables(&motion, Some(&currents), reading),
            (motion, currents) => {
                let unusable = [motion.err(), currents.err()].into_iter().flatten();
                Err(Unusable(unusable.flat_map(|Unusable(findings)| findings).collect()))
            }
        }
    }

    /// Brings the rows of a table to a uniform pace; the currents may stand in one of their own.
    fn of_tables(table: &Table, apart: Option<&Table>, reading: &Reading) -> Result<Self, Unusable> {
        let (Pace { start_s, step_s, place, notes, .. }, count) = grid::find(table, reading)?;
        let signals = &table.signals;
        let known = |at: usize| signals::known(&place, &table.columns[at]);
        let mut samples = Self { machine: reading.machine, start_s, step_s, ..Self::default() };
        samples.units.clone_from(&table.units);
        samples.notes.push(format!("{count} samples of {}.", time(step_s)));
        samples.notes.extend(table.notes.iter().cloned().chain(notes));
        let rows = table.known([signals.positions.start]).len();
        let is_beside = |of: &Known| signals::is_at_samples(of) && 2 * of.len() > rows;
        let is_apart = signals.currents.clone().any(|at| !table.columns[at].is_empty() && !is_beside(&known(at)));
        let end = if is_apart { signals.positions.end } else { signals.currents.end };
        samples.take_columns(table, signals.positions.start..end, &known, count);
        if is_apart {
            samples.take_apart(signals.currents.clone().map(known).collect());
        }
        let mut theta = known(signals.theta);
        samples.wrap_rad = signals::unwrap(&mut theta);
        samples.take_rotation(&theta, &known(signals.omega), reading.omega_rad_s);
        if let Some(currents) = apart {
            let later_s = (currents.origin_ns() - table.origin_ns()) as f64 * 1e-9;
            samples.take_currents(currents, later_s).map_err(|why| format!("currents: {why}"))?;
        }
        Ok(samples)
    }

    /// Takes over positions and currents, by their places among the signals, without readings that are faulty.
    fn take_columns(&mut self, table: &Table, of: Range<usize>, known: &dyn Fn(usize) -> Known, count: usize) {
        let column = |at: usize| match known(at) {
            _ if table.columns[at].is_empty() => Vec::new(),
            known if signals::is_at_samples(&known) => signals::at_samples(&known, count),
            known => signals::straight(&known, count, false),
        };
        let mut columns: Vec<Vec<f64>> = of.clone().map(column).collect();
        if of.clone().all(|at| signals::is_at_samples(&known(at))) {
            let names = table.signals.list[of].iter().map(|signal| signal.name.as_str());
            let mut named: Vec<_> = names.zip(&mut columns).filter(|(_, values)| !values.is_empty()).collect();
            self.notes.extend(faults::leave_out(&mut named, |row| time(self.start_s + row as f64 * self.step_s)));
        }
        let has_gaps = |(_, values): &(usize, &mut Vec<f64>)| values.iter().any(|value| value.is_nan());
        for (at, values) in columns.iter_mut().enumerate().filter(has_gaps) {
            self.missing.resize(count, 0);
            for (missing, value) in self.missing.iter_mut().zip(values.iter()) {
                *missing |= u32::from(value.is_nan()) << at;
            }
            signals::fill(values);
        }
        let gaps = self.missing.iter().filter(|missing| **missing != 0).count();
        if gaps > 0 {
            self.notes.push(format!("{gaps} of {count} samples lack a position or a current: gaps."));
        }
        self.current_a = columns.split_off(table.signals.positions.len());
        self.current_a.resize(table.signals.currents.len(), Vec::new());
        self.position_m = columns;
    }

    /// Takes over the currents of a table whose clock began so much later.
    fn take_currents(&mut self, table: &Table, later_s: f64) -> Result<(), String> {
        let currents = table.signals.currents.clone();
        let rows = table.known([TIME_AT].into_iter().chain(currents.clone()));
        grid::enough(&rows, "all of them")?;
        table.times(&rows).check_rising()?;
        let time_s = |row: usize| table.columns[TIME_AT][row] + later_s;
        let [begin_s, end_s] = [rows[0], rows[rows.len() - 1]].map(time_s);
        let last_s = self.start_s + self.len() as f64 * self.step_s;
        if begin_s > last_s || end_s < self.start_s {
            let [begin, end, first, last] = [begin_s, end_s, self.start_s, last_s].map(time);
            return Err(format!(
                "their times, from {begin} to {end}, and those of the positions, from {first} to {last}, have nothing in common; \
                 one clock is wanted"
            ));
        }
        self.notes.extend(table.notes.iter().cloned());
        self.units[currents.clone()].copy_from_slice(&table.units[currents.clone()]);
        let place = |row: usize| (time_s(row) - self.start_s) / self.step_s;
        let current = |at: usize| rows.iter().map(|row| (place(*row), table.columns[at][*row])).collect();
        self.take_apart(currents.map(current).collect());
        Ok(())
    }

    /// Takes over currents at places of their own.
    fn take_apart(&mut self, currents: Vec<Known>) {
        let (count, step) = (currents[0].len(), rounded_time(self.step_s * signals::distance(&currents[0]), 4));
        self.notes.push(format!("The currents have {count} samples of their own, every {step}."));
        self.apart = Some(currents);
    }
}

/// Reads a table of currents. It need not have the same name for the time as that of the positions, nor the same unit.
fn table_of_currents(from: &mut dyn Read, reading: &Reading) -> Result<Table, Unusable> {
    let mut text = Vec::new();
    from.read_to_end(&mut text)?;
    let wanted = |signals: &Signals, at| at == TIME_AT || signals.currents.contains(&at);
    let mut reading = Reading { rate_s: None, ..reading.clone() };
    Table::read(&mut text.as_slice(), &reading, &wanted).or_else(|first| {
        let currents = reading.machine.of_magnets("im");
        reading.columns.retain(|(signal, _)| currents.contains(signal));
        reading.units.retain(|(signal, _)| currents.contains(signal));
        Table::read(&mut text.as_slice(), &reading, &wanted).map_err(|_| first)
    })
}
