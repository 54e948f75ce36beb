//! The number of samples in a table, and the sample number of each row.

use super::Reading;
use super::header::TIME_AT;
use super::pace::{CLOCKS, Pace};
use super::table::Table;
use crate::studies::identify::signals::ROUNDING;
use crate::studies::identify::{significant, time};

/// Minimum number of samples with all positions.
const LEAST: usize = 20;

/// A recording is not interpolated if its pace, by the end, is within this many sample times of the stated one.
const NEAR: f64 = 0.05;

const INTERPOLATED: &str =
    "The recording was interpolated, at the price of errors that the standard deviation does not include.";

/// Refuses too few rows with known values.
pub(super) fn enough(rows: &[usize], of: &str) -> Result<(), String> {
    let count = rows.len();
    if count < LEAST { Err(format!("{count} samples of {of}, expected at least {LEAST}")) } else { Ok(()) }
}

/// The pace of the positions, with the sample number of every row, and the number of samples; currents may have their own pace.
pub(super) fn find(table: &Table, reading: &Reading) -> Result<(Pace, usize), String> {
    let positions = table.signals.positions.clone();
    let of = ["no position", "the position", "both positions", "all positions"][positions.len().min(3)];
    let all = table.known([TIME_AT].into_iter().chain(positions));
    enough(&all, of)?;
    let timed = table.known([TIME_AT]);
    // Rows without a position count if there are no time stamps or if they are the minority; otherwise, only rows with all positions count.
    let is_dense = table.stamps.is_none() || 2 * all.len() > timed.len();
    let rows = if is_dense { &timed } else { &all };
    // Beyond its ends the rotation is not known.
    let rotation = [table.signals.theta, table.signals.omega].map(|signal| table.known([signal]));
    let is_known = |row: &usize| rotation.iter().all(|of| of.is_empty() || (of[0]..=of[of.len() - 1]).contains(row));
    let at: Vec<usize> = all.iter().copied().filter(is_known).collect();
    let left_out = all.len() - at.len();
    enough(&at, &format!("{of} and the rotation"))?;
    let stamp_s = &table.columns[TIME_AT];
    let found = table.times(rows).pace();
    let is_same = |a: f64, b: f64, tolerance: f64| (a / b - 1.0).abs() <= tolerance;
    let is_near = |wanted| found.as_ref().is_ok_and(|pace| is_same(pace.step_s, wanted, NEAR / at.len() as f64));
    let mut pace = match reading.resample_s.filter(|wanted| !is_near(*wanted)) {
        None => found?,
        Some(step_s) => Pace { start_s: stamp_s[at[0]], step_s, notes: vec![INTERPOLATED.into()], ..Pace::default() },
    };
    let is_interpolated = pace.place.is_empty();
    if left_out > 0 {
        let rows = if left_out == 1 { "row" } else { "rows" };
        pace.notes.push(format!("{left_out} {rows} before the first or after the last angle or speed left out."));
    }
    if !is_dense || is_interpolated {
        table.times(&timed).check_rising(|step| step < 0.0)?;
    }
    if let (Some((known, why)), None) = (&pace.uncertain, reading.rate_s) {
        let percent = significant(100.0 * known, 2);
        return Err(format!("{why}: the pace is known to {percent} % only; give --rate"));
    }
    let step_s = reading.rate_s.unwrap_or(pace.step_s);
    let tolerance = pace.uncertain.as_ref().map_or(CLOCKS, |(known, _)| *known);
    // Numbers of samples instead of times.
    let is_count = pace.step_s == 1.0;
    if !is_count && !is_same(pace.step_s, step_s, tolerance) {
        let ([stated, found], percent) = ([step_s, pace.step_s].map(time), significant(100.0 * tolerance, 2));
        return Err(format!(
            "the stated rate has samples {stated} apart, the time stamps {found}; they must agree within {percent} %"
        ));
    }
    let mut place: Vec<f64> = stamp_s.iter().map(|stamp| (stamp - pace.start_s) / pace.step_s).collect();
    rows.iter().zip(&pace.place).for_each(|(row, own)| place[*row] = *own);
    // The grid extends from the first row with all positions to the last.
    let mut placed = at.iter().map(|row| place[*row]).filter(|place| place.is_finite());
    let first = placed.next().unwrap_or(0.0);
    let count = placed.next_back().unwrap_or(first) - first + 1.0 + ROUNDING;
    let (least, most) = (LEAST as f64, 100.0 * stamp_s.len() as f64);
    if is_interpolated && !(least..most).contains(&count) {
        return Err(format!("--resample {step_s}: {count:.0} samples would come from {} rows", stamp_s.len()));
    }
    place.iter_mut().for_each(|place| *place -= first);
    let start_s = if is_count { (pace.start_s + first) * step_s } else { pace.start_s + first * step_s };
    Ok((Pace { start_s, step_s, place, ..pace }, count as usize))
}
