//! Merging on the full matrix, at the speed at which memory is read.
//!
//! Complete linkage takes the larger of two distances, and does so in every row on its own: a
//! row can catch up with any number of merges when it is next looked at, by raising the column
//! of the one part to that of the other. So no column is ever written across rows, all that is
//! read is consecutive, and rows can be shared out among threads. All pairs that are nearest
//! to each other merge in one round; on the way down to one cluster there are some fifty
//! rounds, in which a row is looked at four or five times.

use crate::Error;
use crate::parallel::Crew;
use crate::simd;

/// No column.
const NONE: u32 = u32::MAX;

/// Columns are moved together when so many are left, in parts of four, and no fewer than this.
const COMPACT_FROM: usize = 64;

/// Fewer distances than this are not worth a thread.
const SHARE: usize = 1 << 14;

/// A cluster's distances to all others.
struct Row {
    /// By column; infinity where no merge is wanted, or possible.
    distances: Vec<f64>,
    /// How many entries of the log it has caught up with.
    caught_up: usize,
    /// The nearest, by column, and how far it is.
    nearest: (u32, f64),
}

impl Row {
    /// Take part in the merges that it has missed.
    fn catch_up(&mut self, log: &[(u32, u32)]) {
        for &(kept, gone) in &log[self.caught_up..] {
            let distance = self.distances[gone as usize];
            let own = &mut self.distances[kept as usize];
            *own = if distance > *own { distance } else { *own };
            self.distances[gone as usize] = f64::INFINITY;
        }
        self.caught_up = log.len();
    }
}

/// Merge whatever is at a finite distance, given a row of distances for each cluster.
///
/// Rows are as long as they are many and infinite on the diagonal. Clusters must be sorted by
/// representative: of equal distances the first in the row is nearest. Returns rows and
/// distances, parts before unions, the smaller row, which stays, first. Takes O(m²) memory and
/// little more than that time.
pub(crate) fn merge(crew: &Crew<'_>, rows: Vec<Vec<f64>>) -> Result<Vec<(u32, u32, f64)>, Error> {
    let total = rows.len().max(1) as f64;
    let start = |distances| Row { distances, caught_up: 0, nearest: (NONE, f64::INFINITY) };
    let mut rows: Vec<Row> = rows.into_iter().map(start).collect();
    // Rows move when columns do; their first numbers are those to be told.
    let mut numbers: Vec<u32> = (0..rows.len() as u32).collect();
    let mut is_left = vec![true; rows.len()];
    let mut must_look = vec![true; rows.len()];
    let mut log: Vec<(u32, u32)> = Vec::new();
    let mut pairs = Vec::new();
    loop {
        let width = rows.len();
        // Look for the nearest.
        let looking: Vec<&mut Row> = rows
            .iter_mut()
            .zip(&must_look)
            .filter(|(_, must)| **must)
            .map(|(row, _)| row)
            .collect();
        in_parallel(crew, width, looking, |row| {
            row.catch_up(&log);
            let least = simd::least(crew.isa, &row.distances);
            let place = row.distances.iter().position(|&distance| distance == least);
            row.nearest = match place {
                Some(place) if least < f64::INFINITY => (place as u32, least),
                _ => (NONE, f64::INFINITY),
            };
        })?;

        // Merge those that are nearest to each other.
        let mut merged = Vec::new();
        for (i, row) in rows.iter().enumerate().filter(|&(i, _)| is_left[i]) {
            let (other, distance) = row.nearest;
            if other != NONE && i < other as usize && rows[other as usize].nearest.0 as usize == i {
                merged.push((i, other as usize, distance));
            }
        }
        if merged.is_empty() {
            return Ok(pairs);
        }
        let mut others: Vec<Row> = Vec::with_capacity(merged.len());
        for &(_, gone, _) in &merged {
            let empty = start(Vec::new());
            others.push(std::mem::replace(&mut rows[gone], empty));
        }
        let mut is_kept = vec![false; rows.len()];
        for &(kept, _, _) in &merged {
            is_kept[kept] = true;
        }
        let kept = rows
            .iter_mut()
            .zip(&is_kept)
            .filter(|(_, is_kept)| **is_kept);
        let unions: Vec<_> = kept.map(|(row, _)| row).zip(others).collect();
        in_parallel(crew, width, unions, |(row, other)| {
            row.catch_up(&log);
            other.catch_up(&log);
            simd::raise(crew.isa, &mut row.distances, &other.distances);
            other.distances = Vec::new();
        })?;
        let mut is_touched = is_kept;
        for &(kept, gone, distance) in &merged {
            is_left[gone] = false;
            is_touched[gone] = true;
            log.push((kept as u32, gone as u32));
            pairs.push((numbers[kept], numbers[gone], distance));
        }
        crew.report(pairs.len() as f64 / total);

        // Those whose nearest has merged must look again; those without one never need to.
        for i in 0..rows.len() {
            let nearest = rows[i].nearest.0;
            is_left[i] &= nearest != NONE;
            must_look[i] = is_left[i] && (is_touched[i] || is_touched[nearest as usize]);
        }
        let left = is_left.iter().filter(|is_left| **is_left).count();
        if left * 4 <= rows.len() * 3 && rows.len() > COMPACT_FROM {
            compact(crew, &mut rows, &is_left, &log)?;
            log.clear();
            numbers = pick(&numbers, &is_left);
            must_look = pick(&must_look, &is_left);
            is_left = vec![true; left];
        }
    }
}

/// Columns that are read together when a condensed matrix is turned: a line of the cache.
const BAND: usize = 8;

/// The full matrix, infinite on the diagonal, of a condensed one.
pub(crate) fn rows_of_condensed(
    crew: &Crew<'_>,
    n: usize,
    distances: &[f64],
) -> Result<Vec<Vec<f64>>, Error> {
    // Row a of the upper triangle, from column a + 1 on.
    let upper = |a: usize| &distances[a * (2 * n - a - 1) / 2..][..n - a - 1];
    let mut rows: Vec<Vec<f64>> = vec![Vec::new(); n];
    crew.each(
        rows.chunks_mut(BAND).enumerate(),
        || (),
        |(), (band, rows)| {
            let first = band * BAND;
            for row in &mut *rows {
                *row = vec![f64::INFINITY; n];
            }
            for b in 0..(first + rows.len()).min(n) {
                // What stands below the diagonal stands in a column of the upper triangle.
                for (i, row) in rows.iter_mut().enumerate().filter(|&(i, _)| b < first + i) {
                    row[b] = upper(b)[first + i - b - 1] + 0.0;
                }
            }
            for (i, row) in rows.iter_mut().enumerate() {
                let a = first + i;
                for (own, distance) in row[a + 1..].iter_mut().zip(upper(a)) {
                    *own = distance + 0.0;
                }
            }
        },
    )?;
    Ok(rows)
}

/// Drop the rows and columns of clusters that are gone.
fn compact(
    crew: &Crew<'_>,
    rows: &mut Vec<Row>,
    is_left: &[bool],
    log: &[(u32, u32)],
) -> Result<(), Error> {
    let columns: Vec<u32> = (0..rows.len() as u32)
        .filter(|&i| is_left[i as usize])
        .collect();
    let mut places = vec![NONE; rows.len()];
    for (place, &column) in columns.iter().enumerate() {
        places[column as usize] = place as u32;
    }
    let mut i = 0;
    rows.retain(|_| {
        i += 1;
        is_left[i - 1]
    });
    in_parallel(crew, is_left.len(), rows.iter_mut().collect(), |row| {
        row.catch_up(log);
        for (place, &column) in columns.iter().enumerate() {
            row.distances[place] = row.distances[column as usize];
        }
        row.distances.truncate(columns.len());
        row.caught_up = 0;
        // Who had a nearest that is gone looks again before this is read.
        row.nearest.0 = places[row.nearest.0 as usize];
    })
}

/// Do something with each row, `width` long, sharing them out if that is worth it.
fn in_parallel<T: Send>(
    crew: &Crew<'_>,
    width: usize,
    mut rows: Vec<T>,
    work: impl Fn(&mut T) + Sync,
) -> Result<(), Error> {
    let per_job = rows
        .len()
        .div_ceil(8 * crew.threads())
        .max(SHARE.div_ceil(width.max(1)));
    crew.each(rows.chunks_mut(per_job), || (), |(), rows| rows.iter_mut().for_each(&work))?;
    Ok(())
}

fn pick<T: Copy>(values: &[T], is_left: &[bool]) -> Vec<T> {
    values
        .iter()
        .zip(is_left)
        .filter(|(_, is_left)| **is_left)
        .map(|(&value, _)| value)
        .collect()
}
