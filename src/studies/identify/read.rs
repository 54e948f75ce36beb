//! Recordings of test benches: tables of text with all their imperfections, made into samples at a uniform pace.

mod header;
mod pace;
mod plausible;
mod signals;
mod stamps;
mod table;
mod text;

use std::io::Read;

use self::header::{Kind, Signals, TIME_AT};
use self::pace::Pace;
use self::signals::Known;
use self::table::Table;
use super::faults;
use super::units::{rounded_time, significant, time};
use crate::estimation::Hold;
use crate::machine::Machine;

pub(super) use self::plausible::REST_RAD_S;
pub(super) use self::signals::{median, noise, range};

/// The identification predicts across gaps of at most so many samples; longer ones begin a new segment.
pub const FILLED: usize = 3;

/// Rows by which gaps that are added follow those that there are: their effects are over by then, and the conditions are the same.
const LATER: usize = 16;
const MOST_ADDED: f64 = 0.03;

/// So many samples of both positions a recording must have.
const LEAST: usize = 20;

/// The time stamps may lead away from the samples that are to be interpolated by so many sample times at the end of the recording.
const NEAR: f64 = 0.05;

/// A rate that is given and the slope of the time stamps may differ by so much; quartz clocks differ by a tenth of it.
const CLOCKS: f64 = 1e-3;

/// How the columns are to be read.
#[derive(Clone, Debug, Default)]
pub struct Reading {
    /// The machine; its signals are read.
    pub machine: &'static Machine,
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
    fn wants(&self, kind: Kind) -> bool {
        match kind {
            Kind::Current(k) => self.magnets.as_ref().is_none_or(|used| used.contains(&k)),
            Kind::Theta | Kind::Omega => self.machine.planes > 0,
            Kind::Time | Kind::Position => true,
        }
    }
}

/// Where angle and speed of the rotor come from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Rotation {
    /// Neither is known.
    #[default]
    Unknown,
    /// Both were recorded.
    Both,
    /// The angle was recorded; the speed is its slope.
    Angle,
    /// The speed was recorded; the angle is its integral, from 0 at the first sample.
    Speed,
    /// The speed is stated; the angle is its integral.
    Told,
}

/// Signals at a uniform pace, in SI units; NaN where nothing is known.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Samples {
    /// The machine.
    pub machine: &'static Machine,
    /// Instant of the first sample, in seconds.
    pub start_s: f64,
    /// Sample time, in seconds.
    pub step_s: f64,
    /// Positions in the order of the readings, in m.
    pub position_m: Vec<Vec<f64>>,
    /// Currents by magnet as recorded, in A; NaN where there was none, and empty for a magnet that is not used.
    pub current_a: Vec<Vec<f64>>,
    /// By row, which positions and currents were not recorded, one bit for each of them in this order; short gaps are filled from their neighbours. Empty if
    /// nothing is missing.
    pub missing: Vec<u32>,
    /// Angle of the rotor, unwrapped, in rad; empty if not known.
    pub theta_rad: Vec<f64>,
    /// Speed, in rad/s; empty if not known.
    pub omega_rad_s: Vec<f64>,
    /// Where the two come from.
    pub rotation: Rotation,
    /// By how much the recorded angle jumps back when it wraps, in rad as read; none if it does not.
    pub wrap_rad: Option<f64>,
    /// The units that the recorded signals were taken to be in: time, positions, currents, angle, speed.
    pub units: Vec<Option<&'static str>>,
    /// The currents at places of their own, in samples from the first, if they were recorded at another rate.
    pub apart: Option<Vec<Vec<(f64, f64)>>>,
    /// Remarks, in sentences.
    pub notes: Vec<String>,
}

/// All findings that keep a recording from being used.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("the recording cannot be used:\n  {}", .0.join("\n  "))]
pub struct Unusable(pub Vec<String>);

impl Samples {
    /// Number of samples.
    #[must_use]
    pub fn len(&self) -> usize {
        self.position_m.first().map_or(0, Vec::len)
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The currents with a value at every sample where one can be had.
    #[must_use]
    pub fn currents(&self, how: Hold) -> Vec<Vec<f64>> {
        match &self.apart {
            Some(apart) => apart.iter().map(|current| signals::resampled(current, self.len(), how)).collect(),
            None => self.current_a.clone(),
        }
    }

    /// Positions, then currents, NaN also where a gap was filled.
    pub(super) fn unfilled(&self) -> Vec<Vec<f64>> {
        let mut columns = [self.position_m.clone(), self.currents(Hold::Linear)].concat();
        for (at, column) in columns.iter_mut().enumerate() {
            let missing = self.missing.iter().zip(column).filter(|(missing, _)| **missing >> at & 1 != 0);
            missing.for_each(|(_, value)| *value = f64::NAN);
        }
        columns
    }

    /// The same with as many gaps again, but in [`MOST_ADDED`] of the rows at most, [`LATER`] rows behind those that there are; none if nothing is missing.
    pub(super) fn thinned(&self) -> Option<Self> {
        let mut thinned = (self.apart.is_none() && !self.missing.is_empty()).then(|| self.clone())?;
        let gaps: Vec<usize> = (0..self.len().saturating_sub(LATER)).filter(|row| self.missing[*row] != 0).collect();
        let every = (gaps.len() as f64 / (MOST_ADDED * self.len() as f64)).ceil().max(1.0) as usize;
        gaps.iter().step_by(every).for_each(|row| thinned.missing[row + LATER] |= self.missing[*row]);
        let mut columns = thinned.unfilled();
        columns.iter_mut().for_each(|column| signals::fill(column));
        thinned.current_a = columns.split_off(self.position_m.len());
        thinned.position_m = columns;
        Some(thinned)
    }

    /// Reads a recording, row by row.
    ///
    /// The text may be UTF-8, UTF-16 or Windows-1252, also compressed by gzip. Columns are separated by comma, semicolon or tab, whichever the header
    /// has most of; a decimal comma is understood where they are not separated by commas. Empty cells and `NaN` are missing
    /// values. Time stamps are numbers, Unix times or ISO 8601; the samples are taken to be on the straight line through them.
    ///
    /// # Errors
    /// Everything that keeps the recording from being used.
    pub fn read_from(mut recording: impl Read, reading: &Reading) -> Result<Self, Unusable> {
        let table = Table::read(&mut recording, reading, &|kind| reading.wants(kind));
        table.and_then(|table| samples(table, reading)).map_err(Unusable)
    }

    /// Reads a recording that is a text already.
    ///
    /// # Errors
    /// As for [`Samples::read_from`].
    pub fn read(text: &str, reading: &Reading) -> Result<Self, Unusable> {
        Self::read_from(text.as_bytes(), reading)
    }

    /// Reads a recording whose currents stand in a table of their own, at any rate, by the same clock. What a current sample
    /// stands for decides how they are brought to the pace of the positions ([`Samples::currents`]).
    ///
    /// # Errors
    /// As for [`Samples::read_from`], of both tables.
    pub fn read_apart_from(
        mut motion: impl Read,
        mut currents: impl Read,
        reading: &Reading,
    ) -> Result<Self, Unusable> {
        let is_motion = |kind| reading.wants(kind) && !matches!(kind, Kind::Current(_));
        let of = |table: &str, findings: Vec<String>| -> Vec<String> {
            findings.iter().map(|finding| format!("{table}: {finding}")).collect()
        };
        let motion = Table::read(&mut motion, reading, &is_motion).map_err(|findings| of("positions", findings));
        let currents = table_of_currents(&mut currents, reading).map_err(|findings| of("currents", findings));
        let (motion, currents) = match (motion, currents) {
            (Ok(motion), Ok(currents)) => (motion, currents),
            (motion, currents) => {
                return Err(Unusable([motion.err(), currents.err()].into_iter().flatten().flatten().collect()));
            }
        };
        let later_s = (currents.origin_ns() - motion.origin_ns()) as f64 * 1e-9;
        let mut samples = samples(motion, reading).map_err(Unusable)?;
        samples.take_currents(currents, later_s).map_err(|finding| Unusable(of("currents", vec![finding])))?;
        Ok(samples)
    }

    /// Takes over the currents of a table whose clock began so much later.
    fn take_currents(&mut self, table: Table, later_s: f64) -> Result<(), String> {
        let of_currents = table.signals.currents.clone();
        let rows = table.known([TIME_AT].into_iter().chain(of_currents.clone()));
        if rows.len() < LEAST {
            return Err(format!("{} samples of all of them, {LEAST} at least are wanted", rows.len()));
        }
        table.check_rising(&rows)?;
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
        let place = |row: usize| (time_s(row) - self.start_s) / self.step_s;
        let current = |at: usize| rows.iter().map(|row| (place(*row), table.columns[at][*row])).collect();
        let currents = of_currents.clone().map(current).collect();
        self.notes.extend(table.notes);
        self.units[of_currents.clone()].copy_from_slice(&table.units[of_currents]);
        self.take_apart(currents);
        Ok(())
    }

    /// Takes over angle and speed, and completes one from the other or from the speed that was given.
    fn take_rotation(&mut self, theta: Known, omega: Known, given_rad_s: Option<f64>) {
        let line =
            |known: &Known| if known.is_empty() { Vec::new() } else { signals::straight(known, self.len(), true) };
        (self.theta_rad, self.omega_rad_s) = (line(&theta), line(&omega));
        if self.machine.planes == 0 {
            return;
        }
        let (rotation, note) = match (theta.is_empty(), omega.is_empty(), given_rad_s) {
            (false, false, _) => (Rotation::Both, None),
            (false, true, _) => {
                self.omega_rad_s = signals::slope(&self.theta_rad, self.step_s);
                (Rotation::Angle, Some("There is no speed; it is the slope of the angle.".into()))
            }
            (true, false, _) => (Rotation::Speed, None),
            (true, true, Some(speed)) => {
                self.omega_rad_s = vec![speed; self.len()];
                (Rotation::Told, Some(format!("The speed is taken to be {} rad/s, as stated.", significant(speed, 6))))
            }
            (true, true, None) => (
                Rotation::Unknown,
                Some("There is neither angle nor speed: the unbalance cannot be identified.".into()),
            ),
        };
        self.rotation = rotation;
        self.notes.extend(note);
        if matches!(self.rotation, Rotation::Speed | Rotation::Told) {
            let turned = self.omega_rad_s.iter().scan(0.0, |angle, omega| {
                let now = *angle;
                *angle += omega * self.step_s;
                Some(now)
            });
            self.theta_rad = turned.collect();
            self.notes.push(
                "There is no angle; it is the integral of the speed, and the phase of the unbalance counts from it."
                    .into(),
            );
        }
    }

    /// Takes over currents at places of their own.
    fn take_apart(&mut self, currents: Vec<Known>) {
        self.notes.push(format!(
            "The currents have {} samples of their own, every {}.",
            currents[0].len(),
            rounded_time(self.step_s * signals::distance(&currents[0]), 4)
        ));
        self.apart = Some(currents);
    }
}

/// Reads a table of currents. It need not have the same name for the time as that of the positions, nor the same unit.
fn table_of_currents(from: &mut dyn Read, reading: &Reading) -> Result<Table, Vec<String>> {
    let mut text = Vec::new();
    from.read_to_end(&mut text).map_err(|error| vec![format!("the text cannot be read: {error}")])?;
    let wanted = |kind: Kind| matches!(kind, Kind::Time | Kind::Current(_));
    let mut reading = Reading { rate_s: None, ..reading.clone() };
    Table::read(&mut text.as_slice(), &reading, &wanted).or_else(|first| {
        let currents = reading.machine.of_magnets("im");
        reading.columns.retain(|(signal, _)| currents.contains(signal));
        reading.units.retain(|(signal, _)| currents.contains(signal));
        Table::read(&mut text.as_slice(), &reading, &wanted).map_err(|_| first)
    })
}

/// Where the rows of a table are, and how many samples there are.
fn grid(table: &Table, reading: &Reading) -> Result<(Pace, usize), Vec<String>> {
    let refuse = |why: String| Err(vec![why]);
    let positions = table.signals.positions.clone();
    let of = ["no position", "the position", "both positions", "all positions"][positions.len().min(3)];
    let few = |count: usize| format!("{count} samples of {of}, {LEAST} at least are wanted");
    let Some(_) = &table.stamps else {
        let count = table.lines.len();
        return match (table.known(positions).len(), reading.rate_s) {
            (known @ 0..LEAST, _) => refuse(few(known)),
            (_, None) => refuse("there are no time stamps and no rate; --rate is wanted".into()),
            (_, Some(step_s)) => {
                let place = (0..count).map(|row| row as f64).collect();
                Ok((Pace { start_s: 0.0, step_s, place, notes: Vec::new() }, count))
            }
        };
    };
    let stamp_s = &table.columns[TIME_AT];
    let timed = table.known([TIME_AT]);
    // The pace is that of the positions; currents may have one of their own.
    let at = table.known([TIME_AT].into_iter().chain(positions));
    if at.len() < LEAST {
        return refuse(few(at.len()));
    }
    // Where a position is missing now and then its row still counts; where most rows have none, the others do.
    let is_dense = 2 * at.len() > timed.len();
    let rows = if is_dense { &timed } else { &at };
    let stamps: Vec<f64> = rows.iter().map(|row| stamp_s[*row]).collect();
    let found = pace::find(&stamps, |row| table.lines[rows[row]]);
    let same = |a: f64, b: f64, freedom: f64| (a / b - 1.0).abs() <= freedom;
    let pace = match (found, reading.resample_s) {
        (Ok(pace), Some(wanted)) if same(pace.step_s, wanted, NEAR / at.len() as f64) => pace,
        (_, Some(wanted)) => {
            table.check_rising(&timed).map_err(|why| vec![why])?;
            let start_s = stamp_s[at[0]];
            let place: Vec<f64> = stamp_s.iter().map(|stamp| (stamp - start_s) / wanted).collect();
            let count = place[at[at.len() - 1]] + 1e-6;
            // The same limit as for a recording that is not interpolated.
            if !(count >= LEAST as f64 && count < 100.0 * stamp_s.len() as f64) {
                return refuse(format!(
                    "--resample {wanted}: {count:.0} samples would come from {} rows",
                    stamp_s.len()
                ));
            }
            let note =
                "The recording was interpolated, at the price of errors that the standard deviation does not include.";
            return Ok((Pace { start_s, step_s: wanted, place, notes: vec![note.into()] }, count as usize + 1));
        }
        (found, None) => found?,
    };
    let mut place: Vec<f64> = stamp_s.iter().map(|stamp| (stamp - pace.start_s) / pace.step_s).collect();
    if !is_dense {
        table.check_rising(&timed).map_err(|why| vec![why])?;
    }
    rows.iter().zip(&pace.place).for_each(|(row, own)| place[*row] = *own);
    let step_s = reading.rate_s.unwrap_or(pace.step_s);
    if !same(pace.step_s, step_s, CLOCKS) {
        return refuse(format!(
            "the stated rate has samples {} apart, the time stamps {}; they must agree within {} %",
            time(step_s),
            time(pace.step_s),
            100.0 * CLOCKS
        ));
    }
    // The grid reaches from the first row with both positions to the last.
    let mut placed = at.iter().map(|row| place[*row]).filter(|place| place.is_finite());
    let first = placed.next().unwrap_or(0.0);
    let count = placed.next_back().unwrap_or(first) - first + 1.0;
    place.iter_mut().for_each(|place| *place -= first);
    Ok((Pace { start_s: pace.start_s + first * step_s, step_s, place, ..pace }, count as usize))
}

/// Brings the rows of a table to a uniform pace.
fn samples(table: Table, reading: &Reading) -> Result<Samples, Vec<String>> {
    let (Pace { start_s, step_s, place, notes }, count) = grid(&table, reading)?;
    let mut notes = [table.notes.clone(), notes].concat();
    let Signals { list, positions, currents: of_currents, theta, omega } = &table.signals;
    notes.insert(0, format!("{count} samples of {}.", time(step_s)));
    let known = |at: usize| signals::known(&place, &table.columns[at]);
    let units = table.units.clone();
    let mut samples = Samples { machine: reading.machine, start_s, step_s, units, ..Samples::default() };
    let currents: Vec<Known> = of_currents.clone().map(known).collect();
    let rows = table.known([positions.start]).len();
    let is_read = |at: &usize| table.units[*at].is_some();
    let is_beside = |of: &Known| signals::is_at_samples(of) && 2 * of.len() > rows;
    let is_apart = of_currents.clone().zip(&currents).any(|(at, of)| is_read(&at) && !is_beside(of));
    let at = positions.start..if is_apart { positions.end } else { of_currents.end };
    // With it, whether all of its readings are at samples.
    let column = |at: usize| match known(at) {
        _ if !is_read(&at) => (Vec::new(), true),
        known if signals::is_at_samples(&known) => (signals::at_samples(&known, count), true),
        known => (signals::straight(&known, count, false), false),
    };
    let (mut columns, at_samples): (Vec<Vec<f64>>, Vec<bool>) = at.clone().map(column).unzip();
    if at_samples.iter().all(|all| *all) {
        let named = at.clone().map(|at| list[at].name.as_str()).zip(&mut columns);
        let mut named: Vec<_> = named.filter(|(_, values)| !values.is_empty()).collect();
        notes.extend(faults::leave_out(&mut named, |row| time(start_s + row as f64 * step_s)));
    }
    for (at, values) in columns.iter_mut().enumerate() {
        if values.iter().any(|value| value.is_nan()) {
            samples.missing.resize(count, 0);
            let rows = samples.missing.iter_mut().zip(values.iter());
            rows.for_each(|(missing, value)| *missing |= u32::from(value.is_nan()) << at);
            signals::fill(values);
        }
    }
    let gaps = samples.missing.iter().filter(|missing| **missing != 0).count();
    if gaps > 0 {
        notes.push(format!("{gaps} of {count} samples lack a position or a current: gaps."));
    }
    samples.current_a = columns.split_off(positions.len());
    samples.current_a.resize(of_currents.len(), Vec::new());
    samples.position_m = columns;
    samples.notes = notes;
    if is_apart {
        samples.take_apart(currents);
    }
    let mut theta = known(*theta);
    samples.wrap_rad = signals::unwrap(&mut theta);
    samples.take_rotation(theta, known(*omega), reading.omega_rad_s);
    Ok(samples)
}
