//! Clusters in spatial order, by halving and, where density varies, by density.
//!
//! Halving alone suffices if density varies little. If some clusters are packed a thousand times
//! closer than others, a block of the halving may hold both, and its box is as large as the gaps
//! between the sparse ones. Then clusters are first sorted into classes of density.

use std::cmp::Reverse;

use crate::clusters::Clusters;
use crate::error::Error;
use crate::halving::sort_by_halving;
use crate::parallel::Workers;
use crate::simd::{self, Aligned, LANES};
use crate::sorting::sort;
use mograft_machine::memory::{allocate, collect};

/// Density is uneven if the gaps of 90 % of the clusters differ by more than this factor.
const UNEVEN_RATIO: f64 = 16.0;

/// Ratio of the gaps at both ends of a class of density.
const CLASS_RATIO: f64 = 4.0;

/// Blocks of clusters that one job handles.
const BLOCKS_PER_JOB: usize = 64;

/// Clusters in spatial order.
pub(crate) struct SpatialOrder {
    /// The clusters: neighbours in space are neighbours in memory.
    pub clusters: Clusters,
    /// If density is uneven, that of the clusters.
    pub density: Option<Density>,
}

/// How near clusters are to others.
pub(crate) struct Density {
    /// The clusters, the densest first.
    pub order: Vec<u32>,
    /// For each cluster, the squared bound to some other cluster.
    pub gaps: Vec<f64>,
}

/// Sort clusters spatially. Takes O(m log m) time for m clusters.
///
/// # Errors
///
/// [`Error::OutOfMemory`], and [`Error::Stopped`] if the progress callback requests a stop.
pub(crate) fn sort_spatially(
    workers: &Workers<'_>,
    clusters: &Clusters,
) -> Result<SpatialOrder, Error> {
    let dim = clusters.centres().len() / clusters.len().max(1);
    let halve = |clusters: &Clusters, order: &mut [u32]| {
        sort_by_halving(workers, clusters.centres(), dim, order)
    };
    let mut order: Vec<u32> = collect(0..clusters.len() as u32)?;
    halve(clusters, &mut order)?;
    let clusters = clusters.reorder(workers, &order)?;
    let gaps = squared_gaps(workers, &clusters)?;
    let mut sorted = collect(gaps.iter().copied())?;
    let mut quantile = |rank| *sorted.select_nth_unstable_by(rank, f64::total_cmp).1;
    let (small, large) = (quantile(gaps.len() / 20), quantile(gaps.len() - 1 - gaps.len() / 20));
    if large <= small * UNEVEN_RATIO * UNEVEN_RATIO {
        return Ok(SpatialOrder { clusters, density: None });
    }
    let class = |i: u32| ((gaps[i as usize] / small).log2() / (2.0 * CLASS_RATIO.log2())) as i32;
    // The sparse classes first, because the filters compare the centres of earlier blocks with the
    // boxes of later ones. A dense box excludes sparse clusters; a sparse box may hold dense ones.
    order = order_by(workers, clusters.len(), |i| Reverse(class(i)))?;
    for same_class in order.chunk_by_mut(|&a, &b| class(a) == class(b)) {
        halve(&clusters, same_class)?;
    }
    let gaps = collect(order.iter().map(|&i| gaps[i as usize]))?;
    // Floats that are not negative have the order of their bits.
    let by_density = order_by(workers, gaps.len(), |i| gaps[i as usize].to_bits())?;
    let density = Some(Density { order: by_density, gaps });
    Ok(SpatialOrder { clusters: clusters.reorder(workers, &order)?, density })
}

/// The indices from 0 to `m`, sorted by a key; of equal keys the smallest index first.
fn order_by<K: Ord + Send>(
    workers: &Workers<'_>,
    m: usize,
    key: impl Fn(u32) -> K,
) -> Result<Vec<u32>, Error> {
    let mut keyed = collect((0..m as u32).map(|i| (key(i), i)))?;
    sort(workers, &mut keyed)?;
    Ok(collect(keyed.into_iter().map(|(_, i)| i))?)
}

/// For each cluster, the smallest squared bound to another cluster of its block.
fn squared_gaps(workers: &Workers<'_>, clusters: &Clusters) -> Result<Vec<f64>, Error> {
    let mut gaps = allocate(f64::INFINITY, clusters.len())?;
    workers.run(
        gaps.chunks_mut(BLOCKS_PER_JOB * LANES).enumerate(),
        || (Vec::new(), Aligned([0.0; LANES])),
        |(block, variances), (job, gaps)| {
            for (i, gaps) in gaps.chunks_mut(LANES).enumerate() {
                let first = (job * BLOCKS_PER_JOB + i) * LANES;
                clusters.copy_to_lanes(first..first + gaps.len(), block, variances);
                for (lane, gap) in gaps.iter_mut().enumerate() {
                    let (centre, variance) =
                        (clusters.centre(first + lane), clusters.variances[first + lane]);
                    let mut bounds =
                        simd::squared_bounds(workers.isa, centre, variance, block, variances);
                    bounds[lane] = f64::INFINITY;
                    *gap = bounds.into_iter().fold(f64::INFINITY, f64::min);
                }
            }
        },
    )?;
    Ok(gaps)
}
