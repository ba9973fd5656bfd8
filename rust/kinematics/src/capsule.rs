//! How far capsules are apart: all points within a radius of a segment.
//!
//! A body's capsules in one frame are `n` pairs of end points, one after the other; frames
//! follow each other. A capsule of no length is a sphere. Distances are signed: negative by
//! how deep two bodies are in each other.

use glam::{DQuat, DVec3};

use crate::Error;
use crate::error::check_len;
use crate::rotation::rotate;

/// Both ends of every capsule in every frame.
///
/// `turned` and `placed` are world rotations and positions of `n_joints` joints, frame by
/// frame; capsule `i` hangs on joint `joints[i]` and ends at `bones[i]` in the joint's frame.
/// Takes O(frames × capsules) time.
///
/// # Errors
///
/// If the buffers are no whole number of frames or differ in length, or a joint is not there.
pub fn capsule_ends(
    turned: &[DQuat],
    placed: &[DVec3],
    n_joints: usize,
    joints: &[usize],
    bones: &[DVec3],
) -> Result<Vec<DVec3>, Error> {
    let n_frames = turned.len().checked_div(n_joints).unwrap_or(0);
    check_len(turned.len(), n_frames * n_joints)?;
    check_len(placed.len(), turned.len())?;
    check_len(bones.len(), joints.len())?;
    if let Some(&joint) = joints.iter().find(|&&joint| joint >= n_joints) {
        return Err(Error::LengthMismatch { expected: joint + 1, given: n_joints });
    }
    let mut ends = Vec::with_capacity(2 * n_frames * joints.len());
    for first in (0..turned.len()).step_by(n_joints.max(1)) {
        for (&joint, &bone) in joints.iter().zip(bones) {
            let start = placed[first + joint];
            ends.extend([start, start + rotate(turned[first + joint], bone)]);
        }
    }
    Ok(ends)
}

/// Distance between the segments from `a` to `b` and from `c` to `d`.
///
/// Parallel and degenerate segments included. Source: Ericson, Real-Time Collision
/// Detection (2005), 5.1.9.
pub fn segment_distance(a: DVec3, b: DVec3, c: DVec3, d: DVec3) -> f64 {
    let (along, other, between) = (b - a, d - c, a - c);
    let (aa, ee) = (along.length_squared(), other.length_squared());
    let (f, g) = (other.dot(between), along.dot(between));
    let (s, t) = if aa == 0.0 && ee == 0.0 {
        (0.0, 0.0)
    } else if aa == 0.0 {
        (0.0, (f / ee).clamp(0.0, 1.0))
    } else if ee == 0.0 {
        ((-g / aa).clamp(0.0, 1.0), 0.0)
    } else {
        let dot = along.dot(other);
        let spread = aa * ee - dot * dot;
        // Of parallel segments any point will do for a start.
        let free = if spread > 0.0 { ((dot * f - g * ee) / spread).clamp(0.0, 1.0) } else { 0.0 };
        let t = (dot * free + f) / ee;
        if t < 0.0 {
            ((-g / aa).clamp(0.0, 1.0), 0.0)
        } else if t > 1.0 {
            (((dot - g) / aa).clamp(0.0, 1.0), 1.0)
        } else {
            (free, t)
        }
    };
    (a + along * s).distance(c + other * t)
}

/// The least distance of any of some pairs of capsules in every frame, and which pair has it.
///
/// `ends` holds frames of `radii.len()` capsules, `others` frames of `other_radii.len()`;
/// frame `f` of the one meets frame `at[f]` of the other. `pairs` names the capsules of either
/// side that are compared; of equally near pairs the first is told. Without pairs the
/// distance is infinite and the pair -1. Takes O(frames × pairs) time; pairs whose bounding spheres are
/// farther apart than the nearest so far are passed over. NaN counts as far away.
///
/// # Errors
///
/// If a buffer is no whole number of frames, or a frame or capsule is not there.
pub fn clearance(
    ends: &[DVec3],
    radii: &[f64],
    others: &[DVec3],
    other_radii: &[f64],
    at: &[usize],
    pairs: &[(usize, usize)],
) -> Result<(Vec<f64>, Vec<i64>), Error> {
    let (width, other_width) = (2 * radii.len(), 2 * other_radii.len());
    check_len(ends.len(), at.len() * width)?;
    let n_others = others.len().checked_div(other_width).unwrap_or(0);
    check_len(others.len(), n_others * other_width)?;
    let there = |&(a, b): &(usize, usize)| a < radii.len() && b < other_radii.len();
    if let Some(pair) = pairs.iter().position(|pair| !there(pair)) {
        return Err(Error::BadPair { pair });
    }
    if let Some(&frame) = at
        .iter()
        .find(|&&frame| frame >= n_others && !pairs.is_empty())
    {
        return Err(Error::LengthMismatch { expected: frame + 1, given: n_others });
    }
    let round = |own: &[DVec3], radius: f64| {
        let (a, b) = (own[0], own[1]);
        ((a + b) * 0.5, a.distance(b) * 0.5 + radius)
    };
    let named = |side: fn(&(usize, usize)) -> usize| {
        let mut capsules: Vec<usize> = pairs.iter().map(side).collect();
        capsules.sort_unstable();
        capsules.dedup();
        capsules
    };
    let (own_named, far_named) = (named(|pair| pair.0), named(|pair| pair.1));
    let mut own = vec![(DVec3::ZERO, 0.0); radii.len()];
    let mut far = vec![(DVec3::ZERO, 0.0); other_radii.len()];
    let mut nearest = Vec::with_capacity(at.len());
    let mut which = Vec::with_capacity(at.len());
    for (frame, &met) in at.iter().enumerate() {
        let body = &ends[frame * width..][..width];
        let (mut least, mut pair_of_least) = (f64::INFINITY, -1_i64);
        if !pairs.is_empty() {
            let other = &others[met * other_width..][..other_width];
            for &i in &own_named {
                own[i] = round(&body[2 * i..], radii[i]);
            }
            for &j in &far_named {
                far[j] = round(&other[2 * j..], other_radii[j]);
            }
            for (index, &(i, j)) in (0_i64..).zip(pairs) {
                let ((middle, reach), (other_middle, other_reach)) = (own[i], far[j]);
                let apart = least + reach + other_reach;
                // A margin keeps rounding from passing over the nearest.
                if middle.distance_squared(other_middle) * (1.0 - 1e-12) > apart * apart
                    && apart > 0.0
                {
                    continue;
                }
                let (a, b) = (body[2 * i], body[2 * i + 1]);
                let (c, d) = (other[2 * j], other[2 * j + 1]);
                let distance = segment_distance(a, b, c, d) - radii[i] - other_radii[j];
                if distance < least {
                    (least, pair_of_least) = (distance, index);
                }
            }
        }
        nearest.push(least);
        which.push(pair_of_least);
    }
    Ok((nearest, which))
}

/// Distance of every capsule from a box, in the order of `ends`.
///
/// `center`, `half` extents and `rotation` place the box. The distance of a point from a box
/// is convex along a segment: forty thirds leave 1e-7 of its length. Takes O(capsules) time.
///
/// # Errors
///
/// If `ends` is no whole number of frames.
pub fn box_clearance(
    ends: &[DVec3],
    radii: &[f64],
    center: DVec3,
    half: DVec3,
    rotation: DQuat,
) -> Result<Vec<f64>, Error> {
    let n_frames = ends.len() / (2 * radii.len()).max(1);
    check_len(ends.len(), n_frames * 2 * radii.len())?;
    let back = rotation.conjugate();
    let distance = |point: DVec3| {
        let beyond = point.abs() - half;
        beyond.max(DVec3::ZERO).length() + beyond.max_element().min(0.0)
    };
    let nearest = |(capsule, &radius): (&[DVec3], &f64)| {
        let (a, b) = (back * (capsule[0] - center), back * (capsule[1] - center));
        let (mut low, mut high) = (0.0, 1.0);
        for _ in 0..40 {
            let third = (high - low) / 3.0;
            let (left, right) = (low + third, high - third);
            if distance(a.lerp(b, left)) <= distance(a.lerp(b, right)) {
                high = right;
            } else {
                low = left;
            }
        }
        let inner = distance(a.lerp(b, 0.5 * (low + high)));
        inner.min(distance(a)).min(distance(b)) - radius
    };
    Ok(ends
        .chunks_exact(2)
        .zip(radii.iter().cycle())
        .map(nearest)
        .collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    const X: DVec3 = DVec3::X;
    const Y: DVec3 = DVec3::Y;
    const Z: DVec3 = DVec3::Z;
    const O: DVec3 = DVec3::ZERO;

    #[test]
    fn known_distances_of_segments() {
        assert_eq!(segment_distance(O, X, Y, X + Y), 1.0); // parallel
        assert_eq!(segment_distance(O, X, 3.0 * X, 4.0 * X), 2.0); // in line
        assert_eq!(segment_distance(-X, X, Z - Y, Z + Y), 1.0); // crossing above
        assert_eq!(segment_distance(O, X, 2.0 * X + Y, 2.0 * X + Y), 2f64.sqrt()); // a point
        assert_eq!(segment_distance(O, O, 2.0 * Y, 2.0 * Y), 2.0); // two points
        assert_eq!(segment_distance(-X, X, -Y, Y), 0.0); // through each other
    }

    #[test]
    fn the_nearest_pair_is_told_and_of_equals_the_first() {
        let ends = [O, X, 5.0 * Y, 5.0 * Y];
        let others = [3.0 * Y, 3.0 * Y, 9.0 * Y, 9.0 * Y];
        let (distances, which) =
            clearance(&ends, &[0.5, 0.25], &others, &[1.0], &[1], &[(0, 0), (1, 0)]).unwrap();
        assert_eq!((distances[0], which[0]), (2.75, 1));
        let (distances, which) =
            clearance(&ends, &[0.5, 0.25], &others, &[1.0], &[0], &[(1, 0), (1, 0)]).unwrap();
        assert_eq!((distances[0], which[0]), (0.75, 0));
        let (distances, which) =
            clearance(&ends, &[0.5, 0.25], &others, &[1.0], &[0], &[]).unwrap();
        assert_eq!((distances[0], which[0]), (f64::INFINITY, -1));
    }

    #[test]
    fn a_capsule_lies_along_its_joint() {
        let quarter = DQuat::from_rotation_z(std::f64::consts::FRAC_PI_2);
        let ends = capsule_ends(&[DQuat::IDENTITY, quarter], &[O, X], 2, &[1], &[X]).unwrap();
        assert!(ends[0] == X && ends[1].abs_diff_eq(X + Y, 1e-15));
        assert!(capsule_ends(&[quarter], &[O], 1, &[1], &[X]).is_err());
    }

    #[test]
    fn what_is_not_there_is_refused() {
        let refusal = clearance(&[O, X], &[1.0], &[O, X], &[1.0], &[0], &[(0, 1)]).unwrap_err();
        assert_eq!(refusal, Error::BadPair { pair: 0 });
        assert!(clearance(&[O, X], &[1.0], &[O, X], &[1.0], &[1], &[(0, 0)]).is_err());
    }

    #[test]
    fn a_box_is_as_far_as_its_faces_edges_and_inside() {
        let ends = [2.0 * X, 3.0 * X, 2.0 * X + 2.0 * Y, 2.0 * X + 2.0 * Y, O, O];
        let found = box_clearance(&ends, &[0.5, 0.0, 0.0], O, DVec3::ONE, DQuat::IDENTITY).unwrap();
        assert_eq!(found, [0.5, 2f64.sqrt(), -1.0]);
    }
}
