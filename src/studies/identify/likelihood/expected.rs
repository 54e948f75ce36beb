//! Motion and pull as they are to be expected: what repeats with the angle of the shaft, and what past innovations explain.

use nalgebra::DMatrix;

use super::data::On;

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
pub(super) fn expected(on: On<'_>, innovations: &[f64]) -> Vec<f32> {
    let case = on.case;
    let (n, magnets) = (case.position.len(), case.current.len());
    let count_of = magnets + 2 * n;
    let all = case.at.len();
    let all_rows = || case.segments.iter().flat_map(|segment| segment.clone().skip(1).map(|row| (row, segment.start)));
    let rows = || all_rows().filter(|(row, _)| !case.is_restored(*row));
    let signals = |row: usize, to: &mut [f64]| {
        let [gaps, squares] = (on.rotor.passes.driven)(on, row);
        (0..magnets).for_each(|k| to[k] = squares[k] / (gaps[k] * gaps[k]));
        to[magnets..].copy_from_slice(&case.track.state[2 * n * row..2 * n * (row + 1)]);
    };
    let angle: f64 = rows().map(|(row, _)| (case.recording.omega_rad_s[row] * case.recording.step_s).abs()).sum();
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
        let terms = terms(case.middle[row]);
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
        let (terms, series) = (terms(case.middle[row]), &series[row / length]);
        for (k, to) in to.iter_mut().enumerate() {
            *to = (0..TERMS).map(|i| terms[i] * series[(i, k)]).sum();
        }
    };

    // Innovations are white: the coefficient of each is that of it alone. The answers of the signals to those of the past, the next one first, behind the sums of their
    // squares.
    let past = |row: usize, first: usize| {
        (1..=PAST).take_while(move |lag| first + lag <= row).flat_map(move |lag| &innovations[n * (row - lag)..][..n])
    };
    let size = 1 + count_of;
    let mut total = vec![0.0; PAST * n * size];
    let mut answers = vec![total.clone(); count];
    let mut rest = vec![0.0; count_of];
    for (row, first) in rows() {
        signals(row, &mut own);
        repeating(row, &mut rest);
        rest.iter_mut().zip(&own).for_each(|(rest, own)| *rest = own - *rest);
        for (of, w) in answers[row / length].chunks_exact_mut(size).zip(past(row, first)) {
            of[0] += w * w;
            of[1..].iter_mut().zip(&rest).for_each(|(of, rest)| *of += w * rest);
        }
    }
    answers.iter().flat_map(|answer| answer.iter().enumerate()).for_each(|(at, of)| total[at] += of);
    for answer in &mut answers {
        for (of, all) in answer.chunks_exact_mut(size).zip(total.chunks_exact(size)) {
            let squares = (all[0] - of[0]).max(1.0);
            of[1..].iter_mut().zip(&all[1..]).for_each(|(of, all)| *of = (all - *of) / squares);
        }
    }
    let mut values = vec![0.0; count_of * all];
    for (row, first) in all_rows() {
        repeating(row, &mut own);
        for (of, w) in answers[row / length].chunks_exact(size).zip(past(row, first)) {
            own.iter_mut().zip(&of[1..]).for_each(|(signal, of)| *signal += w * of);
        }
        values[count_of * row..][..count_of].iter_mut().zip(&own).for_each(|(to, of)| *to = *of as f32);
    }
    values
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
