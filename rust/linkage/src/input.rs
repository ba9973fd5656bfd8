//! Points as the caller holds them: f32 or f64, row-major or column-major.

use crate::error::Error;
use crate::parallel::Workers;

/// Largest count of points: a tree of n points numbers 2n - 1 clusters in 32 bits.
const MAX_POINTS: usize = (u32::MAX / 2) as usize;

/// Coordinates that one job reads.
const VALUES_PER_JOB: usize = 1 << 16;

/// Check a condensed matrix; return the count of its points.
///
/// # Errors
///
/// The first invalid distance, a length that is not n(n - 1)/2, or [`Error::Stopped`].
pub(crate) fn check_condensed<T: Coordinate>(
    workers: &Workers<'_>,
    distances: &[T],
) -> Result<usize, Error> {
    let len = distances.len();
    let n = f64::midpoint(1.0, (1.0 + 8.0 * len as f64).sqrt()).round() as usize;
    if n * (n - 1) / 2 != len {
        return Err(Error::InvalidLength { len });
    }
    if n > MAX_POINTS {
        return Err(Error::TooManyPoints { given: n, max: MAX_POINTS });
    }
    let is_invalid = |&x: &T| !(x.into() >= 0.0 && x.into() < f64::INFINITY);
    let invalid = workers.run(
        distances.chunks(VALUES_PER_JOB).enumerate(),
        || usize::MAX,
        |first, (job, distances)| {
            if let Some(i) = distances.iter().position(is_invalid) {
                *first = (*first).min(job * VALUES_PER_JOB + i);
            }
        },
    )?;
    let index = invalid.into_iter().min().unwrap_or(usize::MAX);
    match distances.get(index) {
        Some(&value) => Err(Error::InvalidDistance { index, value: value.into() }),
        None => Ok(n),
    }
}

/// A type of coordinates: `f32` or `f64`.
pub trait Coordinate: Copy + Into<f64> + Send + Sync + sealed::Sealed {}

impl Coordinate for f32 {}
impl Coordinate for f64 {}

mod sealed {
    /// Implemented for the types of coordinates only.
    pub trait Sealed {}
    impl Sealed for f32 {}
    impl Sealed for f64 {}
}

/// Points in memory that the caller owns, in either layout. Nothing is copied to make a table.
#[derive(Clone, Copy, Debug)]
pub struct Table<'a, T = f64> {
    values: &'a [T],
    dim: usize,
    is_row_major: bool,
}

impl<'a, T: Coordinate> Table<'a, T> {
    /// Points stored one after the other, `dim` coordinates each (C order).
    pub fn rows(values: &'a [T], dim: usize) -> Self {
        Self { values, dim, is_row_major: true }
    }

    /// Points of `dim` coordinates, stored one axis after the other (Fortran order).
    pub fn columns(values: &'a [T], dim: usize) -> Self {
        Self { values, dim, is_row_major: false }
    }

    /// Coordinates per point.
    pub fn dim(&self) -> usize {
        self.dim
    }

    /// Count of points.
    pub fn len(&self) -> usize {
        self.values.len().checked_div(self.dim).unwrap_or(0)
    }

    /// Whether the table has no points.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The coordinates of a point.
    pub(crate) fn row(&self, point: usize) -> impl Iterator<Item = f64> {
        let (start, step) =
            if self.is_row_major { (point * self.dim, 1) } else { (point, self.len()) };
        let values = self.values.get(start..).unwrap_or_default();
        values
            .iter()
            .step_by(step.max(1))
            .take(self.dim)
            .map(|&x| x.into())
    }

    /// Check shape, count and finiteness; return the largest absolute coordinate.
    ///
    /// # Errors
    ///
    /// The first invalid coordinate in the order of the points, or [`Error::Stopped`].
    pub(crate) fn check(&self, workers: &Workers<'_>) -> Result<f64, Error> {
        let (len, dim) = (self.values.len(), self.dim);
        if dim == 0 || !len.is_multiple_of(dim) {
            return Err(Error::InvalidShape { len, dim });
        }
        if self.len() > MAX_POINTS {
            return Err(Error::TooManyPoints { given: self.len(), max: MAX_POINTS });
        }
        let parts = workers.run(
            self.values.chunks(VALUES_PER_JOB),
            || (0.0, true),
            |(largest, is_finite): &mut (f64, bool), values| {
                for &x in values {
                    let size: f64 = x.into().abs();
                    *largest = size.max(*largest);
                    *is_finite &= size < f64::INFINITY;
                }
            },
        )?;
        if parts.iter().all(|&(_, is_finite)| is_finite) {
            return Ok(parts.iter().fold(0.0, |a, part| part.0.max(a)));
        }
        let rows = (0..self.len()).map(|point| self.row(point).position(|x| !x.is_finite()));
        let invalid = rows
            .enumerate()
            .find_map(|(point, axis)| axis.map(|axis| (point, axis)));
        let (point, axis) = invalid.unwrap_or_default();
        let value = self.row(point).nth(axis).unwrap_or(f64::NAN);
        Err(Error::InvalidCoordinate { point, axis, value })
    }
}
