//! An order in which things that are near to each other in space stand near to each other.
//!
//! Halving space does it where density varies little. Where some are packed a thousand times
//! closer than others, a block of the tree would hold both, and its box be as large as the gaps
//! between the latter; there, clusters are sorted by how close they are packed first.

use crate::Error;
use crate::clusters::Clusters;
use crate::graph::transpose;
use crate::parallel::Crew;
use crate::simd::{self, Aligned, LANES};

/// How many things are looked at to find the axis along which they spread most.
const LOOK_AT: usize = 256;

/// Below this a part is not worth a thread of its own.
const SHARE: usize = 1 << 14;

/// Space is uneven if the gaps of most clusters differ by more than this factor.
const UNEVEN: f64 = 64.0;

/// Clusters whose gaps differ by this factor are sorted apart.
const CLASS: f64 = 4.0;

/// Blocks that one job looks at.
const PER_JOB: usize = 64;

/// The same clusters, neighbours in space near to each other.
///
/// Where space is uneven, returns also a list of them by how closely they are packed. Takes
/// O(m log m) time for m clusters.
pub(crate) fn in_spatial_order(
    crew: &Crew<'_>,
    clusters: &Clusters,
) -> Result<(Clusters, Option<Vec<u32>>), Error> {
    let dim = clusters.centres().len() / clusters.len().max(1);
    let mut order: Vec<u32> = (0..clusters.len() as u32).collect();
    by_halves(crew, clusters.centres(), dim, &mut order);
    let clusters = clusters.rearranged(&order);
    let gaps = gaps(crew, &clusters)?;
    let mut sorted = gaps.clone();
    sorted.sort_unstable_by(f64::total_cmp);
    let (small, large) = (sorted[sorted.len() / 20], sorted[sorted.len() - 1 - sorted.len() / 20]);
    if large <= small * UNEVEN * UNEVEN {
        return Ok((clusters, None));
    }
    let class = |i: u32| ((gaps[i as usize] / small).log2() / (2.0 * CLASS.log2())) as i32;
    order = (0..clusters.len() as u32).collect();
    order.sort_by_key(|&i| class(i));
    for alike in order.chunk_by_mut(|&a, &b| class(a) == class(b)) {
        by_halves(crew, clusters.centres(), dim, alike);
    }
    let mut by_gap: Vec<u32> = (0..clusters.len() as u32).collect();
    by_gap.sort_by(|&a, &b| {
        let gap = |i: u32| gaps[order[i as usize] as usize];
        gap(a).total_cmp(&gap(b))
    });
    Ok((clusters.rearranged(&order), Some(by_gap)))
}

/// For each cluster the least squared bound to another of its block.
fn gaps(crew: &Crew<'_>, clusters: &Clusters) -> Result<Vec<f64>, Error> {
    let m = clusters.len();
    let mut gaps = vec![f64::INFINITY; m];
    crew.each(
        gaps.chunks_mut(PER_JOB * LANES).enumerate(),
        || (Vec::new(), Aligned([0.0; LANES])),
        |(block, spreads), (job, gaps)| {
            for (i, gaps) in gaps.chunks_mut(LANES).enumerate() {
                let first = (job * PER_JOB + i) * LANES;
                transpose(clusters, first..first + gaps.len(), block, spreads);
                for (lane, gap) in gaps.iter_mut().enumerate() {
                    let (centre, spread) =
                        (clusters.centre(first + lane), clusters.spreads[first + lane]);
                    let mut bounds = simd::bounds(crew.isa, centre, spread, block, spreads);
                    bounds[lane] = f64::INFINITY;
                    *gap = bounds.into_iter().fold(f64::INFINITY, f64::min);
                }
            }
        },
    )?;
    Ok(gaps)
}

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
