//! Distances between capsules, and from capsules to boxes.
//!
//! A capsule is the set of points within a radius of a segment; if the segment has length 0, it
//! is a sphere. The capsules of a body in one frame are pairs of end points, one after the other;
//! frames follow each other. Distances are signed: a negative distance is the penetration depth.

use glam::{DQuat, DVec3};

use crate::error::{Error, check_len};
use crate::rotation::rotate;
use mograft_machine::memory::{allocate, collect_first, with_capacity};

/// Both ends of every capsule in every frame.
///
/// `rotations` and `positions` are those of `n_joints` joints in the world, frame-major. Capsule
/// `i` starts at joint `joints[i]` and ends at `bones[i]` in the frame of that joint. Takes
/// O(frames × capsules) time. NaN affects the capsules of its joint in its frame.
///
/// # Errors
///
/// If the buffers are not a whole number of frames or differ in length, or a joint does not exist.
pub fn capsule_ends(
    rotations: &[DQuat],
    positions: &[DVec3],
    n_joints: usize,
    joints: &[usize],
    bones: &[DVec3],
) -> Result<Vec<DVec3>, Error> {
    let n_frames = rotations.len().checked_div(n_joints).unwrap_or(0);
    check_len(rotations.len(), n_frames * n_joints)?;
    check_len(positions.len(), rotations.len())?;
    check_len(bones.len(), joints.len())?;
    if let Some(&joint) = joints.iter().find(|&&joint| joint >= n_joints) {
        return Err(Error::InvalidJoint { joint });
    }
    let mut ends = with_capacity(2 * n_frames * joints.len())?;
    for first in (0..rotations.len()).step_by(n_joints.max(1)) {
        for (&joint, &bone) in joints.iter().zip(bones) {
            let start = positions[first + joint];
            ends.extend([start, start + rotate(rotations[first + joint], bone)]);
        }
    }
    Ok(ends)
}

/// Distance between the segments from `a` to `b` and from `c` to `d`.
///
/// Parallel segments and segments of length 0 are allowed. Source: Ericson, Real-Time
/// Collision Detection (2005), section 5.1.9.
pub fn segment_distance(a: DVec3, b: DVec3, c: DVec3, d: DVec3) -> f64 {
    let (direction, other, offset) = (b - a, d - c, a - c);
    let (aa, ee) = (direction.length_squared(), other.length_squared());
    let (f, g) = (other.dot(offset), direction.dot(offset));
    let (s, t) = if aa == 0.0 && ee == 0.0 {
        (0.0, 0.0)
    } else if aa == 0.0 {
        (0.0, (f / ee).clamp(0.0, 1.0))
    } else if ee == 0.0 {
        ((-g / aa).clamp(0.0, 1.0), 0.0)
    } else {
        let dot = direction.dot(other);
        let determinant = aa * ee - dot * dot;
        // For parallel segments any first point is correct.
        let s = if determinant > 0.0 { (dot * f - g * ee) / determinant } else { 0.0 };
        let s = s.clamp(0.0, 1.0);
        let t = (dot * s + f) / ee;
        if t < 0.0 {
            ((-g / aa).clamp(0.0, 1.0), 0.0)
        } else if t > 1.0 {
            (((dot - g) / aa).clamp(0.0, 1.0), 1.0)
        } else {
            (s, t)
        }
    };
    (a + direction * s).distance(c + other * t)
}

/// The smallest distance of any of some pairs of capsules in every frame, and the pair's index.
///
/// `ends` holds frames of `radii.len()` capsules, `others` frames of `other_radii.len()`; frame
/// `f` of `ends` is compared with frame `other_frames[f]` of `others`. `pairs` holds a capsule of
/// each side. Of equally near pairs the first is returned. Without pairs the distance is infinite
/// and the index -1. NaN counts as infinitely far. Takes O(frames × pairs) time; a pair is skipped
/// if its bounding spheres are farther apart than the nearest pair so far.
///
/// # Errors
///
/// If a buffer is not a whole number of frames, or a frame or capsule does not exist.
pub fn clearance(
    ends: &[DVec3],
    radii: &[f64],
    others: &[DVec3],
    other_radii: &[f64],
    other_frames: &[usize],
    pairs: &[(usize, usize)],
) -> Result<(Vec<f64>, Vec<i64>), Error> {
    let (width, other_width) = (2 * radii.len(), 2 * other_radii.len());
    check_len(ends.len(), other_frames.len() * width)?;
    let n_other_frames = others.len().checked_div(other_width).unwrap_or(0);
    check_len(others.len(), n_other_frames * other_width)?;
    let is_valid = |&(a, b): &(usize, usize)| a < radii.len() && b < other_radii.len();
    if let Some(pair) = pairs.iter().position(|pair| !is_valid(pair)) {
        return Err(Error::InvalidPair { pair });
    }
    if pairs.is_empty() {
        let n_frames = other_frames.len();
        return Ok((allocate(f64::INFINITY, n_frames)?, allocate(-1, n_frames)?));
    }
    if let Some(&frame) = other_frames.iter().find(|&&frame| frame >= n_other_frames) {
        return Err(Error::InvalidFrame { frame });
    }
    let mut bodies = [
        Body::new(radii, pairs.iter().map(|pair| pair.0)),
        Body::new(other_radii, pairs.iter().map(|pair| pair.1)),
    ];
    let mut distances = with_capacity(other_frames.len())?;
    let mut nearest = with_capacity(other_frames.len())?;
    for (frame, &other_frame) in other_frames.iter().enumerate() {
        bodies[0].set_frame(&ends[frame * width..][..width]);
        bodies[1].set_frame(&others[other_frame * other_width..][..other_width]);
        let (distance, pair) = nearest_pair(&bodies, pairs);
        distances.push(distance);
        nearest.push(pair);
    }
    Ok((distances, nearest))
}

/// The capsules of a body in one frame.
struct Body<'a> {
    radii: &'a [f64],
    /// The capsules that occur in pairs.
    capsules: Vec<usize>,
    /// Both ends of every capsule.
    ends: &'a [DVec3],
    /// Centre and radius of the bounding sphere of each of `capsules`.
    spheres: Vec<(DVec3, f64)>,
}

impl<'a> Body<'a> {
    fn new(radii: &'a [f64], capsules: impl Iterator<Item = usize>) -> Self {
        let mut capsules: Vec<usize> = capsules.collect();
        capsules.sort_unstable();
        capsules.dedup();
        let spheres = vec![(DVec3::ZERO, 0.0); radii.len()];
        Self { radii, capsules, ends: &[], spheres }
    }

    fn set_frame(&mut self, ends: &'a [DVec3]) {
        self.ends = ends;
        for &capsule in &self.capsules {
            let (a, b) = (ends[2 * capsule], ends[2 * capsule + 1]);
            let radius = a.distance(b) * 0.5 + self.radii[capsule];
            self.spheres[capsule] = ((a + b) * 0.5, radius);
        }
    }
}

/// The smallest distance of any of `pairs`, and its index.
fn nearest_pair(bodies: &[Body<'_>; 2], pairs: &[(usize, usize)]) -> (f64, i64) {
    let [body, other] = bodies;
    let mut nearest = (f64::INFINITY, -1);
    for (index, &(i, j)) in (0_i64..).zip(pairs) {
        let ((centre, radius), (other_centre, other_radius)) = (body.spheres[i], other.spheres[j]);
        let reach = nearest.0 + radius + other_radius;
        // The margin keeps rounding from skipping the nearest pair.
        let is_far = centre.distance_squared(other_centre) * (1.0 - 1e-12) > reach * reach;
        if is_far && reach > 0.0 {
            continue;
        }
        let (a, b) = (body.ends[2 * i], body.ends[2 * i + 1]);
        let (c, d) = (other.ends[2 * j], other.ends[2 * j + 1]);
        let distance = segment_distance(a, b, c, d) - body.radii[i] - other.radii[j];
        if distance < nearest.0 {
            nearest = (distance, index);
        }
    }
    nearest
}

/// Distance of every capsule from a box, in the order of `ends`.
///
/// The box has the given centre, half extents and rotation. The distance of a point from a box is
/// convex along a segment; forty steps of ternary search leave 1e-7 of its length. Takes
/// O(capsules) time. The result for a capsule with NaN is unspecified.
///
/// # Errors
///
/// If `ends` is not a whole number of frames.
pub fn box_clearance(
    ends: &[DVec3],
    radii: &[f64],
    center: DVec3,
    half_extents: DVec3,
    rotation: DQuat,
) -> Result<Vec<f64>, Error> {
    let n_frames = ends.len() / (2 * radii.len()).max(1);
    check_len(ends.len(), n_frames * 2 * radii.len())?;
    let inverse = rotation.conjugate();
    let distance = |point: DVec3| {
        let outside = point.abs() - half_extents;
        outside.max(DVec3::ZERO).length() + outside.max_element().min(0.0)
    };
    let nearest = |(capsule, &radius): (&[DVec3], &f64)| {
        let (a, b) = (inverse * (capsule[0] - center), inverse * (capsule[1] - center));
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
    let distances = ends.chunks_exact(2).zip(radii.iter().cycle()).map(nearest);
    Ok(collect_first(distances, ends.len() / 2)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    const X: DVec3 = DVec3::X;
    const Y: DVec3 = DVec3::Y;
    const Z: DVec3 = DVec3::Z;
    const O: DVec3 = DVec3::ZERO;

    #[test]
    fn segment_distance_of_known_segments_is_exact() {
        assert_eq!(segment_distance(O, X, Y, X + Y), 1.0); // parallel
        assert_eq!(segment_distance(O, X, 3.0 * X, 4.0 * X), 2.0); // in line
        assert_eq!(segment_distance(-X, X, Z - Y, Z + Y), 1.0); // crossing above
        assert_eq!(segment_distance(O, X, 2.0 * X + Y, 2.0 * X + Y), 2f64.sqrt()); // a point
        assert_eq!(segment_distance(O, O, 2.0 * Y, 2.0 * Y), 2.0); // two points
        assert_eq!(segment_distance(-X, X, -Y, Y), 0.0); // through each other
    }

    #[test]
    fn clearance_of_tied_pairs_returns_first() {
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
    fn capsule_ends_follow_joint_rotation() {
        let quarter = DQuat::from_rotation_z(std::f64::consts::FRAC_PI_2);
        let ends = capsule_ends(&[DQuat::IDENTITY, quarter], &[O, X], 2, &[1], &[X]).unwrap();
        assert!(ends[0] == X && ends[1].abs_diff_eq(X + Y, 1e-15));
        assert!(capsule_ends(&[quarter], &[O], 1, &[1], &[X]).is_err());
    }

    #[test]
    fn clearance_of_missing_capsule_or_frame_returns_error() {
        let error = clearance(&[O, X], &[1.0], &[O, X], &[1.0], &[0], &[(0, 1)]).unwrap_err();
        assert_eq!(error, Error::InvalidPair { pair: 0 });
        assert!(clearance(&[O, X], &[1.0], &[O, X], &[1.0], &[1], &[(0, 0)]).is_err());
    }

    #[test]
    fn box_clearance_of_face_edge_and_inside_is_exact() {
        let ends = [2.0 * X, 3.0 * X, 2.0 * X + 2.0 * Y, 2.0 * X + 2.0 * Y, O, O];
        let distances =
            box_clearance(&ends, &[0.5, 0.0, 0.0], O, DVec3::ONE, DQuat::IDENTITY).unwrap();
        assert_eq!(distances, [0.5, 2f64.sqrt(), -1.0]);
    }
}
