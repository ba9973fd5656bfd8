//! Forward kinematics: from local to world.

use glam::{DQuat, DVec3};

use crate::Error;
use crate::error::{check_len, check_parents};

/// World rotations and positions of every joint in every frame.
///
/// `rotations` and `positions` are local and frame-major, `parents.len()` joints wide;
/// the two results are laid out alike. Takes O(frames × joints) time. NaN spreads to the
/// joint's descendants in its frame.
///
/// # Errors
///
/// If the two buffers differ in length or are no whole number of frames, or if a parent
/// does not stand before its child.
pub fn world(
    parents: &[i64],
    rotations: &[DQuat],
    positions: &[DVec3],
) -> Result<(Vec<DQuat>, Vec<DVec3>), Error> {
    check_parents(parents)?;
    check_len(positions.len(), rotations.len())?;
    let n_joints = parents.len();
    let n_frames = rotations.len().checked_div(n_joints).unwrap_or(0);
    check_len(rotations.len(), n_frames * n_joints)?;

    let mut turned = rotations.to_vec();
    let mut placed = positions.to_vec();
    for first in (0..rotations.len()).step_by(n_joints.max(1)) {
        for (joint, &parent) in parents
            .iter()
            .enumerate()
            .filter(|&(_, &parent)| parent >= 0)
        {
            let (at, above) = (first + joint, first + parent as usize);
            placed[at] = placed[above] + turned[above] * positions[at];
            turned[at] = turned[above] * rotations[at];
        }
    }
    Ok((turned, placed))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bent_arm_reaches_round_the_corner() {
        let quarter = DQuat::from_rotation_z(std::f64::consts::FRAC_PI_2);
        let (turned, placed) =
            world(&[-1, 0, 1], &[quarter; 3], &[DVec3::ZERO, DVec3::X, DVec3::X]).unwrap();

        assert!(placed[2].abs_diff_eq(DVec3::new(-1.0, 1.0, 0.0), 1e-15));
        assert!(turned[2].abs_diff_eq(quarter * quarter * quarter, 1e-15));
    }

    #[test]
    fn a_child_before_its_parent_is_refused() {
        let refusal = world(&[1, -1], &[DQuat::IDENTITY; 2], &[DVec3::ZERO; 2]).unwrap_err();
        assert_eq!(refusal, Error::ParentNotBefore { joint: 0 });
    }
}
