//! Vectors of sixteen f64 for every instruction set; see [`vectors`](super::vectors).
//!
//! Every lane holds the bits of scalar arithmetic: nothing is fused.

use super::LANES;

/// Sixteen lanes of f64 in the registers of an instruction set.
pub(super) trait F64x16: Copy {
    /// Whether the registers hold the sums of four rows, not of two.
    const HOLDS_FOUR: bool;

    fn load(lanes: &[f64; LANES]) -> Self;
    fn store(self, lanes: &mut [f64; LANES]);
    fn splat(x: f64) -> Self;
    /// `self + (other - x)²`, rounded after each operation.
    fn add_squared_difference(self, other: Self, x: Self) -> Self;
}

/// Vectors of the baseline set, which the compiler forms out of an array.
#[derive(Clone, Copy)]
pub(super) struct BaselineF64([f64; LANES]);

impl F64x16 for BaselineF64 {
    const HOLDS_FOUR: bool = false;

    #[inline(always)]
    fn load(lanes: &[f64; LANES]) -> Self {
        Self(*lanes)
    }
    #[inline(always)]
    fn store(self, lanes: &mut [f64; LANES]) {
        *lanes = self.0;
    }
    #[inline(always)]
    fn splat(x: f64) -> Self {
        Self([x; LANES])
    }
    #[inline(always)]
    fn add_squared_difference(self, other: Self, x: Self) -> Self {
        let mut sums = self.0;
        for (sum, (other, x)) in sums.iter_mut().zip(other.0.iter().zip(&x.0)) {
            let difference = other - x;
            *sum += difference * difference;
        }
        Self(sums)
    }
}

/// Vectors of the instruction sets beyond the baseline of x86-64.
#[cfg(target_arch = "x86_64")]
pub(super) mod x86 {
    use std::arch::x86_64::{
        __m256d, __m512d, _mm256_add_pd, _mm256_loadu_pd, _mm256_mul_pd, _mm256_set1_pd,
        _mm256_storeu_pd, _mm256_sub_pd, _mm512_add_pd, _mm512_loadu_pd, _mm512_mul_pd,
        _mm512_set1_pd, _mm512_storeu_pd, _mm512_sub_pd,
    };

    use super::{F64x16, LANES};

    /// Four AVX registers.
    #[derive(Clone, Copy)]
    pub(in crate::simd) struct Avx2F64(__m256d, __m256d, __m256d, __m256d);

    /// Two AVX-512 registers.
    #[derive(Clone, Copy)]
    pub(in crate::simd) struct Avx512F64(__m512d, __m512d);

    impl F64x16 for Avx2F64 {
        const HOLDS_FOUR: bool = false;

        #[inline(always)]
        fn load(lanes: &[f64; LANES]) -> Self {
            let start = lanes.as_ptr();
            // SAFETY: the caller is compiled for AVX2, which includes AVX. The four loads read 4
            // each of the 16 f64 at `start` and need no alignment.
            unsafe {
                Self(
                    _mm256_loadu_pd(start),
                    _mm256_loadu_pd(start.add(4)),
                    _mm256_loadu_pd(start.add(8)),
                    _mm256_loadu_pd(start.add(12)),
                )
            }
        }
        #[inline(always)]
        fn store(self, lanes: &mut [f64; LANES]) {
            let start = lanes.as_mut_ptr();
            // SAFETY: the caller is compiled for AVX2, which includes AVX. The four stores write 4
            // each of the 16 f64 at `start`, exclusively by `&mut`, and need no alignment.
            unsafe {
                _mm256_storeu_pd(start, self.0);
                _mm256_storeu_pd(start.add(4), self.1);
                _mm256_storeu_pd(start.add(8), self.2);
                _mm256_storeu_pd(start.add(12), self.3);
            }
        }
        #[inline(always)]
        fn splat(x: f64) -> Self {
            // SAFETY: the caller is compiled for AVX2; `_mm256_set1_pd` needs AVX alone.
            let x = unsafe { _mm256_set1_pd(x) };
            Self(x, x, x, x)
        }
        #[inline(always)]
        fn add_squared_difference(self, other: Self, x: Self) -> Self {
            #[inline(always)]
            fn add(sum: __m256d, other: __m256d, x: __m256d) -> __m256d {
                // SAFETY: the caller is compiled for AVX2; the intrinsics need AVX alone.
                unsafe {
                    let difference = _mm256_sub_pd(other, x);
                    _mm256_add_pd(sum, _mm256_mul_pd(difference, difference))
                }
            }
            Self(
                add(self.0, other.0, x.0),
                add(self.1, other.1, x.1),
                add(self.2, other.2, x.2),
                add(self.3, other.3, x.3),
            )
        }
    }

    impl F64x16 for Avx512F64 {
        const HOLDS_FOUR: bool = true;

        #[inline(always)]
        fn load(lanes: &[f64; LANES]) -> Self {
            let start = lanes.as_ptr();
            // SAFETY: the caller is compiled for AVX-512 F. Both loads read 8 of the 16 f64 at
            // `start` and need no alignment.
            unsafe { Self(_mm512_loadu_pd(start), _mm512_loadu_pd(start.add(8))) }
        }
        #[inline(always)]
        fn store(self, lanes: &mut [f64; LANES]) {
            let start = lanes.as_mut_ptr();
            // SAFETY: the caller is compiled for AVX-512 F. Both stores write 8 of the 16 f64 at
            // `start`, exclusively by `&mut`, and need no alignment.
            unsafe {
                _mm512_storeu_pd(start, self.0);
                _mm512_storeu_pd(start.add(8), self.1);
            }
        }
        #[inline(always)]
        fn splat(x: f64) -> Self {
            // SAFETY: the caller is compiled for AVX-512 F, which `_mm512_set1_pd` needs.
            let x = unsafe { _mm512_set1_pd(x) };
            Self(x, x)
        }
        #[inline(always)]
        fn add_squared_difference(self, other: Self, x: Self) -> Self {
            // SAFETY: the caller is compiled for AVX-512 F, which all intrinsics need.
            unsafe {
                let (low, high) = (_mm512_sub_pd(other.0, x.0), _mm512_sub_pd(other.1, x.1));
                Self(
                    _mm512_add_pd(self.0, _mm512_mul_pd(low, low)),
                    _mm512_add_pd(self.1, _mm512_mul_pd(high, high)),
                )
            }
        }
    }
}
