//! Differences of rotations and of translations, behind one trait.

use glam::{DQuat, DVec3};

use crate::rotation::{exp_small, log_small};

/// The rotation or translation of a joint.
pub trait Value: Copy + PartialEq {
    /// The shortest delta to another value: for rotations a rotation vector in local axes.
    fn delta_to(self, other: Self) -> DVec3;
    /// The value that a delta leads to.
    #[must_use]
    fn plus(self, delta: DVec3) -> Self;
    /// The greatest difference of a component.
    fn difference(self, other: Self) -> f64;
}

impl Value for DQuat {
    fn delta_to(self, other: Self) -> DVec3 {
        log_small(self.inverse() * other)
    }

    fn plus(self, delta: DVec3) -> Self {
        self * exp_small(delta)
    }

    fn difference(self, other: Self) -> f64 {
        let [x, y, z, w] = (self - other).to_array().map(f64::abs);
        x.max(y).max(z).max(w)
    }
}

impl Value for DVec3 {
    fn delta_to(self, other: Self) -> DVec3 {
        other - self
    }

    fn plus(self, delta: DVec3) -> Self {
        self + delta
    }

    fn difference(self, other: Self) -> f64 {
        (self - other).abs().max_element()
    }
}

/// The value plus a delta; of a delta of 0, the value bit for bit.
pub(crate) fn add<V: Value>(value: V, delta: DVec3) -> V {
    if delta == DVec3::ZERO { value } else { value.plus(delta) }
}
