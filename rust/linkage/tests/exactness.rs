//! The linear-memory tree is that of the plain chain, bit for bit, whatever is tuned.

use mograft_linkage::linkage_condensed;
use mograft_linkage::{Error, Level, Options, Tuning, cut, linkage, linkage_by_chain};

/// A small generator of reproducible noise (Marsaglia 2003).
struct Noise(u64);

impl Noise {
    fn next(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0
    }

    fn below(&mut self, n: usize) -> usize {
        (self.next() % n as u64) as usize
    }

    fn unit(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Roughly normal.
    fn bell(&mut self) -> f64 {
        (0..12).map(|_| self.unit()).sum::<f64>() - 6.0
    }
}

/// Clouds that are each hard in a way of its own.
fn cloud(kind: usize, n: usize, dim: usize, noise: &mut Noise) -> Vec<f64> {
    let mut points: Vec<f64> = (0..n * dim).map(|_| noise.bell()).collect();
    match kind {
        // Scattered without ties.
        0 => {}
        // Lattices: distances take few values.
        1 => points.iter_mut().for_each(|x| *x = x.round()),
        2 => points.iter_mut().for_each(|x| *x = f64::from(*x > 0.0)),
        // Each place many times.
        3 => {
            let places = n.div_ceil(4);
            for point in places..n {
                points.copy_within((point % places) * dim..(point % places + 1) * dim, point * dim);
            }
        }
        // Within a hair of each other, far from the origin.
        4 => points.iter_mut().for_each(|x| *x = 7.0 + 1e-9 * *x),
        // Half of the points in a clump.
        5 => points[..n / 2 * dim].iter_mut().for_each(|x| *x *= 1e-9),
        // Radii of all sizes.
        6 => {
            for point in points.chunks_mut(dim) {
                let size = 10_f64.powf(-12.0 * noise.unit());
                for x in point {
                    *x *= size;
                }
            }
        }
        // A single one far off, and numbers near the ends of the range.
        7 => points[dim - 1] = 1e12,
        8 => points.iter_mut().for_each(|x| *x *= 1e305),
        _ => points.iter_mut().for_each(|x| *x *= 1e-290),
    }
    points
}

const KINDS: usize = 10;

fn tuned(noise: &mut Noise) -> Options<'static> {
    let levels = [Level::Baseline, Level::Avx2, Level::Avx512];
    let tuning = Tuning {
        level: levels[noise.below(3)],
        degree: [0.5, 2.0, 8.0, 24.0][noise.below(4)],
        finish: [0, 2, 9, 40][noise.below(4)],
        crowd: [0, 100, 1 << 20][noise.below(3)],
    };
    Options { threads: 1 + noise.below(3), memory: 0, watch: None, tuning }
}

#[test]
fn the_tree_is_that_of_the_chain() {
    let mut noise = Noise(0x1234_5678_9abc_def1);
    for round in 0..400 {
        let (n, dim) = (2 + noise.below(150), 1 + noise.below(12));
        let points = cloud(round % KINDS, n, dim, &mut noise);
        let wanted = linkage_by_chain(&points, dim).unwrap();
        for _ in 0..3 {
            let options = tuned(&mut noise);
            let tree = linkage(&points, dim, &options).unwrap();
            assert!(
                tree == wanted,
                "kind {}, n {n}, dim {dim}, {:?}",
                round % KINDS,
                options.tuning
            );
        }
    }
}

#[test]
fn large_clusters_are_measured_exactly() {
    // Few clusters of many points: what the sweeps and the thinning are for.
    let mut noise = Noise(0xfeed_5678_9abc_0001);
    for round in 0..12 {
        let dim = 1 + noise.below(6);
        let mut points = cloud(round % KINDS, 900, dim, &mut noise);
        for (i, point) in points.chunks_mut(dim).enumerate() {
            point[0] += if round % KINDS < 3 { (i % 5) as f64 * 4.0 } else { 0.0 };
        }
        let wanted = linkage_by_chain(&points, dim).unwrap();
        let options = tuned(&mut noise);
        let tree = linkage(&points, dim, &options).unwrap();
        assert!(tree == wanted, "kind {}, dim {dim}, {:?}", round % KINDS, options.tuning);
    }
}

#[test]
fn the_cut_is_that_of_the_tree() {
    let mut noise = Noise(0x0bad_cafe_1234_5678);
    for round in 0..200 {
        let (n, dim) = (2 + noise.below(120), 1 + noise.below(5));
        let points = cloud(round % KINDS, n, dim, &mut noise);
        let tree = linkage_by_chain(&points, dim).unwrap();
        let height = tree[noise.below(n - 1)][2];
        for diameter in [height, height.next_down().max(0.0), height.next_up(), 0.0] {
            let labels = cut(&points, dim, diameter, &tuned(&mut noise)).unwrap();
            assert_eq!(labels, labels_of(&tree, diameter), "kind {}, {diameter}", round % KINDS);
        }
    }
}

/// Follow each point up to the last merge that is no higher.
fn labels_of(tree: &[[f64; 4]], diameter: f64) -> Vec<i64> {
    let n = tree.len() + 1;
    let mut top: Vec<usize> = (0..2 * n - 1).collect();
    for (i, row) in tree
        .iter()
        .enumerate()
        .rev()
        .filter(|(_, row)| row[2] <= diameter)
    {
        top[row[0] as usize] = top[n + i];
        top[row[1] as usize] = top[n + i];
    }
    let mut seen = Vec::new();
    let mut labels = Vec::new();
    for cluster in &top[..n] {
        if !seen.contains(cluster) {
            seen.push(*cluster);
        }
        labels.extend(
            (0..)
                .zip(&seen)
                .find(|(_, other)| *other == cluster)
                .map(|(i, _)| i),
        );
    }
    labels
}

#[test]
fn a_condensed_matrix_grows_the_same_tree_on_the_matrix_and_by_the_chain() {
    let mut noise = Noise(0x7777_5678_0000_1111);
    for round in 0..60 {
        let n = 1 + noise.below(200);
        // Distances without any geometry, at first with many ties.
        let steps = if round % 2 == 0 { 8.0 } else { 1e9 };
        let distances: Vec<f64> = (0..n * (n - 1) / 2)
            .map(|_| (noise.unit() * steps).round())
            .collect();
        let options = Options { threads: 1 + noise.below(2), ..Options::default() };
        let by_chain = linkage_condensed(&distances, &Options { memory: 0, ..options }).unwrap();
        assert!(linkage_condensed(&distances, &options).unwrap() == by_chain);
    }
}

#[test]
fn what_cannot_be_clustered_is_refused() {
    let options = Options::default();
    let refusal = |points: &[f64], dim| linkage(points, dim, &options).unwrap_err();
    assert_eq!(refusal(&[0.0; 5], 2), Error::NoPoints { len: 5, dim: 2 });
    assert_eq!(refusal(&[], 0), Error::NoPoints { len: 0, dim: 0 });
    assert_eq!(refusal(&[0.0, 1.0, f64::NAN], 1), Error::NotFinite { point: 2, axis: 0 });
    assert_eq!(cut(&[0.0], 1, f64::NAN, &options), Err(Error::BadDiameter));
    assert_eq!(linkage_condensed(&[1.0; 2], &options), Err(Error::NotCondensed { len: 2 }));
    assert_eq!(linkage_condensed(&[-1.0], &options), Err(Error::BadDistance { index: 0 }));
}

#[test]
fn the_caller_can_stop_it() {
    let mut noise = Noise(0x5555_4444_3333_2222);
    let points = cloud(0, 3000, 3, &mut noise);
    let stop = |_: f64| false;
    let options = Options { memory: 0, watch: Some(&stop), ..Options::default() };
    assert_eq!(linkage(&points, 3, &options), Err(Error::Stopped));
}
