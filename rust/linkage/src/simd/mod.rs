//! Inner loops, compiled for three instruction sets; the set is chosen at run time.
//!
//! Every loop is written over sixteen lanes. The instruction sets differ in the width of their
//! vectors only; results do not depend on the set, except as stated for f32:
//!
//! * Loops in f64 compute results. They add coordinates in order and never fuse a multiplication
//!   with an addition. Every lane holds the bits of scalar arithmetic, which are those of SciPy's
//!   `pdist`.
//! * Loops in f32 only exclude pairs from exact measurement. They may fuse a multiplication with
//!   an addition. Their rounding error is bounded by [`f32_sum_error`], and every caller allows
//!   for it.
//!
//! | module | contents |
//! |---|---|
//! | [`vectors`] | vectors of sixteen f32 for every instruction set |
//! | [`doubles`] | vectors of sixteen f64 for every instruction set |
//! | [`filters`] | which boxes, blocks and lanes may be within a limit |
//! | [`reductions`] | distances of one point to many; minimum and maximum of rows |
//!
//! # Unsafe code
//!
//! All `unsafe` code of the crate is in this module: in the macro `dispatch!`, because a function
//! compiled for an instruction set may only be called if the processor has that set, and in the
//! methods of [`vectors`] and [`doubles`], which only such functions call. `Isa::up_to` is the only constructor
//! of an `Isa` above the baseline, and it checks the processor.
//!
//! The tests of this module run without findings under the address sanitizer with AVX-512, under
//! Valgrind with AVX2 (the widest set that Valgrind supports) and under Miri with the baseline:
//!
//! ```text
//! RUSTFLAGS=-Zsanitizer=address cargo +nightly test -p mograft-linkage --lib \
//!     --target x86_64-unknown-linux-gnu
//! valgrind target/release/deps/mograft_linkage-… simd
//! cargo +nightly miri test -p mograft-linkage --lib simd
//! ```
#![allow(unsafe_code, reason = "calls of functions compiled for detected instruction sets")]
#![allow(clippy::inline_always, reason = "vectors must stay in registers across these functions")]
#![allow(clippy::too_many_arguments, reason = "inner loops read flat slices")]

use std::ops::{Deref, DerefMut};

/// Define a function that runs `$body`, compiled for the instruction set of its first argument.
///
/// `$body` is generic over the vectors of the set, [`vectors::F32x16`].
macro_rules! dispatch {
    ($(#[$doc:meta])* $name:ident = $body:ident($($arg:ident: $type:ty),*) $(-> $out:ty)?) => {
        $(#[$doc])*
        #[inline]
        pub(crate) fn $name(isa: mograft_machine::instructions::Isa, $($arg: $type),*) $(-> $out)? {
            #[cfg(target_arch = "x86_64")]
            {
                use $crate::simd::vectors::x86::{Avx2, Avx512};

                #[target_feature(enable = "avx2,fma")]
                fn avx2($($arg: $type),*) $(-> $out)? {
                    $body::<Avx2>($($arg),*)
                }
                #[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl")]
                fn avx512($($arg: $type),*) $(-> $out)? {
                    $body::<Avx512>($($arg),*)
                }
                match isa.level() {
                    // SAFETY: an `Isa` of this level exists only if `Isa::up_to` found that the
                    // processor has every feature that is enabled on `avx512`.
                    mograft_machine::instructions::Level::Avx512 => return unsafe { avx512($($arg),*) },
                    // SAFETY: an `Isa` of this level exists only if `Isa::up_to` found that the
                    // processor has every feature that is enabled on `avx2`.
                    mograft_machine::instructions::Level::Avx2 => return unsafe { avx2($($arg),*) },
                    mograft_machine::instructions::Level::Baseline => {}
                }
            }
            let _ = isa;
            $body::<$crate::simd::vectors::Baseline>($($arg),*)
        }
    };
}

mod doubles;
mod filters;
mod reductions;
#[cfg(test)]
mod tests;
mod vectors;

pub(crate) use filters::{Block, Query, blocks_within, boxes_within};
pub(crate) use reductions::{
    QUERIES, TILE_ROWS, add_squares, first_position, max_of_rows, maximize, minimum,
    squared_bounds, squared_distances,
};

/// Lanes of a vector: points or clusters that are handled side by side.
pub(crate) const LANES: usize = 16;

/// Sixteen numbers, aligned to a cache line.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(align(64))]
pub(crate) struct Aligned<T>(pub [T; LANES]);

impl<T> Deref for Aligned<T> {
    type Target = [T; LANES];

    #[inline(always)]
    fn deref(&self) -> &[T; LANES] {
        &self.0
    }
}

impl<T> DerefMut for Aligned<T> {
    #[inline(always)]
    fn deref_mut(&mut self) -> &mut [T; LANES] {
        &mut self.0
    }
}

/// One coordinate of sixteen points or clusters in f32, for filters.
pub(crate) type F32Lanes = Aligned<f32>;

/// One coordinate of sixteen points or clusters in f64, for results.
pub(crate) type F64Lanes = Aligned<f64>;

/// Upper bound of the relative rounding error of a sum of `dim` squares in f32.
pub(crate) fn f32_sum_error(dim: usize) -> f64 {
    // Each of `dim` squares and `dim + 1` additions rounds by at most half a unit of 2^-23;
    // the remaining margin covers the products of these errors.
    (dim as f64 + 4.0) / f64::from(1 << 23)
}
