//! How far to look in one stage: any limit is right, a good one makes stages few and cheap.
//!
//! A good limit leaves each cluster with some sixteen neighbours: enough that most find their
//! nearest among them and merge, few enough to be measured and kept. It is estimated from a
//! sample of clusters, spread evenly over the order and so over space; nothing is drawn by
//! chance.

use crate::Error;
use crate::clusters::Clusters;
use crate::distance::{Gauge, Scratch};
use crate::graph::transpose;
use crate::parallel::Crew;
use crate::simd::{self, LANES};

/// Clusters in the sample.
const SAMPLE: usize = 96;

/// Of the clusters that may be near, so many times the wanted neighbours are measured.
const MEASURED: f64 = 4.0;

/// Clusters that the bound cannot tell from neighbours, at most so many per neighbour wanted.
///
/// Each of them is measured for nothing. In many dimensions, where the bound is loose, this
/// and not the number of neighbours sets the limit.
const SUSPECTS: f64 = 16.0;

/// A squared limit with about `degree` neighbours to a cluster; some pair is within it.
///
/// Takes O(m d) time for m clusters.
pub(crate) fn choose(
    crew: &Crew<'_>,
    clusters: &Clusters,
    gauge: &Gauge<'_>,
    degree: f64,
) -> Result<f64, Error> {
    let m = clusters.len();
    let sample = SAMPLE.min(m);
    let suspects = ((degree * SUSPECTS) as usize).clamp(1, m - 1);
    let measured = ((degree * MEASURED) as usize + 8).min(suspects);
    let views = crew.each(
        (0..sample).map(|i| (2 * i + 1) * m / (2 * sample)),
        || (Vec::new(), Vec::new(), Scratch::default()),
        |(distances, reaches, scratch), cluster| {
            let mut near = nearest_by_bound(crew, clusters, cluster, suspects);
            reaches.extend(near.last().map(|last| last.0));
            near.truncate(measured);
            let measure = |&(_, other): &(f64, u32)| {
                gauge.within(cluster, other as usize, f64::INFINITY, scratch)
            };
            distances.extend(near.iter().filter_map(measure));
        },
    )?;
    let (mut distances, mut reaches) = (Vec::new(), Vec::new());
    for (some, others, _) in views {
        distances.extend(some);
        reaches.extend(others);
    }
    let limit = quantile(&mut distances, (degree * sample as f64) as usize);
    let least = quantile(&mut distances, 0);
    let half = reaches.len() / 2;
    Ok(limit.min(quantile(&mut reaches, half)).max(least))
}

/// The `wanted` clusters that may be nearest to one, by the bound, in order of it.
fn nearest_by_bound(
    crew: &Crew<'_>,
    clusters: &Clusters,
    cluster: usize,
    wanted: usize,
) -> Vec<(f64, u32)> {
    let m = clusters.len();
    let (centre, spread) = (clusters.centre(cluster), clusters.spreads[cluster]);
    let (mut block, mut spreads) = (Vec::new(), [0.0; LANES]);
    let mut near: Vec<(f64, u32)> = Vec::with_capacity(4 * wanted);
    let mut enough = f64::INFINITY;
    for first in (0..m).step_by(LANES) {
        transpose(clusters, first..m.min(first + LANES), &mut block, &mut spreads);
        let bounds = simd::bounds(crew.isa, centre, spread, &block, &spreads);
        for (other, &bound) in (first..).zip(&bounds) {
            if bound < enough && other != cluster {
                near.push((bound, other as u32));
            }
        }
        if near.len() > 3 * wanted {
            near.select_nth_unstable_by(wanted, |a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            near.truncate(wanted);
            enough = near.iter().fold(0.0, |most, near| near.0.max(most));
        }
    }
    near.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    near.truncate(wanted);
    near
}

/// The value that has `rank` smaller ones, or the largest.
pub(crate) fn quantile(values: &mut [f64], rank: usize) -> f64 {
    let rank = rank.min(values.len().saturating_sub(1));
    if values.is_empty() {
        return f64::INFINITY;
    }
    *values.select_nth_unstable_by(rank, f64::total_cmp).1
}
