//! Parallel work on all processors.

use std::sync::OnceLock;
use std::sync::atomic::{AtomicU64, Ordering};

use rayon::iter::{IndexedParallelIterator, IntoParallelIterator, ParallelIterator};

use crate::progress::Progress;

/// Does the work of each index in the thread pool; the results are in order.
pub fn in_order<T: Send + Sync>(count: usize, work: &(dyn Fn(usize) -> T + Sync)) -> Vec<T> {
    let results: Vec<OnceLock<T>> = (0..count).map(|_| OnceLock::new()).collect();
    each(count, &|index| {
        results[index].get_or_init(|| work(index));
    });
    results.into_iter().filter_map(OnceLock::into_inner).collect()
}

/// The same with a progress bar.
pub fn in_order_shown<T: Send + Sync>(title: &'static str, count: usize, work: &(dyn Fn(usize) -> T + Sync)) -> Vec<T> {
    let (progress, done) = (Progress::new(title, count as u64), AtomicU64::new(0));
    in_order(count, &|index| {
        let result = work(index);
        progress.tell(done.fetch_add(1, Ordering::Relaxed) + 1);
        result
    })
}

/// Not generic, so that the code of the pool is compiled once and not for every kind of work.
fn each(count: usize, work: &(dyn Fn(usize) + Sync)) {
    (0..count).into_par_iter().with_max_len(1).for_each(work);
}
