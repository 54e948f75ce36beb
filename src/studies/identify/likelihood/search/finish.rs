//! Results of a search: estimates freed of the bias that noise makes, and their covariance by information or by scores.
//!
//! Noise of the currents stands in the regressors, noise of the positions comes back through the controller: both bias the scores of the likelihood. Where
//! the columns are driven by what was to be expected ([`expected`](super::super::expected)) there is no such bias (two-stage least squares, instrumental
//! variables).

use nalgebra::{DMatrix, DVector};

use super::super::case::{Case, NOISE_STEP};
use super::super::filter::{Block, Columns, SAME};
use super::super::solve::{self, Normal, part};
use super::super::{Estimate, Failed};
use super::{Blocks, CONVERGED, NOT_APART, Search};

/// Variance of the size of the bias of scores ([`Search::bias`]): 0 where the loop is fast, 1 without feedback; as on line.
const BIAS_VARIANCE: f64 = 0.25;
/// Most steps with instruments.
const INSTRUMENTAL: usize = 6;
/// Blocks from which scores give a covariance.
const SCORES: usize = 32;
/// By how much the variance from scores exceeds that of the information before it counts. From n blocks it scatters by about √(2/n), more
/// with the lag: 0.25 for 32 blocks.
const SCORES_RATIO: f64 = 2.0;

/// A finished search, its sums taken over all columns.
pub struct Finished<'a> {
    pub search: Search<'a>,
    pub blocks: Blocks,
    pub normal: Normal,
    pub estimated: Vec<usize>,
    /// Columns of the sums with the sensitivities to what is estimated; those of `estimated` have their instruments.
    pub columns: Vec<usize>,
    /// Covariance by noise alone, and with priors, of what is estimated.
    pub noise: DMatrix<f64>,
    pub total: DMatrix<f64>,
    /// Whether that by noise is that of the scores.
    pub by_scores: bool,
}

impl Finished<'_> {
    pub fn at(&self, unknown: usize) -> Option<usize> {
        self.estimated.iter().position(|at| *at == unknown)
    }

    pub fn estimate(&self, unknown: usize) -> Estimate {
        let std = |matrix: &DMatrix<f64>| self.at(unknown).map_or(0.0, |i| matrix[(i, i)].max(0.0).sqrt());
        Estimate { value: self.search.x[unknown], noise_std: std(&self.noise), total_std: std(&self.total) }
    }

    /// Whether the search has converged, where all magnets pull.
    pub fn is_solution(&self) -> bool {
        self.search.converged && !(0..self.search.kind.layout.magnets).any(|k| self.estimate(k).is_negative())
    }

    /// The blocks of recording `r`.
    pub fn blocks(&self, r: usize) -> impl Iterator<Item = &Block> {
        self.blocks.iter().filter(move |(of, _)| *of == r).flat_map(|(_, blocks)| blocks)
    }

    pub fn nis(&self, r: usize) -> f64 {
        let count: f64 = self.blocks(r).map(|block| block.count).sum();
        self.blocks(r).map(|block| block.nis).sum::<f64>() / (self.search.coordinates() as f64 * count)
    }
}

fn inverse(a: &DMatrix<f64>) -> Result<DMatrix<f64>, Failed> {
    solve::inverse(a).ok_or_else(|| Failed::Diverged(NOT_APART.into()))
}

/// Takes the sums of a search over all columns.
pub fn finish(mut search: Search<'_>) -> Result<Finished<'_>, Failed> {
    if search.converged {
        // λ has the variance that its mean over the levels of noise is, and the mean square of a level σ known to s in its logarithm is σ² exp(2 s²).
        search.cases.iter_mut().for_each(|case| case.current_noise *= libm::exp(case.noise_variance));
    }
    let estimated = search.estimated();
    let bias = if search.converged && search.exact() { Some(search.free_of_bias()?) } else { None };
    let (blocks, normal, columns) = search.sums(&estimated);
    let (a, b) = search.equations_by(&normal, &estimated, &columns, &columns);
    let response = inverse(&a)?;
    let step = &response * b;
    if bias.is_none() && (0..step.len()).any(|i| step[i].abs() > response[(i, i)].sqrt()) {
        search.converged = false;
    }
    let prior_std = DVector::from_fn(estimated.len(), |i, _| search.prior[estimated[i]].1);
    let weights = DMatrix::from_diagonal(&prior_std.map(|std| 1.0 / (std * std)));
    let information = part(&normal.j, &columns, &columns);
    let mut noise = &response * &information * &response;
    let mut by_scores = false;
    if !search.cases.iter().all(Case::has_known_noise)
        && let Some(scores) = scores(&blocks, &columns, &step, &Normal::new(search.kind.layout, search.cases.len()))
    {
        // Scores of `weight` times the information have `weight²` times the variance.
        let scattered = &response * (scores / search.weight) * &response;
        by_scores = (0..search.kind.layout.magnets).any(|k| scattered[(k, k)] > SCORES_RATIO * noise[(k, k)]);
        if by_scores {
            noise = scattered;
        }
    }
    if let Some(bias) = bias {
        noise += bias;
    }
    let mut total = &noise + &response * weights * &response;
    if let Some(std) = search.mass_tolerance() {
        let scaled = DVector::from_fn(estimated.len(), |i, _| std * search.x[estimated[i]]);
        total += &scaled * scaled.transpose();
    }
    Ok(Finished { search, blocks, normal, estimated, columns, noise, total, by_scores })
}

/// Covariance of the sum of the scores, with the covariance between neighbouring blocks (Newey and West 1987, one lag).
fn scores(blocks: &[(usize, Vec<Block>)], of: &[usize], step: &DVector<f64>, none: &Normal) -> Option<DMatrix<f64>> {
    let count: usize = blocks.iter().map(|(_, blocks)| blocks.len()).sum();
    if count < SCORES {
        return None;
    }
    let mut sum = DMatrix::zeros(of.len(), of.len());
    let mut former: Option<(usize, DVector<f64>)> = None;
    for (r, blocks) in blocks {
        for block in blocks {
            let mut alone = none.clone();
            alone.add(block, *r);
            let score = DVector::from_fn(of.len(), |i, _| alone.b[of[i]]) - part(&alone.j, of, of) * step;
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
    /// Whether all recordings tell what was to be expected of them.
    fn has_instruments(&self) -> bool {
        self.cases.iter().all(|case| !case.track.expected.is_empty())
    }

    /// Sums over all columns, with instruments if there are any, and the columns of the sensitivities to what is estimated.
    fn sums(&self, estimated: &[usize]) -> (Blocks, Normal, Vec<usize>) {
        let instruments = self.has_instruments();
        // Where the bench is searched, whether the search has converged is judged by the sensitivities that led it.
        let total = if self.exact() { Columns::Total } else { Columns::All };
        let blocks = self.pass(if instruments { Columns::Instruments } else { total });
        let normal = self.normal(&blocks);
        // Beside their instruments, the measured sensitivities stand at the end.
        let columns = estimated.iter().map(|at| match self.measured(*at) {
            Some(measured) if instruments => measured,
            _ => *at,
        });
        let columns = columns.collect();
        (blocks, normal, columns)
    }

    /// Place of the measured sensitivity to an unknown in the sums.
    fn measured(&self, unknown: usize) -> Option<usize> {
        let layout = self.kind.layout;
        let j = if unknown < layout.load { unknown } else { unknown + layout.loads() };
        Some(layout.unknowns(self.cases.len()) + layout.measured(j)? - layout.all)
    }

    /// By how much noise of the currents lowers the scores of λ: `λ_k Σ γᵀ S⁻¹ γ` with γ the sensitivity to λ_k that this noise drives.
    ///
    /// S contains the same noise as process noise, so that this is half the derivative of Σ ln det S to the logarithm of its level, over λ_k.
    fn attenuation(&self) -> Vec<f64> {
        let magnets = self.kind.layout.magnets;
        // Three sets go through the filter together.
        let log_dets = |step: f64| -> Vec<f64> {
            let raised = |k: usize| {
                let mut levels = SAME;
                levels.currents.iter_mut().skip(k).take(1).for_each(|level| *level = libm::exp(step));
                levels
            };
            let sets = (0..magnets).step_by(3).map(|first| self.likelihoods([0, 1, 2].map(|k| raised(first + k))));
            let sums = |set: Vec<[[f64; 3]; 3]>| [0, 1, 2].map(|k| set.iter().map(|sums| sums[k][0]).sum::<f64>());
            sets.flat_map(sums).collect()
        };
        let (less, more) = (log_dets(-NOISE_STEP), log_dets(NOISE_STEP));
        (0..magnets).map(|k| (more[k] - less[k]) / (4.0 * NOISE_STEP * self.x[k])).collect()
    }

    /// Moves from the maximum of the likelihood to the estimate that instruments free of its bias; returns the covariance that this adds.
    fn free_of_bias(&mut self) -> Result<DMatrix<f64>, Failed> {
        let of = self.estimated();
        let mut added = DMatrix::zeros(of.len(), of.len());
        for _ in 0..INSTRUMENTAL {
            let (_, normal, columns) = self.sums(&of);
            let (j, b) = self.equations_by(&normal, &of, &columns, &columns);
            let inverse = inverse(&j)?;
            let found = &inverse * b;
            let (bias, unknown) = self.bias(&normal, &of, &columns, &inverse, &found);
            let step = found + bias;
            added = unknown;
            for (i, at) in of.iter().enumerate() {
                self.x[*at] += step[i];
            }
            self.smooth();
            let of_std = |i: usize| (step[i] / (inverse[(i, i)] + added[(i, i)]).sqrt()).abs();
            if (0..of.len()).map(of_std).fold(0.0, f64::max) < CONVERGED {
                break;
            }
        }
        Ok(added)
    }

    /// The bias of the estimate that noise makes, at a point from which `found` leads to the maximum of the likelihood ϑ: the step from there that removes it, and
    /// the covariance of what remains unknown.
    ///
    /// Noise of the currents in the regressors lowers the score of λ_k by A_k, what the controller makes of the noise of the positions raises it, by about
    /// as much where its loop is fast. The sum, −s_k A_k with s_k of variance V ([`BIAS_VARIANCE`]), moves ϑ by −J⁻¹ A s; κ, which divides all
    /// forces, has −1/κ Σ λ_k A_k s_k in its score. The estimate by instruments ϑ_IV is free of it and has the covariance P = H⁻¹ G H⁻ᵀ: for λ and κ alone, with
    /// B = (J⁻¹ A)_λ, `ŝ = V Bᵀ (V B Bᵀ + P_λ − (J⁻¹)_λ)⁻¹ (ϑ_IV − ϑ)_λ`. The on-line
    /// estimator does the same with one s for all.
    fn bias(
        &self,
        normal: &Normal,
        of: &[usize],
        columns: &[usize],
        inverse: &DMatrix<f64>,
        found: &DVector<f64>,
    ) -> (DVector<f64>, DMatrix<f64>) {
        let (n, magnets, attenuation) = (of.len(), self.kind.layout.magnets, self.attenuation());
        let rows: Vec<usize> = (0..n).filter(|i| self.measured(of[*i]).is_some()).collect();
        let mut follows = DMatrix::zeros(n, magnets);
        for (i, k) in rows.iter().flat_map(|i| (0..magnets).map(move |k| (*i, k))) {
            let own = if of[i] < magnets { f64::from(of[i] == k) } else { -self.x[k] / (1.0 + self.x[of[i]]) };
            follows[(i, k)] = own * (self.weight * attenuation[k]);
        }
        let moves = inverse * follows;
        let variance = BIAS_VARIANCE;
        let unknown = || (DVector::zeros(n), &moves * moves.transpose() * variance);
        if !self.has_instruments() {
            return unknown();
        }
        let (h, right) = self.equations_by(normal, of, of, columns);
        let g = part(&normal.j, of, of);
        let Some(h) = solve::general_inverse(&h) else { return unknown() };
        let difference = &h * right - found;
        let covariance = &h * g * h.transpose() - inverse;
        let b = &moves.select_rows(&rows);
        let scatter = b * b.transpose() * variance + part(&covariance, &rows, &rows);
        let Some(weights) = solve::inverse(&scatter) else { return unknown() };
        let gain = b.transpose() * weights * variance;
        let size = &gain * difference.select_rows(&rows);
        let rest = (DMatrix::identity(magnets, magnets) - gain * b) * variance;
        if !size.iter().chain(&rest).all(|x: &f64| x.is_finite()) {
            return unknown();
        }
        (&moves * size, &moves * rest * moves.transpose())
    }
}
