//! Weighted sums over a sliding window whose weights are polynomials: the same cost at every length, and no drift.
//!
//! Wanted after every sample, for several kernels `w` of degree `TERMS − 1` and several signals x (the lanes), is
//!
//! ```text
//! Σ_j w(v_j) x_j        v_j = (2 j − (L − 1))/(L + 1),   j = 0 … L − 1 from the oldest sample to the newest
//! ```
//!
//! so that v = ±1 are the instants just outside the window.
//!
//! # Two ways
//!
//! [`Way::Direct`] multiplies every sample of the window by its weight. [`Way::Blocks`] never looks at most of them:
//! time is cut into blocks of `B = ⌊L/2⌋` samples, and the window is a suffix of the oldest block, one whole block, and a prefix
//! of the block that is filling up.
//!
//! ```text
//!    block c        block c + 1      block c + 2
//! |······sssssss|mmmmmmmmmmmmmmm|pppppppp·······|
//!        └───────────── window ─────────┘
//! ```
//!
//! A block is known by its moments `M_d = Σ u^d x` about its own middle, u ∈ (−1, 1); a kernel becomes a polynomial in u by a
//! Taylor shift to the middle of the block (`v = v_c + ρ u`, ρ = B/(L + 1)), and its sum over the block is a combination of moments. The
//! moments of the prefix grow by one sample at a time and become those of the whole block. The sums over suffixes are
//! made one block ahead of their use: while block c + 2 fills up, block c + 1 is read backwards, one sample per step, and the sum
//! over the suffix so far is written to a table, with the weights that it will have when the window begins there.
//!
//! Every step thus does the same work, whatever L: there is no step that pays for others. Nothing is ever subtracted, and
//! every sum begins anew with its block: what rounding does to a sample is gone when the sample has left the window. This
//! is the two-stack queue of sliding aggregation, made free of its flips by the fixed length of the window.
//!
//! Sums are elementwise over lanes in a fixed order, without fused operations, so that every width of vector instructions
//! gives the same bits.

use serde::{Deserialize, Serialize};

/// How the sums are computed. The results agree to rounding.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Way {
    /// One multiplication per sample of the window, kernel and lane; cost in proportion to the length.
    Direct,
    /// Moments of blocks; the same cost at every length.
    Blocks,
}

/// The shortest window, in samples.
pub const MIN_LENGTH: usize = 4;

/// A sum for every kernel and lane.
pub type Sums<const LANES: usize, const KERNELS: usize> = [[f64; LANES]; KERNELS];

/// Moments of a block, from the zeroth.
type Moments<const LANES: usize, const TERMS: usize> = [[f64; LANES]; TERMS];

/// Kernels on a sliding window of fixed length, ready for use.
#[derive(Clone, Debug, PartialEq)]
pub struct SlidingSums<const LANES: usize, const TERMS: usize, const KERNELS: usize> {
    length: usize,
    way: Way,
    /// Samples per block.
    block: usize,
    /// `C(e, d) a_e ρ^d` at `[d][e − d]`, kernels side by side: Horner's rule in v_c gives the coefficient of u^d.
    shift: [[[f64; KERNELS]; TERMS]; TERMS],
    /// The kernels at the samples of the window; empty for [`Way::Blocks`].
    weights: Vec<[f64; KERNELS]>,
}

/// All that changes with a sample; good only for sums of the same shape.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SlidingState {
    /// Samples taken in since the last clearing, at most L + 1.
    filled: usize,
    /// Row of the newest sample in `samples`.
    newest: usize,
    /// The last L + 1 samples as a ring of rows of lanes; twice in a row for [`Way::Direct`], so that a window is one slice.
    samples: Vec<f64>,
    /// Samples in the block that is filling up.
    in_block: usize,
    /// Whether the table of suffixes is read upwards.
    mirrored: bool,
    /// Sums over the suffixes of the oldest block, each replaced, once read, by one of the block after.
    suffixes: Vec<f64>,
    /// Moments of the suffix that is being made, of the whole block, and of the prefix, one after the other.
    moments: Vec<f64>,
}

impl<const LANES: usize, const TERMS: usize, const KERNELS: usize> SlidingSums<LANES, TERMS, KERNELS> {
    /// Sums over `length` samples with the kernels `Σ_d coefficients[d] v^d`.
    ///
    /// # Panics
    /// If the length is below [`MIN_LENGTH`].
    #[must_use]
    pub fn new(length: usize, kernels: &[[f64; TERMS]; KERNELS], way: Way) -> Self {
        assert!(length >= MIN_LENGTH, "a sliding window of {length} samples: at least {MIN_LENGTH} are wanted");
        let block = length / 2;
        let ratio = block as f64 / (length + 1) as f64;
        let mut shift = [[[0.0; KERNELS]; TERMS]; TERMS];
        let mut scale = 1.0;
        for (d, row) in shift.iter_mut().enumerate() {
            let mut choose = 1.0;
            for e in d..TERMS {
                for (value, kernel) in row[e - d].iter_mut().zip(kernels) {
                    *value = choose * kernel[e] * scale;
                }
                choose = choose * (e + 1) as f64 / (e + 1 - d) as f64;
            }
            scale *= ratio;
        }
        let mut sums = Self { length, way, block, shift, weights: Vec::new() };
        if way == Way::Direct {
            let at = |j: usize| (2.0 * j as f64 - (length - 1) as f64) / (length + 1) as f64;
            sums.weights = (0..length).map(|j| kernels.map(|kernel| horner(&kernel, at(j)))).collect();
        }
        sums
    }

    /// Number of samples in a window.
    #[must_use]
    pub fn length(&self) -> usize {
        self.length
    }

    /// A state without samples; the only place that allocates.
    #[must_use]
    pub fn start(&self) -> SlidingState {
        let [samples, suffixes, moments] = self.sizes();
        SlidingState {
            filled: 0,
            newest: 0,
            samples: vec![0.0; samples],
            in_block: 0,
            mirrored: false,
            suffixes: vec![0.0; suffixes],
            moments: vec![0.0; moments],
        }
    }

    fn sizes(&self) -> [usize; 3] {
        let ring = (self.length + 1) * LANES;
        match self.way {
            Way::Direct => [2 * ring, 0, 0],
            Way::Blocks => [ring, self.suffixes() * KERNELS * LANES, 3 * TERMS * LANES],
        }
    }

    /// Number of suffixes that are in use, and rows of the table.
    fn suffixes(&self) -> usize {
        self.length - self.block - 1
    }

    /// Whether a state, for instance one read from a file, has the shape that these sums need.
    #[must_use]
    pub fn accepts(&self, state: &SlidingState) -> bool {
        [state.samples.len(), state.suffixes.len(), state.moments.len()] == self.sizes()
            && state.filled <= self.length + 1
            && state.newest <= self.length
            && state.in_block < self.block
    }

    /// Takes in one sample of every lane and sums over the window that ends with it; the sums mean something once
    /// [`SlidingSums::is_full`] says so. The state must be an accepted one.
    #[inline(always)]
    pub fn push(&self, state: &mut SlidingState, sample: &[f64; LANES]) -> Sums<LANES, KERNELS> {
        debug_assert!(self.accepts(state));
        state.newest = if state.newest >= self.length { 0 } else { state.newest + 1 };
        state.filled = (state.filled + 1).min(self.length + 1);
        rows_mut(&mut state.samples)[state.newest] = *sample;
        match self.way {
            Way::Direct => {
                rows_mut(&mut state.samples)[state.newest + self.length + 1] = *sample;
                self.direct(state)
            }
            Way::Blocks => self.blocks(state, sample),
        }
    }

    /// Whether a window is full.
    #[must_use]
    pub fn is_full(&self, state: &SlidingState) -> bool {
        state.filled >= self.length
    }

    /// The sample before the oldest of the window, if there was one since the last clearing.
    #[must_use]
    pub fn outgoing(&self, state: &SlidingState) -> Option<[f64; LANES]> {
        // The ring has one row more than the window, so this one is the next to be written.
        let row = if state.newest >= self.length { 0 } else { state.newest + 1 };
        (state.filled > self.length).then(|| rows(&state.samples)[row])
    }

    #[inline(always)]
    fn direct(&self, state: &SlidingState) -> Sums<LANES, KERNELS> {
        let first = state.newest + 2;
        let window = &rows(&state.samples)[first..first + self.length];
        // Two partial sums per lane, of even and odd samples, halve the wait for the result of an addition.
        let mut sums = [[[0.0; LANES]; KERNELS]; 2];
        let (pairs, last) = window.as_chunks::<2>();
        let (weights, last_weights) = self.weights.as_chunks::<2>();
        for (pair, weights) in pairs.iter().zip(weights) {
            for ((sums, sample), weights) in sums.iter_mut().zip(pair).zip(weights) {
                combine(sums, weights, sample);
            }
        }
        for (sample, weights) in last.iter().zip(last_weights) {
            combine(&mut sums[0], weights, sample);
        }
        let [mut even, odd] = sums;
        add(&mut even, &odd);
        even
    }

    #[inline(always)]
    fn blocks(&self, state: &mut SlidingState, sample: &[f64; LANES]) -> Sums<LANES, KERNELS> {
        let k = state.in_block;
        let (block, length) = (self.block as f64, self.length as f64);
        let u = (2 * k + 1) as f64 / block - 1.0;
        // The sample of the block before that lies as far from its end as this one from the beginning of its own. In the
        // first block there is none, and the suffixes made of what is found instead are never used.
        let back = 2 * k + 1;
        let row = if state.newest >= back { state.newest - back } else { state.newest + self.length + 1 - back };
        let mirror_image = rows(&state.samples)[row];

        let (moments, _) = state.moments.as_chunks_mut::<LANES>();
        let ([suffix, whole, prefix], _) = moments.as_chunks_mut::<TERMS>() else {
            // The shape of the state was checked.
            return [[0.0; LANES]; KERNELS];
        };
        gather(prefix, u, sample);
        gather(suffix, -u, &mirror_image);

        // Middles of the blocks in the window, the newest sample being number k of its block.
        let newest = (length - 1.0 - 2.0 * k as f64 + block - 1.0) / (length + 1.0);
        let before = newest - 2.0 * block / (length + 1.0);
        let mut sums = self.evaluate(whole, before);
        add(&mut sums, &self.evaluate(prefix, newest));
        if k < self.suffixes() {
            let (table, _) = state.suffixes.as_chunks_mut::<LANES>();
            let (table, _) = table.as_chunks_mut::<KERNELS>();
            let place = if state.mirrored { k } else { self.suffixes() - 1 - k };
            add(&mut sums, &table[place]);
            // A suffix of k + 1 samples, when the window begins with it.
            table[place] = self.evaluate(suffix, (2.0 * (k + 1) as f64 - block - length) / (length + 1.0));
        }

        state.in_block += 1;
        if state.in_block == self.block {
            state.in_block = 0;
            state.mirrored = !state.mirrored;
            *whole = *prefix;
            *prefix = [[0.0; LANES]; TERMS];
            *suffix = [[0.0; LANES]; TERMS];
        }
        sums
    }

    /// The sums over a block with its middle at `v`.
    #[inline(always)]
    fn evaluate(&self, moments: &Moments<LANES, TERMS>, v: f64) -> Sums<LANES, KERNELS> {
        let mut sums = [[0.0; LANES]; KERNELS];
        for (d, (moment, terms)) in moments.iter().zip(&self.shift).enumerate() {
            let mut coefficient = terms[TERMS - 1 - d];
            for term in terms[..TERMS - 1 - d].iter().rev() {
                for (coefficient, term) in coefficient.iter_mut().zip(term) {
                    *coefficient = *coefficient * v + term;
                }
            }
            combine(&mut sums, &coefficient, moment);
        }
        sums
    }
}

impl SlidingState {
    /// Forgets all samples.
    pub fn clear(&mut self) {
        (self.filled, self.newest, self.in_block, self.mirrored) = (0, 0, 0, false);
        // Old samples and suffixes may stay, for they are overwritten before they come into a full window: the time this
        // takes does not depend on the length of the window.
        self.moments.fill(0.0);
    }

    /// Number of samples since the last clearing, counted up to one more than the window holds.
    #[must_use]
    pub fn filled(&self) -> usize {
        self.filled
    }
}

/// `Σ_d coefficients[d] v^d`.
fn horner(coefficients: &[f64], v: f64) -> f64 {
    coefficients.iter().rev().fold(0.0, |sum, coefficient| sum * v + coefficient)
}

fn rows<const LANES: usize>(values: &[f64]) -> &[[f64; LANES]] {
    values.as_chunks().0
}

fn rows_mut<const LANES: usize>(values: &mut [f64]) -> &mut [[f64; LANES]] {
    values.as_chunks_mut().0
}

/// `M_d += u^d x`.
#[inline(always)]
fn gather<const LANES: usize, const TERMS: usize>(moments: &mut Moments<LANES, TERMS>, u: f64, x: &[f64; LANES]) {
    let mut power = 1.0;
    for moment in moments {
        for (moment, x) in moment.iter_mut().zip(x) {
            *moment += power * x;
        }
        power *= u;
    }
}

/// `sums[kernel] += weights[kernel] x`.
#[inline(always)]
fn combine<const LANES: usize, const KERNELS: usize>(
    sums: &mut Sums<LANES, KERNELS>,
    weights: &[f64; KERNELS],
    x: &[f64; LANES],
) {
    for (sum, weight) in sums.iter_mut().zip(weights) {
        for (sum, x) in sum.iter_mut().zip(x) {
            *sum += weight * x;
        }
    }
}

#[inline(always)]
fn add<const LANES: usize, const KERNELS: usize>(sums: &mut Sums<LANES, KERNELS>, more: &Sums<LANES, KERNELS>) {
    for (sum, more) in sums.iter_mut().flatten().zip(more.iter().flatten()) {
        *sum += more;
    }
}
