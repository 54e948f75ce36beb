//! Sections of a recording that are inconsistent with the others.

use std::ops::Range;

use nalgebra::DVector;

use super::case::SHORTEST_BLOCK;
use super::filter::Block;
use super::search::{Finished, fit};
use super::solve::{Normal, inverse, submatrix};
use super::{Change, Contradiction, Estimate, Recording, SHORTEST, is_silent};
use crate::estimation::chi_square as chi_square_limit;
use crate::studies::statistics::median;

/// Threshold for χ² of a change of force constants or loads between two blocks, as a normal deviate. At one place chance exceeds it with a
/// probability of 3.4 · 10⁻⁶; there are as many places as blocks, and they are not independent.
const THRESHOLD_STD: f64 = 4.5;
/// Smaller relative changes of λ are model errors, not changes of the bearing.
const MIN_RELATIVE_CHANGE: f64 = 0.01;
/// A change of λ explains a change of the load as well if its χ² is at least this part of that of the load.
const ALIKE: f64 = 0.9;
/// Fewest blocks in which a drift differs from a change at an instant.
const MIN_DRIFTING: usize = 4;
/// A block is left out if its normalised innovation squared exceeds this multiple of the median of all blocks, and by at least this many standard
/// deviations.
const DISTURBED_RATIO: f64 = 2.0;
const DISTURBED_STD: f64 = 8.0;
/// Blocks with less than this part of the largest ratio may owe it to the loudest, which misleads the fit: they are judged without it.
const LOUD: f64 = 0.1;
/// Smallest part of the excess of disturbed rows that a change explains if it is their cause. Steps of λ and load explain all of it or more, pushes of 5 to
/// 50 ms mostly a tenth (simulator of `scripts/faults.py`, seeds 905001 to 905006).
const MIN_EXPLAINED: f64 = 0.5;

/// A change of λ or load in a recording; λ is not known before the sides are [compared](compare).
pub(super) struct Detected {
    pub recording: usize,
    /// First row after the change; the number of rows for a drift.
    pub row: usize,
    pub what: Change,
    pub chi_square: f64,
    /// Amount by which χ² exceeds the threshold.
    pub excess: f64,
}

/// Blocks with excessive innovations, and the most significant change.
pub(super) fn inconsistent(finished: &Finished<'_>) -> (Vec<Contradiction>, Option<Detected>) {
    let (disturbed, excess) = disturbed(finished);
    // A disturbance looks like a change of the rows before or after it, which explains little of it.
    (disturbed, change(finished, finished).filter(|change| change.chi_square > MIN_EXPLAINED * excess))
}

/// The most significant change of λ or load: at an instant, or of λ a linear one throughout a recording.
///
/// For a change after block n the score `g` of the blocks up to it has the covariance `J_n − J_n J⁻¹ J_n` with all other unknowns estimated. The
/// contribution of the step that remains, `J_n J⁻¹ b`, is no change and is subtracted. For a drift the blocks have weights `w`, `g = Σ w g_n`, with the
/// covariance `Σ w² J_n − C J⁻¹ Cᵀ`, `C = Σ w J_n` (Lagrange multiplier tests).
///
/// The normalised innovation squared of the rows that were fitted scales the noise if it exceeds 1.
pub(super) fn change(finished: &Finished<'_>, fitted: &Finished<'_>) -> Option<Detected> {
    let search = &finished.search;
    let of = &finished.estimated;
    let (a, b) = search.equations(&finished.normal, of);
    let inverse_all = inverse(&a)?;
    let step = &inverse_all * b;
    let mut found: Option<Detected> = None;
    for r in 0..search.cases.len() {
        let dispersion = fitted.nis(r).max(1.0);
        let layout = search.model.layout;
        let [mut until, mut weighted, mut squared] = [0; 3].map(|_| Normal::new(layout, search.cases.len()));
        // χ² of a change of these unknowns, and the change.
        let test = |unknowns: &[usize], weighted: &Normal, squared: &Normal| {
            let c = submatrix(&weighted.j, unknowns, of);
            let g = DVector::from_fn(unknowns.len(), |i, _| weighted.b[unknowns[i]]) - &c * &step;
            let covariance = submatrix(&squared.j, unknowns, unknowns) - &c * &inverse_all * c.transpose();
            let change = inverse(&covariance)? * &g;
            Some((change.dot(&g) / dispersion, change))
        };
        let excess =
            |chi_square: f64, unknowns: &[usize]| chi_square - chi_square_limit(unknowns.len() as f64, THRESHOLD_STD);
        let lambda: Vec<usize> = (0..layout.magnets).collect();
        let relative = |change: &DVector<f64>| change.iter().zip(&search.x).map(|(by, x)| by / x).collect::<Vec<f64>>();
        let is_large = |relative: &[f64]| relative.iter().any(|by| by.abs() > MIN_RELATIVE_CHANGE);
        let loads = (layout.load..layout.base).map(|j| layout.unknown(j, r));
        let loads: Vec<usize> = loads.filter(|at| finished.at(*at).is_some()).collect();
        let blocks: Vec<&Block> = finished.blocks(r).collect();
        let end = blocks.last().map_or(0, |block| block.rows.end);
        for block in blocks.iter().take(blocks.len().saturating_sub(1)) {
            until.add(block, 1.0);
            // A few rows at the end carry no information, and the covariance of those before them is dominated by rounding.
            if end - block.rows.end < SHORTEST_BLOCK {
                continue;
            }
            let mut of_lambda = 0.0;
            for (is_lambda, unknowns) in [(true, &lambda), (false, &loads)] {
                if unknowns.is_empty() {
                    continue;
                }
                let Some((chi_square, change)) = test(unknowns, &until, &until) else { continue };
                of_lambda = if is_lambda { chi_square } else { of_lambda };
                let excess = excess(chi_square, unknowns);
                let is_large = !is_lambda || is_large(&relative(&change));
                if excess > found.as_ref().map_or(0.0, |found| found.excess) && is_large {
                    let what = if is_lambda {
                        Change::Lambda(vec![Estimate::default().scaled(f64::NAN); layout.magnets])
                    } else {
                        // The effect of a change of λ may be that of a load.
                        Change::Load { chi_square, or_lambda: of_lambda > ALIKE * chi_square }
                    };
                    found = Some(Detected { recording: r, row: block.rows.end, what, chi_square, excess });
                }
            }
        }
        if blocks.len() < MIN_DRIFTING {
            continue;
        }
        for block in &blocks {
            let weight = (block.rows.start + block.rows.end) as f64 / (2.0 * end as f64);
            weighted.add(block, weight);
            squared.add(block, weight * weight);
        }
        let Some((chi_square, change)) = test(&lambda, &weighted, &squared) else { continue };
        let (excess, relative) = (excess(chi_square, &lambda), relative(&change));
        if excess > found.as_ref().map_or(0.0, |found| found.excess) && is_large(&relative) {
            found = Some(Detected { recording: r, row: end, what: Change::Drift(relative), chi_square, excess });
        }
    }
    found
}

/// Leaves out the smaller side of a change; none if no rows would remain. A drift leaves no rows that agree.
pub(super) fn leave_out(masks: &mut [Vec<bool>], finished: &Finished<'_>, change: Detected) -> Option<Contradiction> {
    let Detected { recording, row, what, .. } = change;
    if let Change::Drift(_) = what {
        return Some(Contradiction { recording, part: 0, rows: 0..row, what });
    }
    let (mask, block) = (&mut masks[recording], finished.search.cases[recording].block());
    let used = |rows: &[bool]| rows.iter().filter(|used| **used).count();
    let (before, after) = (used(&mask[..row]), used(&mask[row..]));
    if before.min(after) == 0 || before.max(after) < SHORTEST {
        return None;
    }
    let end = mask.len();
    let rows = if before < after { 0..row } else { row..end };
    // The change lies somewhere within the block before or after.
    mask[rows.start.saturating_sub(block)..(rows.end + block).min(end)].fill(false);
    Some(Contradiction { recording, part: 0, rows, what })
}

/// Says what differs on the side of a change that was left out, by a fit of its own beside that of the rows that remain. The score test that detected the
/// change is linear: it takes large changes of λ for changes of the load.
pub(super) fn compare(recordings: &[Recording], side: &mut Contradiction, rest: &Finished<'_>) {
    let (recording, model) = (side.recording, rest.search.model);
    let mut alone = vec![false; recordings[recording].rows()];
    alone[side.rows.clone()].fill(true);
    let own = fit(&recordings[recording..=recording], &[alone], model, &mut Vec::new());
    let Some(own) = own.ok().filter(|own| own.is_solution() && own.is_quiet() && rest.is_solution()) else { return };
    let layout = model.layout;
    let differs = |unknowns: Range<usize>| {
        let of = |r: usize| unknowns.clone().map(|j| layout.unknown(j, r)).collect::<Vec<_>>();
        let chi_square = difference((&own, &of(0)), (rest, &of(recording)))?;
        (chi_square > chi_square_limit(unknowns.len() as f64, THRESHOLD_STD)).then_some(chi_square)
    };
    let is_large = |k: usize| (own.search.x[k] / rest.search.x[k] - 1.0).abs() > MIN_RELATIVE_CHANGE;
    let lambda_differs = differs(0..layout.magnets).is_some() && (0..layout.magnets).any(is_large);
    if lambda_differs || matches!(side.what, Change::Lambda(_)) {
        side.what = Change::Lambda((0..layout.magnets).map(|k| own.estimate(k)).collect());
    } else if let Some(chi_square) = differs(layout.load..layout.base) {
        side.what = Change::Load { chi_square, or_lambda: false };
    }
}

/// χ² of the difference of unknowns in two fits with independent noise (Wald test).
fn difference((a, of_a): (&Finished<'_>, &[usize]), (b, of_b): (&Finished<'_>, &[usize])) -> Option<f64> {
    let covariance = |of: &Finished<'_>, unknowns: &[usize]| {
        let at = unknowns.iter().map(|at| of.at(*at)).collect::<Option<Vec<_>>>()?;
        Some(submatrix(&of.noise, &at, &at))
    };
    let by = DVector::from_fn(of_a.len(), |i, _| a.search.x[of_a[i]] - b.search.x[of_b[i]]);
    Some((inverse(&(covariance(a, of_a)? + covariance(b, of_b)?))? * &by).dot(&by))
}

/// Blocks with excessive innovations, and the sum of their χ² in excess of that of the others. Where the noise is that of a simulation, they are rounding
/// errors.
fn disturbed(finished: &Finished<'_>) -> (Vec<Contradiction>, f64) {
    let (mut found, mut excess) = (Vec::<Contradiction>::new(), 0.0);
    let coordinates = finished.search.model.layout.loads() as f64;
    for (recording, case) in finished.search.cases.iter().enumerate() {
        if is_silent(case.position_noise, case.current_noise) {
            continue;
        }
        let blocks: Vec<&Block> = finished.blocks(recording).collect();
        let mean = |block: &Block| block.nis / (coordinates * block.count);
        let median = median(blocks.iter().map(|block| mean(block)));
        let ratio = |block: &Block| mean(block) / median;
        let least = LOUD * blocks.iter().map(|block| ratio(block)).fold(DISTURBED_RATIO / LOUD, f64::max);
        // The variance of χ² with Nn degrees of freedom is 2Nn.
        let limit = |block: &Block| 1.0 + DISTURBED_STD / (0.5 * coordinates * block.count).sqrt();
        let is_loud = |block: &&Block| ratio(block) > least.max(limit(block));
        let loud: Vec<&Block> = blocks.into_iter().filter(is_loud).collect();
        let of_block = |block: &&Block| block.nis - median * coordinates * block.count;
        excess += loud.iter().map(of_block).sum::<f64>() / finished.nis(recording).max(1.0);
        found.extend(loud.chunk_by(|a, b| a.rows.end == b.rows.start).map(|run| Contradiction {
            recording,
            part: 0,
            rows: run[0].rows.start..run[run.len() - 1].rows.end,
            what: Change::Disturbed { ratio: run.iter().map(|block| ratio(block)).fold(0.0, f64::max) },
        }));
    }
    (found, excess)
}
