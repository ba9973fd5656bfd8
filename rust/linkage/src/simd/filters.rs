//! Filters: which boxes, blocks and lanes may be within a limit of each other.
//!
//! A cluster is a centre and a variance. The squared distance of two clusters is at least the
//! squared distance of their centres plus both variances (see `clusters`); "within the limit"
//! means that this bound is at most the squared limit. Two points of each cluster that are far
//! apart, its *extreme points*, give a second bound: the largest of their four distances.

use super::vectors::{F32x16, add_squared_difference};
use super::{Aligned, F32Lanes, F64Lanes, LANES};

/// Rows whose sums are computed together. Several independent sums hide the latency of additions.
const ROWS: usize = 4;

dispatch! {
    /// Which of sixteen boxes are within the limit of the box from `low` to `high`.
    ///
    /// `lows` and `highs` hold the corners of the sixteen boxes, one element per axis. Bit `i` is
    /// set if the squared gap between the boxes, plus `variance`, plus `variances[i]`, is at most
    /// `limit`. Computed in f64; takes O(dim) time.
    boxes_within = boxes_within_body(
        low: &[f64], high: &[f64], variance: f64,
        lows: &[F64Lanes], highs: &[F64Lanes], variances: &F64Lanes, limit: f64
    ) -> u16
}

#[inline(always)]
fn boxes_within_body<V: F32x16>(
    low: &[f64],
    high: &[f64],
    variance: f64,
    lows: &[F64Lanes],
    highs: &[F64Lanes],
    variances: &F64Lanes,
    limit: f64,
) -> u16 {
    let mut sums = *variances;
    for sum in sums.iter_mut() {
        *sum += variance;
    }
    for ((&low, &high), (lows, highs)) in low.iter().zip(high).zip(lows.iter().zip(highs)) {
        for lane in 0..LANES {
            let gap = (lows[lane] - high).max(low - highs[lane]).max(0.0);
            sums[lane] += gap * gap;
        }
    }
    sums.iter()
        .rev()
        .fold(0, |mask, &sum| mask << 1 | u16::from(sum <= limit))
}

/// Sixteen clusters and their bounding box.
#[derive(Clone, Copy)]
pub(crate) struct Block<'a> {
    /// Midpoint of the box, one element per axis.
    pub midpoint: &'a [f64],
    /// Half the extent of the box, one element per axis, rounded up.
    pub half_extents: &'a [f32],
    /// Centres relative to the midpoint, one element per axis.
    pub offsets: &'a [F32Lanes],
    /// The two extreme points of every cluster relative to the midpoint, two elements per axis.
    /// Empty if the clusters are points.
    pub extremes: &'a [F32Lanes],
    /// Variances of the clusters, rounded down.
    pub variances: &'a F32Lanes,
    /// The smallest of `variances`.
    pub min_variance: f32,
}

/// A block that is compared with others, and the result of the last comparison.
pub(crate) struct Query<'a> {
    block: Block<'a>,
    /// The squared limit.
    pub limit: f32,
    /// The squared limit of extreme points.
    pub extreme_limit: f32,
    /// Count of rows whose extreme points were compared.
    pub n_extreme_rows: u32,
    /// Bit `i` is set if cluster `i` may be within the limit of the other block's box.
    pub rows: u16,
    /// For every row in `rows`, which clusters of the other block may be within the limit.
    pub found: [u16; LANES],
    /// Centres relative to the other block's midpoint, one element per axis.
    relative: Vec<F32Lanes>,
    /// Extreme points relative to the other block's midpoint.
    relative_extremes: Vec<F32Lanes>,
}

impl<'a> Query<'a> {
    /// A query of `block` with empty results.
    pub fn new(block: Block<'a>) -> Self {
        let relative = vec![Aligned([0.0; LANES]); block.midpoint.len()];
        let relative_extremes = vec![Aligned([0.0; LANES]); block.extremes.len()];
        Self {
            block,
            limit: 0.0,
            extreme_limit: 0.0,
            n_extreme_rows: 0,
            rows: 0,
            found: [0; LANES],
            relative,
            relative_extremes,
        }
    }
}

dispatch! {
    /// Compare the blocks of some queries with another block.
    ///
    /// Updates the results of every query whose bit is set in `selected`. `found` is
    /// undefined for rows that are not in `rows`. Takes O(`selected.count_ones()` × dim) time plus
    /// O(dim) for every row that passes.
    blocks_within = blocks_within_body(queries: &mut [Query<'_>], selected: u16, other: &Block<'_>)
}

#[inline(always)]
fn blocks_within_body<V: F32x16>(queries: &mut [Query<'_>], selected: u16, other: &Block<'_>) {
    let mut remaining = selected;
    while remaining != 0 {
        let first = remaining.trailing_zeros() as usize;
        remaining &= remaining - 1;
        let second = remaining.trailing_zeros() as usize;
        remaining &= remaining.wrapping_sub(1);
        // Two at a time, to hide the latency of additions.
        match queries.get_disjoint_mut([first, second]) {
            Ok(pair) => compare_with_box::<V, 2>(pair, other),
            Err(_) => compare_with_box::<V, 1>([&mut queries[first]], other),
        }
    }
    remaining = selected;
    while remaining != 0 {
        let query = &mut queries[remaining.trailing_zeros() as usize];
        compare_rows::<V>(query, other);
        compare_extremes::<V>(query, other);
        remaining &= remaining - 1;
    }
}

/// Set `rows` of each query: its clusters that may be within the limit of the other's box.
#[inline(always)]
fn compare_with_box<V: F32x16, const N: usize>(queries: [&mut Query<'_>; N], other: &Block<'_>) {
    let dim = other.midpoint.len();
    let mut sums = queries.each_ref().map(|query| {
        let variances = V::load(query.block.variances);
        variances.add(V::splat(other.min_variance))
    });
    let mut parts = queries.map(|query| {
        let Query { block, limit, rows, relative, .. } = query;
        let limit = V::splat(*limit);
        (&block.midpoint[..dim], &block.offsets[..dim], &mut relative[..dim], limit, rows)
    });
    let axes = other.midpoint.iter().zip(&other.half_extents[..dim]);
    for (axis, (&other_midpoint, &half_extent)) in axes.enumerate() {
        let half_extent = V::splat(half_extent);
        for (sum, (midpoint, offsets, relative, ..)) in sums.iter_mut().zip(&mut parts) {
            let shift = V::splat((midpoint[axis] - other_midpoint) as f32);
            let shifted = V::load(&offsets[axis]).add(shift);
            shifted.store(&mut relative[axis]);
            let gap = shifted.abs().sub(half_extent).max(V::splat(0.0));
            *sum = gap.square_add(*sum);
        }
    }
    for (sum, (.., limit, rows)) in sums.into_iter().zip(parts) {
        *rows = sum.le_mask(limit);
    }
}

/// Set `found` of a query for each of its rows.
#[inline(always)]
fn compare_rows<V: F32x16>(query: &mut Query<'_>, other: &Block<'_>) {
    let (mut rows, variances) = (query.rows, query.block.variances);
    let limit = V::splat(query.limit);
    while rows != 0 {
        // If fewer than four rows remain, the last one is repeated.
        let mut next = rows.trailing_zeros() as usize % LANES;
        let group = [(); ROWS].map(|()| {
            if rows != 0 {
                next = rows.trailing_zeros() as usize % LANES;
                rows &= rows - 1;
            }
            next
        });
        let start = |row: usize| V::load(other.variances).add(V::splat(variances[row]));
        // Four variables, because an array of sums does not stay in registers.
        let (mut a, mut b, mut c, mut d) =
            (start(group[0]), start(group[1]), start(group[2]), start(group[3]));
        for (relative, targets) in query.relative.iter().zip(other.offsets) {
            let targets = V::load(targets);
            add_squared_difference(&mut a, targets, relative[group[0]]);
            add_squared_difference(&mut b, targets, relative[group[1]]);
            add_squared_difference(&mut c, targets, relative[group[2]]);
            add_squared_difference(&mut d, targets, relative[group[3]]);
        }
        for (row, sum) in group.into_iter().zip([a, b, c, d]) {
            query.found[row] = sum.le_mask(limit);
        }
    }
}

/// Remove from `found` of a query the pairs of which two extreme points are beyond the limit.
#[inline(always)]
fn compare_extremes<V: F32x16>(query: &mut Query<'_>, other: &Block<'_>) {
    let Query { block, extreme_limit, n_extreme_rows, rows, found, relative_extremes, .. } = query;
    *n_extreme_rows = 0;
    let is_row = |row: usize| *rows >> row & 1 != 0 && found[row] != 0;
    let mut remaining = (0..LANES).fold(0_u16, |bits, row| bits | u16::from(is_row(row)) << row);
    if other.extremes.is_empty() || remaining == 0 {
        return;
    }
    *n_extreme_rows = remaining.count_ones();
    let axes = block.midpoint.iter().zip(other.midpoint);
    let extremes = block.extremes.as_chunks::<2>().0.iter();
    for ((midpoint, other_midpoint), (extremes, relative)) in
        axes.zip(extremes.zip(relative_extremes.as_chunks_mut::<2>().0))
    {
        let shift = V::splat((midpoint - other_midpoint) as f32);
        V::load(&extremes[0]).add(shift).store(&mut relative[0]);
        V::load(&extremes[1]).add(shift).store(&mut relative[1]);
    }
    let limit = V::splat(*extreme_limit);
    while remaining != 0 {
        let row = remaining.trailing_zeros() as usize % LANES;
        remaining &= remaining - 1;
        // Four variables, because an array of sums does not stay in registers.
        let [mut a, mut b, mut c, mut d] = [V::splat(0.0); 4];
        let targets = other.extremes.as_chunks::<2>().0.iter();
        for (relative, [first, second]) in relative_extremes.as_chunks::<2>().0.iter().zip(targets)
        {
            let (first, second) = (V::load(first), V::load(second));
            let [p, q] = [relative[0][row], relative[1][row]];
            add_squared_difference(&mut a, first, p);
            add_squared_difference(&mut b, first, q);
            add_squared_difference(&mut c, second, p);
            add_squared_difference(&mut d, second, q);
        }
        found[row] &= a.max(b).max(c.max(d)).le_mask(limit);
    }
}
