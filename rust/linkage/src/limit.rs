//! How far to look in one stage: any limit is right, a good one makes stages few and cheap.
//!
//! A good limit leaves a cluster with some ten neighbours on average: enough that most find
//! their nearest among them and merge, few enough to be measured and kept. It is estimated from a
//! sample of clusters, spread evenly over the order and so over space; nothing is drawn by
//! chance. Where some are packed much closer than others, the neighbours are all theirs: then
//! more of those are sampled, and each counts for less.

use crate::Error;
use crate::clusters::Clusters;
use crate::distance::{Gauge, Limit, Scratch};
use crate::graph::transpose;
use crate::parallel::Crew;
use crate::simd::{self, Aligned, LANES, Wide};

/// Clusters in the sample.
const SAMPLE: usize = 96;

/// Clusters of it that look around together, so that the others are read once for all.
const TOGETHER: usize = 6;

/// Of the clusters that may be near, so many times the wanted neighbours are measured.
const MEASURED: f64 = 4.0;

/// Clusters that the bound cannot tell from neighbours, at most so many per neighbour wanted.
///
/// Each of them is measured for nothing. In many dimensions, where the bound is loose, this
/// and not the number of neighbours sets the limit.
const SUSPECTS: f64 = 40.0;

/// Suspects of all clusters together that a stage may have in any case: so many cost no more than
/// what they save, another stage.
const FREE: usize = 1 << 24;

/// Where the parts end that are sampled alike if space is uneven, the closest packed first.
const PARTS: [f64; 4] = [0.0, 1.0 / 64.0, 1.0 / 8.0, 1.0];

/// A squared limit with about `degree` neighbours to a cluster; some pair is within it.
///
/// `by_gap` lists the clusters by how closely they are packed, if that is uneven. Takes O(m d)
/// time for m clusters.
pub(crate) fn choose(
    crew: &Crew<'_>,
    clusters: &Clusters,
    gauge: &Gauge<'_>,
    degree: f64,
    by_gap: Option<&[u32]>,
) -> Result<f64, Error> {
    let m = clusters.len();
    let parts: &[f64] = if by_gap.is_some() { &PARTS } else { &[0.0, 1.0] };
    let mut sample = Vec::new();
    for part in parts.windows(2) {
        let [start, end] = [part[0], part[1]].map(|share| (share * m as f64) as usize);
        let count = SAMPLE.min(end - start);
        let weight = (end - start) as f64 / (m * count) as f64;
        // All neighbours may be those of the clusters up to here.
        let crowding = 1.5 / part[1];
        let measured = (degree * MEASURED.max(crowding)) as usize + 8;
        let suspects = measured.max((degree * SUSPECTS) as usize).max(FREE / m);
        for i in 0..count {
            let place = start + (2 * i + 1) * (end - start) / (2 * count);
            let cluster = by_gap.map_or(place, |by_gap| by_gap[place] as usize);
            sample.push(View::new(cluster, weight, measured, suspects.min(m - 1)));
        }
    }
    let seen = crew.each(
        sample.chunks_mut(TOGETHER),
        || (Vec::new(), Vec::new(), Scratch::default()),
        |(distances, reaches, scratch), views| {
            look_around(crew, clusters, views);
            for view in views {
                view.keep(view.suspects);
                // Where all others are suspects, no limit makes them fewer.
                let reach = if view.suspects < m - 1 { view.reach() } else { f64::INFINITY };
                reaches.push((reach, view.weight));
                view.keep(view.measured);
                for (_, other) in std::mem::take(&mut view.near) {
                    let (other, limit) = (other as usize, Limit::of(f64::INFINITY));
                    let distance = gauge.within(view.cluster, other, limit, scratch);
                    distances.extend(distance.map(|distance| (distance, view.weight)));
                }
            }
        },
    )?;
    let (mut distances, mut reaches) = (Vec::new(), Vec::new());
    for (some, others, _) in seen {
        distances.extend(some);
        reaches.extend(others);
    }
    let limit = quantile(&mut distances, degree);
    let least = distances.first().map_or(0.0, |first| first.0);
    Ok(limit.min(quantile(&mut reaches, 0.5)).max(least))
}

/// What a cluster of the sample has around it.
struct View {
    cluster: usize,
    /// The part of all clusters that it stands for.
    weight: f64,
    /// How many of the nearest, by the bound, are to be measured.
    measured: usize,
    /// How many may be suspected of being neighbours.
    suspects: usize,
    /// Bounds and clusters, those that are least among them.
    near: Vec<(f64, u32)>,
    /// No bound from here on is among the least.
    enough: f64,
}

impl View {
    fn new(cluster: usize, weight: f64, measured: usize, suspects: usize) -> Self {
        let (near, enough) = (Vec::new(), f64::INFINITY);
        Self { cluster, weight, measured, suspects, near, enough }
    }

    /// Take note of sixteen clusters.
    fn note(&mut self, first: usize, bounds: &Wide) {
        for (other, &bound) in (first..).zip(bounds.iter()) {
            if bound < self.enough && other != self.cluster {
                self.near.push((bound, other as u32));
            }
        }
        if self.near.len() > 3 * self.suspects {
            self.keep(self.suspects);
            self.enough = self.reach();
        }
    }

    /// Forget all but so many of the nearest.
    fn keep(&mut self, count: usize) {
        if self.near.len() > count {
            self.near
                .select_nth_unstable_by(count, |a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            self.near.truncate(count);
        }
    }

    /// The largest bound.
    fn reach(&self) -> f64 {
        self.near.iter().fold(0.0, |most, near| near.0.max(most))
    }
}

/// Find for each view those that may be nearest, by the bound.
fn look_around(crew: &Crew<'_>, clusters: &Clusters, views: &mut [View]) {
    let m = clusters.len();
    let (mut block, mut spreads) = (Vec::new(), Aligned([0.0; LANES]));
    for first in (0..m).step_by(LANES) {
        transpose(clusters, first..m.min(first + LANES), &mut block, &mut spreads);
        for view in &mut *views {
            let (centre, spread) = (clusters.centre(view.cluster), clusters.spreads[view.cluster]);
            view.note(first, &simd::bounds(crew.isa, centre, spread, &block, &spreads));
        }
    }
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
