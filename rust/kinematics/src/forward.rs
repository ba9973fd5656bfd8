//! Forward kinematics: from local to world.

use glam::{DQuat, DVec3};

use crate::error::{Error, check_len, check_parents};

/// World rotations and positions of every joint in every frame.
///
/// `rotations` and `positions` are local and frame-major, `parents.len()` joints wide;
/// the two results have the same layout. Takes O(frames × joints) time. NaN affects the
/// descendants of its joint in its frame.
///
/// # Errors
///
/// If the two buffers differ in length or are not a whole number of frames, or if a parent
/// does not precede its child.
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

    let mut world_rotations = rotations.to_vec();
    let mut world_positions = positions.to_vec();
    for first in (0..rotations.len()).step_by(n_joints.max(1)) {
        for (joint, &parent) in parents
            .iter()
            .enumerate()
            .filter(|&(_, &parent)| parent >= 0)
        {
            let (i, parent) = (first + joint, first + parent as usize);
            world_positions[i] = world_positions[parent] + world_rotations[parent] * positions[i];
            world_rotations[i] = world_rotations[parent] * rotations[i];
        }
    }
    Ok((world_rotations, world_positions))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn world_of_bent_arm_has_known_end() {
        let quarter = DQuat::from_rotation_z(std::f64::consts::FRAC_PI_2);
        let (world_rotations, world_positions) =
            world(&[-1, 0, 1], &[quarter; 3], &[DVec3::ZERO, DVec3::X, DVec3::X]).unwrap();

        assert!(world_positions[2].abs_diff_eq(DVec3::new(-1.0, 1.0, 0.0), 1e-15));
        assert!(world_rotations[2].abs_diff_eq(quarter * quarter * quarter, 1e-15));
    }

    #[test]
    fn world_with_child_before_parent_returns_error() {
        let error = world(&[1, -1], &[DQuat::IDENTITY; 2], &[DVec3::ZERO; 2]).unwrap_err();
        assert_eq!(error, Error::ParentNotFirst { joint: 0 });
    }
}
