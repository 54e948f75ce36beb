//! Work on all processors.

use rayon::iter::{IndexedParallelIterator, IntoParallelIterator, ParallelIterator};

/// Does the work of every index on the pool of the program; the results in order.
pub fn in_order<T: Send>(count: usize, work: &(dyn Fn(usize) -> T + Sync)) -> Vec<T> {
    (0..count).into_par_iter().with_max_len(1).map(work).collect()
}
