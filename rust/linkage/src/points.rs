//! The points to cluster: scaled, without duplicates, in spatial order.

use crate::error::Error;
use crate::halving::sort_by_halving;
use crate::input::{Coordinate, Table};
use crate::parallel::Workers;
use crate::sorting::sort;
use crate::tree::Merge;
use mograft_machine::memory::{collect, with_capacity};

/// Binary exponent of the largest scaled coordinate.
///
/// Squares then cannot overflow in f32, and squares of distances down to 2^-90 of the largest
/// coordinate cannot underflow there.
const MAX_EXPONENT: i32 = 40;

/// Scaled coordinates below this, 2^-399, become zero.
///
/// Two different points then differ by at least 2^-451 along some axis: their squared distance is
/// at least 2^-902, which is not zero.
const MIN_COORDINATE: f64 = f64::from_bits((1023 - 399) << 52);

/// Most points that one job scales or copies.
const MAX_POINTS_PER_JOB: usize = 1 << 12;

/// Most coordinates that one job scales or copies, if it handles more than one point.
const MAX_COORDINATES_PER_JOB: usize = 1 << 18;

/// How many points of `dim` axes one job scales or copies.
fn points_per_job(dim: usize) -> usize {
    (MAX_COORDINATES_PER_JOB / dim).clamp(1, MAX_POINTS_PER_JOB)
}

/// Distinct points, scaled by a power of two, which changes no digit.
pub(crate) struct Points {
    /// Coordinates per point.
    pub dim: usize,
    /// Scaled coordinates, row-major.
    pub rows: Vec<f64>,
    /// For each row, the smallest index of that point in the input.
    pub input_indices: Vec<u32>,
    /// Merges at height 0 of every repeated point with its first occurrence, by input index.
    pub duplicate_merges: Vec<Merge>,
    /// Binary exponent of the factor from scaled to given distances.
    scale_exponent: i32,
}

impl Points {
    /// Scale finite points and remove duplicates; `largest` is the largest absolute coordinate.
    ///
    /// Takes O(n log n) time for n points.
    ///
    /// # Errors
    ///
    /// [`Error::OutOfMemory`] and [`Error::Stopped`].
    pub fn new<T: Coordinate>(
        workers: &Workers<'_>,
        table: &Table<'_, T>,
        largest: f64,
    ) -> Result<Self, Error> {
        let dim = table.dim();
        let scale_exponent = if largest == 0.0 { 0 } else { exponent(largest) - MAX_EXPONENT };
        let scale = |x: f64| {
            let x = scale_by_power_of_two(x, -scale_exponent);
            // The sum turns -0 into 0, so that equal coordinates have equal bits.
            if x.abs() < MIN_COORDINATE { 0.0 } else { x + 0.0 }
        };
        let mut rows = workers.allocate(0.0, table.len() * dim)?;
        let mut hashes = workers.allocate((0, 0), table.len())?;
        let width = points_per_job(dim);
        let jobs = rows.chunks_mut(width * dim).zip(hashes.chunks_mut(width));
        workers.run(
            jobs.enumerate(),
            || (),
            |(), (job, (rows, hashes))| {
                for (i, (row, entry)) in rows.chunks_mut(dim).zip(hashes).enumerate() {
                    let point = job * width + i;
                    for (scaled, x) in row.iter_mut().zip(table.row(point)) {
                        *scaled = scale(x);
                    }
                    *entry = (hash(row), point as u32);
                }
            },
        )?;
        let (input_indices, duplicate_merges) = find_duplicates(workers, &rows, dim, hashes)?;
        if !duplicate_merges.is_empty() {
            for (row, &point) in input_indices.iter().enumerate() {
                workers.check_row(row, dim)?;
                rows.copy_within(point as usize * dim..(point as usize + 1) * dim, row * dim);
            }
            rows.truncate(input_indices.len() * dim);
            rows.shrink_to_fit();
        }
        Ok(Self { dim, rows, input_indices, duplicate_merges, scale_exponent })
    }

    /// The same points, with rows that are near in space near in memory.
    ///
    /// # Errors
    ///
    /// [`Error::OutOfMemory`] and [`Error::Stopped`].
    pub fn sort_spatially(self, workers: &Workers<'_>) -> Result<Self, Error> {
        let dim = self.dim;
        let mut order: Vec<u32> = collect(0..self.len() as u32)?;
        sort_by_halving(workers, &self.rows, dim, &mut order)?;
        let mut rows = workers.allocate(0.0, self.rows.len())?;
        let width = points_per_job(dim);
        let jobs = rows.chunks_mut(width * dim).zip(order.chunks(width));
        workers.run(
            jobs,
            || (),
            |(), (rows, order)| {
                for (target, &row) in rows.chunks_exact_mut(dim).zip(order) {
                    target.copy_from_slice(self.row(row));
                }
            },
        )?;
        let input_indices = collect(order.iter().map(|&row| self.input_indices[row as usize]))?;
        Ok(Self { rows, input_indices, ..self })
    }

    /// Count of distinct points.
    pub fn len(&self) -> usize {
        self.input_indices.len()
    }

    /// Scaled coordinates of a point.
    pub fn row(&self, row: u32) -> &[f64] {
        &self.rows[row as usize * self.dim..][..self.dim]
    }

    /// The distance, in the unit of the input, that has a given scaled square.
    pub fn distance_from_squared(&self, squared: f64) -> f64 {
        scale_by_power_of_two(squared.sqrt(), self.scale_exponent)
    }

    /// The largest scaled square whose distance is at most `distance`.
    ///
    /// Exact to the last bit: a square is at most the result if and only if
    /// [`Self::distance_from_squared`] of it is at most `distance`. Infinite distances give
    /// infinity.
    pub fn max_squared(&self, distance: f64) -> f64 {
        let is_within = |squared: f64| self.distance_from_squared(squared) <= distance;
        let scaled = scale_by_power_of_two(distance, -self.scale_exponent);
        if is_within(f64::MAX) || !(scaled * scaled).is_finite() {
            return f64::INFINITY;
        }
        // The square of the distance is off by a few units in the last place; bisect its bits.
        let mut low = ((scaled * (1.0 - 1e-9)) * scaled).to_bits();
        if !is_within(f64::from_bits(low)) {
            low = 0;
        }
        let mut high = ((scaled * (1.0 + 1e-9)) * scaled)
            .max(f64::MIN_POSITIVE)
            .to_bits();
        while is_within(f64::from_bits(high)) {
            (low, high) = (high, high + (1 << 52));
        }
        while high - low > 1 {
            let middle = u64::midpoint(low, high);
            if is_within(f64::from_bits(middle)) {
                low = middle;
            } else {
                high = middle;
            }
        }
        f64::from_bits(low)
    }
}

/// The squared distance that determines results: axes added in order, nothing fused.
pub(crate) fn squared_distance(a: &[f64], b: &[f64]) -> f64 {
    let mut sum = 0.0;
    for (x, y) in a.iter().zip(b) {
        sum += (x - y) * (x - y);
    }
    sum
}

/// The binary exponent of `x`; -1023 for subnormal numbers and 0.
fn exponent(x: f64) -> i32 {
    ((x.to_bits() >> 52) as i32 & 0x7ff) - 1023
}

/// `x` times 2^`power`.
fn scale_by_power_of_two(x: f64, power: i32) -> f64 {
    // From bits, because `powi` need not be exact.
    let power_of_two = |power: i32| f64::from_bits(((1023 + power) as u64) << 52);
    // In two steps, because one factor alone may be out of range.
    x * power_of_two(power / 2) * power_of_two(power - power / 2)
}

/// The first occurrence of every point, and the merges of the others with it, both ascending.
///
/// `hashes` are those of all points.
fn find_duplicates(
    workers: &Workers<'_>,
    rows: &[f64],
    dim: usize,
    mut hashes: Vec<(u64, u32)>,
) -> Result<(Vec<u32>, Vec<Merge>), Error> {
    let row = |point: u32| &rows[point as usize * dim..][..dim];
    sort(workers, &mut hashes)?;
    // For each point its first occurrence.
    let mut firsts: Vec<u32> = collect(0..hashes.len() as u32)?;
    let mut n_repeated = 0;
    for same_hash in hashes
        .chunk_by_mut(|a, b| a.0 == b.0)
        .filter(|chunk| chunk.len() > 1)
    {
        // Different points may have the same hash; sort to make equal points adjacent.
        let bits = |point: u32| row(point).iter().map(|x| x.to_bits());
        same_hash.sort_unstable_by(|a, b| bits(a.1).cmp(bits(b.1)).then(a.1.cmp(&b.1)));
        for same in same_hash.chunk_by(|a, b| row(a.1) == row(b.1)) {
            for &(_, point) in &same[1..] {
                workers.check_item(n_repeated)?;
                firsts[point as usize] = same[0].1;
                n_repeated += 1;
            }
        }
    }
    drop(hashes);
    let mut merges = with_capacity(n_repeated)?;
    let points = (0..).zip(&firsts);
    let repeated = points.filter(|&(point, &first)| point != first);
    merges.extend(repeated.map(|(point, &first)| Merge::new(first, point, 0.0)));
    let mut point = 0;
    firsts.retain(|&first| {
        point += 1;
        first == point - 1
    });
    Ok((firsts, merges))
}

fn hash(row: &[f64]) -> u64 {
    row.iter().fold(0x9e37_79b9_7f4a_7c15, |hash, x| {
        let mixed = (hash ^ x.to_bits()).wrapping_mul(0xd6e8_feb8_6659_fd93);
        mixed ^ (mixed >> 32)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use mograft_machine::instructions::Isa;

    fn points_on_line(coordinates: &[f64]) -> Points {
        let workers = Workers::new(1, Isa::best(), None);
        let table = Table::rows(coordinates, 1);
        let largest = table.check(&workers).unwrap();
        Points::new(&workers, &table, largest).unwrap()
    }

    #[test]
    fn distance_from_squared_of_scaled_points_is_exact() {
        for size in [1e-310, 1e-200, 3.0, 1e200, 1.7e308] {
            let points = points_on_line(&[0.0, size, size / 3.0]);
            let squared = squared_distance(points.row(0), points.row(1));
            assert_eq!(points.distance_from_squared(squared), size);
        }
    }

    #[test]
    fn max_squared_is_largest_square_within_distance() {
        for largest in [1e-150, 1.0, 1e150] {
            let points = points_on_line(&[0.0, largest]);
            for distance in [0.0, largest / 7.0, largest * 0.1, largest] {
                let limit = points.max_squared(distance);
                assert!(points.distance_from_squared(limit) <= distance);
                assert!(points.distance_from_squared(limit.next_up()) > distance);
            }
            assert_eq!(points.max_squared(f64::INFINITY), f64::INFINITY);
        }
    }

    #[test]
    fn new_repeated_points_merge_with_first_occurrence() {
        let points = points_on_line(&[1.0, 0.0, -0.0, 2.0, 1.0, 0.0]);
        assert_eq!(points.input_indices, [0, 1, 3]);
        let expected = [Merge::new(1, 2, 0.0), Merge::new(0, 4, 0.0), Merge::new(1, 5, 0.0)];
        assert_eq!(points.duplicate_merges, expected);
        assert!(points.row(2)[0] > points.row(0)[0] && points.rows.len() == 3);
    }
}
