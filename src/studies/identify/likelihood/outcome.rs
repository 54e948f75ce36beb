//! Results of a finished search: estimates with their standard deviations, budget, residuals, suspects.

use nalgebra::{DMatrix, DVector};

use super::bench::{GAIN_DIFFERENCE, IRON, Sensors};
use super::case::Case;
use super::data::Input;
use super::filter::{Columns, HARMONICS};
use super::rotor::ByMagnet;
use super::search::{BENCH_ROWS, Finished};
use super::solve::{self, Normal, inverse, submatrix};
use super::{
    BenchEstimate, Conditions, Contradiction, DELAY, Estimate, Identification, PartResults, SILENT_M, Suspect,
    Unbalance,
};
use crate::bearing::array;
use crate::studies::identify::{mean, plain};

/// χ² with one degree of freedom above which a bench parameter is a suspect; chance exceeds it with a probability of 8 · 10⁻⁶.
const SUSPECT: f64 = 20.0;
/// Part of the information on a parameter below which instruments alone do not test it.
const INFORMED: f64 = 0.5;

pub(super) fn report(
    finished: &Finished<'_>,
    held: &[usize],
    contradictions: Vec<Contradiction>,
    gain_by_slow_force: f64,
) -> Identification {
    let search = &finished.search;
    let layout = search.model.layout;
    let lambda: Vec<Estimate> = (0..layout.magnets).map(|k| finished.estimate(k)).collect();
    let errors_m = search.prediction_errors().into_iter().enumerate();
    let conditions = errors_m.map(|(r, errors_m)| conditions(finished, r, &lambda, errors_m));
    Identification {
        lambda_covariance: finished.total.view((0, 0), (layout.magnets, layout.magnets)).into_owned(),
        // Where every recording has its own, that of the first.
        unbalance: (layout.magnets..layout.load)
            .step_by(2)
            .map(|j| unbalance(finished, layout.unknown(j, 0)))
            .collect(),
        conditions: conditions.collect(),
        lambda,
        bench: (0..search.model.part.parameters.len()).map(|j| of_bench(finished, j, held.contains(&j))).collect(),
        suspects: suspects(finished),
        contradictions,
        covariance_from_scores: finished.covariance_from_scores,
        iterations: search.iterations,
        converged: search.converged,
        gain_by_slow_force,
        log_likelihood: -0.5 * search.merit(&finished.blocks),
    }
}

/// Unbalance whose components are the unknowns `at` and `at + 1`.
fn unbalance(finished: &Finished<'_>, at: usize) -> Unbalance {
    let [c, s] = [at, at + 1].map(|at| finished.search.x[at]);
    let size = c.hypot(s);
    let [i, l] = [at, at + 1].map(|at| finished.at(at).expect("every unbalance is estimated"));
    let (along, across) = ([c / size, s / size], [-s / size, c / size]);
    let std = |matrix: &DMatrix<f64>, d: [f64; 2]| {
        let mixed = 2.0 * d[0] * d[1] * matrix[(i, l)];
        (d[0] * d[0] * matrix[(i, i)] + mixed + d[1] * d[1] * matrix[(l, l)]).max(0.0).sqrt()
    };
    let of = |value: f64, d: [f64; 2], per: f64| Estimate {
        value,
        noise_std: std(&finished.noise, d) / per,
        total_std: std(&finished.total, d) / per,
    };
    Unbalance { magnitude: of(size, along, 1.0), phase: of(libm::atan2(s, c), across, size) }
}

fn conditions(
    finished: &Finished<'_>,
    r: usize,
    lambda: &[Estimate],
    (prediction_errors_m, ahead_m): (Vec<Vec<f64>>, Vec<f64>),
) -> Conditions {
    let search = &finished.search;
    let case = &search.cases[r];
    let (rotor, layout) = (search.rotor(r), search.model.layout);
    let ([mut ki, mut ks], mut rows) = ([ByMagnet::<f64>::default(); 2], 0);
    for piece in &case.pieces {
        let first = usize::from(piece.counted.start == piece.filtered.start);
        for row in piece.counted.clone().skip(first).filter(|row| !case.is_restored(*row)) {
            let input = Input { case, rotor: &rotor, piece };
            let [gaps, squares] = (rotor.passes.gaps_and_squares)(input, row);
            for k in 0..layout.magnets {
                let square = squares[k].max(0.0);
                ki[k] += square.sqrt() / (gaps[k] * gaps[k]);
                ks[k] += square / (gaps[k] * gaps[k] * gaps[k]);
            }
            rows += 1;
        }
    }
    let of = |sums: &ByMagnet| -> Vec<Estimate> {
        let means = sums.iter().map(|sum| 2.0 * sum / f64::from(rows.max(1)));
        lambda.iter().zip(means).map(|(lambda, mean)| lambda.scaled(mean)).collect()
    };
    let blocks = || finished.blocks(r);
    let count: f64 = blocks().map(|block| block.count).sum();
    let power = |axis: usize, harmonic: usize| {
        let sum = |part: usize| blocks().map(|block| block.harmonics[axis][harmonic][part]).sum::<f64>();
        sum(0) * sum(0) + sum(1) * sum(1)
    };
    let powers: Vec<[f64; HARMONICS]> =
        (0..layout.loads()).map(|axis| array::from_fn(|harmonic| power(axis, harmonic))).collect();
    let rms = |errors_m: &[Vec<f64>]| mean(errors_m.iter().flatten().map(|error_m| error_m * error_m)).sqrt();
    let neighbours = blocks().map(|block| block.neighbours).sum::<f64>();
    Conditions {
        load_n: (layout.load..layout.base).map(|j| finished.estimate(layout.unknown(j, r))).collect(),
        parts: vec![PartResults {
            position_noise_m: case.position_noise,
            current_noise_a: case.current_noise,
            slow_force_n: case.slow_force,
            noise_exponent: search.model.part.settings.exponent.then_some(Estimate {
                value: case.exponent,
                noise_std: case.exponent_std,
                total_std: case.exponent_std,
            }),
            rows: case.rows(),
            counting: case.effective_rows(),
            prediction_rms_m: [rms(&prediction_errors_m), rms(&[ahead_m])],
            correlation: neighbours / blocks().map(|block| block.nis).sum::<f64>(),
        }],
        resolution_m: case.resolution_m.clone(),
        ki_n_a: of(&ki),
        ks_n_m: of(&ks),
        harmonics: powers.iter().map(|of| of.map(|power| 2.0 * power / count)).collect(),
        amplitudes: powers.iter().map(|of| of.map(|power| 2.0 * power.sqrt() / count)).collect(),
        prediction_errors_m,
    }
}

/// Results for a bench parameter, by index.
fn of_bench(finished: &Finished<'_>, j: usize, is_held: bool) -> BenchEstimate {
    let search = &finished.search;
    let (magnets, unknown, parameter) =
        (search.model.layout.magnets, search.model.layout.own + j, &search.model.part.parameters[j]);
    let (mut estimate, mut estimated) = (finished.estimate(unknown), finished.at(unknown).is_some());
    if let Some(std) = search.mass_tolerance().filter(|_| j == search.model.places.mass) {
        (estimate.total_std, estimated) = (std, true);
    }
    let tolerance = parameter.knowledge.tolerance().unwrap_or(parameter.typical);
    // All other estimates respond to an error of the parameter.
    let others: Vec<usize> = finished.estimated.iter().copied().filter(|at| *at != unknown).collect();
    let (a, _) = search.equations(&finished.normal, &others);
    let response = inverse(&a).map(|inverse| inverse * submatrix(&finished.normal.j, &others, &[unknown]));
    let relative = |k: usize, value: f64| value / search.x[k];
    let sensitivity = |k: usize| response.as_ref().map_or(f64::NAN, |response| relative(k, response[(k, 0)]));
    let sensitivity: Vec<f64> = (0..magnets).map(sensitivity).collect();
    let contribution = match finished.at(unknown) {
        None => sensitivity.iter().map(|s| s.abs() * tolerance).collect(),
        Some(i) => {
            // Cov(λ, p)²/Var p is the variance that λ loses if p is known.
            let own = finished.total[(i, i)];
            (0..magnets).map(|k| relative(k, (finished.total[(k, i)].powi(2) / own).sqrt())).collect()
        }
    };
    BenchEstimate { parameter: parameter.clone(), estimate, estimated, is_held, sensitivity, tolerance, contribution }
}

/// Lagrange multiplier tests of the bench parameters that are not estimated, and of the gain of each position sensor of a pair. Measured sensitivities
/// count as well for the gains of a pair, which they tell apart best if all currents were recorded (with dropouts a good recording was refused), and where
/// instruments have less than [`INFORMED`] of their information (that of a motion that does not repeat with the turns, for instance); elsewhere they
/// would be biased by noise.
fn suspects(finished: &Finished<'_>) -> Vec<Suspect> {
    let Finished { search, normal, estimated: of, columns, .. } = finished;
    let coordinates = search.model.layout.loads() as f64;
    let rows: f64 = finished.blocks.iter().map(|block| block.count).sum();
    let nis = (finished.blocks.iter().map(|block| block.nis).sum::<f64>() / (coordinates * rows)).max(1.0);
    let parameters = &search.model.part.parameters;
    let single = (0..parameters.len()).map(|j| vec![(j, 1.0)]);
    let sensor = |of: &Sensors| [1.0, -1.0].map(|sign| vec![(of.gain, 1.0), (of.gain_difference, sign)]);
    let directions: Vec<Direction> = single.chain(search.model.places.pairs.iter().flat_map(sensor)).collect();
    let mut all = tests(finished, &directions, normal, columns, None);
    if of != columns && search.cases.iter().all(|case| case.position_noise >= SILENT_M) {
        let weight = (BENCH_ROWS / rows).min(1.0);
        let normal = search.normal(&search.pass(Columns::All));
        let measured = tests(finished, &directions, &normal, of, finished.bias.as_ref());
        let is_complete = search.cases.iter().all(Case::has_all_currents);
        for ((test, measured), direction) in all.iter_mut().zip(measured).zip(&directions) {
            let names = direction.iter().map(|(j, _)| plain(&parameters[*j].name));
            let [is_of_pair, is_delay] = [GAIN_DIFFERENCE, DELAY].map(|name| names.clone().any(|of| of == name));
            // The delay, which is biased most, has a test of its own (`answer::with_delay`).
            let counts = is_of_pair && is_complete || test[1] < INFORMED * measured[1] && !is_delay;
            let square = |[score, own]: [f64; 2]| if own > 0.0 { score * score / own } else { 0.0 };
            if counts && square(*test) < weight * square(measured) {
                *test = measured.map(|sum| weight * sum);
            }
        }
    }
    let suspect = |(direction, [score, own]): (Direction, [f64; 2])| {
        // A gap and an iron path are the same in the model: rounding must not decide which is named first.
        let (value, chi_square) = (score / own, f64::from((score * score / own / nis) as f32));
        let parameters = direction.iter().map(|(j, part)| (*j, part * value)).collect();
        let suspect = Suspect { parameters, std: (nis / own).sqrt(), chi_square };
        let is_open = |(j, _): &(usize, f64)| {
            let is_negative_path = value < 0.0 && plain(&search.model.part.parameters[*j].name) == IRON;
            finished.at(search.model.layout.own + j).is_none() && !is_negative_path
        };
        (direction.iter().all(is_open) && chi_square > SUSPECT).then_some(suspect)
    };
    let mut suspects: Vec<Suspect> = directions.into_iter().zip(all).filter_map(suspect).collect();
    suspects.sort_by(|a, b| b.chi_square.total_cmp(&a.chi_square));
    suspects
}

/// Direction of a test: indices of bench parameters with factors.
type Direction = Vec<(usize, f64)>;

/// Score and information along each direction, with these columns of the sensitivities to the estimated unknowns. If a bias was removed from the
/// estimates, with this covariance left, their scores are bias alone. How much of it the score along a direction contains is unknown: of the scores with
/// all of it and with none the smaller one counts, and its size and the rest of the bias lower the information.
fn tests(
    finished: &Finished<'_>,
    directions: &[Direction],
    normal: &Normal,
    columns: &[usize],
    bias: Option<&DMatrix<f64>>,
) -> Vec<[f64; 2]> {
    let Finished { search, estimated: of, .. } = finished;
    let (h, b) = search.equations_by(normal, of, of, columns);
    let (g, _) = search.equations(normal, of);
    let Some(inverse) = solve::general_inverse(&h) else { return vec![[0.0; 2]; directions.len()] };
    let test = |direction: &Direction| {
        let along = DVector::from_iterator(direction.len(), direction.iter().map(|(_, part)| *part));
        let own: Vec<usize> = direction.iter().map(|(j, _)| search.model.layout.own + j).collect();
        let projected = along.transpose() * submatrix(&normal.j, &own, columns) * &inverse;
        let all = along.dot(&(submatrix(&normal.j, &own, &own) * &along));
        let score = along.dot(&normal.b.select_rows(&own));
        let cross = submatrix(&normal.j, of, &own) * along;
        let own = all - 2.0 * (&projected * &cross)[(0, 0)] + (&projected * &g * projected.transpose())[(0, 0)];
        // A direction that the other unknowns reproduce up to rounding cannot be suspected.
        if own <= 1e-9 * all {
            return [0.0; 2];
        }
        let of_estimates = (&projected * &b)[(0, 0)];
        let other = score - of_estimates;
        match bias {
            Some(bias) => {
                let part = own / (own + of_estimates * of_estimates + cross.dot(&(bias * &cross)));
                [part * if score.abs() < other.abs() { score } else { other }, part * own]
            }
            None => [other, own],
        }
    };
    directions.iter().map(test).collect()
}
