//! Distances between poses.

use std::f64::consts::{FRAC_PI_2, FRAC_PI_4};

use glam::{DQuat, DVec3};

use crate::error::{Error, check_len};
use crate::memory::{collected, filled, reserve};

/// Mean angle over the joints between each of `ends` and each of `starts`, in radians.
///
/// Both are poses of `n_joints` rotations, one after the other; the result is row-major,
/// one row per end. Takes O(ends × starts × joints) time; NaN affects its row or column only.
///
/// # Errors
///
/// If a buffer is not a whole number of poses, or memory is exhausted.
pub fn pose_gaps(ends: &[DQuat], starts: &[DQuat], n_joints: usize) -> Result<Vec<f64>, Error> {
    all_gaps(ends, starts, n_joints, DQuat::to_array, add_angles)
}

/// Mean difference of joint velocities between each of `ends` and each of `starts`.
///
/// As [`pose_gaps`], for `n_joints` vectors per pose: the mean length of their differences.
///
/// # Errors
///
/// If a buffer is not a whole number of poses.
pub fn velocity_gaps(ends: &[DVec3], starts: &[DVec3], n_joints: usize) -> Result<Vec<f64>, Error> {
    all_gaps(ends, starts, n_joints, DVec3::to_array, add_distances)
}

/// The gaps of [`pose_gaps`] between the candidates of consecutive positions.
///
/// `candidates` has the indices of poses in `ends` and `starts`: those of the first position, then
/// those of the next; `counts` has their numbers. For every position but the last, the result has
/// one row per candidate, with one gap per candidate of the next position.
///
/// # Errors
///
/// If a buffer is not a whole number of poses, the counts do not add up to the candidates, or a
/// candidate is too large.
pub fn pose_gaps_along(
    ends: &[DQuat],
    starts: &[DQuat],
    n_joints: usize,
    candidates: &[usize],
    counts: &[usize],
) -> Result<Vec<f64>, Error> {
    gaps_along(ends, starts, n_joints, candidates, counts, DQuat::to_array, add_angles)
}

/// The gaps of [`velocity_gaps`] between the candidates of consecutive positions.
///
/// Arguments and layout are as for [`pose_gaps_along`].
///
/// # Errors
///
/// As for [`pose_gaps_along`].
pub fn velocity_gaps_along(
    ends: &[DVec3],
    starts: &[DVec3],
    n_joints: usize,
    candidates: &[usize],
    counts: &[usize],
) -> Result<Vec<f64>, Error> {
    gaps_along(ends, starts, n_joints, candidates, counts, DVec3::to_array, add_distances)
}

fn all_gaps<T: Copy, const D: usize>(
    ends: &[T],
    starts: &[T],
    n_joints: usize,
    components: impl Fn(&T) -> [f64; D],
    add_gaps: impl Fn([f64; D], &[[f64; LANES]; D], &mut [f64; LANES]),
) -> Result<Vec<f64>, Error> {
    let width = n_joints.max(1);
    check_len(ends.len(), ends.len() / width * n_joints)?;
    check_len(starts.len(), starts.len() / width * n_joints)?;
    let starts = collected(starts.chunks_exact(width), starts.len() / width)?;
    let blocks = Blocks::new(&starts, &components)?;
    let n_ends = ends.len() / width;
    // The last block of lanes is truncated after it was appended.
    let mut gaps = reserve((n_ends * starts.len()).saturating_add(LANES))?;
    for end in ends.chunks_exact(width) {
        blocks.push_mean_gaps(end, &components, &add_gaps, &mut gaps);
    }
    Ok(gaps)
}

fn gaps_along<T: Copy, const D: usize>(
    ends: &[T],
    starts: &[T],
    n_joints: usize,
    candidates: &[usize],
    counts: &[usize],
    components: impl Fn(&T) -> [f64; D],
    add_gaps: impl Fn([f64; D], &[[f64; LANES]; D], &mut [f64; LANES]),
) -> Result<Vec<f64>, Error> {
    let width = n_joints.max(1);
    let n_poses = ends.len() / width;
    check_len(ends.len(), n_poses * n_joints)?;
    check_len(starts.len(), n_poses * n_joints)?;
    check_len(candidates.len(), counts.iter().fold(0, |sum, n| n.saturating_add(sum)))?;
    if let Some(&pose) = candidates.iter().find(|&&pose| pose >= n_poses) {
        return Err(Error::InvalidPose { pose });
    }
    let n_gaps = counts
        .windows(2)
        .map(|pair| pair[0].saturating_mul(pair[1]));
    let n_gaps = n_gaps.fold(LANES, usize::saturating_add);
    let mut gaps = reserve(n_gaps)?;
    let mut rest = candidates;
    for pair in counts.windows(2) {
        let (left, right) = rest.split_at(pair[0]);
        rest = right;
        let starts: Vec<_> = right[..pair[1]]
            .iter()
            .map(|&pose| &starts[pose * width..][..width])
            .collect();
        let blocks = Blocks::new(&starts, &components)?;
        for &pose in left {
            let end = &ends[pose * width..][..width];
            blocks.push_mean_gaps(end, &components, &add_gaps, &mut gaps);
        }
    }
    Ok(gaps)
}

/// Poses whose gaps are computed together: the loops over them become vector instructions.
const LANES: usize = 8;

/// Poses in blocks of [`LANES`]: for every block and joint, each component of all poses. The last
/// block repeats its last pose.
struct Blocks<const D: usize> {
    lanes: Vec<[[f64; LANES]; D]>,
    n_poses: usize,
}

impl<const D: usize> Blocks<D> {
    fn new<T: Copy>(poses: &[&[T]], components: impl Fn(&T) -> [f64; D]) -> Result<Self, Error> {
        let n_joints = poses.first().map_or(0, |pose| pose.len());
        let mut lanes = filled([[0.0; LANES]; D], poses.len().div_ceil(LANES) * n_joints)?;
        for (block, poses) in lanes.chunks_mut(n_joints.max(1)).zip(poses.chunks(LANES)) {
            for lane in 0..LANES {
                let pose = poses[lane.min(poses.len() - 1)];
                for (columns, value) in block.iter_mut().zip(pose) {
                    for (column, number) in columns.iter_mut().zip(components(value)) {
                        column[lane] = number;
                    }
                }
            }
        }
        Ok(Self { lanes, n_poses: poses.len() })
    }

    /// Append the mean gap between a pose and each of these.
    fn push_mean_gaps<T: Copy>(
        &self,
        end: &[T],
        components: impl Fn(&T) -> [f64; D],
        add_gaps: impl Fn([f64; D], &[[f64; LANES]; D], &mut [f64; LANES]),
        gaps: &mut Vec<f64>,
    ) {
        let stop = gaps.len() + self.n_poses;
        for block in self.lanes.chunks_exact(end.len().max(1)) {
            let mut sums = [0.0; LANES];
            for (value, columns) in end.iter().zip(block) {
                add_gaps(components(value), columns, &mut sums);
            }
            gaps.extend(sums.map(|sum| sum / end.len() as f64));
        }
        gaps.truncate(stop);
    }
}

/// Add the angles from one rotation to eight others, as [`crate::rotation::angle`].
fn add_angles([x0, y0, z0, w0]: [f64; 4], others: &[[f64; LANES]; 4], sums: &mut [f64; LANES]) {
    let [xs, ys, zs, ws] = others;
    for lane in 0..LANES {
        let (x1, y1, z1, w1) = (xs[lane], ys[lane], zs[lane], ws[lane]);
        // The product of the conjugate and the other, as glam computes it.
        let x = w0 * x1 - x0 * w1 - y0 * z1 + z0 * y1;
        let y = w0 * y1 + x0 * z1 - y0 * w1 - z0 * x1;
        let z = w0 * z1 - x0 * y1 + y0 * x1 - z0 * w1;
        let w = w0 * w1 + x0 * x1 + y0 * y1 + z0 * z1;
        sums[lane] += 2.0 * arctangent((x * x + y * y + z * z).sqrt(), w.abs());
    }
}

/// Add the distances from one vector to eight others.
fn add_distances([x0, y0, z0]: [f64; 3], others: &[[f64; LANES]; 3], sums: &mut [f64; LANES]) {
    let [xs, ys, zs] = others;
    for lane in 0..LANES {
        let (x, y, z) = (x0 - xs[lane], y0 - ys[lane], z0 - zs[lane]);
        sums[lane] += (x * x + y * y + z * z).sqrt();
    }
}

/// The angle of a point from the x axis, for coordinates that are not negative and not both 0.
///
/// The relative error is below 1e-15. Unlike `f64::atan2` it has no branches, so that loops over
/// it become vector instructions. Rational approximation of Moshier's Cephes library, `atan.c`.
#[inline]
fn arctangent(y: f64, x: f64) -> f64 {
    let is_steep = y > x;
    let (low, high) = if is_steep { (x, y) } else { (y, x) };
    let is_wide = low > TAN_EIGHTH * high;
    let numerator = if is_wide { low - high } else { low };
    let denominator = if is_wide { low + high } else { high };
    let t = numerator / denominator;
    let square = t * t;
    let p = P.iter().fold(0.0, |sum, c| sum * square + c);
    let q = Q.iter().fold(1.0, |sum, c| sum * square + c);
    let angle = if is_wide { FRAC_PI_4 } else { 0.0 } + (t + t * square * (p / q));
    if is_steep { FRAC_PI_2 - angle } else { angle }
}

/// The tangent of π/8.
const TAN_EIGHTH: f64 = 0.414_213_562_373_095_05;

const P: [f64; 5] = [
    -8.750_608_600_031_904e-1,
    -1.615_753_718_733_365_2e1,
    -7.500_855_792_314_705e1,
    -1.228_866_684_490_136_1e2,
    -6.485_021_904_942_025e1,
];

const Q: [f64; 5] = [
    2.485_846_490_142_306_2e1,
    1.650_270_098_316_988_5e2,
    4.328_810_604_912_902_7e2,
    4.853_903_996_359_137e2,
    1.945_506_571_482_614e2,
];

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
    fn arctangent_is_atan2() {
        for i in 0..=4000 {
            let angle = FRAC_PI_2 * f64::from(i) / 4000.0;
            for scale in [1.0, 1e-9, 1e-18] {
                let (y, x) = (scale * angle.sin(), angle.cos());
                let error = (arctangent(y, x) - y.atan2(x)).abs();
                assert!(error <= 1e-15 * y.atan2(x), "{y} {x}");
            }
        }
    }

    #[test]
    fn gaps_along_are_those_of_neighbouring_positions() {
        let turns: Vec<_> = (0..20)
            .map(|i| DQuat::from_rotation_y(f64::from(i * i)))
            .collect();
        let candidates: Vec<_> = (0..10).chain([4, 4, 1]).collect();
        let gaps = pose_gaps_along(&turns, &turns, 2, &candidates, &[2, 8, 3]).unwrap();
        let rows = |ends: &[usize], starts: &[usize]| {
            let poses = |list: &[usize]| -> Vec<_> {
                list.iter()
                    .flat_map(|&i| [turns[2 * i], turns[2 * i + 1]])
                    .collect()
            };
            pose_gaps(&poses(ends), &poses(starts), 2).unwrap()
        };
        let expected = [rows(&[0, 1], &candidates[2..10]), rows(&candidates[2..10], &[4, 4, 1])];
        assert_eq!(gaps, expected.concat());
        let refused = pose_gaps_along(&turns, &turns, 2, &[0, 10], &[1, 1]);
        assert_eq!(refused, Err(Error::InvalidPose { pose: 10 }));
        assert!(pose_gaps_along(&turns, &turns, 2, &[0, 1], &[1, 2]).is_err());
    }

    #[test]
    fn velocity_gaps_are_mean_lengths() {
        let ends = [DVec3::ZERO, DVec3::X];
        let gaps = velocity_gaps(&ends, &[3.0 * DVec3::Y, DVec3::X], 2).unwrap();
        assert_eq!(gaps, [1.5]);
    }
}
