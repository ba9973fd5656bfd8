//! The distance of two clusters, that of their farthest points, or the news that it is too far.
//!
//! Looking at every pair of points would do, and is what happens where clusters are small.
//! Of large ones most pairs need no look:
//!
//! 1. The member of A farthest from C's centre, then the member of C farthest from that, then
//!    back: three sweeps that find a pair nearly as far apart as any. Mostly the clusters are
//!    too far apart, and this pair shows it.
//! 2. A member nearer to the other's centre than the pair's distance less the other's radius
//!    belongs to no farther pair. The few that remain are compared with each other.
//!    (Members of a large cluster stand in order of their distance from its centre, so of most
//!    nothing needs to be read at all.)
//! 3. All this in f32, relative to the clusters' centres. Pairs that could be the farthest, as
//!    far as f32 can tell, are looked at again in f64: the largest of those is the distance.

use crate::Error;
use crate::clusters::{Clusters, SORTED_FROM};
use crate::parallel::Crew;
use crate::points::{Points, squared_distance};
use crate::simd::{self, Aligned, Isa, LANES, Lanes, ROWS};

/// Clusters of fewer members are not packed into lanes.
const PACK_FROM: usize = 4;

/// Clusters of at least so many members are thinned out before all pairs are compared.
const THIN_FROM: usize = 48;

/// A distance too small for its square to be told from 0 in f32.
pub(crate) const VANISHING: f64 = 1e-17;

/// The most by which rounding of a coordinate to f32 changes it, as a fraction.
pub(crate) const HALF_UNIT: f64 = 1.0 / (1 << 24) as f64;

/// Clusters to be packed together: how many one job takes.
const PER_JOB: usize = 256;

/// What measures clusters: their points, packed for the purpose.
pub(crate) struct Gauge<'a> {
    isa: Isa,
    points: &'a Points,
    clusters: &'a Clusters,
    /// Members as offsets from their cluster's centre, sixteen side by side.
    packed: Vec<Lanes>,
    /// Where each cluster's blocks begin.
    starts: Vec<usize>,
    /// Of each block of a large cluster, how far from the centre its farthest member is.
    tops: Vec<f64>,
    /// Radius of each cluster's ball.
    radii: Vec<f64>,
    /// What rounding may have added to the bound of each cluster.
    drifts: Vec<f64>,
    rounding: f64,
}

/// Room to work in, kept from pair to pair.
#[derive(Default)]
pub(crate) struct Scratch {
    way: Vec<f32>,
    from: Vec<f32>,
    near: Vec<Lanes>,
    far: Vec<Lanes>,
    kept: Vec<u32>,
    rows: Vec<f32>,
    most: Vec<f32>,
    thinned: Vec<Lanes>,
    members: Vec<u32>,
}

/// A distance beyond which it does not matter how far apart clusters are.
#[derive(Clone, Copy)]
pub(crate) struct Limit {
    /// Its square, to the last bit.
    pub squared: f64,
    /// The distance, rounded up.
    pub root: f64,
}

impl Limit {
    /// Of the square.
    pub fn of(squared: f64) -> Self {
        Self { squared, root: squared.sqrt() * (1.0 + f64::EPSILON) }
    }
}

/// Two clusters at work.
struct Pair {
    a: usize,
    c: usize,
    /// The distance of their centres at most.
    apart: f64,
    /// What f32 may add to their points' distances, or take from them.
    slack: f64,
    /// The distance beyond which theirs is of no interest.
    limit: f64,
}

impl<'a> Gauge<'a> {
    /// Pack the members of all clusters. Takes O(n) time and memory.
    pub fn new(crew: &Crew<'_>, points: &'a Points, clusters: &'a Clusters) -> Result<Self, Error> {
        let (dim, m) = (points.dim, clusters.len());
        let mut starts = Vec::with_capacity(m + 1);
        starts.push(0);
        for cluster in 0..m {
            let size = clusters.members(cluster).len();
            let blocks = if size < PACK_FROM { 0 } else { size.div_ceil(LANES) };
            starts.push(starts[cluster] + blocks * dim);
        }
        let mut packed = vec![Aligned([0.0; LANES]); starts[m]];
        let mut tops = vec![0.0; starts[m] / dim];
        let mut rest = (packed.as_mut_slice(), tops.as_mut_slice());
        let mut jobs = Vec::with_capacity(m.div_ceil(PER_JOB));
        for first in (0..m).step_by(PER_JOB) {
            let last = (first + PER_JOB).min(m);
            let length = starts[last] - starts[first];
            let (blocks, other_blocks) = rest.0.split_at_mut(length);
            let (tops, other_tops) = rest.1.split_at_mut(length / dim);
            rest = (other_blocks, other_tops);
            jobs.push((first..last, blocks, tops));
        }
        crew.each(
            jobs.into_iter(),
            || (),
            |(), (range, blocks, tops)| {
                let first = starts[range.start];
                for cluster in range {
                    let own = starts[cluster] - first..starts[cluster + 1] - first;
                    let (members, centre) = (clusters.members(cluster), clusters.centre(cluster));
                    pack(points, members, centre, &mut blocks[own.clone()]);
                    if members.len() >= SORTED_FROM {
                        let tops = &mut tops[own.start / dim..own.end / dim];
                        for (top, &member) in tops.iter_mut().zip(members.iter().step_by(LANES)) {
                            *top = squared_distance(points.row(member), centre).sqrt();
                        }
                    }
                }
            },
        )?;
        let radii = clusters
            .radii
            .iter()
            .map(|squared| squared.sqrt())
            .collect();
        let drifts = (0..m).map(|cluster| clusters.drift(cluster)).collect();
        let (isa, rounding) = (crew.isa, simd::rounding(dim));
        Ok(Self { isa, points, clusters, packed, starts, tops, radii, drifts, rounding })
    }

    /// The squared distance of clusters `a` and `c` if it is no more than the limit's.
    pub fn within(&self, a: usize, c: usize, limit: Limit, scratch: &mut Scratch) -> Option<f64> {
        let size = |cluster: usize| self.clusters.members(cluster).len();
        let (a, c) = if size(a) <= size(c) { (a, c) } else { (c, a) };
        let squared = if size(c) < PACK_FROM {
            self.by_all_pairs(a, c, limit.squared)
        } else {
            self.by_sweeps(a, c, limit, scratch)
        };
        squared.filter(|&squared| squared <= limit.squared)
    }

    fn by_all_pairs(&self, a: usize, c: usize, limit: f64) -> Option<f64> {
        let mut most = 0.0;
        for &p in self.clusters.members(a) {
            for &q in self.clusters.members(c) {
                let apart = squared_distance(self.points.row(p), self.points.row(q));
                if apart > most {
                    most = apart;
                    if most > limit {
                        return None;
                    }
                }
            }
        }
        Some(most)
    }

    /// As in the three steps above; `c` is packed, `a` has no more members than it.
    fn by_sweeps(&self, a: usize, c: usize, limit: Limit, scratch: &mut Scratch) -> Option<f64> {
        let [centre_a, centre_c] = [a, c].map(|cluster| self.clusters.centre(cluster));
        offset(centre_c, centre_a, &mut scratch.way);
        let mut start = 0;
        if self.is_packed(a) {
            let farthest = self.sweep(a, &scratch.way, &mut scratch.near);
            if self.rules_out(a, c, farthest, limit) {
                return None;
            }
            start = place_of(farthest, &scratch.near);
        }
        // What rounding offsets to f32, and adding two, can add to a distance or take from it.
        let apart = scratch.way.iter().map(|x| x * x).sum::<f32>();
        let apart = f64::from(apart).sqrt() * 1.01;
        let slack = 4.0 * HALF_UNIT * (apart + self.radii[a] + self.radii[c]) + VANISHING;
        let pair = Pair { a, c, apart, slack, limit: limit.root };
        let best = self.there_and_back(&pair, start, scratch)?;
        self.thin_out(&pair, best, scratch);
        self.compare(&pair, best, scratch)
    }

    /// Whether some point of A is so far from C's centre that A and C are beyond the limit.
    ///
    /// `farthest` is the largest squared distance of a point a from the centre, as f32 sees it.
    /// The average over C's points of |a − c|² is |a − c_C|² + V_C, and no average exceeds the
    /// largest. In f32 |a − c_C| is off by e = 4u (|a − c_C| + 2 r_A + r_C) at most, where u is
    /// half a unit; with x the distance as seen, (x − e)² ≥ x² (1 − ε) − e²/ε for any ε, and
    /// ε = 2^-12 keeps the roots out of this, which is asked more often than anything else.
    fn rules_out(&self, a: usize, c: usize, farthest: f32, limit: Limit) -> bool {
        const EPSILON: f64 = 1.0 / (1 << 12) as f64;
        const UNITS: f64 = (4.0 * HALF_UNIT) * (4.0 * HALF_UNIT) / EPSILON;
        let kept = 1.0 - 2.0 * EPSILON - 2.0 * self.rounding;
        let (radius_a, radius_c) = (self.clusters.radii[a], self.clusters.radii[c]);
        let error = UNITS * (8.0 * radius_a + 2.0 * radius_c) + VANISHING * VANISHING / EPSILON;
        let average = f64::from(farthest) * kept - error + self.clusters.spreads[c];
        let most = limit.root + self.drifts[c];
        average * (1.0 - 1e-9) > most * most
    }

    /// A squared distance, as f32 sees it, that is nearly the largest, and none if that shows
    /// that the clusters are too far apart. Starts from a member of A.
    fn there_and_back(&self, pair: &Pair, start: usize, scratch: &mut Scratch) -> Option<f32> {
        let Pair { a, c, slack, .. } = *pair;
        let Scratch { way, from, far, .. } = scratch;
        let too_far = self.too_far(pair);
        from.clear();
        self.seen_from(c, a, start, way, from);
        let mut blocks = self.blocks(c).len() / self.points.dim;
        if self.clusters.members(c).len() >= SORTED_FROM {
            // Those farthest out show how far out the others must be to matter.
            let best = self.sweep_first(pair, 1, from, far);
            if best > too_far {
                return None;
            }
            let worth = f64::from(best).sqrt() * (1.0 - self.rounding) - 2.0 * slack;
            blocks = self.blocks_beyond(pair, worth);
        }
        let mut best = self.sweep_first(pair, blocks, from, far);
        if best > too_far {
            return None;
        }
        if self.is_packed(a) {
            from.clear();
            from.extend(
                self.lanes(c, place_of(best, far))
                    .zip(&*way)
                    .map(|(x, by)| x + by),
            );
            best = best.max(self.sweep(a, from, far));
        }
        (best <= too_far).then_some(best)
    }

    /// Which members of both may belong to a pair farther than `best`; that pair's own do.
    ///
    /// Those of A go to `kept`; those of C, if it is large, to `thinned`.
    fn thin_out(&self, pair: &Pair, best: f32, scratch: &mut Scratch) {
        let Pair { a, c, slack, .. } = *pair;
        let Scratch { way, from, near, far, kept, thinned, members, .. } = scratch;
        let worth = f64::from(best).sqrt() * (1.0 - self.rounding) - 2.0 * slack;
        let size = self.clusters.members(a).len() as u32;
        kept.clear();
        if self.is_packed(a) {
            let least = square((worth - self.radii[c]) * (1.0 - self.rounding));
            kept.extend((0..size).filter(|&i| lane(near, i) >= least));
        } else {
            kept.extend(0..size);
        }
        thinned.clear();
        members.clear();
        let others = self.clusters.members(c);
        if others.len() < THIN_FROM {
            return;
        }
        from.clear();
        from.extend(way.iter().map(|x| -x));
        let blocks = self.blocks_beyond(pair, worth);
        self.sweep_first(pair, blocks, from, far);
        let least = square((worth - self.radii[a]) * (1.0 - self.rounding));
        for (i, &member) in others.iter().enumerate().take(blocks * LANES) {
            if lane(far, i as u32) >= least {
                self.thin(c, i, members.len(), thinned);
                members.push(member);
            }
        }
    }

    /// The exact squared distance, from the members that are left.
    fn compare(&self, pair: &Pair, mut best: f32, scratch: &mut Scratch) -> Option<f64> {
        let Pair { a, c, slack, .. } = *pair;
        let Scratch { way, far, kept, rows, most, thinned, members, .. } = scratch;
        let dim = self.points.dim;
        let (blocks, members) = if members.is_empty() {
            (self.blocks(c), self.clusters.members(c))
        } else {
            (thinned.as_slice(), members.as_slice())
        };

        // How far the farthest is from each, several at a time.
        rows.clear();
        for &i in &*kept {
            self.seen_from(c, a, i as usize, way, rows);
        }
        let whole = kept.len().next_multiple_of(ROWS) * dim;
        while rows.len() < whole {
            rows.extend_from_within(..dim);
        }
        most.clear();
        let too_far = self.too_far(pair);
        for group in rows.chunks_exact(ROWS * dim) {
            let farthest = simd::farthest_of_rows(self.isa, group, dim, blocks);
            best = farthest.iter().fold(best, |a, &b| a.max(b));
            if best > too_far {
                return None;
            }
            most.extend(farthest);
        }

        // Which of them is it?
        let worth = f64::from(best).sqrt() * (1.0 - 2.0 * self.rounding) - 2.0 * slack;
        let least = square(worth);
        far.resize(blocks.len() / dim, Aligned([0.0; LANES]));
        let mut squared = 0.0;
        for (row, &i) in kept
            .iter()
            .enumerate()
            .filter(|&(row, _)| most[row] >= least)
        {
            simd::sweep(self.isa, &rows[row * dim..][..dim], blocks, far);
            let point = self.points.row(self.clusters.members(a)[i as usize]);
            for (j, &other) in members.iter().enumerate() {
                if lane(far, j as u32) >= least {
                    let apart = squared_distance(point, self.points.row(other));
                    squared = if apart > squared { apart } else { squared };
                }
            }
        }
        Some(squared)
    }

    /// The squared distance that in f32 only pairs beyond the limit can have.
    fn too_far(&self, pair: &Pair) -> f32 {
        let most = (pair.limit + pair.slack) * (1.0 + self.rounding);
        ((most * most) as f32).next_up()
    }

    fn is_packed(&self, cluster: usize) -> bool {
        self.starts[cluster + 1] > self.starts[cluster]
    }

    /// The offset of a member of `a` from the centre of `c`, of which `way` is that from A's.
    fn seen_from(&self, c: usize, a: usize, i: usize, way: &[f32], out: &mut Vec<f32>) {
        if self.is_packed(a) {
            out.extend(self.lanes(a, i).zip(way).map(|(x, by)| x - by));
        } else {
            let row = self.points.row(self.clusters.members(a)[i]);
            out.extend(
                row.iter()
                    .zip(self.clusters.centre(c))
                    .map(|(x, y)| (x - y) as f32),
            );
        }
    }

    fn blocks(&self, cluster: usize) -> &[Lanes] {
        &self.packed[self.starts[cluster]..self.starts[cluster + 1]]
    }

    /// A packed member's offset from its cluster's centre.
    fn lanes(&self, cluster: usize, i: usize) -> impl Iterator<Item = f32> {
        let first = self.starts[cluster] + i / LANES * self.points.dim;
        self.packed[first..first + self.points.dim]
            .iter()
            .map(move |lanes| lanes[i % LANES])
    }

    /// Put a packed member into the `place`-th of blocks that hold all before it.
    fn thin(&self, cluster: usize, i: usize, place: usize, blocks: &mut Vec<Lanes>) {
        let first = place / LANES * self.points.dim;
        if place.is_multiple_of(LANES) {
            // Lanes to spare repeat the block's first member.
            blocks.extend(self.lanes(cluster, i).map(|x| Aligned([x; LANES])));
        }
        for (lanes, x) in blocks[first..].iter_mut().zip(self.lanes(cluster, i)) {
            lanes[place % LANES] = x;
        }
    }

    /// How many of C's blocks may hold a member of a pair at a distance of `worth` or more.
    ///
    /// That member is no nearer to its centre than this less the distance of the other, and
    /// the other's is that of the centres and A's radius at most.
    fn blocks_beyond(&self, pair: &Pair, worth: f64) -> usize {
        let dim = self.points.dim;
        let range = self.starts[pair.c] / dim..self.starts[pair.c + 1] / dim;
        if self.clusters.members(pair.c).len() < SORTED_FROM {
            return range.len();
        }
        let least = (worth - pair.apart - self.radii[pair.a]) * (1.0 - 1e-9) - pair.slack;
        self.tops[range].partition_point(|&top| top >= least).max(1)
    }

    /// As [`Self::sweep`], over some of C's first blocks.
    fn sweep_first(&self, pair: &Pair, blocks: usize, from: &[f32], out: &mut Vec<Lanes>) -> f32 {
        out.resize(blocks, Aligned([0.0; LANES]));
        simd::sweep(self.isa, from, &self.blocks(pair.c)[..blocks * from.len()], out)
    }

    /// Squared distances of `from`, an offset from its centre, to a cluster's members; the
    /// largest is returned.
    fn sweep(&self, cluster: usize, from: &[f32], out: &mut Vec<Lanes>) -> f32 {
        let blocks = self.blocks(cluster);
        out.resize(blocks.len() / from.len(), Aligned([0.0; LANES]));
        simd::sweep(self.isa, from, blocks, out)
    }
}

/// The first place of a value. Lanes to spare repeat a member before them: it is a member's.
fn place_of(value: f32, lanes: &[Lanes]) -> usize {
    lanes
        .iter()
        .flat_map(|lanes| &lanes.0)
        .position(|&x| x == value)
        .unwrap_or(0)
}

/// The way from `origin` to a point.
fn offset(point: &[f64], origin: &[f64], out: &mut Vec<f32>) {
    out.clear();
    out.extend(point.iter().zip(origin).map(|(x, y)| (x - y) as f32));
}

/// Offsets of points from an origin, sixteen side by side; the first fills what is left over.
fn pack(points: &Points, members: &[u32], origin: &[f64], out: &mut [Lanes]) {
    for (block, sixteen) in out.chunks_exact_mut(points.dim).zip(members.chunks(LANES)) {
        for lane in 0..LANES {
            let row = points.row(*sixteen.get(lane).unwrap_or(&members[0]));
            for (lanes, (x, y)) in block.iter_mut().zip(row.iter().zip(origin)) {
                lanes[lane] = (x - y) as f32;
            }
        }
    }
}

fn lane(lanes: &[Lanes], i: u32) -> f32 {
    lanes[i as usize / LANES][i as usize % LANES]
}

/// The square, rounded down; of less than nothing, no more than nothing.
fn square(x: f64) -> f32 {
    let x = x.max(0.0);
    ((x * x) as f32).next_down()
}
