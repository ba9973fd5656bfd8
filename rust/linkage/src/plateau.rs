//! Merging where very many pairs are equally far apart, and none is nearer.
//!
//! On lattices of many axes a single distance may have more pairs than memory. No limit divides
//! them, but their order does: equal distances go by the lower index, then by the higher. So
//! the cluster of the lowest index takes in its neighbours on the plateau, the lowest first, as
//! long as they are neighbours of all it has taken; then the next cluster that is left does.
//! One row of neighbours is needed at a time, and none is kept.

use crate::Error;
use crate::clusters::Clusters;
use crate::distance::{Gauge, Limit, Scratch};
use crate::graph::transpose;
use crate::merging::Merged;
use crate::parallel::Crew;
use crate::simd::{self, Aligned, LANES, Wide};

/// Merge all that are at the squared distance `level`, the least that there is.
///
/// Takes O(m² d) time at worst, and O(m d) memory, for m clusters.
pub(crate) fn merge(
    crew: &Crew<'_>,
    clusters: &Clusters,
    gauge: &Gauge<'_>,
    level: f64,
) -> Result<Merged, Error> {
    let m = clusters.len();
    let mut by_rep: Vec<u32> = (0..m as u32).collect();
    by_rep.sort_unstable_by_key(|&cluster| clusters.reps[cluster as usize]);
    let mut rows = Rows::new(crew, clusters, gauge, level);
    let mut merged = Merged { pairs: Vec::new(), roots: (0..m as u32).collect() };
    let mut is_left = vec![true; m];
    for &low in &by_rep {
        if !std::mem::take(&mut is_left[low as usize]) {
            continue;
        }
        let mut near = rows.neighbours(low, &is_left)?;
        while let Some(&high) = near.first() {
            merged.pairs.push((low, high, level));
            merged.roots[high as usize] = low;
            is_left[high as usize] = false;
            let others = rows.neighbours(high, &is_left)?;
            let rep = |cluster: &u32| clusters.reps[*cluster as usize];
            near.retain(|cluster| others.binary_search_by_key(&rep(cluster), rep).is_ok());
        }
    }
    Ok(merged)
}

/// What finds the neighbours of a cluster.
struct Rows<'a> {
    crew: &'a Crew<'a>,
    clusters: &'a Clusters,
    gauge: &'a Gauge<'a>,
    level: Limit,
    /// The largest squared bound that a pair on the plateau can have.
    limit: f64,
    /// Centres of all clusters, and their spreads, sixteen side by side.
    centres: Vec<Wide>,
    spreads: Vec<Wide>,
    scratch: Scratch,
}

impl<'a> Rows<'a> {
    fn new(crew: &'a Crew<'a>, clusters: &'a Clusters, gauge: &'a Gauge<'a>, level: f64) -> Self {
        let m = clusters.len();
        let (mut centres, mut spreads) = (Vec::new(), Vec::new());
        let mut block = Vec::new();
        for first in (0..m).step_by(LANES) {
            let mut some = Aligned([0.0; LANES]);
            transpose(clusters, first..m.min(first + LANES), &mut block, &mut some);
            centres.extend_from_slice(&block);
            spreads.push(some);
        }
        let drift = (0..m)
            .map(|cluster| clusters.drift(cluster))
            .fold(0.0, f64::max);
        let level = Limit::of(level);
        let most = level.root + 2.0 * drift;
        let limit = most * most * (1.0 + 1e-9);
        Self { crew, clusters, gauge, level, limit, centres, spreads, scratch: Scratch::default() }
    }

    /// The clusters left that are no farther than the plateau, by representative.
    fn neighbours(&mut self, own: u32, is_left: &[bool]) -> Result<Vec<u32>, Error> {
        self.crew.ask()?;
        let cluster = own as usize;
        let (centre, spread) = (self.clusters.centre(cluster), self.clusters.spreads[cluster]);
        let mut near = Vec::new();
        for (block, centres) in self.centres.chunks_exact(centre.len()).enumerate() {
            let bounds = simd::bounds(self.crew.isa, centre, spread, centres, &self.spreads[block]);
            for (other, &bound) in (block * LANES..).zip(bounds.iter()) {
                if bound <= self.limit
                    && other != cluster
                    && is_left[other]
                    && self
                        .gauge
                        .within(cluster, other, self.level, &mut self.scratch)
                        .is_some()
                {
                    near.push(other as u32);
                }
            }
        }
        near.sort_unstable_by_key(|&other| self.clusters.reps[other as usize]);
        Ok(near)
    }
}
