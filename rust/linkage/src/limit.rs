//! How far to look in one stage: any limit is right, a good one makes stages few and cheap.
//!
//! A good limit leaves a cluster with some sixteen neighbours on average: enough that most find
//! their nearest among them and merge, few enough to be measured and kept. It is estimated from a
//! sample of clusters, spread evenly over the order and so over space; nothing is drawn by
//! chance. Where some are packed much closer than others, and stand first, the neighbours are
//! all theirs: then more of those are sampled, and count for less.

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

/// Where the parts end that are sampled alike if space is uneven, of clusters in order.
const PARTS: [f64; 4] = [0.0, 1.0 / 64.0, 1.0 / 8.0, 1.0];

/// A squared limit with about `degree` neighbours to a cluster; some pair is within it.
///
/// If `is_uneven`, clusters stand in order of how closely they are packed. Takes O(m d) time
/// for m clusters.
pub(crate) fn choose(
    crew: &Crew<'_>,
    clusters: &Clusters,
    gauge: &Gauge<'_>,
    degree: f64,
    is_uneven: bool,
) -> Result<f64, Error> {
    let m = clusters.len();
    let parts: &[f64] = if is_uneven { &PARTS } else { &[0.0, 1.0] };
    let mut sample = Vec::new();
    for part in parts.windows(2) {
        let [start, end] = [part[0], part[1]].map(|share| (share * m as f64) as usize);
        let count = SAMPLE.min(end - start);
        let weight = (end - start) as f64 / (m * count) as f64;
        let place = |i: usize| start + (2 * i + 1) * (end - start) / (2 * count);
        // All neighbours may be those of the clusters up to here.
        let crowding = 1.5 / part[1];
        sample.extend((0..count).map(|i| (place(i), weight, crowding)));
    }
    let views = crew.each(
        sample.into_iter(),
        || (Vec::new(), Vec::new(), Scratch::default()),
        |(distances, reaches, scratch), (cluster, weight, crowding)| {
            let measured = (degree * MEASURED.max(crowding)) as usize + 8;
            let suspects = ((degree * SUSPECTS) as usize).max(measured).clamp(1, m - 1);
            let mut near = nearest_by_bound(crew, clusters, cluster, suspects);
            reaches.extend(near.last().map(|last| (last.0, weight)));
            near.truncate(measured);
            for (_, other) in near {
                let distance = gauge.within(cluster, other as usize, f64::INFINITY, scratch);
                distances.extend(distance.map(|distance| (distance, weight)));
            }
        },
    )?;
    let (mut distances, mut reaches) = (Vec::new(), Vec::new());
    for (some, others, _) in views {
        distances.extend(some);
        reaches.extend(others);
    }
    let limit = quantile(&mut distances, degree);
    let least = distances.first().map_or(0.0, |first| first.0);
    Ok(limit.min(quantile(&mut reaches, 0.5)).max(least))
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

/// Sort values, and find the one up to which their weights add up to `share`, or the largest.
fn quantile(values: &mut [(f64, f64)], share: f64) -> f64 {
    values.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
    let mut sum = 0.0;
    let reached = values.iter().find(|(_, weight)| {
        sum += weight;
        sum >= share
    });
    reached
        .or(values.last())
        .map_or(f64::INFINITY, |value| value.0)
}
