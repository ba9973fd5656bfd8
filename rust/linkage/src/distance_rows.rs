//! The full matrix of distances, one row per cluster, infinite on the diagonal.

use crate::clusters::Clusters;
use crate::distance::{ClusterDistances, Limit, Scratch};
use crate::error::Error;
use crate::input::Coordinate;
use crate::parallel::Workers;
use crate::points::Points;
use crate::simd::{self, Aligned, F64Lanes, LANES, TILE_ROWS};
use mograft_machine::memory::{allocate, check_available, collect, with_capacity};

/// Axes that a tile reads at a time: with this number, its points stay in the cache.
const AXES_PER_STEP: usize = 256;

/// Blocks of sixteen points in a tile, along its columns.
const BLOCKS_PER_TILE: usize = 4;

/// Rows in a tile.
const ROWS_PER_TILE: usize = 64;

/// Smallest count of axes for which only half of the matrix is computed and then copied.
const MIN_MIRRORED_DIM: usize = 32;

/// Work of merging, per distance of the matrix, in the unit of [`Workers::add_work`].
const MERGING_WORK: f64 = 80.0;

/// The work of merging `n` points with `dim` axes on the matrix of their distances.
pub(crate) fn work_of_matrix(n: usize, dim: usize) -> f64 {
    let computed = if dim < MIN_MIRRORED_DIM { 1.0 } else { 0.5 };
    (n as f64) * (n as f64) * (computed * dim as f64 + MERGING_WORK)
}

/// Points sixteen side by side, ordered by representative.
struct Columns {
    /// `dim` elements per block.
    lanes: Vec<F64Lanes>,
    dim: usize,
}

/// The matrix of squared distances of points, in the order of the input; infinity beyond
/// `max_squared`.
///
/// Takes O(n² d) time for n points with d axes.
///
/// # Errors
///
/// [`Error::OutOfMemory`] and [`Error::Stopped`].
pub(crate) fn rows_of_points(
    workers: &Workers<'_>,
    points: &Points,
    max_squared: f64,
) -> Result<Vec<Vec<f64>>, Error> {
    let (n, dim) = (points.len(), points.dim);
    let mut order: Vec<u32> = collect(0..n as u32)?;
    order.sort_unstable_by_key(|&row| points.input_indices[row as usize]);
    let mut sorted = workers.allocate(0.0, n * dim)?;
    for (i, (target, &row)) in sorted.chunks_exact_mut(dim).zip(&order).enumerate() {
        workers.check_row(i, dim)?;
        target.copy_from_slice(points.row(row));
    }
    let columns = Columns::new(workers, &sorted, dim)?;
    let is_mirrored = dim >= MIN_MIRRORED_DIM;
    let mut rows = allocate(Vec::new(), n)?;
    workers.run(
        rows.chunks_mut(ROWS_PER_TILE).enumerate(),
        || {
            let sums = allocate(0.0, ROWS_PER_TILE * BLOCKS_PER_TILE * LANES);
            workers.ok_or_stop(sums).unwrap_or_default()
        },
        |sums, (band, rows)| {
            let first = band * ROWS_PER_TILE;
            let points = &sorted[first * dim..(first + rows.len()) * dim];
            for row in &mut *rows {
                let Some(infinities) = workers.ok_or_stop(allocate(f64::INFINITY, n)) else {
                    return;
                };
                *row = infinities;
            }
            let start = if is_mirrored { first } else { 0 };
            columns.fill_rows(workers, points, start, rows, sums);
            for (i, row) in rows.iter_mut().enumerate() {
                row[first + i] = f64::INFINITY;
            }
        },
    )?;
    if is_mirrored {
        mirror(workers, &mut rows)?;
    }
    if max_squared < f64::INFINITY {
        workers.run(
            rows.chunks_mut(ROWS_PER_TILE),
            || (),
            |(), rows| {
                for squared in rows.iter_mut().flatten() {
                    *squared = if *squared <= max_squared { *squared } else { f64::INFINITY };
                }
            },
        )?;
    }
    Ok(rows)
}

impl Columns {
    fn new(workers: &Workers<'_>, points: &[f64], dim: usize) -> Result<Self, Error> {
        let n_blocks = (points.len() / dim).div_ceil(LANES);
        let mut lanes = workers.allocate(Aligned([0.0; LANES]), n_blocks * dim)?;
        for (i, point) in points.chunks_exact(dim).enumerate() {
            workers.check_row(i, dim)?;
            let block = &mut lanes[i / LANES * dim..][..dim];
            for (lanes, &x) in block.iter_mut().zip(point) {
                lanes[i % LANES] = x;
            }
        }
        Ok(Self { lanes, dim })
    }

    /// Squared distances of some points to all from column `start` on, a multiple of the tiles.
    fn fill_rows(
        &self,
        workers: &Workers<'_>,
        points: &[f64],
        start: usize,
        rows: &mut [Vec<f64>],
        sums: &mut [f64],
    ) {
        let (dim, width) = (self.dim, BLOCKS_PER_TILE * LANES);
        let tiles = self.lanes.chunks(BLOCKS_PER_TILE * dim);
        let mut work = 0;
        for (tile, lanes) in tiles.enumerate().skip(start / width) {
            work += (rows.len() * width * dim) as u64;
            if !workers.can_continue(&mut work) {
                return;
            }
            sums.fill(0.0);
            for axis in (0..dim).step_by(AXES_PER_STEP) {
                let end = dim.min(axis + AXES_PER_STEP);
                for (group, sums) in points
                    .chunks(TILE_ROWS * dim)
                    .zip(sums.chunks_exact_mut(TILE_ROWS * width))
                {
                    simd::add_squares(workers.isa, group, dim, axis, end, lanes, sums);
                }
            }
            for (row, sums) in rows.iter_mut().zip(sums.chunks_exact(width)) {
                let columns = tile * width..row.len().min((tile + 1) * width);
                let sums = &sums[..columns.len()];
                row[columns].copy_from_slice(sums);
            }
        }
    }
}

/// Copy the upper triangle of a matrix to the lower one, outside the blocks on the diagonal.
///
/// In each step all rows form pairs of parts of `size` rows: the second is copied from the first.
fn mirror(workers: &Workers<'_>, rows: &mut [Vec<f64>]) -> Result<(), Error> {
    let mut size = ROWS_PER_TILE;
    while size < rows.len() {
        let mut jobs = Vec::new();
        for (i, part) in rows.chunks_mut(2 * size).enumerate() {
            let (low, high) = part.split_at_mut(size.min(part.len()));
            let low = &*low;
            for (j, high) in high.chunks_mut(LANES).enumerate() {
                jobs.push((i * 2 * size, i * 2 * size + size + j * LANES, low, high));
            }
        }
        workers.run(
            jobs.into_iter(),
            || (),
            |(), (low_start, high_start, low, high)| {
                for (k, low) in low.chunks(LANES).enumerate() {
                    for (i, row) in high.iter_mut().enumerate() {
                        let target = &mut row[low_start + k * LANES..][..low.len()];
                        for (x, source) in target.iter_mut().zip(low) {
                            *x = source[high_start + i];
                        }
                    }
                }
            },
        )?;
        size *= 2;
    }
    Ok(())
}

/// The matrix of squared distances of clusters; infinity beyond `max_squared`.
///
/// None if all work together exceeds `max_work`.
///
/// # Errors
///
/// [`Error::OutOfMemory`], and [`Error::Stopped`] if the progress callback requests a stop.
pub(crate) fn rows_of_clusters(
    workers: &Workers<'_>,
    points: &Points,
    clusters: &Clusters,
    max_squared: f64,
    max_work: f64,
) -> Result<Option<Vec<Vec<f64>>>, Error> {
    let distances = ClusterDistances::new(workers, points, clusters)?;
    let limit = Limit::from_squared(max_squared);
    let m = clusters.len();
    check_available(m.saturating_mul(m).saturating_mul(size_of::<f64>()))?;
    let mut rows = with_capacity(m)?;
    for _ in 0..m {
        workers.check_progress()?;
        rows.push(allocate(f64::INFINITY, m)?);
    }
    workers.run(rows.iter_mut().enumerate(), Scratch::default, |scratch, (a, row)| {
        for (b, squared) in row.iter_mut().enumerate().skip(a + 1) {
            if workers.work() <= max_work {
                let distance = distances.squared_within(a, b, limit, scratch);
                *squared = distance.unwrap_or(f64::INFINITY);
                if !workers.can_continue(&mut scratch.work) {
                    break;
                }
            }
        }
        workers.add_work(std::mem::take(&mut scratch.work));
        workers.ok_or_stop(scratch.check_memory());
    })?;
    if workers.work() > max_work {
        return Ok(None);
    }
    for a in 0..m {
        workers.check_progress()?;
        let (rows_before, rows_from) = rows.split_at_mut(a);
        for (row, squared) in rows_before.iter().zip(&mut rows_from[0]) {
            *squared = row[a];
        }
    }
    Ok(Some(rows))
}

/// Rows that are read together from a condensed matrix: the f64 of a cache line.
const ROWS_PER_BAND: usize = 8;

/// The full matrix, infinite on the diagonal, of a condensed one of `n` clusters.
///
/// # Errors
///
/// [`Error::OutOfMemory`], and [`Error::Stopped`] if the progress callback requests a stop.
pub(crate) fn rows_of_condensed<T: Coordinate>(
    workers: &Workers<'_>,
    n: usize,
    distances: &[T],
) -> Result<Vec<Vec<f64>>, Error> {
    // Row a of the upper triangle, from column a + 1 on.
    let upper = |a: usize| &distances[a * (2 * n - a - 1) / 2..][..n - a - 1];
    check_available(n.saturating_mul(n).saturating_mul(size_of::<f64>()))?;
    let mut rows: Vec<Vec<f64>> = allocate(Vec::new(), n)?;
    workers.run(
        rows.chunks_mut(ROWS_PER_BAND).enumerate(),
        || (),
        |(), (band, rows)| {
            let first = band * ROWS_PER_BAND;
            for row in &mut *rows {
                let Some(infinities) = workers.ok_or_stop(allocate(f64::INFINITY, n)) else {
                    return;
                };
                *row = infinities;
            }
            for b in 0..(first + rows.len()).min(n) {
                // Elements below the diagonal are those of a column of the upper triangle. The
                // sum turns -0 into 0.
                for (i, row) in rows.iter_mut().enumerate().filter(|&(i, _)| b < first + i) {
                    row[b] = upper(b)[first + i - b - 1].into() + 0.0;
                }
            }
            for (i, row) in rows.iter_mut().enumerate() {
                let a = first + i;
                for (element, &distance) in row[a + 1..].iter_mut().zip(upper(a)) {
                    *element = distance.into() + 0.0;
                }
            }
        },
    )?;
    Ok(rows)
}
