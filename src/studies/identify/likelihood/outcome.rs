//! Results of a finished search: estimates with their standard deviations, budget, residuals, suspects.

use nalgebra::DMatrix;

use super::data::Input;
use super::filter::HARMONICS;
use super::rotor::ByMagnet;
use super::search::Finished;
use super::solve::{inverse, submatrix};
use super::{BenchEstimate, Conditions, Contradiction, Estimate, Identification, PartResults, Unbalance};
use crate::bearing::array;
use crate::studies::identify::mean;

pub(super) fn report(
    finished: &Finished<'_>,
    held: &[usize],
    contradictions: Vec<Contradiction>,
    gain_by_slow_force: f64,
) -> Identification {
    let search = &finished.search;
    let layout = search.model.layout;
    let (suspects, together) = finished.test.suspects(search);
    let added = finished.test.typical_variance(search);
    let typical_std =
        (0..layout.magnets).map(|k| (finished.total[(k, k)] + added[k]).sqrt() / search.x[k].abs()).collect();
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
        typical_std,
        bench: (0..search.model.part.parameters.len()).map(|j| of_bench(finished, j, held.contains(&j))).collect(),
        suspects,
        together,
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
        None => {
            // With that tolerance, the data would determine the parameter within this standard deviation.
            let std = tolerance / (1.0 + finished.test.information[(j, j)]).sqrt();
            sensitivity.iter().map(|s| s.abs() * std).collect()
        }
        Some(i) => {
            // Cov(λ, p)²/Var p is the variance that λ loses if p is known.
            let own = finished.total[(i, i)];
            (0..magnets).map(|k| relative(k, (finished.total[(k, i)].powi(2) / own).sqrt())).collect()
        }
    };
    BenchEstimate { parameter: parameter.clone(), estimate, estimated, is_held, sensitivity, tolerance, contribution }
}
