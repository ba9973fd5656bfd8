//! Distances of one point to many, and minimum and maximum of rows.

use super::doubles::F64x16;
use super::vectors::{F32x16, add_squared_difference, max_lane};
use super::{Aligned, F32Lanes, F64Lanes, LANES};

/// Points that [`max_of_rows`] takes at a time.
pub(crate) const QUERIES: usize = 4;

/// Points that [`add_squares`] compares with others at a time.
pub(crate) const TILE_ROWS: usize = 4;

dispatch! {
    /// Squared distances of one point to many, in f32; returns the largest.
    ///
    /// `blocks` holds `point.len()` coordinates of sixteen points, then those of the next sixteen;
    /// `out` receives one element per sixteen points. No input may be NaN.
    squared_distances = squared_distances_body(
        point: &[f32], blocks: &[F32Lanes], out: &mut [F32Lanes]
    ) -> f32
}

#[inline(always)]
fn squared_distances_body<V: F32x16>(
    point: &[f32],
    blocks: &[F32Lanes],
    out: &mut [F32Lanes],
) -> f32 {
    let mut largest = V::splat(0.0);
    for (block, out) in blocks.chunks_exact(point.len()).zip(out) {
        let mut sums = V::splat(0.0);
        for (&x, lanes) in point.iter().zip(block) {
            add_squared_difference(&mut sums, V::load(lanes), x);
        }
        largest = largest.max(sums);
        sums.store(out);
    }
    max_lane(largest)
}

dispatch! {
    /// For each of [`QUERIES`] points, the largest squared distance to any of many, in f32.
    ///
    /// `points` holds the coordinates of one point after the other; `blocks` is laid out as for
    /// [`squared_distances`]. No input may be NaN.
    max_of_rows = max_of_rows_body(
        points: &[f32], dim: usize, blocks: &[F32Lanes]
    ) -> [f32; QUERIES]
}

#[inline(always)]
fn max_of_rows_body<V: F32x16>(points: &[f32], dim: usize, blocks: &[F32Lanes]) -> [f32; QUERIES] {
    let mut largest = [V::splat(0.0); QUERIES];
    let (first, rest) = points.split_at(dim);
    let (second, rest) = rest.split_at(dim);
    let (third, fourth) = rest.split_at(dim);
    for block in blocks.chunks_exact(dim) {
        let [mut a, mut b, mut c, mut d] = [V::splat(0.0); QUERIES];
        let coordinates = first.iter().zip(second).zip(third.iter().zip(fourth));
        for (lanes, ((&p, &q), (&r, &s))) in block.iter().zip(coordinates) {
            let lanes = V::load(lanes);
            add_squared_difference(&mut a, lanes, p);
            add_squared_difference(&mut b, lanes, q);
            add_squared_difference(&mut c, lanes, r);
            add_squared_difference(&mut d, lanes, s);
        }
        largest = [largest[0].max(a), largest[1].max(b), largest[2].max(c), largest[3].max(d)];
    }
    largest.map(max_lane)
}

dispatch! {
    /// Squared distance of one point to each of sixteen, plus `variance` and theirs, in f64.
    ///
    /// The squared differences are added axis by axis; the sum of the variances is added last.
    /// With zero variances the result is the exact squared distance, bit for bit.
    squared_bounds = squared_bounds_body(
        point: &[f64], variance: f64, block: &[F64Lanes], variances: &F64Lanes
    ) -> F64Lanes
}

#[inline(always)]
fn squared_bounds_body<V: F32x16>(
    point: &[f64],
    variance: f64,
    block: &[F64Lanes],
    variances: &F64Lanes,
) -> F64Lanes {
    let mut sums = Aligned([0.0; LANES]);
    for (&x, lanes) in point.iter().zip(block) {
        for lane in 0..LANES {
            let difference = lanes[lane] - x;
            sums[lane] += difference * difference;
        }
    }
    for lane in 0..LANES {
        sums[lane] += variances[lane] + variance;
    }
    sums
}

dispatch! {
    /// Add the squared differences along some axes of [`TILE_ROWS`] points and many others.
    ///
    /// `points` holds up to [`TILE_ROWS`] points of `dim` coordinates; `blocks` holds `dim`
    /// coordinates of sixteen points, then those of the next sixteen; `sums` holds one row per
    /// point, with one element for each of the others. Axes are added in order, from `start` to
    /// `end`. Elements of rows without a point are undefined.
    add_squares = add_squares_body(
        points: &[f64], dim: usize, start: usize, end: usize, blocks: &[F64Lanes], sums: &mut [f64]
    )
}

#[inline(always)]
fn add_squares_body<V: F32x16>(
    points: &[f64],
    dim: usize,
    start: usize,
    end: usize,
    blocks: &[F64Lanes],
    sums: &mut [f64],
) {
    let last = points.len() / dim - 1;
    let width = sums.len() / TILE_ROWS;
    let (first, rest) = sums.split_at_mut(width);
    let (second, rest) = rest.split_at_mut(width);
    let (third, fourth) = rest.split_at_mut(width);
    let [a, b, c, d] = std::array::from_fn(|row| &points[row.min(last) * dim..][start..end]);
    let columns = (first
        .as_chunks_mut()
        .0
        .iter_mut()
        .zip(second.as_chunks_mut().0))
    .zip(
        third
            .as_chunks_mut()
            .0
            .iter_mut()
            .zip(fourth.as_chunks_mut().0),
    );
    for (block, ((first, second), (third, fourth))) in blocks.chunks_exact(dim).zip(columns) {
        let block = &block[start..end];
        if V::F64::HOLDS_FOUR {
            add_squares_to_four::<V::F64>([a, b, c, d], block, [first, second, third, fourth]);
        } else {
            add_squares_to_two::<V::F64>([a, b], block, [first, second]);
            add_squares_to_two::<V::F64>([c, d], block, [third, fourth]);
        }
    }
}

/// Add the squared differences of four points and sixteen others.
#[inline(always)]
fn add_squares_to_four<F: F64x16>(
    points: [&[f64]; 4],
    block: &[F64Lanes],
    sums: [&mut [f64; LANES]; 4],
) {
    // Four variables, because an array of sums does not stay in registers.
    let [mut a, mut b, mut c, mut d] = sums.each_ref().map(|sums| F::load(sums));
    let [p, q, r, s] = points;
    for (lanes, ((&p, &q), (&r, &s))) in block.iter().zip(p.iter().zip(q).zip(r.iter().zip(s))) {
        let lanes = F::load(lanes);
        a = a.add_squared_difference(lanes, F::splat(p));
        b = b.add_squared_difference(lanes, F::splat(q));
        c = c.add_squared_difference(lanes, F::splat(r));
        d = d.add_squared_difference(lanes, F::splat(s));
    }
    for (sums, sum) in sums.into_iter().zip([a, b, c, d]) {
        sum.store(sums);
    }
}

/// Add the squared differences of two points and sixteen others.
#[inline(always)]
fn add_squares_to_two<F: F64x16>(
    points: [&[f64]; 2],
    block: &[F64Lanes],
    sums: [&mut [f64; LANES]; 2],
) {
    let [mut a, mut b] = sums.each_ref().map(|sums| F::load(sums));
    for (lanes, (&p, &q)) in block.iter().zip(points[0].iter().zip(points[1])) {
        let lanes = F::load(lanes);
        a = a.add_squared_difference(lanes, F::splat(p));
        b = b.add_squared_difference(lanes, F::splat(q));
    }
    for (sums, sum) in sums.into_iter().zip([a, b]) {
        sum.store(sums);
    }
}

dispatch! {
    /// The smallest element of `row`; infinity if it is empty. NaN is ignored.
    minimum = minimum_body(row: &[f64]) -> f64
}

#[inline(always)]
fn minimum_body<V: F32x16>(row: &[f64]) -> f64 {
    let (blocks, rest) = row.as_chunks::<32>();
    let mut smallest = [f64::INFINITY; 32];
    for block in blocks {
        for (smallest, &value) in smallest.iter_mut().zip(block) {
            *smallest = if value < *smallest { value } else { *smallest };
        }
    }
    smallest
        .iter()
        .chain(rest)
        .fold(f64::INFINITY, |a, &b| if b < a { b } else { a })
}

dispatch! {
    /// Index of the first element of `row` that equals `value`.
    first_position = first_position_body(row: &[f64], value: f64) -> Option<usize>
}

#[inline(always)]
#[allow(clippy::needless_bitwise_bool, reason = "a branch per element would prevent vectorization")]
fn first_position_body<V: F32x16>(row: &[f64], value: f64) -> Option<usize> {
    let (blocks, rest) = row.as_chunks::<32>();
    for (i, block) in blocks.iter().enumerate() {
        let has_value = block.iter().fold(false, |has, &x| has | (x == value));
        if has_value {
            let position = block.iter().position(|&x| x == value);
            return position.map(|position| i * block.len() + position);
        }
    }
    let position = rest.iter().position(|&x| x == value);
    position.map(|position| row.len() - rest.len() + position)
}

dispatch! {
    /// Replace each element of `row` by the larger of it and that of `other`.
    maximize = maximize_body(row: &mut [f64], other: &[f64])
}

#[inline(always)]
fn maximize_body<V: F32x16>(row: &mut [f64], other: &[f64]) {
    for (a, &b) in row.iter_mut().zip(other) {
        *a = if b > *a { b } else { *a };
    }
}
