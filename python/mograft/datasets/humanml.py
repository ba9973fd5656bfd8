"""The features of HumanML3D (Guo et al., 2022) for the 22 joints that the SMPL models share.

For joints in metres, y up, at 20 frames per second, each row has 263 numbers:

====================  ==========================================================================
columns               contents
====================  ==========================================================================
0                     yaw rate of the root: arcsine of the y part of the quaternion between the
                      headings of this frame and the next, so half of the angle
1, 2                  displacement of the root to the next frame, x and z, in the heading
3                     height of the root
4 to 66               positions of joints 1 to 21 relative to the root over the floor, in the
                      heading; heights are above the floor
67 to 192             rotations of joints 1 to 21: first two columns of their matrices, one after
                      the other, relative to the joint before in the chain
193 to 258            displacements of joints 0 to 21 to the next frame, in the heading
259 to 262            contact, 0 or 1: left ankle, left foot, right ankle, right foot
====================  ==========================================================================

The formulas are those of the script of the data set, with two of its properties that are easily
missed: the heading uses the direction between the shoulders minus that between the hips, smoothed
over time, and the rotations of arms begin again at the root. The script also gives all bodies the
bone lengths of one recording, which is not public; here bones keep their lengths.
"""

import itertools

import numpy as np

from mograft._util.arrays import FloatArray, as_floats
from mograft._util.gaussian import gaussian_kernel
from mograft.errors import join_names
from mograft.io.export_figure import ExportTransform
from mograft.io.smpl.body_models import BODY_JOINTS
from mograft.motion import rotations
from mograft.motion.motion import Motion
from mograft.motion.skeleton import Skeleton

HUMANML_RATE = 20.0
"""Frames per second of the data set."""

_CHAINS = (
    (0, 2, 5, 8, 11),
    (0, 1, 4, 7, 10),
    (0, 3, 6, 9, 12, 15),
    (9, 14, 17, 19, 21),
    (9, 13, 16, 18, 20),
)
_LEFT_HIP, _RIGHT_HIP, _LEFT_SHOULDER, _RIGHT_SHOULDER = 1, 2, 16, 17
_FEET = (7, 10, 8, 11)
_MAX_SQUARED_STEP = 0.002  # of a foot in contact, in square metres
_SMOOTHING = 20.0  # standard deviation of the heading, in frames
_DIRECTIONS = np.array([[0, 1, 0], [0, -1, 0], [1, 0, 0], [-1, 0, 0], [0, 0, 1.0]])
_BONES = _DIRECTIONS[[0, 2, 3, 0, 1, 1, 0, 1, 1, 0, 4, 4, 0, 2, 3, 4, 1, 1, 1, 1, 1, 1]]
"""Direction of the bone to each joint in the reference pose; that of joint 0 is not used."""


def check_humanml_joints(skeleton: Skeleton) -> None:
    """Raise ValueError if a skeleton lacks one of the 22 joints."""
    missing = [name for name in BODY_JOINTS if name not in skeleton.names]
    if missing:
        raise ValueError(
            "`features`: humanml3d needs the 22 joints of SMPL, as of AMASS files; the skeleton "
            f"lacks {join_names(missing)}"
        )


def humanml_joints(motion: Motion) -> FloatArray:
    """Return the world positions of the 22 joints in metres, y up, shape (n_frames, 22, 3)."""
    check_humanml_joints(motion.skeleton)
    joints = [motion.skeleton.index(name) for name in BODY_JOINTS]
    return ExportTransform.of(motion, None).points(motion.world_positions()[:, joints])


def humanml3d(joints: FloatArray) -> FloatArray:
    """Return the 263 features of HumanML3D.

    Parameters
    ----------
    joints : array_like, shape (n_frames, 22, 3)
        World positions of the joints of SMPL in metres, y up, at 20 frames per second; at least two
        frames.

    Returns
    -------
    ndarray, shape (n_frames - 1, 263)
        The features; the columns are listed in the documentation of the data sets.

    Raises
    ------
    ValueError
        If the shape is another.
    """
    points = as_floats("joints", joints, ("n_frames", len(BODY_JOINTS), 3)).copy()
    if len(points) < 2:
        raise ValueError(f"`joints` must have at least two frames, got {len(points)}")
    points[..., 1] -= points[..., 1].min()
    points -= points[0, 0] * [1.0, 0.0, 1.0]
    across = points[0, _RIGHT_HIP] - points[0, _LEFT_HIP]
    across = across + points[0, _RIGHT_SHOULDER] - points[0, _LEFT_SHOULDER]
    points = rotations.rotate(_to_front(np.cross([0.0, 1.0, 0.0], across)), points)
    heading, turns = _inverse_kinematics(points)
    steps = np.diff(points, axis=0)
    feet = (steps[:, _FEET] ** 2).sum(axis=2) < _MAX_SQUARED_STEP
    between = rotations.multiply(heading[1:], rotations.inverse(heading[:-1]))
    velocity = rotations.rotate(heading[1:], steps[:, 0])
    local = rotations.rotate(heading[:, None], points - points[:, :1] * [1.0, 0.0, 1.0])[:-1]
    columns = [rotations.rotate(turns[:-1, 1:], axis) for axis in np.eye(3)[:2]]
    displacements = rotations.rotate(heading[:-1, None], steps)
    angles = np.arcsin(np.clip(between[:, 1:2], -1.0, 1.0))
    of_joints = [local[:, 1:], np.concatenate(columns, axis=2), displacements]
    rows = [own.reshape(len(steps), -1) for own in of_joints]
    return np.concatenate([angles, velocity[:, [0, 2]], local[:, 0, 1:2], *rows, feet], axis=1)


def _inverse_kinematics(points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the rotation from the heading to +z, (n, 4), and those of the joints, (n, 22, 4)."""
    across = points[:, _LEFT_HIP] - points[:, _RIGHT_HIP]
    across = across + points[:, _RIGHT_SHOULDER] - points[:, _LEFT_SHOULDER]
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    forward = np.cross([0.0, 1.0, 0.0], across)
    kernel = gaussian_kernel(_SMOOTHING)
    radius = len(kernel) // 2
    padded = np.pad(forward, ((radius, radius), (0, 0)), mode="edge")
    smooth = [np.convolve(column, kernel, mode="valid") for column in padded.T]
    heading = _to_front(np.stack(smooth, axis=1))
    turns = np.zeros((*points.shape[:2], 4))
    turns[:, 0] = heading
    for chain in _CHAINS:
        above = heading
        for joint, child in itertools.pairwise(chain):
            bones = points[:, child] - points[:, joint]
            lengths = np.linalg.norm(bones, axis=1, keepdims=True)
            world = rotations.shortest_arc(_BONES[child], bones / np.maximum(lengths, 1e-12))
            turns[:, child] = rotations.multiply(rotations.inverse(above), world)
            above = world
    return heading, turns


def _to_front(forward: FloatArray) -> FloatArray:
    """Return the rotation from a horizontal direction, shape (..., 3), to +z."""
    unit = forward / np.maximum(np.linalg.norm(forward, axis=-1, keepdims=True), 1e-12)
    return rotations.shortest_arc(unit, np.array([0.0, 0.0, 1.0]))
