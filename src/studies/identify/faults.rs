//! Sensor faults, detected in the columns without a model: readings that are stuck, clipped (stuck at the end of a range) or single outliers,
//! and rows that a late logger repeats. They are left out.

use super::units::{rounded_time, significant, time};
use crate::studies::statistics::{median, quantile, range};

/// Probability of a false alarm in a whole column of good readings.
const CHANCE: f64 = 1e-6;
/// If more than this fraction of the readings are outliers, the signal is not smooth, and none are faults.
const MOST: f64 = 0.01;
/// Runs of equal readings up to this length are not faults: two readings may agree by chance of their digits.
const LEAST: usize = 4;
/// A range is clipped if its end has more than [`CLIPPED`] times the readings of the value beside it, plus [`FEWEST_CLIPPED`].
const CLIPPED: usize = 4;
const FEWEST_CLIPPED: usize = 10;
/// Rows before and after a clipped reading that are left out with it.
const BESIDE_CLIPPED: usize = 8;
/// Steps up to this multiple of the smallest one are those of the quantisation, apart from rounding, and twice as large ones with noise.
const SAME_STEP: f64 = 2.5;
/// Number of faults listed per column.
const LISTED: usize = 3;

/// A column of a recording with its name; names of positions end in m.
pub(super) type Column<'a> = (&'a str, &'a mut Vec<f64>);

/// Sets faulty readings and repeated rows to NaN. Returns notes on them.
pub(super) fn leave_out(columns: &mut [Column<'_>], start_s: f64, step_s: f64) -> Vec<String> {
    let instant = |row: usize| time(start_s + row as f64 * step_s);
    // Repeated rows first: leaving out readings of one column would hide them.
    let repetitions = leave_out_repetitions(columns, step_s);
    let mut notes = Vec::new();
    for (name, values) in columns.iter_mut() {
        let mut found = Vec::new();
        for (value, rows) in clipped(values) {
            let (value, count, first) = (significant(value, 4), rows.len(), instant(rows[0]));
            found.push(format!("clipped at {value} in {count} rows, the first at {first}"));
            // Near clipped readings, only those with inward noise remain: a biased sample.
            for row in rows {
                let end = (row + 1 + BESIDE_CLIPPED).min(values.len());
                values[row.saturating_sub(BESIDE_CLIPPED)..end].fill(f64::NAN);
            }
        }
        let [low, high] = range(&**values);
        let is_position = name.ends_with('m');
        let stuck = stuck(values);
        let returns = stuck.iter().filter(|rows| values[rows.start] == low).count();
        for rows in stuck {
            let value = values[rows.start];
            // A command held at its lower limit; no sensor range ends there, unless it is 0: a command returns to 0 often.
            if value == low && (low > 0.0 || low == 0.0 && returns >= FEWEST_CLIPPED) && !is_position {
                continue;
            }
            let how = if value == low || value == high { "clipped" } else { "stuck" };
            let [from, to] = [instant(rows.start), instant(rows.end - 1)];
            found.push(format!("{how} at {} from {from} to {to}", significant(value, 4)));
            // The first reading of a stuck sensor is its last good one.
            let first = rows.start + usize::from(how == "stuck");
            values[first..rows.end].fill(f64::NAN);
        }
        let outliers = outliers(values, if is_position { 0.0 } else { RARE });
        if let Some(first) = outliers.first() {
            found.push(outliers_in_words(outliers.len(), &instant(*first)));
            let beside = if is_position { 0 } else { BESIDE_OUTLIER };
            outliers.iter().for_each(|row| values[row - beside..=row + beside].fill(f64::NAN));
        }
        notes.extend(left_out(name, found));
    }
    notes.extend(repetitions);
    notes
}

/// The note on faults of a column, if there are any.
fn left_out(name: &str, mut found: Vec<String>) -> Option<String> {
    let more = found.len().saturating_sub(LISTED);
    found.truncate(LISTED);
    found.extend((more > 0).then(|| format!("{more} more")));
    (!found.is_empty()).then(|| format!("{name}: {}; left out.", found.join(", ")))
}

/// The note on an angle or a speed that is wrong from row to row, if there is any, with the instants of the rows.
pub(super) fn intervals_in_words(
    name: &str,
    how: &str,
    rows: &[[f64; 2]],
    instant: impl Fn(f64) -> String,
) -> Option<String> {
    let words = |[from, to]: &[f64; 2]| format!("{how} from {} to {}", instant(*from), instant(*to));
    left_out(name, rows.iter().map(words).collect())
}

/// The number of outliers and the instant of the first.
pub(super) fn outliers_in_words(count: usize, first: &str) -> String {
    if count == 1 { format!("an outlier at {first}") } else { format!("{count} outliers, the first at {first}") }
}

/// Values at which a sensor is clipped, with their rows: a negative minimum or positive maximum, apart from outliers, [`CLIPPED`] times as frequent as
/// the value beside it. The peak of a quantised sine is at most 1/(√2 − 1) times as frequent. A value of most readings is not clipped: nothing moves.
fn clipped(values: &[f64]) -> Vec<(f64, Vec<usize>)> {
    let mut sorted: Vec<f64> = values.iter().copied().filter(|value| value.is_finite()).collect();
    sorted.sort_by(f64::total_cmp);
    let mut runs: Vec<&[f64]> = sorted.chunk_by(|a, b| a == b).collect();
    let end = |runs: &[&[f64]]| {
        let mut beyond = 0.0;
        let is_near = |pair: &&[&[f64]]| {
            let is_outside = beyond <= MOST * sorted.len() as f64;
            beyond += pair[0].len() as f64;
            is_outside
        };
        let is_end = |pair: &&[&[f64]]| {
            let [end, beside] = [pair[0].len(), pair[1].len()];
            2 * end <= sorted.len() && end > CLIPPED * beside + FEWEST_CLIPPED
        };
        runs.windows(2).take_while(is_near).find(is_end).map(|pair| pair[0][0])
    };
    let low = end(&runs).filter(|end| *end < 0.0);
    runs.reverse();
    let high = end(&runs).filter(|end| *end > 0.0);
    let rows = |end: f64| (0..values.len()).filter(|row| values[*row] == end).collect();
    low.into_iter().chain(high).map(|end| (end, rows(end))).collect()
}

/// A larger part of rows that repeat the previous row may be due to a recorder that is faster than the controller.
const REPEATED: f64 = 0.1;
/// Beyond this part nothing moves.
const MOST_REPEATED: f64 = 0.95;

/// Leaves out rows that repeat the previous row; none if most rows repeat, since nothing moves, without noise.
fn leave_out_repetitions(columns: &mut [Column<'_>], step_s: f64) -> Option<String> {
    let count = columns.first()?.1.len();
    let is_repeated = |row: usize| (1..count).contains(&row) && columns.iter().all(|(_, of)| of[row] == of[row - 1]);
    let rows: Vec<usize> = (0..count).filter(|row| is_repeated(*row)).collect();
    let share = rows.len() as f64 / count as f64;
    if rows.is_empty() || share > MOST_REPEATED {
        return None;
    }
    let is_left_out = share <= 0.5;
    for (_, values) in columns.iter_mut().filter(|_| is_left_out) {
        rows.iter().for_each(|row| values[*row] = f64::NAN);
    }
    let mut note = format!("{} rows ({} %) repeat the previous row", rows.len(), significant(100.0 * share, 2));
    note += if is_left_out { "; left out." } else { "." };
    if share > REPEATED {
        let pace = rounded_time(step_s / (1.0 - share), 3);
        note += &format!(" If the recorder is faster than the controller: --resample {}.", pace.replace(' ', ""));
    }
    Some(note)
}

/// Longest run of equal readings that chance explains: if a fraction p of the readings equals the one before, a run of n occurs in N rows with a
/// probability of at most N pⁿ.
pub(super) fn longest_by_chance(equal: usize, count: usize) -> Option<usize> {
    let share = equal as f64 / count.max(1) as f64;
    let longest = libm::log(count as f64 / CHANCE) / -libm::log(share);
    (equal > 0 && longest.is_finite()).then(|| (longest.ceil() as usize).max(LEAST))
}

/// Runs of equal readings that are too long for chance. Readings that are missing or left out do not interrupt a run. A run that ends with a step of the quantisation
/// is the peak of a quantised signal.
fn stuck(values: &[f64]) -> Vec<std::ops::Range<usize>> {
    let known: Vec<usize> = (0..values.len()).filter(|row| values[*row].is_finite()).collect();
    let is_equal = |row: &usize, next: &usize| values[*row] == values[*next];
    let equal = known.windows(2).filter(|pair| is_equal(&pair[0], &pair[1])).count();
    let Some(least) = longest_by_chance(equal, known.len()) else { return Vec::new() };
    let steps = known.windows(2).map(|pair| (values[pair[1]] - values[pair[0]]).abs());
    let quantum = steps.filter(|step| *step > 0.0).fold(f64::INFINITY, f64::min);
    let runs: Vec<&[usize]> = known.chunk_by(is_equal).collect();
    let is_stuck = |at: &usize| {
        let step = |next: &[usize]| (values[next[0]] - values[runs[*at][0]]).abs();
        runs[*at].len() > least && runs.get(at + 1).is_none_or(|next| step(next) > SAME_STEP * quantum)
    };
    (0..runs.len()).filter(is_stuck).map(|at| runs[at][0]..runs[at][runs[at].len() - 1] + 1).collect()
}

/// Rows over which the noise of a sensor is assumed to be constant.
const BLOCK: usize = 500;

/// Unlike positions, currents may jump for a sample, and controllers often do this: an outlier exceeds the 99 % quantile by this factor.
const RARE: f64 = 3.0;
/// Rows left out before and after an outlier of a current, which may be a real jump: a gap this long is not filled from its neighbours.
const BESIDE_OUTLIER: usize = 2;

/// Single readings far from the cubic through their four neighbours, which agree with each other. The limit is √(2 ln(N/CHANCE)) standard
/// deviations, exceeded by normal noise in any row with a probability of [`CHANCE`]; the standard deviation is 1.4826 times the median
/// distance nearby (Huber, *Robust Statistics*, section 5.1). The limit is at least `rare` times the 99 % quantile of all distances.
fn outliers(values: &[f64], rare: f64) -> Vec<usize> {
    let off = |row: usize| match values.get(row.wrapping_sub(2)..=row + 2) {
        Some([a, b, of, c, d]) => of - (4.0 * (b + c) - (a + d)) / 6.0,
        _ => f64::NAN,
    };
    let sizes = |rows: std::ops::Range<usize>| -> Vec<f64> {
        rows.map(|row| off(row).abs()).filter(|off| off.is_finite()).collect()
    };
    let limit = 1.4826 * (2.0 * libm::log(values.len() as f64 / CHANCE)).sqrt();
    let end = values.len().saturating_sub(2);
    let all = sizes(2..end.max(2));
    if all.is_empty() {
        return Vec::new();
    }
    let usual = quantile(all, 0.99);
    let mut found = Vec::new();
    for from in (2..end).step_by(BLOCK) {
        let block = from..(from + BLOCK).min(end);
        let near = sizes(block.clone());
        if near.is_empty() {
            continue;
        }
        let median = median(near);
        let is_outlier = |row: &usize| {
            let size = off(*row).abs();
            // An outlier puts its neighbours off by −2/3 of it; a step or another jump does not.
            let is_single = [row - 1, row + 1].iter().all(|beside| {
                let other = (off(*beside) + off(*row) / 1.5).abs();
                other.is_nan() || other < 0.3 * size
            });
            median > 0.0 && size > (limit * median).max(rare * usual) && is_single
        };
        found.extend(block.filter(is_outlier));
    }
    if found.len() as f64 > MOST * values.len() as f64 { Vec::new() } else { found }
}
