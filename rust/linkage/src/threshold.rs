//! The distance up to which a stage merges: any value is correct, a good one saves time.
//!
//! A good threshold gives a cluster about seven neighbours: enough that most clusters find their
//! nearest one among them and merge, few enough to be measured and stored. It is estimated from a
//! sample of clusters that is spread evenly over the spatial order; nothing is random. If density
//! is uneven, the densest clusters have most neighbours: they are sampled more often and weighted
//! less. A cluster of a dense region may have hundreds of neighbours within the threshold. So of each
//! sampled cluster's neighbours the nearest are measured, and of the others fewer and fewer, each
//! of which represents more.

use std::cmp::Ordering;

use crate::clusters::Clusters;
use crate::distance::{ClusterDistances, Limit, Scratch};
use crate::error::Error;
use crate::parallel::Workers;
use crate::simd::{self, Aligned, F64Lanes, LANES};
use mograft_machine::memory::{append, push, with_capacity};

/// Most clusters in the sample, for each part of [`DENSITY_PARTS`].
const MAX_SAMPLE_SIZE: usize = 48;

/// Fewest clusters in the sample, if there are as many.
const MIN_SAMPLE_SIZE: usize = 12;

/// Clusters per cluster of the sample, between these limits. Measuring the sample must take less
/// time than the stage.
const CLUSTERS_PER_SAMPLE: usize = 64;

/// Clusters of the sample that one job handles; the others are read once for all of them.
const SAMPLES_PER_JOB: usize = 6;

/// Count, per neighbour wanted, of the clusters nearest by the bound that are all measured.
const MEASURED_PER_NEIGHBOUR: f64 = 2.0;

/// The clusters behind them form strata by rank; this is the ratio of the ranks at both ends of a
/// stratum. Of each stratum equally many clusters are measured.
const STRATUM_RATIO: usize = 4;

/// Largest count, per neighbour wanted, of clusters that the bound does not exclude.
///
/// The exact distance to each of them is computed, mostly in vain. In many dimensions the bound is
/// loose, and this count determines the threshold instead of the count of neighbours.
const SUSPECTS_PER_NEIGHBOUR: f64 = 40.0;

/// Suspects of all clusters together that a stage may have in any case. Measuring them costs no
/// more than the stage that they save.
const FREE_SUSPECTS: usize = 1 << 24;

/// If density is uneven, fractions of the clusters by density between which the sample is equally
/// dense.
const DENSITY_PARTS: [f64; 4] = [0.0, 1.0 / 64.0, 1.0 / 8.0, 1.0];

/// A squared threshold with about `degree` neighbours per cluster, and at least one pair.
///
/// `by_density` lists the clusters by density if it is uneven. Takes O(m d) time for m clusters in
/// d dimensions.
///
/// # Errors
///
/// [`Error::OutOfMemory`], and [`Error::Stopped`] if the progress callback requests a stop.
pub(crate) fn choose_threshold(
    workers: &Workers<'_>,
    clusters: &Clusters,
    distances: &ClusterDistances<'_>,
    degree: f64,
    by_density: Option<&[u32]>,
) -> Result<f64, Error> {
    let m = clusters.len();
    let mut sample = draw_sample(m, degree, by_density)?;
    let states = workers.run(
        sample.chunks_mut(SAMPLES_PER_JOB),
        || (Vec::new(), Vec::new(), Scratch::default()),
        |(squares, bounds, scratch), chunk| {
            let collected = collect_nearest(workers, clusters, chunk, &mut scratch.work);
            if workers.ok_or_stop(collected).is_none() {
                return;
            }
            for sampled in chunk {
                sampled.keep_nearest(sampled.n_suspects);
                // If all others are suspects, no threshold excludes any.
                let is_bounded = sampled.n_suspects < m - 1;
                let bound = if is_bounded { sampled.max_bound() } else { f64::INFINITY };
                workers.ok_or_stop(push(bounds, (bound, sampled.weight)));
                let Some(chosen) = workers.ok_or_stop(sampled.strata(degree)) else { return };
                for (other, weight) in chosen {
                    let limit = Limit::from_squared(f64::INFINITY);
                    let squared = distances.squared_within(sampled.cluster, other, limit, scratch);
                    let weight = weight * sampled.weight;
                    let added = squared.map(|squared| push(squares, (squared, weight)));
                    workers.ok_or_stop(added.unwrap_or(Ok(())));
                    if !workers.can_continue(&mut scratch.work) {
                        return;
                    }
                }
            }
            workers.ok_or_stop(scratch.check_memory());
        },
    )?;
    let (mut squares, mut bounds) = (Vec::new(), Vec::new());
    for (thread_squares, thread_bounds, scratch) in states {
        workers.add_work(scratch.work);
        append(&mut squares, thread_squares.into_iter())?;
        append(&mut bounds, thread_bounds.into_iter())?;
    }
    let threshold = weighted_quantile(&mut squares, degree);
    let smallest = squares.first().map_or(0.0, |first| first.0);
    Ok(threshold
        .min(weighted_quantile(&mut bounds, 0.5))
        .max(smallest))
}

/// Choose the clusters of the sample, evenly within each part of density.
fn draw_sample(m: usize, degree: f64, by_density: Option<&[u32]>) -> Result<Vec<Sampled>, Error> {
    let parts: &[f64] = if by_density.is_some() { &DENSITY_PARTS } else { &[0.0, 1.0] };
    let mut sample = with_capacity((parts.len() - 1) * MAX_SAMPLE_SIZE)?;
    for part in parts.windows(2) {
        let [start, end] = [part[0], part[1]].map(|fraction| (fraction * m as f64) as usize);
        let count = ((end - start) / CLUSTERS_PER_SAMPLE)
            .clamp(MIN_SAMPLE_SIZE, MAX_SAMPLE_SIZE)
            .min(end - start);
        let weight = (end - start) as f64 / (m * count) as f64;
        // All neighbours may be those of the clusters up to the end of this part.
        let crowding = SUSPECTS_PER_NEIGHBOUR.max(1.5 / part[1]);
        let n_suspects = ((degree * crowding) as usize + 8)
            .max(FREE_SUSPECTS / m)
            .min(m - 1);
        for i in 0..count {
            let rank = start + (2 * i + 1) * (end - start) / (2 * count);
            let cluster = by_density.map_or(rank, |order| order[rank] as usize);
            let (nearest, cutoff) = (Vec::new(), f64::INFINITY);
            sample.push(Sampled { cluster, weight, n_suspects, nearest, cutoff });
        }
    }
    Ok(sample)
}

/// A cluster of the sample, and the clusters nearest to it by the bound.
struct Sampled {
    cluster: usize,
    /// The fraction of all clusters that it represents.
    weight: f64,
    /// How many of the nearest are kept.
    n_suspects: usize,
    /// Bounds and clusters, those of the smallest bounds among them.
    nearest: Vec<(f64, u32)>,
    /// Only smaller bounds are among the smallest.
    cutoff: f64,
}

impl Sampled {
    /// Add sixteen consecutive clusters.
    fn add_block(&mut self, first: usize, bounds: &F64Lanes) -> Result<(), Error> {
        for (other, &bound) in (first..).zip(bounds.iter()) {
            if bound < self.cutoff && other != self.cluster {
                push(&mut self.nearest, (bound, other as u32))?;
            }
        }
        if self.nearest.len() > 3 * self.n_suspects {
            self.keep_nearest(self.n_suspects);
            self.cutoff = self.max_bound();
        }
        Ok(())
    }

    /// Remove all but the `count` nearest.
    fn keep_nearest(&mut self, count: usize) {
        if self.nearest.len() > count {
            self.nearest.select_nth_unstable_by(count, compare_bounds);
            self.nearest.truncate(count);
        }
    }

    /// The clusters to measure, and how many of the nearest each of them represents.
    fn strata(&mut self, degree: f64) -> Result<Vec<(usize, f64)>, Error> {
        let mut end = self.nearest.len();
        let first = ((degree * MEASURED_PER_NEIGHBOUR) as usize).max(2);
        let bounds = std::iter::successors(Some((first, STRATUM_RATIO)), |&(start, step)| {
            Some((start * STRATUM_RATIO, step * STRATUM_RATIO))
        });
        let mut strata: Vec<_> = bounds.take_while(|&(start, _)| start < end).collect();
        let mut chosen = Vec::new();
        while let Some((start, step)) = strata.pop() {
            self.nearest[..end].select_nth_unstable_by(start, compare_bounds);
            let stratum = self.nearest[start..end].iter().step_by(step);
            let weight = (end - start) as f64 / stratum.len() as f64;
            append(&mut chosen, stratum.map(|&(_, other)| (other as usize, weight)))?;
            end = start;
        }
        let nearest = self.nearest[..end].iter();
        append(&mut chosen, nearest.map(|&(_, other)| (other as usize, 1.0)))?;
        self.nearest = Vec::new();
        Ok(chosen)
    }

    /// The largest bound of the nearest.
    fn max_bound(&self) -> f64 {
        self.nearest
            .iter()
            .fold(0.0, |largest, &(bound, _)| bound.max(largest))
    }
}

/// The order of (bound, cluster) pairs: by the bound, of equal bounds by the cluster.
fn compare_bounds(a: &(f64, u32), b: &(f64, u32)) -> Ordering {
    a.0.total_cmp(&b.0).then(a.1.cmp(&b.1))
}

/// Compare some clusters of the sample with all clusters, and count the work.
fn collect_nearest(
    workers: &Workers<'_>,
    clusters: &Clusters,
    sample: &mut [Sampled],
    work: &mut u64,
) -> Result<(), Error> {
    let m = clusters.len();
    let (mut block, mut variances) = (Vec::new(), Aligned([0.0; LANES]));
    for first in (0..m).step_by(LANES) {
        let members = first..m.min(first + LANES);
        *work += (sample.len() * members.len() * clusters.centre(0).len()) as u64;
        if !workers.can_continue(work) {
            break;
        }
        clusters.copy_to_lanes(members, &mut block, &mut variances);
        for sampled in &mut *sample {
            let centre = clusters.centre(sampled.cluster);
            let variance = clusters.variances[sampled.cluster];
            let bounds = simd::squared_bounds(workers.isa, centre, variance, &block, &variances);
            sampled.add_block(first, &bounds)?;
        }
    }
    Ok(())
}

/// Sort (value, weight) pairs; return the value at which the weights add up to `total`.
///
/// The largest value if they do not, infinity if there is none.
fn weighted_quantile(values: &mut [(f64, f64)], total: f64) -> f64 {
    values.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
    let mut sum = 0.0;
    let quantile = values.iter().find(|(_, weight)| {
        sum += weight;
        sum >= total
    });
    quantile
        .or(values.last())
        .map_or(f64::INFINITY, |value| value.0)
}
