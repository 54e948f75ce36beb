//! What a search found: covariance by information or by scores, and the bias of the scores, which instruments tell.

use nalgebra::{DMatrix, DVector};

use super::super::case::{Case, NOISE_STEP};
use super::super::equations::{ALL, Bearing};
use super::super::filter::Block;
use super::super::instruments::Instruments;
use super::super::solve::{Normal, inverse, part};
use super::super::{Covariance, Estimate, Failed, Knowledge};
use super::{CONVERGED, Search};

/// Variance of the size of the bias of scores ([`bias`]): 0 where the loop is fast, 1 without feedback. With the 0.25 of the on-line estimator error/std
/// was 0.86 and 0.87 over 5 s; with 0.0625 it is 0.87 and 0.96 (drawn bearings, seeds 94001 and 63001).
const BIAS_VARIANCE: f64 = 0.0625;
/// Most steps with instruments.
const INSTRUMENTAL: usize = 4;
/// Blocks from which scores give a covariance.
const SCORES: usize = 32;
/// By how much the variance from scores exceeds that of the information before it counts. From n blocks it scatters by about √(2/n), more
/// with the lag: 0.25 for 32 blocks.
const SCORES_RATIO: f64 = 2.0;

/// A finished search, its sums taken over all columns.
pub struct Finished<'a> {
    pub search: Search<'a>,
    pub blocks: Vec<(usize, Vec<Block>)>,
    pub normal: Normal,
    pub estimated: Vec<usize>,
    /// Covariance by noise alone, and with priors, of what is estimated.
    pub noise: DMatrix<f64>,
    pub total: DMatrix<f64>,
    pub covariance: Covariance,
}

impl Finished<'_> {
    pub fn at(&self, unknown: usize) -> Option<usize> {
        self.estimated.iter().position(|at| *at == unknown)
    }

    pub fn estimate(&self, unknown: usize) -> Estimate {
        let std = |matrix: &DMatrix<f64>| self.at(unknown).map_or(0.0, |i| matrix[(i, i)].max(0.0).sqrt());
        Estimate { value: self.search.x[unknown], noise_std: std(&self.noise), total_std: std(&self.total) }
    }

    pub fn nis(&self, r: usize) -> f64 {
        let blocks = || self.blocks.iter().filter(move |(of, _)| *of == r).flat_map(|(_, blocks)| blocks);
        blocks().map(|block| block.nis).sum::<f64>() / (2.0 * blocks().map(|block| block.count).sum::<f64>())
    }
}

/// Takes the sums of a search over all columns.
pub fn finish(mut search: Search<'_>) -> Result<Finished<'_>, Failed> {
    let blocks = search.pass(true);
    let normal = search.normal(&blocks, true);
    let before = search.x.clone();
    let before_step = search.step(&normal)?;
    // The sums are those of the point before the last step, which no longer matters unless it was a large one.
    if before_step > 1.0 {
        search.converged = false;
    }
    let estimated = search.estimated();
    let (a, _) = search.equations(&normal, &estimated);
    let response =
        inverse(&a).ok_or_else(|| Failed::Diverged("the information matrix is not positive definite".into()))?;
    let weights = DMatrix::from_fn(estimated.len(), estimated.len(), |i, l| {
        if i == l { 1.0 / (search.prior[estimated[i]].1 * search.prior[estimated[i]].1) } else { 0.0 }
    });
    let information = part(&normal.j, &estimated, &estimated);
    let mut noise = &response * &information * &response;
    let mut covariance = Covariance::Information;
    let told = |case: &Case| case.recording.position_noise_m.is_some() && case.recording.current_noise_a.is_some();
    if !search.cases.iter().all(told) {
        let step: Vec<f64> = search.x.iter().zip(&before).map(|(x, before)| x - before).collect();
        if let Some(scores) = scores(&blocks, &estimated, &step, search.cases.len()) {
            // Scores of `weight` times the information have `weight²` times the variance.
            let by_scores = &response * (scores / search.weight) * &response;
            let larger = (0..3).any(|k| by_scores[(k, k)] > SCORES_RATIO * noise[(k, k)]);
            if larger {
                noise = by_scores;
                covariance = Covariance::Scores;
            }
        }
    }
    if search.converged && search.options.bench.iter().all(|told| told.knowledge == Knowledge::Exact) {
        noise += search.free_of_bias()?;
    }
    let total = &noise + &response * weights * &response;
    Ok(Finished { search, blocks, normal, estimated, noise, total, covariance })
}

/// Covariance of the sum of the scores, with the covariance between neighbouring blocks (Newey and West 1987, one lag).
fn scores(blocks: &[(usize, Vec<Block>)], of: &[usize], step: &[f64], recordings: usize) -> Option<DMatrix<f64>> {
    let count: usize = blocks.iter().map(|(_, blocks)| blocks.len()).sum();
    if count < SCORES {
        return None;
    }
    let mut sum = DMatrix::zeros(of.len(), of.len());
    let mut former: Option<(usize, DVector<f64>)> = None;
    for (r, blocks) in blocks {
        for block in blocks {
            let mut alone = Normal::new(recordings);
            alone.add(block, *r, ALL);
            let step = DVector::from_column_slice(step).resize_vertically(alone.b.len(), 0.0);
            let score = alone.b - alone.j * step;
            let score = DVector::from_fn(of.len(), |i, _| score[of[i]]);
            sum += &score * score.transpose();
            if let Some((of, former)) = &former
                && of == r
            {
                let product = &score * former.transpose();
                sum += (&product + product.transpose()) * 0.5;
            }
            former = Some((*r, score));
        }
    }
    Some(sum)
}

impl Search<'_> {
    /// By how much noise of the currents lowers the scores of λ: `λ_k Σ γᵀ S⁻¹ γ` with γ the sensitivity to λ_k that this noise drives.
    ///
    /// S contains the same noise as process noise, so that this is half the derivative of Σ ln det S to the logarithm of its level, over λ_k.
    fn attenuation(&self) -> [f64; 3] {
        let sets = [-NOISE_STEP, NOISE_STEP].map(|step| {
            let raised = |k: usize| std::array::from_fn(|l| if k == l { libm::exp(step) } else { 1.0 });
            self.likelihoods([0, 1, 2].map(raised), |_| true)
        });
        let log_det = |set: &[[[f64; 3]; 3]], k: usize| set.iter().map(|sums| sums[k][0]).sum::<f64>();
        std::array::from_fn(|k| (log_det(&sets[1], k) - log_det(&sets[0], k)) / (4.0 * NOISE_STEP * self.x[k]))
    }

    /// Moves from the maximum of the likelihood to the estimate that instruments free of the bias of scores; returns the covariance that this adds.
    fn free_of_bias(&mut self) -> Result<DMatrix<f64>, Failed> {
        let of = self.estimated();
        let mut added = DMatrix::zeros(of.len(), of.len());
        for _ in 0..INSTRUMENTAL {
            let bearings: Vec<Bearing> = (0..self.cases.len()).map(|r| self.bearing(r)).collect();
            for (case, bearing) in self.cases.iter_mut().zip(&bearings) {
                case.track.instruments = Some(Instruments::new(&case.data, bearing, &case.track, &case.segments));
            }
            let normal = self.normal(&self.pass(true), true);
            let (j, b) = self.equations(&normal, &of);
            let inverse = inverse(&j)
                .ok_or_else(|| Failed::Diverged("the information matrix is not positive definite".into()))?;
            let attenuation = self.attenuation();
            let lowered = DVector::from_fn(of.len(), |i, _| attenuation.get(of[i]).copied().unwrap_or(0.0));
            let a = &inverse * lowered;
            let found = &inverse * b;
            let (size, variance) = bias(&normal, &of, &j, &found, &a);
            let step = found + &a * size;
            added = &a * a.transpose() * variance;
            for (i, at) in of.iter().enumerate() {
                self.x[*at] += step[i];
            }
            let of_std = |i: usize| (step[i] / (inverse[(i, i)] + added[(i, i)]).sqrt()).abs();
            if (0..of.len()).map(of_std).fold(0.0, f64::max) < CONVERGED {
                break;
            }
            self.smooth();
        }
        Ok(added)
    }
}

/// Size of the bias of the scores and its variance, at a point from which `step` leads to the maximum of the likelihood ϑ.
///
/// Noise of the currents in the regressors moves ϑ by −a, what the controller makes of the noise of the positions by about +a where its loop is fast. The
/// sum is −s a; s has the variance V ([`BIAS_VARIANCE`]). With `l = J a/(aᵀ J a)`, the difference `lᵀ (ϑ_IV − ϑ)` is s with the variance
/// `v = lᵀ P_IV l − 1/(aᵀ J a)`, so that `ŝ = V lᵀ (ϑ_IV − ϑ)/(V + v)`, and its variance is `V v/(V + v)`. The on-line estimator does the same.
fn bias(normal: &Normal, of: &[usize], j: &DMatrix<f64>, step: &DVector<f64>, a: &DVector<f64>) -> (f64, f64) {
    let unknown = (0.0, BIAS_VARIANCE);
    let weight = a.dot(&(j * a));
    if weight <= 0.0 {
        return unknown;
    }
    let l = j * a / weight;
    // Instruments take the place of the columns of λ.
    let first = normal.b.len() - 3;
    let rows: Vec<usize> = of.iter().map(|at| if *at < 3 { first + at } else { *at }).collect();
    let (h, g) = (part(&normal.j, &rows, of), part(&normal.j, &rows, &rows));
    let scale = j.diagonal().map(|own| 1.0 / own.sqrt());
    let scaled = DMatrix::from_fn(of.len(), of.len(), |i, c| h[(c, i)] * scale[i] * scale[c]);
    let Some(w) = scaled.lu().solve(&l.component_mul(&scale)) else { return unknown };
    let w = w.component_mul(&scale);
    let right = DVector::from_fn(rows.len(), |i, _| normal.b[rows[i]]);
    let difference = w.dot(&right) - l.dot(step);
    let variance = (w.dot(&(g * &w)) - 1.0 / weight).max(0.0);
    if !difference.is_finite() || !variance.is_finite() {
        return unknown;
    }
    let part = BIAS_VARIANCE / (BIAS_VARIANCE + variance);
    (part * difference, part * variance)
}
