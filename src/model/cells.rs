//! Samples of a window taken together in cells, where the noise of every single one is reckoned with.
//!
//! What noise does needs the test functions to a per cent, not to the last digit, and these are smooth: neighbouring samples
//! of a long window have nearly the same weights. So samples are taken together, as many as leave [`CELLS_PER_HOP`] cells or more
//! to a hop; windows of less than 200 intervals keep every sample a cell of its own. A cell then spans at most a sixteenth of a
//! period of the fastest test function, and a function that is replaced by its mean there loses 1 % of its square at most.
//!
//! The first and the last sample of every window are cells by themselves, for there the weight of a position is out of
//! proportion to its neighbours. As windows move by whole hops, the pattern of cells repeats with every hop, and every window
//! consists of whole cells.

/// At least so many cells are in a hop of as many samples or more.
pub const CELLS_PER_HOP: usize = 4;

/// How the samples of a window and of a hop are taken together.
#[derive(Clone, Debug, PartialEq)]
pub struct Cells {
    /// Numbers of the samples in a hop that end a cell, ascending; the last of a hop ends one.
    ends: Vec<usize>,
    /// How many samples each cell of a window has, oldest first.
    sizes: Vec<usize>,
}

impl Cells {
    /// The cells of windows of so many intervals that move by `hop` samples and end with the last sample of a hop.
    #[must_use]
    pub fn new(intervals: usize, hop: usize) -> Self {
        let size = (hop / CELLS_PER_HOP).max(1);
        let last = hop - 1;
        // The sample of a hop with which windows begin.
        let first = (last + hop - intervals % hop) % hop;
        let mut ends = Vec::new();
        let mut from = 0;
        for single in [first.min(last), last] {
            let many = single.saturating_sub(from);
            let pieces = many.div_ceil(size);
            ends.extend((1..=pieces).map(|piece| from + piece * many / pieces - 1));
            if single >= from {
                ends.push(single);
            }
            from = single + 1;
        }
        let mut sizes = Vec::new();
        let mut size = 0;
        for node in 0..=intervals {
            size += 1;
            if ends.binary_search(&((first + node) % hop)).is_ok() {
                sizes.push(size);
                size = 0;
            }
        }
        Self { ends, sizes }
    }

    /// Whether the sample with this number in its hop is the last of its cell.
    #[must_use]
    pub fn ends(&self, sample: usize) -> bool {
        self.ends.binary_search(&sample).is_ok()
    }

    /// How many cells a hop has.
    #[must_use]
    pub fn per_hop(&self) -> usize {
        self.ends.len()
    }

    /// How many samples each cell of a window has, oldest first.
    #[must_use]
    pub fn sizes(&self) -> &[usize] {
        &self.sizes
    }
}
