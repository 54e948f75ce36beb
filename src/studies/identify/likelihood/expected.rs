//! Motion and pull as they are to be expected: what repeats with the angle of the shaft, and what past innovations explain.

use std::ops::Range;

use nalgebra::DMatrix;

use super::data::{Data, Track};
use super::rotor::{Rotor, State, regressors};

/// Signals of a row as they are to be expected; in single precision, for there are many rows.
pub(super) type Expected<const N: usize, const K: usize> = Signals<N, K, f32>;

/// `i_k²/gap_k²` in A²/m² over the interval that ends at a row, then coordinates and rates at the row.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Signals<const N: usize, const K: usize, T = f64> {
    pub pulls: [T; K],
    pub state: [[T; N]; 2],
}

impl<const N: usize, const K: usize> Expected<N, K> {
    pub fn state(&self) -> State<N> {
        self.state.map(|of| of.map(f64::from))
    }
}

impl<const N: usize, const K: usize> Signals<N, K> {
    /// Their number.
    const COUNT: usize = K + 2 * N;

    fn of_each(mut of: impl FnMut(usize) -> f64) -> Self {
        let pulls = std::array::from_fn(&mut of);
        Self { pulls, state: std::array::from_fn(|d| std::array::from_fn(|n| of(K + N * d + n))) }
    }

    fn iter(&self) -> impl Iterator<Item = &f64> {
        self.pulls.iter().chain(self.state.as_flattened())
    }

    fn iter_mut(&mut self) -> impl Iterator<Item = &mut f64> {
        self.pulls.iter_mut().chain(self.state.as_flattened_mut())
    }
}

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
/// Answer of the signals to past innovations, by lag and axis.
type Answer<const N: usize, const K: usize> = [[Signals<N, K>; N]; PAST];

fn terms([cos, sin]: [f64; 2]) -> Terms {
    let mut terms = [1.0; TERMS];
    let (mut c, mut s) = (1.0, 0.0);
    for pair in terms[1..].chunks_exact_mut(2) {
        (c, s) = (c * cos - s * sin, s * cos + c * sin);
        pair.copy_from_slice(&[c, s]);
    }
    terms
}

/// Expected values of the rows of a recording; empty where too few turns tell.
///
/// Fourier series over the shaft angle, one for each stretch of rows, fitted to the stretches before and after it. The rest is what the controller and the
/// rotor make of noise: it is regressed on past whitened innovations over all other stretches. Innovations are white, so that neither is correlated with
/// those that follow.
pub(super) fn expected<const N: usize, const K: usize>(
    data: &Data<N, K>,
    rotor: &Rotor<N, K>,
    track: &Track<N, K>,
    segments: &[Range<usize>],
    innovations: &[[f64; N]],
) -> Vec<Expected<N, K>> {
    let count_of = Signals::<N, K>::COUNT;
    let all = data.at.len();
    let all_rows = || segments.iter().flat_map(|segment| segment.clone().skip(1).map(|row| (row, segment.start)));
    let rows = || all_rows().filter(|(row, _)| !data.is_unknown(*row));
    let signals = |row: usize| -> Signals<N, K> {
        let state = track.state[row];
        Signals { pulls: regressors(rotor.gaps(&state[0]), data.squares(rotor, row).middle), state }
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
    for (row, _) in rows() {
        let (gram, right) = &mut sums[row / length];
        let (terms, signals) = (terms(data.middle[row]), signals(row));
        for i in 0..TERMS {
            for l in 0..=i {
                gram[(i, l)] += terms[i] * terms[l];
            }
            for (k, signal) in signals.iter().enumerate() {
                right[(i, k)] += terms[i] * signal;
            }
        }
    }
    let series: Vec<DMatrix<f64>> = (0..count).map(|at| beside(&sums, at)).collect();
    let repeating = |row: usize| {
        let (terms, series) = (terms(data.middle[row]), &series[row / length]);
        Signals::<N, K>::of_each(|k| (0..TERMS).map(|i| terms[i] * series[(i, k)]).sum())
    };

    // Innovations are white and of variance 1: correlations are coefficients.
    let past = |row: usize, first: usize| (first..row).rev().take(PAST).map(|before| innovations[before]);
    let nothing = || (0.0, [[Signals::of_each(|_| 0.0); N]; PAST]);
    let mut own: Vec<(f64, Answer<N, K>)> = (0..count).map(|_| nothing()).collect();
    for (row, first) in rows() {
        let (signals, repeating) = (signals(row), repeating(row));
        let (number, answer) = &mut own[row / length];
        *number += 1.0;
        for (of, w) in answer.iter_mut().zip(past(row, first)) {
            for (of, w) in of.iter_mut().zip(w) {
                let rest = signals.iter().zip(repeating.iter()).map(|(signal, repeating)| signal - repeating);
                of.iter_mut().zip(rest).for_each(|(of, rest)| *of += w * rest);
            }
        }
    }
    let mut total: (f64, Answer<N, K>) = nothing();
    for (number, answer) in &own {
        total.0 += number;
        for (sums, own) in total.1.as_flattened_mut().iter_mut().zip(answer.as_flattened()) {
            sums.iter_mut().zip(own.iter()).for_each(|(sum, own)| *sum += own);
        }
    }
    let mut expected = vec![Expected { pulls: [0.0; K], state: [[0.0; N]; 2] }; all];
    for (row, first) in all_rows() {
        let (number, answer) = &own[row / length];
        let per_row = 1.0 / (total.0 - number).max(1.0);
        let mut signals = repeating(row);
        for ((own, all), w) in answer.iter().zip(&total.1).zip(past(row, first)) {
            for a in 0..N {
                let others = all[a].iter().zip(own[a].iter()).map(|(all, own)| all - own);
                signals.iter_mut().zip(others).for_each(|(signal, others)| *signal += w[a] * per_row * others);
            }
        }
        let single = |of: f64| of as f32;
        expected[row] = Expected { pulls: signals.pulls.map(single), state: signals.state.map(|of| of.map(single)) };
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
