//! The most likely point: Fisher scoring with Levenberg–Marquardt damping on the innovations of the filter.

use nalgebra::{DMatrix, DVector};

use super::filter::{BOTH, Filter, ONE, POSITION, Readings, Row};
use super::{Axis, DYNAMICS, GAP, Point, UNKNOWNS, is_logarithm};
use crate::studies::parallel::in_order;

/// Rows passed by all filters before their innovations are summed, so that memory does not grow with the recording.
const ROWS: usize = 4096;
/// Maximum number of iterations, and gain in log-likelihood at which they end.
const MAX_ITERATIONS: usize = 100;
const CONVERGED: f64 = 1e-2;
/// Longest step in steps of the differences ([`Axis::step`]): a tenth of λ, a factor of 7 of a noise.
const MAX_STEP: f64 = 100.0;
/// The logarithm of a noise with less information than this is at its lower limit.
const MIN_INFORMATION: f64 = 1e-3;

/// Result of a search.
#[derive(Clone, Debug)]
pub(super) struct Fit {
    pub point: Point,
    /// Logarithm of the likelihood, up to a constant that depends on the number of readings.
    pub log_likelihood: f64,
    /// Covariance of the point from the Fisher information and tolerances; 0 for unknowns not searched.
    pub covariance: DMatrix<f64>,
    /// The part of it that is due to the tolerances.
    pub of_tolerances: DMatrix<f64>,
    pub readings: usize,
    pub converged: bool,
}

impl Fit {
    /// Adds to the covariance the difference of the bench parameters in another model, at `point`: neither model knows all effects of the controller.
    pub(super) fn widen(&mut self, point: &Point) {
        let is_bench = |at: usize| at <= DYNAMICS && self.covariance[(at, at)] > 0.0;
        let apart = DVector::from_fn(UNKNOWNS, |at, _| if is_bench(at) { point[at] - self.point[at] } else { 0.0 });
        self.covariance.ger(1.0, &apart, &apart, 1.0);
    }
}

/// Sums of one pass: log-likelihood, number of readings, information and score of the unknowns.
struct Sums {
    log_likelihood: f64,
    readings: usize,
    information: DMatrix<f64>,
    score: DVector<f64>,
}

/// Filters readings and calls `each` with the filter after every row, and the innovation of its position with its variance.
pub(super) fn follow(axis: &Axis, readings: &Readings, point: &Point, mut each: impl FnMut(&Filter<BOTH>, [f64; 2])) {
    let Some(mut filter) = Filter::new(axis, axis.law(point), readings) else { return };
    for row in readings.rows.clone() {
        let innovations = filter.step(readings, row);
        each(&filter, innovations[POSITION]);
    }
}

pub(super) fn log_likelihood(axis: &Axis, readings: &Readings, point: &Point) -> f64 {
    pass(axis, readings, point, &[]).map_or(f64::NEG_INFINITY, |sums| sums.log_likelihood)
}

/// Most likely point, from a start along the free unknowns, in at most `most` iterations.
pub(super) fn fit(axis: &Axis, readings: &Readings, start: &Point, free: &[usize], most: usize) -> Option<Fit> {
    let (mut point, mut damping, mut converged) = (*start, 1e-4, false);
    let mut sums = pass(axis, readings, &point, free)?;
    for _ in 0..most.min(MAX_ITERATIONS) {
        let scale = DVector::from_fn(free.len(), |i, _| sums.information[(i, i)].sqrt() + 1e-300);
        let mut step = None;
        while step.is_none() && damping < 1e8 {
            let scaled = DMatrix::from_fn(free.len(), free.len(), |i, j| {
                sums.information[(i, j)] / (scale[i] * scale[j]) + if i == j { damping } else { 0.0 }
            });
            let moved = scaled.cholesky().map(|cholesky| {
                let solved = cholesky.solve(&sums.score.component_div(&scale)).component_div(&scale);
                // The bench parameters λ, gap and load depend on each other: their step is shortened as a whole, that of each noise by itself.
                let longest = |at: usize| MAX_STEP * axis.step(at, &point);
                let is_noise = |at: usize| at > GAP && is_logarithm(at);
                let bench = free.iter().zip(solved.iter()).filter(|(at, _)| !is_noise(**at));
                let part = bench.map(|(at, step)| longest(*at) / step.abs()).fold(1.0, f64::min);
                let mut to = point;
                for (at, step) in free.iter().zip(solved.iter()) {
                    let longest = longest(*at);
                    to[*at] += if is_noise(*at) { step.clamp(-longest, longest) } else { part * step };
                }
                axis.bounded(to)
            });
            let with_gain = |to: Point| (to, log_likelihood(axis, readings, &to) - sums.log_likelihood);
            step = moved.map(with_gain).filter(|(_, gain)| *gain >= -1e-9);
            if step.is_none() {
                damping = (10.0 * damping).max(1e-6);
            }
        }
        // If no direction leads up, the point is a maximum up to rounding.
        converged = step.is_none_or(|(_, gain)| gain < CONVERGED);
        if let Some((to, _)) = step {
            (point, damping) = (to, (0.1 * damping).max(1e-9));
            sums = pass(axis, readings, &point, free)?;
        }
        if converged {
            break;
        }
    }
    let is_kept = |i: &usize| !is_logarithm(free[*i]) || sums.information[(*i, *i)] > MIN_INFORMATION;
    let kept: Vec<usize> = (0..free.len()).filter(is_kept).collect();
    let inverse = sums.information.select_rows(&kept).select_columns(&kept).cholesky()?.inverse();
    let mut covariance = DMatrix::zeros(UNKNOWNS, UNKNOWNS);
    for (i, a) in kept.iter().enumerate() {
        kept.iter().enumerate().for_each(|(j, b)| covariance[(free[*a], free[*b])] = inverse[(i, j)]);
    }
    let precision = DMatrix::from_diagonal(&DVector::from_fn(UNKNOWNS, |at, _| axis.precision(at)));
    let of_tolerances = &covariance * precision * &covariance;
    let Sums { log_likelihood, readings, .. } = sums;
    Some(Fit { point, log_likelihood, covariance, of_tolerances, readings, converged })
}

/// One pass of the filters at a point and, for central differences, at its neighbours along the unknowns.
///
/// The information of an innovation e with variance S is `∂e ∂eᵀ/S + ½ ∂ln S ∂ln Sᵀ`, its score `−e ∂e/S + ½ (e²/S − 1) ∂ln S`.
fn pass(axis: &Axis, readings: &Readings, point: &Point, free: &[usize]) -> Option<Sums> {
    let pass = if axis.used.len() == 1 { pass_of::<ONE> } else { pass_of::<BOTH> };
    pass(axis, readings, point, free)
}

fn pass_of<const N: usize>(axis: &Axis, readings: &Readings, point: &Point, free: &[usize]) -> Option<Sums> {
    let rows = &readings.rows;
    let points = std::iter::once(*point).chain(free.iter().flat_map(|at| axis.neighbours(*at, point)));
    let filters = points.map(|point| Filter::new(axis, axis.law(&point), readings));
    let mut filters: Vec<Filter<N>> = filters.collect::<Option<_>>()?;
    let n = free.len();
    let mut sums =
        Sums { log_likelihood: 0.0, readings: 0, information: DMatrix::zeros(n, n), score: DVector::zeros(n) };
    let widths: Vec<f64> = free.iter().map(|at| 2.0 * axis.step(*at, point)).collect();
    let (mut of_error, mut of_variance) = (vec![0.0; n], vec![0.0; n]);
    let mut from = rows.start;
    while from < rows.end {
        let to = (from + ROWS).min(rows.end);
        let passed = in_order(filters.len(), &|at| {
            let mut filter = filters[at].clone();
            let innovations = (from..to).map(|row| filter.step(readings, row)).collect();
            (filter, innovations)
        });
        let innovations: Vec<Vec<Row>>;
        (filters, innovations) = passed.into_iter().unzip();
        for (at, [error, variance]) in innovations[0].as_flattened().iter().enumerate() {
            if *variance == 0.0 {
                continue;
            }
            sums.readings += 1;
            sums.log_likelihood -= 0.5 * (error * error / variance + libm::log(*variance));
            for i in 0..n {
                let [[e, s], [f, t]] = [1, 2].map(|side| innovations[side + 2 * i].as_flattened()[at]);
                of_error[i] = (e - f) / widths[i];
                of_variance[i] = (s - t) / variance / widths[i];
            }
            for i in 0..n {
                let (along, spread) = (of_error[i] / variance, 0.5 * of_variance[i]);
                sums.score[i] += -error * along + (error * error / variance - 1.0) * spread;
                for l in 0..=i {
                    sums.information[(i, l)] += along * of_error[l] + spread * of_variance[l];
                }
            }
        }
        from = to;
    }
    for (at, off) in axis.deviations(point) {
        let precision = axis.precision(at);
        sums.log_likelihood -= 0.5 * precision * off * off;
        if let Some(i) = free.iter().position(|of| *of == at) {
            sums.score[i] -= precision * off;
            sums.information[(i, i)] += precision;
        }
    }
    sums.information.fill_upper_triangle_with_lower_triangle();
    sums.log_likelihood.is_finite().then_some(sums)
}
