//! Inner loops compiled for several instruction sets; one is selected at run time.
//!
//! No set fuses multiplication and addition, so that the results have the same bits with each.
//! `cargo run --release -p mograft-kinematics --example vectors` prints the time with each.
#![allow(unsafe_code, reason = "calls of functions compiled for detected instruction sets")]

/// An instruction set that this processor has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Isa(Level);

/// The instruction sets that inner loops are compiled for, narrowest first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Level {
    /// The set that every processor of the target has; SSE2 on x86-64.
    Baseline,
    /// AVX2.
    Avx2,
}

impl Isa {
    /// The widest set that this processor has, at most `level`.
    #[inline]
    pub fn up_to(level: Level) -> Self {
        #[cfg(target_arch = "x86_64")]
        if level >= Level::Avx2 && is_x86_feature_detected!("avx2") {
            return Self(Level::Avx2);
        }
        let _ = level;
        Self(Level::Baseline)
    }

    /// The widest set that this processor has.
    #[inline]
    pub fn best() -> Self {
        Self::up_to(Level::Avx2)
    }

    /// The level of this set.
    pub fn level(self) -> Level {
        self.0
    }

    /// Run loops compiled for this set.
    #[inline]
    pub(crate) fn run(self, loops: impl Loops) {
        #[cfg(target_arch = "x86_64")]
        {
            #[target_feature(enable = "avx2")]
            fn avx2(loops: impl Loops) {
                loops.run();
            }
            if self.0 == Level::Avx2 {
                // SAFETY: an `Isa` of this level exists only if `Isa::up_to` found that the
                // processor has AVX2, the only feature that is enabled on `avx2`.
                return unsafe { avx2(loops) };
            }
        }
        loops.run();
    }
}

/// Loops that [`Isa::run`] compiles for each set: `run` and what it calls must be inlined.
pub(crate) trait Loops {
    /// Run the loops.
    fn run(self);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn isa_is_at_most_the_requested_level() {
        assert_eq!(Isa::up_to(Level::Baseline).level(), Level::Baseline);
        assert!(Isa::best().level() <= Level::Avx2);
    }
}
