//! Clusters, each with a ball that bounds its distances to others from below.
//!
//! A ball is a centre, a variance and a radius. The centre c is a weighted mean Σ wᵢ pᵢ of the
//! members, with weights that are not negative and add up to one; the variance is
//! V = Σ wᵢ |pᵢ − c|² under the same weights. For clusters A and C the mean over all pairs of
//! members is
//!
//! > Σ wᵢ vⱼ |aᵢ − cⱼ|² = |c_A − c_C|² + V_A + V_C
//!
//! A maximum is at least a mean, so the squared distance of the two clusters, which is that of
//! the farthest pair, is at least this *bound*. The bound holds for any weights. It is sharpest
//! if the centre is that of the smallest enclosing ball: then the variance has its maximum, the
//! squared radius of that ball. A few steps of the Frank-Wolfe method towards this maximum are
//! precise enough (Bădoiu and Clarkson 2003).

use std::cmp::Reverse;
use std::ops::Range;

use crate::error::Error;
use crate::parallel::Workers;
use crate::points::{Points, squared_distance};
use crate::simd::{Aligned, F64Lanes, LANES};
use crate::sorting::sort_in_job;
use mograft_machine::memory::{append, collect, with_capacity};

/// Frank-Wolfe steps for the ball of a new cluster.
const FRANK_WOLFE_STEPS: u16 = 8;

/// Members that the steps may read, each as often as there are steps.
const FRANK_WOLFE_WORK: usize = 1 << 13;

/// Ratio of squared radius to variance at which the steps end early.
const MAX_RADIUS_RATIO: f64 = 1.03;

/// Count of updates after which a centre is computed anew, because rounding errors add up.
const MAX_UPDATES: u16 = 1000;

/// Upper bound of the rounding error of a centre, as a fraction of the size of its coordinates.
///
/// Each of at most [`MAX_UPDATES`] and a few updates rounds by at most two units of 2^-53.
const CENTRE_ERROR: f64 = 1.0 / (1_u64 << 41) as f64;

/// Work of a coordinate of a member, in the unit of [`Workers::add_work`].
const MEMBER_WORK: u64 = 4;

/// Clusters of at least this size have their members sorted, the farthest from the centre first.
pub(crate) const SORTED_SIZE: usize = 64;

/// Most clusters that one job handles.
const MAX_CLUSTERS_PER_JOB: usize = 256;

/// With fewer jobs than this, each has fewer clusters: few clusters have many members.
const MIN_JOBS: usize = 64;

/// How many of `m` clusters one job handles.
pub(crate) fn clusters_per_job(m: usize) -> usize {
    (m / MIN_JOBS).clamp(1, MAX_CLUSTERS_PER_JOB)
}

/// A partition of the points into clusters.
pub(crate) struct Clusters {
    dim: usize,
    /// For each cluster, the smallest index of its points in the input.
    pub representatives: Vec<u32>,
    /// For each cluster, the index of its first member; then the count of points.
    starts: Vec<u32>,
    /// Row indices of the points, grouped by cluster.
    members: Vec<u32>,
    /// Centres of the balls, row-major.
    centres: Vec<f64>,
    /// Variance of the members under the weights of the centre.
    pub variances: Vec<f64>,
    /// Squared distance of the farthest member from the centre.
    pub squared_radii: Vec<f64>,
    /// How often each centre was updated since it was a point.
    update_counts: Vec<u16>,
    /// Rows of two points of each cluster that are far apart; equal if it has one point only.
    extremes: Vec<[u32; 2]>,
}

impl Clusters {
    /// The partition in which every point is a cluster.
    ///
    /// # Errors
    ///
    /// [`Error::OutOfMemory`], and [`Error::Stopped`] if the progress callback requests a stop.
    pub fn from_points(workers: &Workers<'_>, points: &Points) -> Result<Self, Error> {
        let n = points.len();
        let mut starts = with_capacity(n + 1)?;
        starts.extend(0..=n as u32);
        Ok(Self {
            dim: points.dim,
            representatives: collect(points.input_indices.iter().copied())?,
            starts,
            members: collect(0..n as u32)?,
            centres: workers.copy(&points.rows)?,
            variances: workers.allocate(0.0, n)?,
            squared_radii: workers.allocate(0.0, n)?,
            update_counts: workers.allocate(0, n)?,
            extremes: collect((0..n as u32).map(|point| [point; 2]))?,
        })
    }

    /// Count of clusters.
    pub fn len(&self) -> usize {
        self.representatives.len()
    }

    /// Rows of a cluster's points; from [`SORTED_SIZE`] on, the farthest from the centre first.
    pub fn members(&self, cluster: usize) -> &[u32] {
        &self.members[self.starts[cluster] as usize..self.starts[cluster + 1] as usize]
    }

    /// Rows of two points of a cluster that are far apart; equal if it has one point only.
    pub fn extremes(&self, cluster: usize) -> [u32; 2] {
        self.extremes[cluster]
    }

    /// Whether every cluster is one point.
    pub fn are_points(&self) -> bool {
        self.members.len() == self.len()
    }

    /// Centre of a cluster's ball.
    pub fn centre(&self, cluster: usize) -> &[f64] {
        &self.centres[cluster * self.dim..][..self.dim]
    }

    /// All centres, row-major.
    pub fn centres(&self) -> &[f64] {
        &self.centres
    }

    /// How much rounding may have added to the root of a bound, as far as this cluster is
    /// concerned.
    ///
    /// An error δ of the centre changes its distance by δ, and the variance, a mean over members
    /// no farther than D from it, by 2 δ D: together less than 4 δ in D.
    pub fn bound_error(&self, cluster: usize) -> f64 {
        let norm = |centre: &[f64]| centre.iter().map(|x| x * x).sum::<f64>().sqrt();
        4.0 * CENTRE_ERROR * (norm(self.centre(cluster)) + self.squared_radii[cluster].sqrt())
    }

    /// Copy the centres of up to sixteen clusters side by side: one element per axis.
    ///
    /// `variances` receives their variances, infinity for lanes without a cluster.
    pub fn copy_to_lanes(
        &self,
        clusters: Range<usize>,
        centres: &mut Vec<F64Lanes>,
        variances: &mut F64Lanes,
    ) {
        *variances = Aligned([f64::INFINITY; LANES]);
        centres.clear();
        centres.resize(self.dim, Aligned([0.0; LANES]));
        for (lane, cluster) in clusters.enumerate() {
            variances[lane] = self.variances[cluster];
            for (lanes, &x) in centres.iter_mut().zip(self.centre(cluster)) {
                lanes[lane] = x;
            }
        }
    }

    /// Some or all clusters in another order: cluster `i` is `order[i]` of these.
    ///
    /// # Errors
    ///
    /// [`Error::OutOfMemory`], and [`Error::Stopped`] if the progress callback requests a stop.
    pub fn reorder(&self, workers: &Workers<'_>, order: &[u32]) -> Result<Self, Error> {
        let dim = self.dim;
        let mut starts = with_capacity(order.len() + 1)?;
        starts.push(0);
        let mut end = 0;
        for (i, &cluster) in order.iter().enumerate() {
            workers.check_item(i)?;
            end += self.members(cluster as usize).len() as u32;
            starts.push(end);
        }
        let mut members = workers.allocate(0, end as usize)?;
        let mut centres = workers.allocate(0.0, order.len() * dim)?;
        let width = clusters_per_job(order.len());
        let jobs = split_members(&starts, width, &mut members)?
            .into_iter()
            .zip(centres.chunks_mut(width * dim))
            .zip(order.chunks(width));
        workers.run(
            jobs,
            || (),
            |(), ((mut members, centres), order)| {
                for (centre, &cluster) in centres.chunks_exact_mut(dim).zip(order) {
                    let source = self.members(cluster as usize);
                    let (target, rest) = members.split_at_mut(source.len());
                    target.copy_from_slice(source);
                    members = rest;
                    centre.copy_from_slice(self.centre(cluster as usize));
                }
            },
        )?;
        Ok(Self {
            dim,
            representatives: select(workers, &self.representatives, order)?,
            starts,
            members,
            centres,
            variances: select(workers, &self.variances, order)?,
            squared_radii: select(workers, &self.squared_radii, order)?,
            update_counts: select(workers, &self.update_counts, order)?,
            extremes: select(workers, &self.extremes, order)?,
        })
    }

    /// Append other clusters.
    ///
    /// # Errors
    ///
    /// [`Error::OutOfMemory`].
    pub fn append(&mut self, other: &Self) -> Result<(), Error> {
        let end = self.members.len() as u32;
        let starts = other.starts[1..].iter().map(|start| start + end);
        append(&mut self.starts, starts)?;
        append(&mut self.representatives, other.representatives.iter().copied())?;
        append(&mut self.members, other.members.iter().copied())?;
        append(&mut self.centres, other.centres.iter().copied())?;
        append(&mut self.variances, other.variances.iter().copied())?;
        append(&mut self.squared_radii, other.squared_radii.iter().copied())?;
        append(&mut self.update_counts, other.update_counts.iter().copied())?;
        append(&mut self.extremes, other.extremes.iter().copied())?;
        Ok(())
    }

    /// Unite the clusters that have the same root.
    ///
    /// `roots[i]` is the cluster that `i` was merged into; a root has itself. Takes O(n) time for
    /// n points.
    ///
    /// # Errors
    ///
    /// [`Error::OutOfMemory`], and [`Error::Stopped`] if the progress callback requests a stop.
    pub fn unite(
        &self,
        workers: &Workers<'_>,
        points: &Points,
        roots: &[u32],
    ) -> Result<Self, Error> {
        let dim = self.dim;
        let (targets, mut unions) = self.allocate_unions(workers, roots)?;
        let mut next_members = collect(unions.starts.iter().copied())?;
        for (cluster, &union) in targets.iter().enumerate() {
            workers.check_row(cluster, dim)?;
            let (union, members) = (union as usize, self.members(cluster));
            let start = next_members[union] as usize;
            unions.members[start..start + members.len()].copy_from_slice(members);
            let is_first = start == unions.starts[union] as usize;
            next_members[union] += members.len() as u32;
            let representative = &mut unions.representatives[union];
            *representative = (*representative).min(self.representatives[cluster]);
            if is_first {
                unions.centres[union * dim..][..dim].copy_from_slice(self.centre(cluster));
                unions.variances[union] = self.variances[cluster];
                unions.squared_radii[union] = self.squared_radii[cluster];
                unions.update_counts[union] = self.update_counts[cluster];
                unions.extremes[union] = self.extremes[cluster];
            } else {
                unions.add_part(union, self, cluster);
            }
        }
        unions.refine_balls(workers, points)?;
        Ok(unions)
    }

    /// The union of each cluster, and unions whose members and balls are still to be set.
    fn allocate_unions(
        &self,
        workers: &Workers<'_>,
        roots: &[u32],
    ) -> Result<(Vec<u32>, Self), Error> {
        let mut numbers = workers.allocate(u32::MAX, self.len())?;
        let mut count = 0;
        for cluster in (0..self.len()).filter(|&cluster| roots[cluster] as usize == cluster) {
            workers.check_item(count as usize)?;
            numbers[cluster] = count;
            count += 1;
        }
        let targets = collect(roots.iter().map(|&root| numbers[root as usize]))?;
        let count = count as usize;
        workers.check_progress()?;
        let mut starts = workers.allocate(0, count + 1)?;
        for (cluster, &union) in targets.iter().enumerate() {
            workers.check_item(cluster)?;
            starts[union as usize + 1] += self.members(cluster).len() as u32;
        }
        for i in 1..starts.len() {
            starts[i] += starts[i - 1];
        }
        let unions = Self {
            dim: self.dim,
            representatives: workers.allocate(u32::MAX, count)?,
            starts,
            members: workers.allocate(0, self.members.len())?,
            centres: workers.allocate(0.0, count * self.dim)?,
            variances: workers.allocate(0.0, count)?,
            squared_radii: workers.allocate(f64::NAN, count)?,
            update_counts: workers.allocate(0, count)?,
            extremes: workers.allocate([0; 2], count)?,
        };
        Ok((targets, unions))
    }

    /// Move the centre of a union towards that of one more part, so that the variance is largest.
    ///
    /// Sets the radius to NaN, which [`Self::refine_balls`] replaces.
    fn add_part(&mut self, union: usize, parts: &Self, part: usize) {
        let centre = &mut self.centres[union * self.dim..][..self.dim];
        let squared = squared_distance(centre, parts.centre(part));
        let (variance, part_variance) = (self.variances[union], parts.variances[part]);
        if squared > 0.0 {
            let weight = ((squared + part_variance - variance) / (2.0 * squared)).clamp(0.0, 1.0);
            move_towards(centre, parts.centre(part), weight);
            let rest = 1.0 - weight;
            self.variances[union] =
                rest * variance + weight * part_variance + rest * weight * squared;
        }
        let count = self.update_counts[union].max(parts.update_counts[part]);
        self.update_counts[union] = count.saturating_add(1);
        self.squared_radii[union] = f64::NAN;
    }

    /// Shrink the balls without a radius, those of new clusters, and sort their members.
    fn refine_balls(&mut self, workers: &Workers<'_>, points: &Points) -> Result<(), Error> {
        let (dim, starts) = (self.dim, &self.starts);
        let width = clusters_per_job(starts.len() - 1);
        let members = split_members(starts, width, &mut self.members)?;
        let radii = self.squared_radii.chunks_mut(width);
        let balls = self
            .centres
            .chunks_mut(dim * width)
            .zip(self.variances.chunks_mut(width))
            .zip(radii.zip(self.update_counts.chunks_mut(width)))
            .zip(self.extremes.chunks_mut(width));
        let states = workers.run(
            members.into_iter().zip(balls).enumerate(),
            BallScratch::default,
            |scratch, (job, (mut members, (((centres, variances), (radii, counts)), extremes)))| {
                let numbers = variances.iter_mut().zip(radii).zip(counts).zip(extremes);
                for (i, (centre, (((variance, squared_radius), update_count), extremes))) in
                    centres.chunks_mut(dim).zip(numbers).enumerate()
                {
                    let cluster = job * width + i;
                    let size = (starts[cluster + 1] - starts[cluster]) as usize;
                    let (cluster_members, later) = members.split_at_mut(size);
                    members = later;
                    if squared_radius.is_nan() {
                        let ball = Ball { centre, variance, squared_radius, update_count };
                        let refined = ball.refine(workers, points, cluster_members, scratch);
                        let Some(farthest) = workers.ok_or_stop(refined) else { return };
                        let place = points.row(farthest);
                        *extremes = [farthest, farthest_member(points, cluster_members, place).0];
                    }
                }
            },
        )?;
        for scratch in states {
            workers.add_work(scratch.work);
        }
        Ok(())
    }
}

/// The buffers of a thread that shrinks balls.
#[derive(Default)]
struct BallScratch {
    /// Squared distances from the centre, positions and rows of members.
    keyed: Vec<(Reverse<u64>, u32, u32)>,
    /// Work done since the last check of the progress.
    work: u64,
}

/// The ball of one cluster.
struct Ball<'a> {
    centre: &'a mut [f64],
    variance: &'a mut f64,
    squared_radius: &'a mut f64,
    update_count: &'a mut u16,
}

impl Ball<'_> {
    /// Shrink the ball, set its radius, and sort the members if they are at least [`SORTED_SIZE`].
    ///
    /// Ends early if the progress callback requests a stop. Returns the farthest member.
    fn refine(
        self,
        workers: &Workers<'_>,
        points: &Points,
        members: &mut [u32],
        scratch: &mut BallScratch,
    ) -> Result<u32, Error> {
        let Self { centre, variance, squared_radius, update_count } = self;
        if *update_count > MAX_UPDATES {
            // A point is its own mean without rounding error.
            centre.copy_from_slice(points.row(members[0]));
            (*variance, *update_count) = (0.0, 0);
        }
        let mut farthest = members[0];
        let n_steps = ((FRANK_WOLFE_WORK / members.len()) as u16).clamp(2, FRANK_WOLFE_STEPS);
        for step in 0..=n_steps {
            let (member, squared) = farthest_member(points, members, centre);
            (farthest, *squared_radius) = (member, squared);
            scratch.work += (members.len() * points.dim) as u64 * MEMBER_WORK;
            if !workers.can_continue(&mut scratch.work) {
                return Ok(farthest);
            }
            if step == n_steps || squared <= *variance * MAX_RADIUS_RATIO {
                break;
            }
            // The variance is a parabola in the weight; this is its maximum.
            let weight = ((squared - *variance) / (2.0 * squared)).clamp(0.0, 1.0);
            move_towards(centre, points.row(member), weight);
            *variance = (1.0 - weight) * (*variance + weight * squared);
            *update_count += 1;
        }
        if members.len() >= SORTED_SIZE {
            let BallScratch { keyed, work } = scratch;
            keyed.clear();
            let entries = members.iter().enumerate().map(|(position, &member)| {
                // Floats that are not negative have the order of their bits.
                let squared = squared_distance(points.row(member), centre).to_bits();
                (Reverse(squared), position as u32, member)
            });
            append(keyed, entries)?;
            sort_in_job(workers, keyed, work);
            for (member, entry) in members.iter_mut().zip(keyed) {
                *member = entry.2;
            }
        }
        Ok(farthest)
    }
}

/// The first of the members that are farthest from a place, and its squared distance.
fn farthest_member(points: &Points, members: &[u32], place: &[f64]) -> (u32, f64) {
    let mut farthest = (members[0], -1.0);
    for &member in members {
        let squared = squared_distance(points.row(member), place);
        if squared > farthest.1 {
            farthest = (member, squared);
        }
    }
    farthest
}

fn move_towards(centre: &mut [f64], target: &[f64], weight: f64) {
    for (x, &y) in centre.iter_mut().zip(target) {
        *x += weight * (y - *x);
    }
}

/// The members of each `width` clusters, given the index of each cluster's first.
fn split_members<'a>(
    starts: &[u32],
    width: usize,
    mut members: &'a mut [u32],
) -> Result<Vec<&'a mut [u32]>, Error> {
    let n_clusters = starts.len() - 1;
    let mut parts = with_capacity(n_clusters.div_ceil(width))?;
    for first in (0..n_clusters).step_by(width) {
        let end = n_clusters.min(first + width);
        let (part, rest) = members.split_at_mut((starts[end] - starts[first]) as usize);
        parts.push(part);
        members = rest;
    }
    Ok(parts)
}

fn select<T: Copy>(workers: &Workers<'_>, values: &[T], indices: &[u32]) -> Result<Vec<T>, Error> {
    workers.check_progress()?;
    Ok(collect(indices.iter().map(|&i| values[i as usize]))?)
}
