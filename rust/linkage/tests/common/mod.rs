//! Oracles for complete linkage, and clouds of points that are hard in different ways.

use std::collections::HashMap;

use mograft_linkage::{Level, Options, Tuning, linkage_condensed};
use proptest::prelude::*;

/// Scale points so that squares can neither overflow nor underflow; return the binary exponent.
///
/// Coordinates below 2^-440 of the largest become 0, as the crate documents.
fn scale(points: &[f64]) -> (Vec<f64>, i32) {
    let largest = points
        .iter()
        .fold(0.0, |largest: f64, x| largest.max(x.abs()));
    if largest == 0.0 {
        return (vec![0.0; points.len()], 0);
    }
    let exponent = ((largest.to_bits() >> 52) as i32 & 0x7ff) - 1022;
    let scale = |&x: &f64| {
        let x = times_power_of_two(x, -exponent);
        if x.abs() < 2_f64.powi(-440) { 0.0 } else { x }
    };
    (points.iter().map(scale).collect(), exponent)
}

fn times_power_of_two(x: f64, power: i32) -> f64 {
    x * 2_f64.powi(power / 2) * 2_f64.powi(power - power / 2)
}

fn squared_distance(points: &[f64], dim: usize, a: usize, b: usize) -> f64 {
    (0..dim).fold(0.0, |sum, k| {
        let difference = points[a * dim + k] - points[b * dim + k];
        sum + difference * difference
    })
}

/// Greedy search: merge the pair of least (squared distance, low, high), again and again.
///
/// The definition of the tree, in O(n³) time.
pub fn linkage_by_greedy_search(points: &[f64], dim: usize) -> Vec<[f64; 4]> {
    let n = points.len() / dim;
    let (points, exponent) = scale(points);
    let mut squares: Vec<Vec<f64>> = (0..n)
        .map(|a| {
            (0..n)
                .map(|b| squared_distance(&points, dim, a, b))
                .collect()
        })
        .collect();
    let mut clusters: Vec<Option<(usize, usize)>> = (0..n).map(|point| Some((point, 1))).collect();
    let mut rows = Vec::new();
    while rows.len() + 1 < n {
        let active: Vec<usize> = (0..n).filter(|&i| clusters[i].is_some()).collect();
        let pairs = active.iter().enumerate().flat_map(|(i, &a)| {
            let later = active[i + 1..].iter();
            later.map(move |&b| (a, b))
        });
        let (low, high) = pairs
            .reduce(
                |best, pair| {
                    if squares[pair.0][pair.1] < squares[best.0][best.1] { pair } else { best }
                },
            )
            .unwrap();
        let ((a, size_a), (b, size_b)) = (clusters[low].unwrap(), clusters[high].take().unwrap());
        let height = times_power_of_two(squares[low][high].sqrt(), exponent);
        rows.push([a.min(b) as f64, a.max(b) as f64, height, (size_a + size_b) as f64]);
        clusters[low] = Some((n + rows.len() - 1, size_a + size_b));
        let larger: Vec<f64> = (squares[low].iter().zip(&squares[high]))
            .map(|(a, b)| a.max(*b))
            .collect();
        for (row, &squared) in squares.iter_mut().zip(&larger) {
            row[low] = squared;
        }
        squares[low] = larger;
    }
    rows
}

/// The tree by the nearest-neighbour chain over all squared distances, in O(n²) time.
pub fn linkage_by_chain(points: &[f64], dim: usize) -> Vec<[f64; 4]> {
    let n = points.len() / dim;
    let (points, exponent) = scale(points);
    let squares: Vec<f64> = (0..n)
        .flat_map(|a| (a + 1..n).map(move |b| (a, b)))
        .map(|(a, b)| squared_distance(&points, dim, a, b))
        .collect();
    let options = Options { max_matrix_bytes: 0, ..Options::default() };
    let mut rows = linkage_condensed(&squares, &options).unwrap();
    for row in &mut rows {
        row[2] = times_power_of_two(row[2].sqrt(), exponent);
    }
    rows
}

/// Labels of a tree: follow each point up to the last merge at a height of at most `diameter`.
pub fn labels_of_tree(tree: &[[f64; 4]], diameter: f64) -> Vec<i64> {
    let n = tree.len() + 1;
    let mut tops: Vec<usize> = (0..2 * n - 1).collect();
    let rows = tree.iter().enumerate().rev();
    for (i, row) in rows.filter(|(_, row)| row[2] <= diameter) {
        tops[row[0] as usize] = tops[n + i];
        tops[row[1] as usize] = tops[n + i];
    }
    let mut numbers = HashMap::new();
    let mut labels = Vec::new();
    for top in &tops[..n] {
        let next = i64::try_from(numbers.len()).unwrap();
        labels.push(*numbers.entry(top).or_insert(next));
    }
    labels
}

/// A generator of reproducible numbers (xorshift; Marsaglia 2003).
pub struct Noise(pub u64);

impl Noise {
    fn next(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0
    }

    pub fn below(&mut self, n: usize) -> usize {
        (self.next() % n as u64) as usize
    }

    pub fn uniform(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Approximately normal.
    pub fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.uniform()).sum::<f64>() - 6.0
    }

    pub fn tuned_options(&mut self) -> Options<'static> {
        let tuning = Tuning {
            level: LEVELS[self.below(3)],
            degree: [0.5, 2.0, 8.0, 24.0][self.below(4)],
            dense_size: [0, 2, 9, 40][self.below(4)],
            spare_edges: [0, 100, 1 << 20][self.below(3)],
            matrix_size: 0,
            split_size: [20, 80, 1 << 13][self.below(3)],
            matrix_work: [0.0, 0.01, 0.1, f64::INFINITY][self.below(4)],
        };
        Options { threads: 1 + self.below(3), tuning, ..Options::default() }
    }
}

const LEVELS: [Level; 3] = [Level::Baseline, Level::Avx2, Level::Avx512];

/// Kinds of [`cloud`].
pub const N_KINDS: usize = 10;

/// Clouds that are each hard in a different way.
pub fn cloud(kind: usize, n: usize, dim: usize, noise: &mut Noise) -> Vec<f64> {
    let mut points: Vec<f64> = (0..n * dim).map(|_| noise.normal()).collect();
    match kind {
        // No ties.
        0 => {}
        // Lattices: distances take few values.
        1 => points.iter_mut().for_each(|x| *x = x.round()),
        2 => points.iter_mut().for_each(|x| *x = f64::from(*x > 0.0)),
        // Every point four times.
        3 => {
            let n_distinct = n.div_ceil(4);
            for point in n_distinct..n {
                let source = point % n_distinct;
                points.copy_within(source * dim..(source + 1) * dim, point * dim);
            }
        }
        // Very near to each other and far from the origin.
        4 => points.iter_mut().for_each(|x| *x = 7.0 + 1e-9 * *x),
        // Half of the points in a clump.
        5 => points[..n / 2 * dim].iter_mut().for_each(|x| *x *= 1e-9),
        // Radii of all sizes.
        6 => {
            for point in points.chunks_mut(dim) {
                let size = 10_f64.powf(-12.0 * noise.uniform());
                for x in point {
                    *x *= size;
                }
            }
        }
        // A single point far away, and numbers near the ends of the range of f64.
        7 => points[dim - 1] = 1e12,
        8 => points.iter_mut().for_each(|x| *x *= 1e305),
        _ => points.iter_mut().for_each(|x| *x *= 1e-290),
    }
    points
}

/// Kinds of [`tied_cloud`].
pub const N_TIED_KINDS: usize = 6;

/// Clouds whose distances take few values.
pub fn tied_cloud(kind: usize, n: usize, dim: usize, noise: &mut Noise) -> Vec<f64> {
    let mut points = vec![0.0; n * dim];
    for (i, point) in points.chunks_exact_mut(dim).enumerate() {
        match kind {
            // One axis per point, as far as there are axes; then at another height.
            0 => point[i % dim] = (1 + i / dim) as f64,
            // Several categories of five values.
            1 => point
                .chunks_mut(5)
                .for_each(|part| part[noise.below(part.len())] = 1.0),
            // Fingerprints with few and with many bits.
            2 => point
                .iter_mut()
                .for_each(|x| *x = f64::from(noise.below(20) == 0)),
            3 => point.iter_mut().for_each(|x| *x = noise.below(2) as f64),
            // Integer grids, of many or few differing axes.
            4 => point.iter_mut().for_each(|x| *x = noise.below(4) as f64),
            _ => point
                .iter_mut()
                .take(3)
                .for_each(|x| *x = noise.below(5) as f64),
        }
    }
    points
}

/// Small clouds for proptest: lattices, near duplicates, single precision, wide ranges; rows may
/// be repeated. Shrinks to few points of few axes.
pub fn small_clouds(max_points: usize) -> impl Strategy<Value = (Vec<f64>, usize)> {
    let coordinate = prop_oneof![
        Just((-2_i8..=2).prop_map(f64::from).boxed()),
        Just(prop::sample::select(vec![0.0, -0.0, 1e-12, 1.0, 1.0_f64.next_up(), 1e8]).boxed()),
        Just((-1e3_f32..1e3).prop_map(f64::from).boxed()),
        Just((-1e100..1e100).boxed()),
    ];
    (1..=8_usize, 2..=max_points, coordinate).prop_flat_map(|(dim, n, coordinate)| {
        let rows = prop::collection::vec(prop::collection::vec(coordinate, dim), n);
        let repeats = prop::collection::vec(any::<prop::sample::Index>(), 0..n);
        (rows, repeats).prop_map(move |(mut rows, repeats)| {
            for index in repeats.into_iter().skip(n / 2) {
                let row = rows[index.index(rows.len())].clone();
                rows.push(row);
            }
            (rows.concat(), dim)
        })
    })
}

/// All that may change the running time and nothing else.
pub fn tunings() -> impl Strategy<Value = Tuning> {
    let levels = prop::sample::select(LEVELS.to_vec());
    let degrees = prop::sample::select(vec![0.5, 2.0, 8.0, 24.0]);
    let dense_sizes = prop::sample::select(vec![0, 2, 7, 30]);
    let spare_edges = prop::sample::select(vec![0, 50, 1 << 20]);
    let matrix_work = prop::sample::select(vec![0.0, 0.01, 0.1, f64::INFINITY]);
    let split_sizes = prop::sample::select(vec![9, 40, 1 << 13]);
    (levels, degrees, dense_sizes, spare_edges, matrix_work, split_sizes).prop_map(
        |(level, degree, dense_size, spare_edges, matrix_work, split_size)| Tuning {
            level,
            degree,
            dense_size,
            spare_edges,
            matrix_size: 0,
            matrix_work,
            split_size,
        },
    )
}
