//! Exact complete linkage: points in, tree or labels out; nothing here knows of motion.

mod chain;
mod error;
mod tree;

use chain::{Condensed, chain};
pub use error::Error;

/// The most points that a tree can number.
const MOST: usize = (u32::MAX / 2) as usize;

/// How to go about it; what comes out is the same for all.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// Threads to compute on; at least one is used.
    pub threads: usize,
}

/// The whole tree over points, as the rows of SciPy's linkage matrix.
///
/// `points` is row-major, `dim` wide.
///
/// # Errors
///
/// If `points` are not finite, or no whole number of them.
pub fn linkage(points: &[f64], dim: usize, _options: &Options) -> Result<Vec<[f64; 4]>, Error> {
    let n = check_points(points, dim)?;
    let merges = chain(Condensed::from_fn(n, |a, b| squared_distance(points, dim, a, b)));
    Ok(tree::linkage_matrix(n, &merges, f64::sqrt))
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
    _options: &Options,
) -> Result<Vec<i64>, Error> {
    let n = check_points(points, dim)?;
    if max_diameter.is_nan() || max_diameter < 0.0 {
        return Err(Error::BadDiameter);
    }
    let mut merges = chain(Condensed::from_fn(n, |a, b| squared_distance(points, dim, a, b)));
    merges.retain(|merge| merge.height.sqrt() <= max_diameter);
    Ok(tree::labels(n, &merges))
}

/// The whole tree over a condensed matrix of distances, as the rows of SciPy's linkage matrix.
///
/// # Errors
///
/// If a distance is negative or not finite, or their number is no n(n-1)/2.
pub fn linkage_condensed(distances: Vec<f64>, _options: &Options) -> Result<Vec<[f64; 4]>, Error> {
    let len = distances.len();
    let n = f64::midpoint(1.0, (1.0 + 8.0 * len as f64).sqrt()).round() as usize;
    if n * (n - 1) / 2 != len {
        return Err(Error::NotCondensed { len });
    }
    let is_good = |distance: &f64| distance.is_finite() && *distance >= 0.0;
    if let Some(index) = distances.iter().position(|distance| !is_good(distance)) {
        return Err(Error::BadDistance { index });
    }
    let merges = chain(Condensed::new(n, distances));
    Ok(tree::linkage_matrix(n, &merges, |height| height))
}

fn squared_distance(points: &[f64], dim: usize, a: usize, b: usize) -> f64 {
    let [a, b] = [a, b].map(|point| &points[point * dim..(point + 1) * dim]);
    let mut sum = 0.0;
    for (x, y) in a.iter().zip(b) {
        sum += (x - y) * (x - y);
    }
    sum
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
