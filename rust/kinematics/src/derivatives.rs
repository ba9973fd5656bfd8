//! Accelerations and jerks of captured and assembled motion, as differences between frames.

use glam::{DQuat, DVec3};

use crate::error::{Error, check_len, check_parents};
use mograft_machine::memory::allocate;

/// The greatest angular acceleration and jerk of some joints in each frame, per frame² and frame³.
///
/// `rotations` are frame-major, `n_joints` wide. A rotation vector from a frame to the next is taken
/// as 2 sin(angle / 2), which is 1 % too short at 0.5 rad. An acceleration is that of the middle of
/// three frames, a jerk that of the second of four; elsewhere both are 0. Takes O(frames × joints)
/// time. NaN is ignored.
///
/// # Errors
///
/// If `rotations` are not a whole number of frames, or a joint does not exist.
pub fn greatest_derivatives(
    rotations: &[DQuat],
    n_joints: usize,
    joints: &[usize],
) -> Result<(Vec<f64>, Vec<f64>), Error> {
    let n_frames = rotations.len().checked_div(n_joints).unwrap_or(0);
    check_len(rotations.len(), n_frames * n_joints)?;
    check_joints(joints, n_joints)?;
    let (mut accelerations, mut jerks) = (allocate(0.0, n_frames)?, allocate(0.0, n_frames)?);
    let mut last_step = vec![DVec3::ZERO; joints.len()];
    let mut last_acceleration = last_step.clone();
    for (f, frame) in rotations
        .windows(2 * n_joints.max(1))
        .step_by(n_joints.max(1))
        .enumerate()
    {
        let (mut acceleration_squared, mut jerk_squared) = (0.0_f64, 0.0_f64);
        for (column, &joint) in joints.iter().enumerate() {
            let step = short_step(frame[joint], frame[n_joints + joint]);
            let acceleration = step - last_step[column];
            let jerk = acceleration - last_acceleration[column];
            acceleration_squared = acceleration_squared.max(acceleration.length_squared());
            jerk_squared = jerk_squared.max(jerk.length_squared());
            (last_step[column], last_acceleration[column]) = (step, acceleration);
        }
        if f >= 1 {
            accelerations[f] = acceleration_squared.sqrt();
        }
        if f >= 2 {
            jerks[f - 1] = jerk_squared.sqrt();
        }
    }
    Ok((accelerations, jerks))
}

/// Twice the vector part of the rotation from `a` to `b`, along the shorter arc.
fn short_step(a: DQuat, b: DQuat) -> DVec3 {
    let sign = 2.0_f64.copysign(a.x * b.x + a.y * b.y + a.z * b.z + a.w * b.w);
    let x = a.w * b.x - b.w * a.x - a.y * b.z + a.z * b.y;
    let y = a.w * b.y - b.w * a.y - a.z * b.x + a.x * b.z;
    let z = a.w * b.z - b.w * a.z - a.x * b.y + a.y * b.x;
    DVec3::new(x, y, z) * sign
}

/// The jerk of the world positions of some joints in each frame, per frame³, frame by frame.
///
/// `rotations` and `positions` are local and frame-major, `parents.len()` wide. A jerk is that of
/// the second of four frames; it is 0 in the first frame and in the last two. Takes O(frames ×
/// joints) time. NaN affects the descendants of its joint in the four frames.
///
/// # Errors
///
/// As [`crate::forward::world`], or if a joint does not exist.
pub fn world_jerk(
    parents: &[i64],
    rotations: &[DQuat],
    positions: &[DVec3],
    joints: &[usize],
) -> Result<Vec<f64>, Error> {
    check_parents(parents)?;
    check_len(positions.len(), rotations.len())?;
    let (n_joints, width) = (parents.len(), joints.len());
    let n_frames = rotations.len().checked_div(n_joints).unwrap_or(0);
    check_len(rotations.len(), n_frames * n_joints)?;
    check_joints(joints, n_joints)?;
    let chain = chain_of(parents, joints);
    let mut world = vec![(DQuat::IDENTITY, DVec3::ZERO); n_joints];
    // For each joint its position, step and acceleration in the frame before.
    let mut last = vec![[DVec3::ZERO; 3]; width];
    let mut jerks = allocate(0.0, n_frames.saturating_mul(width))?;
    for f in 0..n_frames {
        for &joint in &chain {
            let (rotation, position) =
                (rotations[f * n_joints + joint], positions[f * n_joints + joint]);
            world[joint] = match usize::try_from(parents[joint]) {
                Ok(parent) => {
                    let (turn, place) = world[parent];
                    (turn * rotation, place + turn * position)
                }
                Err(_) => (rotation, position),
            };
        }
        for (column, (&joint, last)) in joints.iter().zip(&mut last).enumerate() {
            let place = world[joint].1;
            let step = place - last[0];
            let acceleration = step - last[1];
            if f >= 3 {
                jerks[(f - 2) * width + column] = (acceleration - last[2]).length();
            }
            *last = [place, step, acceleration];
        }
    }
    Ok(jerks)
}

/// Some joints and their ancestors, ascending.
fn chain_of(parents: &[i64], joints: &[usize]) -> Vec<usize> {
    let mut is_used = vec![false; parents.len()];
    for &joint in joints {
        let mut next = Ok(joint);
        while let Ok(joint) = next {
            is_used[joint] = true;
            next = usize::try_from(parents[joint]);
        }
    }
    (0..parents.len()).filter(|&joint| is_used[joint]).collect()
}

fn check_joints(joints: &[usize], n_joints: usize) -> Result<(), Error> {
    match joints.iter().find(|&&joint| joint >= n_joints) {
        Some(&joint) => Err(Error::InvalidJoint { joint }),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rotation::exp;

    #[test]
    fn derivatives_of_cubic_motion_are_exact_and_zero_at_ends() {
        let cubes = (0..6).map(|n| f64::from(n * n * n));
        let quats: Vec<_> = cubes.clone().map(|n| exp(DVec3::X * (1e-3 * n))).collect();
        let (accelerations, jerks) = greatest_derivatives(&quats, 1, &[0]).unwrap();
        let expected = [0.0, 6e-3, 12e-3, 18e-3, 24e-3, 0.0];
        assert!(
            accelerations
                .iter()
                .zip(expected)
                .all(|(a, b)| (a - b).abs() < 1e-4)
        );
        let expected = [0.0, 6e-3, 6e-3, 6e-3, 0.0, 0.0];
        assert!(
            jerks
                .iter()
                .zip(expected)
                .all(|(a, b)| (a - b).abs() < 1e-4)
        );

        let places: Vec<_> = cubes.flat_map(|n| [DVec3::Y * n, DVec3::X]).collect();
        let jerks = world_jerk(&[-1, 0], &[DQuat::IDENTITY; 12], &places, &[1]).unwrap();
        assert_eq!(jerks, [0.0, 6.0, 6.0, 6.0, 0.0, 0.0]);
    }

    #[test]
    fn derivatives_of_missing_joint_return_error() {
        let refused = greatest_derivatives(&[DQuat::IDENTITY; 4], 2, &[2]).err();
        assert_eq!(refused, Some(Error::InvalidJoint { joint: 2 }));
        let refused = world_jerk(&[-1], &[DQuat::IDENTITY], &[DVec3::ZERO], &[1]).err();
        assert_eq!(refused, Some(Error::InvalidJoint { joint: 1 }));
        let (few, none) = greatest_derivatives(&[DQuat::IDENTITY; 2], 2, &[1]).unwrap();
        assert_eq!((few, none), (vec![0.0], vec![0.0]));
    }
}
