//! Spatial sorting: rows that are near in space become near in memory.
//!
//! The rows are halved recursively along the axis of largest variance, as in a k-d tree.

use crate::simd::LANES;

/// Rows of which the variance along each axis is estimated.
const SAMPLE_SIZE: usize = 256;

/// Smallest half that gets a thread of its own.
const MIN_ROWS_PER_THREAD: usize = 1 << 14;

/// Sort `order`, a list of rows of `points`, by recursive halving.
///
/// `points` is row-major, `dim` wide, and not NaN. Halves begin at multiples of [`LANES`], so that
/// every block of that many rows is a box of the halving. Rows of equal coordinates are ordered by
/// index: the result does not depend on `n_threads`. Takes O(n log n) time for n rows.
pub(crate) fn sort_by_halving(n_threads: usize, points: &[f64], dim: usize, order: &mut [u32]) {
    if order.len() <= LANES {
        return;
    }
    let axis = widest_axis(points, dim, order);
    let middle = (order.len() / 2)
        .next_multiple_of(LANES)
        .min(order.len() - 1);
    let coordinate = |row: u32| points[row as usize * dim + axis];
    order.select_nth_unstable_by(middle, |&a, &b| {
        coordinate(a).total_cmp(&coordinate(b)).then(a.cmp(&b))
    });
    let (low, high) = order.split_at_mut(middle);
    if n_threads > 1 && low.len() > MIN_ROWS_PER_THREAD {
        std::thread::scope(|scope| {
            scope.spawn(|| sort_by_halving(n_threads / 2, points, dim, low));
            sort_by_halving(n_threads - n_threads / 2, points, dim, high);
        });
    } else {
        sort_by_halving(1, points, dim, low);
        sort_by_halving(1, points, dim, high);
    }
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
