//! Motion and pull as they are to be expected: what repeats with the angle of the shaft, and what past innovations explain.

use nalgebra::DMatrix;

use super::data::On;
use super::rotor::ByMagnet;

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
/// The same where currents have to be predicted; lags at which the answer of a controller changes with so many terms of the angle: another magnet may pull least.
const LONG_PAST: usize = 40;
const NEAR: usize = 3;
const TURNING: usize = 13;
/// Rows up to which currents are predicted. Longer recordings need it less: with 3 % of 1.2 million rows missing, λ is known to 0.016 % without it, and what the answers leave
/// unexplained looked like a backward force.
const PREDICTED_ROWS: usize = 100_000;
/// Factor of a variance that leaves nothing known.
const NOTHING: f64 = 100.0;

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
/// those that follow. The same predicts squared currents that were not recorded, in A², with their standard deviations (`scripts/faults.py`, 10 % of the rows missing:
/// ± is a third of that with unknown forces; with 8 innovations instead of 40 errors were 1.35 deviations instead of 1.04, rms, and without terms of the angle 2.2).
pub(super) fn expected(on: On<'_>, innovations: &[f64]) -> (Vec<f32>, Vec<[f32; 2]>) {
    let case = on.case;
    let (n, magnets) = (case.position.len(), case.current.len());
    let count_of = magnets + 2 * n;
    let all = case.at.len();
    let all_rows = || case.segments.iter().flat_map(|segment| segment.clone().skip(1).map(|row| (row, segment.start)));
    let rows = || all_rows().filter(|(row, _)| !case.is_adrift(*row));
    let signals = |row: usize, to: &mut [f64]| {
        let [gaps, squares] = (on.rotor.passes.driven)(on, row);
        (0..magnets).for_each(|k| to[k] = squares[k] / (gaps[k] * gaps[k]));
        to[magnets..].copy_from_slice(&case.track.state[2 * n * row..2 * n * (row + 1)]);
    };
    let angle: f64 = rows().map(|(row, _)| (case.recording.omega_rad_s[row] * case.recording.step_s).abs()).sum();
    let turns = angle / std::f64::consts::TAU;
    // A rotor at rest repeats at every row; one that turns, once a turn.
    if turns > AT_REST && turns < FEWEST * STRETCHES as f64 {
        return (Vec::new(), Vec::new());
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
    let has_gaps = !case.recording.missing.is_empty() && all <= PREDICTED_ROWS;
    let terms_of = |lag: usize| {
        let turning = if has_gaps && lag <= NEAR { TURNING } else { 1 };
        (0..n).flat_map(move |axis| (0..turning).map(move |term| [lag, axis, term]))
    };
    let of_past: Vec<[usize; 3]> = (1..=if has_gaps { LONG_PAST } else { PAST }).flat_map(terms_of).collect();
    let past = |row: usize, first: usize| {
        let turned = terms(case.middle[row]);
        let known = of_past.iter().take_while(move |[lag, ..]| first + lag <= row);
        known.map(move |[lag, axis, term]| innovations[n * (row - lag) + axis] * turned[*term])
    };
    let size = 1 + count_of;
    let mut total = vec![0.0; of_past.len() * size];
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
    if !has_gaps {
        return (values, Vec::new());
    }

    // Innovations that were not recorded explain nothing: an interval that would follow from it by more than by all else is not known at all.
    let lacks = |row: usize, lag: usize| row < lag || case.is_missing(row - lag);
    // The rest of a current is that of its neighbours where it changes smoothly, as by references and modulations that do not turn with the shaft.
    let mut left: Vec<Option<ByMagnet>> = vec![None; all];
    for (row, _) in rows() {
        signals(row, &mut own);
        let mut off = ByMagnet::default();
        (0..magnets).for_each(|k| off[k] = own[k] - f64::from(values[count_of * row + k]));
        left[row] = Some(off);
    }
    let between = |row: usize| -> Option<ByMagnet> {
        let (before, after) = (left[row - 1]?, (*left.get(row + 1)?)?);
        Some(std::array::from_fn(|k| 0.5 * (before[k] + after[k])))
    };
    let (mut usual, mut smooth, mut whole): (ByMagnet, ByMagnet, f64) = Default::default();
    for (row, _) in rows().filter(|(row, _)| !(1..=LONG_PAST).any(|lag| lacks(*row, lag))) {
        let (Some(left), Some(between)) = (left[row], between(row)) else { continue };
        for k in 0..magnets {
            usual[k] += left[k] * left[k];
            smooth[k] += (left[k] - between[k]).powi(2);
        }
        whole += 1.0;
    }
    let [usual, smooth] = [usual, smooth].map(|sums| sums.map(|sum| sum / whole.max(1.0)));
    let mut predicted = vec![[0.0; 2]; magnets * all];
    for (row, _) in all_rows().filter(|(row, _)| case.is_adrift(*row)) {
        let [gaps, _] = (on.rotor.passes.driven)(on, row);
        let between = between(row);
        for k in 0..magnets {
            let answers = answers[row / length].chunks_exact(size).zip(&of_past);
            let missing = answers.filter(|(_, [lag, ..])| lacks(row, *lag)).map(|(of, _)| of[1 + k] * of[1 + k]);
            let missing = missing.sum::<f64>();
            let value = f64::from(values[count_of * row + k]);
            let (value, variance) = match between.filter(|_| smooth[k] < usual[k]) {
                Some(between) => (value + between[k], smooth[k] + missing),
                None => (value, usual[k] + if missing > usual[k] { NOTHING * missing } else { missing }),
            };
            predicted[magnets * row + k] = [value, variance.sqrt()].map(|of| (of * gaps[k] * gaps[k]) as f32);
        }
    }
    (values, predicted)
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
