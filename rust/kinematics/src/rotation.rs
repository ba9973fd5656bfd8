//! Rotation algebra beyond glam's, accurate near 0 and near a half turn.
//!
//! `glam`'s `to_scaled_axis` takes the longer arc if w < 0 and returns 0 below 1e-8; its
//! `angle_between` uses `acos`, which loses half of the digits near 0. All functions take O(1) time
//! per rotation, and NaN gives NaN.

use std::f64::consts::{FRAC_2_PI, PI, TAU};

use glam::{DQuat, DVec3};

use crate::error::{Error, check_len};
use mograft_machine::memory::{collect_first, copy, with_capacity};

/// Below this angle, the sine equals the angle in f64.
const SMALL_ANGLE: f64 = 1e-8;

/// The rotation by `v.length()` radians about `v`.
pub fn exp(v: DVec3) -> DQuat {
    let angle = v.length();
    if angle < SMALL_ANGLE {
        // To first order, then normalized: sin(x)/x differs from 1 by x²/6 < 1e-16.
        return DQuat::from_xyzw(0.5 * v.x, 0.5 * v.y, 0.5 * v.z, 1.0).normalize();
    }
    let (sin, cos) = (0.5 * angle).sin_cos();
    let xyz = v * (sin / angle);
    DQuat::from_xyzw(xyz.x, xyz.y, xyz.z, cos)
}

/// The shortest rotation vector of `q`, of length 0 to π.
///
/// Of the two vectors of a half turn, the one whose first nonzero component is positive.
pub fn log(q: DQuat) -> DVec3 {
    let q = if q.w < 0.0 { -q } else { q };
    let xyz = q.xyz();
    let sin = xyz.length();
    if sin < SMALL_ANGLE {
        return 2.0 * xyz;
    }
    let v = xyz * (2.0 * sin.atan2(q.w) / sin);
    let first = v.to_array().into_iter().find(|&c| c != 0.0).unwrap_or(0.0);
    if q.w == 0.0 && first < 0.0 { -v } else { v }
}

/// Coefficients of sin(x) / x, of cos(x) and of asin(x) / x in powers of x².
const SINE: [f64; 8] = [
    1.0,
    -1.0 / 6.0,
    1.0 / 120.0,
    -1.0 / 5_040.0,
    1.0 / 362_880.0,
    -1.0 / 39_916_800.0,
    1.0 / 6_227_020_800.0,
    -1.0 / 1_307_674_368_000.0,
];
const COSINE: [f64; 8] = [
    1.0,
    -1.0 / 2.0,
    1.0 / 24.0,
    -1.0 / 720.0,
    1.0 / 40_320.0,
    -1.0 / 3_628_800.0,
    1.0 / 479_001_600.0,
    -1.0 / 87_178_291_200.0,
];
const ARCSINE: [f64; 9] = [
    1.0,
    1.0 / 6.0,
    3.0 / 40.0,
    15.0 / 336.0,
    105.0 / 3_456.0,
    945.0 / 42_240.0,
    10_395.0 / 599_040.0,
    135_135.0 / 9_676_800.0,
    2_027_025.0 / 175_472_640.0,
];

/// [`exp`] up to 4e-16, several times faster for angles below 1 rad.
pub fn exp_small(v: DVec3) -> DQuat {
    let z = 0.25 * v.length_squared();
    // NaN is left to `exp`.
    if z < 0.25 {
        let xyz = v * (0.5 * polynomial(&SINE, z));
        DQuat::from_xyzw(xyz.x, xyz.y, xyz.z, polynomial(&COSINE, z))
    } else {
        exp(v)
    }
}

/// [`log`] up to a relative error of 1e-15, several times faster for angles below 0.28 rad.
pub fn log_small(q: DQuat) -> DVec3 {
    let xyz = q.xyz();
    let z = xyz.length_squared();
    if z < 0.02 { xyz * (2.0_f64.copysign(q.w) * polynomial(&ARCSINE, z)) } else { log(q) }
}

/// The polynomial with the given coefficients at `z`, by Horner's method.
#[inline]
fn polynomial(coefficients: &[f64], z: f64) -> f64 {
    coefficients.iter().rev().fold(0.0, |sum, c| sum * z + c)
}

/// `v` rotated by the unit quaternion `q`: v + 2w u×v + 2u×(u×v), with fewer operations than
/// glam's `q * v`.
pub fn rotate(q: DQuat, v: DVec3) -> DVec3 {
    let cross = 2.0 * q.xyz().cross(v);
    v + q.w * cross + q.xyz().cross(cross)
}

/// The angle between two rotations, 0 to π.
pub fn angle(a: DQuat, b: DQuat) -> f64 {
    let relative = a.inverse() * b;
    2.0 * relative.xyz().length().atan2(relative.w.abs())
}

/// Spherical linear interpolation along the shorter arc; exactly `a` at 0 and ±`b` at 1.
///
/// For a half turn, [`log`] determines the direction.
pub fn slerp(a: DQuat, b: DQuat, t: f64) -> DQuat {
    if t == 0.0 {
        a
    } else if t == 1.0 {
        if a.dot(b) < 0.0 { -b } else { b }
    } else {
        a * exp(t * log(a.inverse() * b))
    }
}

/// The same rotations with signs that do not jump between frames.
///
/// `rotations` has `n_joints` quaternions per frame. In the first frame w ≥ 0; the dot product of
/// the quaternions of a joint in consecutive frames is not negative. Takes O(frames × joints) time.
/// NaN keeps the sign of the frame before.
///
/// # Errors
///
/// If memory is exhausted.
pub fn continuous_signs(rotations: &[DQuat], n_joints: usize) -> Result<Vec<DQuat>, Error> {
    let mut signed = copy(rotations)?;
    for i in 0..signed.len() {
        let is_flipped = match i.checked_sub(n_joints) {
            Some(before) => signed[i].dot(signed[before]) < 0.0,
            None => signed[i].w < 0.0,
        };
        if is_flipped {
            signed[i] = -signed[i];
        }
    }
    Ok(signed)
}

/// Intrinsic Euler angles to rotations: each about an axis of the frame already rotated.
///
/// `angles` holds `axes.len()` angles in radians for each of `n` rotations; axis 0, 1, 2 is x, y,
/// z. Without axes the result is the identity `n` times.
///
/// # Errors
///
/// If the lengths disagree, an axis does not exist, or memory is exhausted.
pub fn from_euler(angles: &[f64], axes: &[usize], n: usize) -> Result<Vec<DQuat>, Error> {
    check_len(angles.len(), n.saturating_mul(axes.len()))?;
    if axes.iter().any(|&axis| axis > 2) {
        return Err(Error::InvalidChannel);
    }
    let rotations = (0..n).map(|i| {
        let angles = &angles[i * axes.len()..][..axes.len()];
        let mut q = [0.0, 0.0, 0.0, 1.0];
        for (&axis, &angle) in axes.iter().zip(angles) {
            turn(&mut q, axis, angle);
        }
        DQuat::from_array(q)
    });
    Ok(collect_first(rotations, n)?)
}

/// Rotations from the channels of successive frames, as [`from_euler`] for every joint.
///
/// A frame has `n_channels` values in units of `radians`. The rotation of joint `j` has the
/// channels `turns[starts[j]..starts[j + 1]]`, each an axis and the column of its angle. Of `q` and
/// `-q` the one nearer to the previous frame is returned; in the first frame, the one with w ≥ 0.
/// Takes O(frames × channels) time.
///
/// # Errors
///
/// If `values` are not whole frames, or the channels of a joint, an axis or a column do not exist.
pub fn from_channels(
    values: &[f64],
    n_channels: usize,
    starts: &[usize],
    turns: &[(usize, usize)],
    radians: f64,
) -> Result<Vec<DQuat>, Error> {
    let n_frames = values.len() / n_channels.max(1);
    check_len(values.len(), n_frames * n_channels)?;
    let n_joints = starts.len().saturating_sub(1);
    let exists = |&(axis, column): &(usize, usize)| axis < 3 && column < n_channels;
    let is_ordered = starts.is_sorted() && starts.last().is_none_or(|&end| end <= turns.len());
    if !is_ordered || !turns.iter().all(exists) {
        return Err(Error::InvalidChannel);
    }
    let mut rotations: Vec<DQuat> = with_capacity(n_frames.saturating_mul(n_joints))?;
    for frame in values.chunks_exact(n_channels.max(1)) {
        for joint in starts.windows(2) {
            let mut q = [0.0, 0.0, 0.0, 1.0];
            for &(axis, column) in &turns[joint[0]..joint[1]] {
                turn(&mut q, axis, frame[column] * radians);
            }
            let q = DQuat::from_array(q);
            let previous = rotations
                .len()
                .checked_sub(n_joints)
                .map_or(DQuat::IDENTITY, |i| rotations[i]);
            rotations.push(if q.dot(previous) < 0.0 { -q } else { q });
        }
    }
    Ok(rotations)
}

/// Multiply `q` from the right by the rotation about coordinate axis `i`.
fn turn(q: &mut [f64; 4], i: usize, angle: f64) {
    let (sin, cos) = sin_cos(0.5 * angle);
    let [x, y, z, w] = *q;
    // Named for a rotation about x; the other axes are cyclic permutations.
    let (j, k) = ((i + 1) % 3, (i + 2) % 3);
    let v = [x, y, z];
    q[i] = v[i] * cos + w * sin;
    q[j] = v[j] * cos + v[k] * sin;
    q[k] = v[k] * cos - v[j] * sin;
    q[3] = w * cos - v[i] * sin;
}

/// Sine and cosine with an error of at most 2.3e-16, several times faster than `f64::sin_cos`.
///
/// The argument is reduced to an eighth turn in three steps, which are exact up to 1e6; the
/// polynomials are those of fdlibm's `__kernel_sin` and `__kernel_cos` (Sun Microsystems
/// 1993).
fn sin_cos(x: f64) -> (f64, f64) {
    /// π/2 in parts of 33 bits, and the rest.
    const QUARTER: [f64; 3] =
        [1.570_796_326_734_125_6, 6.077_100_506_303_966e-11, 2.022_266_248_795_950_6e-21];
    /// Adding 1.5 · 2^52 rounds a number to an integer, which is then in the lowest bits.
    const ROUNDING: f64 = 6_755_399_441_055_744.0;
    if x.abs() > 1e6 || x.is_nan() {
        return x.sin_cos();
    }
    let shifted = x * FRAC_2_PI + ROUNDING;
    let quarters = shifted - ROUNDING;
    let r = ((x - quarters * QUARTER[0]) - quarters * QUARTER[1]) - quarters * QUARTER[2];
    let z = r * r;
    let sin = -1.984_126_982_985_795e-4
        + z * (2.755_731_370_707_007e-6
            + z * (-2.505_076_025_340_686_3e-8 + z * 1.589_690_995_211_55e-10));
    let sin = r + r * z * (-1.666_666_666_666_663_2e-1 + z * (8.333_333_333_322_49e-3 + z * sin));
    let cos = 2.480_158_728_947_673e-5
        + z * (-2.755_731_435_139_066_3e-7
            + z * (2.087_572_321_298_175e-9 - z * 1.135_964_755_778_819_5e-11));
    let cos = 4.166_666_666_666_66e-2 + z * (-1.388_888_888_887_411e-3 + z * cos);
    let cos = 1.0 - (0.5 * z - z * z * cos);
    // The quadrant determines the signs and whether sine and cosine are exchanged. Bit operations,
    // because a branch would often be mispredicted.
    let quadrant = shifted.to_bits();
    let exchange_mask = 0_u64.wrapping_sub(quadrant & 1);
    let (sin, cos) = (sin.to_bits(), cos.to_bits());
    let exchange = (sin ^ cos) & exchange_mask;
    let sign = |quadrant: u64| (quadrant & 2) << 62;
    (
        f64::from_bits(sin ^ exchange ^ sign(quadrant)),
        f64::from_bits(cos ^ exchange ^ sign(quadrant.wrapping_add(1))),
    )
}

/// Euler angles of successive rotations, each triple as near as possible to the previous one.
///
/// `axes` are three different axes; the angles are in radians. Of all triples of a rotation the
/// nearest to that of the previous frame (for the first frame, to `near`) is returned, so that the
/// curves do not jump by full turns. In gimbal lock the first angle keeps its previous value.
///
/// Half sums and half differences of the outer angles come directly from the quaternion, which is
/// accurate near gimbal lock. Source: Bernardes and Viollet, PLoS ONE 17(11), 2022.
///
/// # Errors
///
/// If an axis does not exist, or memory is exhausted.
pub fn to_euler(
    rotations: &[DQuat],
    axes: [usize; 3],
    near: [f64; 3],
) -> Result<Vec<[f64; 3]>, Error> {
    if axes.iter().any(|&axis| axis > 2) {
        return Err(Error::InvalidChannel);
    }
    let mut near = near;
    let angles = rotations.iter().map(|&q| {
        near = nearest_euler(q, axes, near);
        near
    });
    Ok(collect_first(angles, rotations.len())?)
}

fn nearest_euler(q: DQuat, [i, j, k]: [usize; 3], near: [f64; 3]) -> [f64; 3] {
    let parity = if (i + 1) % 3 == j { 1.0 } else { -1.0 };
    let xyz = [q.x, q.y, q.z];
    let (w, x, y, z) = (q.w, xyz[i], xyz[j], parity * xyz[k]);
    // With half angles: (a, b) = √2·sin(π/4 − β/2)·(cos, sin)(α/2 − γ/2) and
    // (c, d) = √2·cos(π/4 − β/2)·(cos, sin)(α/2 + γ/2).
    let (a, b) = (w - y, x - z);
    let (c, d) = (w + y, x + z);
    let (low, high) = (a.hypot(b), c.hypot(d));
    let middle = 2.0 * high.atan2(low) - 0.5 * PI;
    let (difference, sum) = (2.0 * b.atan2(a), 2.0 * d.atan2(c));

    let (first, last) = if low < SMALL_ANGLE {
        (near[0], sum - near[0])
    } else if high < SMALL_ANGLE {
        (near[0], near[0] - difference)
    } else {
        (0.5 * (sum + difference), 0.5 * (sum - difference))
    };
    let last = parity * last;
    let unwrapped = |angles: [f64; 3]| -> [f64; 3] {
        std::array::from_fn(|n| angles[n] - TAU * ((angles[n] - near[n]) / TAU).round())
    };
    let distance =
        |angles: &[f64; 3]| -> f64 { angles.iter().zip(&near).map(|(a, b)| (a - b).abs()).sum() };
    let direct = unwrapped([first, middle, last]);
    let flipped = unwrapped([first + PI, PI - middle, last + PI]);
    if distance(&flipped) < distance(&direct) { flipped } else { direct }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lattice() -> impl Iterator<Item = DQuat> {
        // Directions and lengths, some beyond a half turn, and the poles.
        let grid = [-2.9, -1.0, -1e-5, 0.0, 1e-9, 0.7, 1.6];
        grid.into_iter().flat_map(move |x| {
            grid.into_iter()
                .flat_map(move |y| grid.into_iter().map(move |z| exp(DVec3::new(x, y, z))))
        })
    }

    #[test]
    fn log_of_exp_is_shortest_rotation_vector() {
        for q in lattice() {
            let v = log(q);
            assert!(v.length() <= PI + 1e-15);
            let back = exp(v);
            assert!(back.abs_diff_eq(q, 1e-14) || back.abs_diff_eq(-q, 1e-14), "{q} {back}");
            assert!((angle(DQuat::IDENTITY, q) - v.length()).abs() < 1e-14);
        }
    }

    #[test]
    fn series_of_small_angles_agree_with_exp_and_log() {
        for scale in [0.0, 1e-12, 1e-5, 0.02, 0.1, 0.25, 0.33, 0.6] {
            for q in lattice() {
                let v = scale * log(q);
                assert!(exp_small(v).abs_diff_eq(exp(v), 5e-16), "{v}");
                for q in [exp(v), -exp(v)] {
                    let (short, exact) = (log_small(q), log(q));
                    assert!((short - exact).length() <= 1e-15 * exact.length(), "{q}");
                }
            }
        }
    }

    #[test]
    fn log_of_half_turn_does_not_depend_on_sign() {
        let q = DQuat::from_xyzw(0.0, -0.6, 0.8, 0.0);
        assert_eq!(log(q), log(-q));
        assert!(log(q).y > 0.0);
    }

    #[test]
    fn continuous_signs_keeps_rotations_without_jumps() {
        let flip = |(i, q): (usize, DQuat)| if i * i % 7 < 3 { -q } else { q };
        let rotations: Vec<_> = lattice().enumerate().map(flip).collect();
        let signed = continuous_signs(&rotations, 5).unwrap();
        assert!(signed[..5].iter().all(|q| q.w >= 0.0));
        assert!(
            signed
                .iter()
                .zip(&signed[5..])
                .all(|(a, b)| a.dot(*b) >= 0.0)
        );
        assert!(
            signed
                .iter()
                .zip(&rotations)
                .all(|(a, b)| a == b || *a == -*b)
        );
    }

    #[test]
    fn to_euler_every_order_round_trips() {
        for axes in [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]] {
            for q in lattice() {
                for near in [[0.0; 3], [3.0, -2.0, 8.0]] {
                    let angles = to_euler(&[q], axes, near).unwrap()[0];
                    let back = from_euler(&angles, &axes, 1).unwrap()[0];
                    assert!(angle(q, back) < 1e-12, "{axes:?} {q} {back}");
                }
            }
        }
    }

    #[test]
    fn sin_cos_is_within_stated_error_of_standard_library() {
        let steps = (-400_000..400_000).map(|n| f64::from(n) * 1.234_567e-4);
        let quarters = (-9..9).map(|n| f64::from(n) * 0.5 * PI);
        let far = [0.0, -0.0, 1e-300, 999_999.5, -999_999.5, 1e6 + 0.5, -1e9, 1e22, 1e300];
        for x in steps.chain(quarters).chain(far) {
            let ((sin, cos), (want_sin, want_cos)) = (sin_cos(x), x.sin_cos());
            let off = (sin - want_sin).abs().max((cos - want_cos).abs());
            assert!(off <= 2.3e-16, "{x}: {sin} {want_sin} {cos} {want_cos}");
        }
    }

    #[test]
    fn from_channels_equals_from_euler_with_continuous_sign() {
        // Two joints: Z of column 0 and X of column 3, then Y of column 1; column 2 is no turn.
        let (starts, turns) = ([0, 2, 3], [(2, 0), (0, 3), (1, 1)]);
        let values: Vec<f64> = (0..400).map(|n| f64::from(n * n % 97) * 7.0).collect();
        let rotations = from_channels(&values, 4, &starts, &turns, 0.1).expect("whole frames");
        for (frame, joints) in values.chunks(4).zip(rotations.chunks(2)) {
            let first = from_euler(&[0.1 * frame[0], 0.1 * frame[3]], &[2, 0], 1).unwrap()[0];
            let second = from_euler(&[0.1 * frame[1]], &[1], 1).unwrap()[0];
            assert!(joints[0].abs_diff_eq(first, 1e-14) || joints[0].abs_diff_eq(-first, 1e-14));
            assert!(joints[1].abs_diff_eq(second, 1e-14) || joints[1].abs_diff_eq(-second, 1e-14));
        }
        assert!(rotations[..2].iter().all(|q| q.w >= 0.0));
        for joint in 0..2 {
            let track: Vec<_> = rotations.iter().skip(joint).step_by(2).collect();
            assert!(track.windows(2).all(|pair| pair[0].dot(*pair[1]) >= 0.0));
        }
    }

    #[test]
    fn from_channels_of_missing_channel_returns_error() {
        let refused = |values: &[f64], starts: &[usize], turns: &[(usize, usize)]| {
            from_channels(values, 2, starts, turns, 1.0).err()
        };
        assert_eq!(refused(&[0.0; 4], &[0, 1], &[(2, 1)]), None);
        let short = Error::LengthMismatch { expected: 2, given: 3 };
        assert_eq!(refused(&[0.0; 3], &[0, 1], &[(2, 1)]), Some(short));
        for (starts, turns) in
            [([0, 2], [(2, 1)]), ([1, 0], [(2, 1)]), ([0, 1], [(3, 1)]), ([0, 1], [(2, 2)])]
        {
            assert_eq!(refused(&[0.0; 4], &starts, &turns), Some(Error::InvalidChannel));
        }
    }

    #[test]
    fn to_euler_in_gimbal_lock_keeps_first_angle_and_rotation() {
        for middle in [0.5 * PI, -0.5 * PI] {
            for axes in [[2, 0, 1], [0, 1, 2]] {
                let q = from_euler(&[0.3, middle, 1.1], &axes, 1).unwrap()[0];
                let angles = to_euler(&[q], axes, [0.2, 1.5, 1.0]).unwrap()[0];
                assert!((angles[0] - 0.2).abs() < 1e-12);
                assert!(angle(q, from_euler(&angles, &axes, 1).unwrap()[0]) < 1e-9);
            }
        }
    }

    #[test]
    fn to_euler_of_several_full_turns_is_continuous() {
        let turns: Vec<_> = (0..100)
            .map(|f| [0.2 * f64::from(f), 0.4, -0.15 * f64::from(f)])
            .collect();
        let flat = turns.concat();
        let rotations = from_euler(&flat, &[2, 0, 1], turns.len()).unwrap();
        for (angles, expected) in to_euler(&rotations, [2, 0, 1], [0.0; 3])
            .unwrap()
            .iter()
            .zip(&turns)
        {
            for (angle, expected) in angles.iter().zip(expected) {
                assert!((angle - expected).abs() < 1e-12);
            }
        }
    }
}
