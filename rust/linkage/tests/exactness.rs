//! The tree is that of the oracles, bit for bit, for all values of the tuning parameters.

mod common;

use std::ops::ControlFlow;

use common::{
    N_KINDS, N_TIED_KINDS, Noise, cloud, labels_of_tree, linkage_by_chain,
    linkage_by_greedy_search, small_clouds, tied_cloud, tunings,
};
use mograft_linkage::{Error, Level, Options, Table, Tuning, cut, linkage, linkage_condensed};
use proptest::prelude::*;
use proptest::test_runner::FileFailurePersistence;

fn config(cases: u32) -> ProptestConfig {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/exactness.proptest-regressions");
    let persistence = FileFailurePersistence::Direct(path);
    ProptestConfig { failure_persistence: Some(Box::new(persistence)), cases, ..Default::default() }
}

/// `Options` has no `Debug` of its own, because of the callback.
fn describe(options: &Options<'_>) -> String {
    format!("threads {}, {:?}", options.threads, options.tuning)
}

proptest! {
    #![proptest_config(config(256))]

    #[test]
    fn linkage_any_tuning_equals_greedy_search(
        (points, dim) in small_clouds(12),
        threads in 1..=3_usize,
        tuning in tunings(),
    ) {
        let expected = linkage_by_greedy_search(&points, dim);
        prop_assert_eq!(&linkage_by_chain(&points, dim), &expected);
        let options = Options { threads, ..Options::default() };
        prop_assert_eq!(&linkage(Table::rows(&points, dim), &options).unwrap(), &expected);
        let tuned = Options { tuning, ..options };
        prop_assert_eq!(&linkage(Table::rows(&points, dim), &tuned).unwrap(), &expected);
    }

    #[test]
    fn linkage_any_tuning_equals_chain(
        (points, dim) in small_clouds(100),
        threads in 1..=3_usize,
        tuning in tunings(),
    ) {
        let expected = linkage_by_chain(&points, dim);
        let options = Options { threads, tuning, ..Options::default() };
        prop_assert_eq!(linkage(Table::rows(&points, dim), &options).unwrap(), expected);
    }

    #[test]
    fn cut_any_tuning_equals_cut_of_tree(
        (points, dim) in small_clouds(40),
        threads in 1..=3_usize,
        tuning in tunings(),
        row in any::<prop::sample::Index>(),
    ) {
        let tree = linkage_by_chain(&points, dim);
        let height = tree[row.index(tree.len())][2];
        let options = Options { threads, tuning, ..Options::default() };
        for diameter in [height, height.next_down().max(0.0), height.next_up()] {
            let labels = cut(Table::rows(&points, dim), diameter, &options).unwrap();
            prop_assert_eq!(labels, labels_of_tree(&tree, diameter));
        }
    }
}

#[test]
fn linkage_hard_small_clouds_equals_chain() {
    let mut noise = Noise(0x1234_5678_9abc_def1);
    for round in 0..400 {
        let (n, dim) = (2 + noise.below(150), 1 + noise.below(12));
        let points = cloud(round % N_KINDS, n, dim, &mut noise);
        let expected = linkage_by_chain(&points, dim);
        for _ in 0..3 {
            let options = noise.tuned_options();
            let tree = linkage(Table::rows(&points, dim), &options).unwrap();
            let kind = round % N_KINDS;
            assert!(tree == expected, "kind {kind}, n {n}, dim {dim}, {}", describe(&options));
        }
    }
}

#[test]
fn linkage_tied_points_with_many_axes_equals_chain() {
    let mut noise = Noise(0x0dd5_5678_9abc_0003);
    for round in 0..36 {
        let n = 2 + noise.below(400);
        let (kind, dim) = (round % N_TIED_KINDS, 30 + noise.below(300));
        let points = tied_cloud(kind, n, dim, &mut noise);
        let expected = linkage_by_chain(&points, dim);
        let on_matrix = Options { threads: 2, ..Options::default() };
        for options in [on_matrix, noise.tuned_options()] {
            let tree = linkage(Table::rows(&points, dim), &options).unwrap();
            assert!(tree == expected, "kind {kind}, n {n}, dim {dim}, {}", describe(&options));
        }
    }
}

#[test]
fn linkage_any_layout_and_precision_gives_same_tree() {
    let mut noise = Noise(0x1a70_5678_9abc_0007);
    for kind in [0, 1, 3] {
        let (n, dim) = (300, 4);
        let points: Vec<f32> = cloud(kind, n, dim, &mut noise)
            .into_iter()
            .map(|x| x as f32)
            .collect();
        let doubles: Vec<f64> = points.iter().map(|&x| x.into()).collect();
        let columns: Vec<f32> = (0..n * dim).map(|i| points[i % n * dim + i / n]).collect();
        let options = noise.tuned_options();
        let expected = linkage(Table::rows(&doubles, dim), &options).unwrap();
        assert!(linkage(Table::rows(&points, dim), &options).unwrap() == expected);
        assert!(linkage(Table::columns(&columns, dim), &options).unwrap() == expected);
        let labels = cut(Table::columns(&columns, dim), 1.0, &options).unwrap();
        assert_eq!(labels, cut(Table::rows(&doubles, dim), 1.0, &options).unwrap());
    }
}

#[test]
fn linkage_few_large_clusters_equals_chain() {
    // Clusters of many points need the sweeps and the selection of candidates.
    let mut noise = Noise(0xfeed_5678_9abc_0001);
    for round in 0..12 {
        let dim = 1 + noise.below(6);
        let kind = round % N_KINDS;
        let mut points = cloud(kind, 900, dim, &mut noise);
        for (i, point) in points.chunks_mut(dim).enumerate() {
            point[0] += if kind < 3 { (i % 5) as f64 * 4.0 } else { 0.0 };
        }
        let expected = linkage_by_chain(&points, dim);
        let options = noise.tuned_options();
        let tree = linkage(Table::rows(&points, dim), &options).unwrap();
        assert!(tree == expected, "kind {kind}, dim {dim}, {}", describe(&options));
    }
}

/// Compare three tunings with the tree by default, and the cut with that of the tree.
fn assert_tunings_agree(n: usize) {
    let tuning = |level, degree, dense_size, spare_edges| {
        let default = Tuning::default();
        Tuning { level, degree, dense_size, spare_edges, matrix_size: 0, ..default }
    };
    let tunings = [
        (1, tuning(Level::Baseline, 16.0, 256, 1 << 20)),
        (2, tuning(Level::Avx2, 6.0, 2, 1 << 20)),
        (3, tuning(Level::Avx512, 40.0, 1000, 1 << 10)),
    ];
    let mut noise = Noise(0x0123_4567_89ab_cdef);
    for kind in 0..N_KINDS {
        // Binary points in few dimensions are few places; ten dimensions keep 1,024.
        let points = cloud(kind, n, 10, &mut noise);
        let expected = linkage(Table::rows(&points, 10), &Options::default()).unwrap();
        if n <= 5_000 {
            assert!(expected == linkage_by_chain(&points, 10), "kind {kind}");
        }
        for (threads, tuning) in tunings {
            let options = Options { threads, max_matrix_bytes: 0, tuning, ..Options::default() };
            let tree = linkage(Table::rows(&points, 10), &options).unwrap();
            assert!(tree == expected, "kind {kind}, {}", describe(&options));
        }
        let diameter = expected[n * 9 / 10][2];
        let options = Options { threads: 2, max_matrix_bytes: 0, ..Options::default() };
        let labels = cut(Table::rows(&points, 10), diameter, &options).unwrap();
        assert!(labels == labels_of_tree(&expected, diameter), "kind {kind}");
    }
}

#[test]
fn linkage_2500_points_is_same_for_all_tunings() {
    assert_tunings_agree(2_500);
}

#[test]
#[ignore = "takes minutes: cargo test --release -p mograft-linkage -- --ignored"]
fn linkage_20000_points_is_same_for_all_tunings() {
    assert_tunings_agree(20_000);
}

#[test]
fn cut_hard_small_clouds_equals_cut_of_tree() {
    let mut noise = Noise(0x0bad_cafe_1234_5678);
    for round in 0..200 {
        let (n, dim) = (2 + noise.below(120), 1 + noise.below(5));
        let kind = round % N_KINDS;
        let points = cloud(kind, n, dim, &mut noise);
        let tree = linkage_by_chain(&points, dim);
        let height = tree[noise.below(n - 1)][2];
        for diameter in [height, height.next_down().max(0.0), height.next_up(), 0.0] {
            let labels = cut(Table::rows(&points, dim), diameter, &noise.tuned_options()).unwrap();
            assert_eq!(labels, labels_of_tree(&tree, diameter), "kind {kind}, {diameter}");
        }
    }
}

#[test]
fn linkage_plateau_after_nearer_pair_equals_chain() {
    // A grid whose edges are too many and of one length, and one shorter pair far away from it.
    let mut points: Vec<f64> = (0..1000)
        .flat_map(|i| [i % 10, i / 10 % 10, i / 100].map(f64::from))
        .collect();
    points.extend([1e3, 0.0, 0.0, 1e3 + 0.5, 0.0, 0.0]);
    let tuning = Tuning { degree: 0.5, dense_size: 2, spare_edges: 0, ..Tuning::default() };
    let options = Options { max_matrix_bytes: 0, tuning, ..Options::default() };
    assert!(linkage(Table::rows(&points, 3), &options).unwrap() == linkage_by_chain(&points, 3));
}

#[test]
fn linkage_condensed_on_matrix_equals_chain() {
    let mut noise = Noise(0x7777_5678_0000_1111);
    for round in 0..60 {
        let n = 1 + noise.below(300);
        // Distances without geometry, with no ties, many ties or ties alone.
        let n_steps = [8.0, 1e9, 0.0, 1.0][round % 4];
        let distances: Vec<f64> = (0..n * (n - 1) / 2)
            .map(|_| (noise.uniform() * n_steps).round())
            .collect();
        let options = Options { threads: 1 + noise.below(2), ..Options::default() };
        let by_chain = Options { max_matrix_bytes: 0, ..options };
        let expected = linkage_condensed(&distances, &by_chain).unwrap();
        assert!(linkage_condensed(&distances, &options).unwrap() == expected);
    }
}

#[test]
fn invalid_input_returns_error() {
    let options = Options::default();
    let error = |points: &[f64], dim| linkage(Table::rows(points, dim), &options).unwrap_err();
    assert_eq!(error(&[0.0; 5], 2), Error::InvalidShape { len: 5, dim: 2 });
    assert_eq!(error(&[], 0), Error::InvalidShape { len: 0, dim: 0 });
    assert_eq!(
        error(&[0.0, 1.0, f64::INFINITY], 1),
        Error::InvalidCoordinate { point: 2, axis: 0, value: f64::INFINITY }
    );
    let nan = error(&[0.0, 1.0, f64::NAN, 0.0], 2).to_string();
    assert_eq!(nan, "`points` must be finite, got NaN at [1, 0]");
    assert_eq!(
        cut(Table::rows(&[0.0], 1), -1.0, &options),
        Err(Error::InvalidDiameter { value: -1.0 })
    );
    assert!(cut(Table::rows(&[0.0], 1), f64::NAN, &options).is_err());
    assert_eq!(linkage_condensed(&[1.0; 2], &options), Err(Error::InvalidLength { len: 2 }));
    assert_eq!(
        linkage_condensed(&[1.0, 2.0, -1.0, f64::NAN, 0.0, 0.0], &options),
        Err(Error::InvalidDistance { index: 2, value: -1.0 })
    );
    let columns = Table::columns(&[0.0, 1.0, f64::NAN, 0.0, f64::INFINITY, 0.0], 2);
    assert_eq!(
        linkage(columns, &options),
        Err(Error::InvalidCoordinate { point: 1, axis: 1, value: f64::INFINITY })
    );
}

#[test]
fn memory_limit_below_need_returns_error() {
    let options = Options { max_bytes: 1000, ..Options::default() };
    let error = linkage(Table::rows(&[0.0; 100], 2), &options).unwrap_err();
    assert!(matches!(error, Error::MemoryLimit { needed: 1001.., limit: 1000 }));
    let error = linkage_condensed(&[1.0; 190], &options).unwrap_err();
    assert_eq!(error, Error::MemoryLimit { needed: 1520, limit: 1000 });
    assert!(linkage_condensed(&[1.0; 105], &options).is_ok());
}

#[test]
fn progress_callback_returning_false_stops_linkage() {
    let mut noise = Noise(0x5555_4444_3333_2222);
    let points = cloud(0, 3000, 3, &mut noise);
    let stop = |_: f64| ControlFlow::Break(());
    let options = Options { max_matrix_bytes: 0, progress: Some(&stop), ..Options::default() };
    assert_eq!(linkage(Table::rows(&points, 3), &options), Err(Error::Stopped));
}
