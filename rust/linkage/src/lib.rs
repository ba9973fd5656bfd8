//! Exact complete linkage: points in, tree or labels out; nothing here knows of motion.

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
/// `points` is row-major, `dim` wide.
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
