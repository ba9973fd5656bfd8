//! From merges in any order to SciPy's linkage matrix or to labels.
//!
//! A cluster is identified by its *representative*, the smallest index among its points. All
//! algorithms of this crate find the same set of merges, because the key by which pairs are
//! chosen is a strict order; this module sorts the merges into the order of greedy search.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use crate::error::Error;
use crate::parallel::Workers;
use crate::sorting::sort;
use mograft_machine::memory::{allocate, collect, with_capacity};

/// Marks a missing merge.
const NONE: u32 = u32::MAX;

/// The union of two clusters.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Merge {
    /// The smaller representative, which becomes that of the union.
    pub low: u32,
    /// The larger representative.
    pub high: u32,
    /// The distance of the two clusters, or its square; the same for all merges of a list.
    pub height: f64,
}

impl Merge {
    /// The merge of clusters `a` and `b`, in either order.
    pub fn new(a: u32, b: u32, height: f64) -> Self {
        Self { low: a.min(b), high: a.max(b), height }
    }

    /// The key by which merges are chosen, as integers of the same order.
    fn key(&self) -> (u64, u32, u32) {
        // Floats that are not negative have the order of their bits.
        (self.height.to_bits(), self.low, self.high)
    }
}

/// SciPy's linkage matrix: `n - 1` rows (cluster, cluster, height, size).
///
/// `merges` are all merges of `n` points; every merge stands behind those of its parts. Rows have
/// the order of greedy search: the least key among the merges whose parts exist. `to_height` maps
/// the height of a merge to that of its row. Takes O(n log n) time.
///
/// # Errors
///
/// [`Error::OutOfMemory`], and [`Error::Stopped`] if the progress callback requests a stop.
pub(crate) fn linkage_matrix(
    workers: &Workers<'_>,
    n: usize,
    merges: &[Merge],
    to_height: impl Fn(f64) -> f64,
) -> Result<Vec<[f64; 4]>, Error> {
    let (parents, mut n_missing) = merge_parents(workers, n, merges)?;
    let keys = merges.iter().enumerate();
    let mut order = collect(keys.map(|(index, merge)| (merge.height.to_bits(), index as u32)))?;
    sort(workers, &mut order)?;

    // Number and size of the cluster of each representative.
    let mut clusters: Vec<(u32, u32)> = collect((0..n as u32).map(|point| (point, 1)))?;
    let mut rows = with_capacity(merges.len())?;
    let mut ready = BinaryHeap::from(with_capacity(n_simultaneous(&order))?);
    for same_height in order.chunk_by(|a, b| a.0 == b.0) {
        let heap_entry = |merge: u32| Reverse((merges[merge as usize].key(), merge));
        let indices = same_height.iter().map(|&(_, index)| index);
        ready.extend(
            indices
                .filter(|&index| n_missing[index as usize] == 0)
                .map(heap_entry),
        );
        while let Some(Reverse((_, index))) = ready.pop() {
            workers.check_item(rows.len())?;
            let merge = merges[index as usize];
            let parts = [merge.low, merge.high].map(|rep| clusters[rep as usize]);
            let [(a, size_a), (b, size_b)] = parts;
            let size = size_a + size_b;
            clusters[merge.low as usize] = ((n + rows.len()) as u32, size);
            let height = to_height(merge.height);
            rows.push([f64::from(a.min(b)), f64::from(a.max(b)), height, f64::from(size)]);

            let parent = parents[index as usize];
            if parent != NONE {
                n_missing[parent as usize] -= 1;
                // A parent of larger height is ready when its height comes.
                if n_missing[parent as usize] == 0
                    && merges[parent as usize].height.to_bits() == same_height[0].0
                {
                    ready.push(heap_entry(parent));
                }
            }
        }
    }
    Ok(rows)
}

/// The largest count of merges at the same height, given the merges sorted by height.
fn n_simultaneous(order: &[(u64, u32)]) -> usize {
    let same_height = order.chunk_by(|a, b| a.0 == b.0);
    same_height.map(<[_]>::len).max().unwrap_or(0)
}

/// For each merge, the merge that its union is part of, and how many of its parts are unions.
fn merge_parents(
    workers: &Workers<'_>,
    n: usize,
    merges: &[Merge],
) -> Result<(Vec<u32>, Vec<u8>), Error> {
    let mut latest = allocate(NONE, n)?;
    let mut parents = allocate(NONE, merges.len())?;
    let mut n_unions = allocate(0, merges.len())?;
    for (index, merge) in merges.iter().enumerate() {
        workers.check_item(index)?;
        for representative in [merge.low, merge.high] {
            let part = latest[representative as usize];
            if part != NONE {
                parents[part as usize] = index as u32;
                n_unions[index] += 1;
            }
        }
        latest[merge.low as usize] = index as u32;
    }
    Ok((parents, n_unions))
}

/// The cluster of each of `n` points, numbered from 0 in the order of the representatives.
///
/// `merges` may be in any order. Takes O(n) time.
///
/// # Errors
///
/// [`Error::OutOfMemory`], and [`Error::Stopped`] if the progress callback requests a stop.
pub(crate) fn labels(workers: &Workers<'_>, n: usize, merges: &[Merge]) -> Result<Vec<i64>, Error> {
    // Every point except the smallest of its cluster points to a smaller point of that cluster.
    let mut targets: Vec<u32> = collect(0..n as u32)?;
    for (index, merge) in merges.iter().enumerate() {
        workers.check_item(index)?;
        targets[merge.high as usize] = merge.low;
    }
    let mut labels = with_capacity(n)?;
    let mut n_clusters = 0;
    for (point, &target) in targets.iter().enumerate() {
        workers.check_item(point)?;
        if target as usize == point {
            labels.push(n_clusters);
            n_clusters += 1;
        } else {
            labels.push(labels[target as usize]);
        }
    }
    Ok(labels)
}

#[cfg(test)]
mod tests {
    use super::*;
    use mograft_machine::instructions::Isa;

    #[test]
    fn linkage_matrix_unordered_merges_gives_greedy_order() {
        // Four points on a line and two far away; all but the last merge have the same height.
        let merges = [
            Merge::new(4, 5, 1.0),
            Merge::new(3, 2, 1.0),
            Merge::new(0, 1, 1.0),
            Merge::new(2, 0, 1.0),
            Merge::new(4, 0, 3.0),
        ];
        let workers = Workers::new(1, Isa::best(), None);
        let rows = linkage_matrix(&workers, 6, &merges, |height| height).unwrap();
        let expected = [
            [0.0, 1.0, 1.0, 2.0],
            [2.0, 3.0, 1.0, 2.0],
            [6.0, 7.0, 1.0, 4.0],
            [4.0, 5.0, 1.0, 2.0],
            [8.0, 9.0, 3.0, 6.0],
        ];
        assert_eq!(rows, expected);
    }

    #[test]
    fn labels_of_merges_count_from_first_point() {
        let merges = [Merge::new(1, 4, 0.5), Merge::new(2, 1, 0.7)];
        let workers = Workers::new(1, Isa::best(), None);
        assert_eq!(labels(&workers, 6, &merges).unwrap(), [0, 1, 1, 2, 1, 3]);
    }
}
