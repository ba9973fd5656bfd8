//! Sampled segments, and the feature vectors that compare them.

use glam::DQuat;

use crate::error::{Error, check_len};
use crate::rotation::log;
use mograft_machine::memory::{allocate, with_capacity};
use mograft_machine::threads::for_each_part;

/// Smallest count of segments that gets a thread of its own.
const MIN_ROWS_PER_THREAD: usize = 64;

/// Segments of equal length, a row of numbers each, in single or double precision.
///
/// A row begins with `n_samples` poses of `n_joints` rotations, xyzw, which may deviate from unit
/// length by rounding; other features of the segment follow them.
#[derive(Clone, Copy, Debug)]
pub struct Rows<'a, T> {
    /// The rows, one after the other.
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
        let n = self.numbers.len() / self.width.max(1);
        check_len(self.width, self.width.max(self.pose_width()))?;
        check_len(self.numbers.len(), n * self.width)
    }

    /// Count of the numbers of a row that are rotations.
    fn pose_width(&self) -> usize {
        4_usize
            .saturating_mul(self.n_samples)
            .saturating_mul(self.n_joints)
    }
}

/// For each joint the sum of q qᵀ over all poses, a 4 × 4 matrix in 16 numbers.
///
/// Poses are added in the order of rows. Takes O(n) time for n numbers; NaN affects its joint
/// only.
///
/// # Errors
///
/// If the numbers are not whole rows, or rows are shorter than their poses.
pub fn moments<T: Copy + Into<f64>>(rows: Rows<T>) -> Result<Vec<f64>, Error> {
    rows.check()?;
    let mut sums = allocate([[0.0; 4]; 4], rows.n_joints)?;
    for row in rows.numbers.chunks_exact(rows.width.max(1)) {
        let (quats, _) = row[..rows.pose_width()].as_chunks::<4>();
        for (quat, joint) in quats.iter().zip((0..rows.n_joints).cycle()) {
            let q = quat.map(Into::into);
            for (a, row_sums) in q.iter().zip(&mut sums[joint]) {
                for (b, sum) in q.iter().zip(row_sums) {
                    *sum += a * b;
                }
            }
        }
    }
    Ok(sums.into_flattened().into_flattened())
}

/// Feature vectors of some joints, one per row: rotation vectors, then the last `n_rest` numbers.
///
/// For each of `joints`, for each sample, the shortest rotation vector (as [`log`]) from the
/// joint's reference to its rotation, in the frame of the reference. Rows are shared out among
/// `threads`; the result does not depend on their count. NaN affects its vector only. Takes
/// O(rows × joints × samples) time.
///
/// # Errors
///
/// If the numbers are not whole rows, rows are shorter than their poses and `n_rest`, a joint
/// does not exist, or there is not one reference per joint.
pub fn features<T: Copy + Into<f64> + Sync>(
    rows: Rows<T>,
    joints: &[usize],
    references: &[DQuat],
    n_rest: usize,
    threads: usize,
) -> Result<Vec<f64>, Error> {
    rows.check()?;
    check_len(rows.width, rows.width.max(rows.pose_width().saturating_add(n_rest)))?;
    check_len(references.len(), joints.len())?;
    if let Some(&joint) = joints.iter().find(|&&joint| joint >= rows.n_joints) {
        return Err(Error::InvalidJoint { joint });
    }
    let inverses: Vec<DQuat> = references.iter().map(|r| r.conjugate()).collect();
    let width = 3_usize
        .saturating_mul(rows.n_samples)
        .saturating_mul(joints.len())
        .saturating_add(n_rest);
    let n = rows.numbers.len() / rows.width.max(1);
    let mut vectors = allocate(0.0, n.saturating_mul(width))?;
    let fill = |vectors: &mut [f64], numbers: &[T]| {
        let numbers = numbers.chunks_exact(rows.width.max(1));
        for (vector, row) in vectors.chunks_exact_mut(width.max(1)).zip(numbers) {
            let (rotation_vectors, rest) = vector.split_at_mut(width - n_rest);
            let (quats, _) = row[..rows.pose_width()].as_chunks::<4>();
            let tracks = joints.iter().zip(&inverses);
            let relative = tracks.flat_map(|(&joint, inverse)| {
                let track = quats.get(joint..).unwrap_or_default();
                let track = track.iter().step_by(rows.n_joints);
                track.map(move |q| *inverse * DQuat::from_array(q.map(Into::into)))
            });
            let targets = rotation_vectors.as_chunks_mut::<3>().0.iter_mut();
            for (vector, q) in targets.zip(relative) {
                *vector = log(q.normalize()).to_array();
            }
            for (to, &from) in rest.iter_mut().zip(&row[rows.width - n_rest..]) {
                *to = from.into();
            }
        }
    };
    let rows_per_thread = n.div_ceil(threads.max(1)).max(MIN_ROWS_PER_THREAD);
    let parts = vectors.chunks_mut(rows_per_thread.saturating_mul(width).max(1));
    let parts = parts.zip(
        rows.numbers
            .chunks(rows_per_thread.saturating_mul(rows.width).max(1)),
    );
    for_each_part(parts, |(vectors, numbers)| fill(vectors, numbers));
    Ok(vectors)
}

/// Euclidean distances between pairs of points of `width` coordinates.
///
/// `from` and `to` have the indices of each pair among the points. Up to 128 coordinates, squares
/// are added in the order of `numpy.linalg.norm` with an axis. Takes O(pairs × width) time; NaN
/// affects the distances of its point only.
///
/// # Errors
///
/// If the coordinates are not whole points, there are not two points per pair, a point does not
/// exist, or memory is exhausted. Points without coordinates are not counted: any index is valid.
pub fn distances(
    points: &[f64],
    width: usize,
    from: &[usize],
    to: &[usize],
) -> Result<Vec<f64>, Error> {
    let n_points = points.len() / width.max(1);
    check_len(points.len(), n_points * width)?;
    check_len(to.len(), from.len())?;
    if width == 0 {
        return Ok(allocate(0.0, from.len())?);
    }
    let mut lengths = with_capacity(from.len())?;
    for (&from, &to) in from.iter().zip(to) {
        let point = from.max(to);
        if point >= n_points {
            return Err(Error::UnknownSegment { segment: point });
        }
        let (a, b) = (&points[from * width..][..width], &points[to * width..][..width]);
        let (a_blocks, a_rest) = a.as_chunks::<8>();
        let (b_blocks, b_rest) = b.as_chunks::<8>();
        let mut sums = [0.0; 8];
        for (a, b) in a_blocks.iter().zip(b_blocks) {
            for ((sum, a), b) in sums.iter_mut().zip(a).zip(b) {
                *sum += (a - b) * (a - b);
            }
        }
        let [s0, s1, s2, s3, s4, s5, s6, s7] = sums;
        let mut sum = ((s0 + s1) + (s2 + s3)) + ((s4 + s5) + (s6 + s7));
        for (a, b) in a_rest.iter().zip(b_rest) {
            sum += (a - b) * (a - b);
        }
        lengths.push(sum.sqrt());
    }
    Ok(lengths)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rotation::exp;
    use glam::DVec3;

    /// `n` rows of different rotations, each row with three more numbers, and their width.
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
    fn features_on_any_thread_count_equal_scalar_formula() {
        let (n, n_samples, n_joints) = (3 * MIN_ROWS_PER_THREAD + 5, 3, 4);
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
    fn moments_equal_sums_in_pose_order() {
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
    fn features_and_moments_of_f32_equal_those_of_same_numbers_in_f64() {
        let (numbers, width) = numbers(2, 2, 2);
        let single: Vec<f32> = numbers.iter().map(|&x| x as f32).collect();
        let double: Vec<f64> = single.iter().copied().map(f64::from).collect();
        let (n_samples, n_joints) = (2, 2);
        let f32_rows = Rows { numbers: &single[..], width, n_samples, n_joints };
        let f64_rows = Rows { numbers: &double[..], width, n_samples, n_joints };
        assert_eq!(moments(f32_rows), moments(f64_rows));
        let references = [DQuat::IDENTITY];
        assert_eq!(
            features(f32_rows, &[1], &references, 3, 1),
            features(f64_rows, &[1], &references, 3, 1)
        );
    }

    #[test]
    fn distances_are_norms_of_differences() {
        for width in [1, 2, 7, 8, 9, 16, 21] {
            let points: Vec<f64> = (0..5 * width).map(|i| (1.3 * i as f64).sin()).collect();
            let (from, to) = ([0, 4, 2, 3], [1, 0, 2, 1]);
            let found = distances(&points, width, &from, &to).unwrap();
            for (i, length) in found.into_iter().enumerate() {
                let gaps = (0..width)
                    .map(|axis| points[from[i] * width + axis] - points[to[i] * width + axis]);
                let squares: f64 = gaps.map(|gap| gap * gap).sum();
                assert!((length - squares.sqrt()).abs() <= 1e-15 * (1.0 + length));
            }
        }
        assert_eq!(distances(&[], 3, &[], &[]), Ok(vec![]));
        assert_eq!(distances(&[], 0, &[5, 1], &[0, 2]), Ok(vec![0.0; 2]));
        let unknown = Err(Error::UnknownSegment { segment: 2 });
        assert_eq!(distances(&[1.0; 4], 2, &[0, 2], &[0, 1]), unknown);
        assert_eq!(distances(&[1.0; 4], 2, &[0, 1], &[0, 2]), unknown);
        assert!(distances(&[1.0; 5], 2, &[0], &[0]).is_err());
        assert!(distances(&[1.0; 4], 2, &[0], &[0, 1]).is_err());
        assert_eq!(
            distances(&[1.0; 4], 0, &[0], &[0]),
            Err(Error::LengthMismatch { expected: 0, given: 4 })
        );
    }

    #[test]
    fn features_and_moments_of_mismatched_input_return_error() {
        let (numbers, width) = numbers(2, 2, 2);
        let rows = Rows { numbers: &numbers[..], width, n_samples: 2, n_joints: 2 };
        let references = [DQuat::IDENTITY];
        assert!(features(rows, &[0], &references, 4, 1).is_err());
        assert!(features(rows, &[0], &[], 0, 1).is_err());
        assert_eq!(features(rows, &[2], &references, 0, 1), Err(Error::InvalidJoint { joint: 2 }));
        for bad in [
            Rows { numbers: &numbers[1..], ..rows },
            Rows { width: 15, ..rows },
            Rows { n_samples: 3, ..rows },
        ] {
            assert!(moments(bad).is_err());
            assert!(features(bad, &[0], &references, 0, 1).is_err());
        }
        let none = Rows { numbers: &numbers[..0], width: 0, n_samples: 0, n_joints: 0 };
        assert_eq!(moments(none), Ok(vec![]));
        assert_eq!(features(none, &[], &[], 0, 1), Ok(vec![]));
    }
}
