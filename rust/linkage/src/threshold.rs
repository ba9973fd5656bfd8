//! The distance up to which a stage merges: any value is correct, a good one saves time.
//!
//! A good threshold gives a cluster about ten neighbours: enough that most clusters find their
//! nearest one among them and merge, few enough to be measured and stored. It is estimated from a
//! sample of clusters that is spread evenly over the spatial order; nothing is random. If density
//! is uneven, the densest clusters have most neighbours: they are sampled more often and weighted
//! less.

use crate::clusters::Clusters;
use crate::distance::{ClusterDistances, Limit, Scratch};
use crate::error::Error;
use crate::parallel::Workers;
use crate::simd::{self, Aligned, F64Lanes, LANES};

/// Clusters in the sample, for each part of [`DENSITY_PARTS`].
const SAMPLE_SIZE: usize = 96;

/// Clusters of the sample that one job handles; the others are read once for all of them.
const SAMPLES_PER_JOB: usize = 6;

/// Neighbours measured per neighbour wanted.
const MEASURED_PER_NEIGHBOUR: f64 = 4.0;

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
/// [`Error::Stopped`] if the progress callback requests a stop.
pub(crate) fn choose_threshold(
    workers: &Workers<'_>,
    clusters: &Clusters,
    distances: &ClusterDistances<'_>,
    degree: f64,
    by_density: Option<&[u32]>,
) -> Result<f64, Error> {
    let m = clusters.len();
    let mut sample = draw_sample(m, degree, by_density);
    let states = workers.run(
        sample.chunks_mut(SAMPLES_PER_JOB),
        || (Vec::new(), Vec::new(), Scratch::default()),
        |(squares, bounds, scratch), chunk| {
            collect_nearest(workers, clusters, chunk);
            for sampled in chunk {
                sampled.keep_nearest(sampled.n_suspects);
                // If all others are suspects, no threshold excludes any.
                let is_bounded = sampled.n_suspects < m - 1;
                let bound = if is_bounded { sampled.max_bound() } else { f64::INFINITY };
                bounds.push((bound, sampled.weight));
                sampled.keep_nearest(sampled.n_measured);
                for (_, other) in std::mem::take(&mut sampled.nearest) {
                    let (other, limit) = (other as usize, Limit::from_squared(f64::INFINITY));
                    let squared = distances.squared_within(sampled.cluster, other, limit, scratch);
                    squares.extend(squared.map(|squared| (squared, sampled.weight)));
                }
            }
        },
    )?;
    let (mut squares, mut bounds) = (Vec::new(), Vec::new());
    workers.add_work((sample.len() * m * clusters.centre(0).len()) as u64);
    for (thread_squares, thread_bounds, scratch) in states {
        workers.add_work(scratch.work);
        squares.extend(thread_squares);
        bounds.extend(thread_bounds);
    }
    let threshold = weighted_quantile(&mut squares, degree);
    let smallest = squares.first().map_or(0.0, |first| first.0);
    Ok(threshold
        .min(weighted_quantile(&mut bounds, 0.5))
        .max(smallest))
}

/// Choose the clusters of the sample, evenly within each part of density.
fn draw_sample(m: usize, degree: f64, by_density: Option<&[u32]>) -> Vec<Sampled> {
    let parts: &[f64] = if by_density.is_some() { &DENSITY_PARTS } else { &[0.0, 1.0] };
    let mut sample = Vec::new();
    for part in parts.windows(2) {
        let [start, end] = [part[0], part[1]].map(|fraction| (fraction * m as f64) as usize);
        let count = SAMPLE_SIZE.min(end - start);
        let weight = (end - start) as f64 / (m * count) as f64;
        // All neighbours may be those of the clusters up to the end of this part.
        let crowding = 1.5 / part[1];
        let n_measured = (degree * MEASURED_PER_NEIGHBOUR.max(crowding)) as usize + 8;
        let n_suspects = n_measured
            .max((degree * SUSPECTS_PER_NEIGHBOUR) as usize)
            .max(FREE_SUSPECTS / m)
            .min(m - 1);
        for i in 0..count {
            let rank = start + (2 * i + 1) * (end - start) / (2 * count);
            let cluster = by_density.map_or(rank, |order| order[rank] as usize);
            let (nearest, cutoff) = (Vec::new(), f64::INFINITY);
            sample.push(Sampled { cluster, weight, n_measured, n_suspects, nearest, cutoff });
        }
    }
    sample
}

/// A cluster of the sample, and the clusters nearest to it by the bound.
struct Sampled {
    cluster: usize,
    /// The fraction of all clusters that it represents.
    weight: f64,
    /// How many of the nearest are measured.
    n_measured: usize,
    /// How many of the nearest are kept.
    n_suspects: usize,
    /// Bounds and clusters, those of the smallest bounds among them.
    nearest: Vec<(f64, u32)>,
    /// Only smaller bounds are among the smallest.
    cutoff: f64,
}

impl Sampled {
    /// Add sixteen consecutive clusters.
    fn add_block(&mut self, first: usize, bounds: &F64Lanes) {
        for (other, &bound) in (first..).zip(bounds.iter()) {
            if bound < self.cutoff && other != self.cluster {
                self.nearest.push((bound, other as u32));
            }
        }
        if self.nearest.len() > 3 * self.n_suspects {
            self.keep_nearest(self.n_suspects);
            self.cutoff = self.max_bound();
        }
    }

    /// Remove all but the `count` nearest.
    fn keep_nearest(&mut self, count: usize) {
        if self.nearest.len() > count {
            self.nearest
                .select_nth_unstable_by(count, |a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            self.nearest.truncate(count);
        }
    }

    /// The largest bound of the nearest.
    fn max_bound(&self) -> f64 {
        self.nearest
            .iter()
            .fold(0.0, |largest, &(bound, _)| bound.max(largest))
    }
}

/// Compare some clusters of the sample with all clusters.
fn collect_nearest(workers: &Workers<'_>, clusters: &Clusters, sample: &mut [Sampled]) {
    let m = clusters.len();
    let (mut block, mut variances) = (Vec::new(), Aligned([0.0; LANES]));
    for first in (0..m).step_by(LANES) {
        clusters.copy_to_lanes(first..m.min(first + LANES), &mut block, &mut variances);
        for sampled in &mut *sample {
            let centre = clusters.centre(sampled.cluster);
            let variance = clusters.variances[sampled.cluster];
            let bounds = simd::squared_bounds(workers.isa, centre, variance, &block, &variances);
            sampled.add_block(first, &bounds);
        }
    }
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
