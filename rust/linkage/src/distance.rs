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
//! 3. All this in f32, relative to the clusters' centres. Pairs that could be the farthest, as
//!    far as f32 can tell, are looked at again in f64: the largest of those is the distance.

use crate::Error;
use crate::clusters::Clusters;
use crate::parallel::Crew;
use crate::points::{Points, squared_distance};
use crate::simd::{self, Isa, LANES, Lanes, ROWS};

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

/// Two clusters at work.
struct Pair {
    a: usize,
    c: usize,
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
        let mut packed = vec![[0.0; LANES]; starts[m]];
        let mut rest = packed.as_mut_slice();
        let mut jobs = Vec::with_capacity(m.div_ceil(PER_JOB));
        for first in (0..m).step_by(PER_JOB) {
            let last = (first + PER_JOB).min(m);
            let (own, others) = rest.split_at_mut(starts[last] - starts[first]);
            rest = others;
            jobs.push((first..last, own));
        }
        crew.each(
            jobs.into_iter(),
            || (),
            |(), (range, mut room)| {
                for cluster in range {
                    let (own, others) = room.split_at_mut(starts[cluster + 1] - starts[cluster]);
                    room = others;
                    pack(points, clusters.members(cluster), clusters.centre(cluster), own);
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
        Ok(Self { isa, points, clusters, packed, starts, radii, drifts, rounding })
    }

    /// The squared distance of clusters `a` and `c` if it is at most `limit`.
    pub fn within(&self, a: usize, c: usize, limit: f64, scratch: &mut Scratch) -> Option<f64> {
        let size = |cluster: usize| self.clusters.members(cluster).len();
        let (a, c) = if size(a) <= size(c) { (a, c) } else { (c, a) };
        let squared = if size(c) < PACK_FROM {
            self.by_all_pairs(a, c, limit)
        } else {
            self.by_sweeps(a, c, limit, scratch)
        };
        squared.filter(|&squared| squared <= limit)
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
    fn by_sweeps(&self, a: usize, c: usize, limit: f64, scratch: &mut Scratch) -> Option<f64> {
        let [centre_a, centre_c] = [a, c].map(|cluster| self.clusters.centre(cluster));
        offset(centre_c, centre_a, &mut scratch.way);
        // What rounding offsets to f32, and adding two, can add to a distance or take from it.
        let apart = scratch.way.iter().map(|x| x * x).sum::<f32>();
        let apart = f64::from(apart).sqrt() * 1.01;
        let slack = 4.0 * HALF_UNIT * (apart + self.radii[a] + self.radii[c]) + VANISHING;
        let pair = Pair { a, c, slack, limit: limit.sqrt() };
        let best = self.there_and_back(&pair, scratch)?;
        self.thin_out(&pair, best, scratch);
        self.compare(&pair, best, scratch)
    }

    /// A squared distance, as f32 sees it, that is nearly the largest, and none if that, or the
    /// bound that comes along, shows that the clusters are too far apart.
    fn there_and_back(&self, pair: &Pair, scratch: &mut Scratch) -> Option<f32> {
        let Pair { a, c, slack, limit } = *pair;
        let Scratch { way, from, near, far, .. } = scratch;
        let too_far = self.too_far(pair);
        let mut start = 0;
        if self.is_packed(a) {
            let farthest = self.sweep(a, way, near);
            // No average of squared distances, as that from here to C, exceeds the largest.
            let least = (f64::from(farthest).sqrt() * (1.0 - self.rounding) - slack).max(0.0);
            let average = least * least + self.clusters.spreads[c];
            let most = limit + self.drifts[c];
            if average * (1.0 - 1e-9) > most * most {
                return None;
            }
            start = place_of(farthest, near);
        }
        from.clear();
        self.seen_from(c, a, start, way, from);
        let mut best = self.sweep(c, from, far);
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
        self.sweep(c, from, far);
        let least = square((worth - self.radii[a]) * (1.0 - self.rounding));
        for (i, &member) in others.iter().enumerate() {
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
        far.resize(blocks.len() / dim, [0.0; LANES]);
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
            blocks.extend(self.lanes(cluster, i).map(|x| [x; LANES]));
        }
        for (lanes, x) in blocks[first..].iter_mut().zip(self.lanes(cluster, i)) {
            lanes[place % LANES] = x;
        }
    }

    /// Squared distances of `from`, an offset from its centre, to a cluster's members; the
    /// largest is returned.
    fn sweep(&self, cluster: usize, from: &[f32], out: &mut Vec<Lanes>) -> f32 {
        let blocks = self.blocks(cluster);
        out.resize(blocks.len() / from.len(), [0.0; LANES]);
        simd::sweep(self.isa, from, blocks, out)
    }
}

/// The first place of a value. Lanes to spare repeat a member before them: it is a member's.
fn place_of(value: f32, lanes: &[Lanes]) -> usize {
    lanes
        .as_flattened()
        .iter()
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
