//! Spatial sorting: rows that are near in space become near in memory.
//!
//! The rows are halved recursively along the axis of largest variance, as in a k-d tree.

use crate::error::Error;
use crate::parallel::Workers;
use crate::simd::LANES;
use mograft_machine::memory::append;

/// Rows of which the variance along each axis is estimated.
const SAMPLE_SIZE: usize = 256;

/// Largest part that one job sorts.
const MAX_PART_ROWS: usize = 1 << 14;

/// Work of a coordinate of the sample, in the unit of [`Workers::add_work`].
const COORDINATE_WORK: u64 = 4;

/// Work of a row that is moved to its half.
const ROW_WORK: u64 = 64;

/// The buffers of a thread.
#[derive(Default)]
struct Scratch {
    /// A part of the rows, with one coordinate of each.
    keyed: Vec<(f64, u32)>,
    /// Work done since the last check of the progress.
    work: u64,
}

/// Sort `order`, a list of rows of `points`, by recursive halving.
///
/// `points` is row-major, `dim` wide, and not NaN. Halves begin at multiples of [`LANES`], so that
/// every block of that many rows is a box of the halving. Rows of equal coordinates are ordered by
/// index: the result does not depend on the threads. Takes O(n log n) time for n rows.
///
/// # Errors
///
/// [`Error::OutOfMemory`], and [`Error::Stopped`] if the progress callback requests a stop.
pub(crate) fn sort_by_halving(
    workers: &Workers<'_>,
    points: &[f64],
    dim: usize,
    order: &mut [u32],
) -> Result<(), Error> {
    let mut parts = vec![order];
    // In each step all parts are halved at the same time.
    while parts.iter().any(|part| part.len() > MAX_PART_ROWS) {
        let states = workers.run(parts.iter_mut(), Scratch::default, |scratch, part| {
            workers.ok_or_stop(halve(points, dim, part, scratch));
        })?;
        for scratch in states {
            workers.add_work(scratch.work);
        }
        parts = (parts.into_iter())
            .flat_map(|part| {
                let middle = middle_of(part.len());
                let (low, high) = part.split_at_mut(middle);
                [low, high]
            })
            .collect();
    }
    let states = workers.run(parts.into_iter(), Scratch::default, |scratch, part| {
        workers.ok_or_stop(sort_part(workers, points, dim, part, scratch));
    })?;
    for scratch in states {
        workers.add_work(scratch.work);
    }
    Ok(())
}

/// Sort a part on this thread.
fn sort_part(
    workers: &Workers<'_>,
    points: &[f64],
    dim: usize,
    order: &mut [u32],
    scratch: &mut Scratch,
) -> Result<(), Error> {
    if order.len() > LANES {
        halve(points, dim, order, scratch)?;
        if !workers.can_continue(&mut scratch.work) {
            return Ok(());
        }
        let (low, high) = order.split_at_mut(middle_of(order.len()));
        sort_part(workers, points, dim, low, scratch)?;
        sort_part(workers, points, dim, high, scratch)?;
    }
    Ok(())
}

/// Where the second half begins; the end if there is one block only.
fn middle_of(len: usize) -> usize {
    let middle = (len / 2).next_multiple_of(LANES);
    if len > LANES { middle.min(len - 1) } else { len }
}

/// Move the rows of the first half before the others.
fn halve(
    points: &[f64],
    dim: usize,
    order: &mut [u32],
    scratch: &mut Scratch,
) -> Result<(), Error> {
    let middle = middle_of(order.len());
    if middle == order.len() {
        return Ok(());
    }
    let axis = widest_axis(points, dim, order);
    scratch.work += (dim * SAMPLE_SIZE.min(order.len())) as u64 * COORDINATE_WORK
        + order.len() as u64 * ROW_WORK;
    let keyed = &mut scratch.keyed;
    keyed.clear();
    append(
        keyed,
        order
            .iter()
            .map(|&row| (points[row as usize * dim + axis], row)),
    )?;
    keyed.select_nth_unstable_by(middle, |a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    for (row, keyed) in order.iter_mut().zip(keyed) {
        *row = keyed.1;
    }
    Ok(())
}

/// The axis of largest variance, estimated from evenly spaced rows; of equal axes the first.
fn widest_axis(points: &[f64], dim: usize, order: &[u32]) -> usize {
    let sample = order
        .iter()
        .step_by(order.len().div_ceil(SAMPLE_SIZE))
        .map(|&row| &points[row as usize * dim..][..dim]);
    // Coordinates are taken relative to a row, so that points far from the origin keep their
    // digits.
    let origin = &points[order[0] as usize * dim..][..dim];
    let (mut sums, mut squares) = (vec![0.0; dim], vec![0.0; dim]);
    let mut count = 0.0;
    for row in sample {
        for (axis, (&x, &x0)) in row.iter().zip(origin).enumerate() {
            sums[axis] += x - x0;
            squares[axis] += (x - x0) * (x - x0);
        }
        count += 1.0;
    }
    let variance = |axis: usize| squares[axis] - sums[axis] * sums[axis] / count;
    (0..dim)
        .max_by(|&a, &b| variance(a).total_cmp(&variance(b)).then(b.cmp(&a)))
        .unwrap_or(0)
}
