//! Forward kinematics, from local to world, and its inverse.

use glam::{DQuat, DVec3};

use crate::error::{Error, check_len, check_parents};
use crate::rotation::rotate;
use mograft_machine::memory::copy;

/// World rotations and positions of every joint in every frame.
///
/// `rotations` and `positions` are local and frame-major, `parents.len()` joints wide;
/// the two results have the same layout. Takes O(frames × joints) time. NaN affects the
/// descendants of its joint in its frame.
///
/// # Errors
///
/// If the two buffers differ in length or are not a whole number of frames, or if a parent
/// does not precede its child, or if memory is exhausted.
pub fn world(
    parents: &[i64],
    rotations: &[DQuat],
    positions: &[DVec3],
) -> Result<(Vec<DQuat>, Vec<DVec3>), Error> {
    check(parents, rotations, positions)?;
    let n_joints = parents.len();
    let mut world_rotations = copy(rotations)?;
    let mut world_positions = copy(positions)?;
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

/// Local rotations and positions of every joint in every frame: the inverse of [`world`].
///
/// `rotations` and `positions` are those of the world, laid out as in [`world`]; the root keeps
/// them. Takes O(frames × joints) time. NaN affects the children of its joint in its frame.
///
/// # Errors
///
/// As [`world`].
pub fn local(
    parents: &[i64],
    rotations: &[DQuat],
    positions: &[DVec3],
) -> Result<(Vec<DQuat>, Vec<DVec3>), Error> {
    check(parents, rotations, positions)?;
    let (mut local_rotations, mut local_positions) = (copy(rotations)?, copy(positions)?);
    for first in (0..rotations.len()).step_by(parents.len().max(1)) {
        for (joint, &parent) in parents
            .iter()
            .enumerate()
            .filter(|&(_, &parent)| parent >= 0)
        {
            let (i, parent) = (first + joint, first + parent as usize);
            let to_parent = rotations[parent].conjugate();
            local_rotations[i] = to_parent * rotations[i];
            local_positions[i] = rotate(to_parent, positions[i] - positions[parent]);
        }
    }
    Ok((local_rotations, local_positions))
}

/// Check the hierarchy and the lengths of the buffers.
fn check(parents: &[i64], rotations: &[DQuat], positions: &[DVec3]) -> Result<(), Error> {
    check_parents(parents)?;
    check_len(positions.len(), rotations.len())?;
    let n_frames = rotations.len().checked_div(parents.len()).unwrap_or(0);
    check_len(rotations.len(), n_frames * parents.len())
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
    fn local_of_world_is_the_original() {
        let turn = |i: i32| DQuat::from_scaled_axis(DVec3::new(0.3, -0.2, 0.5) * f64::from(i));
        let rotations: Vec<_> = (0..8).map(turn).collect();
        let positions: Vec<_> = (0..8)
            .map(|i| DVec3::new(f64::from(i), 2.0, -1.0))
            .collect();
        let parents = [-1, 0, 1, 0];
        let (turned, moved) = world(&parents, &rotations, &positions).unwrap();
        let (again, places) = local(&parents, &turned, &moved).unwrap();
        for (joint, (q, p)) in again.iter().zip(&places).enumerate() {
            assert!(q.abs_diff_eq(rotations[joint], 1e-14), "{joint}");
            assert!(p.abs_diff_eq(positions[joint], 1e-13), "{joint}");
        }
    }

    #[test]
    fn kinematics_with_child_before_parent_returns_error() {
        for kernel in [world, local] {
            let error = kernel(&[1, -1], &[DQuat::IDENTITY; 2], &[DVec3::ZERO; 2]).unwrap_err();
            assert_eq!(error, Error::ParentNotFirst { joint: 0 });
        }
    }
}
