//! Distances between poses.
#![allow(clippy::inline_always, reason = "loops are compiled for several instruction sets")]

use std::f64::consts::{FRAC_PI_2, FRAC_PI_4};

use glam::{DQuat, DVec3};

use crate::error::{Error, check_len};
use mograft_machine::instructions::{Isa, Loops};
use mograft_machine::memory::{allocate, collect_first, with_capacity};

/// Mean angle over the joints between each of `ends` and each of `starts`, in radians.
///
/// Both are poses of `n_joints` rotations, one after the other; the result is row-major,
/// one row per end. Takes O(ends × starts × joints) time; NaN affects its row or column only.
///
/// # Errors
///
/// If a buffer is not a whole number of poses, or memory is exhausted.
pub fn pose_gaps(ends: &[DQuat], starts: &[DQuat], n_joints: usize) -> Result<Vec<f64>, Error> {
    all_gaps::<DQuat, 4>(ends, starts, n_joints)
}

/// Mean difference of joint velocities between each of `ends` and each of `starts`.
///
/// As [`pose_gaps`], for `n_joints` vectors per pose: the mean length of their differences.
///
/// # Errors
///
/// If a buffer is not a whole number of poses.
pub fn velocity_gaps(ends: &[DVec3], starts: &[DVec3], n_joints: usize) -> Result<Vec<f64>, Error> {
    all_gaps::<DVec3, 3>(ends, starts, n_joints)
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
    gaps_along_with::<DQuat, 4>(Isa::best(), ends, starts, n_joints, candidates, counts)
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
    gaps_along_with::<DVec3, 3>(Isa::best(), ends, starts, n_joints, candidates, counts)
}

fn all_gaps<T: Value<D>, const D: usize>(
    ends: &[T],
    starts: &[T],
    n_joints: usize,
) -> Result<Vec<f64>, Error> {
    let width = n_joints.max(1);
    check_len(ends.len(), ends.len() / width * n_joints)?;
    check_len(starts.len(), starts.len() / width * n_joints)?;
    let starts = collect_first(starts.chunks_exact(width), starts.len() / width)?;
    let blocks = Blocks::new(&starts)?;
    let n_ends = ends.len() / width;
    // The last block of lanes is truncated after it was appended.
    let mut gaps = with_capacity((n_ends * starts.len()).saturating_add(LANES))?;
    for end in ends.chunks_exact(width) {
        Isa::best().run(PushMeanGaps { blocks: &blocks, end, gaps: &mut gaps });
    }
    Ok(gaps)
}

/// [`pose_gaps_along`] or [`velocity_gaps_along`] with one instruction set.
#[doc(hidden)]
pub fn gaps_along_with<T: Value<D>, const D: usize>(
    isa: Isa,
    ends: &[T],
    starts: &[T],
    n_joints: usize,
    candidates: &[usize],
    counts: &[usize],
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
    let mut gaps = with_capacity(n_gaps)?;
    let mut rest = candidates;
    for pair in counts.windows(2) {
        let (left, right) = rest.split_at(pair[0]);
        rest = right;
        let starts: Vec<_> = right[..pair[1]]
            .iter()
            .map(|&pose| &starts[pose * width..][..width])
            .collect();
        let blocks = Blocks::new(&starts)?;
        for &pose in left {
            let end = &ends[pose * width..][..width];
            isa.run(PushMeanGaps { blocks: &blocks, end, gaps: &mut gaps });
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
    fn new<T: Value<D>>(poses: &[&[T]]) -> Result<Self, Error> {
        let n_joints = poses.first().map_or(0, |pose| pose.len());
        let mut lanes = allocate([[0.0; LANES]; D], poses.len().div_ceil(LANES) * n_joints)?;
        for (block, poses) in lanes.chunks_mut(n_joints.max(1)).zip(poses.chunks(LANES)) {
            for lane in 0..LANES {
                let pose = poses[lane.min(poses.len() - 1)];
                for (columns, value) in block.iter_mut().zip(pose) {
                    for (column, number) in columns.iter_mut().zip(value.components()) {
                        column[lane] = number;
                    }
                }
            }
        }
        Ok(Self { lanes, n_poses: poses.len() })
    }
}

/// Append the mean gap between the pose `end` and each pose of the blocks.
struct PushMeanGaps<'a, T, const D: usize> {
    blocks: &'a Blocks<D>,
    end: &'a [T],
    gaps: &'a mut Vec<f64>,
}

impl<T: Value<D>, const D: usize> Loops for PushMeanGaps<'_, T, D> {
    #[inline(always)]
    fn run(self) {
        let Self { blocks, end, gaps } = self;
        let stop = gaps.len() + blocks.n_poses;
        for block in blocks.lanes.chunks_exact(end.len().max(1)) {
            let mut sums = [0.0; LANES];
            for (value, columns) in end.iter().zip(block) {
                T::add_gaps(value.components(), columns, &mut sums);
            }
            gaps.extend(sums.map(|sum| sum / end.len() as f64));
        }
        gaps.truncate(stop);
    }
}

/// A rotation or a velocity of a joint, with `D` components.
#[doc(hidden)]
pub trait Value<const D: usize>: Copy {
    /// The components.
    fn components(&self) -> [f64; D];

    /// Add the gaps from one value to eight others.
    fn add_gaps(from: [f64; D], others: &[[f64; LANES]; D], sums: &mut [f64; LANES]);
}

impl Value<4> for DQuat {
    #[inline(always)]
    fn components(&self) -> [f64; 4] {
        self.to_array()
    }

    /// Add angles, as [`crate::rotation::angle`].
    #[inline(always)]
    fn add_gaps([x0, y0, z0, w0]: [f64; 4], others: &[[f64; LANES]; 4], sums: &mut [f64; LANES]) {
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
}

impl Value<3> for DVec3 {
    #[inline(always)]
    fn components(&self) -> [f64; 3] {
        self.to_array()
    }

    /// Add distances.
    #[inline(always)]
    fn add_gaps([x0, y0, z0]: [f64; 3], others: &[[f64; LANES]; 3], sums: &mut [f64; LANES]) {
        let [xs, ys, zs] = others;
        for lane in 0..LANES {
            let (x, y, z) = (x0 - xs[lane], y0 - ys[lane], z0 - zs[lane]);
            sums[lane] += (x * x + y * y + z * z).sqrt();
        }
    }
}

/// The angle of a point from the x axis, for coordinates that are not negative and not both 0.
///
/// The relative error is below 1e-15. Unlike `f64::atan2` it has no branches, so that loops over
/// it become vector instructions. Rational approximation of Moshier's Cephes library, `atan.c`.
#[inline(always)]
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
    use mograft_machine::instructions::Level;

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
    fn gaps_have_the_same_bits_with_every_instruction_set() {
        let turns: Vec<_> = (0..60)
            .map(|i| {
                DQuat::from_rotation_y(f64::from(i * i)) * DQuat::from_rotation_x(f64::from(i))
            })
            .collect();
        let moves: Vec<_> = turns.iter().map(|turn| turn.xyz()).collect();
        let (candidates, counts) = ((0..20).chain(3..12).collect::<Vec<_>>(), [11, 9, 9]);
        let [narrow, wide] = [Level::Baseline, Level::Avx2].map(Isa::up_to).map(|isa| {
            let angles = gaps_along_with(isa, &turns, &turns, 3, &candidates, &counts).unwrap();
            (angles, gaps_along_with(isa, &moves, &moves, 3, &candidates, &counts).unwrap())
        });
        assert_eq!(narrow, wide);
    }

    #[test]
    fn velocity_gaps_are_mean_lengths() {
        let ends = [DVec3::ZERO, DVec3::X];
        let gaps = velocity_gaps(&ends, &[3.0 * DVec3::Y, DVec3::X], 2).unwrap();
        assert_eq!(gaps, [1.5]);
    }
}
