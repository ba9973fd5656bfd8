//! Differences of rotations and of translations, behind one trait.

use glam::{DQuat, DVec3};

use crate::error::{Error, check_len};
use crate::rotation::{exp_small, log_small};
use mograft_machine::memory::{copy, with_capacity};

/// The rotation or translation of a joint.
pub trait Value: Copy + PartialEq {
    /// The shortest delta to another value: for rotations a rotation vector in local axes.
    fn delta_to(self, other: Self) -> DVec3;
    /// The value that a delta leads to.
    #[must_use]
    fn plus(self, delta: DVec3) -> Self;
    /// Whether the negative value is equivalent and nearer to another one.
    fn is_opposite(self, other: Self) -> bool;
    /// The equivalent negative value.
    #[must_use]
    fn negated(self) -> Self;
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

    fn is_opposite(self, other: Self) -> bool {
        self.dot(other) < 0.0
    }

    fn negated(self) -> Self {
        -self
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

    fn is_opposite(self, _: Self) -> bool {
        false
    }

    fn negated(self) -> Self {
        self
    }

    fn difference(self, other: Self) -> f64 {
        (self - other).abs().max_element()
    }
}

/// The value plus a delta; of a delta of 0, the value bit for bit.
pub(crate) fn add<V: Value>(value: V, delta: DVec3) -> V {
    if delta == DVec3::ZERO { value } else { value.plus(delta) }
}

/// Frames of a body in which those of some joints are replaced, and which values differ.
///
/// `base` is frame-major, `n_joints` wide, `part` is `joints.len()` wide; the second result has one
/// entry for each value of `part`. The first is None if no value differs. A joint without a
/// different value keeps the values of `base`. Of the values q and -q of a rotation, the nearer one
/// to the frame before is returned; in the first frame, the one with w ≥ 0. Takes
/// O(frames × joints) time.
///
/// # Errors
///
/// If the numbers of frames differ, a joint does not exist, or memory is exhausted.
pub fn replace_joints<V: Value>(
    base: &[V],
    n_joints: usize,
    part: &[V],
    joints: &[usize],
    identity: V,
) -> Result<(Option<Vec<V>>, Vec<bool>), Error> {
    let (n_frames, width) = (base.len().checked_div(n_joints).unwrap_or(0), joints.len());
    check_len(base.len(), n_frames * n_joints)?;
    check_len(part.len(), n_frames * width)?;
    if let Some(&joint) = joints.iter().find(|&&joint| joint >= n_joints) {
        return Err(Error::InvalidJoint { joint });
    }
    let mut is_changed = with_capacity(part.len())?;
    for (frame, part) in base
        .chunks_exact(n_joints.max(1))
        .zip(part.chunks_exact(width.max(1)))
    {
        is_changed.extend(
            joints
                .iter()
                .zip(part)
                .map(|(&joint, own)| frame[joint] != *own),
        );
    }
    if !is_changed.contains(&true) {
        return Ok((None, is_changed));
    }
    let mut replaced = copy(base)?;
    for (column, &joint) in joints.iter().enumerate() {
        if !is_changed
            .iter()
            .skip(column)
            .step_by(width)
            .any(|&own| own)
        {
            continue;
        }
        let (mut last, mut is_negated) = (identity, false);
        for (f, &own) in part.iter().skip(column).step_by(width).enumerate() {
            is_negated ^= own.is_opposite(last);
            replaced[f * n_joints + joint] = if is_negated { own.negated() } else { own };
            last = own;
        }
    }
    Ok((Some(replaced), is_changed))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn replaced_joint_has_continuous_signs_and_equal_joint_is_kept() {
        let q = |x: f64| DQuat::from_xyzw(x, 0.0, 0.0, (1.0 - x * x).sqrt());
        let base = [q(0.0), -q(0.5), q(0.1), q(0.5)];
        let part = [-q(0.3), -q(0.5), q(0.4), q(0.5)];
        let (found, is_changed) =
            replace_joints(&base, 2, &part, &[0, 1], DQuat::IDENTITY).unwrap();
        assert_eq!(found.unwrap(), [q(0.3), -q(0.5), q(0.4), q(0.5)]);
        assert_eq!(is_changed, [true, false, true, false]);
        let (kept, _) = replace_joints(&base, 2, &base, &[0, 1], DQuat::IDENTITY).unwrap();
        assert_eq!(kept, None);
        let refused = replace_joints(&base, 2, &part, &[0, 2], DQuat::IDENTITY).err();
        assert_eq!(refused, Some(Error::InvalidJoint { joint: 2 }));
    }
}
