//! Distances between poses.

use glam::{DQuat, DVec3};

use crate::error::{Error, check_len};
use crate::rotation::angle;

/// Mean angle over the joints between each of `ends` and each of `starts`, in radians.
///
/// Both are poses of `n_joints` rotations, one after the other; the result is row-major,
/// one row per end. Takes O(ends × starts × joints) time; NaN affects its row or column only.
///
/// # Errors
///
/// If a buffer is not a whole number of poses.
pub fn pose_gaps(ends: &[DQuat], starts: &[DQuat], n_joints: usize) -> Result<Vec<f64>, Error> {
    mean_gaps(ends, starts, n_joints, angle)
}

/// Mean difference of joint velocities between each of `ends` and each of `starts`.
///
/// As [`pose_gaps`], for `n_joints` vectors per pose: the mean length of their differences.
///
/// # Errors
///
/// If a buffer is not a whole number of poses.
pub fn velocity_gaps(ends: &[DVec3], starts: &[DVec3], n_joints: usize) -> Result<Vec<f64>, Error> {
    mean_gaps(ends, starts, n_joints, DVec3::distance)
}

fn mean_gaps<T: Copy>(
    ends: &[T],
    starts: &[T],
    n_joints: usize,
    gap: impl Fn(T, T) -> f64,
) -> Result<Vec<f64>, Error> {
    let width = n_joints.max(1);
    check_len(ends.len(), ends.len() / width * n_joints)?;
    check_len(starts.len(), starts.len() / width * n_joints)?;
    let mut means = Vec::with_capacity((ends.len() / width) * (starts.len() / width));
    for end in ends.chunks_exact(width) {
        for start in starts.chunks_exact(width) {
            let sum: f64 = end.iter().zip(start).map(|(&a, &b)| gap(a, b)).sum();
            means.push(sum / n_joints as f64);
        }
    }
    Ok(means)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pose_gaps_are_mean_angles() {
        let turn = DQuat::from_rotation_x;
        let ends = [turn(0.0), turn(0.0), turn(1.0), turn(1.0)];
        let gaps = pose_gaps(&ends, &[turn(0.5), turn(-0.5)], 2).unwrap();
        assert!((gaps[0] - 0.5).abs() < 1e-15 && (gaps[1] - 1.0).abs() < 1e-15);
    }

    #[test]
    fn velocity_gaps_are_mean_lengths() {
        let ends = [DVec3::ZERO, DVec3::X];
        let gaps = velocity_gaps(&ends, &[3.0 * DVec3::Y, DVec3::X], 2).unwrap();
        assert_eq!(gaps, [1.5]);
    }
}
