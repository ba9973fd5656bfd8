//! All pairs of clusters within a limit, found without measuring most pairs.
//!
//! Clusters are compared in blocks of sixteen. Four filters, each finer and more expensive than
//! the one before, pass the pairs whose bound (see [`clusters`](crate::clusters)) is within the
//! limit:
//!
//! 1. the box of a block against the boxes of sixteen others, in f64;
//! 2. the sixteen centres of a block against the box of another, in f32;
//! 3. the remaining centres against the sixteen centres of the other block, in f32;
//! 4. two points, far apart, of the remaining clusters against those of the other block, in f32.
//!
//! The filters in f32 work relative to the midpoint of the other block: their rounding error is
//! small compared with the distances in question, not with the whole cloud. If the blocks are so
//! large that it is not small, filters 2 and 3 are computed in f64 instead, without filter 4. The
//! pairs that pass are measured exactly.

use std::ops::Range;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering::Relaxed};

use crate::blocks::Blocks;
use crate::distance::{
    ClusterDistances, F32_PER_WORK, F32_ROUNDOFF, F32_UNDERFLOW, Limit, Scratch,
};
use crate::error::Error;
use crate::parallel::Workers;
use crate::profile;
use crate::simd::{self, Aligned, F64Lanes, LANES, Query};
use mograft_machine::memory::{collect, push};

/// Most blocks that one job compares with all later ones, which are then read once for all of them.
const BLOCKS_PER_TILE: usize = 8;

/// With fewer tiles than this, each has fewer blocks: few clusters have many members.
const MIN_TILES: usize = 64;

/// Largest f32 error, as a fraction of the limit, with which the f32 filters are used.
const MAX_F32_ERROR_RATIO: f64 = 0.01;

/// Error of the offset between two clusters in f32, as a fraction of the distance between the
/// midpoints of their blocks.
///
/// The offsets of both, the offset between the midpoints and their sum each round by half a unit.
/// The distance between the midpoints is at most the limit, both bound errors and both half
/// diagonals. Extreme points instead of centres have no bound error, and the distance of the farthest
/// from the midpoint instead of the half diagonal.
const F32_OFFSET_ERROR: f64 = 8.0 * F32_ROUNDOFF;

/// Two clusters and their squared distance.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Edge {
    /// The cluster of smaller index.
    pub a: u32,
    /// The cluster of larger index.
    pub b: u32,
    /// The squared distance, exact.
    pub squared: f64,
}

/// The result of a search.
pub(crate) enum Edges {
    /// All pairs within the limit, in parts.
    Complete(Vec<Vec<Edge>>),
    /// The pairs found until they were too many, in parts.
    Truncated(Vec<Vec<Edge>>),
    /// The search ended because all work together exceeds the limit.
    Exhausted,
}

/// All pairs of clusters whose squared distance is at most `limit`.
///
/// Ends early if there are more than `max_edges`, or if all work together exceeds `max_work`. The order of edges depends on the threads. Takes
/// O(m²) time at worst for m clusters, nearly all of it in the filters, and the memory of the
/// edges.
///
/// # Errors
///
/// [`Error::OutOfMemory`], and [`Error::Stopped`] if the progress callback requests a stop.
pub(crate) fn edges_within(
    workers: &Workers<'_>,
    blocks: &Blocks<'_>,
    distances: &ClusterDistances<'_>,
    limit: f64,
    max_edges: usize,
    max_work: f64,
) -> Result<Edges, Error> {
    let search = Search::new(workers, blocks, Target::Edges(distances), limit)?;
    let n_found = AtomicUsize::new(0);
    let states = workers.run(tiles(blocks.len()), SearchState::default, |state, tile| {
        if n_found.load(Relaxed) > max_edges || workers.work() > max_work {
            return;
        }
        let before = state.edges.len();
        search.search_tile(tile, state);
        workers.ok_or_stop(state.scratch.check_memory());
        workers.add_work(std::mem::take(&mut state.scratch.work));
        n_found.fetch_add(state.edges.len() - before, Relaxed);
    })?;
    if workers.work() > max_work {
        return Ok(Edges::Exhausted);
    }
    let edges = states.into_iter().map(|state| state.edges).collect();
    if n_found.into_inner() > max_edges {
        return Ok(Edges::Truncated(edges));
    }
    Ok(Edges::Complete(edges))
}

/// Which clusters may be within a squared distance of any other.
///
/// `is_known` are clusters that are. Takes the time of [`edges_within`] at worst, without exact
/// distances, and less if blocks are known as a whole.
///
/// # Errors
///
/// [`Error::OutOfMemory`], and [`Error::Stopped`] if the progress callback requests a stop.
pub(crate) fn clusters_within(
    workers: &Workers<'_>,
    blocks: &Blocks<'_>,
    limit: f64,
    is_known: Vec<bool>,
) -> Result<Vec<bool>, Error> {
    let marks = collect(is_known.into_iter().map(AtomicBool::new))?;
    let search = Search::new(workers, blocks, Target::Marks(&marks), limit)?;
    workers.run(tiles(blocks.len()), SearchState::default, |state, tile| {
        search.search_tile(tile, state);
        workers.add_work(std::mem::take(&mut state.scratch.work));
    })?;
    Ok(collect(marks.into_iter().map(AtomicBool::into_inner))?)
}

/// The blocks of each tile.
fn tiles(n_blocks: usize) -> impl ExactSizeIterator<Item = Range<usize>> + Send {
    let width = (n_blocks / MIN_TILES).clamp(1, BLOCKS_PER_TILE);
    (0..n_blocks.div_ceil(width)).map(move |tile| tile * width..n_blocks.min((tile + 1) * width))
}

/// What a search does with the pairs that pass the filters.
#[derive(Clone, Copy)]
enum Target<'a> {
    /// Measure them.
    Edges(&'a ClusterDistances<'a>),
    /// Mark both clusters.
    Marks(&'a [AtomicBool]),
}

/// The edges that a thread has found, and its buffers.
#[derive(Default)]
struct SearchState {
    edges: Vec<Edge>,
    scratch: Scratch,
    centres: Vec<F64Lanes>,
}

/// The filters for one limit.
struct Search<'a> {
    workers: &'a Workers<'a>,
    blocks: &'a Blocks<'a>,
    target: Target<'a>,
    limit: Limit,
    /// The limit plus the f32 error that is proportional to it.
    f32_limit: f64,
    /// For each block, the f32 error that does not depend on the limit, plus its bound error.
    block_errors: Vec<f64>,
    /// Relative error of squared distances in f32.
    sum_error: f64,
    /// Lower and upper corners of the box around each group.
    group_lows: Vec<f64>,
    group_highs: Vec<f64>,
    /// The largest bound error of all blocks.
    max_bound_error: f64,
}

impl<'a> Search<'a> {
    fn new(
        workers: &'a Workers<'a>,
        blocks: &'a Blocks<'a>,
        target: Target<'a>,
        squared: f64,
    ) -> Result<Self, Error> {
        let limit = Limit::from_squared(squared);
        let block_error = |(half_diagonal, bound_error): (&f64, &f64)| {
            F32_OFFSET_ERROR * half_diagonal
                + (1.0 + F32_OFFSET_ERROR) * bound_error
                + F32_UNDERFLOW / 2.0
        };
        let errors = blocks.half_diagonals.iter().zip(&blocks.bound_errors);
        let (group_lows, group_highs) = blocks.group_corners()?;
        Ok(Self {
            workers,
            blocks,
            target,
            limit,
            f32_limit: limit.root * (1.0 + F32_OFFSET_ERROR),
            block_errors: collect(errors.map(block_error))?,
            sum_error: simd::f32_sum_error(blocks.dim),
            group_lows,
            group_highs,
            max_bound_error: blocks.bound_errors.iter().copied().fold(0.0, f64::max),
        })
    }

    /// All edges from the blocks of a tile to themselves and to later blocks: filter 1.
    fn search_tile(&self, tile: Range<usize>, state: &mut SearchState) {
        let dim = self.blocks.dim;
        let boxes: Vec<(Vec<f64>, Vec<f64>)> = tile
            .clone()
            .map(|block| (0..dim).map(|axis| self.blocks.extent(block, axis)).unzip())
            .collect();
        let tile_box = surrounding_box(&boxes, dim);
        let limit = square(self.limit.root + 2.0 * self.max_bound_error) * (1.0 + 1e-9);
        let query = |block: usize| Query::new(self.blocks.block(block));
        let mut queries: Vec<Query<'_>> = tile.clone().map(query).collect();
        // For each block of the tile, which blocks of the group are within the limit.
        let mut masks = [0_u16; BLOCKS_PER_TILE];
        for group in tile.start / LANES..self.blocks.n_groups() {
            state.scratch.work += dim as u64;
            if !self.workers.can_continue(&mut state.scratch.work) {
                return;
            }
            if self.squared_gap(&tile_box, group) > limit {
                continue;
            }
            state.scratch.work += (dim * LANES * tile.len()) as u64;
            profile::count("boxes compared with boxes", LANES * tile.len());
            let (lows, highs, variances) = self.blocks.group(group);
            let mut union = 0_u16;
            for ((mask, block), (low, high)) in masks.iter_mut().zip(tile.clone()).zip(&boxes) {
                let variance = self.blocks.min_variance(block);
                *mask = if group < block / LANES {
                    0
                } else {
                    let isa = self.workers.isa;
                    simd::boxes_within(isa, low, high, variance, lows, highs, variances, limit)
                };
                if group == block / LANES {
                    *mask &= u16::MAX << (block % LANES);
                }
                union |= *mask;
            }
            while union != 0 {
                let lane = union.trailing_zeros() as usize;
                union &= union - 1;
                let selected =
                    (masks.iter().rev()).fold(0, |bits, mask| bits << 1 | (mask >> lane & 1));
                let other = group * LANES + lane;
                self.search_block(tile.start, selected, other, &mut queries, state);
            }
        }
    }

    /// Squared gap between a box and that of a group.
    fn squared_gap(&self, tile_box: &[(f64, f64)], group: usize) -> f64 {
        let axes = group * self.blocks.dim..(group + 1) * self.blocks.dim;
        let (lows, highs) = (&self.group_lows[axes.clone()], &self.group_highs[axes]);
        let corners = lows.iter().zip(highs);
        let axis_gap = |(&(low, high), (&other_low, &other_high)): (&(f64, f64), (&f64, &f64))| {
            square((other_low - high).max(low - other_high).max(0.0))
        };
        tile_box.iter().zip(corners).map(axis_gap).sum()
    }

    /// All edges from some blocks of a tile to later clusters of block `j`: filters 2 to 4.
    ///
    /// Bit `k` of `selected` is that of block `tile_start + k`.
    fn search_block(
        &self,
        tile_start: usize,
        selected: u16,
        j: usize,
        queries: &mut [Query<'_>],
        state: &mut SearchState,
    ) {
        let selected = self.without_marked(tile_start, selected, j);
        if selected == 0 {
            return;
        }
        let mut needs_f64 = 0;
        let mut remaining = selected;
        while remaining != 0 {
            let k = remaining.trailing_zeros() as usize;
            remaining &= remaining - 1;
            let error = self.block_errors[tile_start + k] + self.block_errors[j];
            needs_f64 |= u16::from(error > MAX_F32_ERROR_RATIO * self.limit.root) << k;
            let radii = &self.blocks.extreme_radii;
            let radius = radii[tile_start + k] + radii[j];
            queries[k].limit = self.f32_square(error);
            queries[k].extreme_limit = self.f32_square(F32_OFFSET_ERROR * radius + F32_UNDERFLOW);
        }
        let other = self.blocks.block(j);
        simd::blocks_within(self.workers.isa, queries, selected & !needs_f64, &other);
        profile::count("blocks compared with centres", selected.count_ones() as usize);
        let n_rows: u32 = (queries.iter().enumerate())
            .filter(|(k, _)| selected >> k & 1 != 0)
            .map(|(_, query)| 1 + query.rows.count_ones() + 4 * query.n_extreme_rows)
            .sum();
        state.scratch.work += (n_rows as usize * self.blocks.dim * LANES / F32_PER_WORK) as u64;
        let mut remaining = selected;
        while remaining != 0 {
            let k = remaining.trailing_zeros() as usize;
            remaining &= remaining - 1;
            if needs_f64 >> k & 1 != 0 {
                self.filter_in_f64(tile_start + k, j, &mut queries[k], state);
            }
            if queries[k].rows != 0 {
                self.push_edges(tile_start + k, j, &queries[k], state);
            }
        }
    }

    /// The squared limit in f32 for pairs whose offset has this error.
    fn f32_square(&self, error: f64) -> f32 {
        // The last factor includes the rounding of this product to f32.
        (square(self.f32_limit + error) * (1.0 + 3.0 * self.sum_error)) as f32
    }

    /// The selected blocks, except those whose clusters, and those of block `j`, are all marked.
    fn without_marked(&self, tile_start: usize, selected: u16, j: usize) -> u16 {
        let Target::Marks(marks) = self.target else { return selected };
        let is_marked =
            |block: usize| (self.blocks.members(block)).all(|cluster| marks[cluster].load(Relaxed));
        if !is_marked(j) {
            return selected;
        }
        (0..BLOCKS_PER_TILE).fold(selected, |bits, k| {
            let is_done = bits >> k & 1 != 0 && is_marked(tile_start + k);
            bits & !(u16::from(is_done) << k)
        })
    }

    /// Measure the pairs of blocks `i` and `j` that have passed, and append the edges.
    fn push_edges(&self, i: usize, j: usize, query: &Query<'_>, state: &mut SearchState) {
        let (first, second) = (self.blocks.members(i), self.blocks.members(j));
        let mut rows = query.rows & (u16::MAX >> (LANES - first.len()));
        let used_lanes = u16::MAX >> (LANES - second.len());
        while rows != 0 {
            let row = rows.trailing_zeros() as usize;
            rows &= rows - 1;
            // Within a block, each pair once.
            let later = if i == j { (u16::MAX << row) << 1 } else { u16::MAX };
            let mut lanes = query.found[row] & used_lanes & later;
            while lanes != 0 {
                let (a, b) = (first.start + row, second.start + lanes.trailing_zeros() as usize);
                lanes &= lanes - 1;
                match self.target {
                    Target::Marks(marks) => {
                        marks[a].store(true, Relaxed);
                        marks[b].store(true, Relaxed);
                    }
                    Target::Edges(distances) => {
                        let squared =
                            distances.squared_within(a, b, self.limit, &mut state.scratch);
                        if !self.workers.can_continue(&mut state.scratch.work) {
                            return;
                        }
                        if let Some(squared) = squared {
                            let edge = Edge { a: a as u32, b: b as u32, squared };
                            if self
                                .workers
                                .ok_or_stop(push(&mut state.edges, edge))
                                .is_none()
                            {
                                return;
                            }
                        }
                    }
                }
            }
        }
    }

    /// Filters 2 and 3 in f64, for blocks that are too large for f32.
    fn filter_in_f64(&self, i: usize, j: usize, query: &mut Query<'_>, state: &mut SearchState) {
        let clusters = self.blocks.clusters;
        let limit = self.limit.root + self.blocks.bound_errors[i] + self.blocks.bound_errors[j];
        let limit = square(limit) * (1.0 + 1e-9);
        let (first, second) = (self.blocks.members(i), self.blocks.members(j));
        let is_within = |block, cluster| self.blocks.is_within_box(cluster, block, limit);
        query.rows = (first.clone().enumerate())
            .fold(0, |rows, (row, cluster)| rows | u16::from(is_within(j, cluster)) << row);
        if query.rows == 0 || !second.clone().any(|cluster| is_within(i, cluster)) {
            query.rows = 0;
            return;
        }
        let mut variances = Aligned([f64::INFINITY; LANES]);
        clusters.copy_to_lanes(second, &mut state.centres, &mut variances);
        let rows = first
            .enumerate()
            .filter(|(row, _)| query.rows >> row & 1 != 0);
        for (row, cluster) in rows {
            let (centre, variance) = (clusters.centre(cluster), clusters.variances[cluster]);
            let isa = self.workers.isa;
            let bounds = simd::squared_bounds(isa, centre, variance, &state.centres, &variances);
            query.found[row] = (bounds.iter().enumerate())
                .fold(0, |bits, (lane, &bound)| bits | u16::from(bound <= limit) << lane);
        }
    }
}

/// The box around some boxes, as (low, high) along every axis.
fn surrounding_box(boxes: &[(Vec<f64>, Vec<f64>)], dim: usize) -> Vec<(f64, f64)> {
    let extent = |axis: usize| {
        let start = (f64::INFINITY, f64::NEG_INFINITY);
        boxes
            .iter()
            .fold(start, |(low, high), (lows, highs)| (low.min(lows[axis]), high.max(highs[axis])))
    };
    (0..dim).map(extent).collect()
}

fn square(x: f64) -> f64 {
    x * x
}
