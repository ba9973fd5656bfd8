//! The exact distance of two clusters, that of their farthest points, if it is within a limit.
//!
//! For small clusters all pairs of points are measured. For large clusters A and C most pairs
//! need not be:
//!
//! 1. *Sweeps.* Find the member of A farthest from C's centre, then the member of C farthest from
//!    that one, then back. The distances of these pairs are nearly the largest. In most calls they
//!    exceed the limit, and the call ends.
//! 2. *Candidates.* If a member is nearer to the other centre than the distance found so far less
//!    the other radius, no pair of it is farther. Only the other members remain as candidates.
//!    Members of large clusters are sorted by their distance from the centre, so that only the
//!    leading blocks are read.
//! 3. *Exact maximum.* Steps 1 and 2 are computed in f32, relative to the centres. All pairs of
//!    candidates whose f32 distance may be the largest are measured in f64.

use crate::clusters::{Clusters, SORTED_SIZE};
use crate::error::Error;
use crate::packed::{MIN_PACKED_SIZE, PackedMembers};
use crate::parallel::Workers;
use crate::points::{Points, squared_distance};
use crate::profile;
use crate::simd::{self, Aligned, F32Lanes, LANES, QUERIES};
use mograft_machine::memory::{collect, ensure_capacity, with_capacity};

/// Work of measuring a pair of clusters, without that on coordinates.
const PAIR_WORK: u64 = 300;

/// Work of the difference of two coordinates without vectors.
const SCALAR_WORK: u64 = 8;

/// Vectors of this many f32 take as much work as the difference of two coordinates in f64.
pub(crate) const F32_PER_WORK: usize = 4;

/// Smallest cluster C whose candidates are selected; of smaller ones all members are candidates.
const MIN_SELECTION_SIZE: usize = 48;

/// Distances below this have a square that f32 cannot distinguish from 0.
pub(crate) const F32_UNDERFLOW: f64 = 1e-17;

/// Unit roundoff of f32: the largest relative error of rounding a coordinate.
pub(crate) const F32_ROUNDOFF: f64 = 1.0 / (1 << 24) as f64;

/// A distance beyond which the exact distance of two clusters is not needed.
#[derive(Clone, Copy)]
pub(crate) struct Limit {
    /// The squared distance, exact.
    pub squared: f64,
    /// The distance, rounded up.
    pub root: f64,
}

impl Limit {
    /// The limit with this square.
    pub fn from_squared(squared: f64) -> Self {
        Self { squared, root: squared.sqrt() * (1.0 + f64::EPSILON) }
    }
}

/// Buffers of a thread, reused from pair to pair.
#[derive(Default)]
pub(crate) struct Scratch {
    /// Work done with these buffers, in the unit of [`Workers::add_work`].
    pub work: u64,
    /// Set if the system has refused memory for these buffers.
    error: Option<Error>,
    /// C's centre relative to A's.
    shift: Vec<f32>,
    /// The point that a sweep starts from, relative to the centre of the swept cluster.
    origin: Vec<f32>,
    /// Squared distances of A's members from C's centre.
    a_squares: Vec<F32Lanes>,
    /// Squared distances of C's members from the last `origin`.
    c_squares: Vec<F32Lanes>,
    /// Candidates of A, as indices of members.
    a_candidates: Vec<u32>,
    /// Offsets of A's candidates from C's centre, row-major.
    a_offsets: Vec<f32>,
    /// For each candidate of A, the largest squared distance to a candidate of C.
    a_maxima: Vec<f32>,
    /// Candidates of C, as rows of points; empty if all members are candidates.
    c_candidates: Vec<u32>,
    /// Offsets of C's candidates from C's centre, packed.
    c_offsets: Vec<F32Lanes>,
}

impl Scratch {
    /// Check that the system has not refused memory: after that, pairs may seem beyond the limit.
    ///
    /// # Errors
    ///
    /// [`Error::OutOfMemory`] if it has.
    pub fn check_memory(&self) -> Result<(), Error> {
        self.error.map_or(Ok(()), Err)
    }
}

/// Two clusters, and the constants of their comparison.
struct Pair {
    a: usize,
    c: usize,
    /// Upper bound of the distance of the centres.
    centre_distance: f64,
    /// Upper bound of the error of distances between their points that f32 offsets cause.
    offset_error: f64,
    /// The limit of the call.
    limit: f64,
}

/// Measures distances between the clusters of a partition.
pub(crate) struct ClusterDistances<'a> {
    workers: &'a Workers<'a>,
    points: &'a Points,
    clusters: &'a Clusters,
    packed: PackedMembers,
    /// Radius of each cluster's ball.
    radii: Vec<f64>,
    /// Rounding error of each cluster's bounds.
    bound_errors: Vec<f64>,
    /// Relative error of squared distances in f32.
    sum_error: f64,
}

impl<'a> ClusterDistances<'a> {
    /// Prepare to measure. Takes O(n) time and memory for n points.
    ///
    /// # Errors
    ///
    /// [`Error::OutOfMemory`], and [`Error::Stopped`] if the progress callback requests a stop.
    pub fn new(
        workers: &'a Workers<'a>,
        points: &'a Points,
        clusters: &'a Clusters,
    ) -> Result<Self, Error> {
        let radii = collect(clusters.squared_radii.iter().map(|squared| squared.sqrt()))?;
        let mut bound_errors = with_capacity(clusters.len())?;
        for cluster in 0..clusters.len() {
            workers.check_row(cluster, points.dim)?;
            bound_errors.push(clusters.bound_error(cluster));
        }
        Ok(Self {
            workers,
            points,
            clusters,
            packed: PackedMembers::new(workers, points, clusters)?,
            radii,
            bound_errors,
            sum_error: simd::f32_sum_error(points.dim),
        })
    }

    /// The squared distance of clusters `a` and `c` if it is within the limit.
    ///
    /// None also if the system refuses memory, which [`Scratch::check_memory`] tells, and if the
    /// progress callback requests a stop.
    /// Takes time proportional to the product of the sizes at worst, to their sum in most calls.
    pub fn squared_within(
        &self,
        a: usize,
        c: usize,
        limit: Limit,
        scratch: &mut Scratch,
    ) -> Option<f64> {
        let size = |cluster: usize| self.clusters.members(cluster).len();
        let (a, c) = if size(a) <= size(c) { (a, c) } else { (c, a) };
        scratch.work += PAIR_WORK;
        profile::count("pairs of clusters measured", 1);
        let squared = if size(c) < MIN_PACKED_SIZE {
            scratch.work += (size(a) * size(c) * self.points.dim) as u64 * SCALAR_WORK;
            self.maximum_of_all_pairs(a, c, limit.squared)
        } else {
            let squared = self.maximum_by_sweeps(a, c, limit, scratch);
            squared.unwrap_or_else(|error| {
                scratch.error = Some(error);
                None
            })
        };
        squared.filter(|&squared| squared <= limit.squared)
    }

    fn maximum_of_all_pairs(&self, a: usize, c: usize, limit: f64) -> Option<f64> {
        let mut largest = 0.0;
        for &p in self.clusters.members(a) {
            for &q in self.clusters.members(c) {
                let squared = squared_distance(self.points.row(p), self.points.row(q));
                if squared > largest {
                    largest = squared;
                    if largest > limit {
                        return None;
                    }
                }
            }
        }
        Some(largest)
    }

    /// The three steps above. `c` is packed; `a` has at most as many members.
    fn maximum_by_sweeps(
        &self,
        a: usize,
        c: usize,
        limit: Limit,
        scratch: &mut Scratch,
    ) -> Result<Option<f64>, Error> {
        let size = |cluster: usize| self.clusters.members(cluster).len();
        let n_lanes = self.packed.blocks(c).len() / self.points.dim;
        ensure_capacity(&mut scratch.a_squares, n_lanes)?;
        ensure_capacity(&mut scratch.c_squares, n_lanes)?;
        let [centre_a, centre_c] = [a, c].map(|cluster| self.clusters.centre(cluster));
        scratch.shift.clear();
        let axes = centre_c.iter().zip(centre_a);
        scratch.shift.extend(axes.map(|(x, y)| (x - y) as f32));
        let mut start = 0;
        if self.packed.contains(a) {
            scratch.work += (size(a) * self.points.dim / F32_PER_WORK) as u64;
            let farthest = self.sweep(a, &scratch.shift, &mut scratch.a_squares);
            if self.is_beyond(a, c, farthest, limit) {
                return Ok(None);
            }
            start = position_of(farthest, &scratch.a_squares);
        }
        let squared_shift = scratch.shift.iter().map(|x| x * x).sum::<f32>();
        let centre_distance = f64::from(squared_shift).sqrt() * 1.01;
        // Rounding of two offsets to f32, and of their sum.
        let reach = centre_distance + self.radii[a] + self.radii[c];
        let offset_error = 4.0 * F32_ROUNDOFF * reach + F32_UNDERFLOW;
        let pair = Pair { a, c, centre_distance, offset_error, limit: limit.root };
        scratch.work += ((size(a) + size(c)) * self.points.dim / F32_PER_WORK) as u64;
        let Some(largest) = self.sweep_both(&pair, start, scratch) else { return Ok(None) };
        self.select_candidates(&pair, largest, scratch)?;
        self.exact_maximum(&pair, largest, scratch)
    }

    /// Whether a point of A is so far from C's centre that the clusters are beyond the limit.
    ///
    /// `farthest` is the largest squared distance of a point a from the centre, in f32. The mean
    /// over C's points of |a − c|² is |a − c_C|² + V_C, and a maximum is at least a mean. In f32,
    /// |a − c_C| has an error of at most e = 4u (|a − c_C| + 2 r_A + r_C), where u is the unit
    /// roundoff. With x the computed distance, (x − e)² ≥ x² (1 − ε) − e²/ε for any ε > 0. The
    /// choice ε = 2^-12 avoids square roots in this function, the most frequently called one.
    fn is_beyond(&self, a: usize, c: usize, farthest: f32, limit: Limit) -> bool {
        const EPSILON: f64 = 1.0 / (1 << 12) as f64;
        const SQUARED_ERROR: f64 = (4.0 * F32_ROUNDOFF) * (4.0 * F32_ROUNDOFF) / EPSILON;
        let factor = 1.0 - 2.0 * EPSILON - 2.0 * self.sum_error;
        let (radius_a, radius_c) = (self.clusters.squared_radii[a], self.clusters.squared_radii[c]);
        let error = SQUARED_ERROR * (8.0 * radius_a + 2.0 * radius_c)
            + F32_UNDERFLOW * F32_UNDERFLOW / EPSILON;
        let mean = f64::from(farthest) * factor - error + self.clusters.variances[c];
        let largest = limit.root + self.bound_errors[c];
        mean * (1.0 - 1e-9) > largest * largest
    }

    /// Step 1: a squared distance in f32 that is nearly the largest.
    ///
    /// Starts at member `start` of A. None if the clusters are beyond the limit.
    fn sweep_both(&self, pair: &Pair, start: usize, scratch: &mut Scratch) -> Option<f32> {
        let Pair { a, c, .. } = *pair;
        let Scratch { shift, origin, c_squares, .. } = scratch;
        let limit = self.f32_limit(pair);
        origin.clear();
        self.push_offset(pair, start, shift, origin);
        let mut n_blocks = self.packed.blocks(c).len() / self.points.dim;
        if self.clusters.members(c).len() >= SORTED_SIZE {
            // The first block, of the farthest members, shows how many blocks matter.
            let largest = self.sweep_blocks(c, 1, origin, c_squares);
            if largest > limit {
                return None;
            }
            n_blocks = self.n_blocks_beyond(pair, self.lower_distance(pair, largest));
        }
        let mut largest = self.sweep_blocks(c, n_blocks, origin, c_squares);
        if largest > limit {
            return None;
        }
        if self.packed.contains(a) {
            origin.clear();
            let offset = self.packed.offset(c, position_of(largest, c_squares));
            origin.extend(offset.zip(&*shift).map(|(x, shift)| x + shift));
            largest = largest.max(self.sweep(a, origin, c_squares));
        }
        (largest <= limit).then_some(largest)
    }

    /// Step 2: the members that may belong to a pair at least as far as `largest`.
    fn select_candidates(
        &self,
        pair: &Pair,
        largest: f32,
        scratch: &mut Scratch,
    ) -> Result<(), Error> {
        let Pair { a, c, .. } = *pair;
        let Scratch { shift, origin, a_squares, c_squares, a_candidates, .. } = scratch;
        let Scratch { c_candidates, c_offsets, .. } = scratch;
        let distance = self.lower_distance(pair, largest);
        let size = self.clusters.members(a).len() as u32;
        a_candidates.clear();
        ensure_capacity(a_candidates, size as usize)?;
        if self.packed.contains(a) {
            let least = square_down((distance - self.radii[c]) * (1.0 - self.sum_error));
            a_candidates.extend((0..size).filter(|&i| lane(a_squares, i) >= least));
        } else {
            a_candidates.extend(0..size);
        }
        c_offsets.clear();
        c_candidates.clear();
        let members = self.clusters.members(c);
        if members.len() < MIN_SELECTION_SIZE {
            return Ok(());
        }
        origin.clear();
        origin.extend(shift.iter().map(|x| -x));
        let n_blocks = self.n_blocks_beyond(pair, distance);
        ensure_capacity(c_candidates, n_blocks * LANES)?;
        ensure_capacity(c_offsets, n_blocks * self.points.dim)?;
        self.sweep_blocks(c, n_blocks, origin, c_squares);
        let least = square_down((distance - self.radii[a]) * (1.0 - self.sum_error));
        for (i, &member) in members.iter().enumerate().take(n_blocks * LANES) {
            if lane(c_squares, i as u32) >= least {
                self.packed.append(c, i, c_candidates.len(), c_offsets);
                c_candidates.push(member);
            }
        }
        Ok(())
    }

    /// Step 3: the exact squared distance, from the candidates.
    fn exact_maximum(
        &self,
        pair: &Pair,
        mut largest: f32,
        scratch: &mut Scratch,
    ) -> Result<Option<f64>, Error> {
        let Pair { a, c, offset_error, .. } = *pair;
        let Scratch { shift, c_squares, a_candidates, a_offsets, a_maxima, .. } = scratch;
        let Scratch { c_candidates, c_offsets, .. } = scratch;
        let dim = self.points.dim;
        let (blocks, members) = if c_candidates.is_empty() {
            (self.packed.blocks(c), self.clusters.members(c))
        } else {
            (c_offsets.as_slice(), c_candidates.as_slice())
        };

        // In f32: for each candidate of A, the largest squared distance to the candidates of C, or to
        // all its members if there are no candidates.
        a_offsets.clear();
        let padded = a_candidates.len().next_multiple_of(QUERIES) * dim;
        ensure_capacity(a_offsets, padded)?;
        for &i in &*a_candidates {
            self.push_offset(pair, i as usize, shift, a_offsets);
        }
        while a_offsets.len() < padded {
            a_offsets.extend_from_within(..dim);
        }
        a_maxima.clear();
        ensure_capacity(a_maxima, padded / dim)?;
        let row_work = (blocks.len() * LANES / F32_PER_WORK) as u64;
        let limit = self.f32_limit(pair);
        for group in a_offsets.chunks_exact(QUERIES * dim) {
            scratch.work += QUERIES as u64 * row_work;
            if !self.workers.can_continue(&mut scratch.work) {
                return Ok(None);
            }
            let maxima = simd::max_of_rows(self.workers.isa, group, dim, blocks);
            largest = maxima.iter().fold(largest, |a, &b| a.max(b));
            if largest > limit {
                return Ok(None);
            }
            a_maxima.extend(maxima);
        }

        // In f64, all pairs that may be the farthest.
        let least = square_down(
            f64::from(largest).sqrt() * (1.0 - 2.0 * self.sum_error) - 2.0 * offset_error,
        );
        c_squares.resize(blocks.len() / dim, Aligned([0.0; LANES]));
        let mut squared = 0.0;
        let rows = a_candidates.iter().enumerate();
        for (row, &i) in rows.filter(|&(row, _)| a_maxima[row] >= least) {
            scratch.work += row_work;
            if !self.workers.can_continue(&mut scratch.work) {
                return Ok(None);
            }
            simd::squared_distances(
                self.workers.isa,
                &a_offsets[row * dim..][..dim],
                blocks,
                c_squares,
            );
            let point = self.points.row(self.clusters.members(a)[i as usize]);
            for (j, &member) in members.iter().enumerate() {
                if lane(c_squares, j as u32) >= least {
                    scratch.work += dim as u64 * SCALAR_WORK;
                    let exact = squared_distance(point, self.points.row(member));
                    squared = if exact > squared { exact } else { squared };
                }
            }
        }
        Ok(Some(squared))
    }

    /// The squared distance in f32 that only pairs beyond the limit can exceed.
    fn f32_limit(&self, pair: &Pair) -> f32 {
        let limit = (pair.limit + pair.offset_error) * (1.0 + self.sum_error);
        ((limit * limit) as f32).next_up()
    }

    /// Lower bound of the largest distance, from a squared distance in f32.
    ///
    /// The offset error counts twice: for the pair found and for those it is compared with.
    fn lower_distance(&self, pair: &Pair, squared: f32) -> f64 {
        f64::from(squared).sqrt() * (1.0 - self.sum_error) - 2.0 * pair.offset_error
    }

    /// Append the offset of member `i` of A from C's centre, given C's centre relative to A's.
    fn push_offset(&self, pair: &Pair, i: usize, shift: &[f32], out: &mut Vec<f32>) {
        if self.packed.contains(pair.a) {
            let offset = self.packed.offset(pair.a, i);
            out.extend(offset.zip(shift).map(|(x, shift)| x - shift));
        } else {
            let row = self.points.row(self.clusters.members(pair.a)[i]);
            let axes = row.iter().zip(self.clusters.centre(pair.c));
            out.extend(axes.map(|(x, y)| (x - y) as f32));
        }
    }

    /// How many of C's leading blocks may hold a member of a pair at least `distance` apart.
    ///
    /// By the triangle inequality, the distance of such a member from C's centre is at least
    /// `distance` - (distance of the centres) - (radius of A).
    fn n_blocks_beyond(&self, pair: &Pair, distance: f64) -> usize {
        let block_radii = self.packed.block_radii(pair.c);
        if self.clusters.members(pair.c).len() < SORTED_SIZE {
            return block_radii.len();
        }
        let least = (distance - pair.centre_distance - self.radii[pair.a]) * (1.0 - 1e-9)
            - pair.offset_error;
        block_radii
            .partition_point(|&radius| radius >= least)
            .max(1)
    }

    /// Squared distances of `origin` to the members of a cluster's first blocks; the largest.
    fn sweep_blocks(
        &self,
        cluster: usize,
        n_blocks: usize,
        origin: &[f32],
        out: &mut Vec<F32Lanes>,
    ) -> f32 {
        out.resize(n_blocks, Aligned([0.0; LANES]));
        let blocks = &self.packed.blocks(cluster)[..n_blocks * origin.len()];
        simd::squared_distances(self.workers.isa, origin, blocks, out)
    }

    /// Squared distances of `origin` to all members of a cluster; returns the largest.
    fn sweep(&self, cluster: usize, origin: &[f32], out: &mut Vec<F32Lanes>) -> f32 {
        let n_blocks = self.packed.blocks(cluster).len() / origin.len();
        self.sweep_blocks(cluster, n_blocks, origin, out)
    }
}

/// The first index of a value. Unused lanes repeat an earlier member, so it is that of a member.
fn position_of(value: f32, lanes: &[F32Lanes]) -> usize {
    lanes
        .iter()
        .flat_map(|lanes| &lanes.0)
        .position(|&x| x == value)
        .unwrap_or(0)
}

fn lane(lanes: &[F32Lanes], i: u32) -> f32 {
    lanes[i as usize / LANES][i as usize % LANES]
}

/// The square of a distance, rounded down; at most 0 if the distance is negative.
fn square_down(distance: f64) -> f32 {
    let distance = distance.max(0.0);
    ((distance * distance) as f32).next_down()
}
