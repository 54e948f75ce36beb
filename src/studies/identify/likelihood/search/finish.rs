//! Results of a search: estimates with the noise bias removed, and their covariance from information or scores.
//!
//! Current noise enters the regressors, position noise returns through the controller: both bias the scores of the likelihood. Columns driven by
//! expected values ([`expected`](super::super::expected)) have no such bias (two-stage least squares, instrumental variables).

use nalgebra::{DMatrix, DVector};

use super::super::case::NOISE_STEP;
use super::super::filter::{Block, Columns, Likelihoods, UNCHANGED};
use super::super::solve::{self, Normal, submatrix};
use super::super::{Estimate, Failed, SILENT_M};
use super::test::Test;
use super::{CONVERGED, NOT_DETERMINED, Search};

/// Variance of the relative size of the bias of scores ([`Search::bias`]): 0 where the loop is fast, 1 without feedback; as in the on-line estimator.
const BIAS_VARIANCE: f64 = 0.25;
/// Maximum number of steps with instruments.
const MAX_INSTRUMENTAL_STEPS: usize = 6;
/// Minimum number of blocks for a covariance from scores.
const MIN_SCORE_BLOCKS: usize = 32;
/// Ratio to the variance from the information above which the variance from scores is used. From n blocks it scatters by about √(2/n), more
/// with the lag: 0.25 for 32 blocks.
const SCORES_RATIO: f64 = 2.0;

/// Noise of the currents, relative to their rms, that may explain all motion. Where λ2 steps by −30 to +50 % in the middle of a recording, the search may end
/// with 0.12 to 0.39; sensors have 0.001 to 0.03 (simulator of `scripts/faults.py`, seeds 955001 to 955015).
const MAX_CURRENT_NOISE: f64 = 0.1;

/// Part of the currents that may be restored without a notable bias of the scores. With clipped currents (`scripts/faults.py --only clipped`, seed
/// 5111001) four of six good recordings were refused.
const RESTORED: f64 = 0.005;

/// Noise of the currents, relative to their rms, that may bias the scores. With 1 % one of 40 good recordings is refused, with 0.5 % none
/// (`scripts/faults.py --seed 48001 --runs 40 --only none`), but a wrong gap is then valid (test `a_wrong_gap_shows_beside_the_turns`).
const NOISY: f64 = 0.01;

/// A finished search with sums over all columns.
pub struct Finished<'a> {
    pub search: Search<'a>,
    pub blocks: Vec<Block>,
    pub normal: Normal,
    pub estimated: Vec<usize>,
    /// Covariance of the estimated unknowns: from noise alone, and with priors.
    pub noise: DMatrix<f64>,
    pub total: DMatrix<f64>,
    /// Whether the covariance from noise is that of the scores.
    pub covariance_from_scores: bool,
    /// Test of the bench parameters that are not estimated.
    pub test: Test,
}

impl Finished<'_> {
    pub fn at(&self, unknown: usize) -> Option<usize> {
        self.estimated.iter().position(|at| *at == unknown)
    }

    pub fn estimate(&self, unknown: usize) -> Estimate {
        let std = |matrix: &DMatrix<f64>| self.at(unknown).map_or(0.0, |i| matrix[(i, i)].max(0.0).sqrt());
        Estimate { value: self.search.x[unknown], noise_std: std(&self.noise), total_std: std(&self.total) }
    }

    /// Whether a magnet pushes.
    pub fn pushes(&self) -> bool {
        (0..self.search.model.layout.magnets).any(|k| self.estimate(k).is_negative())
    }

    /// Whether the search has converged to a point where all magnets attract.
    pub fn is_solution(&self) -> bool {
        self.search.converged && !self.pushes()
    }

    /// Whether the noise of the currents is too small to explain the motion.
    pub fn is_quiet(&self) -> bool {
        self.search.cases.iter().all(|case| case.current_noise < MAX_CURRENT_NOISE * case.rms_current_a())
    }

    /// The blocks of recording `r`.
    pub fn blocks(&self, r: usize) -> impl Iterator<Item = &Block> {
        self.blocks.iter().filter(move |block| block.recording == r)
    }

    pub fn nis(&self, r: usize) -> f64 {
        let count: f64 = self.blocks(r).map(|block| block.count).sum();
        self.blocks(r).map(|block| block.nis).sum::<f64>() / (self.search.coordinates() as f64 * count)
    }
}

pub fn inverse(a: &DMatrix<f64>) -> Result<DMatrix<f64>, Failed> {
    solve::inverse(a).ok_or_else(|| Failed::Diverged(NOT_DETERMINED.into()))
}

/// Computes the sums over all columns, and the covariance.
pub fn finish(mut search: Search<'_>) -> Result<Finished<'_>, Failed> {
    if search.converged {
        // The variance of λ is its mean over possible noise levels; the mean square of a level σ with standard deviation s of its logarithm is σ² exp(2 s²).
        search.cases.iter_mut().for_each(|case| case.current_noise *= libm::exp(case.noise_variance));
    }
    let estimated = search.estimated();
    // Instruments lead away from the maximum of the likelihood, at which the bench is tested. There, much noise of the currents biases the scores, any
    // noise where the positions are exact, and so do restored currents.
    let is_read = search.cases.iter().all(|case| {
        let is_quiet = case.current_noise < NOISY * case.rms_current_a() && case.position_noise >= SILENT_M;
        is_quiet && case.part_restored() < RESTORED
    });
    let test = match search.corrects_bias() && is_read {
        true => Some(Test::of(&search, &search.pass(Columns::All), &estimated)?),
        false => None,
    };
    let bias = if search.converged && search.corrects_bias() { Some(search.free_of_bias()?) } else { None };
    let (blocks, normal, columns) = search.sums(&estimated);
    let (a, b) = search.equations_by(&normal, &estimated, &columns, &columns);
    let response = inverse(&a)?;
    let step = &response * b;
    if bias.is_none() && (0..step.len()).any(|i| step[i].abs() > response[(i, i)].sqrt()) {
        search.converged = false;
    }
    let prior_std = DVector::from_fn(estimated.len(), |i, _| search.prior[estimated[i]].1);
    let weights = DMatrix::from_diagonal(&prior_std.map(|std| 1.0 / (std * std)));
    let information = submatrix(&normal.j, &columns, &columns);
    let test = test.map_or_else(|| Test::of(&search, &blocks, &estimated), Ok)?;
    let mut noise = &response * &information * &response;
    let mut covariance_from_scores = false;
    if let Some(scores) = scores(&blocks, &columns, &step, &Normal::new(search.model.layout, search.cases.len())) {
        // A factor `weight` on the information is `weight²` on the variance of the scores.
        let scattered = &response * (scores / search.weight) * &response;
        covariance_from_scores =
            (0..search.model.layout.magnets).any(|k| scattered[(k, k)] > SCORES_RATIO * noise[(k, k)]);
        if covariance_from_scores {
            noise = scattered;
        }
    }
    if let Some(bias) = &bias {
        noise += bias;
    }
    let mut total = &noise + &response * weights * &response;
    if let Some(std) = search.mass_tolerance() {
        let scaled = DVector::from_fn(estimated.len(), |i, _| std * search.x[estimated[i]]);
        total += &scaled * scaled.transpose();
    }
    Ok(Finished { search, blocks, normal, estimated, noise, total, covariance_from_scores, test })
}

/// Covariance of the sum of the scores, including that between neighbouring blocks (Newey and West 1987, one lag).
fn scores(blocks: &[Block], of: &[usize], step: &DVector<f64>, none: &Normal) -> Option<DMatrix<f64>> {
    if blocks.len() < MIN_SCORE_BLOCKS {
        return None;
    }
    let mut sum = DMatrix::zeros(of.len(), of.len());
    let mut former: Option<(usize, DVector<f64>)> = None;
    for block in blocks {
        let mut single = none.clone();
        single.add(block, 1.0);
        let score = DVector::from_fn(of.len(), |i, _| single.b[of[i]]) - submatrix(&single.j, of, of) * step;
        sum += &score * score.transpose();
        if let Some((recording, former)) = &former
            && *recording == block.recording
        {
            let product = &score * former.transpose();
            sum += (&product + product.transpose()) * 0.5;
        }
        former = Some((block.recording, score));
    }
    Some(sum)
}

impl Search<'_> {
    /// Whether expected values are known for all recordings.
    fn has_instruments(&self) -> bool {
        self.cases.iter().all(|case| !case.expected.is_empty())
    }

    /// Sums over all columns, with instruments if available, and the columns of the sensitivities to the estimated unknowns.
    fn sums(&self, estimated: &[usize]) -> (Vec<Block>, Normal, Vec<usize>) {
        let instruments = self.has_instruments();
        // Where the bench is searched, convergence is judged by the sensitivities used in the search.
        let total = if self.corrects_bias() { Columns::Total } else { Columns::All };
        let blocks = self.pass(if instruments { Columns::Instruments } else { total });
        let normal = self.normal(&blocks);
        // With instruments, the measured sensitivities are at the end.
        let columns = estimated.iter().map(|at| match self.measured(*at) {
            Some(measured) if instruments => measured,
            _ => *at,
        });
        (blocks, normal, columns.collect())
    }

    /// Column of the measured sensitivity to an unknown in the sums.
    fn measured(&self, unknown: usize) -> Option<usize> {
        let layout = self.model.layout;
        let j = if unknown < layout.own { unknown } else { unknown + layout.owned() };
        Some(layout.unknowns(self.cases.len()) + layout.measured(j)? - layout.all)
    }

    /// Decrease of the scores of λ due to current noise: `λ_k Σ γᵀ S⁻¹ γ` with γ the sensitivity to λ_k driven by this noise.
    ///
    /// S contains the same noise as process noise, so this is half the derivative of Σ ln det S with respect to the logarithm of its level, over λ_k.
    fn attenuation(&self) -> Vec<f64> {
        let magnets = self.model.layout.magnets;
        // Three sets pass the filter together.
        let log_dets = |step: f64| -> Vec<f64> {
            let raised = |k: usize| {
                let mut levels = UNCHANGED;
                levels.currents.iter_mut().skip(k).take(1).for_each(|level| *level = libm::exp(step));
                levels
            };
            let sets = (0..magnets).step_by(3).map(|first| self.likelihoods([0, 1, 2].map(|k| raised(first + k))));
            let sums = |set: Vec<Likelihoods>| [0, 1, 2].map(|k| set.iter().map(|sums| sums[k][0]).sum::<f64>());
            sets.flat_map(sums).collect()
        };
        let (less, more) = (log_dets(-NOISE_STEP), log_dets(NOISE_STEP));
        (0..magnets).map(|k| (more[k] - less[k]) / (4.0 * NOISE_STEP * self.x[k])).collect()
    }

    /// Moves from the maximum of the likelihood to the estimate that instruments free of bias; returns the covariance added.
    fn free_of_bias(&mut self) -> Result<DMatrix<f64>, Failed> {
        let of = self.estimated();
        let mut added = DMatrix::zeros(of.len(), of.len());
        for _ in 0..MAX_INSTRUMENTAL_STEPS {
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

    /// Bias of the estimate due to noise, at a point from which `found` leads to the maximum of the likelihood ϑ: the step from there that removes it,
    /// and the covariance of the part that remains unknown.
    ///
    /// Current noise in the regressors lowers the score of λ_k by A_k; position noise, through the controller, raises it, by about as much where the loop
    /// is fast. The sum, −s_k A_k with s_k of variance V ([`BIAS_VARIANCE`]), moves ϑ by −J⁻¹ A s; κ, which divides all forces, has
    /// −1/κ Σ λ_k A_k s_k in its score. The instrumental estimate ϑ_IV is free of it and has the covariance P = H⁻¹ G H⁻ᵀ: for λ and κ alone, with
    /// B = (J⁻¹ A)_λ, `ŝ = V Bᵀ (V B Bᵀ + P_λ − (J⁻¹)_λ)⁻¹ (ϑ_IV − ϑ)_λ`. The on-line estimator does the same with one s for all.
    fn bias(
        &self,
        normal: &Normal,
        of: &[usize],
        columns: &[usize],
        inverse: &DMatrix<f64>,
        found: &DVector<f64>,
    ) -> (DVector<f64>, DMatrix<f64>) {
        let (n, magnets, attenuation) = (of.len(), self.model.layout.magnets, self.attenuation());
        let rows: Vec<usize> = (0..n).filter(|i| self.measured(of[*i]).is_some()).collect();
        let mut score_bias = DMatrix::zeros(n, magnets);
        for (i, k) in rows.iter().flat_map(|i| (0..magnets).map(move |k| (*i, k))) {
            let own = if of[i] < magnets { f64::from(of[i] == k) } else { -self.x[k] / (1.0 + self.x[of[i]]) };
            score_bias[(i, k)] = own * (self.weight * attenuation[k]);
        }
        let estimate_bias = inverse * score_bias;
        let variance = BIAS_VARIANCE;
        let unknown = || (DVector::zeros(n), &estimate_bias * estimate_bias.transpose() * variance);
        if !self.has_instruments() {
            return unknown();
        }
        let (h, right) = self.equations_by(normal, of, of, columns);
        let g = submatrix(&normal.j, of, of);
        let Some(h) = solve::general_inverse(&h) else { return unknown() };
        let difference = &h * right - found;
        let covariance = &h * g * h.transpose() - inverse;
        let b = &estimate_bias.select_rows(&rows);
        let scatter = b * b.transpose() * variance + submatrix(&covariance, &rows, &rows);
        let Some(weights) = solve::inverse(&scatter) else { return unknown() };
        let gain = b.transpose() * weights * variance;
        let size = &gain * difference.select_rows(&rows);
        let remainder = (DMatrix::identity(magnets, magnets) - gain * b) * variance;
        if !size.iter().chain(&remainder).all(|x: &f64| x.is_finite()) {
            return unknown();
        }
        (&estimate_bias * size, &estimate_bias * remainder * estimate_bias.transpose())
    }
}
