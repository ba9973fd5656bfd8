//! The nearest-neighbour chain over a condensed matrix: O(n²) time on one thread.
//!
//! The chain follows nearest neighbours from any cluster. The keys along it decrease strictly, so
//! it ends at two clusters that are nearest to each other. They may be merged at once, whatever
//! else remains to be merged (see the crate's documentation).
//!
//! Source: Benzécri (1982); Murtagh (1983); this form is that of Müllner, arXiv:1109.2378.

use crate::error::Error;
use crate::parallel::Workers;
use crate::tree::Merge;
use mograft_machine::memory::{collect, with_capacity};

/// A condensed matrix: distances of pairs (0, 1), (0, 2), …, (1, 2), ….
pub(crate) struct Condensed {
    n: usize,
    distances: Vec<f64>,
}

impl Condensed {
    /// The matrix of `n * (n - 1) / 2` distances.
    pub fn new(n: usize, distances: Vec<f64>) -> Self {
        debug_assert_eq!(distances.len(), n * n.saturating_sub(1) / 2);
        Self { n, distances }
    }

    fn index(&self, a: u32, b: u32) -> usize {
        let (low, high) = (a.min(b) as usize, a.max(b) as usize);
        low * (2 * self.n - low - 1) / 2 + (high - low - 1)
    }

    fn get(&self, a: u32, b: u32) -> f64 {
        self.distances[self.index(a, b)]
    }

    /// Replace the distance of a pair by the larger of it and `distance`.
    fn maximize(&mut self, a: u32, b: u32, distance: f64) {
        let index = self.index(a, b);
        self.distances[index] = self.distances[index].max(distance);
    }
}

/// All merges of complete linkage, every merge behind those of its parts.
///
/// Of equal distances the pair of smaller representatives is merged first. Distances must not be
/// NaN. Takes O(n²) time.
///
/// # Errors
///
/// [`Error::OutOfMemory`], and [`Error::Stopped`] if the progress callback requests a stop.
pub(crate) fn merge_by_chain(
    workers: &Workers<'_>,
    mut matrix: Condensed,
) -> Result<Vec<Merge>, Error> {
    let n = matrix.n;
    let mut active: Vec<u32> = collect(0..n as u32)?;
    let mut chain: Vec<u32> = with_capacity(n)?;
    let mut merges = with_capacity(n.saturating_sub(1))?;
    while active.len() > 1 {
        workers.set_fraction(merges.len() as f64 / n as f64);
        workers.check_progress()?;
        let tip = chain.pop().unwrap_or(active[0]);
        let (neighbour, height) = nearest(&matrix, &active, tip);
        if chain.last() != Some(&neighbour) {
            chain.extend([tip, neighbour]);
            continue;
        }
        chain.pop();
        let merge = Merge::new(tip, neighbour, height);
        active.retain(|&cluster| cluster != merge.high);
        for &other in active.iter().filter(|&&other| other != merge.low) {
            let distance = matrix.get(merge.high, other);
            matrix.maximize(merge.low, other, distance);
        }
        merges.push(merge);
    }
    Ok(merges)
}

/// The nearest active cluster and its distance; of equal distances the first.
fn nearest(matrix: &Condensed, active: &[u32], cluster: u32) -> (u32, f64) {
    let mut best = (cluster, f64::INFINITY);
    for &other in active.iter().filter(|&&other| other != cluster) {
        let distance = matrix.get(cluster, other);
        if distance < best.1 || best.0 == cluster {
            best = (other, distance);
        }
    }
    best
}
