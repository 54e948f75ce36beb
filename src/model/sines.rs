//! Sums of sines over a sliding window, at the end of every hop: a cost per sample that does not depend on the window.
//!
//! Wanted of several signals x (the lanes), at every `hop`-th sample, is over the inner nodes of a window of N intervals
//!
//! ```text
//! s_l = Σ_j sin(l π j/N) x_j        j = 1 … N − 1,   l = 1 … 12
//! ```
//!
//! Time is cut into blocks of one hop. The sums `C_l = Σ_r cos(l π r/N) x` and `S_l = Σ_r sin(l π r/N) x` over a block,
//! r counted from its first node, grow with every sample; the theorem of addition brings a block to its place o in the window:
//!
//! ```text
//! s_l = Σ_blocks sin(l π o/N) C_l + cos(l π o/N) S_l
//! ```
//!
//! The oldest block lies in the window with its last nodes alone, always the same number of them; their sums are kept beside those
//! of the whole block. So a sample costs two multiplications per harmonic and lane, and a hop as many for every block, of which there
//! are [`MAX_BLOCKS`] at most. Nothing is ever subtracted, and what a sample has left in rounding is gone when its block is.
//!
//! All sums are elementwise in a fixed order, without fused operations: every width of vector instructions gives the same bits.

use std::f64::consts::PI;

use multiversion::multiversion;
use serde::{Deserialize, Serialize};

/// Number of harmonics l.
pub const HARMONICS: usize = 12;

/// Number of signals.
pub const LANES: usize = 7;

/// A hop is at least so many times in a window of 50 intervals or more, and less than twice as often.
pub const HOPS_PER_WINDOW: usize = 25;

/// The most blocks that a window can have.
pub const MAX_BLOCKS: usize = 2 * HOPS_PER_WINDOW;

/// Cosines, then sines, of all harmonics.
const TERMS: usize = 2 * HARMONICS;

/// `Σ_j sin(l π j/N) x_j` for every lane and l.
pub type SineSums = [[f64; HARMONICS]; LANES];

/// Moments of the nodes of a block, or of a part of it.
type Moments = [[f64; TERMS]; LANES];

/// Sines on a window of a fixed length, ready for use.
#[derive(Clone, Debug, PartialEq)]
pub struct SlidingSines {
    hop: usize,
    /// Nodes of the oldest block that lie in the window, none if all do.
    rest: usize,
    /// `cos(l π r/N)`, then `sin(l π r/N)`, for the nodes r of a block.
    basis: Vec<[f64; TERMS]>,
    /// `sin(l π o/N)`, then `cos(l π o/N)`, for the blocks of a window, the newest first.
    places: Vec<[f64; TERMS]>,
}

/// All that changes with a sample; good only for sines on the same window.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SlidingSinesState {
    /// Moments of the block that is filling up: of the nodes that will not lie in the window when the block is its oldest,
    /// then of the others.
    filling: Vec<f64>,
    /// Row of the newest block.
    newest: usize,
    /// Moments of the blocks as a ring: the whole blocks, then their last nodes.
    blocks: Vec<f64>,
}

impl SlidingSines {
    /// Sines on windows of so many intervals, 2 at least.
    #[must_use]
    pub fn new(intervals: usize, hop: usize) -> Self {
        let inner = intervals.saturating_sub(1).max(1);
        let turn = 2 * intervals as i64;
        let angle = |l: usize, node: i64| PI * (l as i64 * node).rem_euclid(turn) as f64 / intervals as f64;
        let row = |node: i64, first: fn(f64) -> f64, second: fn(f64) -> f64| {
            std::array::from_fn(|term| match term {
                0..HARMONICS => first(angle(term + 1, node)),
                _ => second(angle(term + 1 - HARMONICS, node)),
            })
        };
        let origin = |block: usize| intervals as i64 - ((block + 1) * hop) as i64;
        Self {
            hop,
            rest: inner % hop,
            basis: (0..hop).map(|r| row(r as i64, libm::cos, libm::sin)).collect(),
            places: (0..inner.div_ceil(hop)).map(|block| row(origin(block), libm::sin, libm::cos)).collect(),
        }
    }

    /// A state without samples; the only place that allocates.
    #[must_use]
    pub fn start(&self) -> SlidingSinesState {
        let [filling, blocks] = self.sizes();
        SlidingSinesState { filling: vec![0.0; filling], newest: 0, blocks: vec![0.0; blocks] }
    }

    fn sizes(&self) -> [usize; 2] {
        [2 * LANES * TERMS, 2 * self.places.len() * LANES * TERMS]
    }

    /// Whether a state, for instance one read from a file, has the shape that these sines need.
    #[must_use]
    pub fn accepts(&self, state: &SlidingSinesState) -> bool {
        [state.filling.len(), state.blocks.len()] == self.sizes() && state.newest < self.places.len()
    }

    /// Takes in one node of every lane, number `r` < hop of its block; the one with the greatest r ends the block. The state must
    /// be an accepted one.
    pub fn push(&self, state: &mut SlidingSinesState, r: usize, x: &[f64; LANES]) {
        debug_assert!(self.accepts(state));
        push(self, state, r, x);
    }

    /// The sums over the window that ends with the last block.
    #[must_use]
    pub fn sums(&self, state: &SlidingSinesState) -> SineSums {
        debug_assert!(self.accepts(state));
        sums(self, state)
    }
}

impl SlidingSinesState {
    /// Forgets all samples.
    pub fn clear(&mut self) {
        // Old blocks may stay, for they are overwritten before they come into a full window.
        self.filling.fill(0.0);
    }
}

fn moments(values: &[f64]) -> &[Moments] {
    values.as_chunks().0.as_chunks().0
}

fn moments_mut(values: &mut [f64]) -> &mut [Moments] {
    values.as_chunks_mut().0.as_chunks_mut().0
}

#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2"))]
fn push(sines: &SlidingSines, state: &mut SlidingSinesState, r: usize, x: &[f64; LANES]) {
    let [early, late] = moments_mut(&mut state.filling) else { return };
    let part = if r < sines.hop - sines.rest { &mut *early } else { &mut *late };
    let basis = &sines.basis[r];
    for (moment, x) in part.iter_mut().zip(x) {
        for (moment, basis) in moment.iter_mut().zip(basis) {
            *moment += basis * x;
        }
    }
    if r + 1 == sines.hop {
        let count = sines.places.len();
        state.newest = if state.newest + 1 >= count { 0 } else { state.newest + 1 };
        let (whole, last) = moments_mut(&mut state.blocks).split_at_mut(count);
        last[state.newest] = *late;
        let sum = whole[state.newest].as_flattened_mut().iter_mut();
        for ((sum, early), late) in sum.zip(early.as_flattened()).zip(late.as_flattened()) {
            *sum = early + late;
        }
        *early = [[0.0; TERMS]; LANES];
        *late = [[0.0; TERMS]; LANES];
    }
}

#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2"))]
fn sums(sines: &SlidingSines, state: &SlidingSinesState) -> SineSums {
    let count = sines.places.len();
    let (whole, last) = moments(&state.blocks).split_at(count);
    let mut result = [[0.0; HARMONICS]; LANES];
    for (lane, result) in result.iter_mut().enumerate() {
        let mut sums = [0.0; TERMS];
        let mut row = state.newest;
        for (block, place) in sines.places.iter().enumerate() {
            let cut = block + 1 == count && sines.rest > 0;
            let moments = if cut { &last[row][lane] } else { &whole[row][lane] };
            for ((sum, place), moment) in sums.iter_mut().zip(place).zip(moments) {
                *sum += place * moment;
            }
            row = if row == 0 { count - 1 } else { row - 1 };
        }
        let (cosines, sines) = sums.split_at(HARMONICS);
        for ((result, cosine), sine) in result.iter_mut().zip(cosines).zip(sines) {
            *result = cosine + sine;
        }
    }
    result
}
