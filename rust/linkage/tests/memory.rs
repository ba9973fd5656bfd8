//! A refused allocation is an error, whichever of the large ones of a call it is.
#![allow(unsafe_code, reason = "an allocator that refuses memory")]

#[allow(dead_code, reason = "other tests use the rest")]
mod common;

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicUsize, Ordering::SeqCst};

use common::{Noise, cloud};
use mograft_linkage::{Error, Options, Table, Tuning, cut, linkage, linkage_condensed};

/// Allocations of at least this many bytes may be refused.
const LARGE: usize = 2_000;

/// Refusals that are tried for a call, evenly spaced if it makes more large allocations.
const MAX_REFUSALS: usize = 80;

/// Large allocations until one is refused; [`usize::MAX`] for none.
static REMAINING: AtomicUsize = AtomicUsize::new(usize::MAX);

struct Refusing;

/// Whether an allocation of `size` bytes is refused.
fn is_refused(size: usize) -> bool {
    let is_counted = size >= LARGE && REMAINING.load(SeqCst) != usize::MAX;
    is_counted && REMAINING.fetch_sub(1, SeqCst) == 0
}

// SAFETY: all memory is that of the system's allocator; a null pointer means that there is none.
unsafe impl GlobalAlloc for Refusing {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        if is_refused(layout.size()) {
            return std::ptr::null_mut();
        }
        // SAFETY: as for this function.
        unsafe { System.alloc(layout) }
    }

    unsafe fn realloc(&self, ptr: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        if size > layout.size() && is_refused(size) {
            return std::ptr::null_mut();
        }
        // SAFETY: as for this function.
        unsafe { System.realloc(ptr, layout, size) }
    }

    unsafe fn dealloc(&self, ptr: *mut u8, layout: Layout) {
        // SAFETY: as for this function.
        unsafe { System.dealloc(ptr, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Refusing = Refusing;

/// Refuse large allocations of a call, one each time; return how many it makes.
fn count_refusals<T>(call: impl Fn() -> Result<T, Error>) -> usize {
    let run = |n_before: usize| {
        REMAINING.store(n_before, SeqCst);
        let result = call();
        let n_left = REMAINING.swap(usize::MAX, SeqCst);
        (result.map(drop), n_before.wrapping_sub(n_left))
    };
    let (result, total) = run(usize::MAX / 2);
    assert_eq!(result, Ok(()));
    for n_before in (0..total).step_by(total.div_ceil(MAX_REFUSALS)) {
        match run(n_before) {
            // A vector that grows requests twice the bytes that it needs.
            (Err(Error::OutOfMemory { bytes }), _) => assert!(2 * bytes >= LARGE),
            // Without the address space for a thread, the call takes fewer.
            (Ok(()), _) if n_before == 0 => {}
            // Which thread does a job changes the number of allocations.
            (Ok(()), n_made) if n_made <= n_before => {}
            (result, _) => panic!("allocation {n_before} of {total}: {result:?}"),
        }
    }
    total
}

#[test]
fn refused_allocation_is_an_error_whichever_it_is() {
    let in_stages = Options { max_matrix_bytes: 0, ..Options::default() };
    let (n, dim) = (2_200, 3);
    // No ties, every point four times, and radii of all sizes.
    for kind in [0, 3, 6] {
        let points = cloud(kind, n, dim, &mut Noise(1));
        let options = Options { threads: if kind == 0 { 2 } else { 1 }, ..in_stages };
        let table = Table::rows(&points, dim);
        assert!(count_refusals(|| linkage(table, &options)) > 100);
    }
    let points = cloud(0, n, dim, &mut Noise(2));
    let columns = Table::columns(&points, dim);
    assert!(count_refusals(|| cut(columns, 0.1, &in_stages)) > 20);
    // Too many equal distances for edges.
    let points = cloud(2, 600, 12, &mut Noise(3));
    let tuning = Tuning { spare_edges: 0, degree: 0.5, ..Tuning::default() };
    let few_edges = Options { tuning, ..in_stages };
    let table = Table::rows(&points, 12);
    assert!(count_refusals(|| linkage(table, &few_edges)) > 20);
    // On the matrix of points, and on that of all distances.
    let points = cloud(0, 300, 12, &mut Noise(4));
    let table = Table::rows(&points, 12);
    assert!(count_refusals(|| linkage(table, &Options::default())) > 300);
    let distances: Vec<f64> = (1..=200 * 199 / 2).map(f64::from).collect();
    assert!(count_refusals(|| linkage_condensed(&distances, &in_stages)) > 1);
}
