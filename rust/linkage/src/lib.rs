//! Exact complete linkage in linear memory: points in, tree or labels out.
//!
//! Complete linkage repeatedly merges the two clusters whose farthest points are nearest:
//! D(A, C) = max |a − c|. Textbook algorithms store all n²/2 distances. This crate stores those of
//! a few neighbours of each cluster at a time and returns the same tree, bit for bit. It knows
//! nothing of motion or of Python.
//!
//! # Correctness
//!
//! **Order of merges.** Each pair of clusters has the key (D², lower representative, higher
//! representative); the representative of a cluster is the smallest index among its points. No two
//! pairs have the same key. Complete linkage is *reducible*: a merge never decreases a key. Let
//! A and B be two clusters with keys to a third cluster C; then the key of A ∪ B is not less than
//! the lesser of the two. If the D² differ, the union has the larger one. If they are equal, the
//! representative of the union is that of A or of B, and its key is theirs.
//!
//! **Order of search.** Therefore two clusters that are each other's nearest remain so until they
//! merge, whatever else merges before; they may be merged at once. The pair of least key is such a
//! pair. So greedy search, the nearest-neighbour chain and rounds that merge all such pairs make
//! the same merges, and [`tree`] sorts them into the order of greedy search.
//!
//! **Thresholds.** Take the graph of all pairs of clusters with D ≤ T, and merge on it until no
//! edge is left. A pair that is not an edge is farther than T, so clusters that are each other's
//! nearest in the graph are so among all clusters. The graph is updated without measuring points:
//! A ∪ B is within T of C if and only if both parts are, at the larger of the two distances. When
//! no edge is left, all merges up to height T are made. The next *stage* takes the remaining
//! clusters and a larger T. The result is the same for any T, any count of threads and any block
//! size; they determine the running time only. Flat clusters of diameter t are the same
//! computation with T ≤ t, which ends after T = t.
//!
//! **Bounds.** For any weights that add up to one, the weighted mean of |a − c|² over the points
//! of A and C is |c_A − c_C|² + V_A + V_C, which depends on the weighted centres and variances
//! alone; D² is at least that mean. The distances between two points of A and two of C, chosen far
//! apart, are a second bound. Both bounds, computed for blocks of sixteen clusters, exclude most
//! pairs from exact measurement.
//!
//! **Rounding.** Squared distances are summed in f64, axis by axis, never fused or reordered: the
//! bits are those of SciPy on every processor. f32 arithmetic only excludes pairs, with an
//! allowance for its rounding; it never ranks them. Trees therefore equal SciPy's bit for bit if
//! no two distances are equal; among equal distances SciPy's order differs.
//!
//! # Layers
//!
//! A module uses only modules above it in this table (`tests/layers.rs` checks this).
//!
//! | module | contents |
//! |---|---|
//! | [`mod@error`] | the errors of this crate |
//! | [`simd`] | inner loops for three instruction sets; all `unsafe` code |
//! | [`profile`] | measurement of the work that threads share |
//! | [`parallel`] | scoped threads, progress, stopping |
//! | [`sorting`] | sorting of many keys on several threads |
//! | [`options`] | resources and tuning of a call |
//! | [`input`] | points as the caller holds them |
//! | [`tree`] | from merges to SciPy's matrix or to labels |
//! | [`halving`] | spatial sorting of rows |
//! | [`points`] | scaling, duplicates, the squared distance that determines results |
//! | [`clusters`] | centres, variances and radii, and those of unions |
//! | [`spatial_order`] | spatial sorting of clusters, with regard to density |
//! | [`packed`] | members of clusters as f32 offsets, sixteen side by side |
//! | [`distance`] | the exact distance of two clusters, from few of their points |
//! | [`blocks`] | bounding boxes of sixteen clusters |
//! | [`neighbours`] | all pairs within a limit: four filters over blocks |
//! | [`threshold`] | the choice of T, from a sample |
//! | [`adjacency`] | lists of neighbours in the sparse graph |
//! | [`merging`] | merging on the sparse graph |
//! | [`plateau`] | merging if too many pairs have the same distance for any graph |
//! | [`distance_rows`] | the full matrix of distances |
//! | [`dense`] | merging on a full matrix, at the speed of reading memory |
//! | [`mod@chain`] | the nearest-neighbour chain on a condensed matrix |
//! | [`stages`] | the loop over thresholds; the last clusters on a matrix |
//!
//! # Sources
//!
//! Müllner, *Modern hierarchical, agglomerative clustering algorithms*, arXiv:1109.2378 (chain,
//! reducibility); Yu et al., *ParChain*, VLDB 2021 (linear memory by range queries); Bădoiu and
//! Clarkson, *Smaller core-sets for balls*, SODA 2003 (enclosing balls).
#![allow(rustdoc::private_intra_doc_links, reason = "this page is for readers of the source")]

mod adjacency;
mod blocks;
mod chain;
mod clusters;
mod dense;
mod distance;
mod distance_rows;
mod error;
mod halving;
mod input;
mod merging;
mod neighbours;
mod options;
mod packed;
mod parallel;
mod plateau;
mod points;
#[cfg_attr(not(feature = "profile"), allow(dead_code))]
pub mod profile;
mod simd;
mod sorting;
mod spatial_order;
mod stages;
mod threshold;
mod tree;

use chain::{Condensed, merge_by_chain};
pub use error::Error;
pub use input::{Coordinate, Table};
pub use mograft_machine::instructions::{Isa, Level};
use mograft_machine::memory::{allocate, append, check_available, collect};
pub use options::{Options, Tuning, available_memory};
pub use parallel::Progress;
use parallel::{Workers, affordable_threads};
use points::Points;
use tree::Merge;

/// The example of the README, which runs with the tests.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;

/// Axes per multiple of the count of points that is merged on a matrix without any stage.
const AXES_PER_SIZE_FACTOR: usize = 128;

/// The largest such multiple.
const MAX_SIZE_FACTOR: usize = 3;

/// The tree of complete linkage over points, as the rows of SciPy's linkage matrix.
///
/// A row holds the numbers of the two clusters, the smaller first, their distance and the size of
/// the union. Of equal distances the pair with the lower representatives is merged first, as
/// described for this crate. Takes memory linear in n, and O(n²) time at worst; about n^1.4 on
/// clouds in ten dimensions. If the bounds exclude so few pairs that a matrix of all distances
/// takes less time, and `options.max_matrix_bytes` allows it, the matrix is used.
///
/// # Errors
///
/// If `points` has NaN or infinite elements or is not a whole number of points, if there are more
/// than 2^31 - 1 points, if the memory does not suffice, or if the progress callback requests a
/// stop.
///
/// # Examples
///
/// ```
/// use mograft_linkage::{Options, Table, linkage};
///
/// let points = [0.0_f32, 1.0, 5.0];
/// let tree = linkage(Table::rows(&points, 1), &Options::default())?;
/// assert_eq!(tree, [[0.0, 1.0, 1.0, 2.0], [2.0, 3.0, 5.0, 3.0]]);
/// # Ok::<(), mograft_linkage::Error>(())
/// ```
pub fn linkage<T: Coordinate>(
    points: Table<'_, T>,
    options: &Options<'_>,
) -> Result<Vec<[f64; 4]>, Error> {
    let (workers, scaled, merges) = merge_points(&points, f64::INFINITY, options)?;
    profile::begin_phase("tree");
    let to_height = |squared| scaled.distance_from_squared(squared);
    tree::linkage_matrix(&workers, points.len(), &merges, to_height)
}

/// The cluster of each point after all merges at heights up to and including `max_diameter`.
///
/// Clusters are numbered from 0 in the order of their first points. Time and memory are at most
/// those of [`linkage`].
///
/// # Errors
///
/// As for [`linkage`], and if `max_diameter` is negative or NaN.
///
/// # Examples
///
/// ```
/// use mograft_linkage::{Options, Table, cut};
///
/// let points = [0.0, 9.0, 1.0, 8.0];
/// let labels = cut(Table::rows(&points, 1), 2.0, &Options::default())?;
/// assert_eq!(labels, [0, 1, 0, 1]);
/// # Ok::<(), mograft_linkage::Error>(())
/// ```
pub fn cut<T: Coordinate>(
    points: Table<'_, T>,
    max_diameter: f64,
    options: &Options<'_>,
) -> Result<Vec<i64>, Error> {
    if max_diameter.is_nan() || max_diameter < 0.0 {
        return Err(Error::InvalidDiameter { value: max_diameter });
    }
    let (workers, _, merges) = merge_points(&points, max_diameter, options)?;
    tree::labels(&workers, points.len(), &merges)
}

/// The tree of complete linkage over a condensed matrix, as the rows of SciPy's linkage matrix.
///
/// `distances` holds the pairs (0, 1), (0, 2), …, (1, 2), …, and need not obey the triangle
/// inequality. Rows and ties are as for [`linkage`]. Takes O(n²) time, and the memory of a full
/// matrix if `options.max_matrix_bytes` allows it. Otherwise it takes that of a copy of
/// `distances`, uses the nearest-neighbour chain on one thread and is several times slower.
///
/// # Errors
///
/// If a distance is negative, infinite or NaN, if there are not n(n - 1)/2 of them for any n, or
/// if the progress callback requests a stop.
pub fn linkage_condensed<T: Coordinate>(
    distances: &[T],
    options: &Options<'_>,
) -> Result<Vec<[f64; 4]>, Error> {
    let copy_bytes = distances.len().saturating_mul(size_of::<f64>());
    let workers = workers_of(options, copy_bytes.saturating_mul(2));
    workers.check_progress()?;
    let n = input::check_condensed(&workers, distances)?;
    check_memory(copy_bytes, options)?;
    let merges = if matrix_fits(n, options.max_matrix_bytes.min(options.max_bytes)) {
        let rows = distance_rows::rows_of_condensed(&workers, n, distances)?;
        let pairs = dense::merge_on_matrix(&workers, rows)?.into_iter();
        collect(pairs.map(|(a, b, distance)| Merge::new(a, b, distance)))?
    } else {
        let mut copy = allocate(0.0, distances.len())?;
        for (i, (copied, &distance)) in copy.iter_mut().zip(distances).enumerate() {
            workers.check_item(i)?;
            // The sum turns -0 into 0, which would have another key.
            *copied = distance.into() + 0.0;
        }
        merge_by_chain(&workers, Condensed::new(n, copy))?
    };
    tree::linkage_matrix(&workers, n, &merges, |height| height)
}

/// The threads, the points, and all their merges at heights up to `max_height`.
fn merge_points<'a, T: Coordinate>(
    table: &Table<'_, T>,
    max_height: f64,
    options: &Options<'a>,
) -> Result<(Workers<'a>, Points, Vec<Merge>), Error> {
    let needed = table.len().saturating_mul(bytes_per_point(table.dim()));
    let workers = workers_of(options, needed);
    workers.check_progress()?;
    let largest = table.check(&workers)?;
    check_memory(needed, options)?;
    profile::begin_phase("points");
    let mut points = Points::new(&workers, table, largest)?;
    let mut merges = std::mem::take(&mut points.duplicate_merges);
    let max_squared = points.max_squared(max_height);
    let fits = matrix_fits(points.len(), options.max_matrix_bytes.min(options.max_bytes));
    // The more axes, the less the bounds exclude.
    let size_factor = MAX_SIZE_FACTOR.min(1 + points.dim / AXES_PER_SIZE_FACTOR);
    if fits && points.len() <= options.tuning.matrix_size * size_factor {
        let found = merge_points_on_matrix(&workers, &points, max_squared)?;
        append(&mut merges, found.into_iter())?;
        return Ok((workers, points, merges));
    }
    profile::begin_phase("halving");
    let points = points.sort_spatially(&workers)?;
    let max_work = if fits {
        options.tuning.matrix_work * distance_rows::work_of_matrix(points.len(), points.dim)
    } else {
        f64::INFINITY
    };
    let found = stages::merge_in_stages(&workers, &points, max_squared, max_work, &options.tuning)?;
    let found = match found {
        Some(found) => found,
        None => merge_points_on_matrix(&workers, &points, max_squared)?,
    };
    append(&mut merges, found.into_iter())?;
    Ok((workers, points, merges))
}

/// All merges of distinct points up to a squared distance, on the matrix of all distances.
fn merge_points_on_matrix(
    workers: &Workers<'_>,
    points: &Points,
    max_squared: f64,
) -> Result<Vec<Merge>, Error> {
    let mut representatives = collect(points.input_indices.iter().copied())?;
    representatives.sort_unstable();
    let rows = distance_rows::rows_of_points(workers, points, max_squared)?;
    let pairs = dense::merge_on_matrix(workers, rows)?.into_iter();
    let representative = |row: u32| representatives[row as usize];
    let merge = |(a, b, squared)| Merge::new(representative(a), representative(b), squared);
    Ok(collect(pairs.map(merge))?)
}

/// Upper bound, by experience, of the memory that stages take per point.
fn bytes_per_point(dim: usize) -> usize {
    3 * dim * size_of::<f64>() + 320
}

/// Check that a call may use `needed` bytes, and that the system has them.
///
/// The bytes are requested at once and released again, so that a call without enough memory fails
/// early.
fn check_memory(needed: usize, options: &Options<'_>) -> Result<(), Error> {
    let limit = options.max_bytes;
    if needed > limit {
        return Err(Error::MemoryLimit { needed, limit });
    }
    check_available(needed)?;
    Ok(())
}

/// The threads of a call that needs `bytes` bytes.
fn workers_of<'a>(options: &Options<'a>, bytes: usize) -> Workers<'a> {
    let n_threads = affordable_threads(options.threads, bytes);
    Workers::new(n_threads, Isa::up_to(options.tuning.level), options.progress)
}

/// Whether a matrix of n² distances has at most this many bytes.
fn matrix_fits(n: usize, max_bytes: usize) -> bool {
    n.checked_mul(n)
        .is_some_and(|cells| cells <= max_bytes / size_of::<f64>())
}
