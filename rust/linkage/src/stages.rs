//! The stages of exact complete linkage in linear memory.
//!
//! A stage sorts the clusters spatially, chooses a threshold, finds all pairs within it, merges on
//! their graph and computes the balls of the unions. The crate's documentation proves that the
//! result does not depend on the thresholds.

use crate::blocks::Blocks;
use crate::clusters::Clusters;
use crate::dense::merge_on_matrix;
use crate::distance::ClusterDistances;
use crate::distance_rows::rows_of_clusters;
use crate::error::Error;
use crate::merging::merge_on_graph;
use crate::neighbours::{Edge, Edges, edges_within};
use crate::options::Tuning;
use crate::parallel::Workers;
use crate::plateau::merge_plateau;
use crate::points::Points;
use crate::profile;
use crate::spatial_order::{SpatialOrder, sort_spatially};
use crate::threshold::choose_threshold;
use crate::tree::Merge;

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

/// All merges of distinct points up to a squared distance, every merge behind those of its parts.
///
/// Returns None if all work together exceeds `max_work`, in the unit of [`Workers::add_work`].
///
/// # Errors
///
/// [`Error::Stopped`] if the progress callback requests a stop.
pub(crate) fn merge_in_stages(
    workers: &Workers<'_>,
    points: &Points,
    max_squared: f64,
    max_work: f64,
    tuning: &Tuning,
) -> Result<Option<Vec<Merge>>, Error> {
    let n = points.len();
    let mut merges = Vec::with_capacity(n);
    let mut clusters = Clusters::from_points(points);
    let mut degree = tuning.degree;
    while clusters.len() > tuning.dense_size.max(1) {
        let m = clusters.len();
        profile::begin_phase("sort");
        let by_density;
        SpatialOrder { clusters, by_density } = sort_spatially(workers, &clusters)?;
        let by_density = by_density.as_deref();
        profile::begin_phase("pack");
        let distances = ClusterDistances::new(workers, points, &clusters)?;
        profile::begin_phase("threshold");
        let wanted = if by_density.is_some() { UNEVEN_DEGREE_FACTOR * degree } else { degree };
        let threshold = choose_threshold(workers, &clusters, &distances, wanted, by_density)?;
        let max_edges = (MAX_EDGE_FACTOR * degree * m as f64) as usize + tuning.spare_edges;
        profile::begin_phase("blocks");
        let blocks = Blocks::new(&clusters);
        profile::begin_phase("edges");
        let bounds = Bounds { squared: threshold.min(max_squared), max_edges, max_work };
        let found = find_edges(workers, &blocks, &distances, bounds)?;
        drop(blocks);
        let (merged, threshold, is_sparse) = match found {
            Found::Edges(edges, threshold) => {
                drop(distances);
                let n_edges: usize = edges.iter().map(Vec::len).sum();
                let is_sparse = (n_edges as f64) < SPARSE_FRACTION * wanted * m as f64;
                workers.add_work(n_edges as u64 * EDGE_WORK);
                profile::begin_phase("merge");
                let merged = merge_on_graph(workers, &clusters.representatives, edges)?;
                (merged, threshold, is_sparse)
            }
            Found::Plateau(squared) => {
                let merged = merge_plateau(workers, &clusters, &distances, squared, max_work)?;
                let Some(merged) = merged else { return Ok(None) };
                (merged, squared, false)
            }
            Found::Exhausted => return Ok(None),
        };
        profile::begin_phase("collect");
        let representative = |cluster: u32| clusters.representatives[cluster as usize];
        merges.extend(
            merged
                .pairs
                .iter()
                .map(|&(a, b, squared)| Merge::new(representative(a), representative(b), squared)),
        );
        workers.set_fraction(merges.len() as f64 / n as f64);
        if threshold >= max_squared {
            return Ok(Some(merges));
        }
        debug_assert!(!merged.pairs.is_empty(), "some pair is within the threshold");
        if merged.pairs.len() * MIN_MERGED_DIVISOR < m {
            let max_degree = if is_sparse { MAX_DEGREE_SPARSE } else { MAX_DEGREE_DENSE };
            degree = (degree * 1.5).min(max_degree).max(degree);
        }
        profile::begin_phase("unite");
        clusters = clusters.unite(workers, points, &merged.roots)?;
    }
    profile::begin_phase("rest");
    let found = merge_remaining(workers, points, &clusters, max_squared, max_work)?;
    Ok(found.map(|found| {
        merges.extend(found);
        merges
    }))
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
        let mut squares: Vec<f64> = edges.iter().flatten().map(|edge| edge.squared).collect();
        drop(edges);
        let quarter = squares.len() / 4;
        let (nearer, &mut quarter, _) = squares.select_nth_unstable_by(quarter, f64::total_cmp);
        let below = nearer.iter().copied().filter(|&squared| squared < limit);
        if quarter < limit {
            limit = quarter;
        } else if let Some(largest) = below.reduce(f64::max) {
            limit = largest;
        } else {
            // All pairs found have the same distance. The next search is for smaller ones.
            plateau = Some(limit);
            limit = limit.next_down();
        }
    }
}

/// Merge the remaining clusters on the full matrix; None if all work together exceeds `max_work`.
fn merge_remaining(
    workers: &Workers<'_>,
    points: &Points,
    clusters: &Clusters,
    max_squared: f64,
    max_work: f64,
) -> Result<Option<Vec<Merge>>, Error> {
    let mut order: Vec<u32> = (0..clusters.len() as u32).collect();
    order.sort_unstable_by_key(|&cluster| clusters.representatives[cluster as usize]);
    let clusters = clusters.reorder(workers, &order)?;
    let Some(rows) = rows_of_clusters(workers, points, &clusters, max_squared, max_work)? else {
        return Ok(None);
    };
    let representative = |cluster: u32| clusters.representatives[cluster as usize];
    let pairs = merge_on_matrix(workers, rows)?.into_iter();
    Ok(Some(
        pairs
            .map(|(a, b, squared)| Merge::new(representative(a), representative(b), squared))
            .collect(),
    ))
}
