//! An order in which things that are near to each other in space stand near to each other.

use crate::parallel::Crew;
use crate::simd::LANES;

/// How many things are looked at to find the axis along which they spread most.
const LOOK_AT: usize = 256;

/// Below this a part is not worth a thread of its own.
const SHARE: usize = 1 << 14;

/// Sort `order`, a list of rows of `at`, by halving it along the axis of largest variance.
///
/// Halves are cut at multiples of [`LANES`], so that blocks of that many rows are boxes of
/// the tree that the halving makes. Equal coordinates are ordered by row: the outcome depends
/// on nothing but the input. Takes O(n log n) time.
pub(crate) fn by_halves(crew: &Crew<'_>, at: &[f64], dim: usize, order: &mut [u32]) {
    halve(crew.threads(), at, dim, order);
}

fn halve(threads: usize, at: &[f64], dim: usize, order: &mut [u32]) {
    if order.len() <= LANES {
        return;
    }
    let axis = widest_axis(at, dim, order);
    let middle = (order.len() / 2)
        .next_multiple_of(LANES)
        .min(order.len() - 1);
    let coordinate = |row: u32| at[row as usize * dim + axis];
    order.select_nth_unstable_by(middle, |&a, &b| {
        coordinate(a).total_cmp(&coordinate(b)).then(a.cmp(&b))
    });
    let (low, high) = order.split_at_mut(middle);
    if threads > 1 && low.len() > SHARE {
        std::thread::scope(|scope| {
            scope.spawn(|| halve(threads / 2, at, dim, low));
            halve(threads - threads / 2, at, dim, high);
        });
    } else {
        halve(1, at, dim, low);
        halve(1, at, dim, high);
    }
}

fn widest_axis(at: &[f64], dim: usize, order: &[u32]) -> usize {
    let rows = || {
        order
            .iter()
            .step_by(order.len().div_ceil(LOOK_AT))
            .map(|&row| &at[row as usize * dim..][..dim])
    };
    let first = &at[order[0] as usize * dim..][..dim];
    let (mut sums, mut squares) = (vec![0.0; dim], vec![0.0; dim]);
    let mut count = 0.0;
    for row in rows() {
        // Relative to one of them, so that a cloud far from the origin keeps its digits.
        for (axis, (&x, &x0)) in row.iter().zip(first).enumerate() {
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
