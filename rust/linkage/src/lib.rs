//! Exact complete linkage in linear memory: points in, tree or labels out.
//!
//! Complete linkage merges, again and again, the two clusters whose farthest points are
//! nearest: D(A, C) = max |a − c|. Every textbook algorithm holds all n²/2 distances. This one
//! holds, at any time, those of a few neighbours of each cluster, and grows the same tree, bit
//! for bit. Nothing here knows of motion or of Python.
//!
//! # Why it is right
//!
//! **One order of merging.** Give each pair of clusters the key (D², lower representative,
//! higher representative), where a cluster's representative is the smallest index among its
//! points. No two pairs have the same key. And merging brings nothing nearer: of the two keys
//! of A and B to a third cluster C, that of A ∪ B is never less than the lesser. For where D²
//! differ, the union takes the larger; where they are equal, the union's representative is that
//! of A or of B, and its key is theirs.
//!
//! **Any order of finding.** So two clusters that are each other's nearest stay so whatever
//! else merges, until they do: they may as well merge at once. The pair of least key is always
//! such a pair, and greedy search, the nearest-neighbour chain and rounds of merging all such
//! pairs at once make the same merges. Their one order is put back at the end ([`tree`]).
//!
//! **A limit costs nothing.** Take all pairs of clusters with D ≤ T, exactly, and merge on this
//! sparse graph until no edge is left. A pair that is no edge is farther than T, so two clusters
//! that are nearest to each other in the graph are so among all. The graph keeps up with its
//! merges without any point being looked at: A ∪ B is within T of C if and only if both parts
//! are, at the larger of the two distances, because D of a union is a maximum. When it is
//! exhausted, everything up to height T is done. Then comes another *stage*, with the clusters
//! that there are now and a larger T. **Any T is right**, and so is any number of threads and
//! any block size; they decide only how long it takes. Flat clusters of diameter t are the same
//! run with T never above t, stopped when it has been t.
//!
//! **Few pairs need a look.** For any weights that add up to one, the weighted mean of |a − c|²
//! over the points of A and C is |c_A − c_C|² + V_A + V_C, from the weighted centres and
//! variances alone, and D² is no less. This bound, in blocks of sixteen clusters, leaves few
//! pairs to measure exactly.
//!
//! **No float decides but the right one.** Squared distances are summed in f64, coordinate by
//! coordinate, never fused or reordered: the same bits on every processor, and SciPy's. f32 is
//! used to rule pairs out, always with an allowance for its rounding, never to rank them.
//!
//! # Where it is
//!
//! | module | idea |
//! |---|---|
//! | [`stages`] | the loop: limit, graph, merging, clusters anew; few clusters on a matrix |
//! | [`limit`] | how large a T is worth while, from a sample |
//! | [`graph`] | all pairs within T: three sieves over blocks of clusters |
//! | [`distance`] | the exact distance of two clusters, from few of their points |
//! | [`merging`] | nearest pairs merge on the sparse graph, to exhaustion |
//! | [`plateau`] | the same where too many pairs are equally far for any graph |
//! | [`clusters`] | centres, variances and radii, and how unions get theirs |
//! | [`dense`] | merging on a full matrix, at the speed of memory |
//! | [`order`] | what is near in space is near in memory |
//! | [`points`] | scaling, repeated points, the squared distance that decides |
//! | [`tree`] | merges to SciPy's matrix, or to labels |
//! | [`mod@chain`] | the plain nearest-neighbour chain: what all is tested against |
//! | [`simd`] | the inner loops for three instruction sets; all `unsafe` |
//! | [`parallel`] | sharing out work; progress; stopping |
//!
//! Anchors: Müllner, *Modern hierarchical, agglomerative clustering algorithms*,
//! arXiv:1109.2378 (chain, reducibility); Yu et al., *ParChain*, VLDB 2021 (linear memory by
//! range queries); Bădoiu and Clarkson, *Smaller core-sets for balls*, SODA 2003 (the balls).
#![allow(rustdoc::private_intra_doc_links, reason = "the essay is for readers of the source")]

mod chain;
mod clusters;
mod dense;
mod distance;
mod error;
mod graph;
mod limit;
mod merging;
mod order;
mod parallel;
mod plateau;
mod points;
mod simd;
mod stages;
mod tree;

use chain::{Condensed, chain};
pub use error::Error;
use parallel::Crew;
pub use parallel::Watch;
use points::Points;
pub use simd::{Isa, Level};
use tree::Merge;

/// The most points that a tree can number.
const MOST: usize = (u32::MAX / 2) as usize;

/// How to go about it; what comes out is the same for all.
#[derive(Clone, Copy)]
pub struct Options<'a> {
    /// Threads to compute on; at least one is used.
    pub threads: usize,
    /// Bytes that a matrix of all distances may take.
    pub memory: usize,
    /// Asked a few times a second whether to go on.
    pub watch: Option<Watch<'a>>,
    /// What tests turn.
    pub tuning: Tuning,
}

impl Default for Options<'_> {
    /// One thread, 16 MiB, nobody asked.
    fn default() -> Self {
        Self { threads: 1, memory: 16 << 20, watch: None, tuning: Tuning::default() }
    }
}

/// Numbers that make it fast or slow, and change nothing else.
#[derive(Clone, Copy, Debug)]
pub struct Tuning {
    /// The widest instructions to use.
    pub level: Level,
    /// Neighbours that a stage looks for around a cluster.
    pub degree: f64,
    /// So few clusters are finished on a matrix.
    pub finish: usize,
    /// Edges that a stage may have in excess of those it hoped for.
    pub crowd: usize,
}

impl Default for Tuning {
    fn default() -> Self {
        Self { level: Level::Avx512, degree: 16.0, finish: 256, crowd: 1 << 20 }
    }
}

/// The whole tree over points, as the rows of SciPy's linkage matrix.
///
/// `points` is row-major, `dim` wide. Rows come in the order of their keys, unions after their
/// parts. Takes memory linear in n, and time of O(n²) at worst; of about n to 1.7 on clouds of ten
/// axes, because most of the n² is done sixteen by sixteen or not at all.
///
/// # Errors
///
/// If `points` are not finite, or no whole number of them; if the caller wants to stop.
pub fn linkage(points: &[f64], dim: usize, options: &Options<'_>) -> Result<Vec<[f64; 4]>, Error> {
    let n = check_points(points, dim)?;
    let (points, merges) = merge_points(points, dim, f64::INFINITY, options)?;
    Ok(tree::linkage_matrix(n, &merges, |squared| points.distance(squared)))
}

/// The cluster of each point after all merges no higher than `max_diameter`.
///
/// Clusters are numbered from 0 in order of their smallest indices.
///
/// # Errors
///
/// As for [`linkage`], and if `max_diameter` is negative or not a number.
pub fn cut(
    points: &[f64],
    dim: usize,
    max_diameter: f64,
    options: &Options<'_>,
) -> Result<Vec<i64>, Error> {
    let n = check_points(points, dim)?;
    if max_diameter.is_nan() || max_diameter < 0.0 {
        return Err(Error::BadDiameter);
    }
    let (_, merges) = merge_points(points, dim, max_diameter, options)?;
    Ok(tree::labels(n, &merges))
}

/// All merges no higher than `most`.
fn merge_points(
    points: &[f64],
    dim: usize,
    most: f64,
    options: &Options<'_>,
) -> Result<(Points, Vec<Merge>), Error> {
    let crew = Crew::new(options.threads, Isa::up_to(options.tuning.level), options.watch);
    crew.ask()?;
    let points = Points::new(points, dim).in_spatial_order(&crew);
    let mut merges = points.repeats.clone();
    let tuning = if matrix_fits(points.len(), options.memory) {
        Tuning { finish: points.len(), ..options.tuning }
    } else {
        options.tuning
    };
    merges.extend(stages::merges(&crew, &points, points.squared(most), &tuning)?);
    Ok((points, merges))
}

/// Whether a matrix of n² distances takes no more bytes than these.
fn matrix_fits(n: usize, bytes: usize) -> bool {
    n.checked_mul(n)
        .is_some_and(|cells| cells <= bytes / size_of::<f64>())
}

/// The whole tree over a condensed matrix of distances, as the rows of SciPy's linkage matrix.
///
/// The pairs stand in the order (0, 1), (0, 2), …, (1, 2), …. Takes O(n²) time, and as many
/// bytes as a full matrix if `options.memory` allows them; else a copy of the distances and
/// several times longer, on one thread, by the plain chain.
///
/// # Errors
///
/// If a distance is negative or not finite, or their number is no n(n-1)/2; if the caller
/// wants to stop.
pub fn linkage_condensed(distances: &[f64], options: &Options<'_>) -> Result<Vec<[f64; 4]>, Error> {
    let len = distances.len();
    let n = f64::midpoint(1.0, (1.0 + 8.0 * len as f64).sqrt()).round() as usize;
    if n * (n - 1) / 2 != len {
        return Err(Error::NotCondensed { len });
    }
    let is_good = |distance: &f64| distance.is_finite() && *distance >= 0.0;
    if let Some(index) = distances.iter().position(|distance| !is_good(distance)) {
        return Err(Error::BadDistance { index });
    }
    let crew = Crew::new(options.threads, Isa::up_to(options.tuning.level), options.watch);
    let merges = if matrix_fits(n, options.memory) {
        let rows = dense::rows_of_condensed(&crew, n, distances)?;
        let pairs = dense::merge(&crew, rows)?;
        pairs
            .into_iter()
            .map(|(a, b, distance)| Merge::new(a, b, distance))
            .collect()
    } else {
        // The sum makes 0 of -0, which would be sorted apart.
        chain(&crew, Condensed::new(n, distances.iter().map(|x| x + 0.0).collect()))?
    };
    Ok(tree::linkage_matrix(n, &merges, |height| height))
}

/// The tree as [`linkage`] finds it, by the plain chain over all distances.
///
/// For tests: it takes O(n²) time and memory.
///
/// # Errors
///
/// As for [`linkage`].
pub fn linkage_by_chain(points: &[f64], dim: usize) -> Result<Vec<[f64; 4]>, Error> {
    let n = check_points(points, dim)?;
    let points = Points::new(points, dim);
    let squared = |a, b| points::squared_distance(points.row(a as u32), points.row(b as u32));
    let crew = Crew::new(1, Isa::up_to(Level::Baseline), None);
    let mut merges = points.repeats.clone();
    merges.extend(
        chain(&crew, Condensed::from_fn(points.len(), squared))?
            .iter()
            .map(|merge| Merge {
                low: points.given_at[merge.low as usize],
                high: points.given_at[merge.high as usize],
                ..*merge
            }),
    );
    Ok(tree::linkage_matrix(n, &merges, |squared| points.distance(squared)))
}

/// The number of points, if they can be clustered.
fn check_points(points: &[f64], dim: usize) -> Result<usize, Error> {
    let len = points.len();
    if dim == 0 || !len.is_multiple_of(dim) {
        return Err(Error::NoPoints { len, dim });
    }
    if len / dim > MOST {
        return Err(Error::TooManyPoints { given: len / dim, most: MOST });
    }
    match points.iter().position(|x| !x.is_finite()) {
        Some(place) => Err(Error::NotFinite { point: place / dim, axis: place % dim }),
        None => Ok(len / dim),
    }
}
