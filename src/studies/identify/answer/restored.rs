//! Missing readings, restored from the currents with which the controller responded to them.
//!
//! A filter that predicts across a missing position treats the later currents as known. They are not independent of its error: the controller
//! has read the position, including its noise, and responded. With noise of 0.5 µm and 10 % of the rows missing, such a likelihood had its
//! maximum at twice λ. But the response also reveals the reading. A linear model of the controller is fitted where nothing is missing (ARX,
//! Ljung 1999, section 4.2),
//!
//! ```text
//! p(t) = c + Σ_l A_l p(t−l) + B_l q(t−l) + e(t),    l = 1 … n,
//! ```
//!
//! where p are the pulls `(i/gap)²` and q the positions; the coefficients depend on the angle of the shaft, `1, cos θ, sin θ`, if that lowers
//! the final prediction error. Missing positions are those that best satisfy it in all rows that respond to them (least squares, weighted by
//! the inverse covariance of e).
//!
//! Missing pulls are predicted from earlier rows alone. Estimated from later responses, they would absorb the errors e of these, which move
//! the rotor as well. The controller is not quite linear either: magnets only pull. A pull that would be negative is set to 0, and the others
//! change with it by the covariance of e.

use std::collections::BTreeMap;

use nalgebra::{DMatrix, DVector};

use crate::studies::statistics::spread;

/// Numbers of past samples and of factors of the angle: filters of a controller need a longer past.
const MODELS: [[usize; 2]; 4] = [[4, 1], [4, 3], [8, 1], [8, 3]];
/// Minimum and maximum number of rows per coefficient; more add little information.
const ROWS: [usize; 2] = [4, 40];
/// Number of fits, each weighted by the residuals of nearby rows in the one before: while the controller starts, they are ten times as large.
const FITS: usize = 4;
/// Added to the diagonal of the normal equations, per row: hardly more than rounding, since positions differ little from sample to sample, and
/// the controller responds to their difference. With 10⁻⁶, λ was off by four standard deviations.
const RIDGE: f64 = 1e-12;
/// Number of nearby rows on which the model is judged.
const NEAR: usize = 30;
/// Maximum number of readings that are restored together: the effort grows with its cube.
const TOGETHER: usize = 200;
/// Prior standard deviation of an unknown reading, relative to that of its signal: uninformative.
const PRIOR_STD: f64 = 10.0;
/// Relative spread of force constants; that of drawn bearings is 0.12.
const SPREAD: f64 = 0.15;

/// Row and signal; the pulls come first, then the positions.
type Place = (usize, usize);

/// Signals of bearings that are controlled together, with their means and standard deviations.
pub struct Signals<'a, F: Fn(usize, usize) -> bool> {
    of: Vec<&'a [f64]>,
    pulls: usize,
    scales: Vec<[f64; 2]>,
    /// Directions of the pulls, by position.
    directions: &'a [Vec<f64>],
    theta_rad: &'a [f64],
    is_missing: F,
}

/// A linear model of the controller.
#[derive(Default)]
struct Model {
    past: usize,
    /// For each factor of the angle, the past samples, the latest first, and the constant; a column per pull.
    coefficients: DMatrix<f64>,
    factors: usize,
    /// Inverse covariance of the errors.
    weights: DMatrix<f64>,
    /// The rows that it was fitted to, and their errors by row and pull.
    rows: Vec<usize>,
    errors: DMatrix<f64>,
}

impl Model {
    /// The coefficients for these factors of the angle: of the past samples and the constant, by pull.
    fn at(&self, factors: [f64; 3]) -> DMatrix<f64> {
        let terms = self.coefficients.nrows() / self.factors;
        (0..self.factors).map(|of| self.coefficients.rows(of * terms, terms) * factors[of]).sum()
    }

    /// Normalised mean square of the errors of nearby rows: 1, or more where the controller differs, as before it uses estimates.
    fn misfit(&self, row: usize) -> f64 {
        let at = self.rows.partition_point(|of| *of < row);
        let first = at.saturating_sub(NEAR / 2).min(self.rows.len().saturating_sub(NEAR));
        let near = self.errors.rows(first, NEAR.min(self.rows.len()));
        (near * &self.weights).dot(&near) / near.len() as f64
    }

    /// The unknown pulls of a row, with their covariance, given the expected and the known pulls.
    fn conditional(
        &self,
        expected: &DVector<f64>,
        known: &[Option<f64>],
    ) -> Option<(Vec<usize>, DVector<f64>, DMatrix<f64>)> {
        let (free, given): (Vec<usize>, Vec<usize>) = (0..known.len()).partition(|k| known[*k].is_none());
        let off = DVector::from_iterator(given.len(), given.iter().map(|k| known[*k].unwrap_or(0.0) - expected[*k]));
        let covariance = self.weights.select_rows(&free).select_columns(&free).cholesky()?.inverse();
        let pulled = self.weights.select_rows(&free).select_columns(&given) * off;
        Some((free.clone(), expected.select_rows(&free) - &covariance * pulled, covariance))
    }
}

impl<'a, F: Fn(usize, usize) -> bool> Signals<'a, F> {
    /// Pulls, then positions; `is_missing(row, signal)` is whether a reading is missing. Each pull acts on the positions along its direction.
    pub fn new(of: Vec<&'a [f64]>, directions: &'a [Vec<f64>], theta_rad: &'a [f64], is_missing: F) -> Self {
        let scale = |(signal, of): (usize, &&[f64])| {
            let known = (0..of.len()).filter(|row| !is_missing(*row, signal)).map(|row| of[row]);
            let [mean, variance] = spread(known);
            [mean, variance.sqrt()]
        };
        let scales = of.iter().enumerate().map(scale).collect();
        Self { of, pulls: directions.len(), scales, directions, theta_rad, is_missing }
    }

    fn count(&self) -> usize {
        self.of.len()
    }

    /// NaN if it is missing.
    fn value(&self, (row, signal): Place) -> f64 {
        let [mean, std] = self.scales[signal];
        if (self.is_missing)(row, signal) { f64::NAN } else { (self.of[signal][row] - mean) / std }
    }

    fn factors(&self, row: usize) -> [f64; 3] {
        let (sin, cos) = libm::sincos(self.theta_rad[row]);
        [1.0, cos, sin]
    }

    /// The places of this many samples before a row, the latest first.
    fn past(&self, row: usize, samples: usize) -> impl Iterator<Item = Place> {
        (1..=samples).flat_map(move |back| (0..self.count()).map(move |signal| (row - back, signal)))
    }

    /// The model with these numbers of past samples and factors of the angle, and the logarithm of its final prediction error (Akaike; Ljung
    /// 1999, section 16.4); `None` if there are too few rows.
    fn model(&self, [past, factors]: [usize; 2]) -> Option<(f64, Model)> {
        let terms = factors * (past * self.count() + 1);
        let mut since = 0;
        let has_past = |row: &usize| {
            let is_known = (0..self.count()).all(|signal| self.value((*row, signal)).is_finite());
            since = if is_known { since + 1 } else { 0 };
            since > past
        };
        let rows: Vec<usize> = (0..self.theta_rad.len()).filter(has_past).collect();
        let every = (rows.len() / (ROWS[1] * terms)).max(1);
        let rows: Vec<usize> = rows.into_iter().step_by(every).collect();
        if rows.len() < ROWS[0] * terms {
            return None;
        }
        let column = |row: &usize| {
            let past: Vec<f64> = self.past(*row, past).map(|place| self.value(place)).chain([1.0]).collect();
            self.factors(*row)
                .into_iter()
                .take(factors)
                .flat_map(move |factor| past.clone().into_iter().map(move |of| factor * of))
        };
        let terms_of = DMatrix::from_row_iterator(rows.len(), terms, rows.iter().flat_map(column));
        let responses = DMatrix::from_fn(rows.len(), self.pulls, |of, k| self.value((rows[of], k)));
        let (count, ridge) = (rows.len() as f64, RIDGE * rows.len() as f64);
        let mut model = Model { past, factors, rows, ..Model::default() };
        let mut weights = DVector::repeat(model.rows.len(), 1.0);
        let mut final_error = 0.0;
        for _ in 0..FITS {
            let weighted = DMatrix::from_fn(model.rows.len(), terms, |of, i| terms_of[(of, i)] * weights[of]);
            let gram = weighted.tr_mul(&terms_of) + DMatrix::from_diagonal_element(terms, terms, ridge);
            model.coefficients = gram.cholesky()?.solve(&weighted.tr_mul(&responses));
            model.errors = &responses - &terms_of * &model.coefficients;
            // Errors of the coefficients add to those of the responses.
            let more = (count + terms as f64) / (count - terms as f64);
            let weighted = DMatrix::from_fn(model.rows.len(), self.pulls, |of, k| model.errors[(of, k)] * weights[of]);
            let cholesky = (weighted.tr_mul(&model.errors) * (more / weights.sum())).cholesky()?;
            (final_error, model.weights) = (cholesky.ln_determinant(), cholesky.inverse());
            weights = DVector::from_iterator(model.rows.len(), model.rows.iter().map(|row| 1.0 / model.misfit(*row)));
            final_error -= self.pulls as f64 * weights.map(libm::log).mean();
        }
        Some((final_error, model))
    }

    /// The missing readings, as far as the responses of the controller determine them: values and standard deviations.
    pub fn restored(&self) -> Vec<(Place, [f64; 2])> {
        let models = MODELS.into_iter().filter_map(|of| self.model(of));
        let Some((_, model)) = models.min_by(|(a, _), (b, _)| a.total_cmp(b)) else { return Vec::new() };
        let is_missing = |row: &usize| (0..self.count()).any(|signal| (self.is_missing)(*row, signal));
        let rows: Vec<usize> = (0..self.theta_rad.len()).filter(is_missing).collect();
        // In a longer run, the past is not known.
        let runs = rows.chunk_by(|row, next| row + 1 == *next).filter(|run| run.len() <= model.past);
        let rows: Vec<usize> = runs.flatten().copied().collect();
        // Rows within the past of each other share responses.
        let sharing = rows.chunk_by(|row, next| next - row <= model.past).filter(|rows| rows[0] >= model.past);
        let mut restored = BTreeMap::new();
        for rows in sharing.flat_map(|rows| rows.chunks((TOGETHER / self.count()).max(1))) {
            self.positions(&model, rows, &mut restored);
            rows.iter().for_each(|row| self.pulls(&model, *row, &mut restored));
        }
        let each = restored.into_iter().map(|(place, [value, variance]): (Place, [f64; 2])| {
            let [mean, scale] = self.scales[place.1];
            (place, [mean + scale * value, scale * variance.sqrt()])
        });
        each.collect()
    }

    /// Adds the missing positions of some rows: least squares for all their missing readings, over all rows that respond to them.
    fn positions(&self, model: &Model, rows: &[usize], restored: &mut BTreeMap<Place, [f64; 2]>) {
        let is_missing = |place: &Place| (self.is_missing)(place.0, place.1);
        let places = rows.iter().flat_map(|row| (0..self.count()).map(|signal| (*row, signal)));
        let places: BTreeMap<Place, usize> = places.filter(is_missing).zip(0..).collect();
        let size = places.len();
        let mut information = DMatrix::identity(size, size) / (PRIOR_STD * PRIOR_STD);
        let mut right = DVector::zeros(size);
        for row in rows[0]..self.theta_rad.len().min(rows[rows.len() - 1] + model.past + 1) {
            // e = residual − Σ slope · unknown.
            let mut slopes = DMatrix::<f64>::zeros(self.pulls, size);
            let mut residual = DVector::<f64>::zeros(self.pulls);
            let coefficients = model.at(self.factors(row));
            for k in 0..self.pulls {
                let mut add = |place: Place, factor: f64| match places.get(&place) {
                    Some(at) => slopes[(k, *at)] -= factor,
                    None => residual[k] += factor * self.value(place),
                };
                add((row, k), 1.0);
                self.past(row, model.past).zip(coefficients.column(k).iter()).for_each(|(of, factor)| add(of, -factor));
                residual[k] -= coefficients[(coefficients.nrows() - 1, k)];
            }
            // Rows with readings that are not usable, or are restored with other rows, contribute nothing.
            if residual.iter().all(|residual| residual.is_finite()) {
                let weighted = slopes.tr_mul(&model.weights);
                information += &weighted * &slopes;
                right += weighted * residual;
            }
        }
        let Some(cholesky) = information.cholesky() else { return };
        let (values, covariance) = (cholesky.solve(&right), cholesky.inverse());
        // A reading whose error may be as large as its variation remains unknown.
        let is_determined = |(_, signal): Place, at: usize| signal >= self.pulls && covariance[(at, at)] < 1.0;
        let positions = places.into_iter().filter(|(place, at)| is_determined(*place, *at));
        let variance = |row: usize, at: usize| model.misfit(row) * covariance[(at, at)];
        restored.extend(positions.map(|(place, at)| (place, [values[at], variance(place.0, at)])));
    }

    /// Adds the missing pulls of a row, predicted from earlier rows.
    fn pulls(&self, model: &Model, row: usize, restored: &mut BTreeMap<Place, [f64; 2]>) {
        let known = |place: Place| restored.get(&place).copied().unwrap_or_else(|| [self.value(place), 0.0]);
        let past = self.past(row, model.past).map(known);
        let (values, variances): (Vec<f64>, Vec<f64>) = past.chain([[1.0, 0.0]]).map(|[value, of]| (value, of)).unzip();
        let coefficients = model.at(self.factors(row));
        let expected = coefficients.tr_mul(&DVector::from(values));
        if expected.iter().any(|of| !of.is_finite()) {
            return;
        }
        // Errors of readings that were restored before propagate.
        let inherited = coefficients.map(|of| of * of).tr_mul(&DVector::from(variances));
        let mut known: Vec<Option<f64>> =
            (0..self.pulls).map(|k| (!(self.is_missing)(row, k)).then(|| self.value((row, k)))).collect();
        let Some((missing, mut values, covariance)) = model.conditional(&expected, &known) else { return };
        // Magnets only pull: a negative pull is set to 0, and the others are conditioned on that.
        let mut free = missing.clone();
        let zero = |k: usize| -self.scales[k][0] / self.scales[k][1];
        let lowest = |free: &[usize], values: &DVector<f64>| {
            let above = free.iter().zip(values.iter()).map(|(k, value)| (value - zero(*k), *k));
            above.min_by(|(a, _), (b, _)| a.total_cmp(b)).filter(|(above, _)| *above < 0.0).map(|(_, k)| k)
        };
        while let Some(k) = lowest(&free, &values) {
            known[k] = Some(zero(k));
            let Some((others, of_others, _)) = model.conditional(&expected, &known) else { return };
            (free, values) = (others, of_others);
        }
        free.iter().zip(values.iter()).for_each(|(k, value)| known[*k] = Some(*value));
        let mut covariance = covariance * model.misfit(row);
        (0..missing.len()).for_each(|at| covariance[(at, at)] += inherited[missing[at]]);
        let part = self.force_fraction(&missing, &covariance);
        for (at, k) in missing.iter().enumerate() {
            restored.insert((row, *k), [known[*k].unwrap_or(0.0), part * covariance[(at, at)]]);
        }
    }

    /// Fraction of the variance of missing pulls of a row that affects their force. The controller divides a force among magnets that pull
    /// against each other: errors of their pulls cancel as far as their force constants are equal.
    fn force_fraction(&self, pulls: &[usize], covariance: &DMatrix<f64>) -> f64 {
        let along = |i: usize, j: usize| {
            let [a, b] = [i, j].map(|at| pulls[at]);
            let of: f64 = self.directions[a].iter().zip(&self.directions[b]).map(|(a, b)| a * b).sum();
            of * self.scales[a][1] * self.scales[b][1] * covariance[(i, j)]
        };
        let force: f64 = (0..pulls.len()).flat_map(|i| (0..pulls.len()).map(move |j| along(i, j))).sum();
        force / (0..pulls.len()).map(|i| along(i, i)).sum::<f64>() + SPREAD * SPREAD
    }
}
