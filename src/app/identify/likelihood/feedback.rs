//! What position noise, fed back by the controller, does to the regressors, and how it is taken out of them.
//!
//! The controller answers the noise v of the position sensors: currents, and the motion that follows, hold a part `L v` with a strictly causal
//! L. The score `Σ φᵀ S⁻¹ e` weighs past and future, so this part of φ and v in e correlate, and λ̂ is biased (by three standard deviations after
//! 1 s with 0.1 µm and 50 mA). The smoother knows `v̂ = σ_z² Σ⁻¹ e` with `E v v̂ᵀ = E v̂ v̂ᵀ`; hence
//!
//! - regression of the magnets' forces on past v̂ gives L without attenuation, and
//! - regressors without `L v̂` leave a score whose expectation at the truth is 0.
//!
//! The forces mostly follow the wanted motion: harmonics of the shaft angle and a parabola, over two revolutions at a time, are estimated along
//! with L. It is constant for the resultant force alone, each axis on its own, and until the controller changes, so that it is estimated anew for
//! every epoch; how the magnets share the resultant depends on which of them carries the smallest force.

use std::f64::consts::TAU;
use std::ops::Range;

use nalgebra::DMatrix;

use super::equations::{Bearing, State};
use super::filter::{Data, Track};

/// Harmonics of the shaft angle in the wanted motion.
const HARMONICS: usize = 8;
/// Unknowns of the wanted motion over one stretch: a parabola and the harmonics.
const WANTED: usize = 3 + 2 * HARMONICS;
/// Lags from 1 on with a coefficient each; later ones share one, over ranges that grow by a third.
const SINGLE: usize = 4;
/// The controller has forgotten after this time, s: ten time constants at 1000 rad/s.
const MEMORY_S: f64 = 0.01;
/// Rows of a stretch at least: ten for each of its unknowns.
const STRETCH: usize = 10 * WANTED;
/// Rows of an epoch, about.
const EPOCH: usize = 10_000;
/// Rows per coefficient below which nothing is taken out: the bias is small there beside what noise does.
const ROWS_PER_COEFFICIENT: usize = 120;
/// Rows from which sharing is learnt for each smallest magnet on its own.
const CLASS_ROWS: usize = 300;

/// Ranges of lags, ends included.
fn groups(most: usize) -> Vec<(usize, usize)> {
    let mut groups: Vec<(usize, usize)> = (1..=SINGLE.min(most)).map(|lag| (lag, lag)).collect();
    let mut from = SINGLE + 1;
    while from <= most {
        let to = (from + from / 3).min(most);
        groups.push((from, to));
        from = to + 1;
    }
    groups
}

/// Solves least squares from its normal equations; `None` if they are singular.
fn solve(a: &DMatrix<f64>, b: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let n = a.nrows();
    // The shaft may stand still: its harmonics are constants then.
    let scale: Vec<f64> = (0..n).map(|i| 1.0 / a[(i, i)].max(f64::MIN_POSITIVE).sqrt()).collect();
    let scaled = DMatrix::from_fn(n, n, |i, l| a[(i, l)] * scale[i] * scale[l] + if i == l { 1e-9 } else { 0.0 });
    let right = DMatrix::from_fn(n, b.ncols(), |i, l| b[(i, l)] * scale[i]);
    let x = scaled.cholesky()?.solve(&right);
    Some(DMatrix::from_fn(n, b.ncols(), |i, l| x[(i, l)] * scale[i])).filter(|x| x.iter().all(|x| x.is_finite()))
}

fn middle(track: &Track, row: usize) -> State {
    let (from, to) = (&track.state[row - 1], &track.state[row]);
    std::array::from_fn(|i| 0.5 * (from[i] + to[i]))
}

/// What is regressed on what, for the rows of one segment.
struct Signals {
    /// Forces of the magnets, N, at the rows from the second on; the first is 0.
    pulls: Vec<[f64; 3]>,
    /// Sums of the smoothed position noise before each row.
    sums: Vec<[f64; 2]>,
}

impl Signals {
    fn new(data: &Data, bearing: &Bearing, track: &Track, segment: &Range<usize>) -> Self {
        let mut signals = Self { pulls: Vec::with_capacity(segment.len()), sums: vec![[0.0; 2]] };
        let mut sum = [0.0; 2];
        for row in segment.clone() {
            signals.pulls.push(if row == segment.start {
                [0.0; 3]
            } else {
                let squares = data.square(bearing, row);
                let squares = std::array::from_fn(|k| squares[k] + track.smoothed[row][k]);
                bearing.forces_by_current(&middle(track, row), squares)
            });
            let (read, _) = bearing.reading(&track.state[row], [0.0; 2], data.shaft(row));
            for a in 0..2 {
                sum[a] += data.position[row][a] - read[a];
            }
            signals.sums.push(sum);
        }
        signals
    }

    /// Sum of the position noise over a range of lags before `row`.
    fn lagged(&self, (from, to): (usize, usize), row: usize) -> [f64; 2] {
        // Rows row − to ..= row − from.
        let (low, high) = (row.saturating_sub(to), (row + 1).saturating_sub(from));
        std::array::from_fn(|a| self.sums[high][a] - self.sums[low][a])
    }

    fn answer(&self, response: &[Vec<f64>; 2], groups: &[(usize, usize)], row: usize) -> [f64; 2] {
        let mut answer = [0.0; 2];
        for (at, group) in groups.iter().enumerate() {
            let v = self.lagged(*group, row);
            for a in 0..2 {
                answer[a] += response[a][at] * v[a];
            }
        }
        answer
    }
}

/// Second difference over the rows before and after.
fn bend<const N: usize>(values: [[f64; N]; 3]) -> [f64; N] {
    std::array::from_fn(|i| values[0][i] - 2.0 * values[1][i] + values[2][i])
}

/// Writes the answer to position noise, as squared currents, to `track`.
pub(super) fn find(data: &Data, bearing: &Bearing, track: &mut Track, segments: &[Range<usize>]) {
    track.answer.fill([0.0; 3]);
    for segment in segments {
        let signals = Signals::new(data, bearing, track, segment);
        let epochs = (segment.len() / EPOCH).max(1);
        let length = segment.len().div_ceil(epochs);
        for epoch in 0..epochs {
            let rows = epoch * length..((epoch + 1) * length).min(segment.len());
            find_in(data, bearing, track, segment.start, &signals, &rows);
        }
    }
}

/// The same for the rows `rows` of the segment that begins at `start`.
fn find_in(
    data: &Data,
    bearing: &Bearing,
    track: &mut Track,
    start: usize,
    signals: &Signals,
    rows: &Range<usize>,
) {
    let most = (MEMORY_S / data.h).ceil() as usize;
    let groups = groups(most);
    // Of the first rows of a segment not all that was before is known.
    let from = rows.start.max(most + 2);
    if rows.end < from + ROWS_PER_COEFFICIENT * groups.len() {
        return;
    }
    let Some(response) = response(data, bearing, start, signals, from..rows.end, &groups) else { return };
    let smallest = |pulls: &[f64; 3]| (0..3).fold(0, |least, k| if pulls[k] < pulls[least] { k } else { least });
    let Some(sharing) = sharing(signals, &response, from..rows.end, &groups, smallest) else { return };
    for row in rows.start.max(1)..rows.end {
        let fed_back = signals.answer(&response, &groups, row);
        let share = &sharing[smallest(&signals.pulls[row])];
        let by: [f64; 3] = std::array::from_fn(|k| share[(0, k)] * fed_back[0] + share[(1, k)] * fed_back[1]);
        let change = bearing.squares_of(&middle(track, start + row), by);
        track.answer[start + row] = change;
    }
}

/// Coefficients of the resultant force, y and z, by group of lags.
fn response(
    data: &Data,
    bearing: &Bearing,
    start: usize,
    signals: &Signals,
    rows: Range<usize>,
    groups: &[(usize, usize)],
) -> Option<[Vec<f64>; 2]> {
    let n = groups.len();
    let turn = TAU / (data.omega[start + rows.start].abs() * data.h);
    let stretch = if turn.is_finite() { (2.0 * turn) as usize } else { 0 };
    let stretch = stretch.clamp(STRETCH, EPOCH / 2).min(rows.len());
    let stretches = rows.len() / stretch;
    let width = WANTED + 2 * n + 2;
    let mut gram = [DMatrix::zeros(n, n), DMatrix::zeros(n, n)];
    let mut right = [DMatrix::zeros(n, 1), DMatrix::zeros(n, 1)];
    let mut line = vec![0.0; width];
    for part in 0..stretches {
        let from = rows.start + part * rows.len() / stretches;
        let to = rows.start + (part + 1) * rows.len() / stretches;
        let mut sums = DMatrix::zeros(width, width);
        for row in from..to {
            let t = 2.0 * (row - from) as f64 / (to - from) as f64 - 1.0;
            line[0] = 1.0;
            line[1] = t;
            line[2] = t * t;
            let [c, s] = data.middle[start + row];
            let mut angle = [c, s];
            for h in 0..HARMONICS {
                line[3 + 2 * h] = angle[0];
                line[4 + 2 * h] = angle[1];
                angle = [angle[0] * c - angle[1] * s, angle[1] * c + angle[0] * s];
            }
            for (at, group) in groups.iter().enumerate() {
                let v = signals.lagged(*group, row);
                line[WANTED + at] = v[0];
                line[WANTED + n + at] = v[1];
            }
            let force = bearing.resultant(signals.pulls[row]);
            line[width - 2] = force[0];
            line[width - 1] = force[1];
            for i in 0..width {
                let factor = line[i];
                let column = &mut sums.column_mut(i);
                for l in i..width {
                    column[l] += factor * line[l];
                }
            }
        }
        // Without the wanted motion: Schur complement of its block.
        let wanted = sums.view((0, 0), (WANTED, WANTED)).into_owned();
        let wanted = DMatrix::from_fn(WANTED, WANTED, |i, l| wanted[(i.max(l), i.min(l))]);
        let cross = sums.view((WANTED, 0), (width - WANTED, WANTED)).transpose();
        let fitted = solve(&wanted, &cross)?;
        let without = |i: usize, l: usize| {
            let (i, l) = (i.max(l), i.min(l));
            sums[(WANTED + i, WANTED + l)] - cross.column(i).dot(&fitted.column(l))
        };
        for a in 0..2 {
            for i in 0..n {
                for l in 0..n {
                    gram[a][(i, l)] += without(a * n + i, a * n + l);
                }
                right[a][(i, 0)] += without(2 * n + a, a * n + i);
            }
        }
    }
    let of = |a: usize| solve(&gram[a], &right[a]).map(|x| x.iter().copied().collect::<Vec<f64>>());
    Some([of(0)?, of(1)?])
}

/// How the magnets share a change of the resultant, by the magnet with the smallest force: two rows, a column for each magnet.
fn sharing(
    signals: &Signals,
    response: &[Vec<f64>; 2],
    rows: Range<usize>,
    groups: &[(usize, usize)],
    smallest: impl Fn(&[f64; 3]) -> usize,
) -> Option<Vec<DMatrix<f64>>> {
    let mut sums: Vec<(DMatrix<f64>, DMatrix<f64>, usize)> =
        (0..4).map(|_| (DMatrix::zeros(2, 2), DMatrix::zeros(2, 3), 0)).collect();
    let answers: Vec<[f64; 2]> = rows.clone().map(|row| signals.answer(response, groups, row)).collect();
    for row in rows.start + 1..rows.end - 1 {
        let at = row - rows.start;
        // Second differences: the wanted forces bend little.
        let x = bend([answers[at - 1], answers[at], answers[at + 1]]);
        let y = bend([signals.pulls[row - 1], signals.pulls[row], signals.pulls[row + 1]]);
        let class = smallest(&signals.pulls[row]);
        for (a, b, count) in sums.iter_mut().enumerate().filter(|(c, _)| *c == class || *c == 3).map(|(_, sum)| sum) {
            for i in 0..2 {
                for l in 0..2 {
                    a[(i, l)] += x[i] * x[l];
                }
                for k in 0..3 {
                    b[(i, k)] += x[i] * y[k];
                }
            }
            *count += 1;
        }
    }
    let all = &sums[3];
    sums[..3]
        .iter()
        .map(|class| if class.2 >= CLASS_ROWS { class } else { all })
        .map(|(a, b, _)| solve(a, b))
        .collect()
}
