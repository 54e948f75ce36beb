//! Recordings of test benches: tables of text with all their imperfections, made into samples at a uniform pace.

mod gaps;
mod header;
mod pace;
mod plausible;
mod stamps;
mod table;
mod text;
mod units;

use std::io::Read;

use self::header::{CURRENTS, OMEGA, POSITIONS, SIGNALS, THETA, TIME_AT};
use self::table::Table;

pub use self::plausible::Finding;
pub use self::units::{duration_s, rate_s};
pub(super) use self::units::{number_and_unit, significant, time};

/// Gaps of at most so many samples are filled; longer ones interrupt the identification.
pub const FILLED: usize = 3;

/// So many samples of both positions a recording must have.
const LEAST: usize = 20;

/// How far an instant may be from a sample to count as its own, in sample times.
const NEAR: f64 = 0.05;

/// A rate that is told and the slope of the time stamps may differ by so much; quartz clocks differ by a tenth of it.
const CLOCKS: f64 = 1e-3;

/// How the columns are to be read.
#[derive(Clone, Debug, Default)]
pub struct Reading {
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

/// What a current sample stands for decides how missing ones are filled.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Currents {
    /// The next known one stands for the interval before it.
    Before,
    /// The last known one stands for the interval after it.
    After,
    /// Straight lines.
    Linear,
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
    /// The speed was told; the angle is its integral.
    Told,
}

/// Signals at a uniform pace, in SI units; NaN where nothing is known.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Samples {
    /// Instant of the first sample, in seconds.
    pub start_s: f64,
    /// Sample time, in seconds.
    pub step_s: f64,
    /// Position (Y, Z), in m.
    pub position_m: [Vec<f64>; 2],
    /// Currents as recorded, in A; NaN where there was none.
    pub current_a: [Vec<f64>; 3],
    /// Angle of the rotor, unwrapped, in rad; empty if not known.
    pub theta_rad: Vec<f64>,
    /// Speed, in rad/s; empty if not known.
    pub omega_rad_s: Vec<f64>,
    /// Where the two come from.
    pub rotation: Rotation,
    /// By how much the recorded angle jumps back when it wraps, in rad as read; none if it does not.
    pub wrap_rad: Option<f64>,
    /// The units that the recorded signals were taken to be in, by the order (time, Ym, Zm, im\[1\], im\[2\], im\[3\], theta, omega).
    pub units: [Option<&'static str>; 8],
    /// The currents at instants of their own, if they were recorded apart: in s and A.
    pub apart: Option<(Vec<f64>, [Vec<f64>; 3])>,
    /// What was found and done, in sentences.
    pub notes: Vec<String>,
}

/// What keeps a recording from being used, all findings.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("the recording cannot be used:\n  {}", .0.join("\n  "))]
pub struct Unusable(pub Vec<String>);

impl Samples {
    /// Number of samples.
    #[must_use]
    pub fn len(&self) -> usize {
        self.position_m[0].len()
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The currents with a value at every sample where one can be had.
    #[must_use]
    pub fn currents(&self, how: Currents) -> [Vec<f64>; 3] {
        if let Some((time, columns)) = &self.apart {
            return std::array::from_fn(|k| {
                let instants = (0..self.len()).map(|j| self.start_s + j as f64 * self.step_s);
                gaps::resampled(time, &columns[k], instants, self.step_s, how)
            });
        }
        std::array::from_fn(|k| gaps::fill_current(&self.current_a[k], how))
    }

    /// Reads a recording, row by row.
    ///
    /// The text may be UTF-8, UTF-16 or Windows-1252. Columns are separated by comma, semicolon or tab, whichever the header
    /// has most of; a decimal comma is understood where they are not separated by commas. Empty cells and `NaN` are missing
    /// values. Time stamps are numbers, Unix times or ISO 8601; the samples are taken to be on the straight line through them.
    ///
    /// # Errors
    /// Everything that keeps the recording from being used.
    pub fn read_from(recording: impl Read, reading: &Reading) -> Result<Self, Unusable> {
        samples(Table::read(recording, reading, |_| true)?, reading)
    }

    /// Reads a recording that is a text already.
    ///
    /// # Errors
    /// As for [`Samples::read_from`].
    pub fn read(text: &str, reading: &Reading) -> Result<Self, Unusable> {
        Self::read_from(text.as_bytes(), reading)
    }

    /// Both tables of [`Samples::read_apart_from`] as texts.
    ///
    /// # Errors
    /// As for [`Samples::read_apart_from`].
    pub fn read_apart(motion: &str, currents: &str, reading: &Reading) -> Result<Self, Unusable> {
        Self::read_apart_from(motion.as_bytes(), currents.as_bytes(), reading)
    }

    /// Reads a recording whose currents stand in a table of their own, at any rate, by the same clock. What a current sample
    /// stands for decides how they are brought to the pace of the positions ([`Samples::currents`]).
    ///
    /// # Errors
    /// As for [`Samples::read_from`], of both tables.
    pub fn read_apart_from(motion: impl Read, currents: impl Read, reading: &Reading) -> Result<Self, Unusable> {
        let motion = Table::read(motion, reading, |signal| !CURRENTS.contains(&signal));
        // The tables need not have the same name for the time, nor is it read in the same unit.
        let own = |signal: &str| CURRENTS.map(|at| SIGNALS[at].name).any(|name| name == signal);
        let mut told = Reading { rate_s: None, ..reading.clone() };
        let wanted = |signal: usize| signal == TIME_AT || CURRENTS.contains(&signal);
        let mut text = Vec::new();
        let mut currents = currents;
        if let Err(error) = currents.read_to_end(&mut text) {
            return Err(Unusable(vec![format!("the table of the currents cannot be read: {error}")]));
        }
        let mut apart = Table::read(text.as_slice(), &told, wanted);
        if apart.is_err() {
            told.columns.retain(|(signal, _)| own(signal));
            told.units.retain(|(signal, _)| own(signal));
            apart = Table::read(text.as_slice(), &told, wanted).map_err(|second| apart.err().unwrap_or(second));
        }
        drop(text);
        let (motion, mut apart) = match (motion, apart) {
            (Ok(motion), Ok(apart)) => (motion, apart),
            (motion, apart) => {
                let of = |findings: Option<Unusable>, what: &str| {
                    let findings = findings.map(|unusable| unusable.0).unwrap_or_default();
                    findings.into_iter().map(|finding| format!("{what}: {finding}")).collect::<Vec<_>>()
                };
                let mut findings = of(motion.err(), "positions");
                findings.extend(of(apart.err(), "currents"));
                return Err(Unusable(findings));
            }
        };
        let origin_ns = |table: &Table| table.stamps.as_ref().map_or(0, stamps::Stamps::origin_ns);
        let later_s = (origin_ns(&apart) - origin_ns(&motion)) as f64 * 1e-9;
        let mut samples = samples(motion, reading)?;
        let known =
            |row: &usize| [TIME_AT].into_iter().chain(CURRENTS).all(|signal| apart.columns[signal][*row].is_finite());
        let rows: Vec<usize> = (0..apart.lines.len()).filter(known).collect();
        let column = |signal: usize| rows.iter().map(|row| apart.columns[signal][*row]).collect::<Vec<f64>>();
        let time: Vec<f64> = column(TIME_AT).into_iter().map(|time| time + later_s).collect();
        if time.len() < LEAST {
            return Err(Unusable(vec![format!(
                "currents: {} samples of all of them, {LEAST} at least are wanted",
                time.len()
            )]));
        }
        if let Some(row) = time.windows(2).position(|pair| pair[1] <= pair[0]) {
            return Err(Unusable(vec![format!(
                "currents: time does not rise from line {} to line {}",
                apart.lines[rows[row]],
                apart.lines[rows[row + 1]]
            )]));
        }
        let end_s = samples.start_s + samples.len() as f64 * samples.step_s;
        if time[0] > end_s || time[time.len() - 1] < samples.start_s {
            return Err(Unusable(vec![format!(
                "currents: their times, from {} to {}, and those of the positions, from {} to {}, have nothing in common; one \
                 clock is wanted",
                units::time(time[0]),
                units::time(time[time.len() - 1]),
                units::time(samples.start_s),
                units::time(end_s)
            )]));
        }
        samples.notes.append(&mut apart.notes);
        samples.notes.push(format!(
            "The currents have {} samples of their own, every {}.",
            time.len(),
            units::time(units::significant(gaps::median(&time), 4).parse().unwrap_or(f64::NAN))
        ));
        samples.units[CURRENTS].copy_from_slice(&apart.units[CURRENTS]);
        let currents = std::array::from_fn(|k| column(CURRENTS.start + k));
        samples.apart = Some((time, currents));
        Ok(samples)
    }

    /// What looks like a misread unit, by magnitude and by comparison of the signals with each other; `gap_m` is the nominal
    /// air gap in m. A recording with findings must not be used.
    #[must_use]
    pub fn implausible(&self, gap_m: f64) -> Vec<Finding> {
        plausible::findings(self, gap_m)
    }
}

/// Which sample each row belongs to.
struct Grid {
    start_s: f64,
    step_s: f64,
    count: usize,
    /// The sample that a row is.
    sample: Vec<Option<u32>>,
    /// The sample at the end of the interval in which a row lies, for currents that come more often than the positions.
    interval: Vec<Option<u32>>,
}

/// Brings the rows of a table to a uniform pace.
fn samples(table: Table, reading: &Reading) -> Result<Samples, Unusable> {
    let Table { mut columns, mut lines, units, stamps, mut notes } = table;
    let refuse = |why: String| Err(Unusable(vec![why]));
    if stamps.is_some() {
        // Rows without a time are of no use.
        let keep: Vec<bool> = columns[TIME_AT].iter().map(|time| time.is_finite()).collect();
        if keep.contains(&false) {
            for column in columns.iter_mut().filter(|column| !column.is_empty()) {
                let mut rows = keep.iter();
                column.retain(|_| *rows.next().unwrap_or(&false));
            }
            let mut rows = keep.iter();
            lines.retain(|_| *rows.next().unwrap_or(&false));
        }
    }
    // The pace is that of the positions; currents may have one of their own.
    let known = |row: &usize| {
        POSITIONS.into_iter().all(|signal| columns[signal].get(*row).is_some_and(|value| value.is_finite()))
    };
    let at: Vec<usize> = (0..lines.len()).filter(known).collect();
    if at.len() < LEAST {
        return refuse(format!("{} samples of both positions, {LEAST} at least are wanted", at.len()));
    }
    let time = std::mem::take(&mut columns[TIME_AT]);
    let mut findings = Vec::new();
    let grid = match &stamps {
        None => match reading.rate_s {
            Some(step_s) => Some(grid_of_rows(step_s, lines.len())),
            None => return refuse("there are no time stamps and no rate; --rate is wanted".into()),
        },
        Some(_) => match grid_of_stamps(&time, &at, &lines, reading, &mut notes) {
            Ok(grid) => grid,
            Err(mut why) => {
                findings.append(&mut why);
                None
            }
        },
    };
    if !findings.is_empty() {
        return Err(Unusable(findings));
    }
    let mut samples = Samples { units, ..Samples::default() };
    let jumps;
    (jumps, samples.wrap_rad) = wrap(&columns[THETA]);
    match grid {
        Some(grid) => take_rows(&mut samples, &grid, columns, jumps, &mut notes),
        None => {
            let step_s = reading.resample_s.unwrap_or(f64::NAN);
            if let Some(row) = time.windows(2).position(|pair| pair[1] <= pair[0]) {
                return refuse(format!("time does not rise from line {} to line {}", lines[row], lines[row + 1]));
            }
            let end_s = time[at[at.len() - 1]];
            samples.start_s = time[at[0]];
            samples.step_s = step_s;
            let count = (end_s - samples.start_s) / step_s + 1e-6;
            // The same limit as for a recording that is not interpolated.
            if !(count >= LEAST as f64 && count < 100.0 * lines.len() as f64) {
                return refuse(format!("--resample {step_s}: {count:.0} samples would come from {} rows", lines.len()));
            }
            interpolate_rows(&mut samples, count as usize + 1, &time, columns, jumps, &mut notes);
        }
    }
    let count = samples.len();
    notes.insert(0, format!("{count} samples of {}.", units::time(samples.step_s)));
    take_rotation(&mut samples, reading, &mut notes);
    samples.notes = notes;
    Ok(samples)
}

/// Rows without time stamps follow each other at the rate that was told.
fn grid_of_rows(step_s: f64, count: usize) -> Grid {
    let sample: Vec<Option<u32>> = (0..count as u32).map(Some).collect();
    Grid { start_s: 0.0, step_s, count, interval: sample.clone(), sample }
}

/// The pace that the time stamps have; none if it is to be interpolated.
fn grid_of_stamps(
    time: &[f64],
    at: &[usize],
    lines: &[u32],
    reading: &Reading,
    notes: &mut Vec<String>,
) -> Result<Option<Grid>, Vec<String>> {
    // Where a position is missing now and then its row still counts; where most rows have none, the others do.
    let all = 2 * at.len() > lines.len();
    let found = if all {
        pace::find(time, |row| lines[row])
    } else {
        let own: Vec<f64> = at.iter().map(|row| time[*row]).collect();
        pace::find(&own, |row| lines[at[row]])
    };
    let same = |a: f64, b: f64, freedom: f64| (a / b - 1.0).abs() <= freedom;
    let pace = match (found, reading.resample_s) {
        (Ok(pace), Some(told)) if !same(pace.step_s, told, NEAR / at.len() as f64) => {
            notes.push(format!(
                "The recording has a pace of {}; it was interpolated, as told.",
                units::time(pace.step_s)
            ));
            return Ok(None);
        }
        (Err(_), Some(_)) => {
            notes.push(
                "The recording has no uniform pace; it was interpolated, at the price of errors that the standard deviation \
                 does not know."
                    .into(),
            );
            return Ok(None);
        }
        (found, _) => found?,
    };
    let mut step_s = pace.step_s;
    if let Some(told) = reading.rate_s {
        if !same(step_s, told, CLOCKS) {
            return Err(vec![format!(
                "the rate that was told has samples {} apart, the time stamps {}; they must agree within {} %",
                units::time(told),
                units::time(step_s),
                100.0 * CLOCKS
            )]);
        }
        step_s = told;
    }
    notes.extend(pace.notes);
    let (sample, interval): (Vec<_>, Vec<_>) = if all {
        (pace.place.clone(), pace.place)
    } else {
        let near = NEAR.max(3.0 * pace.scatter).min(0.3);
        let place = |time: &f64| (time - pace.start_s) / pace.step_s;
        let mut sample = vec![None; time.len()];
        for (row, place) in at.iter().zip(&pace.place) {
            sample[*row] = *place;
        }
        let interval =
            time.iter().map(place).map(|place| (place - near).ceil()).map(|end| (end >= 0.0).then_some(end as u32));
        (sample, interval.collect())
    };
    // The grid reaches from the first row with both positions to the last.
    let first = at.iter().find_map(|row| sample[*row]).unwrap_or(0);
    let last = at.iter().rev().find_map(|row| sample[*row]).unwrap_or(first);
    let count = (last - first) as usize + 1;
    let cut = |places: Vec<Option<u32>>| -> Vec<Option<u32>> {
        places.into_iter().map(|place| place?.checked_sub(first).filter(|place| (*place as usize) < count)).collect()
    };
    let start_s = pace.start_s + f64::from(first) * step_s;
    Ok(Some(Grid { start_s, step_s, count, sample: cut(sample), interval: cut(interval) }))
}

/// The signals at the samples that the rows are.
fn take_rows(samples: &mut Samples, grid: &Grid, mut columns: Vec<Vec<f64>>, jumps: bool, notes: &mut Vec<String>) {
    let count = grid.count;
    samples.start_s = grid.start_s;
    samples.step_s = grid.step_s;
    let mut signal = |at: usize| {
        let column = std::mem::take(&mut columns[at]);
        let mut values = if column.is_empty() { Vec::new() } else { vec![f64::NAN; count] };
        for (value, sample) in column.iter().zip(&grid.sample).filter(|(value, _)| value.is_finite()) {
            if let Some(sample) = sample {
                values[*sample as usize] = *value;
            }
        }
        values
    };
    for (axis, at) in POSITIONS.enumerate() {
        let (filled, number) = gaps::fill_position(signal(at));
        if number > 0 {
            notes.push(format!("{number} missing samples of {} were filled by cubics.", SIGNALS[at].name));
        }
        samples.position_m[axis] = filled;
    }
    samples.theta_rad = signal(THETA);
    if jumps {
        unwrap(&mut samples.theta_rad, |sample| sample as f64);
    }
    samples.omega_rad_s = signal(OMEGA);
    for (k, at) in CURRENTS.enumerate() {
        if columns[at].is_empty() {
            continue;
        }
        samples.current_a[k] = mean_square(&std::mem::take(&mut columns[at]), &grid.interval, count);
        let missing = samples.current_a[k].iter().filter(|value| !value.is_finite()).count();
        if missing > 0 {
            notes.push(format!(
                "{missing} of {count} samples have no {}; they follow from their neighbours.",
                SIGNALS[at].name
            ));
        }
    }
}

/// The signals at a pace of their own, interpolated.
fn interpolate_rows(
    samples: &mut Samples,
    count: usize,
    time: &[f64],
    mut columns: Vec<Vec<f64>>,
    jumps: bool,
    notes: &mut Vec<String>,
) {
    let (start_s, step_s) = (samples.start_s, samples.step_s);
    if jumps {
        unwrap(&mut columns[THETA], |row| (time[row] - time[0]) / step_s);
    }
    let signal = |column: &[f64]| -> Vec<f64> {
        let instants = (0..count).map(|sample| start_s + sample as f64 * step_s);
        if column.is_empty() { Vec::new() } else { gaps::interpolate(time, column, instants, step_s) }
    };
    for (axis, at) in POSITIONS.enumerate() {
        let (filled, number) = gaps::fill_position(signal(&columns[at]));
        if number > 0 {
            notes.push(format!("{number} missing samples of {} were filled by cubics.", SIGNALS[at].name));
        }
        samples.position_m[axis] = filled;
    }
    for (k, at) in CURRENTS.enumerate() {
        samples.current_a[k] = signal(&columns[at]);
    }
    samples.theta_rad = signal(&columns[THETA]);
    samples.omega_rad_s = signal(&columns[OMEGA]);
}

/// Completes angle and speed, one from the other or from the speed that was told.
fn take_rotation(samples: &mut Samples, reading: &Reading, notes: &mut Vec<String>) {
    let count = samples.len();
    for line in [&mut samples.theta_rad, &mut samples.omega_rad_s] {
        gaps::fill_straight(line);
        // A column without any value is none.
        if line.iter().all(|value| !value.is_finite()) {
            line.clear();
        }
    }
    samples.rotation = match (samples.theta_rad.is_empty(), samples.omega_rad_s.is_empty(), reading.omega_rad_s) {
        (false, false, _) => Rotation::Both,
        (false, true, _) => {
            samples.omega_rad_s = speed_of(&samples.theta_rad, samples.step_s);
            notes.push("There is no speed; it is the slope of the angle.".into());
            Rotation::Angle
        }
        (true, false, _) => Rotation::Speed,
        (true, true, Some(speed)) => {
            samples.omega_rad_s = vec![speed; count];
            notes.push(format!("The speed is taken to be {} rad/s, as told.", units::significant(speed, 6)));
            Rotation::Told
        }
        (true, true, None) => {
            notes.push("There is neither angle nor speed: the unbalance cannot be identified.".into());
            Rotation::Unknown
        }
    };
    if matches!(samples.rotation, Rotation::Speed | Rotation::Told) {
        // The angle counts from the first sample.
        let mut angle = 0.0;
        let step_s = samples.step_s;
        samples.theta_rad = samples
            .omega_rad_s
            .iter()
            .map(|omega| {
                let now = angle;
                angle += omega * step_s;
                now
            })
            .collect();
        notes.push(
            "There is no angle; it is the integral of the speed, and the phase of the unbalance counts from it.".into(),
        );
    }
}

/// Currents that come more often than the positions count by their mean square over the interval that ends at the sample.
fn mean_square(column: &[f64], interval: &[Option<u32>], count: usize) -> Vec<f64> {
    let mut sums = vec![(0.0, 0.0, 0_u32); count];
    for (value, sample) in column.iter().zip(interval).filter(|(value, _)| value.is_finite()) {
        let Some(sample) = sample else { continue };
        let (sum, squares, number) = &mut sums[*sample as usize];
        *sum += value;
        *squares += value * value;
        *number += 1;
    }
    let mean = |(sum, squares, number): &(f64, f64, u32)| match number {
        0 => f64::NAN,
        // The only one keeps its sign and its last bit.
        1 => *sum,
        _ => (squares / f64::from(*number)).sqrt().copysign(*sum),
    };
    sums.iter().map(mean).collect()
}

/// Whether an angle ever jumps by more than half its range, and by how much it jumps when it wraps: always against its
/// direction. An angle without jumps is left as it is, for a unit that was misread must not be hidden by taking turns off it.
fn wrap(angle: &[f64]) -> (bool, Option<f64>) {
    let known = || angle.iter().copied().filter(|value| value.is_finite());
    let (low, high) =
        known().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| (low.min(value), high.max(value)));
    let mut jumps = Vec::new();
    let mut others = Vec::new();
    for (former, next) in known().zip(known().skip(1)) {
        let step = next - former;
        if step.abs() > 0.5 * (high - low) { jumps.push(step) } else { others.push(step) }
    }
    if jumps.is_empty() || others.len() < 2 * jumps.len() {
        return (!jumps.is_empty(), None);
    }
    let median = |steps: &mut Vec<f64>| {
        let middle = steps.len() / 2;
        *steps.select_nth_unstable_by(middle, f64::total_cmp).1
    };
    let (jump, step) = (median(&mut jumps), median(&mut others));
    let against = jumps.iter().all(|one| one.signum() == jump.signum()) && jump * step < 0.0;
    (true, against.then(|| (step - jump).abs()))
}

/// An angle without jumps of whole turns; `at` is where the value of an index lies, in samples. Over a gap the rotor turns on
/// as before.
fn unwrap(angle: &mut [f64], at: impl Fn(usize) -> f64) {
    use std::f64::consts::TAU;
    /// The pace is followed over about so many samples.
    const FOLLOWED: f64 = 20.0;
    let mut last: Option<(f64, f64)> = None;
    let mut pace = None;
    for (index, value) in angle.iter_mut().enumerate().filter(|(_, value)| value.is_finite()) {
        let here = at(index);
        if let Some((before, place)) = last {
            let samples = here - place;
            let expected = before + if samples > 1.5 { pace.unwrap_or(0.0) * samples } else { 0.0 };
            *value -= ((*value - expected) / TAU).round() * TAU;
            let step = (*value - before) / samples;
            pace = Some(pace.map_or(step, |pace: f64| pace + (step - pace) / FOLLOWED));
        }
        last = Some((*value, here));
    }
}

/// Slope of an angle, by straight lines fitted over 41 samples.
fn speed_of(theta: &[f64], step_s: f64) -> Vec<f64> {
    const HALF: usize = 20;
    (0..theta.len())
        .map(|j| {
            let from = j.saturating_sub(HALF).min(theta.len().saturating_sub(2 * HALF + 1));
            let piece = &theta[from..(from + 2 * HALF + 1).min(theta.len())];
            let middle = (piece.len() - 1) as f64 / 2.0;
            let (mut up, mut down) = (0.0, 0.0);
            for (n, value) in piece.iter().enumerate() {
                up += (n as f64 - middle) * value;
                down += (n as f64 - middle) * (n as f64 - middle);
            }
            up / down / step_s
        })
        .collect()
}
