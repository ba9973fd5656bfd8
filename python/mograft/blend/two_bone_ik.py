"""Inverse kinematics of limbs of two bones, and of legs."""

import numpy as np

from mograft._util.arrays import FloatArray
from mograft.blend.recombine import Part
from mograft.body.contacts import Leg
from mograft.motion import rotations
from mograft.motion.motion import Motion

_USUAL_AXIS_WEIGHT = 0.1  # weight of the mean bend axis; that of a frame is the sine of its bend


def bend_limb(
    start: FloatArray, middle: FloatArray, end: FloatArray, target: FloatArray, axis: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the rotations that move the end of a limb of two bones to a target, each (n, 4).

    `start`, `middle` and `end`, shape (n, 3), are positions of the limb's first joint, of the joint
    between its bones, and of its end. If `target` is out of reach, the limb is straightened towards
    it. The limb bends about the unit vectors `axis`, roughly perpendicular to both bones: for a
    knee the cross product of thigh and shank. The results are world rotations: that of the whole
    limb about its start, and that of the lower bone about the middle joint. The second one is
    applied first.
    """
    upper, lower = start - middle, end - middle
    upper_along, upper_across = _split(upper, axis)
    lower_along, lower_across = _split(lower, axis)
    product = np.linalg.norm(upper_across, axis=1) * np.linalg.norm(lower_across, axis=1)
    squared_reach = ((target - start) ** 2).sum(axis=1)
    cosine = 0.5 * ((upper**2).sum(axis=1) + (lower**2).sum(axis=1) - squared_reach)
    cosine = (cosine - upper_along * lower_along) / np.maximum(product, 1e-300)
    angle = _signed_angles(upper_across, lower_across, axis)
    half = 0.5 * (np.arccos(cosine.clip(-1.0, 1.0)) - angle)[:, None]
    at_middle = np.concatenate([np.sin(half) * axis, np.cos(half)], axis=1)
    bent_end = middle + rotations.rotate(at_middle, lower) - start
    given_end, direction = end - start, target - start
    # The first arc is in the plane of the limb, so only the second rotates that plane.
    at_start = rotations.multiply(
        rotations.shortest_arc(given_end, direction), rotations.shortest_arc(bent_end, given_end)
    )
    return at_start, at_middle


def flexion_angles(
    start: FloatArray, middle: FloatArray, end: FloatArray, axis: FloatArray
) -> FloatArray:
    """Return by how many radians a limb of two bones is bent about unit vectors `axis`, (n,).

    A straight limb has the angle 0, and one that is bent backwards a negative angle. The arguments
    are those of `bend_limb`.
    """
    _, upper = _split(start - middle, axis)
    _, lower = _split(end - middle, axis)
    angles = _signed_angles(upper, lower, axis)
    return np.where(angles > 0.0, np.pi - angles, -np.pi - angles)


def _split(vectors: FloatArray, axis: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the components of vectors along unit vectors, (n,), and across them, (n, 3)."""
    along = (vectors * axis).sum(axis=1)
    return along, vectors - along[:, None] * axis


def _signed_angles(upper: FloatArray, lower: FloatArray, axis: FloatArray) -> FloatArray:
    """Return the angles about `axis` from vectors `upper` to `lower`, perpendicular to it."""
    return np.arctan2((np.cross(upper, lower) * axis).sum(axis=1), (upper * lower).sum(axis=1))


def bend_leg(
    motion: Motion,
    world_rotations: FloatArray,
    world_positions: FloatArray,
    leg: Leg,
    points: FloatArray,
    displacements: FloatArray,
) -> Part | None:
    """Return the rotations of hip, knee and ankle that displace heel and toe by `displacements`.

    The world transforms, shape (n_frames, n_joints, 4 or 3), and `points`, the positions of heel
    and toe, are those after the root has been moved. `points` and `displacements` have shape
    (n_frames, 2, 3). Frames with displacements of 0 are kept bit for bit. The result is None if all
    displacements are 0.
    """
    joints = np.array([leg.hip, leg.knee, leg.ankle])
    is_moved = (displacements != 0.0).any(axis=(1, 2))
    frames = np.flatnonzero(is_moved)
    if not len(frames):
        return None
    limb = (world_positions[:, joint] for joint in joints)
    axis = bend_axes(world_rotations[:, leg.hip], *limb)[frames]
    hip, knee, ankle = (world_positions[frames, joint] for joint in joints)
    given, target = points[frames], points[frames] + displacements[frames]
    at_hip, at_knee = bend_limb(hip, knee, ankle, target[:, 0], axis)
    foot_rotation = rotations.shortest_arc(given[:, 1] - given[:, 0], target[:, 1] - target[:, 0])
    inverse_knee, inverse_hip = rotations.inverse(at_knee), rotations.inverse(at_hip)
    at_ankle = rotations.multiply(rotations.multiply(inverse_knee, inverse_hip), foot_rotation)
    quats = motion.rotations[:, joints].copy()
    for column, (joint, change) in enumerate(zip(joints, (at_hip, at_knee, at_ankle), strict=True)):
        parent = int(motion.skeleton.parents[joint])
        if parent >= 0:
            change = rotations.multiply(rotations.inverse(world_rotations[frames, parent]), change)
        quats[frames, column] = rotations.multiply(change, world_rotations[frames, joint])
    quats /= np.linalg.norm(quats, axis=-1, keepdims=True)
    quats = np.where(is_moved[:, None, None], quats, motion.rotations[:, joints])
    return Part(joints, quats, motion.positions[:, joints])


def bend_axes(
    start_rotations: FloatArray,
    start: FloatArray,
    middle: FloatArray,
    end: FloatArray,
    usual: FloatArray | None = None,
) -> FloatArray:
    """Return the world axis about which a limb of two bones bends in each frame, (n_frames, 3).

    The axis is the normal of the plane of the limb. In a nearly straight limb it approaches
    `usual`, shape (3,), in the local axes of the limb's first joint: by default `mean_bend_axis`.
    `start_rotations` are world rotations of the first joint, the positions those of `bend_limb`.
    """
    if usual is None:
        usual = mean_bend_axis(start_rotations, start, middle, end)
    world = rotations.rotate(start_rotations, np.tile(usual, (len(start_rotations), 1)))
    axes = _limb_normals(start, middle, end) + _USUAL_AXIS_WEIGHT * world
    return axes / np.linalg.norm(axes, axis=1, keepdims=True)


def mean_bend_axis(
    start_rotations: FloatArray, start: FloatArray, middle: FloatArray, end: FloatArray
) -> FloatArray:
    """Return the mean normal of a limb over all frames, in the local axes of its first joint.

    The result is a unit vector. For a limb that never bends, it is perpendicular to the upper bone.
    """
    normal = _limb_normals(start, middle, end)
    mean = rotations.rotate(rotations.inverse(start_rotations), normal).sum(axis=0)
    if np.linalg.norm(mean) < 1e-9:
        upper = (start - middle)[:1]
        along = rotations.rotate(rotations.inverse(start_rotations[:1]), upper)[0]
        mean = np.cross(along, np.eye(3)[np.argmin(np.abs(along))])
    return mean / np.linalg.norm(mean)


def _limb_normals(start: FloatArray, middle: FloatArray, end: FloatArray) -> FloatArray:
    """Return normals of the plane of a limb, (n, 3); the length is the sine of the bend."""
    upper, lower = start - middle, end - middle
    lengths = np.linalg.norm(upper, axis=1) * np.linalg.norm(lower, axis=1)
    return np.cross(upper, lower) / np.where(lengths > 0, lengths, 1.0)[:, None]
