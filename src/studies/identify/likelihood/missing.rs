//! Currents that were not recorded: their errors, and what the controller made of the noise of the positions in them.
//!
//! A controller answers the noise of the positions with jumps of its currents. The cubic through the neighbours of a current that is missing knows nothing of
//! them, and its error belongs to innovations that are past: with 10 % of the rows missing, λ at the true parameters was off by −1.4 deviations on average, and
//! its rms error was 2.0 deviations (80 seeds of `scripts/faults.py` from 9001, those known to 0.5 % or worse). With the answer to the last eight innovations added, both are
//! what they are without gaps: 0.2 and 1.2. With noise of 0.5 µm, λ remains off by several per cent. Where the bench is exactly as stated, such a current is therefore
//! predicted from what is past alone ([`expected`](super::expected)), and instruments find λ.

use nalgebra::{DMatrix, DVector};

use super::case::Case;
use super::{Missing, Origin, Recording};
use crate::studies::identify::rms;

/// Innovations that are looked back at; with 16, the result is the same.
const PAST: usize = 8;
/// Fewest currents for each term.
const FEWEST: usize = 10;
/// Error of a current that is not known, relative to its rms: so large that the interval tells nothing of the magnet.
const NOTHING: f64 = 10.0;

/// Errors of the cubic through the two neighbours on both sides, at currents that were recorded as they were.
pub(super) struct Cubic<'a> {
    current_a: &'a [&'a [f64]],
    rows: Vec<usize>,
}

impl<'a> Cubic<'a> {
    pub fn of(recording: &Recording, current_a: &'a [&'a [f64]]) -> Self {
        let is_known = |row: usize| {
            recording.missing[row] == Missing::default() && recording.usable.get(row).copied().unwrap_or(true)
        };
        let count = recording.rows();
        let all_known = |row: &usize| (row - 2..row + 3).all(is_known);
        let rows = if recording.missing.is_empty() { 2..2 } else { 2..count.saturating_sub(2).max(2) };
        Self { current_a, rows: rows.filter(all_known).collect() }
    }

    fn error_a(&self, row: usize) -> DVector<f64> {
        DVector::from_fn(self.current_a.len(), |k, _| {
            let i = &self.current_a[k][row - 2..row + 3];
            i[2] - (4.0 * (i[1] + i[3]) - i[0] - i[4]) / 6.0
        })
    }

    /// rms error, A.
    pub fn rms_a(&self) -> Vec<f64> {
        let mut sum = vec![0.0; self.current_a.len()];
        for row in &self.rows {
            self.error_a(*row).iter().zip(&mut sum).for_each(|(error, sum)| *sum += error * error);
        }
        sum.into_iter().map(|sum: f64| (sum / self.rows.len().max(1) as f64).sqrt()).collect()
    }
}

/// Error of a current that is not known, A.
pub(super) fn unknown_a(current_a: &[&[f64]]) -> Vec<f64> {
    current_a.iter().map(|of| NOTHING * rms(of.iter().copied().filter(|i| i.is_finite()))).collect()
}

/// Adds to currents that were filled what past innovations, whitened, say of the error of the cubic.
pub(super) fn refill(case: &mut Case<'_>, innovations: &[f64]) {
    let (recording, current_a, n, k) = (case.recording, &case.current, case.position.len(), case.current.len());
    let (cubic, terms) = (Cubic::of(recording, current_a), n * PAST);
    if cubic.rows.len() < FEWEST * terms {
        return;
    }
    let mut has_past = vec![false; recording.rows()];
    case.segments.iter().for_each(|segment| {
        let from = (segment.start + PAST).min(segment.end);
        has_past[from..segment.end].fill(true);
    });
    let past = |row: usize| DVector::from_fn(terms, |at, _| innovations[n * (row - 1 - at / n) + at % n]);
    let rows = || cubic.rows.iter().filter(|row| has_past[**row]);
    let (mut gram, mut right) = (DMatrix::zeros(terms, terms), DMatrix::zeros(terms, k));
    for row in rows() {
        let (past, error_a) = (past(*row), cubic.error_a(*row));
        gram.ger(1.0, &past, &past, 1.0);
        right.ger(1.0, &past, &error_a, 1.0);
    }
    let Some(cholesky) = gram.cholesky() else { return };
    let answer = cholesky.solve(&right).transpose();
    let mut sum = vec![0.0; k];
    for row in rows() {
        let rest = cubic.error_a(*row) - &answer * past(*row);
        rest.iter().zip(&mut sum).for_each(|(rest, sum)| *sum += rest * rest);
    }
    let freedom = rows().count() - terms;
    case.filled_a = sum.into_iter().map(|sum: f64| (sum / freedom as f64).sqrt()).collect();
    for (row, missing) in recording.missing.iter().enumerate().filter(|(row, _)| has_past[*row]) {
        let more = &answer * past(row);
        for k in (0..k).filter(|k| missing.current[case.first + k] == Origin::Filled) {
            case.filled[k].to_mut()[row] = current_a[k][row] + more[k];
        }
    }
}
