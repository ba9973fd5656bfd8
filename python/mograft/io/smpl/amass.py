"""AMASS files: reading of the rotation vectors of SMPL, SMPL-H or SMPL-X, and changed copies."""

import os
import warnings
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from mograft._util.arrays import BoolArray, FloatArray
from mograft.errors import SkeletonMismatchError, join_names
from mograft.io.clips import Clips, errors_of_file, single_clip
from mograft.io.npz import NpzArchive, copy_npz_archive, open_npz_archive
from mograft.io.rest_pose import POSITION_TOLERANCE
from mograft.io.smpl.body_models import MODELS, SMPL_H, SMPL_X, BodyModel, rest_skeleton
from mograft.motion import limits, rotations
from mograft.motion.motion import Motion
from mograft.motion.skeleton import Skeleton

_MAX_ANGLE = 1e-7  # radians
_MAX_DISTANCE = 1e-6  # metres
"""Differences up to which a pose counts as unchanged: the rounding of BVH files of six decimals."""

_RATE_NAMES = ("mocap_framerate", "mocap_frame_rate")


@dataclass(frozen=True, eq=False)
class AmassFile:
    """The headers of an AMASS file."""

    archive: NpzArchive
    model: BodyModel
    n_frames: int
    columns: dict[str, slice]  # of the poses in each array: in ``poses``, those of parts, or both
    rate_name: str | None  # of the array with the frames per second; None if there is none

    def poses(self) -> FloatArray:
        """Read the rotation vectors, shape (n_frames, n_columns); zero for absent parts."""
        names = ("poses",) if "poses" in self.columns else self.columns
        vectors = np.zeros((self.n_frames, self.model.n_columns))
        for name in names:
            vectors[:, self.columns[name]] = self.archive.read_floats(name, ("n_frames", "n"))
        return vectors

    def rate(self, given: float | None) -> float:
        """Return the frames per second that the file states, or `given` if it states none.

        Raises `FormatError` if the file states none and `given` is None, or if the rate is invalid.
        """
        if self.rate_name is None:
            if given is None:
                message = "expected frames per second, got no such array; give a rate"
                raise self.archive.error(_RATE_NAMES[0], message)
            return given
        shape = () if self.archive.headers[self.rate_name].shape == () else (1,)
        rate = float(self.archive.read_floats(self.rate_name, shape).reshape(()))
        if not rate > 0:
            raise self.archive.error(self.rate_name, f"expected frames per second, got {rate:g}")
        with errors_of_file(self.archive.path, f"array `{self.rate_name}`"):
            limits.check_frame_time(1.0 / rate)
        return rate


def open_amass_file(path: Path) -> AmassFile:
    """Check the headers of an AMASS file; raise `FormatError` if a shape is wrong."""
    archive, name = open_npz_archive(path), "poses"
    if name in archive.headers:
        n_frames, n_columns = archive.header("poses", ("n_frames", "n_columns")).shape
        model = next((model for model in MODELS if model.n_columns == n_columns), None)
        if model is None:
            known = ", ".join(f"{model.n_columns} ({model.name})" for model in MODELS)
            raise archive.error("poses", f"expected {known} columns, got {n_columns}")
    else:
        name = "root_orient"
        n_frames = archive.header(name, ("n_frames", 3)).shape[0]
        has_face = {"pose_jaw", "pose_eye"} & archive.headers.keys()
        model = SMPL_X if has_face else SMPL_H
    if n_frames == 0:
        raise archive.error(name, "expected at least one frame, got none")
    with errors_of_file(path):
        limits.check_frames(n_frames)
    parts = {"poses": slice(0, model.n_columns), **model.columns}
    columns = {name: own for name, own in parts.items() if name in archive.headers}
    for name, own in columns.items():
        archive.header(name, (n_frames, own.stop - own.start))
    archive.header("trans", (n_frames, 3))
    rate_name = next((name for name in _RATE_NAMES if name in archive.headers), None)
    return AmassFile(archive, model, n_frames, columns, rate_name)


def to_motion(file: AmassFile, rest: Skeleton, rate: float | None) -> Motion:
    """Return the motion of an AMASS file, given the rest skeleton of its body model.

    `rate` is used if the file states no frame rate.
    """
    vectors = file.poses().reshape(file.n_frames, -1, 3)
    positions = np.tile(rest.offsets, (file.n_frames, 1, 1))
    positions[:, 0] += file.archive.read_floats("trans", (file.n_frames, 3))
    quats = rotations.continuous_signs(rotations.exp(vectors))
    return Motion(rest, 1.0 / file.rate(rate), quats, positions)


def open_amass(path: Path, *, rate: float | None, skeleton: Skeleton | None) -> Clips:
    """Return the clip of an AMASS file; see `mograft.io.formats.Opener`.

    Local rotations are those of ``poses``. World axes are those of the file (z up in AMASS), and
    lengths are in metres. The position of the pelvis is ``trans`` plus its rest position.
    """
    file = open_amass_file(path)
    rest, note = rest_skeleton(file.model, skeleton)
    form, notes = f"AMASS {file.model.name}", (note, *_notes(file))
    return single_clip(path, form, lambda: to_motion(file, rest, rate), rate, notes=notes)


def _notes(file: AmassFile) -> list[str]:
    """Return notes on a missing rate, missing parts, and arrays that are not in the motion."""
    used = {*file.columns, "trans", file.rate_name}
    headers = file.archive.headers
    pickled = [name for name, header in headers.items() if header.dtype.hasobject]
    kept = [name for name in headers if name not in used and name not in pickled]
    notes = []
    if file.rate_name is None:
        notes.append("frames per second: those given, because the file states none")
    if "poses" not in file.columns:
        absent = [name for name in file.model.columns if name not in file.columns]
        notes += [f"poses: zero for {join_names(absent)}"] if absent else []
    if kept:
        notes.append(f"arrays that are not part of the motion: {join_names(kept)}")
    if pickled:
        notes.append(f"arrays of pickled objects, which are not read: {join_names(pickled)}")
    return notes


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
    is_same, is_same_place = _find_unchanged(motion, source)
    vectors = rotations.log(motion.rotations).reshape(motion.n_frames, -1)
    translations = motion.positions[:, 0] - motion.skeleton.offsets[0]
    replaced = {
        name: _merge(file, name, vectors[:, columns], is_same[:, columns])
        for name, columns in file.columns.items()
    }
    replaced["trans"] = _merge(file, "trans", translations, is_same_place)
    rate = file.rate(motion.rate)
    if file.rate_name is not None and abs(motion.rate - rate) > 1e-9 * rate:
        shape = file.archive.headers[file.rate_name].shape
        replaced[file.rate_name] = np.full(shape, motion.rate)
    headers, kept = file.archive.headers, {*replaced, file.rate_name, "betas"}
    of_frames = [name for name, own in headers.items() if own.shape[:1] == (file.n_frames,)]
    has_same_length = motion.n_frames == file.n_frames
    omitted = [name for name in of_frames if not has_same_length and name not in kept]
    copy_npz_archive(file.archive, Path(path), replaced, set(omitted))
    if omitted:
        text = f"{join_names(omitted)}, which have one row per frame of {like}"
        warnings.warn(f"{path} lacks {text}", stacklevel=2)


def _in_order_of(file: AmassFile, motion: Motion) -> Motion:
    """Return a motion with its joints in the order of the model, which differs from that of BVH.

    Raises SkeletonMismatchError if the motion has other joints.
    """
    skeleton, model = motion.skeleton, file.model
    if sorted(skeleton.names) == sorted(model.joints):
        order = [skeleton.names.index(name) for name in model.joints]
        channels = tuple(skeleton.channels[joint] for joint in order)
        ordered = Skeleton(model.joints, model.parents, skeleton.offsets[order], channels)
        above = np.where(model.parents < 0, -1, np.array(order)[model.parents])
        if np.array_equal(skeleton.parents[order], above):
            return replace(
                motion,
                skeleton=ordered,
                rotations=motion.rotations[:, order],
                positions=motion.positions[:, order],
                channel_values=None,
            )
    expected = f"the {len(model.joints)} joints of {model.name}, as in {file.archive.path}"
    got = f"{skeleton.n_joints} joints, the first of which is {skeleton.names[0]}"
    raise SkeletonMismatchError(f"`motion` must have {expected}, got {got}")


def _check_channels(motion: Motion, file: AmassFile) -> None:
    """Raise ValueError if the file cannot store the motion; see `write_amass`."""
    skeleton, model = motion.skeleton, file.model
    gaps = np.abs(motion.positions - skeleton.offsets)[:, 1:].max(axis=(0, 2), initial=0.0)
    moved = np.flatnonzero(gaps > POSITION_TOLERANCE * np.abs(skeleton.offsets).max(initial=1.0))
    if len(moved):
        got = f"a joint that leaves its offset, {skeleton.names[moved[0] + 1]}"
        raise ValueError(f"AMASS can translate the root only, got {got}")
    stored = np.zeros(model.n_columns, bool)
    for columns in file.columns.values():
        stored[columns] = True
    is_turned = np.abs(motion.rotations[..., :3]).max(axis=(0, 2)) > 0
    lost = np.flatnonzero(is_turned & ~stored[::3])
    if len(lost):
        missing = f"array for the rotations of {skeleton.names[lost[0]]}"
        raise ValueError(f"{file.archive.path} has no {missing}")


def _merge(file: AmassFile, name: str, values: FloatArray, is_same: BoolArray) -> npt.NDArray[Any]:
    """Return `values` in the type of an array of the file, with the file's values where `is_same`.

    `is_same` has as many columns as `values`, and at most as many rows.
    """
    old = file.archive.read(name, (file.n_frames, values.shape[1]))
    new = values.astype(old.dtype if old.dtype.kind == "f" else np.float64)
    rows = slice(len(is_same))
    new[rows][is_same] = old[rows][is_same]
    return new


def _find_unchanged(motion: Motion, source: Motion) -> tuple[BoolArray, BoolArray]:
    """Return whether rotations, and positions of the root, are those of the file in the same frame.

    The shapes are (number of common frames, 3 n_joints) and (number of common frames, 3): each
    result is repeated for the three components of the rotation vector or position.
    """
    rows = slice(min(motion.n_frames, source.n_frames))
    own, other = motion.rotations[rows], source.rotations[rows]
    # Half the angle between them is at most the distance of the quaternions.
    gaps = np.minimum(np.abs(own - other).max(axis=-1), np.abs(own + other).max(axis=-1))
    shifts = np.abs(motion.positions[rows, 0] - source.positions[rows, 0]).max(axis=1)
    is_same, is_same_place = gaps <= 0.5 * _MAX_ANGLE, shifts <= _MAX_DISTANCE
    return np.repeat(is_same, 3, axis=1), np.repeat(is_same_place[:, None], 3, axis=1)
