//! Sliding windows: samples kept so that a window is one contiguous slice, and the integrals of the paper's kernels.

use multiversion::multiversion;
use serde::{Deserialize, Serialize};

use super::kernel::{Polynomial, ROWS_PER_AXIS, Weights, exponent_and_factor, psi};
use super::sliding::{MIN_LENGTH, SlidingState, SlidingSums, Way};

/// Ring buffers of several signals with a common cursor, each kept twice in a row.
///
/// Sample j is written at `j mod n` and at `j mod n + n`, so that the last n samples are always contiguous, oldest
/// first. A moving sum is then a plain dot product; nothing is ever subtracted, and nothing can drift.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Window {
    nodes: usize,
    signals: usize,
    next: usize,
    filled: usize,
    values: Vec<f64>,
}

impl Window {
    /// An empty window of `nodes` samples of `signals` signals; the only place that allocates.
    #[must_use]
    pub fn new(signals: usize, nodes: usize) -> Self {
        Self { nodes, signals, next: 0, filled: 0, values: vec![0.0; 2 * nodes * signals] }
    }

    /// Whether the shape is the one given and the cursor is within it; a state read from a file may fail this.
    #[must_use]
    pub fn has_shape(&self, signals: usize, nodes: usize) -> bool {
        self.nodes == nodes
            && self.signals == signals
            && self.values.len() == 2 * nodes * signals
            && self.next < nodes.max(1)
            && self.filled <= nodes
    }

    /// Forgets all samples.
    pub fn clear(&mut self) {
        // What is left behind is overwritten before the window is full again; the time this takes does not depend on its length.
        self.next = 0;
        self.filled = 0;
    }

    /// Number of samples since the last [`Window::clear`], at most the length of the window.
    #[must_use]
    pub fn filled(&self) -> usize {
        self.filled
    }

    /// Whether all nodes hold samples.
    #[must_use]
    pub fn is_full(&self) -> bool {
        self.filled == self.nodes
    }

    /// Takes in one sample of every signal; signals beyond the shape are ignored.
    pub fn push(&mut self, sample: &[f64]) {
        let nodes = self.nodes;
        if nodes == 0 {
            return;
        }
        for (ring, value) in self.values.chunks_exact_mut(2 * nodes).zip(sample) {
            ring[self.next] = *value;
            ring[self.next + nodes] = *value;
        }
        self.next = (self.next + 1) % nodes;
        self.filled = (self.filled + 1).min(nodes);
    }

    /// The window of one signal, oldest sample first; empty if there is no such signal.
    #[must_use]
    pub fn signal(&self, index: usize) -> &[f64] {
        let start = 2 * self.nodes * index + self.next;
        self.values.get(start..start + self.nodes).unwrap_or(&[])
    }
}

/// `Σ a_j b_j`, in eight partial sums: the order is fixed, so every platform gives the same bits, and the compiler
/// can use vector registers, the widest that the processor has.
#[must_use]
#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2"))]
pub fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut sums = [0.0; 8];
    let (blocks_a, blocks_b) = (a.chunks_exact(8), b.chunks_exact(8));
    let rest: f64 = blocks_a.remainder().iter().zip(blocks_b.remainder()).map(|(x, y)| x * y).sum();
    for (x, y) in blocks_a.zip(blocks_b) {
        for (sum, (x, y)) in sums.iter_mut().zip(x.iter().zip(y)) {
            *sum += x * y;
        }
    }
    ((sums[0] + sums[4]) + (sums[2] + sums[6])) + ((sums[1] + sums[5]) + (sums[3] + sums[7])) + rest
}

/// From this number of intervals on, moments of blocks are faster than a product per sample: measured by the benchmark `ratios`.
pub const BLOCKS_FROM: usize = 128;

/// Number of kernels: the rows of P(18), then that of the static load.
pub const KERNELS: usize = ROWS_PER_AXIS + 1;

/// The integrals of one test function φ over a window.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Integrals {
    /// `∫ φ'' (Y, Z) dτ`, m.
    pub position: [f64; 2],
    /// `∫ φ i_k²/gap_k² dτ`, A²/m².
    pub squares: [f64; 3],
    /// `∫ φ ω² (cos θ, sin θ) dτ`, rad²/s².
    pub rotating: [f64; 2],
}

/// One sample of what the paper's kernels are integrated against.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Sample {
    /// Position (Y, Z), m.
    pub position: [f64; 2],
    /// `i_k²/gap_k²` at the start and at the end of the interval that ends with the sample; at the sample, twice, if the current is
    /// continuous. A²/m².
    pub squares: [[f64; 3]; 2],
}

/// The integrals of the kernels of [`Weights::paper`] and [`Weights::static_load`] over a sliding window, at a cost that does not
/// depend on its length.
///
/// The weights of a [`Weights`] are those of its test function φ moved between its argument and the signal, which the two
/// null values of φ at the ends allow:
///
/// ```text
/// Σ_j held_start_j s_j + held_end_j e_j = h/6  Σ_j φ_j ((s_j + 2 e_j) + (2 s_{j+1} + e_{j+1}))
/// Σ_j node_j f_j                        = h/12 Σ_j φ_j (f_{j−1} + 10 f_j + f_{j+1})
/// ```
///
/// So one kernel serves each magnet, a polynomial on the inner nodes j = 1 … N − 1. That of the positions is one as well, but for
/// its two end values, which are added one by one.
#[derive(Clone, Debug, PartialEq)]
pub struct WindowSums {
    continuous: bool,
    /// h/6 or h/12.
    unit: f64,
    position: SlidingSums<2, 6, KERNELS>,
    /// Weights of the oldest and of the newest position.
    ends: [[f64; 2]; KERNELS],
    squares: SlidingSums<4, 8, KERNELS>,
}

/// All that changes with a sample; good only for sums of the same shape.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct WindowSumsState {
    /// Samples since the last clearing, counted up to two.
    seen: usize,
    /// The last sample and the one before.
    last: [Sample; 2],
    position: SlidingState,
    squares: SlidingState,
}

impl WindowSums {
    /// Sums over windows of so many intervals, 8 at least; `continuous` if the currents are, not held.
    #[must_use]
    pub fn new(intervals: usize, continuous: bool) -> Self {
        let way = if intervals < BLOCKS_FROM { Way::Direct } else { Way::Blocks };
        Self::by(way, intervals, continuous)
    }

    /// As [`WindowSums::new`], in a way of one's own choice.
    #[must_use]
    pub fn by(way: Way, intervals: usize, continuous: bool) -> Self {
        let length = intervals.saturating_sub(1).max(MIN_LENGTH);
        let h = 1.0 / intervals as f64;
        let weights: [Weights; KERNELS] = std::array::from_fn(|row| match row {
            ROWS_PER_AXIS.. => Weights::static_load(intervals),
            _ => Weights::paper(row, intervals),
        });
        let functions: [Polynomial; KERNELS] = std::array::from_fn(|row| match row {
            ROWS_PER_AXIS.. => static_load(),
            _ => paper(row, h),
        });
        let accelerations = std::array::from_fn(|row| coefficients(&second_difference(&functions[row], h)));
        Self {
            continuous,
            unit: if continuous { h / 12.0 } else { h / 6.0 },
            position: SlidingSums::new(length, &accelerations, way),
            ends: std::array::from_fn(|row| [weights[row].position[0], weights[row].position[intervals]]),
            squares: SlidingSums::new(length, &functions.map(|function| coefficients(&function)), way),
        }
    }

    /// A state without samples; the only place that allocates.
    #[must_use]
    pub fn start(&self) -> WindowSumsState {
        let (position, squares) = (self.position.start(), self.squares.start());
        WindowSumsState { seen: 0, last: [Sample::default(); 2], position, squares }
    }

    /// Whether a state, for instance one read from a file, has the shape that these sums need.
    #[must_use]
    pub fn accepts(&self, state: &WindowSumsState) -> bool {
        self.position.accepts(&state.position) && self.squares.accepts(&state.squares)
    }

    /// Takes in one sample; the integrals over the window that ends with it, once there is one.
    pub fn push(&self, state: &mut WindowSumsState, sample: &Sample) -> Option<[Integrals; KERNELS]> {
        push(self, state, sample)
    }
}

impl WindowSumsState {
    /// Forgets all samples.
    pub fn clear(&mut self) {
        self.seen = 0;
        self.last = [Sample::default(); 2];
        self.position.clear();
        self.squares.clear();
    }
}

/// What [`WindowSums::push`] does, for the widest registers that the processor has. The sums are the same with all of them.
#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2"))]
fn push(sums: &WindowSums, state: &mut WindowSumsState, sample: &Sample) -> Option<[Integrals; KERNELS]> {
    let [last, before] = state.last;
    state.last = [*sample, last];
    if state.seen == 0 {
        // What the kernels need of a sample is known when the next one has come.
        state.seen = 1;
        return None;
    }
    let combined: [f64; 4] = std::array::from_fn(|k| match k {
        3.. => 0.0,
        _ => sums.unit * combined(k, sums.continuous, [&before, &last, sample]),
    });
    let positions = sums.position.push(&mut state.position, &last.position);
    let squares = sums.squares.push(&mut state.squares, &combined);
    let oldest = sums.position.outgoing(&state.position)?;
    Some(std::array::from_fn(|row| {
        let [first, newest] = sums.ends[row];
        Integrals {
            position: std::array::from_fn(|axis| {
                positions[row][axis] + (first * oldest[axis] + newest * sample.position[axis])
            }),
            squares: std::array::from_fn(|k| squares[row][k]),
            rotating: [0.0; 2],
        }
    }))
}

/// What a test function weighs at the middle one of three samples for magnet k, in units of h/12 if the current is continuous, else of h/6.
#[inline(always)]
pub(super) fn combined(k: usize, continuous: bool, [before, last, sample]: [&Sample; 3]) -> f64 {
    if continuous {
        return before.squares[0][k] + 10.0 * last.squares[0][k] + sample.squares[0][k];
    }
    let [[start, end], [next_start, next_end]] =
        [last.squares.map(|square| square[k]), sample.squares.map(|square| square[k])];
    (start + 2.0 * end) + (2.0 * next_start + next_end)
}

/// φ of [`Weights::paper`] as a polynomial in v ∈ [−1, 1], τ = (1 + v)/2: the central difference of
/// [`psi_between_nodes`](super::kernel::psi_between_nodes).
fn paper(row: usize, h: f64) -> Polynomial {
    let (n, factor) = exponent_and_factor(row);
    let [from_start, from_end] = [0.5, -0.5].map(|half| Polynomial::new([0.5, half]));
    let [cut_start, cut_end] = [0.5, -0.5].map(|half| Polynomial::new([(1.0 - h * h) / 4.0, half, 0.25]));
    let powers = (2..n).fold(Polynomial::power(0), |product, _| product.times(&from_start));
    let primitive = powers.times(&cut_start).times(&from_end).times(&cut_end);
    // Half a step in τ is a step h in v.
    differences(&primitive, h, 1).scaled(2.0 * factor)
}

/// φ of [`Weights::static_load`] as a polynomial in v.
fn static_load() -> Polynomial {
    let [from_start, from_end] = [0.5, -0.5].map(|half| Polynomial::new([0.5, half]));
    let product = from_start.times(&from_end);
    product.times(&product).times(&product).scaled(1.0 / psi(3).integral())
}

/// `(φ(v + 2h) − 2 φ(v) + φ(v − 2h))/h`.
fn second_difference(function: &Polynomial, h: f64) -> Polynomial {
    differences(function, 2.0 * h, 2).scaled(8.0 * h)
}

/// `(p(v + d) ∓ p(v − d))/(2 dⁿ)` less its terms of order below n; n = 1 for the difference, 2 for the sum. No term is the
/// difference of others.
fn differences(p: &Polynomial, d: f64, n: usize) -> Polynomial {
    let mut result = vec![0.0; p.coefficients.len().saturating_sub(n)];
    for (k, coefficient) in p.coefficients.iter().enumerate() {
        let mut choose = 1.0;
        for i in 0..=k {
            if i >= n && (i - n).is_multiple_of(2) {
                result[k - i] += coefficient * choose * libm::pow(d, (i - n) as f64);
            }
            choose = choose * (k - i) as f64 / (i + 1) as f64;
        }
    }
    Polynomial::new(result)
}

fn coefficients<const TERMS: usize>(polynomial: &Polynomial) -> [f64; TERMS] {
    std::array::from_fn(|term| polynomial.coefficients.get(term).copied().unwrap_or(0.0))
}
