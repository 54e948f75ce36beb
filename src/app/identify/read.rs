//! Recordings of test benches: tables of text with all their imperfections, made into samples at a uniform pace.

use crate::slave::unit::{AMPERE, METRE, ONE, RADIAN, RADIAN_PER_SECOND, SECOND, Unit};

/// Signals that a recording may have: name, other names it goes by, unit. The first six are needed.
const SIGNALS: [(&str, &[&str], Unit); 8] = [
    ("time", &["t", "Time", "zeit", "Zeit"], SECOND),
    ("Ym", &["Y", "y"], METRE),
    ("Zm", &["Z", "z"], METRE),
    ("im[1]", &["im1", "i[1]", "i1"], AMPERE),
    ("im[2]", &["im2", "i[2]", "i2"], AMPERE),
    ("im[3]", &["im3", "i[3]", "i3"], AMPERE),
    ("theta", &["theta_m"], RADIAN),
    ("omega", &["omegam"], RADIAN_PER_SECOND),
];
const NEEDED: usize = 6;
/// Where the currents stand among them.
const CURRENTS: std::ops::Range<usize> = 3..6;

/// How far an instant may be from the uniform pace, in sample times.
const JITTER: f64 = 0.05;

/// Gaps of at most so many samples are filled; longer ones interrupt the identification.
pub const FILLED: usize = 3;

/// How the columns are to be read.
#[derive(Clone, Debug, Default)]
pub struct Reading {
    /// Names of columns: signal as in the interface, name in the header.
    pub columns: Vec<(String, String)>,
    /// Units: signal as in the interface, unit. What stands in the header counts otherwise, then SI.
    pub units: Vec<(String, String)>,
    /// Speed in rad/s where the recording has neither angle nor speed.
    pub omega_rad_s: Option<f64>,
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
                instants.map(|instant_s| resampled(time, &columns[k], instant_s, self.step_s, how)).collect()
            });
        }
        std::array::from_fn(|k| fill_current(&self.current_a[k], how))
    }

    /// Reads the text of a recording.
    ///
    /// Columns are parted by comma, semicolon or tab, whichever the header has most of; a decimal comma is understood where
    /// they are not parted by commas. Empty cells and `NaN` are missing values.
    ///
    /// # Errors
    /// Everything that keeps the recording from being used.
    pub fn read(text: &str, reading: &Reading) -> Result<Self, Unusable> {
        Table::read(text, reading, |_| true)?.samples(reading)
    }

    /// Reads a recording whose currents stand in a table of their own, at any rate, by the same clock. What a current sample
    /// stands for decides how they are brought to the pace of the positions ([`Samples::currents`]).
    ///
    /// # Errors
    /// As for [`Samples::read`], of both tables.
    pub fn read_apart(motion: &str, currents: &str, reading: &Reading) -> Result<Self, Unusable> {
        let motion = Table::read(motion, reading, |signal| !CURRENTS.contains(&signal))?;
        // The tables need not have the same name for the time.
        let mut own = reading.clone();
        own.columns.retain(|(signal, name)| signal != "time" || currents.contains(name.as_str()));
        let apart = Table::read(currents, &own, |signal| signal == 0 || CURRENTS.contains(&signal))?;
        let mut samples = motion.samples(reading)?;
        let known = |row: &usize| [0].into_iter().chain(CURRENTS).all(|signal| apart.columns[signal][*row].is_finite());
        let rows: Vec<usize> = (0..apart.columns[0].len()).filter(known).collect();
        let column = |signal: usize| rows.iter().map(|row| apart.columns[signal][*row]).collect::<Vec<f64>>();
        let time = column(0);
        if time.len() < 20 || time.windows(2).any(|pair| pair[1] <= pair[0]) {
            return Err(Unusable(vec![format!(
                "{} samples of all currents, 20 at least are wanted at rising times",
                time.len()
            )]));
        }
        samples.notes.extend(apart.notes);
        samples.notes.push(format!(
            "The currents have {} samples of their own, every {:.6} ms.",
            time.len(),
            median(&time) * 1e3
        ));
        samples.apart = Some((time, std::array::from_fn(|k| column(CURRENTS.start + k))));
        Ok(samples)
    }
}

/// The columns of a recording, in SI units.
struct Table {
    /// In the order of [`SIGNALS`]; empty where there is none.
    columns: Vec<Vec<f64>>,
    notes: Vec<String>,
}

impl Table {
    /// Reads the signals that are `wanted`, by their places in [`SIGNALS`].
    fn read(text: &str, reading: &Reading, wanted: impl Fn(usize) -> bool) -> Result<Self, Unusable> {
        let text = text.trim_start_matches('\u{feff}');
        // Lines before the header, as data loggers write them, hold no separator or a remark.
        let header_line =
            text.lines().find(|line| !line.trim_start().starts_with(['#', '%']) && line.contains([',', ';', '\t']));
        let Some(header_line) = header_line else {
            return Err(Unusable(vec!["no header with the names of the columns was found".into()]));
        };
        let count = |separator: char| header_line.matches(separator).count();
        let separator = [';', '\t', ','].into_iter().max_by_key(|separator| count(*separator)).unwrap_or(',');
        let mut notes = Vec::new();
        let skipped = text.find(header_line).unwrap_or(0);
        let mut reader = csv::ReaderBuilder::new()
            .delimiter(separator as u8)
            .flexible(true)
            .has_headers(false)
            .trim(csv::Trim::All)
            .from_reader(&text.as_bytes()[skipped..]);
        let mut records = reader.records();
        let header: Vec<(String, Option<String>)> = match records.next() {
            Some(Ok(record)) => record.iter().map(name_and_unit).collect(),
            _ => return Err(Unusable(vec!["the header cannot be read".into()])),
        };
        let mut findings = Vec::new();
        let known: Vec<&str> = header.iter().map(|(name, _)| name.as_str()).collect();
        for (signal, _) in reading.columns.iter().chain(&reading.units) {
            if !SIGNALS.iter().any(|(name, ..)| name == signal) {
                let names: Vec<_> = SIGNALS.iter().map(|(name, ..)| *name).collect();
                findings.push(format!("{signal} is no signal of a recording: known are {}", names.join(", ")));
            }
        }
        // Where each signal stands, and what brings it to SI units.
        let mut places = Vec::new();
        for (at, (signal, others, unit)) in SIGNALS.iter().enumerate() {
            if !wanted(at) {
                places.push(None);
                continue;
            }
            let told = reading.columns.iter().rev().find(|(name, _)| name == signal).map(|(_, column)| column);
            let place = match told {
                Some(column) => {
                    let place = known.iter().position(|name| name == column);
                    if place.is_none() {
                        let known = known.join(", ");
                        findings.push(format!("--column {signal}={column}: the header has {known}"));
                    }
                    place
                }
                None => find(&known, signal, others),
            };
            let Some(place) = place else {
                if at < NEEDED && told.is_none() {
                    let known = known.join(", ");
                    findings.push(format!(
                        "{signal}: no column of this name; name one with --column {signal}=…, of {known}"
                    ));
                }
                places.push(None);
                continue;
            };
            let named = reading.units.iter().rev().find(|(name, _)| name == signal).map(|(_, unit)| unit.clone());
            let name = named.or_else(|| header[place].1.clone());
            let factor = match &name {
                Some(name) => unit.convert(1.0, name),
                None => Some(1.0),
            };
            match factor {
                Some(factor) => places.push(Some((place, factor))),
                None => {
                    let names: Vec<_> = unit.names().collect();
                    let given = name.as_deref().unwrap_or_default();
                    findings.push(format!("{signal}: the unit {given} is none of {}", names.join(", ")));
                    places.push(None);
                }
            }
            if name.is_none() && *unit != ONE {
                notes.push(format!(
                    "{signal} (column {}) has no unit; it is taken to be in {}.",
                    known[place], unit.name
                ));
            }
        }
        if !findings.is_empty() {
            return Err(Unusable(findings));
        }
        let mut columns = vec![Vec::new(); SIGNALS.len()];
        for (line, record) in records.enumerate() {
            let record = match record {
                Ok(record) => record,
                Err(error) => return Err(Unusable(vec![error.to_string()])),
            };
            if record.iter().all(str::is_empty) {
                continue;
            }
            for (column, place) in columns.iter_mut().zip(&places) {
                let Some((place, factor)) = place else { continue };
                let cell = record.get(*place).unwrap_or_default();
                match number(cell, separator) {
                    Some(value) => column.push(value * factor),
                    None => findings.push(format!("row {} after the header: {cell:?} is no number", line + 1)),
                }
            }
            if findings.len() > 5 {
                break;
            }
        }
        if findings.is_empty() { Ok(Self { columns, notes }) } else { Err(Unusable(findings)) }
    }

    fn samples(self, reading: &Reading) -> Result<Samples, Unusable> {
        let Self { mut columns, mut notes } = self;
        let refuse = |why: String| Err(Unusable(vec![why]));
        // Rows without a time are of no use.
        let keep: Vec<bool> = columns[0].iter().map(|time| time.is_finite()).collect();
        for column in columns.iter_mut().filter(|column| !column.is_empty()) {
            let mut rows = keep.iter();
            column.retain(|_| *rows.next().unwrap_or(&false));
        }
        let time = columns[0].clone();
        if let Some(row) = time.windows(2).position(|pair| pair[1] <= pair[0]) {
            return refuse(format!(
                "time does not rise from row {} ({} s) to the next ({} s)",
                row + 1,
                time[row],
                time[row + 1]
            ));
        }
        // The pace is that of the positions; currents may have one of their own.
        let at: Vec<usize> =
            (0..time.len()).filter(|row| columns[1][*row].is_finite() && columns[2][*row].is_finite()).collect();
        if at.len() < 20 {
            return refuse(format!("{} samples of both positions, 20 at least are wanted", at.len()));
        }
        let mut steps: Vec<f64> = at.windows(2).map(|pair| time[pair[1]] - time[pair[0]]).collect();
        steps.sort_by(f64::total_cmp);
        let start_s = time[at[0]];
        let last_s = time[*at.last().expect("twenty samples")];
        // The median is the pace, and the whole length makes it exact.
        let median = steps[steps.len() / 2];
        let exact = (last_s - start_s) / ((last_s - start_s) / median).round();
        let step_s = reading.resample_s.unwrap_or(exact);
        if !(step_s.is_finite() && step_s > 0.0) {
            return refuse(format!("a sample time of {step_s} s"));
        }
        let count = ((last_s - start_s) / step_s).round() as usize + 1;
        let worst = at
            .iter()
            .map(|row| (time[*row] - start_s) / step_s)
            .map(|place| (place - place.round()).abs())
            .fold(0.0, f64::max);
        let uniform = worst <= JITTER;
        if !uniform && reading.resample_s.is_none() {
            return refuse(format!(
                "the positions have no uniform pace: instants are up to {:.0} % of {:.4} ms off it; --resample {median} \
                 interpolates, at the price of errors that the standard deviation does not know",
                100.0 * worst,
                step_s * 1e3
            ));
        }
        let mut samples = Samples { start_s, step_s, ..Samples::default() };
        notes.insert(0, format!("{count} samples of {:.6} ms.", step_s * 1e3));
        let signal = |column: &[f64]| -> Vec<f64> {
            if column.is_empty() {
                Vec::new()
            } else if uniform {
                on_grid(&time, column, start_s, step_s, count)
            } else {
                (0..count).map(|j| interpolate(&time, column, start_s + j as f64 * step_s)).collect()
            }
        };
        if !uniform {
            notes.push("The recording has no uniform pace; it was interpolated.".into());
        }
        for axis in 0..2 {
            let (filled, number) = fill_position(&signal(&columns[1 + axis]));
            if number > 0 {
                notes.push(format!("{number} missing samples of {} were filled by cubics.", ["Ym", "Zm"][axis]));
            }
            samples.position_m[axis] = filled;
        }
        for k in (0..3).filter(|k| !columns[CURRENTS.start + k].is_empty()) {
            samples.current_a[k] = if uniform {
                mean_square(&time, &columns[3 + k], start_s, step_s, count)
            } else {
                signal(&columns[3 + k])
            };
            let missing = samples.current_a[k].iter().filter(|value| !value.is_finite()).count();
            if missing > 0 {
                notes.push(format!(
                    "{missing} of {count} samples have no im[{}]; they follow from their neighbours.",
                    k + 1
                ));
            }
        }
        let mut theta = unwrap(signal(&columns[6]));
        let mut omega = signal(&columns[7]);
        for line in [&mut theta, &mut omega] {
            fill_straight(line);
        }
        if theta.is_empty()
            && omega.is_empty()
            && let Some(speed) = reading.omega_rad_s
        {
            omega = vec![speed; count];
            notes.push(format!("The speed is taken to be {speed} rad/s, as told."));
        }
        if theta.is_empty() && !omega.is_empty() {
            // The angle counts from the first sample.
            let mut angle = 0.0;
            theta = omega
                .iter()
                .map(|omega| {
                    let now = angle;
                    angle += omega * step_s;
                    now
                })
                .collect();
            notes.push(
                "There is no angle; it is the integral of the speed, and the phase of the unbalance counts from it."
                    .into(),
            );
        } else if omega.is_empty() && !theta.is_empty() {
            omega = speed_of(&theta, step_s);
            notes.push("There is no speed; it is the slope of the angle.".into());
        }
        if theta.is_empty() {
            notes.push("There is neither angle nor speed: the unbalance cannot be identified.".into());
        }
        samples.theta_rad = theta;
        samples.omega_rad_s = omega;
        samples.notes = notes;
        Ok(samples)
    }
}

/// `name [unit]` or `name (unit)`; an index in brackets is no unit.
fn name_and_unit(cell: &str) -> (String, Option<String>) {
    let cell = cell.trim().trim_matches('"').trim();
    for (open, close) in [('[', ']'), ('(', ')')] {
        if let Some(inner) = cell.strip_suffix(close)
            && let Some((name, unit)) = inner.rsplit_once(open)
            && !name.trim().is_empty()
            && !unit.chars().all(|c| c.is_ascii_digit())
        {
            return (name.trim().into(), Some(unit.trim().into()));
        }
    }
    (cell.into(), None)
}

/// The column of a signal: by its name, behind an element's name (that of the plant first), or by another name.
fn find(known: &[&str], signal: &str, others: &[&str]) -> Option<usize> {
    let exact = |name: &str| known.iter().position(|candidate| *candidate == name);
    let behind = |name: &str| {
        let suffix = format!(".{name}");
        let mut found = known.iter().enumerate().filter(|(_, candidate)| candidate.ends_with(&suffix));
        match (found.next(), found.next()) {
            (Some((at, _)), None) => Some(at),
            _ => None,
        }
    };
    exact(signal)
        .or_else(|| exact(&format!("plant.{signal}")))
        .or_else(|| others.iter().find_map(|name| exact(&format!("plant.{name}")).filter(|_| signal == "omega")))
        .or_else(|| behind(signal))
        .or_else(|| others.iter().find_map(|name| exact(name)))
}

/// A cell as a number; `None` for what is none, NaN for what is missing.
fn number(cell: &str, separator: char) -> Option<f64> {
    let cell = cell.trim();
    if cell.is_empty() || cell.eq_ignore_ascii_case("nan") || cell == "-" || cell.eq_ignore_ascii_case("na") {
        return Some(f64::NAN);
    }
    match cell.parse::<f64>() {
        Ok(value) => Some(value),
        Err(_) if separator != ',' => cell.replace(',', ".").parse().ok(),
        Err(_) => None,
    }
}

/// The values at the instants of the grid, NaN where there are none.
fn on_grid(time: &[f64], column: &[f64], start_s: f64, step_s: f64, count: usize) -> Vec<f64> {
    let mut grid = vec![f64::NAN; count];
    for (time, value) in time.iter().zip(column) {
        let place = (time - start_s) / step_s;
        let near = place.round();
        if (place - near).abs() <= JITTER && near >= 0.0 && (near as usize) < count && value.is_finite() {
            grid[near as usize] = *value;
        }
    }
    grid
}

/// Currents that come more often than the positions count by their mean square over the interval that ends at the sample.
fn mean_square(time: &[f64], column: &[f64], start_s: f64, step_s: f64, count: usize) -> Vec<f64> {
    let mut sums = vec![(0.0, 0_u32); count];
    for (time, value) in time.iter().zip(column).filter(|(_, value)| value.is_finite()) {
        let place = ((time - start_s) / step_s - JITTER).ceil();
        if place >= 0.0 && (place as usize) < count {
            let (sum, number) = &mut sums[place as usize];
            *sum += value * value;
            *number += 1;
        }
    }
    sums.iter().map(|(sum, number)| if *number == 0 { f64::NAN } else { (sum / f64::from(*number)).sqrt() }).collect()
}

/// The usual distance of instants that rise.
fn median(time: &[f64]) -> f64 {
    let mut steps: Vec<f64> = time.windows(2).map(|pair| pair[1] - pair[0]).collect();
    steps.sort_by(f64::total_cmp);
    steps.get(steps.len() / 2).copied().unwrap_or(f64::NAN)
}

/// The current that a sample at an instant is to have, from samples at other instants: the root of the mean of its square over
/// the interval that the sample stands for, or the value on the straight line. NaN in gaps.
fn resampled(time: &[f64], column: &[f64], instant_s: f64, step_s: f64, how: Currents) -> f64 {
    // Instants come from decimal fractions.
    let rounding = 1e-6 * step_s;
    let reach = (FILLED as f64 + 1.0) * median(time).max(step_s);
    let (mut at, end) = match how {
        Currents::Linear => {
            let after = time.partition_point(|time| *time < instant_s - rounding);
            let near = |row: usize| time.get(row).is_some_and(|time| (time - instant_s).abs() <= reach);
            let between = near(after) && (after == 0 || near(after - 1));
            return if between { interpolate(time, column, instant_s) } else { f64::NAN };
        }
        Currents::Before => (instant_s - step_s, instant_s),
        Currents::After => (instant_s, instant_s + step_s),
    };
    let mut sum = 0.0;
    while at < end - rounding {
        // The first sample after the instant; it stands for what is before it, or the one before it for what is after.
        let next = time.partition_point(|time| *time <= at + rounding);
        let row = if how == Currents::Before { next } else { next.wrapping_sub(1) };
        let Some(value) = column.get(row).filter(|_| (time[row] - at).abs() <= reach) else { return f64::NAN };
        let until = time.get(next).copied().unwrap_or(end).min(end);
        sum += value * value * (until - at);
        at = until;
    }
    (sum / step_s).sqrt()
}

/// A straight line between the known neighbours of an instant.
fn interpolate(time: &[f64], column: &[f64], instant_s: f64) -> f64 {
    let after = time.partition_point(|time| *time < instant_s);
    let next = (after..time.len()).find(|row| column[*row].is_finite());
    let former = (0..after).rev().find(|row| column[*row].is_finite());
    match (former, next) {
        (_, Some(next)) if (time[next] - instant_s).abs() < 1e-12 => column[next],
        (Some(former), Some(next)) => {
            let share = (instant_s - time[former]) / (time[next] - time[former]);
            column[former] + share * (column[next] - column[former])
        }
        _ => f64::NAN,
    }
}

/// Short gaps filled by the cubic through two neighbours on both sides; how many samples were filled.
fn fill_position(values: &[f64]) -> (Vec<f64>, usize) {
    let mut filled = values.to_vec();
    let mut number = 0;
    let mut j = 0;
    while j < values.len() {
        if values[j].is_finite() {
            j += 1;
            continue;
        }
        let end = (j..values.len()).find(|at| values[*at].is_finite()).unwrap_or(values.len());
        let nodes = [j.wrapping_sub(2), j.wrapping_sub(1), end, end + 1];
        let known = nodes.map(|at| values.get(at).copied().unwrap_or(f64::NAN));
        if end - j <= FILLED && known.iter().all(|value| value.is_finite()) {
            for (at, place) in filled.iter_mut().enumerate().take(end).skip(j) {
                let x = at as f64;
                *place = (0..4)
                    .map(|n| {
                        let others = (0..4).filter(|m| *m != n);
                        known[n]
                            * others
                                .map(|m| (x - nodes[m] as f64) / (nodes[n] as f64 - nodes[m] as f64))
                                .product::<f64>()
                    })
                    .sum();
                number += 1;
            }
        }
        j = end;
    }
    (filled, number)
}

fn fill_current(values: &[f64], how: Currents) -> Vec<f64> {
    // A pace of its own is no gap: as far apart as they usually are, and a few more.
    let known: Vec<usize> = (0..values.len()).filter(|j| values[*j].is_finite()).collect();
    let mut steps: Vec<usize> = known.windows(2).map(|pair| pair[1] - pair[0]).collect();
    steps.sort_unstable();
    let reach = steps.get(steps.len() / 2).copied().unwrap_or(1) + FILLED;
    let mut filled = values.to_vec();
    for pair in known.windows(2) {
        let (former, next) = (pair[0], pair[1]);
        if next - former > reach {
            continue;
        }
        for (j, place) in filled.iter_mut().enumerate().take(next).skip(former + 1) {
            let share = (j - former) as f64 / (next - former) as f64;
            *place = match how {
                Currents::Before => values[next],
                Currents::After => values[former],
                Currents::Linear => values[former] + share * (values[next] - values[former]),
            };
        }
    }
    filled
}

/// Gaps filled by straight lines.
fn fill_straight(values: &mut [f64]) {
    let known: Vec<usize> = (0..values.len()).filter(|j| values[*j].is_finite()).collect();
    for pair in known.windows(2) {
        let (former, next) = (values[pair[0]], values[pair[1]]);
        for (j, place) in values.iter_mut().enumerate().take(pair[1]).skip(pair[0] + 1) {
            *place = former + (next - former) * (j - pair[0]) as f64 / (pair[1] - pair[0]) as f64;
        }
    }
}

/// An angle without jumps of whole turns.
fn unwrap(mut angle: Vec<f64>) -> Vec<f64> {
    use std::f64::consts::TAU;
    let mut last = f64::NAN;
    let mut turns = 0.0;
    for value in angle.iter_mut().filter(|value| value.is_finite()) {
        let raw = *value;
        if last.is_finite() {
            turns -= ((raw - last) / TAU).round();
        }
        last = raw;
        *value = raw + turns * TAU;
    }
    angle
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
