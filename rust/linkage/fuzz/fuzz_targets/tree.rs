//! The tree of any points, by stages and on the matrix: `python -m tests.fuzz_rust 600 tree`.
//!
//! The first byte is the count of axes, the second selects the tuning, and the third selects the
//! threads and the type of coordinates; the others are coordinates. One thread and few points take
//! about a millisecond.
#![no_main]

use libfuzzer_sys::fuzz_target;
use mograft_linkage::{Options, Table, Tuning, cut, linkage};

/// Largest count of points. Blocks have sixteen clusters: this is more than three of them.
const MAX_POINTS: usize = 56;

/// Third bytes from which two threads are used: starting them takes most of the time.
const MIN_THREADED_MODE: u8 = 0xfc;

fuzz_target!(|data: &[u8]| {
    let [dim, tuning, mode, rest @ ..] = data else { return };
    let dim = usize::from(dim % 20 + 1);
    let mut numbers: Vec<f32> = if mode % 2 == 0 {
        // Whole numbers, with many equal distances and equal points.
        rest.iter().map(|&byte| f32::from(byte.cast_signed())).collect()
    } else {
        let quadruples = rest.as_chunks::<4>().0.iter();
        quadruples.map(|bytes| f32::from_le_bytes(*bytes)).collect()
    };
    numbers.truncate(numbers.len().min(MAX_POINTS * dim) / dim * dim);
    let points = Table::rows(&numbers, dim);
    let on_matrix = Options {
        threads: 1,
        max_matrix_bytes: usize::MAX,
        max_bytes: usize::MAX,
        progress: None,
        tuning: Tuning::default(),
    };
    let tuning = Tuning {
        degree: f64::from(tuning % 8) + 0.5,
        dense_size: usize::from(tuning / 8 % 8),
        split_size: usize::from(mode / 2 % 4) * 8,
        spare_edges: usize::from(tuning / 64) * 100,
        ..Tuning::default()
    };
    let threads = if *mode >= MIN_THREADED_MODE { 2 } else { 1 };
    let by_stages = Options { threads, max_matrix_bytes: 0, tuning, ..on_matrix };
    // Errors are compared as text, because they may hold NaN.
    let tree_of = |options| linkage(points, options).map_err(|error| error.to_string());
    let tree = tree_of(&on_matrix);
    assert_eq!(tree, tree_of(&by_stages));
    if let Ok(tree) = tree
        && let Some(row) = tree.get(tree.len() / 2)
    {
        assert_eq!(cut(points, row[2], &on_matrix), cut(points, row[2], &by_stages));
    }
});
