"""Write motions into copies of AMASS files."""

import os
import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from mograft._util.arrays import BoolArray, FloatArray
from mograft.errors import SkeletonMismatchError, join_names
from mograft.io.npz_archive import copy_npz_archive
from mograft.io.rest_pose import POSITION_TOLERANCE
from mograft.io.smpl.reader import AmassFile, open_amass_file, to_motion
from mograft.motion import rotations
from mograft.motion.motion import Motion
from mograft.motion.skeleton import Skeleton

_MAX_ANGLE = 1e-7  # radians
_MAX_DISTANCE = 1e-6  # metres
"""Differences up to which a pose counts as unchanged: the rounding of BVH files of six decimals."""


def write_amass(
    motion: Motion, path: str | os.PathLike[str], *, like: str | os.PathLike[str]
) -> None:
    """Write a copy of an AMASS file with another motion, such as a graft of the file's motion.

    Parameters
    ----------
    motion : Motion
        A motion with the joints of the body model of `like`, in any order, in metres.
    path : str or path
        The file to write.
    like : str or path
        The AMASS file to copy.

    Warns
    -----
    UserWarning
        If arrays with one row per frame, such as ``dmpls``, are omitted because the number of
        frames differs from that of `like`.

    Raises
    ------
    SkeletonMismatchError
        If the joints differ from those of the model of `like`.
    ValueError
        If a joint other than the root leaves its offset, which AMASS cannot store, or `like` has no
        array for a joint that rotates.
    FormatError
        If `like` is not a valid AMASS file.
    OSError
        If a file cannot be read or written.

    Notes
    -----
    A rotation vector or a translation of `like` keeps its bits if the motion has the same rotation
    or position in the same frame, within 1e-7 radians or 1e-6 metres. Motions that were stored as
    BVH have errors up to this size. Other rotations become shortest rotation vectors in the type of
    the array. Arrays of parts of ``poses``, such as ``pose_body``, are changed with it.
    ``mocap_framerate`` changes only if the rate of the motion differs. All other arrays, such as
    ``betas`` and ``gender``, keep their bits.
    """
    file = open_amass_file(Path(like))
    motion = _in_order_of(file, motion)
    _check_channels(motion, file)
    # The motion of the file on the same skeleton: equal poses are those that were not changed.
    source = to_motion(file, motion.skeleton, motion.rate)
    is_same = _same_rotations(motion, source)
    vectors = rotations.log(motion.rotations).reshape(motion.n_frames, -1)
    translations = motion.positions[:, 0] - motion.skeleton.offsets[0]
    replaced = {
        name: _merge(file, name, vectors[:, columns], is_same[:, columns])
        for name, columns in ((name, file.columns(name)) for name in file.pose_names)
    }
    replaced["trans"] = _merge(file, "trans", translations, _same_positions(motion, source))
    rate = file.rate(motion.rate)
    if file.rate_name is not None and abs(motion.rate - rate) > 1e-9 * rate:
        shape = file.archive.headers[file.rate_name].shape
        replaced[file.rate_name] = np.full(shape, motion.rate)
    omitted = _frame_arrays(file) if motion.n_frames != file.n_frames else ()
    copy_npz_archive(file.archive, Path(path), replaced, set(omitted))
    if omitted:
        warnings.warn(
            f"{path} lacks {join_names(omitted)}, which have one row per frame of {like}",
            stacklevel=2,
        )


def _in_order_of(file: AmassFile, motion: Motion) -> Motion:
    """Return a motion with its joints in the order of the model, which differs from that of BVH.

    Raises SkeletonMismatchError if the motion has other joints.
    """
    skeleton, model = motion.skeleton, file.model
    if sorted(skeleton.names) == sorted(model.joints):
        order = [skeleton.names.index(name) for name in model.joints]
        ordered = Skeleton(
            model.joints,
            model.parents,
            skeleton.offsets[order],
            tuple(skeleton.channels[joint] for joint in order),
        )
        above = np.where(model.parents < 0, -1, np.array(order)[model.parents])
        if np.array_equal(skeleton.parents[order], above):
            return replace(
                motion,
                skeleton=ordered,
                rotations=motion.rotations[:, order],
                positions=motion.positions[:, order],
                channel_values=None,
            )
    raise SkeletonMismatchError(
        f"`motion` must have the {len(model.joints)} joints of {model.name}, as in "
        f"{file.archive.path}, got {skeleton.n_joints} joints, the first of which is "
        f"{skeleton.names[0]}"
    )


def _check_channels(motion: Motion, file: AmassFile) -> None:
    """Raise ValueError if the file cannot store the motion; see `write_amass`."""
    skeleton, model = motion.skeleton, file.model
    gaps = np.abs(motion.positions - skeleton.offsets)[:, 1:].max(axis=(0, 2), initial=0.0)
    moved = np.flatnonzero(gaps > POSITION_TOLERANCE * np.abs(skeleton.offsets).max(initial=1.0))
    if len(moved):
        raise ValueError(
            "AMASS can translate the root only, got a joint that leaves its offset, "
            f"{skeleton.names[moved[0] + 1]}"
        )
    stored = np.zeros(model.n_columns, bool)
    for name in file.pose_names:
        stored[file.columns(name)] = True
    is_turned = np.abs(motion.rotations[..., :3]).max(axis=(0, 2)) > 0
    lost = np.flatnonzero(is_turned & ~stored[::3])
    if len(lost):
        raise ValueError(
            f"{file.archive.path} has no array for the rotations of {skeleton.names[lost[0]]}"
        )


def _merge(file: AmassFile, name: str, values: FloatArray, is_same: BoolArray) -> npt.NDArray[Any]:
    """Return `values` in the type of an array of the file, with the file's values where `is_same`.

    `is_same` has as many columns as `values`, and at most as many rows.
    """
    old = file.archive.read(name, (file.n_frames, values.shape[1]))
    new = values.astype(old.dtype if old.dtype.kind == "f" else np.float64)
    rows = slice(len(is_same))
    new[rows][is_same] = old[rows][is_same]
    return new


def _same_rotations(motion: Motion, source: Motion) -> BoolArray:
    """Return whether each rotation of a motion is that of the file in the same frame.

    The shape is (number of common frames, 3 n_joints): each result is repeated for the three
    components of the rotation vector.
    """
    rows = slice(min(motion.n_frames, source.n_frames))
    own, other = motion.rotations[rows], source.rotations[rows]
    # Half the angle between them is at most the distance of the quaternions.
    gaps = np.minimum(np.abs(own - other).max(axis=-1), np.abs(own + other).max(axis=-1))
    same: BoolArray = gaps <= 0.5 * _MAX_ANGLE
    return np.repeat(same, 3, axis=1)


def _same_positions(motion: Motion, source: Motion) -> BoolArray:
    """Return whether each position of the root is that of the file in the same frame.

    The shape is (number of common frames, 3): each result is repeated for the three coordinates.
    """
    rows = slice(min(motion.n_frames, source.n_frames))
    gaps = np.abs(motion.positions[rows, 0] - source.positions[rows, 0]).max(axis=-1)
    same: BoolArray = gaps <= _MAX_DISTANCE
    return np.repeat(same[:, None], 3, axis=1)


def _frame_arrays(file: AmassFile) -> tuple[str, ...]:
    """Return the names of the arrays with one row per frame that `write_amass` does not replace."""
    used = {*file.pose_names, file.rate_name, "trans", "betas"}
    return tuple(
        name
        for name, header in file.archive.headers.items()
        if name not in used and header.shape[:1] == (file.n_frames,)
    )
