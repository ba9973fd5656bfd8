//! The algebra of rotations that glam leaves out, exact near 0 and near a half turn.
//!
//! `glam`'s `to_scaled_axis` takes the longer way round when w < 0 and returns 0 below
//! 1e-8, and its `angle_between` goes through `acos`, which is blind near 0; hence these.

use std::f64::consts::{PI, TAU};

use glam::{DQuat, DVec3};

/// Below this length a vector part is its own sine.
const TINY: f64 = 1e-8;

/// The rotation by `v.length()` radians about `v`.
pub fn exp(v: DVec3) -> DQuat {
    let angle = v.length();
    if angle < TINY {
        // To first order, then made unit again: sin(x)/x differs from 1 by x²/6 < 1e-16.
        return DQuat::from_xyzw(0.5 * v.x, 0.5 * v.y, 0.5 * v.z, 1.0).normalize();
    }
    let (sin, cos) = (0.5 * angle).sin_cos();
    let xyz = v * (sin / angle);
    DQuat::from_xyzw(xyz.x, xyz.y, xyz.z, cos)
}

/// The shortest rotation vector of `q`, of length 0 to π.
///
/// A half turn has two; the one whose first nonzero component is positive is taken.
pub fn log(q: DQuat) -> DVec3 {
    let q = if q.w < 0.0 { -q } else { q };
    let xyz = q.xyz();
    let sin = xyz.length();
    if sin < TINY {
        return 2.0 * xyz;
    }
    let v = xyz * (2.0 * sin.atan2(q.w) / sin);
    let first = v.to_array().into_iter().find(|&c| c != 0.0).unwrap_or(0.0);
    if q.w == 0.0 && first < 0.0 { -v } else { v }
}

/// The angle between two rotations, 0 to π.
pub fn angle(a: DQuat, b: DQuat) -> f64 {
    let between = a.inverse() * b;
    2.0 * between.xyz().length().atan2(between.w.abs())
}

/// Spherical linear interpolation along the shorter arc; exactly `a` at 0 and ±`b` at 1.
///
/// Which way a half turn goes is decided by [`log`].
pub fn slerp(a: DQuat, b: DQuat, t: f64) -> DQuat {
    if t == 0.0 {
        a
    } else if t == 1.0 {
        if a.dot(b) < 0.0 { -b } else { b }
    } else {
        a * exp(t * log(a.inverse() * b))
    }
}

/// Rotations about one axis after the other, each about the axes already turned.
///
/// `angles` holds `axes.len()` angles in radians per rotation; axis 0, 1, 2 is x, y, z.
/// An empty order gives the identity `n` times.
pub fn from_euler(angles: &[f64], axes: &[usize], n: usize) -> Vec<DQuat> {
    let turn = |axis: usize, angle: f64| {
        let (sin, cos) = (0.5 * angle).sin_cos();
        let mut q = [0.0, 0.0, 0.0, cos];
        q[axis] = sin;
        DQuat::from_array(q)
    };
    (0..n)
        .map(|i| {
            let angles = &angles[i * axes.len()..][..axes.len()];
            let turns = axes
                .iter()
                .zip(angles)
                .map(|(&axis, &angle)| turn(axis, angle));
            turns.reduce(|q, next| q * next).unwrap_or(DQuat::IDENTITY)
        })
        .collect()
}

/// Euler angles of successive rotations, each as near to the one before as can be.
///
/// `axes` are three different axes, the angles are in radians. Of all triples that give a
/// rotation the one nearest to the previous frame's (the first: to `near`) is taken, so
/// the curves have no jump by a full turn; in gimbal lock the first angle stays as it was.
///
/// Half sums and half differences of the outer angles are found from the quaternion
/// itself, which loses nothing near the lock: Bernardes and Viollet, PLoS ONE 17(11), 2022.
pub fn to_euler(rotations: &[DQuat], axes: [usize; 3], near: [f64; 3]) -> Vec<[f64; 3]> {
    let mut near = near;
    rotations
        .iter()
        .map(|&q| {
            near = nearest_euler(q, axes, near);
            near
        })
        .collect()
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

    let (first, last) = if low < TINY {
        (near[0], sum - near[0])
    } else if high < TINY {
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

    fn spread() -> impl Iterator<Item = DQuat> {
        // A lattice of directions and lengths, some beyond a half turn, and the poles.
        let grid = [-2.9, -1.0, -1e-5, 0.0, 1e-9, 0.7, 1.6];
        grid.into_iter().flat_map(move |x| {
            grid.into_iter()
                .flat_map(move |y| grid.into_iter().map(move |z| exp(DVec3::new(x, y, z))))
        })
    }

    #[test]
    fn log_undoes_exp_along_the_shorter_way() {
        for q in spread() {
            let v = log(q);
            assert!(v.length() <= PI + 1e-15);
            let back = exp(v);
            assert!(back.abs_diff_eq(q, 1e-14) || back.abs_diff_eq(-q, 1e-14), "{q} {back}");
            assert!((angle(DQuat::IDENTITY, q) - v.length()).abs() < 1e-14);
        }
    }

    #[test]
    fn a_half_turn_has_one_logarithm() {
        let q = DQuat::from_xyzw(0.0, -0.6, 0.8, 0.0);
        assert_eq!(log(q), log(-q));
        assert!(log(q).y > 0.0);
    }

    #[test]
    fn euler_angles_give_their_rotation_back_in_every_order() {
        for axes in [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]] {
            for q in spread() {
                for near in [[0.0; 3], [3.0, -2.0, 8.0]] {
                    let angles = to_euler(&[q], axes, near)[0];
                    let back = from_euler(&angles, &axes, 1)[0];
                    assert!(angle(q, back) < 1e-12, "{axes:?} {q} {back}");
                }
            }
        }
    }

    #[test]
    fn gimbal_lock_keeps_the_first_angle_and_the_rotation() {
        for middle in [0.5 * PI, -0.5 * PI] {
            for axes in [[2, 0, 1], [0, 1, 2]] {
                let q = from_euler(&[0.3, middle, 1.1], &axes, 1)[0];
                let angles = to_euler(&[q], axes, [0.2, 1.5, 1.0])[0];
                assert!((angles[0] - 0.2).abs() < 1e-12);
                assert!(angle(q, from_euler(&angles, &axes, 1)[0]) < 1e-9);
            }
        }
    }

    #[test]
    fn euler_angles_follow_the_previous_frame_through_full_turns() {
        let turns: Vec<_> = (0..100)
            .map(|f| [0.2 * f64::from(f), 0.4, -0.15 * f64::from(f)])
            .collect();
        let flat = turns.concat();
        let rotations = from_euler(&flat, &[2, 0, 1], turns.len());
        for (angles, expected) in to_euler(&rotations, [2, 0, 1], [0.0; 3]).iter().zip(&turns) {
            for (angle, expected) in angles.iter().zip(expected) {
                assert!((angle - expected).abs() < 1e-12);
            }
        }
    }
}
