"""Read NPZ files of Kimodo."""

from pathlib import Path

import numpy as np

from mograft._util.arrays import FloatArray
from mograft.errors import join_names
from mograft.io.clips import ClipLength, Clips
from mograft.io.kimodo.joints import SKELETONS, KimodoSkeleton
from mograft.io.named_errors import errors_of_file
from mograft.io.npz_archive import NpzArchive, open_npz_archive
from mograft.io.rest_pose import to_local
from mograft.motion import limits, rotations
from mograft.motion.motion import Motion
from mograft.motion.skeleton import CHANNELS, Skeleton

RATE = 30.0
"""Frames per second of the models of Kimodo; their files do not state it."""

_ORTHONORMAL_TOLERANCE = 1e-3
_RIGID_TOLERANCE = 2e-5
"""Distance of a joint from its mean offset, as a fraction of the figure's largest extent, up to
which its bone is rigid. Positions in single precision, some metres from the origin, need it."""


def open_kimodo(path: Path, *, rate: float | None, skeleton: Skeleton | None) -> Clips:  # noqa: ARG001
    """Return the clip of a file of Kimodo; see `mograft.io.formats.Opener`.

    The number of joints determines the skeleton, a value of `SKELETONS`. Rotation matrices are
    relative to its rest pose. Offsets are the mean positions of the joints in the axes of their
    parents; a joint whose position differs from its offset in some frame has position channels.
    Axes are those of the file, and lengths are in metres.
    """
    archive = open_npz_archive(path)
    shape = archive.header("posed_joints", ("n_frames", "n_joints", 3)).shape
    n_frames, n_joints = shape[:2]
    archive.header("global_rot_mats", (n_frames, n_joints, 3, 3))
    if n_joints not in SKELETONS:
        known = ", ".join(f"{count} ({own.name})" for count, own in sorted(SKELETONS.items()))
        raise archive.error("posed_joints", f"expected {known} joints, got {n_joints}")
    if n_frames == 0:
        raise archive.error("posed_joints", "expected at least one frame, got none")
    with errors_of_file(path, "array `posed_joints`"):
        limits.check_frames(n_frames)

    def load(_: int) -> Motion:
        with errors_of_file(path):
            motion = _to_motion(archive, SKELETONS[n_joints], n_frames)
        return motion if rate is None else motion.resample(rate)

    others = [name for name in archive.headers if name not in ("posed_joints", "global_rot_mats")]
    notes = [f"frames per second: {RATE:g}, that of Kimodo's models; the file states none"]
    if others:
        notes.append(f"arrays that are not part of the motion: {join_names(others)}")
    return Clips(
        path,
        (path.stem,),
        load,
        f"Kimodo {SKELETONS[n_joints].name}",
        notes=tuple(notes),
        lengths=(ClipLength(n_frames, 1.0 / RATE),),
    )


def _to_motion(archive: NpzArchive, kind: KimodoSkeleton, n_frames: int) -> Motion:
    """Return the motion of a file of Kimodo."""
    n_joints = len(kind.joints)
    world_positions = archive.read_floats("posed_joints", (n_frames, n_joints, 3))
    matrices = archive.read_floats("global_rot_mats", (n_frames, n_joints, 3, 3))
    _check_matrices(archive, matrices)
    parents = np.array(kind.parents)
    world_rotations = rotations.from_matrices(matrices)
    local, positions = to_local(parents, world_rotations, world_positions)
    offsets = positions.mean(axis=0)
    offsets[0] = 0.0
    extent = float(np.ptp(world_positions, axis=1).max())
    is_rigid = np.abs(positions - offsets).max(axis=(0, 2)) <= _RIGID_TOLERANCE * extent
    is_rigid[0] = False
    positions[:, is_rigid] = offsets[is_rigid]
    turns = ("Zrotation", "Xrotation", "Yrotation")
    channels = [turns if rigid else (*CHANNELS[:3], *turns) for rigid in is_rigid]
    path = archive.path
    return Motion(
        Skeleton(kind.joints, parents, offsets, tuple(channels)),
        1.0 / RATE,
        rotations.continuous_signs(local),
        positions,
        name=path.stem,
        path=path,
    )


def _check_matrices(archive: NpzArchive, matrices: FloatArray) -> None:
    """Raise `FormatError` if a matrix is not a rotation."""
    bounded = np.clip(matrices, -2.0, 2.0)  # products of larger numbers could overflow
    products = np.einsum("...ij,...kj->...ik", bounded, bounded)
    gaps = np.abs(products - np.eye(3)).max(axis=(-2, -1))
    invalid = (gaps > _ORTHONORMAL_TOLERANCE) | (np.linalg.det(bounded) < 0)
    if invalid.any():
        frame, joint = (int(index) for index in np.argwhere(invalid)[0])
        raise archive.error(
            "global_rot_mats",
            f"expected rotation matrices, got a matrix that is none at [{frame}, {joint}]",
        )
