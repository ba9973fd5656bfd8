"""The NPZ files that whole-body trackers are trained on, computed without a simulator."""

import io
import os
from pathlib import Path
from typing import Any, Literal

import numpy as np

from mograft._util.arrays import FloatArray, IntArray
from mograft._util.atomic import write_bytes
from mograft.io.clips import Clips, errors_of_file, single_clip
from mograft.io.npz import open_npz_archive
from mograft.io.robots import poses
from mograft.motion import rotations
from mograft.motion.hinges import TableLayout
from mograft.motion.motion import Motion
from mograft.motion.skeleton import Skeleton

ORDERS = ("mjlab", "beyondmimic")
"""Trackers by the order of their joints and bodies: depth first, as in the model; breadth first."""

_MAX_DISTANCE = 0.02  # metres between the bodies of a file and those of its angles


def orders_of(skeleton: Skeleton, tracker: str) -> tuple[IntArray, IntArray]:
    """Return the indices of joints in `Hinges.names`, and of bodies in `Hinges.bodies`."""
    hinges = poses.hinges_of(skeleton)
    levels = np.array([len(skeleton.ancestors(joint)) for joint in range(skeleton.n_joints)])
    levels *= tracker != "mjlab"
    first, second = (levels[own].argsort(kind="stable") for own in (hinges.joints, hinges.bodies))
    return first, second


def write_tracker(
    motion: Motion,
    path: str | os.PathLike[str],
    *,
    tracker: Literal["mjlab", "beyondmimic"] = "mjlab",
) -> None:
    """Write a robot's motion as the reference of a whole-body tracker.

    Parameters
    ----------
    motion : Motion
        The motion of a robot, whose skeleton has `hinges`, at the rate of the tracker.
    path : str or path
        The NPZ file to write.
    tracker : {"mjlab", "beyondmimic"}
        Whose order joints and bodies have: depth first, as in the model, or breadth first.

    Raises
    ------
    ValueError
        If an argument is invalid or the skeleton has no hinges.
    OSError
        If the file cannot be written.

    Notes
    -----
    The arrays for F frames, N joints and B bodies, in float32, SI units and world axes with z up:
    ``fps`` (1,), ``joint_pos`` and ``joint_vel`` (F, N), ``body_pos_w`` (F, B, 3), ``body_quat_w``
    (F, B, 4) in the order wxyz, ``body_lin_vel_w`` and ``body_ang_vel_w`` (F, B, 3), and
    ``joint_names`` and ``body_names``. Bodies are the root and those that a joint moves; positions
    and velocities are those of their origins. Velocities of the joints and of the root are central
    differences, those of the bodies follow from them.
    """
    hinges = poses.hinges_of(motion.skeleton)
    if tracker not in ORDERS:
        raise ValueError(f"`tracker` must be {' or '.join(ORDERS)}, got {tracker!r}")
    joints, order = orders_of(motion.skeleton, tracker)
    angles = poses.to_pose(motion).angles
    turned, places = body_transforms(motion)
    speeds, linear, angular = _velocities(motion, angles, places)
    quats = rotations.continuous_signs(turned)[..., [3, 0, 1, 2]]
    arrays = {
        "fps": np.array([motion.rate]),
        "joint_pos": angles[:, joints],
        "joint_vel": speeds[:, joints],
        "body_pos_w": places[:, order],
        "body_quat_w": quats[:, order],
        "body_lin_vel_w": linear[:, order],
        "body_ang_vel_w": angular[:, order],
    }
    packed: dict[str, Any] = {name: own.astype(np.float32) for name, own in arrays.items()}
    packed["joint_names"] = np.array(hinges.names)[joints]
    packed["body_names"] = np.array(motion.skeleton.names)[hinges.bodies[order]]
    buffer = io.BytesIO()
    np.savez(buffer, **packed)
    write_bytes(Path(path), buffer.getvalue())


def body_transforms(motion: Motion) -> tuple[FloatArray, FloatArray]:
    """Return the world rotations and origins of `Hinges.bodies`, in the axes of the model."""
    hinges = poses.hinges_of(motion.skeleton)
    turned, places = (own[:, hinges.bodies] for own in motion.world_transforms())
    places = places + rotations.rotate(turned, hinges.origins[hinges.bodies])
    return rotations.multiply(turned, hinges.frames[hinges.bodies]), places


def _velocities(
    motion: Motion, angles: FloatArray, places: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the velocities of the joints, and linear and angular ones of the bodies."""
    skeleton, rate = motion.skeleton, motion.rate
    hinges, n = poses.hinges_of(skeleton), motion.n_frames
    turned, joints = motion.world_transforms()
    speeds, root = np.zeros_like(angles), np.zeros((n, 3))
    angular, linear = np.zeros_like(joints), np.zeros_like(joints)
    if n > 1:
        speeds, root = (np.gradient(own, axis=0) * rate for own in (angles, joints[:, 0]))
        middle = np.clip(np.arange(n), 1, max(n - 2, 1))  # at the ends as in the frame inside
        first, last = middle - 1, np.minimum(middle + 1, n - 1)
        product = rotations.multiply(turned[last, 0], rotations.inverse(turned[first, 0]))
        product /= np.linalg.norm(product, axis=1, keepdims=True)
        angular[:, 0] = rotations.log(product) * (rate / (last - first))[:, None]
    linear[:, 0] = root
    spins = np.zeros_like(joints)
    axes = rotations.rotate(turned[:, hinges.joints], hinges.axes)
    spins[:, hinges.joints] = speeds[..., None] * axes
    for joint, parent in enumerate(skeleton.parents[1:].tolist(), start=1):
        arm = joints[:, joint] - joints[:, parent]
        linear[:, joint] = linear[:, parent] + np.cross(angular[:, parent], arm)
        angular[:, joint] = angular[:, parent] + spins[:, joint]
    own = angular[:, hinges.bodies]
    moved = linear[:, hinges.bodies] + np.cross(own, places - joints[:, hinges.bodies])
    return speeds, moved, own


def open_tracker(path: Path, *, rate: float | None, skeleton: Skeleton | None) -> Clips:
    """Return the clip of a tracker's file; see `mograft.io.formats.Opener`.

    `skeleton` is the result of `read_model`. The order of joints and bodies is the one in which the
    angles give the positions of the bodies.
    """
    model = skeleton
    if model is None or model.hinges is None:
        return single_clip(path, "robot NPZ", lambda: poses.refuse_without_model(path), rate)
    archive = open_npz_archive(path)
    angles = archive.read_floats("joint_pos", ("n_frames", len(model.hinges.names)))
    shape = (len(angles), len(model.hinges.bodies))
    places = archive.read_floats("body_pos_w", (*shape, 3))
    quats = archive.read_floats("body_quat_w", (*shape, 4))[:, 0, poses.COLUMNS_OF_ORDER["wxyz"]]
    header = archive.headers.get("fps")
    fps = archive.read_floats("fps", header.shape if header else ())
    with errors_of_file(path):
        if not len(angles) or fps.size != 1 or not fps > 0.0:
            raise ValueError(f"expected frames and a rate above 0, got {len(angles)} and {fps}")
        found = []
        for tracker in ORDERS:
            joints, bodies = orders_of(model, tracker)
            pose = poses.Pose(places[:, 0], quats, angles[:, np.argsort(joints)])
            layout = TableLayout("wxyz", is_single=True)
            motion = poses.to_motion(model, pose, layout, 1.0 / fps.item())
            error = float(np.abs(body_transforms(motion)[1][:, bodies] - places).max())
            found.append((error, tracker, motion))
        error, tracker, motion = min(found, key=lambda own: own[0])
        if error > _MAX_DISTANCE:
            got = f"bodies {error:.2g} m away from those of the model with these angles"
            raise ValueError(f"expected bodies in the order of {' or '.join(ORDERS)}, got {got}")
    notes = (f"order of joints and bodies: {tracker}, bodies within {error:.2g} m",)
    return single_clip(path, "robot NPZ", lambda: motion, rate, notes=notes)
