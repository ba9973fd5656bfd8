//! Sampled segments, and the vectors that compare them.

use std::thread;

use glam::DQuat;

use crate::Error;
use crate::error::check_len;
use crate::rotation::log;

/// Segments that a thread is begun for: fewer are done sooner without it.
const SHARE: usize = 64;

/// Segments of equal length, a row of numbers each, in single or double precision.
///
/// A row begins with `n_samples` poses of `n_joints` rotations, xyzw, which need not be quite
/// unit; what else is known of the segment stands behind them.
#[derive(Clone, Copy, Debug)]
pub struct Rows<'a, T> {
    /// One row after the other.
    pub numbers: &'a [T],
    /// Numbers per row.
    pub width: usize,
    /// Poses per row.
    pub n_samples: usize,
    /// Rotations per pose.
    pub n_joints: usize,
}

impl<T> Rows<'_, T> {
    fn check(&self) -> Result<(), Error> {
        let (poses, n) = (self.poses(), self.numbers.len() / self.width.max(1));
        check_len(self.width, self.width.max(poses))?;
        check_len(self.numbers.len(), n * self.width)
    }

    /// Numbers of a row that are rotations.
    fn poses(&self) -> usize {
        4 * self.n_samples * self.n_joints
    }
}

/// Each joint's Σ q qᵀ over all poses, 16 numbers per joint.
///
/// Added pose by pose, in the order of rows. NaN stays in its joint.
///
/// # Errors
///
/// If the numbers are no whole rows, or rows are shorter than their poses.
pub fn moments<T: Copy + Into<f64>>(rows: Rows<T>) -> Result<Vec<f64>, Error> {
    rows.check()?;
    let mut summed = vec![[[0.0; 4]; 4]; rows.n_joints];
    for row in rows.numbers.chunks_exact(rows.width.max(1)) {
        let (quats, _) = row[..rows.poses()].as_chunks::<4>();
        for (quat, sum) in quats.iter().zip((0..rows.n_joints).cycle()) {
            let q = quat.map(Into::into);
            for (own, sums) in q.iter().zip(&mut summed[sum]) {
                for (other, sum) in q.iter().zip(sums) {
                    *sum += own * other;
                }
            }
        }
    }
    Ok(summed.into_flattened().into_flattened())
}

/// Feature vectors of some joints, one per row: rotation vectors, then the last `n_rest` numbers.
///
/// For each of `joints`, for each sample, the shortest rotation vector (as [`log`]) that leads
/// from the joint's reference to its rotation, in the reference's frame. Shared out among
/// `threads` by rows; NaN stays in its vector.
///
/// # Errors
///
/// If the numbers are no whole rows, rows are shorter than their poses and `n_rest`, a joint
/// does not exist, or references are not one per joint.
pub fn features<T: Copy + Into<f64> + Sync>(
    rows: Rows<T>,
    joints: &[usize],
    references: &[DQuat],
    n_rest: usize,
    threads: usize,
) -> Result<Vec<f64>, Error> {
    rows.check()?;
    check_len(rows.width, rows.width.max(rows.poses() + n_rest))?;
    check_len(references.len(), joints.len())?;
    if let Some(&joint) = joints.iter().find(|&&joint| joint >= rows.n_joints) {
        return Err(Error::NoSuchJoint { joint });
    }
    let inverse: Vec<DQuat> = references.iter().map(|r| r.conjugate()).collect();
    let wide = 3 * rows.n_samples * joints.len() + n_rest;
    let n = rows.numbers.len() / rows.width.max(1);
    let mut found = vec![0.0; n * wide];
    let fill = |found: &mut [f64], numbers: &[T]| {
        let own = numbers.chunks_exact(rows.width.max(1));
        for (vector, row) in found.chunks_exact_mut(wide.max(1)).zip(own) {
            let (turned, rest) = vector.split_at_mut(wide - n_rest);
            let (quats, _) = row[..rows.poses()].as_chunks::<4>();
            let each = joints.iter().zip(&inverse);
            let each = each.flat_map(|(&joint, back)| {
                let track = quats[joint..].iter().step_by(rows.n_joints);
                track.map(move |q| *back * DQuat::from_array(q.map(Into::into)))
            });
            for (vector, q) in turned.as_chunks_mut::<3>().0.iter_mut().zip(each) {
                *vector = log(q.normalize()).to_array();
            }
            for (to, &from) in rest.iter_mut().zip(&row[rows.width - n_rest..]) {
                *to = from.into();
            }
        }
    };
    let share = n.div_ceil(threads.max(1)).max(SHARE);
    thread::scope(|scope| {
        let parts = found.chunks_mut((share * wide).max(1));
        let mut parts = parts.zip(rows.numbers.chunks((share * rows.width).max(1)));
        let own = parts.next();
        for (found, numbers) in parts {
            scope.spawn(move || fill(found, numbers));
        }
        if let Some((found, numbers)) = own {
            fill(found, numbers);
        }
    });
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rotation::exp;
    use glam::DVec3;

    /// Three numbers behind the poses of each of `n` rows, whose rotations are all different.
    fn numbers(n: usize, n_samples: usize, n_joints: usize) -> (Vec<f64>, usize) {
        let width = 4 * n_samples * n_joints + 3;
        let mut numbers: Vec<f64> = (0..n * width).map(|i| i as f64).collect();
        for row in numbers.chunks_mut(width) {
            for q in row[..width - 3].as_chunks_mut::<4>().0 {
                let v = DVec3::new(0.4, 0.1, -0.2) * (1.0 + (0.7 * q[0]).sin());
                *q = exp(v).to_array();
            }
        }
        (numbers, width)
    }

    #[test]
    fn features_are_those_of_each_row_joint_and_sample_by_itself_on_any_number_of_threads() {
        let (n, n_samples, n_joints) = (3 * SHARE + 5, 3, 4);
        let (numbers, width) = numbers(n, n_samples, n_joints);
        let rows = Rows { numbers: &numbers, width, n_samples, n_joints };
        let joints = [3, 0];
        let references = [exp(DVec3::X), exp(DVec3::Y)];
        for n_rest in 0..=3 {
            let mut expected = vec![];
            for row in numbers.chunks(width) {
                for (joint, reference) in joints.iter().zip(references) {
                    for sample in 0..n_samples {
                        let q = DQuat::from_slice(&row[4 * (sample * n_joints + joint)..]);
                        expected.extend(log((reference.conjugate() * q).normalize()).to_array());
                    }
                }
                expected.extend(&row[width - n_rest..]);
            }
            for threads in [0, 1, 2, 3, 1000] {
                let found = features(rows, &joints, &references, n_rest, threads);
                assert_eq!(found.as_ref(), Ok(&expected));
            }
        }
    }

    #[test]
    fn moments_are_added_pose_by_pose() {
        let (n, n_samples, n_joints) = (9, 3, 2);
        let (numbers, width) = numbers(n, n_samples, n_joints);
        let rows = Rows { numbers: &numbers, width, n_samples, n_joints };
        let found = moments(rows).expect("whole rows");
        for (joint, i, k) in (0..n_joints).flat_map(|j| (0..16).map(move |x| (j, x / 4, x % 4))) {
            let mut sum = 0.0;
            for row in numbers.chunks(width) {
                for sample in 0..n_samples {
                    let q = &row[4 * (sample * n_joints + joint)..];
                    sum += q[i] * q[k];
                }
            }
            assert_eq!(found[16 * joint + 4 * i + k], sum);
        }
    }

    #[test]
    fn single_precision_is_taken_as_it_is() {
        let (numbers, width) = numbers(2, 2, 2);
        let single: Vec<f32> = numbers.iter().map(|&x| x as f32).collect();
        let double: Vec<f64> = single.iter().copied().map(f64::from).collect();
        let (n_samples, n_joints) = (2, 2);
        let ours = Rows { numbers: &single[..], width, n_samples, n_joints };
        let theirs = Rows { numbers: &double[..], width, n_samples, n_joints };
        assert_eq!(moments(ours), moments(theirs));
        let from = [DQuat::IDENTITY];
        assert_eq!(features(ours, &[1], &from, 3, 1), features(theirs, &[1], &from, 3, 1));
    }

    #[test]
    fn what_does_not_fit_is_refused() {
        let (numbers, width) = numbers(2, 2, 2);
        let rows = Rows { numbers: &numbers[..], width, n_samples: 2, n_joints: 2 };
        let from = [DQuat::IDENTITY];
        assert!(features(rows, &[0], &from, 4, 1).is_err());
        assert!(features(rows, &[0], &[], 0, 1).is_err());
        assert_eq!(features(rows, &[2], &from, 0, 1), Err(Error::NoSuchJoint { joint: 2 }));
        for bad in [
            Rows { numbers: &numbers[1..], ..rows },
            Rows { width: 15, ..rows },
            Rows { n_samples: 3, ..rows },
        ] {
            assert!(moments(bad).is_err());
            assert!(features(bad, &[0], &from, 0, 1).is_err());
        }
        let none = Rows { numbers: &numbers[..0], width: 0, n_samples: 0, n_joints: 0 };
        assert_eq!(moments(none), Ok(vec![]));
        assert_eq!(features(none, &[], &[], 0, 1), Ok(vec![]));
    }
}
