//! Expected motion and pull: the part that repeats with the shaft angle, and the part explained by past innovations.

use nalgebra::{DMatrix, DVector, SVector};

use super::data::Input;

/// Harmonics of the shaft angle.
const HARMONICS: usize = 12;
/// Number of terms: mean, cosines, sines.
const TERMS: usize = 2 * HARMONICS + 1;
/// Turns per stretch of rows, as in the memory of the on-line estimator, and minimum number of stretches of a recording.
const TURNS: f64 = 8.0;
const MIN_STRETCHES: usize = 6;
/// Minimum number of turns per stretch: the neighbouring stretches then cover all angles.
const MIN_TURNS: f64 = 1.0;
/// Number of turns below which a rotor is at rest.
const AT_REST: f64 = 0.01;
/// Added to the diagonal, relative to the number of rows: harmonics that the few rows of a turn do not separate then share their amplitude.
const RIDGE: f64 = 1e-6;
/// Number of past innovations. With 16 instead of 8, λ and its standard deviation are the same within a per cent; with 4, the standard deviation of a
/// bearing that noise excites is a tenth larger (seeds 63006, 92016, 92025 of drawn bearings, 24 seeds of the noise each).
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

/// Expected values of the rows of a recording, as in [`Case`](super::case::Case); empty if there are too few turns.
///
/// A Fourier series over the shaft angle for each stretch of rows is fitted to the stretches before and after it. The residual, which controller and
/// rotor make of noise, is regressed on past whitened innovations over all other stretches. Innovations are white, so neither part is correlated with
/// later ones.
pub(super) fn expected(input: Input<'_>, innovations: &[f64]) -> Vec<f32> {
    let case = input.case;
    let (n, magnets) = (case.position.len(), case.current.len());
    let count_of = magnets + 2 * n;
    let all = case.at.len();
    let all_rows = || case.segments.iter().flat_map(|segment| segment.clone().skip(1).map(|row| (row, segment.start)));
    let rows = || all_rows().filter(|(row, _)| !case.is_restored(*row));
    let signals = |row: usize, to: &mut [f64]| {
        let [gaps, squares] = (input.rotor.passes.gaps_and_squares)(input, row);
        (0..magnets).for_each(|k| to[k] = squares[k] / (gaps[k] * gaps[k]));
        to[magnets..].copy_from_slice(&case.state[2 * n * row..2 * n * (row + 1)]);
    };
    let angle: f64 = rows().map(|(row, _)| (case.recording.omega_rad_s[row] * case.recording.step_s).abs()).sum();
    let turns = angle / std::f64::consts::TAU;
    // A rotor at rest repeats at every row, a turning one once per turn.
    if turns > AT_REST && turns < MIN_TURNS * MIN_STRETCHES as f64 {
        return Vec::new();
    }
    let per_turn = rows().count() as f64 / turns.max(1e-9);
    let length = ((TURNS * per_turn) as usize).min(all / MIN_STRETCHES).max(1);
    let count = all.div_ceil(length);

    let mut sums = vec![(DMatrix::<f64>::zeros(TERMS, TERMS), DMatrix::<f64>::zeros(TERMS, count_of)); count];
    let mut own = DVector::zeros(count_of);
    for (row, _) in rows() {
        let (gram, right) = &mut sums[row / length];
        let terms = SVector::from(terms(case.middle[row]));
        signals(row, own.as_mut_slice());
        gram.ger(1.0, &terms, &terms, 1.0);
        right.ger(1.0, &terms, &own, 1.0);
    }
    let series: Vec<DMatrix<f64>> = (0..count).map(|at| fit_neighbours(&sums, at)).collect();
    let repeating = |row: usize| {
        let (terms, series) = (terms(case.middle[row]), &series[row / length]);
        DVector::from_fn(count_of, |k, _| (0..TERMS).map(|i| terms[i] * series[(i, k)]).sum())
    };

    // Innovations are white, so each coefficient follows from one of them alone. Sums for each past innovation, the latest first: its square, then its
    // products with the signals.
    let past = |row: usize, first: usize| {
        (1..=PAST).take_while(move |lag| first + lag <= row).flat_map(move |lag| &innovations[n * (row - lag)..][..n])
    };
    let mut responses = vec![DMatrix::<f64>::zeros(1 + count_of, PAST * n); count];
    for (row, first) in rows() {
        signals(row, own.as_mut_slice());
        let residual = &own - repeating(row);
        for (mut of, w) in responses[row / length].column_iter_mut().zip(past(row, first)) {
            of[0] += w * w;
            of.rows_mut(1, count_of).axpy(*w, &residual, 1.0);
        }
    }
    let total: DMatrix<f64> = responses.iter().sum();
    for response in &mut responses {
        *response = &total - &*response;
        for mut of in response.column_iter_mut() {
            let squares = of[0].max(1.0);
            of /= squares;
        }
    }
    let mut values = vec![0.0; count_of * all];
    for (row, first) in all_rows() {
        let mut own = repeating(row);
        for (of, w) in responses[row / length].column_iter().zip(past(row, first)) {
            own.axpy(*w, &of.rows(1, count_of), 1.0);
        }
        values[count_of * row..][..count_of].iter_mut().zip(&own).for_each(|(to, of)| *to = *of as f32);
    }
    values
}

/// Series fitted to the stretches before and after one.
fn fit_neighbours(sums: &[(DMatrix<f64>, DMatrix<f64>)], at: usize) -> DMatrix<f64> {
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
