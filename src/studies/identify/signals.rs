//! Signals at the samples: gaps, resampling, angle and speed.

use std::f64::consts::TAU;

use super::faults::longest_by_chance;
use crate::estimation::{Hold, angle_difference};
use crate::studies::statistics::{median, quantile, range};

/// Longest gap, in samples, across which the identification predicts; a longer one begins a new segment.
const FILLED: usize = 3;

/// Greatest distance, in samples, of the neighbours through which a cubic fills a gap.
const SPAN: usize = 2 * FILLED + 1;

/// Known values with their places, in samples from the first; places increase.
pub(super) type Known = Vec<(f64, f64)>;

/// The known values of a column with their places.
pub(super) fn known(place: &[f64], column: &[f64]) -> Known {
    let both = place.iter().copied().zip(column.iter().copied());
    both.filter(|(place, value)| place.is_finite() && value.is_finite()).collect()
}

/// Whether all places are whole samples.
pub(super) fn is_at_samples(known: &Known) -> bool {
    known.iter().all(|(place, _)| place.fract() == 0.0)
}

/// The values by sample; NaN for samples without one.
pub(super) fn at_samples(known: &Known, count: usize) -> Vec<f64> {
    let mut values = vec![f64::NAN; count];
    for (place, value) in known.iter().filter(|(place, _)| (0.0..count as f64).contains(place)) {
        values[*place as usize] = *value;
    }
    values
}

/// Median distance of the known values, in samples.
pub(super) fn distance(known: &Known) -> f64 {
    median(known.windows(2).map(|pair| pair[1].0 - pair[0].0))
}

/// The longest distance to a neighbour, in samples, that is not a gap.
fn longest(known: &Known) -> f64 {
    (FILLED as f64 + 1.0) * distance(known).max(1.0)
}

/// Linear interpolation at the samples; NaN in gaps unless these are bridged. Empty if nothing is known.
pub(super) fn straight(known: &Known, count: usize, bridges: bool) -> Vec<f64> {
    let count = if known.is_empty() { 0 } else { count };
    let longest = if bridges { f64::INFINITY } else { longest(known) };
    let at = |sample: usize| {
        let after = known.partition_point(|(place, _)| *place < sample as f64 - ROUNDING);
        let (next, value) = *known.get(after)?;
        if next - sample as f64 <= ROUNDING {
            return Some(value);
        }
        let (former, begin) = known[after.checked_sub(1)?];
        let near = next - sample as f64 <= longest && sample as f64 - former <= longest;
        near.then(|| begin + (value - begin) * (sample as f64 - former) / (next - former))
    };
    (0..count).map(|sample| at(sample).unwrap_or(f64::NAN)).collect()
}

/// Rounding error of places, in samples, and of angles, in rad: they come from decimal fractions.
pub(super) const ROUNDING: f64 = 1e-6;

/// The currents at the samples from currents at other instants: rms over the interval that a sample stands for, or linear interpolation.
/// NaN in gaps.
pub(super) fn resampled(known: &Known, count: usize, how: Hold) -> Vec<f64> {
    if how == Hold::Linear || known.is_empty() {
        return straight(known, count, false);
    }
    let longest = longest(known);
    let mean_square = |sample: usize| {
        let start = if how == Hold::HeldBefore { sample as f64 - 1.0 } else { sample as f64 };
        let (mut at, mut sum) = (start, 0.0);
        while at < start + 1.0 - ROUNDING {
            // The next value stands for the time before it, or the previous one for the time after it.
            let next = known.partition_point(|(place, _)| *place <= at + ROUNDING);
            let row = if how == Hold::HeldBefore { next } else { next.wrapping_sub(1) };
            let Some((_, value)) = known.get(row).filter(|(place, _)| (place - at).abs() <= longest) else {
                return f64::NAN;
            };
            let until = known.get(next).map_or(start + 1.0, |(place, _)| place.min(start + 1.0));
            // A single value is returned exactly, with its sign.
            if until - at > 1.0 - ROUNDING {
                return *value;
            }
            sum += value * value * (until - at);
            at = until;
        }
        sum.sqrt()
    };
    (0..count).map(mean_square).collect()
}

/// Fills short gaps by the cubic through two neighbours on either side.
pub(super) fn fill(values: &mut [f64]) {
    let known: Vec<usize> = (0..values.len()).filter(|at| values[*at].is_finite()).collect();
    for nodes in known.windows(4).filter(|nodes| nodes[2] - nodes[1] <= FILLED + 1 && nodes[3] - nodes[0] <= SPAN) {
        for at in nodes[1] + 1..nodes[2] {
            let from = |node: &usize| at as f64 - *node as f64;
            let basis = |one: &usize| {
                let others = nodes.iter().filter(|other| *other != one);
                others.map(|other| from(other) / (*one as f64 - *other as f64)).product::<f64>()
            };
            values[at] = nodes.iter().map(|node| values[*node] * basis(node)).sum();
        }
    }
}

/// Leaves out the readings with these numbers; returns the first and last place of each run of them.
fn leave_out(signal: &mut Known, is_wrong: &[bool]) -> Vec<[f64; 2]> {
    let rows: Vec<usize> = (0..signal.len()).filter(|row| is_wrong[*row]).collect();
    let runs = rows.chunk_by(|row, next| row + 1 == *next);
    let ends = runs.map(|run| [run[0], run[run.len() - 1]].map(|row| signal[row].0)).collect();
    let mut row = 0..;
    signal.retain(|_| !is_wrong[row.next().unwrap_or(0)]);
    ends
}

/// Leaves out equal angles of a shaft that turns before and after them; returns their first and last places. A shaft that comes to rest turns less and less:
/// in the last rows less than half as far as in as many before.
pub(super) fn leave_out_stuck(angle: &mut Known) -> Vec<[f64; 2]> {
    const LEAST_ROWS: usize = 20;
    let equal = angle.windows(2).filter(|pair| pair[0].1 == pair[1].1).count();
    let Some(longest) = longest_by_chance(equal, angle.len()) else { return Vec::new() };
    let rows = longest.max(LEAST_ROWS);
    let turned = |from: usize| {
        let piece = angle.get(from..=from + rows)?;
        Some(piece.windows(2).map(|pair| angle_difference(pair[0].1, pair[1].1)).sum::<f64>().abs())
    };
    let mut is_wrong = vec![false; angle.len()];
    let mut from = 0;
    for run in angle.chunk_by(|one, next| one.1 == next.1) {
        let to = from + run.len();
        let before = from.checked_sub(2 * rows + 1).and_then(|far| Some([turned(far)?, turned(far + rows)?]));
        let after = turned(to).and_then(|near| Some([turned(to + rows)?, near]));
        let mut sides = before.into_iter().chain(after).peekable();
        let is_stuck = run.len() > longest && sides.peek().is_some() && sides.all(|[far, near]| near > 0.5 * far);
        is_wrong[from..to].fill(is_stuck);
        from = to;
    }
    leave_out(angle, &is_wrong)
}

/// Leaves out speeds between a jump and the jump back, or that do not change after a jump: a rotor does not jump. Returns their first and last places.
pub(super) fn leave_out_dropouts(speed: &mut Known) -> Vec<[f64; 2]> {
    /// Jumps are larger than this fraction of the median speed, and than this multiple of the median step.
    const JUMP: f64 = 0.05;
    const NOISE: f64 = 20.0;
    let step = median(speed.windows(2).map(|pair| (pair[1].1 - pair[0].1).abs()));
    let limit = (JUMP * median(speed.iter().map(|(_, speed)| speed.abs()))).max(NOISE * step);
    let count = speed.len();
    let wrong_from = |is_backward: bool| {
        let (mut is_wrong, mut last) = (vec![false; count], None);
        for row in 0..count {
            let row = if is_backward { count - 1 - row } else { row };
            let value = speed[row].1;
            is_wrong[row] = (value - *last.get_or_insert(value)).abs() > limit;
            last = if is_wrong[row] { last } else { Some(value) };
        }
        is_wrong
    };
    let is_usual = |is_wrong: &Vec<bool>| 2 * is_wrong.iter().filter(|is_wrong| **is_wrong).count() <= count;
    let Some(mut is_wrong) = [false, true].into_iter().map(wrong_from).find(is_usual) else { return Vec::new() };
    // A jump for good is a change of the speed between two parts of a recording, unless the speed is constant after it.
    let at_begin = is_wrong.iter().take_while(|is_wrong| **is_wrong).count();
    let at_end = is_wrong.iter().rev().take_while(|is_wrong| **is_wrong).count();
    for run in [0..at_begin, count - at_end..count] {
        let is_constant = speed[run.clone()].windows(2).all(|pair| pair[0].1 == pair[1].1);
        is_wrong[run].fill(is_constant);
    }
    leave_out(speed, &is_wrong)
}

/// Leaves out single angles far from the middle of their neighbours, compared with the usual distance, which an encoder makes a count, and with
/// rounding; returns their places.
pub(super) fn leave_out_jumps(angle: &mut Known) -> Vec<f64> {
    let distance =
        |of: &[(f64, f64)]| angle_difference(of[0].1 + 0.5 * angle_difference(of[0].1, of[2].1), of[1].1).abs();
    let off: Vec<f64> = angle.windows(3).map(distance).collect();
    if off.is_empty() {
        return Vec::new();
    }
    let limit = (4.0 * quantile(off.clone(), 0.99)).max(ROUNDING);
    // A reading that is off by e makes its neighbours off by half of it, a step both of its sides alike.
    let is_jump = |at: &usize| {
        let beside = [at.wrapping_sub(1), at + 1].map(|beside| off.get(beside).copied().unwrap_or(0.0));
        off[*at] > limit && beside.iter().all(|beside| 1.5 * beside < off[*at])
    };
    let jumps: Vec<usize> = (0..off.len()).filter(is_jump).map(|at| at + 1).collect();
    let places = jumps.iter().map(|at| angle[*at].0).collect();
    for at in jumps.into_iter().rev() {
        angle.remove(at);
    }
    places
}

/// Unwraps an angle; in gaps the rotor keeps its speed. Returns the jump of the recorded angle when it wraps, if all jumps are against its
/// direction. An angle that never jumps by more than half its range is left as it is: unwrapping would hide a misread unit.
pub(super) fn unwrap(angle: &mut Known) -> Option<f64> {
    /// The speed is averaged over about this many samples.
    const AVERAGED: f64 = 20.0;
    let range = range(angle.iter().map(|(_, value)| *value));
    let (jumps, steps): (Vec<f64>, Vec<f64>) =
        angle.windows(2).map(|pair| pair[1].1 - pair[0].1).partition(|step| step.abs() > 0.5 * (range[1] - range[0]));
    if jumps.is_empty() {
        return None;
    }
    let mut speed = None;
    for at in 1..angle.len() {
        let ((former, before), (place, value)) = (angle[at - 1], &mut angle[at]);
        let samples = *place - former;
        let expected = before + if samples > 1.5 { speed.unwrap_or(0.0) * samples } else { 0.0 };
        *value -= ((*value - expected) / TAU).round() * TAU;
        let step = (*value - before) / samples;
        speed = Some(speed.map_or(step, |speed: f64| speed + (step - speed) / AVERAGED));
    }
    let [jump, step] = [&jumps, &steps].map(median);
    let is_against = jumps.iter().all(|one| one * jump > 0.0) && jump * step < 0.0;
    (steps.len() >= 2 * jumps.len() && is_against).then(|| (step - jump).abs())
}

/// Slope of an angle, by straight lines fitted over 41 samples.
pub(super) fn slope(angle: &[f64], step_s: f64) -> Vec<f64> {
    const WIDTH: usize = 41;
    let at = |sample: usize| {
        let from = sample.saturating_sub(WIDTH / 2).min(angle.len().saturating_sub(WIDTH));
        let piece = &angle[from..(from + WIDTH).min(angle.len())];
        let middle = (piece.len() - 1) as f64 / 2.0;
        let (up, down) = piece.iter().enumerate().fold((0.0, 0.0), |(up, down), (n, value)| {
            let x = n as f64 - middle;
            (up + x * value, down + x * x)
        });
        up / (down * step_s)
    };
    (0..angle.len()).map(at).collect()
}
