//! Parts of a recording that contradict the rest.

use nalgebra::DVector;

use super::case::SHORTEST_BLOCK;
use super::filter::Block;
use super::search::{Finished, fit};
use super::solve::{Normal, inverse, part};
use super::{Change, Contradiction, Estimate, Recording, SHORTEST};
use crate::estimation::chi_square as chance;
use crate::studies::statistics::median;

/// χ² of a change of force constants or loads between two blocks above which it counts, as a normal deviate. At one place chance makes it with a
/// probability of 3.4 · 10⁻⁶; there are as many places as blocks, which are not independent of each other.
const CHANGE: f64 = 4.5;
/// A change of λ less than this, relative, is no change of the bearing but what models leave.
const LEAST_CHANGE: f64 = 0.01;
/// Normalised innovations squared of a block, relative to the median of all, above which it is left out, and by how many of their
/// standard deviations they are at least.
const DISTURBED: f64 = 2.0;
const DISTURBED_STD: f64 = 8.0;

/// A change of λ or load in a recording.
pub(super) struct Found {
    pub recording: usize,
    /// First row after it.
    pub row: usize,
    pub lambda: bool,
    pub chi_square: f64,
    /// By how much χ² is above that of chance.
    pub excess: f64,
}

/// The most significant change of λ or load.
///
/// For a change after block n the score of the blocks up to it, `g`, has the covariance `J_n − J_n J⁻¹ J_n`, all other unknowns estimated;
/// what the step that remains would take of it, `J_n J⁻¹ b`, is no change.
pub(super) fn change(finished: &Finished<'_>) -> Option<Found> {
    let search = &finished.search;
    let of = &finished.estimated;
    let (a, b) = search.equations(&finished.normal, of);
    let inverse_all = inverse(&a)?;
    let step = &inverse_all * b;
    let mut found: Option<Found> = None;
    for r in 0..search.cases.len() {
        let dispersion = finished.nis(r).max(1.0);
        let layout = search.kind.layout;
        let mut until = Normal::new(layout, search.cases.len());
        let loads = (layout.load..layout.base).map(|j| layout.unknown(j, r));
        let loads: Vec<usize> = loads.filter(|at| finished.at(*at).is_some()).collect();
        let blocks: Vec<&Block> = finished.blocks(r).collect();
        let end = blocks.last().map_or(0, |block| block.rows.end);
        for block in blocks.iter().take(blocks.len().saturating_sub(1)) {
            until.add(block, r);
            // A few rows at the end say nothing, and the covariance of what is before them is rounding.
            if end - block.rows.end < SHORTEST_BLOCK {
                continue;
            }
            for (lambda, unknowns) in [(true, &(0..layout.magnets).collect()), (false, &loads)] {
                if unknowns.is_empty() {
                    continue;
                }
                let c = part(&until.j, unknowns, of);
                let g = DVector::from_fn(unknowns.len(), |i, _| until.b[unknowns[i]]) - &c * &step;
                let covariance = part(&until.j, unknowns, unknowns) - &c * &inverse_all * c.transpose();
                let Some(gain) = inverse(&covariance) else { continue };
                let step = &gain * &g;
                let chi_square = step.dot(&g) / dispersion;
                let relative = (0..layout.magnets).map(|k| (step.get(k).copied().unwrap_or(0.0) / search.x[k]).abs());
                let large = !lambda || relative.fold(0.0, f64::max) > LEAST_CHANGE;
                let excess = chi_square - chance(unknowns.len() as f64, CHANGE);
                if excess > found.as_ref().map_or(0.0, |found| found.excess) && large {
                    found = Some(Found { recording: r, row: block.rows.end, lambda, chi_square, excess });
                }
            }
        }
    }
    found
}

/// Leaves out the smaller side of a change and describes it, with estimates of its own if λ is another there; nothing if nothing would remain.
pub(super) fn leave_out(
    recordings: &[Recording],
    masks: &mut [Vec<bool>],
    finished: &Finished<'_>,
    change: &Found,
) -> Option<Contradiction> {
    let (search, recording) = (&finished.search, change.recording);
    let (mask, block) = (&mut masks[recording], search.cases[recording].block());
    let used = |rows: &[bool]| rows.iter().filter(|used| **used).count();
    let (before, after) = (used(&mask[..change.row]), used(&mask[change.row..]));
    if before.min(after) == 0 || before.max(after) < SHORTEST {
        return None;
    }
    let end = mask.len();
    let rows = if before < after { 0..change.row } else { change.row..end };
    // The change is somewhere within the block before or after.
    mask[rows.start.saturating_sub(block)..(rows.end + block).min(end)].fill(false);
    let what = if change.lambda {
        let mut alone = vec![false; end];
        alone[rows.clone()].fill(true);
        let fitted = fit(&recordings[recording..=recording], &[alone], search.kind, &mut Vec::new()).ok();
        let unknown = Estimate::default().scaled(f64::NAN);
        let lambda = |k: usize| fitted.as_ref().map_or(unknown, |fitted| fitted.estimate(k));
        Change::Lambda((0..search.kind.layout.magnets).map(lambda).collect())
    } else {
        Change::Load { chi_square: change.chi_square }
    };
    Some(Contradiction { recording, part: 0, rows, what })
}

/// Blocks whose innovations are too large.
pub(super) fn disturbed(finished: &Finished<'_>) -> Vec<Contradiction> {
    let mut found: Vec<Contradiction> = Vec::new();
    let coordinates = finished.search.kind.layout.loads() as f64;
    for recording in 0..finished.search.cases.len() {
        let blocks: Vec<&Block> = finished.blocks(recording).collect();
        let mean = |block: &Block| block.nis / (coordinates * block.count);
        let median = median(blocks.iter().map(|block| mean(block)));
        for block in blocks {
            let ratio = mean(block) / median;
            // The variance of χ² with Nn degrees of freedom is 2Nn.
            if ratio > DISTURBED && ratio > 1.0 + DISTURBED_STD / (0.5 * coordinates * block.count).sqrt() {
                match found.last_mut() {
                    Some(Contradiction { recording: r, rows, what: Change::Disturbed { ratio: before }, .. })
                        if *r == recording && rows.end == block.rows.start =>
                    {
                        rows.end = block.rows.end;
                        *before = before.max(ratio);
                    }
                    _ => found.push(Contradiction {
                        recording,
                        part: 0,
                        rows: block.rows.clone(),
                        what: Change::Disturbed { ratio },
                    }),
                }
            }
        }
    }
    found
}
