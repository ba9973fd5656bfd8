//! Merges, in whatever order they were found, to the tree or the labels that they mean.
//!
//! A cluster is known by its *representative*, the smallest index among its points. Every
//! algorithm of this crate hands over the same set of merges, because the key by which
//! they are chosen is strict; here they take their one order and get written.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// No cluster, no merge.
const NONE: u32 = u32::MAX;

/// Two clusters that became one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Merge {
    /// Representative of the cluster that holds the smaller index; it becomes the union's.
    pub low: u32,
    /// Representative of the other.
    pub high: u32,
    /// Distance of the farthest pair between them, or its square: the algorithm's choice.
    pub height: f64,
}

impl Merge {
    /// The merge of two clusters, given in any order.
    pub fn new(a: u32, b: u32, height: f64) -> Self {
        Self { low: a.min(b), high: a.max(b), height }
    }

    /// The key by which merges are chosen, as integers of the same order.
    fn key(&self) -> (u64, u32, u32) {
        // The bits of floats that are not negative rise with them.
        (self.height.to_bits(), self.low, self.high)
    }
}

/// The rows of SciPy's linkage matrix, `n - 1` times (cluster, cluster, height, size).
///
/// `merges` are all merges of `n` points, each after those of its own parts. They are
/// written as greedy search would have found them: always the least key among those whose
/// parts are there. `height_of` turns the merges' heights into those to be written. Takes
/// O(n log n) time.
pub(crate) fn linkage_matrix(
    n: usize,
    merges: &[Merge],
    height_of: impl Fn(f64) -> f64,
) -> Vec<[f64; 4]> {
    let (parents, mut missing) = family(n, merges);
    let candidate = |merge: u32| Reverse((merges[merge as usize].key(), merge));
    let mut ready: BinaryHeap<_> = (0..merges.len() as u32)
        .filter(|&merge| missing[merge as usize] == 0)
        .map(candidate)
        .collect();

    let mut clusters: Vec<(u32, u32)> = (0..n as u32).map(|point| (point, 1)).collect();
    let mut rows = Vec::with_capacity(merges.len());
    while let Some(Reverse((_, index))) = ready.pop() {
        let merge = merges[index as usize];
        let [(a, size_a), (b, size_b)] = [merge.low, merge.high].map(|rep| clusters[rep as usize]);
        let size = size_a + size_b;
        clusters[merge.low as usize] = ((n + rows.len()) as u32, size);
        let height = height_of(merge.height);
        rows.push([f64::from(a.min(b)), f64::from(a.max(b)), height, f64::from(size)]);

        let parent = parents[index as usize];
        if parent != NONE {
            missing[parent as usize] -= 1;
            if missing[parent as usize] == 0 {
                ready.push(candidate(parent));
            }
        }
    }
    rows
}

/// For each merge the one that its union takes part in, and how many of its parts are merges.
fn family(n: usize, merges: &[Merge]) -> (Vec<u32>, Vec<u8>) {
    let mut maker = vec![NONE; n];
    let mut parents = vec![NONE; merges.len()];
    let mut parts = vec![0; merges.len()];
    for (index, merge) in merges.iter().enumerate() {
        for rep in [merge.low, merge.high] {
            let made_by = maker[rep as usize];
            if made_by != NONE {
                parents[made_by as usize] = index as u32;
                parts[index] += 1;
            }
        }
        maker[merge.low as usize] = index as u32;
    }
    (parents, parts)
}

/// The cluster of each of `n` points, numbered in order of the clusters' representatives.
///
/// `merges` are those that were made, in any order. Takes O(n) time.
pub(crate) fn labels(n: usize, merges: &[Merge]) -> Vec<i64> {
    // Each cluster but the first of a chain has joined one of a smaller representative.
    let mut joined: Vec<u32> = (0..n as u32).collect();
    for merge in merges {
        joined[merge.high as usize] = merge.low;
    }
    let mut labels = Vec::with_capacity(n);
    let mut next = 0;
    for (point, &low) in joined.iter().enumerate() {
        if low as usize == point {
            labels.push(next);
            next += 1;
        } else {
            labels.push(labels[low as usize]);
        }
    }
    labels
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_stand_in_greedy_order_with_parts_before_unions() {
        // Four points on a line and two far off: all of one height, found in odd order.
        let found = [
            Merge::new(4, 5, 1.0),
            Merge::new(3, 2, 1.0),
            Merge::new(0, 1, 1.0),
            Merge::new(2, 0, 1.0),
            Merge::new(4, 0, 3.0),
        ];
        let rows = linkage_matrix(6, &found, |height| height);
        let wanted = [
            [0.0, 1.0, 1.0, 2.0],
            [2.0, 3.0, 1.0, 2.0],
            [6.0, 7.0, 1.0, 4.0],
            [4.0, 5.0, 1.0, 2.0],
            [8.0, 9.0, 3.0, 6.0],
        ];
        assert_eq!(rows, wanted);
    }

    #[test]
    fn labels_count_up_from_the_first_point() {
        let merges = [Merge::new(1, 4, 0.5), Merge::new(2, 1, 0.7)];
        assert_eq!(labels(6, &merges), [0, 1, 1, 2, 1, 3]);
    }
}
