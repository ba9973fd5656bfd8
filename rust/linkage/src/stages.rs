//! The stages of exact complete linkage in linear memory.
//!
//! See the crate's essay for why this is right; here is only what is done in which order.

use crate::clusters::Clusters;
use crate::distance::{Gauge, Limit, Scratch};
use crate::graph::{Blocks, Edge, Graph, transpose};
use crate::parallel::Crew;
use crate::points::Points;
use crate::simd::{self, Aligned, LANES};
use crate::tree::Merge;
use crate::{Error, Tuning, dense, limit, merging, order, plateau};

/// A stage that merges no more than this part of the clusters looks for more next time.
const POOR: usize = 8;

/// The most neighbours that a stage looks for where it gets few of them.
const MOST_NEIGHBOURS: f64 = 256.0;

/// The most where it gets what it looks for, and yet they merge little: all is crowded in one
/// place, and elsewhere there is nothing within the limit.
const MANY_NEIGHBOURS: f64 = 12.0;

/// Where space is uneven, the part of the neighbours that is looked for. All are those of a few
/// clusters packed together, each of which has very many.
const CROWDED: f64 = 0.25;

/// Fewer edges than this part of those looked for are few.
const THIN: f64 = 0.125;

/// Edges that a stage may have for each neighbour wanted, before it is content with less.
const CROWD: f64 = 4.0;

/// All merges of different points no higher than a squared distance, parts before unions.
pub(crate) fn merges(
    crew: &Crew<'_>,
    points: &Points,
    most: f64,
    tuning: &Tuning,
) -> Result<Vec<Merge>, Error> {
    let n = points.len();
    let mut merges = Vec::with_capacity(n);
    let mut clusters = Clusters::singles(points);
    let mut degree = tuning.degree;
    while clusters.len() > tuning.finish.max(1) {
        let m = clusters.len();
        let by_gap;
        (clusters, by_gap) = order::in_spatial_order(crew, &clusters)?;
        let gauge = Gauge::new(crew, points, &clusters)?;
        let wanted = if by_gap.is_some() { CROWDED * degree } else { degree };
        let limit = limit::choose(crew, &clusters, &gauge, wanted, by_gap.as_deref())?.min(most);
        let near = near_ones(crew, &clusters, &gauge, limit, degree, tuning.crowd)?;
        let (merged, limit, is_thin) = match near {
            Near::Edges(edges, limit) => {
                drop(gauge);
                let is_thin = (edges.len() as f64) < THIN * wanted * m as f64;
                (merging::merge(crew, &clusters.reps, edges)?, limit, is_thin)
            }
            Near::Plateau(level) => (plateau::merge(crew, &clusters, &gauge, level)?, level, false),
        };
        merges.extend(merged.pairs.iter().map(|&(a, b, squared)| {
            Merge::new(clusters.reps[a as usize], clusters.reps[b as usize], squared)
        }));
        crew.report(merges.len() as f64 / n as f64);
        if limit >= most {
            return Ok(merges);
        }
        debug_assert!(!merged.pairs.is_empty(), "the limit is no less than some pair's distance");
        if merged.pairs.len() * POOR < m {
            let most = if is_thin { MOST_NEIGHBOURS } else { MANY_NEIGHBOURS };
            degree = (degree * 1.5).min(most).max(degree);
        }
        clusters = clusters.united(crew, points, &merged.roots)?;
    }
    finish(crew, points, &clusters, most, &mut merges)?;
    Ok(merges)
}

/// What a stage finds.
enum Near {
    /// All pairs within a squared distance.
    Edges(Vec<Edge>, f64),
    /// The least squared distance; too many pairs have it.
    Plateau(f64),
}

/// All edges within a limit, or within a smaller one if they are too many.
fn near_ones(
    crew: &Crew<'_>,
    clusters: &Clusters,
    gauge: &Gauge<'_>,
    mut limit: f64,
    degree: f64,
    spare: usize,
) -> Result<Near, Error> {
    let blocks = Blocks::new(clusters);
    let crowd = (CROWD * degree * clusters.len() as f64) as usize + spare;
    let mut level = None;
    loop {
        let edges = match blocks.pairs_within(crew, gauge, limit, crowd)? {
            Graph::Whole(edges) => {
                let nothing_below = level.filter(|_| edges.is_empty());
                return Ok(nothing_below.map_or(Near::Edges(edges, limit), Near::Plateau));
            }
            Graph::Crowded(edges) => edges,
        };
        let mut squares: Vec<f64> = edges.iter().map(|edge| edge.squared).collect();
        drop(edges);
        let quarter = squares.len() / 4;
        let (nearer, &mut quarter, _) = squares.select_nth_unstable_by(quarter, f64::total_cmp);
        let less = nearer.iter().copied().filter(|&squared| squared < limit);
        if quarter < limit {
            limit = quarter;
        } else if let Some(less) = less.reduce(f64::max) {
            limit = less;
        } else {
            // All that were found are equally far. Is anything nearer?
            level = Some(limit);
            limit = limit.next_down();
        }
    }
}

/// Merge what is left on the full matrix.
fn finish(
    crew: &Crew<'_>,
    points: &Points,
    clusters: &Clusters,
    most: f64,
    merges: &mut Vec<Merge>,
) -> Result<(), Error> {
    let mut order: Vec<u32> = (0..clusters.len() as u32).collect();
    order.sort_unstable_by_key(|&cluster| clusters.reps[cluster as usize]);
    let clusters = clusters.rearranged(&order);
    let rows = if clusters.len() == points.len() {
        rows_of_points(crew, &clusters, most)?
    } else {
        rows_of_clusters(crew, points, &clusters, most)?
    };
    for (a, b, squared) in dense::merge(crew, rows)? {
        let [a, b] = [a, b].map(|cluster| clusters.reps[cluster as usize]);
        merges.push(Merge::new(a, b, squared));
    }
    Ok(())
}

/// The matrix of squared distances of single points; infinity for those beyond the limit.
fn rows_of_points(crew: &Crew<'_>, clusters: &Clusters, most: f64) -> Result<Vec<Vec<f64>>, Error> {
    let m = clusters.len();
    let (mut columns, mut block, mut none) = (Vec::new(), Vec::new(), Aligned([0.0; LANES]));
    for first in (0..m).step_by(LANES) {
        transpose(clusters, first..m.min(first + LANES), &mut block, &mut none);
        columns.extend_from_slice(&block);
    }
    let mut rows = vec![Vec::new(); m];
    crew.each(
        rows.chunks_mut(LANES).enumerate(),
        || (),
        |(), (band, rows)| {
            for (i, row) in rows.iter_mut().enumerate() {
                let own = band * LANES + i;
                let centre = clusters.centre(own);
                row.reserve_exact(m.next_multiple_of(LANES));
                for block in columns.chunks_exact(centre.len()) {
                    let squares =
                        simd::bounds(crew.isa, centre, 0.0, block, &Aligned([0.0; LANES]));
                    row.extend(squares.map(
                        |squared| {
                            if squared <= most { squared } else { f64::INFINITY }
                        },
                    ));
                }
                row.truncate(m);
                row[own] = f64::INFINITY;
            }
        },
    )?;
    Ok(rows)
}

/// The matrix of squared distances of clusters; infinity for those beyond the limit.
fn rows_of_clusters(
    crew: &Crew<'_>,
    points: &Points,
    clusters: &Clusters,
    most: f64,
) -> Result<Vec<Vec<f64>>, Error> {
    let gauge = Gauge::new(crew, points, clusters)?;
    let m = clusters.len();
    let mut rows = vec![vec![f64::INFINITY; m]; m];
    crew.each(rows.iter_mut().enumerate(), Scratch::default, |scratch, (a, row)| {
        for (b, squared) in row.iter_mut().enumerate().skip(a + 1) {
            *squared = gauge
                .within(a, b, Limit::of(most), scratch)
                .unwrap_or(f64::INFINITY);
        }
    })?;
    for a in 0..m {
        let (before, own) = rows.split_at_mut(a);
        for (row, squared) in before.iter().zip(&mut own[0]) {
            *squared = row[a];
        }
    }
    Ok(rows)
}
