//! Points made ready: scaled, each place once, and in an order that follows space.

use crate::order;
use crate::parallel::Crew;
use crate::tree::Merge;

/// The binary exponent to which the largest coordinate is scaled.
///
/// Squares then stay far from overflow in f32 too, and those of distances down to 2^-90 of
/// the largest coordinate stay clear of underflow there.
const EXPONENT: i32 = 40;

/// Scaled coordinates below this, 2^-399, count as zero.
///
/// So two different points differ by at least 2^-451 along some axis: their squared
/// distance, 2^-902 or more, is not zero.
const TINY: f64 = f64::from_bits((1023 - 399) << 52);

/// Different points, scaled by a power of two, which changes no digit.
pub(crate) struct Points {
    /// Coordinates of one point.
    pub dim: usize,
    /// Row-major.
    pub rows: Vec<f64>,
    /// The smallest index at which each point was given.
    pub given_at: Vec<u32>,
    /// The merges, all at height 0, of points that were given again with the first of each.
    pub repeats: Vec<Merge>,
    /// A scaled distance times two to this power is a given distance.
    unit: i32,
}

impl Points {
    /// Take finite points, row-major, `dim` wide.
    pub fn new(given: &[f64], dim: usize) -> Self {
        let largest = given.iter().fold(0.0, |most: f64, x| most.max(x.abs()));
        let unit = if largest == 0.0 { 0 } else { exponent(largest) - EXPONENT };
        let clean = |&x: &f64| {
            let x = times_power_of_two(x, -unit);
            // The sum turns -0 into 0: bits that differ are coordinates that differ.
            if x.abs() < TINY { 0.0 } else { x + 0.0 }
        };
        let mut rows: Vec<f64> = given.iter().map(clean).collect();
        let (given_at, repeats) = first_of_each(&rows, dim);
        if !repeats.is_empty() {
            for (row, &point) in given_at.iter().enumerate() {
                rows.copy_within(point as usize * dim..(point as usize + 1) * dim, row * dim);
            }
            rows.truncate(given_at.len() * dim);
            rows.shrink_to_fit();
        }
        Self { dim, rows, given_at, repeats, unit }
    }

    /// The same points, neighbours in space stored near to each other.
    pub fn in_spatial_order(self, crew: &Crew<'_>) -> Self {
        let mut order: Vec<u32> = (0..self.len() as u32).collect();
        order::by_halves(crew, &self.rows, self.dim, &mut order);
        let mut rows = Vec::with_capacity(self.rows.len());
        for &row in &order {
            rows.extend_from_slice(self.row(row));
        }
        let given_at = order
            .iter()
            .map(|&row| self.given_at[row as usize])
            .collect();
        Self { rows, given_at, ..self }
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.given_at.len()
    }

    /// The coordinates of a point.
    pub fn row(&self, row: u32) -> &[f64] {
        &self.rows[row as usize * self.dim..][..self.dim]
    }

    /// The distance, as given, of points whose scaled squared distance this is.
    pub fn distance(&self, squared: f64) -> f64 {
        times_power_of_two(squared.sqrt(), self.unit)
    }

    /// The largest scaled squared distance of points that are no farther apart than this.
    ///
    /// To the last bit: a squared distance is at most this where [`Self::distance`] of it is
    /// at most `distance`.
    pub fn squared(&self, distance: f64) -> f64 {
        let is_within = |squared: f64| self.distance(squared) <= distance;
        let scaled = times_power_of_two(distance, -self.unit);
        if is_within(f64::MAX) || !(scaled * scaled).is_finite() {
            return f64::INFINITY;
        }
        // The root is off by a few units in the last place; bisect among the bits.
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

/// The squared distance that decides: coordinates added in order, nothing fused.
pub(crate) fn squared_distance(a: &[f64], b: &[f64]) -> f64 {
    let mut sum = 0.0;
    for (x, y) in a.iter().zip(b) {
        sum += (x - y) * (x - y);
    }
    sum
}

/// The exponent of the largest power of two that is no larger; of subnormals, the normal's.
fn exponent(x: f64) -> i32 {
    ((x.to_bits() >> 52) as i32 & 0x7ff) - 1023
}

fn times_power_of_two(x: f64, power: i32) -> f64 {
    // From its bits, because `powi` need not be exact to the last.
    let power_of_two = |power: i32| f64::from_bits(((1023 + power) as u64) << 52);
    // In two steps, because one power alone may be out of range.
    x * power_of_two(power / 2) * power_of_two(power - power / 2)
}

/// Find points that are given more than once: the first of each, and the others' merges.
fn first_of_each(rows: &[f64], dim: usize) -> (Vec<u32>, Vec<Merge>) {
    let row = |point: u32| &rows[point as usize * dim..][..dim];
    let mut hashed: Vec<(u64, u32)> = rows
        .chunks_exact(dim)
        .zip(0..)
        .map(|(row, point)| (hash(row), point))
        .collect();
    hashed.sort_unstable();
    let mut repeats = Vec::new();
    for same_hash in hashed
        .chunk_by_mut(|a, b| a.0 == b.0)
        .filter(|chunk| chunk.len() > 1)
    {
        // Equal points have equal hashes, and others may too: sort them out.
        let bits = |point: u32| row(point).iter().map(|x| x.to_bits());
        same_hash.sort_unstable_by(|a, b| bits(a.1).cmp(bits(b.1)).then(a.1.cmp(&b.1)));
        for same in same_hash.chunk_by(|a, b| row(a.1) == row(b.1)) {
            repeats.extend(
                same[1..]
                    .iter()
                    .map(|again| Merge::new(same[0].1, again.1, 0.0)),
            );
        }
    }
    let mut is_first = vec![true; hashed.len()];
    for merge in &repeats {
        is_first[merge.high as usize] = false;
    }
    repeats.sort_unstable_by_key(|merge| merge.high);
    (
        (0..hashed.len() as u32)
            .filter(|&point| is_first[point as usize])
            .collect(),
        repeats,
    )
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

    #[test]
    fn scaling_changes_no_digit_and_goes_back() {
        for size in [1e-310, 1e-200, 3.0, 1e200, 1.7e308] {
            let points = Points::new(&[0.0, size, size / 3.0], 1);
            let squared = squared_distance(points.row(0), points.row(1));
            assert_eq!(points.distance(squared), size);
        }
    }

    #[test]
    fn a_limit_lets_through_what_is_no_farther_and_nothing_else() {
        for largest in [1e-150, 1.0, 1e150] {
            let points = Points::new(&[0.0, largest], 1);
            for distance in [0.0, largest / 7.0, largest * 0.1, largest] {
                let limit = points.squared(distance);
                assert!(points.distance(limit) <= distance);
                assert!(points.distance(limit.next_up()) > distance);
            }
            assert_eq!(points.squared(f64::INFINITY), f64::INFINITY);
        }
    }

    #[test]
    fn repeats_merge_with_the_first() {
        let points = Points::new(&[1.0, 0.0, -0.0, 2.0, 1.0, 0.0], 1);
        assert_eq!(points.given_at, [0, 1, 3]);
        let wanted = [Merge::new(1, 2, 0.0), Merge::new(0, 4, 0.0), Merge::new(1, 5, 0.0)];
        assert_eq!(points.repeats, wanted);
        assert!(points.row(2)[0] > points.row(0)[0] && points.rows.len() == 3);
    }
}
