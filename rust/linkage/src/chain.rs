//! The nearest-neighbour chain over a condensed matrix: plain, quadratic, and the measure
//! of everything else in this crate.
//!
//! Follow nearest neighbours from any cluster. The keys along the way fall strictly, so the
//! walk ends at two clusters that are nearest to each other; by the argument in the crate's
//! essay these two may be merged at once, whatever else is still to be merged.
//! (Benzécri 1982; Murtagh 1983; Müllner, arXiv:1109.2378, writes it as it is done here.)

use crate::Error;
use crate::parallel::Crew;
use crate::tree::Merge;

/// Distances of `n` things, each pair once: (0, 1), (0, 2), …, (1, 2), ….
pub(crate) struct Condensed {
    n: usize,
    distances: Vec<f64>,
}

impl Condensed {
    /// Take a buffer of `n * (n - 1) / 2` distances.
    pub fn new(n: usize, distances: Vec<f64>) -> Self {
        debug_assert_eq!(distances.len(), n * n.saturating_sub(1) / 2);
        Self { n, distances }
    }

    /// Ask for each pair once.
    pub fn from_fn(n: usize, mut distance: impl FnMut(usize, usize) -> f64) -> Self {
        let mut distances = Vec::with_capacity(n * n.saturating_sub(1) / 2);
        for a in 0..n {
            distances.extend((a + 1..n).map(|b| distance(a, b)));
        }
        Self::new(n, distances)
    }

    fn index(&self, a: u32, b: u32) -> usize {
        let (low, high) = (a.min(b) as usize, a.max(b) as usize);
        low * (2 * self.n - low - 1) / 2 + (high - low - 1)
    }

    fn get(&self, a: u32, b: u32) -> f64 {
        self.distances[self.index(a, b)]
    }

    fn raise(&mut self, a: u32, b: u32, distance: f64) {
        let index = self.index(a, b);
        self.distances[index] = self.distances[index].max(distance);
    }
}

/// All merges of complete linkage, parts before unions, in O(n²) time.
///
/// Among equal distances the pair of the smaller representatives goes first.
///
/// # Errors
///
/// If the caller wants to stop.
pub(crate) fn chain(crew: &Crew<'_>, mut matrix: Condensed) -> Result<Vec<Merge>, Error> {
    let n = matrix.n;
    let mut active: Vec<u32> = (0..n as u32).collect();
    let mut walk: Vec<u32> = Vec::with_capacity(n);
    let mut merges = Vec::with_capacity(n.saturating_sub(1));
    while active.len() > 1 {
        crew.report(merges.len() as f64 / n as f64);
        crew.ask()?;
        let here = walk.pop().unwrap_or(active[0]);
        let (next, height) = nearest(&matrix, &active, here);
        if walk.last() != Some(&next) {
            walk.extend([here, next]);
            continue;
        }
        walk.pop();
        let merge = Merge::new(here, next, height);
        active.retain(|&other| other != merge.high);
        for &other in active.iter().filter(|&&other| other != merge.low) {
            let distance = matrix.get(merge.high, other);
            matrix.raise(merge.low, other, distance);
        }
        merges.push(merge);
    }
    Ok(merges)
}

/// The cluster of least key seen from `here`: of equal distances the first.
fn nearest(matrix: &Condensed, active: &[u32], here: u32) -> (u32, f64) {
    let mut best = (here, f64::INFINITY);
    for &other in active.iter().filter(|&&other| other != here) {
        let distance = matrix.get(here, other);
        if distance < best.1 || best.0 == here {
            best = (other, distance);
        }
    }
    best
}
