//! The instruction set that inner loops use; it is detected at run time.
#![allow(unsafe_code, reason = "calls of functions compiled for detected instruction sets")]

/// An instruction set that this processor has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Isa(Level);

/// The instruction sets that inner loops are compiled for, narrowest first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Level {
    /// The set that every processor of the target has; SSE2 on x86-64.
    Baseline,
    /// AVX2 with fused multiplication and addition.
    Avx2,
    /// AVX-512 (F, BW, DQ, VL).
    Avx512,
}

impl Isa {
    /// The widest set that this processor has, at most `level`.
    #[inline]
    pub fn up_to(level: Level) -> Self {
        #[cfg(target_arch = "x86_64")]
        {
            let has_avx2 = is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma");
            let has_avx512 = is_x86_feature_detected!("avx512f")
                && is_x86_feature_detected!("avx512bw")
                && is_x86_feature_detected!("avx512dq")
                && is_x86_feature_detected!("avx512vl");
            if level >= Level::Avx512 && has_avx2 && has_avx512 {
                return Self(Level::Avx512);
            }
            if level >= Level::Avx2 && has_avx2 {
                return Self(Level::Avx2);
            }
        }
        let _ = level;
        Self(Level::Baseline)
    }

    /// The widest set that this processor has.
    #[inline]
    pub fn best() -> Self {
        Self::up_to(Level::Avx512)
    }

    /// The level of this set.
    #[inline]
    pub fn level(self) -> Level {
        self.0
    }

    /// Run loops compiled for AVX2 if this set includes it, or else for the baseline.
    ///
    /// Neither fuses multiplication and addition, so that the results have the same bits.
    #[inline]
    pub fn run(self, loops: impl Loops) {
        #[cfg(target_arch = "x86_64")]
        {
            #[target_feature(enable = "avx2")]
            fn avx2(loops: impl Loops) {
                loops.run();
            }
            if self.0 >= Level::Avx2 {
                // SAFETY: an `Isa` of this level exists only if `Isa::up_to` found that the
                // processor has AVX2, the only feature that is enabled on `avx2`.
                return unsafe { avx2(loops) };
            }
        }
        loops.run();
    }
}

/// Loops that [`Isa::run`] compiles for each set: `run` and what it calls must be inlined.
pub trait Loops {
    /// Run the loops.
    fn run(self);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn isa_is_at_most_the_requested_level() {
        for level in [Level::Baseline, Level::Avx2, Level::Avx512] {
            assert!(Isa::up_to(level).level() <= level);
        }
        assert_eq!(Isa::best(), Isa::up_to(Level::Avx512));
    }
}
