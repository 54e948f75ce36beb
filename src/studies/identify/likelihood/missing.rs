//! Currents that were not recorded: their errors, and what the controller made of the noise of the positions in them.
//!
//! A controller answers the noise of the positions with jumps of its currents. The cubic through the neighbours of a current that is missing knows nothing of
//! them, and its error belongs to innovations that are past: with 10 % of the rows missing, λ at the true parameters was off by −1.4 deviations on average, and
//! its rms error was 2.0 deviations (80 seeds of `scripts/faults.py` from 9001, those known to 0.5 % or worse). With the answer to the last eight innovations added, both are
//! what they are without gaps: 0.2 and 1.2.

use std::ops::Range;

use nalgebra::{SMatrix, SVector};

use super::data::Data;
use super::{Missing, Origin, Recording};

/// Innovations that are looked back at; with 16, the result is the same.
const PAST: usize = 8;
const TERMS: usize = 2 * PAST;
/// Fewest currents for each term.
const FEWEST: usize = 10;
/// Error of a current that is not known, relative to its rms: so large that the interval tells nothing of the magnet.
const NOTHING: f64 = 10.0;

/// Errors of the cubic through the two neighbours on both sides, at currents that were recorded as they were.
pub(super) struct Cubic<'a> {
    recording: &'a Recording<'a>,
    rows: Vec<usize>,
}

impl<'a> Cubic<'a> {
    pub fn of(recording: &'a Recording<'a>) -> Self {
        let is_known = |row: usize| {
            recording.missing[row] == Missing::default() && recording.usable.get(row).copied().unwrap_or(true)
        };
        let count = recording.current_a.len();
        let all_known = |row: &usize| (row - 2..row + 3).all(is_known);
        let rows = if recording.missing.is_empty() { 2..2 } else { 2..count.saturating_sub(2).max(2) };
        Self { recording, rows: rows.filter(all_known).collect() }
    }

    fn error_a(&self, row: usize) -> [f64; 3] {
        let i = &self.recording.current_a[row - 2..row + 3];
        std::array::from_fn(|k| i[2][k] - (4.0 * (i[1][k] + i[3][k]) - i[0][k] - i[4][k]) / 6.0)
    }

    /// rms error, A.
    pub fn rms_a(&self) -> [f64; 3] {
        let mut sum = [0.0; 3];
        for row in &self.rows {
            self.error_a(*row).iter().zip(&mut sum).for_each(|(error, sum)| *sum += error * error);
        }
        sum.map(|sum| (sum / self.rows.len().max(1) as f64).sqrt())
    }
}

/// Error of a current that is not known, A.
pub(super) fn unknown_a(recording: &Recording<'_>) -> [f64; 3] {
    std::array::from_fn(|k| {
        let known = || recording.current_a.iter().map(|current| current[k]).filter(|i| i.is_finite());
        NOTHING * (known().map(|i| i * i).sum::<f64>() / known().count().max(1) as f64).sqrt()
    })
}

/// Adds to currents that were filled what past innovations, whitened, say of the error of the cubic.
pub(super) fn refill(data: &mut Data, recording: &Recording<'_>, segments: &[Range<usize>], innovations: &[[f64; 2]]) {
    let cubic = Cubic::of(recording);
    if cubic.rows.len() < FEWEST * TERMS {
        return;
    }
    let mut has_past = vec![false; innovations.len()];
    segments.iter().for_each(|segment| {
        let from = (segment.start + PAST).min(segment.end);
        has_past[from..segment.end].fill(true);
    });
    let past = |row: usize| SVector::<f64, TERMS>::from_fn(|at, _| innovations[row - 1 - at / 2][at % 2]);
    let rows = || cubic.rows.iter().filter(|row| has_past[**row]);
    let (mut gram, mut right) = (SMatrix::<f64, TERMS, TERMS>::zeros(), SMatrix::<f64, TERMS, 3>::zeros());
    for row in rows() {
        let (past, error_a) = (past(*row), SVector::from(cubic.error_a(*row)));
        gram += past * past.transpose();
        right += past * error_a.transpose();
    }
    let Some(cholesky) = gram.cholesky() else { return };
    let answer = cholesky.solve(&right).transpose();
    let mut sum = [0.0; 3];
    for row in rows() {
        let rest = SVector::from(cubic.error_a(*row)) - answer * past(*row);
        rest.iter().zip(&mut sum).for_each(|(rest, sum)| *sum += rest * rest);
    }
    let freedom = rows().count() - TERMS;
    data.filled_a = sum.map(|sum| (sum / freedom as f64).sqrt());
    let current = data.current.to_mut();
    for (row, missing) in recording.missing.iter().enumerate().filter(|(row, _)| has_past[*row]) {
        let more = answer * past(row);
        for k in (0..3).filter(|k| missing.current[*k] == Origin::Filled) {
            current[row][k] = recording.current_a[row][k] + more[k];
        }
    }
}
