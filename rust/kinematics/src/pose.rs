//! How far poses are apart.

use glam::DQuat;

use crate::Error;
use crate::error::check_len;
use crate::rotation::angle;

/// Mean joint angle between every one of `ends` and every one of `starts`, in radians.
///
/// Both are poses of `n_joints` rotations, one after the other; the result is row-major,
/// one row per end. Takes O(ends × starts) time; NaN stays in its row or column.
///
/// # Errors
///
/// If a buffer is no whole number of poses.
pub fn pose_gaps(ends: &[DQuat], starts: &[DQuat], n_joints: usize) -> Result<Vec<f64>, Error> {
    let width = n_joints.max(1);
    check_len(ends.len(), ends.len() / width * n_joints)?;
    check_len(starts.len(), starts.len() / width * n_joints)?;
    let pairs = ends
        .chunks_exact(width)
        .flat_map(|end| starts.chunks_exact(width).map(move |start| (end, start)));
    let mean = |(end, start): (&[DQuat], &[DQuat])| {
        let sum: f64 = end.iter().zip(start).map(|(&a, &b)| angle(a, b)).sum();
        sum / n_joints as f64
    };
    Ok(pairs.map(mean).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gaps_are_mean_angles() {
        let turn = DQuat::from_rotation_x;
        let ends = [turn(0.0), turn(0.0), turn(1.0), turn(1.0)];
        let gaps = pose_gaps(&ends, &[turn(0.5), turn(-0.5)], 2).unwrap();
        assert!((gaps[0] - 0.5).abs() < 1e-15 && (gaps[1] - 1.0).abs() < 1e-15);
    }
}
