//! Samples that are missing, and samples that are wanted between those there are.

use super::{Currents, FILLED};

/// The usual distance of instants that rise.
pub(super) fn median(time: &[f64]) -> f64 {
    let mut steps: Vec<f64> = time.windows(2).map(|pair| pair[1] - pair[0]).collect();
    steps.sort_by(f64::total_cmp);
    steps.get(steps.len() / 2).copied().unwrap_or(f64::NAN)
}

/// The currents that samples at rising instants are to have, from samples at other instants: the root of the mean of the square
/// over the interval that the sample stands for, or the value on the straight line. NaN in gaps.
pub(super) fn resampled(
    time: &[f64],
    column: &[f64],
    instants: impl Iterator<Item = f64>,
    step_s: f64,
    how: Currents,
) -> Vec<f64> {
    if how == Currents::Linear {
        return interpolate(time, column, instants, step_s);
    }
    // Instants come from decimal fractions.
    let rounding = 1e-6 * step_s;
    let reach = reach(time, step_s);
    let mean_square = |instant_s: f64| {
        let (mut at, end) = match how {
            Currents::After => (instant_s, instant_s + step_s),
            Currents::Before | Currents::Linear => (instant_s - step_s, instant_s),
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
    };
    instants.map(mean_square).collect()
}

/// How far from an instant its neighbours may be.
fn reach(time: &[f64], step_s: f64) -> f64 {
    (FILLED as f64 + 1.0) * median(time).max(step_s)
}

/// Straight lines between the known neighbours of instants, NaN in gaps.
pub(super) fn interpolate(time: &[f64], column: &[f64], instants: impl Iterator<Item = f64>, step_s: f64) -> Vec<f64> {
    let known: Vec<usize> = (0..time.len()).filter(|row| column[*row].is_finite()).collect();
    let reach = reach(time, step_s);
    let rounding = 1e-6 * step_s;
    let at = |instant_s: f64| {
        let after = known.partition_point(|row| time[*row] < instant_s - rounding);
        let next = *known.get(after)?;
        if (time[next] - instant_s).abs() <= rounding {
            return Some(column[next]);
        }
        let former = known[after.checked_sub(1)?];
        let near = time[next] - instant_s <= reach && instant_s - time[former] <= reach;
        let share = (instant_s - time[former]) / (time[next] - time[former]);
        near.then(|| column[former] + share * (column[next] - column[former]))
    };
    instants.map(|instant_s| at(instant_s).unwrap_or(f64::NAN)).collect()
}

/// Short gaps filled by the cubic through two neighbours on both sides; how many samples were filled.
pub(super) fn fill_position(values: Vec<f64>) -> (Vec<f64>, usize) {
    if values.iter().all(|value| value.is_finite()) {
        return (values, 0);
    }
    let mut filled = values.clone();
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

/// Currents with a value at every sample where the neighbours tell it.
pub(super) fn fill_current(values: &[f64], how: Currents) -> Vec<f64> {
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
pub(super) fn fill_straight(values: &mut [f64]) {
    let known: Vec<usize> = (0..values.len()).filter(|j| values[*j].is_finite()).collect();
    for pair in known.windows(2) {
        let (former, next) = (values[pair[0]], values[pair[1]]);
        for (j, place) in values.iter_mut().enumerate().take(pair[1]).skip(pair[0] + 1) {
            *place = former + (next - former) * (j - pair[0]) as f64 / (pair[1] - pair[0]) as f64;
        }
    }
}
