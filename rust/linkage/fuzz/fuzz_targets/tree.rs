//! The tree of any points, by stages and on the matrix: `python -m tests.fuzz_rust 600 tree`.
//!
//! The first byte is the count of axes, the second selects the tuning; the others are coordinates.
#![no_main]

use libfuzzer_sys::fuzz_target;
use mograft_linkage::{Options, Table, Tuning, cut, linkage};

fuzz_target!(|data: &[u8]| {
    let [dim, tuning, rest @ ..] = data else { return };
    let dim = usize::from(dim % 40 + 1);
    let numbers: Vec<f32> = (rest.as_chunks::<4>().0.iter())
        .map(|bytes| f32::from_le_bytes(*bytes))
        .collect();
    let points = Table::rows(&numbers[..numbers.len() / dim * dim], dim);
    let on_matrix = Options { max_matrix_bytes: usize::MAX, ..Options::default() };
    let tuning = Tuning {
        degree: f64::from(tuning % 8) + 0.5,
        dense_size: usize::from(tuning / 8 % 8),
        spare_edges: usize::from(tuning / 64) * 100,
        ..Tuning::default()
    };
    let by_stages = Options { threads: 2, max_matrix_bytes: 0, tuning, ..on_matrix };
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
