//! Merging on the full matrix, at the speed of reading memory.
//!
//! Complete linkage takes the larger of two distances, independently in every row. So a row may
//! postpone any number of merges until it is needed: for each it then raises the column of the
//! remaining cluster to that of the merged one. No column is written across rows, all reads are
//! consecutive, and rows are shared out among threads. In each round all pairs merge that are each
//! other's nearest; there are about fifty rounds, and a row is read in four or five of them.

use crate::error::Error;
use crate::parallel::Workers;
use crate::simd;

/// Marks a missing column.
const NONE: u32 = u32::MAX;

/// Smallest matrix whose rows and columns are removed, once a quarter of its clusters has merged.
const MIN_COMPACTED_SIZE: usize = 64;

/// Fewest distances that one job handles.
const DISTANCES_PER_JOB: usize = 1 << 14;

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
            let kept = &mut self.distances[kept as usize];
            *kept = if distance > *kept { distance } else { *kept };
            self.distances[removed as usize] = f64::INFINITY;
        }
        self.n_applied = log.len();
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
/// which the union keeps, is first. Takes O(m²) memory and little more than O(m²) time for m
/// clusters.
///
/// # Errors
///
/// [`Error::Stopped`] if the progress callback requests a stop.
pub(crate) fn merge_on_matrix(
    workers: &Workers<'_>,
    rows: Vec<Vec<f64>>,
) -> Result<Vec<(u32, u32, f64)>, Error> {
    let total = rows.len().max(1) as f64;
    let mut matrix = Matrix::new(rows);
    let mut pairs = Vec::new();
    loop {
        matrix.update_nearest(workers)?;
        let merged = matrix.reciprocal_pairs();
        if merged.is_empty() {
            return Ok(pairs);
        }
        matrix.merge_rows(workers, &merged)?;
        for &(kept, removed, distance) in &merged {
            pairs.push((matrix.numbers[kept], matrix.numbers[removed], distance));
        }
        workers.set_fraction(pairs.len() as f64 / total);
        let n_active = matrix
            .is_active
            .iter()
            .filter(|is_active| **is_active)
            .count();
        if n_active * 4 <= matrix.rows.len() * 3 && matrix.rows.len() > MIN_COMPACTED_SIZE {
            matrix.compact(workers)?;
        }
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
    fn new(rows: Vec<Vec<f64>>) -> Self {
        let n = rows.len();
        Self {
            rows: rows.into_iter().map(Row::new).collect(),
            numbers: (0..n as u32).collect(),
            is_active: vec![true; n],
            is_outdated: vec![true; n],
            log: Vec::new(),
        }
    }

    /// Find the nearest cluster of the outdated rows.
    fn update_nearest(&mut self, workers: &Workers<'_>) -> Result<(), Error> {
        let (width, log) = (self.rows.len(), &self.log);
        let rows = self.rows.iter_mut().zip(&self.is_outdated);
        let outdated = rows
            .filter(|(_, is_outdated)| **is_outdated)
            .map(|(row, _)| row);
        for_each_row(workers, width, outdated.collect(), |row| {
            row.apply(log);
            row.find_nearest(workers);
        })
    }

    /// Pairs of rows that are each other's nearest, the smaller first, in order.
    fn reciprocal_pairs(&self) -> Vec<(usize, usize, f64)> {
        let mut pairs = Vec::new();
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
        pairs
    }

    /// Merge pairs of rows; update which rows are active and outdated.
    fn merge_rows(
        &mut self,
        workers: &Workers<'_>,
        merged: &[(usize, usize, f64)],
    ) -> Result<(), Error> {
        let (width, log) = (self.rows.len(), &self.log);
        let mut removed_rows: Vec<Row> = Vec::with_capacity(merged.len());
        let mut is_kept = vec![false; width];
        for &(kept, removed, _) in merged {
            let empty = Row::new(Vec::new());
            removed_rows.push(std::mem::replace(&mut self.rows[removed], empty));
            is_kept[kept] = true;
        }
        let rows = self.rows.iter_mut().zip(&is_kept);
        let kept_rows = rows.filter(|(_, is_kept)| **is_kept).map(|(row, _)| row);
        let unions: Vec<_> = kept_rows.zip(removed_rows).collect();
        for_each_row(workers, width, unions, |(row, removed)| {
            row.apply(log);
            removed.apply(log);
            simd::maximize(workers.isa, &mut row.distances, &removed.distances);
            removed.distances = Vec::new();
        })?;
        let mut has_merged = is_kept;
        for &(kept, removed, _) in merged {
            self.is_active[removed] = false;
            has_merged[removed] = true;
            self.log.push((kept as u32, removed as u32));
        }
        // A row without a nearest cluster never gets one.
        for i in 0..width {
            let nearest = self.rows[i].nearest.0;
            self.is_active[i] &= nearest != NONE;
            self.is_outdated[i] =
                self.is_active[i] && (has_merged[i] || has_merged[nearest as usize]);
        }
        Ok(())
    }

    /// Remove the rows and columns of inactive clusters, and clear the log.
    fn compact(&mut self, workers: &Workers<'_>) -> Result<(), Error> {
        let (is_active, log) = (&self.is_active, &self.log);
        let width = self.rows.len();
        let columns: Vec<u32> = (0..width as u32)
            .filter(|&column| is_active[column as usize])
            .collect();
        let mut new_columns = vec![NONE; width];
        for (new, &old) in columns.iter().enumerate() {
            new_columns[old as usize] = new as u32;
        }
        let mut i = 0;
        self.rows.retain(|_| {
            i += 1;
            is_active[i - 1]
        });
        for_each_row(workers, width, self.rows.iter_mut().collect(), |row| {
            row.apply(log);
            for (new, &old) in columns.iter().enumerate() {
                row.distances[new] = row.distances[old as usize];
            }
            row.distances.truncate(columns.len());
            row.n_applied = 0;
            // If the nearest cluster was removed, the row is outdated and this is not read.
            row.nearest.0 = new_columns[row.nearest.0 as usize];
        })?;
        self.log.clear();
        self.numbers = select(&self.numbers, &self.is_active);
        self.is_outdated = select(&self.is_outdated, &self.is_active);
        self.is_active = vec![true; columns.len()];
        Ok(())
    }
}

/// Rows that are read together from a condensed matrix: the f64 of a cache line.
const ROWS_PER_BAND: usize = 8;

/// The full matrix, infinite on the diagonal, of a condensed one of `n` clusters.
///
/// # Errors
///
/// [`Error::Stopped`] if the progress callback requests a stop.
pub(crate) fn rows_of_condensed(
    workers: &Workers<'_>,
    n: usize,
    distances: &[f64],
) -> Result<Vec<Vec<f64>>, Error> {
    // Row a of the upper triangle, from column a + 1 on.
    let upper = |a: usize| &distances[a * (2 * n - a - 1) / 2..][..n - a - 1];
    let mut rows: Vec<Vec<f64>> = vec![Vec::new(); n];
    workers.run(
        rows.chunks_mut(ROWS_PER_BAND).enumerate(),
        || (),
        |(), (band, rows)| {
            let first = band * ROWS_PER_BAND;
            for row in &mut *rows {
                *row = vec![f64::INFINITY; n];
            }
            for b in 0..(first + rows.len()).min(n) {
                // Elements below the diagonal are those of a column of the upper triangle. The
                // sum turns -0 into 0.
                for (i, row) in rows.iter_mut().enumerate().filter(|&(i, _)| b < first + i) {
                    row[b] = upper(b)[first + i - b - 1] + 0.0;
                }
            }
            for (i, row) in rows.iter_mut().enumerate() {
                let a = first + i;
                for (element, distance) in row[a + 1..].iter_mut().zip(upper(a)) {
                    *element = distance + 0.0;
                }
            }
        },
    )?;
    Ok(rows)
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
        .max(DISTANCES_PER_JOB.div_ceil(width.max(1)));
    workers.run(
        rows.chunks_mut(rows_per_job),
        || (),
        |(), rows| rows.iter_mut().for_each(&work),
    )?;
    Ok(())
}

fn select<T: Copy>(values: &[T], is_selected: &[bool]) -> Vec<T> {
    values
        .iter()
        .zip(is_selected)
        .filter(|(_, is_selected)| **is_selected)
        .map(|(&value, _)| value)
        .collect()
}
