//! Merging if very many pairs have the same distance and none is nearer.
//!
//! On lattices of many axes more pairs may have the smallest distance, the *plateau*, than memory
//! holds edges. No limit separates them, but their order does: of equal distances the lower
//! representative goes first, then the higher. So the cluster of lowest representative absorbs its
//! neighbours on the plateau, the lowest first, as long as they are neighbours of all that it has
//! absorbed; then the lowest remaining cluster does. One row of neighbours is computed at a time,
//! and none is stored.

use crate::clusters::Clusters;
use crate::distance::{ClusterDistances, Limit, Scratch};
use crate::error::Error;
use crate::merging::MergedClusters;
use crate::parallel::Workers;
use crate::simd::{self, Aligned, F64Lanes, LANES};
use mograft_machine::memory::{allocate, collect, push, with_capacity};

/// Merge all pairs at the squared distance `squared`, which is the smallest of all pairs.
///
/// Returns None if all work together exceeds `max_work`. Takes O(m² d) time at worst and O(m d) memory for m clusters in d dimensions.
///
/// # Errors
///
/// [`Error::OutOfMemory`], and [`Error::Stopped`] if the progress callback requests a stop.
pub(crate) fn merge_plateau(
    workers: &Workers<'_>,
    clusters: &Clusters,
    distances: &ClusterDistances<'_>,
    squared: f64,
    max_work: f64,
) -> Result<Option<MergedClusters>, Error> {
    let m = clusters.len();
    let mut order: Vec<u32> = collect(0..m as u32)?;
    order.sort_unstable_by_key(|&cluster| clusters.representatives[cluster as usize]);
    let mut search = PlateauSearch::new(workers, clusters, distances, squared)?;
    let mut merged = MergedClusters { pairs: Vec::new(), roots: collect(0..m as u32)? };
    let mut is_active = allocate(true, m)?;
    for &low in &order {
        if !std::mem::take(&mut is_active[low as usize]) {
            continue;
        }
        if workers.work() > max_work {
            return Ok(None);
        }
        let mut neighbours = search.neighbours(low, &is_active)?;
        while let Some(&high) = neighbours.first() {
            push(&mut merged.pairs, (low, high, squared))?;
            merged.roots[high as usize] = low;
            is_active[high as usize] = false;
            let others = search.neighbours(high, &is_active)?;
            let representative = |cluster: &u32| clusters.representatives[*cluster as usize];
            neighbours.retain(|cluster| {
                others
                    .binary_search_by_key(&representative(cluster), representative)
                    .is_ok()
            });
        }
    }
    Ok(Some(merged))
}

/// Finds the neighbours of a cluster on the plateau.
struct PlateauSearch<'a> {
    workers: &'a Workers<'a>,
    clusters: &'a Clusters,
    distances: &'a ClusterDistances<'a>,
    limit: Limit,
    /// The largest squared bound that a pair on the plateau can have.
    max_bound: f64,
    /// Centres and variances of all clusters, sixteen side by side.
    centres: Vec<F64Lanes>,
    variances: Vec<F64Lanes>,
    scratch: Scratch,
}

impl<'a> PlateauSearch<'a> {
    fn new(
        workers: &'a Workers<'a>,
        clusters: &'a Clusters,
        distances: &'a ClusterDistances<'a>,
        squared: f64,
    ) -> Result<Self, Error> {
        let m = clusters.len();
        let n_blocks = m.div_ceil(LANES);
        let mut centres = with_capacity(n_blocks * clusters.centre(0).len())?;
        let mut variances = with_capacity(n_blocks)?;
        let mut block = Vec::new();
        for first in (0..m).step_by(LANES) {
            let mut block_variances = Aligned([0.0; LANES]);
            clusters.copy_to_lanes(first..m.min(first + LANES), &mut block, &mut block_variances);
            centres.extend_from_slice(&block);
            variances.push(block_variances);
        }
        let bound_error = (0..m)
            .map(|cluster| clusters.bound_error(cluster))
            .fold(0.0, f64::max);
        let limit = Limit::from_squared(squared);
        let root = limit.root + 2.0 * bound_error;
        Ok(Self {
            workers,
            clusters,
            distances,
            limit,
            max_bound: root * root * (1.0 + 1e-9),
            centres,
            variances,
            scratch: Scratch::default(),
        })
    }

    /// The active clusters on the plateau of a cluster, sorted by representative.
    fn neighbours(&mut self, cluster: u32, is_active: &[bool]) -> Result<Vec<u32>, Error> {
        let cluster = cluster as usize;
        let (centre, variance) = (self.clusters.centre(cluster), self.clusters.variances[cluster]);
        let isa = self.workers.isa;
        let mut neighbours = Vec::new();
        for (block, centres) in self.centres.chunks_exact(centre.len()).enumerate() {
            self.workers.check_row(block, LANES * centre.len())?;
            let bounds =
                simd::squared_bounds(isa, centre, variance, centres, &self.variances[block]);
            for (other, &bound) in (block * LANES..).zip(bounds.iter()) {
                if bound > self.max_bound || other == cluster || !is_active[other] {
                    continue;
                }
                let squared =
                    self.distances
                        .squared_within(cluster, other, self.limit, &mut self.scratch);
                if !self.workers.can_continue(&mut self.scratch.work) {
                    self.workers.check_progress()?;
                }
                if squared.is_some() {
                    push(&mut neighbours, other as u32)?;
                }
            }
        }
        self.scratch.check_memory()?;
        let computed = self.clusters.len() * centre.len();
        self.workers
            .add_work(computed as u64 + std::mem::take(&mut self.scratch.work));
        neighbours.sort_unstable_by_key(|&other| self.clusters.representatives[other as usize]);
        Ok(neighbours)
    }
}
