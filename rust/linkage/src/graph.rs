//! All pairs of clusters no farther apart than a limit, found without looking at most pairs.
//!
//! Clusters stand in blocks of sixteen neighbours. Three sieves, each coarser and cheaper than
//! the next, pass what may be a pair; all work with the bound of `clusters`, that the squared
//! distance of two clusters is at least that of their centres plus both spreads:
//!
//! 1. box of a block against the boxes of sixteen others, in f64;
//! 2. sixteen centres against the box of another block;
//! 3. those centres that are left against the sixteen of the other block.
//!
//! The last two are in f32, relative to the middle of the other block, so that rounding is
//! small against the distances in question and not against the whole cloud; where the blocks
//! are so large that it is not small, the third alone is done, in f64. What is left is measured
//! exactly by `distance`.

use std::ops::Range;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};

use crate::Error;
use crate::clusters::Clusters;
use crate::distance::{Gauge, HALF_UNIT, Limit, Scratch, VANISHING};
use crate::parallel::Crew;
use crate::simd::{self, Aligned, LANES, Lanes, Query, Wide};

/// Blocks whose turn it is together: what they are compared with stays in the cache.
const TILE: usize = 8;

/// Where a lane holds no cluster: farther than any distance, with a square that f32 can hold.
const NOWHERE: f32 = 1e17;

/// f32 will do as long as its rounding is no larger part of the limit than this.
const FINE: f64 = 0.01;

/// What rounding to f32 may add to the way between two clusters, in parts of how far the middles
/// of their blocks are apart: offsets, the way between the middles and their sum each round by
/// half a unit. Middles are no farther apart than the limit, both drifts and both reaches.
const UNITS: f64 = 8.0 * HALF_UNIT;

/// Two clusters and their squared distance.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Edge {
    /// One of them.
    pub a: u32,
    /// The other, of a larger number.
    pub b: u32,
    /// The squared distance.
    pub squared: f64,
}

/// Edges, or some of them if there are too many.
pub(crate) enum Graph {
    /// All.
    Whole(Vec<Edge>),
    /// Those found before there were too many.
    Crowded(Vec<Edge>),
}

/// Blocks of clusters, as the sieves see them.
pub(crate) struct Blocks<'a> {
    clusters: &'a Clusters,
    dim: usize,
    /// Corners of the boxes of all blocks, sixteen boxes side by side.
    lows: Vec<Wide>,
    highs: Vec<Wide>,
    /// The least spread in each block.
    spreads: Vec<Wide>,
    /// Middle of each box.
    middles: Vec<f64>,
    /// Half the extent of each box, rounded up.
    halves: Vec<f32>,
    /// Half the diagonal of each box.
    reaches: Vec<f64>,
    /// The most that the bounds of a block's clusters may be off.
    drifts: Vec<f64>,
    /// Centres as offsets from the middle.
    offsets: Vec<Lanes>,
    /// Spreads of single clusters, rounded down.
    lane_spreads: Vec<Lanes>,
    /// The least of each block's.
    least_spreads: Vec<f32>,
}

impl<'a> Blocks<'a> {
    /// Blocks of consecutive clusters. Takes O(m) time and memory for m of them.
    pub fn new(clusters: &'a Clusters) -> Self {
        let dim = clusters.centres().len() / clusters.len();
        let count = clusters.len().div_ceil(LANES);
        let groups = count.div_ceil(LANES);
        let mut blocks = Self {
            clusters,
            dim,
            lows: vec![Aligned([f64::INFINITY; LANES]); groups * dim],
            highs: vec![Aligned([f64::NEG_INFINITY; LANES]); groups * dim],
            spreads: vec![Aligned([f64::INFINITY; LANES]); groups],
            middles: Vec::with_capacity(count * dim),
            halves: Vec::with_capacity(count * dim),
            reaches: Vec::with_capacity(count),
            drifts: Vec::with_capacity(count),
            offsets: vec![Aligned([NOWHERE; LANES]); count * dim],
            lane_spreads: vec![Aligned([0.0; LANES]); count],
            least_spreads: Vec::with_capacity(count),
        };
        for block in 0..count {
            blocks.fill(block);
        }
        blocks
    }

    /// The clusters of a block.
    fn members(&self, block: usize) -> Range<usize> {
        block * LANES..self.clusters.len().min((block + 1) * LANES)
    }

    fn fill(&mut self, block: usize) {
        let (dim, group, lane) = (self.dim, block / LANES, block % LANES);
        let mut reach = 0.0;
        for axis in 0..dim {
            let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
            for cluster in self.members(block) {
                let x = self.clusters.centre(cluster)[axis];
                (low, high) = (low.min(x), high.max(x));
            }
            self.lows[group * dim + axis][lane] = low;
            self.highs[group * dim + axis][lane] = high;
            let middle = f64::midpoint(low, high);
            let half = (high - middle).max(middle - low);
            reach += half * half;
            self.middles.push(middle);
            self.halves.push(((half * (1.0 + 1e-9)) as f32).next_up());
            for (place, cluster) in self.members(block).enumerate() {
                let x = self.clusters.centre(cluster)[axis];
                self.offsets[block * dim + axis][place] = (x - middle) as f32;
            }
        }
        let mut drift = 0.0;
        for (place, cluster) in self.members(block).enumerate() {
            let spread = self.clusters.spreads[cluster];
            let least = &mut self.spreads[group][lane];
            *least = least.min(spread);
            self.lane_spreads[block][place] = ((spread * (1.0 - 1e-6)) as f32).next_down().max(0.0);
            drift = f64::max(drift, self.clusters.drift(cluster));
        }
        self.reaches.push(reach.sqrt());
        self.drifts.push(drift);
        let spreads = &self.lane_spreads[block][..self.members(block).len()];
        self.least_spreads
            .push(spreads.iter().copied().fold(f32::INFINITY, f32::min));
    }

    /// A block as the second and third sieve see it.
    fn block(&self, block: usize) -> simd::Block<'_> {
        let own = block * self.dim..(block + 1) * self.dim;
        simd::Block {
            middle: &self.middles[own.clone()],
            half: &self.halves[own.clone()],
            offsets: &self.offsets[own],
            spreads: &self.lane_spreads[block],
            spread: self.least_spreads[block],
        }
    }

    /// All pairs of the blocks' clusters whose squared distance is at most `limit`.
    ///
    /// Gives up when there are more than `crowd`. Takes O(m²) time at worst, by far most of
    /// it in the sieves; memory is that of the edges.
    pub fn pairs_within(
        &self,
        crew: &Crew<'_>,
        gauge: &Gauge<'_>,
        limit: f64,
        crowd: usize,
    ) -> Result<Graph, Error> {
        let sieve = Sieve::new(self, crew, gauge, limit);
        let count = self.reaches.len();
        let found = AtomicUsize::new(0);
        let edges = crew.each(
            (0..count.div_ceil(TILE)).map(|tile| tile * TILE..count.min((tile + 1) * TILE)),
            Hunt::default,
            |hunt, tile| {
                if found.load(Relaxed) > crowd {
                    return;
                }
                let before = hunt.edges.len();
                sieve.tile(tile, hunt);
                found.fetch_add(hunt.edges.len() - before, Relaxed);
            },
        )?;
        let mut edges = edges.into_iter().map(|hunt| hunt.edges);
        let mut all = edges.next().unwrap_or_default();
        for more in edges {
            all.extend_from_slice(&more);
        }
        if found.into_inner() > crowd {
            return Ok(Graph::Crowded(all));
        }
        Ok(Graph::Whole(all))
    }
}

/// What a thread finds, and its room to work in.
#[derive(Default)]
struct Hunt {
    edges: Vec<Edge>,
    scratch: Scratch,
    wide: Vec<Wide>,
}

/// The three sieves for one limit.
struct Sieve<'a> {
    blocks: &'a Blocks<'a>,
    crew: &'a Crew<'a>,
    gauge: &'a Gauge<'a>,
    limit: Limit,
    /// The limit, with what f32 may add to it.
    reach: f64,
    /// What f32 may add for each block, and the bounds of its clusters.
    slacks: Vec<f64>,
    rounding: f64,
    /// Corners of the box around each group of sixteen boxes.
    group_lows: Vec<f64>,
    group_highs: Vec<f64>,
    drift: f64,
}

impl<'a> Sieve<'a> {
    fn new(blocks: &'a Blocks<'a>, crew: &'a Crew<'a>, gauge: &'a Gauge<'a>, squared: f64) -> Self {
        let least = |lanes: &Wide| lanes.iter().copied().fold(f64::INFINITY, f64::min);
        let most = |lanes: &Wide| lanes.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let limit = Limit::of(squared);
        let slack =
            |(reach, drift): (&f64, &f64)| UNITS * reach + (1.0 + UNITS) * drift + VANISHING / 2.0;
        Self {
            blocks,
            crew,
            gauge,
            limit,
            reach: limit.root * (1.0 + UNITS),
            slacks: blocks
                .reaches
                .iter()
                .zip(&blocks.drifts)
                .map(slack)
                .collect(),
            rounding: simd::rounding(blocks.dim),
            group_lows: blocks.lows.iter().map(least).collect(),
            group_highs: blocks.highs.iter().map(most).collect(),
            drift: blocks.drifts.iter().copied().fold(0.0, f64::max),
        }
    }

    /// All edges from the blocks of a tile to themselves and to those after them.
    fn tile(&self, tile: Range<usize>, hunt: &mut Hunt) {
        let dim = self.blocks.dim;
        let corner = |block: usize, axis: usize| {
            let (row, lane) = (block / LANES * dim + axis, block % LANES);
            (self.blocks.lows[row][lane], self.blocks.highs[row][lane])
        };
        let boxes: Vec<(Vec<f64>, Vec<f64>)> = tile
            .clone()
            .map(|block| (0..dim).map(|axis| corner(block, axis)).unzip())
            .collect();
        let around: Vec<(f64, f64)> = (0..dim)
            .map(|axis| {
                boxes
                    .iter()
                    .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), (lows, highs)| {
                        (low.min(lows[axis]), high.max(highs[axis]))
                    })
            })
            .collect();
        let least = |block: usize| self.blocks.spreads[block / LANES][block % LANES];
        let limit = square(self.limit.root + 2.0 * self.drift) * (1.0 + 1e-9);

        let own = |block: usize| Query::new(self.blocks.block(block));
        let mut queries: Vec<Query<'_>> = tile.clone().map(own).collect();
        let mut near = [0_u16; TILE];
        for group in tile.start / LANES..self.blocks.spreads.len() {
            let corners = group * dim..(group + 1) * dim;
            let (lows, highs) =
                (&self.group_lows[corners.clone()], &self.group_highs[corners.clone()]);
            let gap = |((&(low, high), &other_low), &other_high): ((&(f64, f64), &f64), &f64)| {
                square((other_low - high).max(low - other_high).max(0.0))
            };
            if around.iter().zip(lows).zip(highs).map(gap).sum::<f64>() > limit {
                continue;
            }
            let (lows, highs) = (&self.blocks.lows[corners.clone()], &self.blocks.highs[corners]);
            let mut any = 0_u16;
            for ((near, block), (low, high)) in near.iter_mut().zip(tile.clone()).zip(&boxes) {
                let spreads = &self.blocks.spreads[group];
                *near = if group < block / LANES {
                    0
                } else {
                    simd::boxes_near(
                        self.crew.isa,
                        low,
                        high,
                        least(block),
                        lows,
                        highs,
                        spreads,
                        limit,
                    )
                };
                if group == block / LANES {
                    *near &= u16::MAX << (block % LANES);
                }
                any |= *near;
            }
            while any != 0 {
                let lane = any.trailing_zeros() as usize;
                any &= any - 1;
                let which =
                    (near.iter().rev()).fold(0, |bits, near| bits << 1 | (near >> lane & 1));
                self.sift(tile.start, which, group * LANES + lane, &mut queries, hunt);
            }
        }
    }

    /// All edges from some blocks of a tile, one for each bit of `which`, to later clusters of
    /// block `j`: the second and third sieve.
    fn sift(&self, tile: usize, which: u16, j: usize, queries: &mut [Query<'_>], hunt: &mut Hunt) {
        let mut finely = 0;
        for (k, query) in queries.iter_mut().enumerate() {
            let slack = self.slacks[tile + k] + self.slacks[j];
            finely |= u16::from(slack > FINE * self.limit.root) << k;
            // The rounding of this to f32 is a part of the last factor.
            query.limit = (square(self.reach + slack) * (1.0 + 3.0 * self.rounding)) as f32;
        }
        simd::blocks_near(self.crew.isa, queries, which & !finely, &self.blocks.block(j));
        let mut left = which;
        while left != 0 {
            let k = left.trailing_zeros() as usize;
            left &= left - 1;
            if finely >> k & 1 != 0 {
                self.sift_finely(tile + k, j, &mut queries[k], hunt);
            }
            if queries[k].rows != 0 {
                self.measure(tile + k, j, &queries[k], hunt);
            }
        }
    }

    /// The edges among the pairs that are left of blocks `i` and `j`.
    fn measure(&self, i: usize, j: usize, query: &Query<'_>, hunt: &mut Hunt) {
        let (first, second) = (self.blocks.members(i), self.blocks.members(j));
        let mut rows = query.rows & (u16::MAX >> (LANES - first.len()));
        let lanes = u16::MAX >> (LANES - second.len());
        while rows != 0 {
            let row = rows.trailing_zeros() as usize;
            rows &= rows - 1;
            // Within a block, each pair once.
            let later = if i == j { (u16::MAX << row) << 1 } else { u16::MAX };
            let mut near = query.found[row] & lanes & later;
            while near != 0 {
                let (a, b) = (first.start + row, second.start + near.trailing_zeros() as usize);
                near &= near - 1;
                if let Some(squared) = self.gauge.within(a, b, self.limit, &mut hunt.scratch) {
                    hunt.edges.push(Edge { a: a as u32, b: b as u32, squared });
                }
            }
        }
    }

    /// The second and third sieve in f64, for blocks too large for f32.
    fn sift_finely(&self, i: usize, j: usize, query: &mut Query<'_>, hunt: &mut Hunt) {
        let clusters = self.blocks.clusters;
        let limit = self.limit.root + self.blocks.drifts[i] + self.blocks.drifts[j];
        let limit = square(limit) * (1.0 + 1e-9);
        let (first, second) = (self.blocks.members(i), self.blocks.members(j));
        let is_near = |block: usize, cluster: usize| self.is_near_box(cluster, block, limit);
        query.rows = (first.clone().enumerate())
            .fold(0, |rows, (row, cluster)| rows | u16::from(is_near(j, cluster)) << row);
        if query.rows == 0 || !second.clone().any(|cluster| is_near(i, cluster)) {
            query.rows = 0;
            return;
        }
        let mut spreads = Aligned([f64::INFINITY; LANES]);
        transpose(clusters, second, &mut hunt.wide, &mut spreads);
        for (row, cluster) in first
            .enumerate()
            .filter(|(row, _)| query.rows >> row & 1 != 0)
        {
            let (centre, spread) = (clusters.centre(cluster), clusters.spreads[cluster]);
            let bounds = simd::bounds(self.crew.isa, centre, spread, &hunt.wide, &spreads);
            let bit = |(lane, &bound): (usize, &f64)| u16::from(bound <= limit) << lane;
            query.found[row] = bounds
                .iter()
                .enumerate()
                .map(bit)
                .fold(0, |bits, bit| bits | bit);
        }
    }

    /// Whether a cluster may be within a squared limit of one of a block.
    fn is_near_box(&self, cluster: usize, block: usize, limit: f64) -> bool {
        let (group, lane) = (block / LANES, block % LANES);
        let corners = group * self.blocks.dim..(group + 1) * self.blocks.dim;
        let (lows, highs) = (&self.blocks.lows[corners.clone()], &self.blocks.highs[corners]);
        let mut sum = self.blocks.clusters.spreads[cluster] + self.blocks.spreads[group][lane];
        for (&x, (low, high)) in self
            .blocks
            .clusters
            .centre(cluster)
            .iter()
            .zip(lows.iter().zip(highs))
        {
            sum += square((low[lane] - x).max(x - high[lane]).max(0.0));
            if sum > limit {
                return false;
            }
        }
        true
    }
}

/// The centres of up to sixteen clusters side by side; their spreads, infinite where none is.
pub(crate) fn transpose(
    clusters: &Clusters,
    range: Range<usize>,
    centres: &mut Vec<Wide>,
    spreads: &mut Wide,
) {
    *spreads = Aligned([f64::INFINITY; LANES]);
    centres.clear();
    centres.resize(clusters.centre(range.start).len(), Aligned([0.0; LANES]));
    for (lane, cluster) in range.enumerate() {
        spreads[lane] = clusters.spreads[cluster];
        for (lanes, &x) in centres.iter_mut().zip(clusters.centre(cluster)) {
            lanes[lane] = x;
        }
    }
}

fn square(x: f64) -> f64 {
    x * x
}
