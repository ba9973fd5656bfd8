//! The stages of exact complete linkage in linear memory.
//!
//! A stage sorts the clusters spatially, chooses a threshold, finds all pairs within it, merges on
//! their graph and computes the balls of the unions. The crate's documentation proves that the
//! result does not depend on the thresholds. If density is uneven, the densest clusters are merged
//! up to a limit in stages of their own, so that the others are not sorted again in each of them.

use crate::blocks::Blocks;
use crate::clusters::Clusters;
use crate::dense::merge_on_matrix;
use crate::distance::ClusterDistances;
use crate::distance_rows::rows_of_clusters;
use crate::error::Error;
use crate::merging::{MergedClusters, merge_on_graph};
use crate::neighbours::{Edge, Edges, clusters_within, edges_within};
use crate::options::Tuning;
use crate::parallel::Workers;
use crate::plateau::merge_plateau;
use crate::points::Points;
use crate::profile;
use crate::spatial_order::{Density, SpatialOrder, sort_spatially};
use crate::threshold::choose_threshold;
use crate::tree::Merge;
use mograft_machine::memory::{append, collect, push, with_capacity};

/// If a stage merges less than one in this many clusters, the next one seeks more neighbours.
const MIN_MERGED_DIVISOR: usize = 8;

/// Largest degree if stages find few of the edges expected.
const MAX_DEGREE_SPARSE: f64 = 256.0;

/// Largest degree if stages find the edges expected and still merge few clusters: then a dense
/// region has all the edges, and other clusters have none.
const MAX_DEGREE_DENSE: f64 = 12.0;

/// Factor of the degree if density is uneven: then a few dense clusters have very many neighbours.
const UNEVEN_DEGREE_FACTOR: f64 = 0.25;

/// Fraction of the edges expected below which a stage counts as sparse.
const SPARSE_FRACTION: f64 = 0.125;

/// Work of merging on the graph, per edge, in the unit of [`Workers::add_work`].
const EDGE_WORK: u64 = 1000;

/// Multiple of the edges expected above which a stage lowers its threshold.
const MAX_EDGE_FACTOR: f64 = 4.0;

/// Fraction of the clusters, the densest, that are merged without the others if density is uneven.
const DENSE_FRACTION: usize = 4;

/// Edges, about, from which a smaller limit is estimated if too many were found.
const LIMIT_SAMPLE_SIZE: usize = 1 << 18;

/// All merges of distinct points up to a squared distance, every merge behind those of its parts.
///
/// Returns None if all work together exceeds `max_work`, in the unit of [`Workers::add_work`].
///
/// # Errors
///
/// [`Error::OutOfMemory`], and [`Error::Stopped`] if the progress callback requests a stop.
pub(crate) fn merge_in_stages(
    workers: &Workers<'_>,
    points: &Points,
    max_squared: f64,
    max_work: f64,
    tuning: &Tuning,
) -> Result<Option<Vec<Merge>>, Error> {
    let merges = with_capacity(points.len())?;
    let mut run = Run { workers, points, max_work, tuning, merges };
    let end = run.merge_up_to(Clusters::from_points(workers, points)?, max_squared, false)?;
    Ok(end.map(|_| run.merges))
}

/// A call of [`merge_in_stages`].
struct Run<'a> {
    workers: &'a Workers<'a>,
    points: &'a Points,
    max_work: f64,
    tuning: &'a Tuning,
    /// The merges so far.
    merges: Vec<Merge>,
}

impl Run<'_> {
    /// Merge clusters up to a squared distance; return those that remain.
    ///
    /// None if all work together exceeds the limit. The result is empty unless `is_part`: unless
    /// the clusters are a part of those that the caller merges.
    fn merge_up_to(
        &mut self,
        mut clusters: Clusters,
        max_squared: f64,
        is_part: bool,
    ) -> Result<Option<Clusters>, Error> {
        let (workers, tuning) = (self.workers, self.tuning);
        let mut degree = tuning.degree;
        let mut may_split = true;
        while clusters.len() > tuning.dense_size.max(1) {
            let m = clusters.len();
            profile::begin_phase("sort");
            let SpatialOrder { clusters: sorted, density } = sort_spatially(workers, &clusters)?;
            clusters = sorted;
            if let Some(density) = density
                .as_ref()
                .filter(|_| may_split && m >= tuning.split_size)
                && let Some(limit) = split_limit(density, max_squared)
            {
                let n_merges = self.merges.len();
                let Some(rest) = self.merge_dense(&clusters, density, limit)? else {
                    return Ok(None);
                };
                clusters = rest;
                may_split = self.merges.len() > n_merges;
                continue;
            }
            may_split = true;
            let by_density = density.as_ref().map(|density| density.order.as_slice());
            let Some(stage) = self.run_stage(&clusters, by_density, degree, max_squared)? else {
                return Ok(None);
            };
            self.push_merges(&clusters, &stage.merged.pairs)?;
            let is_last = stage.threshold >= max_squared;
            if is_last && !is_part {
                return Ok(Some(clusters.reorder(workers, &[])?));
            }
            debug_assert!(is_last || !stage.merged.pairs.is_empty(), "a pair is within the limit");
            if stage.merged.pairs.len() * MIN_MERGED_DIVISOR < m {
                let max_degree = if stage.is_sparse { MAX_DEGREE_SPARSE } else { MAX_DEGREE_DENSE };
                degree = (degree * 1.5).min(max_degree).max(degree);
            }
            profile::begin_phase("unite");
            clusters = clusters.unite(workers, self.points, &stage.merged.roots)?;
            if is_last {
                return Ok(Some(clusters));
            }
        }
        profile::begin_phase("rest");
        self.merge_remaining(&clusters, max_squared, is_part)
    }

    /// Merge the densest clusters up to a limit; return all that remain.
    ///
    /// Clusters without any other within the limit do not merge up to it, and those that have one
    /// merge as if the others did not exist.
    fn merge_dense(
        &mut self,
        clusters: &Clusters,
        density: &Density,
        limit: f64,
    ) -> Result<Option<Clusters>, Error> {
        profile::begin_phase("split");
        let is_known = collect(density.gaps.iter().map(|&gap| gap <= limit))?;
        let blocks = Blocks::new(self.workers, self.points, clusters)?;
        let is_dense = clusters_within(self.workers, &blocks, limit, is_known)?;
        drop(blocks);
        let select = |is_wanted: bool| -> Result<Vec<u32>, Error> {
            let mut indices = collect(0..is_dense.len() as u32)?;
            indices.retain(|&index| is_dense[index as usize] == is_wanted);
            Ok(indices)
        };
        let dense = clusters.reorder(self.workers, &select(true)?)?;
        let Some(mut rest) = self.merge_up_to(dense, limit, true)? else { return Ok(None) };
        rest.append(&clusters.reorder(self.workers, &select(false)?)?)?;
        Ok(Some(rest))
    }

    /// Find the pairs within a threshold and merge on their graph; None if there is too much work.
    fn run_stage(
        &self,
        clusters: &Clusters,
        by_density: Option<&[u32]>,
        degree: f64,
        max_squared: f64,
    ) -> Result<Option<Stage>, Error> {
        let (workers, max_work, m) = (self.workers, self.max_work, clusters.len());
        profile::begin_phase("pack");
        let distances = ClusterDistances::new(workers, self.points, clusters)?;
        profile::begin_phase("threshold");
        let wanted = if by_density.is_some() { UNEVEN_DEGREE_FACTOR * degree } else { degree };
        let threshold = choose_threshold(workers, clusters, &distances, wanted, by_density)?;
        let max_edges = (MAX_EDGE_FACTOR * degree * m as f64) as usize + self.tuning.spare_edges;
        profile::begin_phase("blocks");
        let blocks = Blocks::new(workers, self.points, clusters)?;
        profile::begin_phase("edges");
        let bounds = Bounds { squared: threshold.min(max_squared), max_edges, max_work };
        let found = find_edges(workers, &blocks, &distances, bounds)?;
        drop(blocks);
        Ok(match found {
            Found::Edges(edges, threshold) => {
                drop(distances);
                let n_edges: usize = edges.iter().map(Vec::len).sum();
                let is_sparse = (n_edges as f64) < SPARSE_FRACTION * wanted * m as f64;
                workers.add_estimated_work(n_edges as u64 * EDGE_WORK);
                profile::begin_phase("merge");
                let merged = merge_on_graph(workers, &clusters.representatives, edges)?;
                Some(Stage { merged, threshold, is_sparse })
            }
            Found::Plateau(squared) => {
                let merged = merge_plateau(workers, clusters, &distances, squared, max_work)?;
                merged.map(|merged| Stage { merged, threshold: squared, is_sparse: false })
            }
            Found::Exhausted => None,
        })
    }

    /// Append the merges of pairs of clusters.
    fn push_merges(&mut self, clusters: &Clusters, pairs: &[(u32, u32, f64)]) -> Result<(), Error> {
        profile::begin_phase("collect");
        let representative = |cluster: u32| clusters.representatives[cluster as usize];
        let merge =
            |&(a, b, squared): &_| Merge::new(representative(a), representative(b), squared);
        append(&mut self.merges, pairs.iter().map(merge))?;
        self.workers
            .set_fraction(self.merges.len() as f64 / self.points.len() as f64);
        Ok(())
    }

    /// Merge few clusters on the full matrix; result as for [`Self::merge_up_to`].
    fn merge_remaining(
        &mut self,
        clusters: &Clusters,
        max_squared: f64,
        is_part: bool,
    ) -> Result<Option<Clusters>, Error> {
        let (workers, points) = (self.workers, self.points);
        let mut order: Vec<u32> = collect(0..clusters.len() as u32)?;
        order.sort_unstable_by_key(|&cluster| clusters.representatives[cluster as usize]);
        let clusters = clusters.reorder(workers, &order)?;
        let rows = rows_of_clusters(workers, points, &clusters, max_squared, self.max_work)?;
        let Some(rows) = rows else { return Ok(None) };
        let pairs = merge_on_matrix(workers, rows)?;
        self.push_merges(&clusters, &pairs)?;
        if !is_part {
            return Ok(Some(clusters));
        }
        let mut roots: Vec<u32> = collect(0..clusters.len() as u32)?;
        // In reverse, so that the root of the cluster that remains is known.
        for &(kept, removed, _) in pairs.iter().rev() {
            roots[removed as usize] = roots[kept as usize];
        }
        Ok(Some(clusters.unite(workers, points, &roots)?))
    }
}

/// The limit up to which the densest clusters are merged without the others, if it is of use.
fn split_limit(density: &Density, max_squared: f64) -> Option<f64> {
    let rank = density.order.len() / DENSE_FRACTION;
    let limit = density.gaps[density.order[rank] as usize];
    (limit > 0.0 && limit < max_squared).then_some(limit)
}

/// The result of a stage.
struct Stage {
    merged: MergedClusters,
    /// The squared distance up to which all merges are made.
    threshold: f64,
    /// Whether far fewer edges were found than expected.
    is_sparse: bool,
}

/// The result of a search for edges.
enum Found {
    /// All pairs within a squared distance, and that distance.
    Edges(Vec<Vec<Edge>>, f64),
    /// The smallest squared distance; too many pairs have it.
    Plateau(f64),
    /// All work together exceeds the limit.
    Exhausted,
}

/// Where a search for edges ends.
#[derive(Clone, Copy)]
struct Bounds {
    /// Largest squared distance.
    squared: f64,
    /// Count of edges above which the distance is reduced.
    max_edges: usize,
    /// Limit of all work together.
    max_work: f64,
}

/// All pairs within a squared distance, or within a smaller one if there are too many.
fn find_edges(
    workers: &Workers<'_>,
    blocks: &Blocks<'_>,
    distances: &ClusterDistances<'_>,
    bounds: Bounds,
) -> Result<Found, Error> {
    let Bounds { squared: mut limit, max_edges, max_work } = bounds;
    let mut plateau = None;
    loop {
        let edges = match edges_within(workers, blocks, distances, limit, max_edges, max_work)? {
            Edges::Complete(edges) => {
                let plateau = plateau.filter(|_| edges.iter().all(Vec::is_empty));
                return Ok(plateau.map_or(Found::Edges(edges, limit), Found::Plateau));
            }
            Edges::Truncated(edges) => edges,
            Edges::Exhausted => return Ok(Found::Exhausted),
        };
        let quarter = quarter_of(&edges)?;
        let squares = edges.iter().flatten().map(|edge| edge.squared);
        if quarter < limit {
            limit = quarter;
        } else if let Some(largest) = squares.filter(|&squared| squared < limit).reduce(f64::max) {
            limit = largest;
        } else {
            // All pairs found have the same distance. The next search is for smaller ones.
            plateau = Some(limit);
            limit = limit.next_down();
        }
    }
}

/// The squared distance within which about a quarter of the edges are; there is at least one.
fn quarter_of(edges: &[Vec<Edge>]) -> Result<f64, Error> {
    let n_edges: usize = edges.iter().map(Vec::len).sum();
    let mut squares = Vec::new();
    for edge in edges
        .iter()
        .flatten()
        .step_by(n_edges.div_ceil(LIMIT_SAMPLE_SIZE))
    {
        push(&mut squares, edge.squared)?;
    }
    let quarter = squares.len() / 4;
    Ok(*squares.select_nth_unstable_by(quarter, f64::total_cmp).1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::distance_rows::rows_of_points;
    use crate::input::Table;
    use crate::parallel::WORK_PER_CHECK;
    use mograft_machine::instructions::Isa;

    /// Points of `n_groups` groups, so that the last clusters have many members each.
    fn grouped_points(workers: &Workers<'_>, n: usize, dim: usize, n_groups: usize) -> Points {
        let mut state = 1_u64;
        let coordinates: Vec<f64> = (0..n * dim)
            .map(|i| {
                state = state.wrapping_mul(0x5851_f42d_4c95_7f2d).wrapping_add(1);
                let group = i / dim % n_groups;
                (group + i % dim) as f64 * f64::from(group > 0) + (state >> 40) as f64 / 1e8
            })
            .collect();
        let table = Table::rows(&coordinates, dim);
        let largest = table.check(workers).unwrap();
        Points::new(workers, &table, largest).unwrap()
    }

    #[test]
    fn work_between_checks_of_progress_does_not_grow_with_all_work() {
        for (n, dim, n_groups) in [(20_000, 3, 2), (6_000, 20, 1), (300, 2_000, 1)] {
            let workers = Workers::new(1, Isa::best(), None);
            let points = grouped_points(&workers, n, dim, n_groups);
            if n <= 300 {
                rows_of_points(&workers, &points, f64::INFINITY).unwrap();
            } else {
                let tuning = Tuning::default();
                let limits = (f64::INFINITY, f64::INFINITY);
                merge_in_stages(&workers, &points, limits.0, limits.1, &tuning).unwrap();
            }
            workers.check_progress().unwrap();
            println!("{n} x {dim}: {} of {}", workers.max_unchecked_work(), workers.work());
            assert!(workers.max_unchecked_work() <= 2.0 * WORK_PER_CHECK as f64);
            assert!(workers.work() >= 10.0 * WORK_PER_CHECK as f64);
        }
    }
}
