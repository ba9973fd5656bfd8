//! The algorithms of the crate on one thread: `cargo bench -p mograft-linkage`.
#![allow(missing_docs, reason = "the macros of criterion make public functions")]

use criterion::{Criterion, criterion_group, criterion_main};
use mograft_linkage::{Options, Table, cut, linkage, linkage_condensed};

/// Reproducible numbers, approximately normal (xorshift; Marsaglia 2003).
fn noise(count: usize) -> Vec<f64> {
    let mut state = 0x1234_5678_9abc_def1_u64;
    let mut uniform = || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 11) as f64 / (1_u64 << 53) as f64
    };
    (0..count)
        .map(|_| (0..12).map(|_| uniform()).sum::<f64>() - 6.0)
        .collect()
}

fn bench(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("linkage");
    group.sample_size(10);
    let options = Options::default();
    let white = noise(100_000);
    group.bench_function("tree, 10,000 points of noise with 10 axes", |bencher| {
        bencher.iter(|| linkage(Table::rows(&white, 10), &options));
    });
    group.bench_function("cut at 3, 10,000 points of noise with 10 axes", |bencher| {
        bencher.iter(|| cut(Table::rows(&white, 10), 3.0, &options));
    });
    let bits: Vec<f64> = noise(500 * 1000)
        .iter()
        .map(|&x| f64::from(x > 1.6))
        .collect();
    group.bench_function("tree on the matrix, 1,000 fingerprints of 500 bits", |bencher| {
        bencher.iter(|| linkage(Table::rows(&bits, 500), &options));
    });
    let distances: Vec<f64> = noise(1000 * 999 / 2).iter().map(|x| x.abs()).collect();
    for (name, max_matrix_bytes) in [("full matrix", usize::MAX), ("condensed matrix", 0)] {
        let options = Options { max_matrix_bytes, ..options };
        group.bench_function(format!("1,000 points, {name}"), |bencher| {
            bencher.iter(|| linkage_condensed(&distances, &options));
        });
    }
    group.finish();
}

criterion_group!(benches, bench);
criterion_main!(benches);
