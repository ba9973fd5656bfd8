//! Vectors of sixteen f32 for every instruction set.
//!
//! Only the functions that `dispatch!` compiles for an instruction set use the vectors of that
//! set; the methods are inlined into them. The visibility of this module keeps the rest of the
//! crate from naming these types.

use super::doubles::{BaselineF64, F64x16};
use super::{Aligned, F32Lanes, LANES};

/// Sixteen lanes of f32 in the registers of an instruction set.
pub(super) trait F32x16: Copy {
    /// Sixteen lanes of f64 in the same instruction set.
    type F64: F64x16;

    fn load(lanes: &F32Lanes) -> Self;
    fn store(self, lanes: &mut F32Lanes);
    fn splat(x: f32) -> Self;
    fn add(self, other: Self) -> Self;
    fn sub(self, other: Self) -> Self;
    fn abs(self) -> Self;
    /// The larger of each pair of lanes; the lane of `other` if either is NaN.
    fn max(self, other: Self) -> Self;
    /// `self * self + sum`, rounded once or twice.
    fn square_add(self, sum: Self) -> Self;
    /// Bit `i` is set if lane `i` is at most that of `other`; never for NaN.
    fn le_mask(self, other: Self) -> u16;
}

/// Add the squared difference of `x` and each lane to `sums`.
#[inline(always)]
pub(super) fn add_squared_difference<V: F32x16>(sums: &mut V, lanes: V, x: f32) {
    *sums = lanes.sub(V::splat(x)).square_add(*sums);
}

/// The largest lane. Each step compares one half of the remaining lanes with the other half, in one
/// vector operation.
#[inline(always)]
pub(super) fn max_lane<V: F32x16>(vector: V) -> f32 {
    let mut lanes = Aligned([0.0; LANES]);
    vector.store(&mut lanes);
    let mut half = LANES / 2;
    while half > 0 {
        for lane in 0..half {
            lanes[lane] = lanes[lane].max(lanes[lane + half]);
        }
        half /= 2;
    }
    lanes[0]
}

/// Vectors of the baseline set, which the compiler forms out of an array.
#[derive(Clone, Copy)]
pub(super) struct Baseline(F32Lanes);

impl Baseline {
    #[inline(always)]
    fn zip(self, other: Self, f: impl Fn(f32, f32) -> f32) -> Self {
        let mut lanes = self.0;
        for (x, &y) in lanes.iter_mut().zip(other.0.iter()) {
            *x = f(*x, y);
        }
        Self(lanes)
    }
}

impl F32x16 for Baseline {
    type F64 = BaselineF64;

    #[inline(always)]
    fn load(lanes: &F32Lanes) -> Self {
        Self(*lanes)
    }
    #[inline(always)]
    fn store(self, lanes: &mut F32Lanes) {
        *lanes = self.0;
    }
    #[inline(always)]
    fn splat(x: f32) -> Self {
        Self(Aligned([x; LANES]))
    }
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        self.zip(other, |x, y| x + y)
    }
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        self.zip(other, |x, y| x - y)
    }
    #[inline(always)]
    fn abs(self) -> Self {
        Self(Aligned(self.0.map(f32::abs)))
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        self.zip(other, |x, y| if x > y { x } else { y })
    }
    #[inline(always)]
    fn square_add(self, sum: Self) -> Self {
        self.zip(sum, |x, sum| x * x + sum)
    }
    #[inline(always)]
    fn le_mask(self, other: Self) -> u16 {
        // Each lane computes its own bit. The bits are merged by halving, so that each step is
        // one vector operation.
        let mut bits = [0_u32; LANES];
        for (lane, (bit, (x, y))) in bits
            .iter_mut()
            .zip(self.0.iter().zip(other.0.iter()))
            .enumerate()
        {
            *bit = u32::from(x <= y) << lane;
        }
        let mut half = LANES / 2;
        while half > 0 {
            for lane in 0..half {
                bits[lane] |= bits[lane + half];
            }
            half /= 2;
        }
        bits[0] as u16
    }
}

/// Vectors of the instruction sets beyond the baseline of x86-64.
#[cfg(target_arch = "x86_64")]
pub(super) mod x86 {
    use std::arch::x86_64::{
        __m256, __m512, _CMP_LE_OQ, _mm256_add_ps, _mm256_andnot_ps, _mm256_cmp_ps,
        _mm256_fmadd_ps, _mm256_loadu_ps, _mm256_max_ps, _mm256_movemask_ps, _mm256_set1_ps,
        _mm256_storeu_ps, _mm256_sub_ps, _mm512_abs_ps, _mm512_add_ps, _mm512_cmp_ps_mask,
        _mm512_fmadd_ps, _mm512_loadu_ps, _mm512_max_ps, _mm512_set1_ps, _mm512_storeu_ps,
        _mm512_sub_ps,
    };

    use super::{F32Lanes, F32x16};
    use crate::simd::doubles::x86::{Avx2F64, Avx512F64};

    /// Two AVX registers: lanes 0 to 7 and lanes 8 to 15.
    #[derive(Clone, Copy)]
    pub(in crate::simd) struct Avx2(__m256, __m256);

    /// One AVX-512 register.
    #[derive(Clone, Copy)]
    pub(in crate::simd) struct Avx512(__m512);

    impl F32x16 for Avx2 {
        type F64 = Avx2F64;

        #[inline(always)]
        fn load(lanes: &F32Lanes) -> Self {
            let start = lanes.as_ptr();
            // SAFETY: the caller is compiled for AVX2, which includes AVX. Both loads read 8 of
            // the 16 f32 at `start` and need no alignment.
            unsafe { Self(_mm256_loadu_ps(start), _mm256_loadu_ps(start.add(8))) }
        }
        #[inline(always)]
        fn store(self, lanes: &mut F32Lanes) {
            let start = lanes.as_mut_ptr();
            // SAFETY: the caller is compiled for AVX2, which includes AVX. Both stores write 8 of
            // the 16 f32 at `start`, exclusively by `&mut`, and need no alignment.
            unsafe {
                _mm256_storeu_ps(start, self.0);
                _mm256_storeu_ps(start.add(8), self.1);
            }
        }
        #[inline(always)]
        fn splat(x: f32) -> Self {
            // SAFETY: the caller is compiled for AVX2; `_mm256_set1_ps` needs AVX alone.
            unsafe { Self(_mm256_set1_ps(x), _mm256_set1_ps(x)) }
        }
        #[inline(always)]
        fn add(self, other: Self) -> Self {
            // SAFETY: the caller is compiled for AVX2; `_mm256_add_ps` needs AVX alone.
            unsafe { Self(_mm256_add_ps(self.0, other.0), _mm256_add_ps(self.1, other.1)) }
        }
        #[inline(always)]
        fn sub(self, other: Self) -> Self {
            // SAFETY: the caller is compiled for AVX2; `_mm256_sub_ps` needs AVX alone.
            unsafe { Self(_mm256_sub_ps(self.0, other.0), _mm256_sub_ps(self.1, other.1)) }
        }
        #[inline(always)]
        fn abs(self) -> Self {
            // SAFETY: the caller is compiled for AVX2; both intrinsics need AVX alone.
            unsafe {
                let sign = _mm256_set1_ps(-0.0);
                Self(_mm256_andnot_ps(sign, self.0), _mm256_andnot_ps(sign, self.1))
            }
        }
        #[inline(always)]
        fn max(self, other: Self) -> Self {
            // SAFETY: the caller is compiled for AVX2; `_mm256_max_ps` needs AVX alone.
            unsafe { Self(_mm256_max_ps(self.0, other.0), _mm256_max_ps(self.1, other.1)) }
        }
        #[inline(always)]
        fn square_add(self, sum: Self) -> Self {
            // SAFETY: the caller is compiled for AVX2 and FMA; `_mm256_fmadd_ps` needs FMA.
            unsafe {
                Self(_mm256_fmadd_ps(self.0, self.0, sum.0), _mm256_fmadd_ps(self.1, self.1, sum.1))
            }
        }
        #[inline(always)]
        fn le_mask(self, other: Self) -> u16 {
            // SAFETY: the caller is compiled for AVX2; both intrinsics need AVX alone.
            unsafe {
                let low = _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LE_OQ>(self.0, other.0));
                let high = _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LE_OQ>(self.1, other.1));
                (low | high << 8) as u16
            }
        }
    }

    impl F32x16 for Avx512 {
        type F64 = Avx512F64;

        #[inline(always)]
        fn load(lanes: &F32Lanes) -> Self {
            // SAFETY: the caller is compiled for AVX-512 F. The load reads the 16 f32 of `lanes`
            // and needs no alignment.
            unsafe { Self(_mm512_loadu_ps(lanes.as_ptr())) }
        }
        #[inline(always)]
        fn store(self, lanes: &mut F32Lanes) {
            // SAFETY: the caller is compiled for AVX-512 F. The store writes the 16 f32 of
            // `lanes`, exclusively by `&mut`, and needs no alignment.
            unsafe { _mm512_storeu_ps(lanes.as_mut_ptr(), self.0) }
        }
        #[inline(always)]
        fn splat(x: f32) -> Self {
            // SAFETY: the caller is compiled for AVX-512 F, which `_mm512_set1_ps` needs.
            unsafe { Self(_mm512_set1_ps(x)) }
        }
        #[inline(always)]
        fn add(self, other: Self) -> Self {
            // SAFETY: the caller is compiled for AVX-512 F, which `_mm512_add_ps` needs.
            unsafe { Self(_mm512_add_ps(self.0, other.0)) }
        }
        #[inline(always)]
        fn sub(self, other: Self) -> Self {
            // SAFETY: the caller is compiled for AVX-512 F, which `_mm512_sub_ps` needs.
            unsafe { Self(_mm512_sub_ps(self.0, other.0)) }
        }
        #[inline(always)]
        fn abs(self) -> Self {
            // SAFETY: the caller is compiled for AVX-512 F, which `_mm512_abs_ps` needs.
            unsafe { Self(_mm512_abs_ps(self.0)) }
        }
        #[inline(always)]
        fn max(self, other: Self) -> Self {
            // SAFETY: the caller is compiled for AVX-512 F, which `_mm512_max_ps` needs.
            unsafe { Self(_mm512_max_ps(self.0, other.0)) }
        }
        #[inline(always)]
        fn square_add(self, sum: Self) -> Self {
            // SAFETY: the caller is compiled for AVX-512 F, which `_mm512_fmadd_ps` needs.
            unsafe { Self(_mm512_fmadd_ps(self.0, self.0, sum.0)) }
        }
        #[inline(always)]
        fn le_mask(self, other: Self) -> u16 {
            // SAFETY: the caller is compiled for AVX-512 F, which `_mm512_cmp_ps_mask` needs.
            unsafe { _mm512_cmp_ps_mask::<_CMP_LE_OQ>(self.0, other.0) }
        }
    }
}
