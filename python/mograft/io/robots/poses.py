"""Motions of a robot from its root and joint angles, and the order of a root's quaternion."""

from dataclasses import replace
from pathlib import Path
from typing import NamedTuple, NoReturn

import numpy as np

from mograft._util.arrays import FloatArray
from mograft.errors import FormatError
from mograft.motion import rotations
from mograft.motion.hinges import NO_LIMIT, Hinges, TableLayout
from mograft.motion.motion import Motion
from mograft.motion.skeleton import Skeleton

DEFAULT_RATE = 30.0
"""Frames per second of a table that states none: that of Kimodo and of retargeted LAFAN1."""

COLUMNS_OF_ORDER = {"wxyz": [1, 2, 3, 0], "xyzw": [0, 1, 2, 3]}
"""Columns of x, y, z and w in each order of a quaternion."""

UNITS = {1.0: "m", 0.01: "cm", 0.001: "mm"}
"""Units of length by their metres."""

MAX_NORM_ERROR = 1e-3
_MAX_EXCESS = 0.5  # radians beyond the limits up to which angles are plausible
_MAX_FRAMES = 200  # frames that are compared
_MIN_STEP = 1e-4  # heights of the root; smaller steps are no evidence

_MIN_GAP = 0.08
"""Difference of the implausibilities of both orders from which on the order is not ambiguous.

In half a second of the recordings of a G1, turned to any heading, it is larger in 99 of 100 cases,
and in none has the wrong order the smaller one.
"""


class Pose(NamedTuple):
    """The root and the angles of a robot in every frame, in metres and radians."""

    positions: FloatArray  # (n_frames, 3)
    quats: FloatArray  # xyzw, (n_frames, 4)
    angles: FloatArray  # (n_frames, n_hinges)


def refuse_without_model(path: Path) -> NoReturn:
    """Raise the error for a motion of a robot that is read without its model."""
    remedy = "give --model, or in Python skeleton=mograft.formats.read_model(...)"
    if path.suffix.lower() == ".csv":
        remedy += "; other tables are no motions, which are .bvh, .glb, .fbx or .npz: one of clips "
        remedy += f"and their tags is for mograft index --tags {path}"
    raise FormatError(f"expected the model of the robot, got none: {remedy}", path)


def to_motion(
    model: Skeleton, pose: Pose, layout: TableLayout, frame_time: float = 1.0 / DEFAULT_RATE
) -> Motion:
    """Return the motion of a robot, whose skeleton has the layout of its file.

    Signs of quaternions are those of the file, or continue those of the frame before.
    """
    hinges, n_frames = hinges_of(model), len(pose.angles)
    quats = np.tile(rotations.IDENTITY, (n_frames, model.n_joints, 1))
    quats[:, hinges.joints] = hinges.rotations(pose.angles)
    root = pose.quats / np.linalg.norm(pose.quats, axis=1, keepdims=True)
    turned = np.where((root[1:] * root[:-1]).sum(axis=1) < 0.0, -1.0, 1.0)
    root[1:] *= np.cumprod(turned)[:, None]
    quats[:, 0] = root
    positions = np.tile(model.offsets, (n_frames, 1, 1))
    positions[:, 0] = pose.positions
    skeleton = replace(model, hinges=replace(hinges, layout=layout))
    return Motion(skeleton, frame_time, quats, positions)


def hinges_of(skeleton: Skeleton) -> Hinges:
    """Return the hinges of a robot; raise ValueError if the skeleton has none."""
    if skeleton.hinges is None:
        raise ValueError("`motion` must be the motion of a robot, whose skeleton has hinges")
    return skeleton.hinges


def to_pose(motion: Motion) -> Pose:
    """Return the root and the angles of a motion of a robot; raise ValueError for another."""
    angles = hinges_of(motion.skeleton).angles(motion.rotations)
    return Pose(motion.positions[:, 0], motion.rotations[:, 0], angles)


def find_unit(model: Skeleton, heights: FloatArray) -> float:
    """Return the metres in a unit of length, a key of `UNITS`, from heights of the root.

    With it the root is about as high as on straight legs. Raises ValueError if none is plausible.
    """
    ratio = float(np.percentile(np.abs(heights), 95)) / _standing_height(model)
    for unit in UNITS:
        if 0.05 <= ratio * unit < 5.0:
            return unit
    raise ValueError(f"expected heights of the root in m, cm or mm, got {ratio:.3g} of its legs")


def find_angle_unit(hinges: Hinges, values: FloatArray) -> float:
    """Return the radians in a unit of angles, with which angles fit the limits of the joints.

    Raises ValueError if neither radians nor degrees do.
    """
    free = [-2.0 * np.pi, 2.0 * np.pi]
    low, high = np.where(np.abs(hinges.limits) < NO_LIMIT, hinges.limits, free).T
    for unit in (1.0, np.pi / 180.0):
        excess = np.abs(unit * values - np.clip(unit * values, low, high)).max(axis=0)
        if excess.max() <= _MAX_EXCESS:
            return unit
    name = hinges.names[int(excess.argmax())]
    raise ValueError(f"expected angles within the limits of {name}, got {excess.max():.3g} beyond")


def find_quaternion_order(model: Skeleton, pose: Pose) -> tuple[str, str]:
    """Return the order of the quaternions of a pose, and a text with the evidence.

    The implausibility of an order is the sum of three terms: the standard deviation of the lowest
    point of the body, in heights of the root on straight legs; the mean of (1 - u) / 2, where u is
    the cosine of the angle from the vertical to the root's up axis; and d / (d + r), where d and r
    are the mean steps of the lowest point and of the root over the floor. In the wrong order, a
    robot that looks along an axis stands upright, but its feet slide. The norm and the continuity
    of quaternions do not depend on the order. Raises ValueError if the evidence does not decide.
    """
    last, height = len(pose.quats) - 1, _standing_height(model)
    rows = np.unique(np.linspace(0, max(last - 1, 0), _MAX_FRAMES).round().astype(int))
    some = Pose(*(own[np.append(rows, np.minimum(rows + 1, last))] for own in pose))
    found = []
    for order, columns in COLUMNS_OF_ORDER.items():
        motion = to_motion(model, some._replace(quats=some.quats[:, columns]), TableLayout())
        turned, places = motion.world_transforms()
        x, y = turned[:, 0, 0], turned[:, 0, 1]
        before, after = places.reshape(2, len(rows), -1, 3)[..., :2]
        steps = np.linalg.norm(after - before, axis=2)
        lowest = places[: len(rows), :, 2].argmin(axis=1)
        slide, root = steps[np.arange(len(rows)), lowest].mean(), steps[:, 0].mean()
        share = slide / (slide + root + _MIN_STEP * height)
        spread = places[..., 2].min(axis=1).std() / height
        found.append((float(spread + (x * x + y * y).mean() + share), order))
    (least, best), (second, other) = sorted(found)
    text = f"{best}, implausibility {least:.3f}, against {second:.3f} of {other}"
    if second - least < _MIN_GAP:
        raise ValueError(f"the order of quaternions is ambiguous ({text}): give --quaternion")
    return best, text


def _standing_height(model: Skeleton) -> float:
    return max(float(-model.rest_positions()[:, 2].min()), 1e-9)
