//! Sliding windows stored as contiguous slices, and the integrals of the paper's kernels.

use serde::{Deserialize, Serialize};

use super::kernel::{ROWS_PER_AXIS, Weights};
use crate::bearing::array;

/// Ring buffers of several signals with a common cursor, each stored twice in a row.
///
/// Sample j is written at `j mod n` and at `j mod n + n`, so that the last n samples are always contiguous, oldest first. A moving sum is then a plain dot
/// product, without subtractions and so without drift.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Window {
    nodes: usize,
    next: usize,
    filled: usize,
    values: Vec<f64>,
}

impl Window {
    /// Discards all samples.
    pub fn clear(&mut self) {
        // Old values are overwritten before the window is full again; clearing takes the same time for any length.
        self.next = 0;
        self.filled = 0;
    }

    /// Number of nodes that hold samples.
    pub fn filled(&self) -> usize {
        self.filled
    }

    /// Appends one sample of each signal.
    pub fn push(&mut self, sample: &[f64; SIGNALS]) {
        let nodes = self.nodes;
        for (ring, value) in self.values.chunks_exact_mut(2 * nodes).zip(sample) {
            ring[self.next] = *value;
            ring[self.next + nodes] = *value;
        }
        self.next = (self.next + 1) % nodes;
        self.filled = (self.filled + 1).min(nodes);
    }

    /// The window of one signal, oldest sample first.
    pub fn signal(&self, index: usize) -> &[f64] {
        let start = 2 * self.nodes * index + self.next;
        &self.values[start..start + self.nodes]
    }
}

/// `Σ a_j b_j` in eight partial sums: a fixed order, so that the result is the same on every platform, and suitable for vector registers.
pub fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut sums = [0.0; 8];
    let (blocks_a, blocks_b) = (a.chunks_exact(8), b.chunks_exact(8));
    let remainder: f64 = blocks_a.remainder().iter().zip(blocks_b.remainder()).map(|(x, y)| x * y).sum();
    for (x, y) in blocks_a.zip(blocks_b) {
        for (sum, (x, y)) in sums.iter_mut().zip(x.iter().zip(y)) {
            *sum += x * y;
        }
    }
    ((sums[0] + sums[4]) + (sums[2] + sums[6])) + ((sums[1] + sums[5]) + (sums[3] + sums[7])) + remainder
}

/// Signals of a window: two positions, then `i_k²/gap_k²` at the start and at the end of each interval.
const SIGNALS: usize = 8;

/// The integrals of one test function φ over a window.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Integrals {
    /// `∫ φ'' (Y, Z) dτ`, m.
    pub position: [f64; 2],
    /// `∫ φ i_k²/gap_k² dτ`, A²/m².
    pub squares: [f64; 3],
}

/// One sample of the signals that the paper's kernels weight.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sample {
    /// Position (Y, Z), m.
    pub position: [f64; 2],
    /// `i_k²/gap_k²` at the start and at the end of the interval that ends with the sample; both are the value at the sample if the
    /// current is continuous. A²/m².
    pub squares: [[f64; 3]; 2],
}

/// The integrals of the kernels of [`Weights::paper`] and [`Weights::static_load`] over a sliding window: finite impulse responses.
#[derive(Clone, Debug, PartialEq)]
pub struct WindowSums {
    continuous: bool,
    /// Of the rows of P(18), and of the static load.
    pub rows: [Weights; ROWS_PER_AXIS],
    static_load: Weights,
}

impl WindowSums {
    /// Sums over windows of this many intervals, at least 8; `continuous` if the currents are continuous, not held.
    pub fn new(intervals: usize, continuous: bool) -> Self {
        let rows = std::array::from_fn(|row| Weights::paper(row, intervals));
        Self { continuous, rows, static_load: Weights::static_load(intervals) }
    }

    fn nodes(&self) -> usize {
        self.static_load.position.len()
    }

    /// A window without samples; the only place that allocates.
    pub fn start(&self) -> Window {
        let nodes = self.nodes();
        Window { nodes, next: 0, filled: 0, values: vec![0.0; 2 * nodes * SIGNALS] }
    }

    /// Whether a window, for instance one read from a file, has the shape that these sums need.
    pub fn accepts(&self, window: &Window) -> bool {
        let nodes = self.nodes();
        window.nodes == nodes
            && window.values.len() == 2 * nodes * SIGNALS
            && window.next < nodes
            && window.filled <= nodes
    }

    /// Appends a sample; once the window is full, returns the integrals of the rows and of the static load over the window that ends with it.
    pub fn push(&self, window: &mut Window, sample: &Sample) -> Option<([Integrals; ROWS_PER_AXIS], Integrals)> {
        let [y, z] = sample.position;
        let [[s1, s2, s3], [e1, e2, e3]] = sample.squares;
        window.push(&[y, z, s1, s2, s3, e1, e2, e3]);
        if window.filled < window.nodes {
            return None;
        }
        let integrals = |Weights { position, held_start, held_end, node }: &Weights| Integrals {
            position: array::from_fn(|axis| dot(position, window.signal(axis))),
            squares: array::from_fn(|k| match self.continuous {
                true => dot(node, window.signal(5 + k)),
                false => dot(held_start, window.signal(2 + k)) + dot(held_end, window.signal(5 + k)),
            }),
        };
        Some((self.rows.each_ref().map(integrals), integrals(&self.static_load)))
    }
}
