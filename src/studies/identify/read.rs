//! Recordings of test benches: text tables with all their imperfections, converted to uniform samples.

mod grid;
mod header;
mod pace;
mod stamps;
mod table;
mod text;

use std::io::Read;
use std::ops::Range;

use self::pace::Pace;
use self::stamps::Stamps;
use self::table::Table;
use super::samples::Samples;
use super::signals::Known;
use super::units::{rounded_time, time};
use super::{faults, signals};
use crate::machine::Machine;
use crate::simulation::Pair;

pub(super) use self::header::{Signals, TIME_AT};

/// How to read a recording.
#[derive(Clone, Debug, Default)]
pub struct Reading {
    /// The machine; its signals are read.
    pub machine: &'static Machine,
    /// Whether the machine was stated. If not, a recording with the columns of a machine with more magnets is refused.
    pub is_stated: bool,
    /// The magnets in use, counted from 0, if not all.
    pub magnets: Option<Vec<usize>>,
    /// Names of columns: signal as in the interface, name in the header.
    pub columns: Vec<Pair>,
    /// Units: signal as in the interface, unit. The default is the unit in the header, or else SI.
    pub units: Vec<Pair>,
    /// Readings of columns that stand for 0: signal as in the interface, number in the unit of the column.
    pub zeros: Vec<Pair>,
    /// Speed in rad/s for a recording with neither angle nor speed.
    pub omega_rad_s: Option<f64>,
    /// Sample time in s for recordings without time stamps; time stamps must agree with it.
    pub rate_s: Option<f64>,
    /// Sample time in s to which recordings without a uniform pace are interpolated.
    pub resample_s: Option<f64>,
}

impl Reading {
    /// Whether to read this signal: angle and speed only for a rotor with unbalance.
    fn wants(&self, signals: &Signals, at: usize) -> bool {
        if signals.currents.contains(&at) {
            return self.magnets.as_ref().is_none_or(|used| used.contains(&(at - signals.currents.start)));
        }
        at < signals.theta || self.machine.planes > 0
    }
}

/// All reasons why a recording cannot be used.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("the recording cannot be used:\n  {}", .0.join("\n  "))]
pub struct Unusable(pub Vec<String>);

impl From<String> for Unusable {
    fn from(finding: String) -> Self {
        Self(vec![finding])
    }
}

impl Samples {
    /// Reads a recording.
    ///
    /// The text may be UTF-8, UTF-16 or Windows-1252, plain or compressed by gzip. Columns are separated by comma, semicolon or tab,
    /// whichever is most frequent in the header; decimal commas are accepted unless commas separate the columns. Empty cells and `NaN` are
    /// missing values. Time stamps are numbers, Unix times or ISO 8601; the samples are assumed to be on the straight line through them.
    ///
    /// # Errors
    /// All reasons why the recording cannot be used.
    pub fn read(mut recording: impl Read, reading: &Reading) -> Result<Self, Unusable> {
        let table = Table::read(&mut recording, reading, &|signals, at| reading.wants(signals, at))?;
        Self::of_tables(&table, None, reading)
    }

    /// Reads a recording whose currents are in a separate table, at any rate, by the same clock. The meaning of a current
    /// sample decides how they are resampled ([`Samples::currents`]).
    ///
    /// # Errors
    /// As for [`Samples::read`], of both tables.
    pub fn read_apart(mut motion: impl Read, mut currents: impl Read, reading: &Reading) -> Result<Self, Unusable> {
        let is_motion = |signals: &Signals, at| reading.wants(signals, at) && !signals.currents.contains(&at);
        let motion = Table::read(&mut motion, reading, &is_motion);
        let currents = table_of_currents(&mut currents, reading);
        match (motion, currents) {
            (Ok(motion), Ok(currents)) => Self::of_tables(&motion, Some(&currents), reading),
            (motion, currents) => {
                let [positions, currents] = [motion, currents].map(|table| table.err().into_iter().flat_map(|of| of.0));
                let named = positions.map(|finding| format!("positions: {finding}"));
                Err(Unusable(named.chain(currents.map(|finding| format!("currents: {finding}"))).collect()))
            }
        }
    }

    /// Converts the rows of a table to uniform samples; the currents may be in a separate table.
    fn of_tables(table: &Table, apart: Option<&Table>, reading: &Reading) -> Result<Self, Unusable> {
        let signals = &table.signals;
        let is_blank = |at: &usize| !table.columns[*at].is_empty() && table.columns[*at].iter().all(|x| x.is_nan());
        let blank = (signals.positions.start..signals.currents.end).filter(is_blank);
        let blank: Vec<String> =
            blank.map(|at| format!("{}: the column contains no readings", signals.list[at].name)).collect();
        if !blank.is_empty() {
            return Err(Unusable(blank));
        }
        let (Pace { start_s, step_s, place, notes, .. }, count) = grid::find(table, reading)?;
        let known = |at: usize| signals::known(&place, &table.columns[at]);
        let mut samples = Self { machine: reading.machine, start_s, step_s, units: table.units(), ..Self::default() };
        samples.notes.push(format!("{count} samples of {}.", time(step_s)));
        samples.notes.extend(table.notes.iter().cloned().chain(notes));
        let rows = table.known([signals.positions.start]).len();
        let is_aligned = |of: &Known| signals::is_at_samples(of) && 2 * of.len() > rows;
        let is_apart = signals.currents.clone().any(|at| !table.columns[at].is_empty() && !is_aligned(&known(at)));
        let end = if is_apart { signals.positions.end } else { signals.currents.end };
        samples.set_columns(table, signals.positions.start..end, &known, count);
        if is_apart {
            samples.set_apart(signals.currents.clone().map(known).collect());
        }
        let (mut theta, mut omega) = (known(signals.theta), known(signals.omega));
        let instant = |place: f64| time(start_s + place * step_s);
        let jumps = signals::leave_out_jumps(&mut theta);
        if let Some(first) = jumps.first() {
            let words = faults::outliers_in_words(jumps.len(), &instant(*first));
            samples.notes.push(format!("theta: {words}; left out."));
        }
        let [stuck, dropouts] = [signals::leave_out_stuck(&mut theta), signals::leave_out_dropouts(&mut omega)];
        let notes = [("theta", "stuck", stuck), ("omega", "wrong", dropouts)];
        samples
            .notes
            .extend(notes.iter().filter_map(|(name, how, rows)| faults::intervals_in_words(name, how, rows, instant)));
        samples.wrap_rad = signals::unwrap(&mut theta);
        samples.set_rotation(&theta, &omega, reading.omega_rad_s);
        if let Some(currents) = apart {
            let [origin_ns, later_ns] = [table, currents].map(|of| of.stamps.as_ref().map_or(0, Stamps::origin_ns));
            let later_s = (later_ns - origin_ns) as f64 * 1e-9;
            samples.set_currents(currents, later_s).map_err(|why| format!("currents: {why}"))?;
        }
        Ok(samples)
    }

    /// Sets positions and currents from the signals `of` of a table, without faulty readings.
    fn set_columns(&mut self, table: &Table, of: Range<usize>, known: &dyn Fn(usize) -> Known, count: usize) {
        let column = |at: usize| match known(at) {
            _ if table.columns[at].is_empty() => Vec::new(),
            known if signals::is_at_samples(&known) => signals::at_samples(&known, count),
            known => signals::straight(&known, count, false),
        };
        let mut columns: Vec<Vec<f64>> = of.clone().map(column).collect();
        if of.clone().all(|at| signals::is_at_samples(&known(at))) {
            let names = table.signals.list[of].iter().map(|signal| signal.name.as_str());
            let mut named: Vec<_> = names.zip(&mut columns).filter(|(_, values)| !values.is_empty()).collect();
            self.notes.extend(faults::leave_out(&mut named, self.start_s, self.step_s));
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

    /// Sets the currents from a table whose clock starts `later_s` later.
    fn set_currents(&mut self, table: &Table, later_s: f64) -> Result<(), String> {
        let currents = table.signals.currents.clone();
        let rows = table.known([TIME_AT].into_iter().chain(currents.clone()));
        grid::enough(&rows, "all of them")?;
        table.times(&rows).check_rising(|step| step < 0.0)?;
        let time_s = |row: usize| table.columns[TIME_AT][row] + later_s;
        let [begin_s, end_s] = [rows[0], rows[rows.len() - 1]].map(time_s);
        let last_s = self.start_s + self.len() as f64 * self.step_s;
        if begin_s > last_s || end_s < self.start_s {
            let [begin, end, first, last] = [begin_s, end_s, self.start_s, last_s].map(time);
            return Err(format!(
                "their times, from {begin} to {end}, and those of the positions, from {first} to {last}, do not overlap; \
                 expected one clock"
            ));
        }
        self.notes.extend(table.notes.iter().cloned());
        self.units[currents.clone()].copy_from_slice(&table.units()[currents.clone()]);
        let place = |row: usize| (time_s(row) - self.start_s) / self.step_s;
        let current = |at: usize| rows.iter().map(|row| (place(*row), table.columns[at][*row])).collect();
        self.set_apart(currents.map(current).collect());
        Ok(())
    }

    /// Sets currents that have their own places.
    fn set_apart(&mut self, currents: Vec<Known>) {
        let used = currents.iter().find(|known| !known.is_empty()).unwrap_or(&currents[0]);
        let (count, step) = (used.len(), rounded_time(self.step_s * signals::distance(used), 4));
        self.notes.push(format!("The currents have {count} samples of their own, every {step}."));
        self.apart = Some(currents);
    }
}

/// Reads a table of currents, whose name and unit of the time may differ from those in the table of positions.
fn table_of_currents(from: &mut dyn Read, reading: &Reading) -> Result<Table, Unusable> {
    let bytes = text::bytes(from)?;
    let wanted = |signals: &Signals, at| at == TIME_AT || signals.currents.contains(&at);
    let mut reading = Reading { rate_s: None, ..reading.clone() };
    Table::read(&mut bytes.as_slice(), &reading, &wanted).or_else(|first| {
        let currents = reading.machine.of_magnets("im");
        reading.columns.retain(|(signal, _)| currents.contains(signal));
        reading.units.retain(|(signal, _)| currents.contains(signal));
        reading.zeros.retain(|(signal, _)| currents.contains(signal));
        Table::read(&mut bytes.as_slice(), &reading, &wanted).map_err(|_| first)
    })
}
