//! The samples of a sliding window, kept so that a window is one contiguous slice.

use serde::{Deserialize, Serialize};

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
        self.next = 0;
        self.filled = 0;
        self.values.fill(0.0);
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
/// can use vector registers.
#[must_use]
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
