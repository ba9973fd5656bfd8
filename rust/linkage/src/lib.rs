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
//! alone; D² is at least that mean. This bound, computed for blocks of sixteen clusters, excludes
//! most pairs from exact measurement.
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
//! | [`parallel`] | scoped threads, progress, stopping |
//! | [`options`] | resources and tuning of a call |
//! | [`tree`] | from merges to SciPy's matrix or to labels |
//! | [`halving`] | spatial sorting of rows |
//! | [`points`] | scaling, duplicates, the squared distance that determines results |
//! | [`clusters`] | centres, variances and radii, and those of unions |
//! | [`spatial_order`] | spatial sorting of clusters, with regard to density |
//! | [`packed`] | members of clusters as f32 offsets, sixteen side by side |
//! | [`distance`] | the exact distance of two clusters, from few of their points |
//! | [`blocks`] | bounding boxes of sixteen clusters |
//! | [`neighbours`] | all pairs within a limit: three filters over blocks |
//! | [`threshold`] | the choice of T, from a sample |
//! | [`merging`] | merging on the sparse graph |
//! | [`plateau`] | merging if too many pairs have the same distance for any graph |
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

mod blocks;
mod chain;
mod clusters;
mod dense;
mod distance;
mod error;
mod halving;
mod merging;
mod neighbours;
mod options;
mod packed;
mod parallel;
mod plateau;
mod points;
mod simd;
mod spatial_order;
mod stages;
mod threshold;
mod tree;

use chain::{Condensed, merge_by_chain};
pub use error::Error;
pub use options::{Options, Tuning};
pub use parallel::Progress;
use parallel::Workers;
use points::Points;
pub use simd::{Isa, Level};
use tree::Merge;

/// Largest count of points: a tree of n points numbers 2n - 1 clusters in 32 bits.
const MAX_POINTS: usize = (u32::MAX / 2) as usize;

/// The tree of complete linkage over points, as the rows of SciPy's linkage matrix.
///
/// `points` is row-major, `dim` wide. A row holds the numbers of the two clusters, the smaller
/// first, their distance and the size of the union. Of equal distances the pair with the lower
/// representatives is merged first, as described for this crate. Takes memory linear in n and
/// O(n²) time at worst; about n^1.7 on clouds in ten dimensions, because the filters compare
/// sixteen clusters at a time or none.
///
/// # Errors
///
/// If `points` has NaN or infinite elements or is not a whole number of points, if there are more
/// than 2^31 - 1 points, or if the progress callback requests a stop.
pub fn linkage(points: &[f64], dim: usize, options: &Options<'_>) -> Result<Vec<[f64; 4]>, Error> {
    let n = check_points(points, dim)?;
    let (points, merges) = merge_points(points, dim, f64::INFINITY, options)?;
    Ok(tree::linkage_matrix(n, &merges, |squared| points.distance_from_squared(squared)))
}

/// The cluster of each point after all merges at heights up to and including `max_diameter`.
///
/// `points` is row-major, `dim` wide. Clusters are numbered from 0 in the order of their first
/// points. Time and memory are at most those of [`linkage`].
///
/// # Errors
///
/// As for [`linkage`], and if `max_diameter` is negative or NaN.
pub fn cut(
    points: &[f64],
    dim: usize,
    max_diameter: f64,
    options: &Options<'_>,
) -> Result<Vec<i64>, Error> {
    let n = check_points(points, dim)?;
    if max_diameter.is_nan() || max_diameter < 0.0 {
        return Err(Error::InvalidDiameter { value: max_diameter });
    }
    let (_, merges) = merge_points(points, dim, max_diameter, options)?;
    Ok(tree::labels(n, &merges))
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
pub fn linkage_condensed(distances: &[f64], options: &Options<'_>) -> Result<Vec<[f64; 4]>, Error> {
    let len = distances.len();
    let n = f64::midpoint(1.0, (1.0 + 8.0 * len as f64).sqrt()).round() as usize;
    if n * (n - 1) / 2 != len {
        return Err(Error::InvalidLength { len });
    }
    let is_valid = |distance: f64| distance.is_finite() && distance >= 0.0;
    for (index, &value) in distances.iter().enumerate() {
        if !is_valid(value) {
            return Err(Error::InvalidDistance { index, value });
        }
    }
    let workers = workers_of(options);
    let merges = if matrix_fits(n, options.max_matrix_bytes) {
        let rows = dense::rows_of_condensed(&workers, n, distances)?;
        dense::merge_on_matrix(&workers, rows)?
            .into_iter()
            .map(|(a, b, distance)| Merge::new(a, b, distance))
            .collect()
    } else {
        // The sum turns -0 into 0, which would have another key.
        let copy = distances.iter().map(|x| x + 0.0).collect();
        merge_by_chain(&workers, Condensed::new(n, copy))?
    };
    Ok(tree::linkage_matrix(n, &merges, |height| height))
}

/// The points, and all their merges at heights up to `max_height`.
fn merge_points(
    points: &[f64],
    dim: usize,
    max_height: f64,
    options: &Options<'_>,
) -> Result<(Points, Vec<Merge>), Error> {
    let workers = workers_of(options);
    workers.check_progress()?;
    let points = Points::new(points, dim).sort_spatially(&workers);
    let mut merges = points.duplicate_merges.clone();
    let tuning = if matrix_fits(points.len(), options.max_matrix_bytes) {
        Tuning { dense_size: points.len(), ..options.tuning }
    } else {
        options.tuning
    };
    let max_squared = points.max_squared(max_height);
    merges.extend(stages::merge_in_stages(&workers, &points, max_squared, &tuning)?);
    Ok((points, merges))
}

fn workers_of<'a>(options: &Options<'a>) -> Workers<'a> {
    Workers::new(options.threads, Isa::up_to(options.tuning.level), options.progress)
}

/// Whether a matrix of n² distances has at most this many bytes.
fn matrix_fits(n: usize, max_bytes: usize) -> bool {
    n.checked_mul(n)
        .is_some_and(|cells| cells <= max_bytes / size_of::<f64>())
}

/// Check the shape, count and finiteness of points; return their count.
fn check_points(points: &[f64], dim: usize) -> Result<usize, Error> {
    let len = points.len();
    if dim == 0 || !len.is_multiple_of(dim) {
        return Err(Error::InvalidShape { len, dim });
    }
    if len / dim > MAX_POINTS {
        return Err(Error::TooManyPoints { given: len / dim, max: MAX_POINTS });
    }
    match points.iter().position(|x| !x.is_finite()) {
        Some(i) => {
            Err(Error::InvalidCoordinate { point: i / dim, axis: i % dim, value: points[i] })
        }
        None => Ok(len / dim),
    }
}
