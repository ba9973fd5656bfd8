//! Merging on the full matrix, at the speed of reading memory.
//!
//! Complete linkage takes the larger of two distances, independently in every row. So a row may
//! postpone any number of merges until it is needed: for each it then raises the column of the
//! remaining cluster to that of the merged one. No column is written across rows, all reads are
//! consecutive, and rows are shared out among threads.
//!
//! In each *round* all pairs merge that are each other's nearest; there are about fifty rounds, and
//! a row is read in four or five of them. A cluster whose nearest has merged at an unchanged
//! distance keeps it: no other cluster comes nearer, and the union has a lower representative.
//! Some matrices have few such pairs in each round, for example if most distances are equal. Then a
//! nearest-neighbour *chain* makes the remaining merges; it reads at most three rows per merge.

use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};

use crate::error::Error;
use crate::parallel::Workers;
use crate::simd;
use mograft_machine::memory::{allocate, append, collect, push, with_capacity};

/// Marks a missing column.
const NONE: u32 = u32::MAX;

/// Smallest matrix whose rows and columns are removed, once a quarter of its clusters has merged.
const MIN_COMPACTED_SIZE: usize = 64;

/// Fewest distances that one job handles.
const DISTANCES_PER_JOB: usize = 1 << 14;

/// Most distances that one job handles, if it handles more than one row.
const MAX_DISTANCES_PER_JOB: usize = 1 << 20;

/// Rows read per merge, on average, above which rounds end and the chain begins.
const MAX_ROWS_PER_MERGE: usize = 8;

/// Work of a round in addition to that on rows, as a count of rows.
const ROWS_PER_ROUND: usize = 4;

/// Rows that take as much time as one if they need not be read.
const UPDATES_PER_ROW: usize = 16;

/// The distances of a cluster to all others.
struct Row {
    /// By column; infinity for the cluster itself, merged clusters and pairs that may not merge.
    distances: Vec<f64>,
    /// Count of merges of the log that the row has applied.
    n_applied: usize,
    /// Column and distance of the nearest cluster.
    nearest: (u32, f64),
}

impl Row {
    fn new(distances: Vec<f64>) -> Self {
        Self { distances, n_applied: 0, nearest: (NONE, f64::INFINITY) }
    }

    /// Apply the merges of the log that the row has postponed.
    fn apply(&mut self, log: &[(u32, u32)]) {
        for &(kept, removed) in &log[self.n_applied..] {
            let distance = self.distances[removed as usize];
            let kept_distance = &mut self.distances[kept as usize];
            *kept_distance = if distance > *kept_distance { distance } else { *kept_distance };
            self.distances[removed as usize] = f64::INFINITY;
            if self.nearest.0 == removed {
                self.nearest.0 = kept;
            }
        }
        self.n_applied = log.len();
    }

    /// Apply the log; find the nearest cluster, unless its distance is unchanged.
    ///
    /// Returns whether the row was searched.
    fn update(&mut self, workers: &Workers<'_>, log: &[(u32, u32)]) -> bool {
        self.apply(log);
        let (column, distance) = self.nearest;
        let is_same = column != NONE && self.distances[column as usize] == distance;
        if !is_same {
            self.find_nearest(workers);
        }
        !is_same
    }

    /// Become the row of the union with the cluster of another row, which is emptied.
    fn unite(&mut self, workers: &Workers<'_>, removed: &mut Self, log: &[(u32, u32)]) {
        self.apply(log);
        removed.apply(log);
        simd::maximize(workers.isa, &mut self.distances, &removed.distances);
        removed.distances = Vec::new();
    }

    /// Find the nearest cluster; of equal distances the first.
    fn find_nearest(&mut self, workers: &Workers<'_>) {
        let smallest = simd::minimum(workers.isa, &self.distances);
        let column = simd::first_position(workers.isa, &self.distances, smallest);
        self.nearest = match column {
            Some(column) if smallest < f64::INFINITY => (column as u32, smallest),
            _ => (NONE, f64::INFINITY),
        };
    }
}

/// Merge all pairs at a finite distance, given one row of distances per cluster.
///
/// Rows are as long as there are rows, infinite on the diagonal, and not NaN. Clusters must be
/// sorted by representative: of equal distances in a row the first is nearest. Returns pairs of
/// rows with their distances; every pair stands behind those of its parts, and the smaller row,
/// which the union keeps, is first. Takes O(m²) memory and time for m clusters.
///
/// # Errors
///
/// [`Error::OutOfMemory`], and [`Error::Stopped`] if the progress callback requests a stop.
pub(crate) fn merge_on_matrix(
    workers: &Workers<'_>,
    rows: Vec<Vec<f64>>,
) -> Result<Vec<(u32, u32, f64)>, Error> {
    let total = rows.len().max(1) as f64;
    let mut matrix = Matrix::new(rows)?;
    let mut pairs = Vec::new();
    let mut n_rows_read = 0;
    while n_rows_read <= MAX_ROWS_PER_MERGE * (pairs.len() + total as usize) {
        n_rows_read += ROWS_PER_ROUND + matrix.update_nearest(workers)?;
        let merged = matrix.reciprocal_pairs()?;
        if merged.is_empty() {
            return Ok(pairs);
        }
        matrix.merge_pairs(workers, &merged)?;
        let numbers = &matrix.numbers;
        let numbered = merged
            .into_iter()
            .map(|(a, b, distance)| (numbers[a], numbers[b], distance));
        append(&mut pairs, numbered)?;
        workers.set_fraction(pairs.len() as f64 / total);
        if matrix.is_sparse() {
            matrix.compact(workers)?;
        }
    }
    merge_by_chain(workers, &mut matrix, &mut pairs)?;
    Ok(pairs)
}

/// Make the remaining merges by the nearest-neighbour chain (see [`chain`](crate::chain)).
fn merge_by_chain(
    workers: &Workers<'_>,
    matrix: &mut Matrix,
    pairs: &mut Vec<(u32, u32, f64)>,
) -> Result<(), Error> {
    let total = (matrix.rows.len() + pairs.len()).max(1) as f64;
    let mut chain: Vec<usize> = Vec::new();
    let mut first_active = 0;
    let mut n_merges_left = 0;
    loop {
        workers.check_progress()?;
        if chain.is_empty() {
            let is_active = &matrix.is_active[first_active..];
            let Some(skipped) = is_active.iter().position(|&is_active| is_active) else {
                return Ok(());
            };
            first_active += skipped;
            chain.push(first_active);
        }
        let tip = chain[chain.len() - 1];
        let row = &mut matrix.rows[tip];
        row.apply(&matrix.log);
        row.find_nearest(workers);
        let (column, distance) = row.nearest;
        if column == NONE {
            // Only a chain of one cluster can end here: the others have a finite distance.
            matrix.is_active[tip] = false;
            chain.clear();
            continue;
        }
        let neighbour = column as usize;
        if chain.len() < 2 || chain[chain.len() - 2] != neighbour {
            chain.push(neighbour);
            continue;
        }
        chain.truncate(chain.len() - 2);
        let (kept, removed) = (tip.min(neighbour), tip.max(neighbour));
        push(pairs, (matrix.numbers[kept], matrix.numbers[removed], distance))?;
        matrix.merge_pair(workers, kept, removed);
        workers.set_fraction(pairs.len() as f64 / total);
        if n_merges_left == 0 {
            let new_positions = matrix.compact(workers)?;
            for row in &mut chain {
                *row = new_positions[*row] as usize;
            }
            (first_active, n_merges_left) = (0, matrix.rows.len() / 4 + 1);
        }
        n_merges_left -= 1;
    }
}

/// The matrix of the clusters that remain, and the merges that its rows have postponed.
struct Matrix {
    rows: Vec<Row>,
    /// For each row, its index in the matrix given.
    numbers: Vec<u32>,
    /// Which rows may still merge.
    is_active: Vec<bool>,
    /// Which rows must find their nearest cluster again.
    is_outdated: Vec<bool>,
    /// Merges as (remaining column, removed column).
    log: Vec<(u32, u32)>,
}

impl Matrix {
    fn new(rows: Vec<Vec<f64>>) -> Result<Self, Error> {
        let n = rows.len();
        Ok(Self {
            rows: collect(rows.into_iter().map(Row::new))?,
            numbers: collect(0..n as u32)?,
            is_active: allocate(true, n)?,
            is_outdated: allocate(true, n)?,
            log: with_capacity(n)?,
        })
    }

    /// Find the nearest cluster of the outdated rows; return the work as a count of rows read.
    fn update_nearest(&mut self, workers: &Workers<'_>) -> Result<usize, Error> {
        let (width, log) = (self.rows.len(), &self.log);
        let rows = self.rows.iter_mut().zip(&self.is_outdated);
        let mut outdated: Vec<&mut Row> = with_capacity(width)?;
        outdated.extend(
            rows.filter(|(_, is_outdated)| **is_outdated)
                .map(|(row, _)| row),
        );
        let n_updated = outdated.len();
        let n_read = AtomicUsize::new(0);
        for_each_row(workers, width, outdated, |row| {
            n_read.fetch_add(usize::from(row.update(workers, log)), Relaxed);
        })?;
        Ok(n_read.into_inner() + n_updated / UPDATES_PER_ROW)
    }

    /// Whether a quarter of the rows is inactive.
    fn is_sparse(&self) -> bool {
        let n_active = (self.is_active.iter())
            .filter(|is_active| **is_active)
            .count();
        n_active * 4 <= self.rows.len() * 3 && self.rows.len() > MIN_COMPACTED_SIZE
    }

    /// Pairs of rows that are each other's nearest, the smaller first, in order.
    fn reciprocal_pairs(&self) -> Result<Vec<(usize, usize, f64)>, Error> {
        let mut pairs = with_capacity(self.rows.len() / 2)?;
        for (i, row) in self
            .rows
            .iter()
            .enumerate()
            .filter(|&(i, _)| self.is_active[i])
        {
            let (other, distance) = row.nearest;
            if other == NONE || i >= other as usize {
                continue;
            }
            if self.rows[other as usize].nearest.0 as usize == i {
                pairs.push((i, other as usize, distance));
            }
        }
        Ok(pairs)
    }

    /// Merge pairs of rows; update which rows are active and outdated.
    fn merge_pairs(
        &mut self,
        workers: &Workers<'_>,
        merged: &[(usize, usize, f64)],
    ) -> Result<(), Error> {
        let (width, log) = (self.rows.len(), &self.log);
        let mut removed_rows: Vec<Row> = with_capacity(merged.len())?;
        let mut is_kept = allocate(false, width)?;
        for &(kept, removed, _) in merged {
            let empty = Row::new(Vec::new());
            removed_rows.push(std::mem::replace(&mut self.rows[removed], empty));
            is_kept[kept] = true;
        }
        let rows = self.rows.iter_mut().zip(&is_kept);
        let kept_rows = rows.filter(|(_, is_kept)| **is_kept).map(|(row, _)| row);
        let mut unions = with_capacity(merged.len())?;
        unions.extend(kept_rows.zip(removed_rows));
        for_each_row(workers, width, unions, |(row, removed)| {
            row.unite(workers, removed, log);
        })?;
        let mut has_merged = is_kept;
        for &(kept, removed, _) in merged {
            self.is_active[removed] = false;
            has_merged[removed] = true;
            self.log.push((kept as u32, removed as u32));
        }
        // A row without a nearest cluster never gets one.
        for (i, row) in self.rows.iter_mut().enumerate() {
            let nearest = row.nearest.0;
            self.is_active[i] &= nearest != NONE;
            self.is_outdated[i] =
                self.is_active[i] && (has_merged[i] || has_merged[nearest as usize]);
            if has_merged[i] {
                // Equal to no distance.
                row.nearest.1 = f64::NAN;
            }
        }
        Ok(())
    }

    /// Merge two rows, of which `kept` is the smaller. Leaves `is_outdated` as it is.
    fn merge_pair(&mut self, workers: &Workers<'_>, kept: usize, removed: usize) {
        let mut removed_row = std::mem::replace(&mut self.rows[removed], Row::new(Vec::new()));
        self.rows[kept].unite(workers, &mut removed_row, &self.log);
        self.is_active[removed] = false;
        self.log.push((kept as u32, removed as u32));
    }

    /// Remove the rows and columns of inactive clusters, and clear the log.
    ///
    /// Returns the new index of each row.
    fn compact(&mut self, workers: &Workers<'_>) -> Result<Vec<u32>, Error> {
        let (is_active, log) = (&self.is_active, &self.log);
        let width = self.rows.len();
        let mut columns: Vec<u32> = collect(0..width as u32)?;
        columns.retain(|&column| is_active[column as usize]);
        let mut new_columns = allocate(NONE, width)?;
        for (new, &old) in columns.iter().enumerate() {
            new_columns[old as usize] = new as u32;
        }
        let mut i = 0;
        self.rows.retain(|_| {
            i += 1;
            is_active[i - 1]
        });
        for_each_row(workers, width, collect(self.rows.iter_mut())?, |row| {
            row.apply(log);
            for (new, &old) in columns.iter().enumerate() {
                row.distances[new] = row.distances[old as usize];
            }
            row.distances.truncate(columns.len());
            row.n_applied = 0;
            if row.nearest.0 != NONE {
                row.nearest.0 = new_columns[row.nearest.0 as usize];
            }
        })?;
        self.log.clear();
        retain_selected(&mut self.numbers, &self.is_active);
        retain_selected(&mut self.is_outdated, &self.is_active);
        self.is_active.retain(|&is_active| is_active);
        Ok(new_columns)
    }
}

/// Run `work` for each row, `width` long, on several threads if there is enough work.
fn for_each_row<T: Send>(
    workers: &Workers<'_>,
    width: usize,
    mut rows: Vec<T>,
    work: impl Fn(&mut T) + Sync,
) -> Result<(), Error> {
    let rows_per_job = rows
        .len()
        .div_ceil(8 * workers.n_threads())
        .min(MAX_DISTANCES_PER_JOB / width.max(1))
        .max(DISTANCES_PER_JOB.div_ceil(width.max(1)));
    workers.run(
        rows.chunks_mut(rows_per_job),
        || (),
        |(), rows| rows.iter_mut().for_each(&work),
    )?;
    Ok(())
}

fn retain_selected<T>(values: &mut Vec<T>, is_selected: &[bool]) {
    let mut is_selected = is_selected.iter();
    values.retain(|_| is_selected.next().is_some_and(|&is_selected| is_selected));
}
