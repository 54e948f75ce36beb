//! Results of a finished search: estimates with their deviations, budget, residuals, suspects.

use nalgebra::DMatrix;

use super::bench::{BENCH, PARAMETERS};
use super::equations::LOAD;
use super::filter::{self, HARMONICS, LAGS};
use super::search::Finished;
use super::solve::{self, inverse, part, unknown};
use super::{
    BenchEstimate, BudgetLine, Conditions, Contradiction, Estimate, Identification, Knowledge, Residuals, Suspect,
};

/// χ² with one degree of freedom above which a bench parameter is a suspect: 8 · 10⁻⁶ by chance.
const SUSPECT: f64 = 20.0;

pub(super) fn report(
    finished: &Finished,
    mut held: Vec<usize>,
    contradictions: Vec<Contradiction>,
    gain_by_slow_force: f64,
) -> Identification {
    held.sort_unstable();
    held.dedup();
    let search = &finished.search;
    let lambda = [0, 1, 2].map(|k| finished.estimate(k));
    let unbalance = [3, 4].map(|at| finished.estimate(at));
    let (magnitude, phase) = polar(finished, unbalance);
    let bench = std::array::from_fn(|j| BenchEstimate {
        told: search.options.bench[j],
        estimate: finished.estimate(LOAD + j),
        estimated: finished.at(LOAD + j).is_some(),
    });
    Identification {
        lambda,
        lambda_covariance: std::array::from_fn(|k| std::array::from_fn(|l| finished.total[(k, l)])),
        unbalance,
        unbalance_magnitude: magnitude,
        unbalance_phase: phase,
        conditions: (0..search.cases.len()).map(|r| conditions(finished, r, &lambda)).collect(),
        bench,
        not_separated: held,
        budget: budget(finished),
        residuals: (0..search.cases.len()).map(|r| residuals(finished, r)).collect(),
        prediction_errors_m: (0..search.cases.len()).map(|r| prediction_errors(finished, r)).collect(),
        suspects: suspects(finished),
        contradictions,
        covariance: finished.covariance,
        iterations: search.iterations,
        converged: search.converged,
        gain_by_slow_force,
        log_likelihood: -0.5 * search.merit(&finished.blocks),
    }
}

/// Magnitude and phase of the unbalance.
fn polar(finished: &Finished, [c, s]: [Estimate; 2]) -> (Estimate, Estimate) {
    let size = (c.value * c.value + s.value * s.value).sqrt();
    let (Some(i), Some(l)) = (finished.at(3), finished.at(4)) else {
        return (Estimate { value: size, ..Estimate::default() }, Estimate::default());
    };
    let (along, across) = ([c.value / size, s.value / size], [-s.value / size, c.value / size]);
    let std = |matrix: &DMatrix<f64>, d: [f64; 2]| {
        (d[0] * d[0] * matrix[(i, i)] + 2.0 * d[0] * d[1] * matrix[(i, l)] + d[1] * d[1] * matrix[(l, l)])
            .max(0.0)
            .sqrt()
    };
    let of = |value: f64, d: [f64; 2], per: f64| Estimate {
        value,
        noise_std: std(&finished.noise, d) / per,
        total_std: std(&finished.total, d) / per,
    };
    (of(size, along, 1.0), of(libm::atan2(s.value, c.value), across, size))
}

fn conditions(finished: &Finished, r: usize, lambda: &[Estimate; 3]) -> Conditions {
    let search = &finished.search;
    let case = &search.cases[r];
    let bearing = search.bearing(r);
    let (mut ki, mut ks, mut rows) = ([0.0; 3], [0.0; 3], 0);
    for piece in &case.pieces {
        let first = usize::from(piece.counted.start == piece.filtered.start);
        for row in piece.counted.clone().skip(first).filter(|row| !case.data.is_unknown(*row)) {
            let gaps = bearing.gaps_at(&case.track.state[row]);
            let squares = case.data.squares(&bearing, row).middle;
            for k in 0..3 {
                let square = squares[k].max(0.0);
                ki[k] += square.sqrt() / (gaps[k] * gaps[k]);
                ks[k] += square / (gaps[k] * gaps[k] * gaps[k]);
            }
            rows += 1;
        }
    }
    let scaled = |factor: f64, of: &Estimate| Estimate {
        value: factor * of.value,
        noise_std: factor * of.noise_std,
        total_std: factor * of.total_std,
    };
    Conditions {
        load_n: [LOAD, LOAD + 1].map(|j| finished.estimate(unknown(j, r))),
        position_noise_m: case.position_noise,
        current_noise_a: case.current_noise,
        slow_force_n: case.slow_force,
        rows: case.rows(),
        counting: case.counting(),
        resolution_m: case.resolution_m,
        nis: finished.nis(r),
        ki_n_a: std::array::from_fn(|k| scaled(2.0 * ki[k] / f64::from(rows.max(1)), &lambda[k])),
        ks_n_m: std::array::from_fn(|k| scaled(2.0 * ks[k] / f64::from(rows.max(1)), &lambda[k])),
    }
}

fn budget(finished: &Finished) -> Vec<BudgetLine> {
    let search = &finished.search;
    let relative = |k: usize, value: f64| value / search.x[k];
    let line = |j: usize| {
        let unknown = LOAD + j;
        let told = search.options.bench[j].knowledge;
        let tolerance = match told {
            Knowledge::Tolerance(std) => std,
            _ => PARAMETERS[j].typical,
        };
        // All that is estimated follows an error of the parameter, but for the parameter itself.
        let others: Vec<usize> = finished.estimated.iter().copied().filter(|at| *at != unknown).collect();
        let (a, _) = search.equations(&finished.normal, &others);
        let response = inverse(&a).map(|inverse| inverse * part(&finished.normal.j, &others, &[unknown]));
        let sensitivity =
            std::array::from_fn(|k| response.as_ref().map_or(f64::NAN, |response| relative(k, response[(k, 0)])));
        let contribution = match finished.at(unknown) {
            None => sensitivity.map(|s: f64| s.abs() * tolerance),
            Some(i) => std::array::from_fn(|k| {
                // Cov(λ, p)²/Var p is what λ's variance loses when p is known.
                let (cross, own) = (finished.total[(k, i)], finished.total[(i, i)]);
                relative(k, (cross * cross / own).sqrt())
            }),
        };
        BudgetLine { parameter: j, sensitivity, tolerance, told: told != Knowledge::Exact, contribution }
    };
    (0..BENCH).map(line).collect()
}

fn residuals(finished: &Finished, r: usize) -> Residuals {
    let blocks = || finished.blocks.iter().filter(move |(of, _)| *of == r).flat_map(|(_, blocks)| blocks);
    let rows: f64 = blocks().map(|block| block.count).sum();
    let nis: f64 = blocks().map(|block| block.nis).sum::<f64>();
    let mut residuals = Residuals { harmonics: [[0.0; 2]; 4], amplitudes: [[0.0; 2]; 4], lags: [0.0; 4] };
    const { assert!(HARMONICS == 4 && LAGS == 4) };
    for harmonic in 0..HARMONICS {
        for axis in 0..2 {
            let sum = |part: usize| blocks().map(|block| block.harmonics[harmonic][axis][part]).sum::<f64>();
            let power = sum(0) * sum(0) + sum(1) * sum(1);
            residuals.harmonics[harmonic][axis] = 2.0 * power / rows;
            residuals.amplitudes[harmonic][axis] = 2.0 * power.sqrt() / rows;
        }
    }
    for lag in 0..LAGS {
        residuals.lags[lag] = blocks().map(|block| block.lags[lag]).sum::<f64>() / nis;
    }
    residuals
}

/// Measured minus predicted positions of one recording by row, in m; NaN where a row was not used.
fn prediction_errors(finished: &Finished, r: usize) -> Vec<[f64; 2]> {
    let (case, bearing) = (&finished.search.cases[r], finished.search.bearing(r));
    let variance = case.position_noise * case.position_noise;
    let mut errors = vec![[f64::NAN; 2]; case.data.position.len()];
    for piece in &case.pieces {
        let innovations = filter::innovations(&case.data, &bearing, &case.track, variance, piece);
        errors[piece.counted.clone()].iter_mut().zip(innovations).for_each(|(error, [metres, _])| *error = metres);
    }
    errors
}

/// Lagrange multiplier tests of the bench parameters that are not estimated.
fn suspects(finished: &Finished) -> Vec<Suspect> {
    let search = &finished.search;
    let (of, columns) = (&finished.estimated, &finished.columns);
    let (h, b) = search.equations_by(&finished.normal, of, of, columns);
    let (g, _) = search.equations(&finished.normal, of);
    let Some(inverse) = solve::general_inverse(&h) else { return Vec::new() };
    let rows: f64 = finished.blocks.iter().flat_map(|(_, blocks)| blocks).map(|block| 2.0 * block.count).sum();
    let nis = finished.blocks.iter().flat_map(|(_, blocks)| blocks).map(|block| block.nis).sum::<f64>() / rows;
    let mut suspects = Vec::new();
    for j in (0..BENCH).filter(|j| finished.at(LOAD + j).is_none()) {
        let unknown = LOAD + j;
        let projected = part(&finished.normal.j, &[unknown], columns) * &inverse;
        let all = finished.normal.j[(unknown, unknown)];
        let cross = part(&finished.normal.j, of, &[unknown]);
        let own = all - 2.0 * (&projected * cross)[(0, 0)] + (&projected * &g * projected.transpose())[(0, 0)];
        // A parameter that the other unknowns imitate up to rounding cannot be suspected.
        if own <= 1e-9 * all {
            continue;
        }
        let score = finished.normal.b[unknown] - (&projected * &b)[(0, 0)];
        let chi_square = score * score / own / nis.max(1.0);
        if chi_square > SUSPECT {
            suspects.push(Suspect {
                parameter: j,
                value: search.options.bench[j].value + score / own,
                std: (nis.max(1.0) / own).sqrt(),
                chi_square,
            });
        }
    }
    suspects.sort_by(|a, b| b.chi_square.total_cmp(&a.chi_square));
    suspects
}
