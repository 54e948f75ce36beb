//! Motion and pull as they are to be expected: what repeats with the angle of the shaft, and what past innovations explain.

use std::ops::Range;

use nalgebra::DMatrix;

use super::data::On;
use super::filter::Passes;

/// Harmonics of the shaft angle.
const HARMONICS: usize = 12;
/// Mean, cosines, sines.
const TERMS: usize = 2 * HARMONICS + 1;
/// Turns in a stretch of rows, as the on-line estimator remembers, and the fewest stretches of a recording.
const TURNS: f64 = 8.0;
const STRETCHES: usize = 6;
/// Fewest turns in a stretch: its neighbours have all angles then.
const FEWEST: f64 = 1.0;
/// Turns of a rotor that is at rest.
const AT_REST: f64 = 0.01;
/// Harmonics that the few rows of a turn do not tell apart share their amplitude: added to the diagonal, relative to the rows.
const RIDGE: f64 = 1e-6;
/// Innovations that are looked back at. With 16 instead of 8, λ and its deviation are the same within a per cent; with 4, the deviation of a bearing that
/// noise excites is a tenth larger (seeds 63006, 92016, 92025 of drawn bearings, 24 seeds of the noise each).
const PAST: usize = 8;

type Terms = [f64; TERMS];
fn terms([cos, sin]: [f64; 2]) -> Terms {
    let mut terms = [1.0; TERMS];
    let (mut c, mut s) = (1.0, 0.0);
    for pair in terms[1..].chunks_exact_mut(2) {
        (c, s) = (c * cos - s * sin, s * cos + c * sin);
        pair.copy_from_slice(&[c, s]);
    }
    terms
}

/// Expected values of the rows of a recording, as in [`Track`](super::data::Track); empty where too few turns tell.
///
/// Fourier series over the shaft angle, one for each stretch of rows, fitted to the stretches before and after it. The rest is what the controller and the
/// rotor make of noise: it is regressed on past whitened innovations over all other stretches. Innovations are white, so that neither is correlated with
/// those that follow.
pub(super) fn expected(passes: &dyn Passes, on: On<'_>, segments: &[Range<usize>], innovations: &[f64]) -> Vec<f32> {
    let data = on.data;
    let (n, magnets) = (data.position.len(), data.current.len());
    let count_of = magnets + 2 * n;
    let all = data.at.len();
    let all_rows = || segments.iter().flat_map(|segment| segment.clone().skip(1).map(|row| (row, segment.start)));
    let rows = || all_rows().filter(|(row, _)| !data.is_unknown(*row));
    let signals = |row: usize, to: &mut [f64]| {
        let [gaps, squares] = passes.driven(on, row);
        (0..magnets).for_each(|k| to[k] = squares[k] / (gaps[k] * gaps[k]));
        to[magnets..].copy_from_slice(&on.track.state[2 * n * row..2 * n * (row + 1)]);
    };
    let angle: f64 = rows().map(|(row, _)| (data.omega[row] * data.h).abs()).sum();
    let turns = angle / std::f64::consts::TAU;
    // A rotor at rest repeats at every row; one that turns, once a turn.
    if turns > AT_REST && turns < FEWEST * STRETCHES as f64 {
        return Vec::new();
    }
    let per_turn = rows().count() as f64 / turns.max(1e-9);
    let length = ((TURNS * per_turn) as usize).min(all / STRETCHES).max(1);
    let count = all.div_ceil(length);

    let mut sums = vec![(DMatrix::<f64>::zeros(TERMS, TERMS), DMatrix::<f64>::zeros(TERMS, count_of)); count];
    let mut own = vec![0.0; count_of];
    for (row, _) in rows() {
        let (gram, right) = &mut sums[row / length];
        let terms = terms(data.middle[row]);
        signals(row, &mut own);
        for i in 0..TERMS {
            for l in 0..=i {
                gram[(i, l)] += terms[i] * terms[l];
            }
            for (k, signal) in own.iter().enumerate() {
                right[(i, k)] += terms[i] * signal;
            }
        }
    }
    let series: Vec<DMatrix<f64>> = (0..count).map(|at| beside(&sums, at)).collect();
    let repeating = |row: usize, to: &mut [f64]| {
        let (terms, series) = (terms(data.middle[row]), &series[row / length]);
        for (k, to) in to.iter_mut().enumerate() {
            *to = (0..TERMS).map(|i| terms[i] * series[(i, k)]).sum();
        }
    };

    // Innovations are white and of variance 1: correlations are coefficients. The answer of the signals to those of the past, the next one and its first axis first.
    let past = |row: usize, first: usize| {
        let before = (first..row).rev().take(PAST);
        before.flat_map(|before| innovations[n * before..n * (before + 1)].iter().copied())
    };
    let nothing = || (0.0, vec![0.0; PAST * n * count_of]);
    let mut answers: Vec<(f64, Vec<f64>)> = (0..count).map(|_| nothing()).collect();
    let mut rest = vec![0.0; count_of];
    for (row, first) in rows() {
        signals(row, &mut own);
        repeating(row, &mut rest);
        rest.iter_mut().zip(&own).for_each(|(rest, own)| *rest = own - *rest);
        let (number, answer) = &mut answers[row / length];
        *number += 1.0;
        for (of, w) in answer.chunks_exact_mut(count_of).zip(past(row, first)) {
            of.iter_mut().zip(&rest).for_each(|(of, rest)| *of += w * rest);
        }
    }
    let mut total = nothing();
    for (number, answer) in &answers {
        total.0 += number;
        total.1.iter_mut().zip(answer).for_each(|(sum, of)| *sum += of);
    }
    let mut expected = vec![0.0; count_of * all];
    for (row, first) in all_rows() {
        let (number, answer) = &answers[row / length];
        let per_row = 1.0 / (total.0 - number).max(1.0);
        repeating(row, &mut own);
        let each = answer.chunks_exact(count_of).zip(total.1.chunks_exact(count_of));
        for ((of, all), w) in each.zip(past(row, first)) {
            let others = all.iter().zip(of).map(|(all, of)| all - of);
            own.iter_mut().zip(others).for_each(|(signal, others)| *signal += w * per_row * others);
        }
        let to = &mut expected[count_of * row..count_of * (row + 1)];
        to.iter_mut().zip(&own).for_each(|(to, of)| *to = *of as f32);
    }
    expected
}

/// The series that fits the stretches before and after one.
fn beside(sums: &[(DMatrix<f64>, DMatrix<f64>)], at: usize) -> DMatrix<f64> {
    let (mut gram, mut right) = (DMatrix::zeros(TERMS, TERMS), DMatrix::zeros(TERMS, sums[at].1.ncols()));
    for (more, of) in [at.checked_sub(1), Some(at + 1)].into_iter().flatten().filter_map(|at| sums.get(at)) {
        gram += more;
        right += of;
    }
    let ridge = RIDGE * gram[(0, 0)];
    (0..TERMS).for_each(|i| gram[(i, i)] += ridge);
    match gram.cholesky() {
        Some(cholesky) => cholesky.solve(&right),
        None => right * 0.0,
    }
}
