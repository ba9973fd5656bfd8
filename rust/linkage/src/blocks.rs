//! Clusters in blocks of sixteen, with bounding boxes and f32 offsets for the filters.

use std::ops::Range;

use crate::clusters::Clusters;
use crate::error::Error;
use crate::parallel::Workers;
use crate::points::Points;
use crate::simd::{self, Aligned, F32Lanes, F64Lanes, LANES};
use mograft_machine::memory::{collect, with_capacity};

/// Offset of a lane without a cluster: beyond any limit, with a square that f32 can hold.
const EMPTY_LANE_OFFSET: f32 = 1e17;

/// Blocks of sixteen consecutive clusters; sixteen consecutive blocks form a *group*.
pub(crate) struct Blocks<'a> {
    /// The clusters.
    pub clusters: &'a Clusters,
    /// Coordinates per centre.
    pub dim: usize,
    /// Lower corners of the boxes around the centres, `dim` elements per group.
    lows: Vec<F64Lanes>,
    /// Upper corners of the boxes.
    highs: Vec<F64Lanes>,
    /// The smallest variance of each block, one element per group.
    min_variances: Vec<F64Lanes>,
    /// Midpoints of the boxes, row-major.
    midpoints: Vec<f64>,
    /// Half the extents of the boxes, rounded up, row-major.
    half_extents: Vec<f32>,
    /// Half the diagonal of each box.
    pub half_diagonals: Vec<f64>,
    /// The largest rounding error of the bounds of each block's clusters.
    pub bound_errors: Vec<f64>,
    /// Centres relative to the midpoint, `dim` elements per block.
    offsets: Vec<F32Lanes>,
    /// The extreme points of the clusters relative to the midpoint, `2 * dim` elements per block.
    /// Empty if every cluster is one point.
    extremes: Vec<F32Lanes>,
    /// The largest distance of a block's extreme points from the midpoint.
    pub extreme_radii: Vec<f64>,
    /// Variances of the clusters, rounded down, one element per block.
    f32_variances: Vec<F32Lanes>,
    /// The smallest element of each of `f32_variances`.
    min_f32_variances: Vec<f32>,
}

impl<'a> Blocks<'a> {
    /// Form blocks of consecutive clusters. Takes O(m) time and memory for m clusters.
    ///
    /// # Errors
    ///
    /// [`Error::OutOfMemory`], and [`Error::Stopped`] if the progress callback requests a stop.
    pub fn new(
        workers: &Workers<'_>,
        points: &Points,
        clusters: &'a Clusters,
    ) -> Result<Self, Error> {
        let dim = clusters.centres().len() / clusters.len();
        let n_blocks = clusters.len().div_ceil(LANES);
        let n_groups = n_blocks.div_ceil(LANES);
        let n_extremes = if clusters.are_points() { 0 } else { 2 };
        let mut blocks = Self {
            clusters,
            dim,
            lows: workers.allocate(Aligned([f64::INFINITY; LANES]), n_groups * dim)?,
            highs: workers.allocate(Aligned([f64::NEG_INFINITY; LANES]), n_groups * dim)?,
            min_variances: workers.allocate(Aligned([f64::INFINITY; LANES]), n_groups)?,
            midpoints: with_capacity(n_blocks * dim)?,
            half_extents: with_capacity(n_blocks * dim)?,
            half_diagonals: with_capacity(n_blocks)?,
            bound_errors: with_capacity(n_blocks)?,
            offsets: workers.allocate(Aligned([EMPTY_LANE_OFFSET; LANES]), n_blocks * dim)?,
            extremes: workers.allocate(Aligned([0.0; LANES]), n_extremes * n_blocks * dim)?,
            extreme_radii: workers.allocate(0.0, n_blocks)?,
            f32_variances: workers.allocate(Aligned([0.0; LANES]), n_blocks)?,
            min_f32_variances: with_capacity(n_blocks)?,
        };
        for block in 0..n_blocks {
            workers.check_row(block, LANES * dim)?;
            blocks.set_box(block);
            blocks.set_variances(block);
            if n_extremes > 0 {
                blocks.set_extremes(points, block);
            }
        }
        Ok(blocks)
    }

    /// Set the box of a block and the offsets of its centres.
    fn set_box(&mut self, block: usize) {
        let (dim, group, lane) = (self.dim, block / LANES, block % LANES);
        let mut squared_diagonal = 0.0;
        for axis in 0..dim {
            let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
            for cluster in self.members(block) {
                let x = self.clusters.centre(cluster)[axis];
                (low, high) = (low.min(x), high.max(x));
            }
            self.lows[group * dim + axis][lane] = low;
            self.highs[group * dim + axis][lane] = high;
            let midpoint = f64::midpoint(low, high);
            let half_extent = (high - midpoint).max(midpoint - low);
            squared_diagonal += half_extent * half_extent;
            self.midpoints.push(midpoint);
            self.half_extents
                .push(((half_extent * (1.0 + 1e-9)) as f32).next_up());
            for (i, cluster) in self.members(block).enumerate() {
                let x = self.clusters.centre(cluster)[axis];
                self.offsets[block * dim + axis][i] = (x - midpoint) as f32;
            }
        }
        self.half_diagonals.push(squared_diagonal.sqrt());
    }

    /// Set the variances and rounding errors of a block.
    fn set_variances(&mut self, block: usize) {
        let mut bound_error = 0.0;
        for (i, cluster) in self.members(block).enumerate() {
            let variance = self.clusters.variances[cluster];
            let smallest = &mut self.min_variances[block / LANES][block % LANES];
            *smallest = smallest.min(variance);
            let rounded = ((variance * (1.0 - 1e-6)) as f32).next_down();
            self.f32_variances[block][i] = rounded.max(0.0);
            bound_error = f64::max(bound_error, self.clusters.bound_error(cluster));
        }
        self.bound_errors.push(bound_error);
        let variances = &self.f32_variances[block][..self.members(block).len()];
        self.min_f32_variances
            .push(variances.iter().copied().fold(f32::INFINITY, f32::min));
    }

    /// Set the offsets of the extreme points of a block.
    fn set_extremes(&mut self, points: &Points, block: usize) {
        let (dim, members) = (self.dim, self.members(block));
        let midpoint = &self.midpoints[block * dim..][..dim];
        let lanes = &mut self.extremes[2 * block * dim..][..2 * dim];
        let mut largest: f64 = 0.0;
        for (i, cluster) in members.enumerate() {
            for (k, point) in self.clusters.extremes(cluster).into_iter().enumerate() {
                let mut squared = 0.0;
                for (axis, (x, y)) in points.row(point).iter().zip(midpoint).enumerate() {
                    lanes[2 * axis + k][i] = (x - y) as f32;
                    squared += (x - y) * (x - y);
                }
                largest = largest.max(squared);
            }
        }
        self.extreme_radii[block] = largest.sqrt() * (1.0 + 1e-9);
    }

    /// Count of blocks.
    pub fn len(&self) -> usize {
        self.half_diagonals.len()
    }

    /// Count of groups.
    pub fn n_groups(&self) -> usize {
        self.min_variances.len()
    }

    /// The clusters of a block.
    pub fn members(&self, block: usize) -> Range<usize> {
        block * LANES..self.clusters.len().min((block + 1) * LANES)
    }

    /// A block as the filters in f32 take it.
    pub fn block(&self, block: usize) -> simd::Block<'_> {
        let axes = block * self.dim..(block + 1) * self.dim;
        let extremes = if self.extremes.is_empty() {
            &[]
        } else {
            &self.extremes[2 * block * self.dim..2 * (block + 1) * self.dim]
        };
        simd::Block {
            extremes,
            midpoint: &self.midpoints[axes.clone()],
            half_extents: &self.half_extents[axes.clone()],
            offsets: &self.offsets[axes],
            variances: &self.f32_variances[block],
            min_variance: self.min_f32_variances[block],
        }
    }

    /// Lower and upper coordinate of a block's box along an axis.
    pub fn extent(&self, block: usize, axis: usize) -> (f64, f64) {
        let (row, lane) = (block / LANES * self.dim + axis, block % LANES);
        (self.lows[row][lane], self.highs[row][lane])
    }

    /// The smallest variance of a block's clusters.
    pub fn min_variance(&self, block: usize) -> f64 {
        self.min_variances[block / LANES][block % LANES]
    }

    /// Lower corners, upper corners and smallest variances of the sixteen boxes of a group.
    pub fn group(&self, group: usize) -> (&[F64Lanes], &[F64Lanes], &F64Lanes) {
        let axes = group * self.dim..(group + 1) * self.dim;
        (&self.lows[axes.clone()], &self.highs[axes], &self.min_variances[group])
    }

    /// Corners of the boxes around the groups: `dim` lower and `dim` upper coordinates per group.
    ///
    /// # Errors
    ///
    /// [`Error::OutOfMemory`].
    pub fn group_corners(&self) -> Result<(Vec<f64>, Vec<f64>), Error> {
        let smallest = |lanes: &F64Lanes| lanes.iter().copied().fold(f64::INFINITY, f64::min);
        let largest = |lanes: &F64Lanes| lanes.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        Ok((collect(self.lows.iter().map(smallest))?, collect(self.highs.iter().map(largest))?))
    }

    /// Whether a cluster may be within a squared limit of some cluster of a block.
    pub fn is_within_box(&self, cluster: usize, block: usize, limit: f64) -> bool {
        let lane = block % LANES;
        let (lows, highs, variances) = self.group(block / LANES);
        let mut sum = self.clusters.variances[cluster] + variances[lane];
        let centre = self.clusters.centre(cluster);
        for (&x, (low, high)) in centre.iter().zip(lows.iter().zip(highs)) {
            let gap = (low[lane] - x).max(x - high[lane]).max(0.0);
            sum += gap * gap;
            if sum > limit {
                return false;
            }
        }
        true
    }
}
