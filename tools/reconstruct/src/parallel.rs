//! Loops that use all cores with the feature `rayon` and one thread without it. Results are the same.

#[cfg(feature = "rayon")]
use rayon::prelude::*;

/// Calls `work` with the number and the values of each chunk of `size` values; returns the results in order.
pub(crate) fn chunks<T: Send, R: Send>(
    values: &mut [T],
    size: usize,
    work: impl Fn(usize, &mut [T]) -> R + Sync,
) -> Vec<R> {
    #[cfg(feature = "rayon")]
    let chunks = values.par_chunks_mut(size);
    #[cfg(not(feature = "rayon"))]
    let chunks = values.chunks_mut(size);
    chunks.enumerate().map(|(number, chunk)| work(number, chunk)).collect()
}

/// Calls `work` with each number below `count`; returns the results in order.
pub(crate) fn map<R: Send>(count: u32, work: impl Fn(u32) -> R + Sync + Send) -> Vec<R> {
    #[cfg(feature = "rayon")]
    let numbers = (0..count).into_par_iter();
    #[cfg(not(feature = "rayon"))]
    let numbers = 0..count;
    numbers.map(work).collect()
}

/// Sorts values of which no two are equal.
pub(crate) fn sort<T: Ord + Send>(values: &mut [T]) {
    #[cfg(feature = "rayon")]
    values.par_sort_unstable();
    #[cfg(not(feature = "rayon"))]
    values.sort_unstable();
}
