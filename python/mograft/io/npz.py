"""NPZ: motions as NumPy arrays."""

import io
import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from mograft._util.atomic import write_bytes
from mograft.errors import FormatError, join_names
from mograft.io.clips import Clips, errors_of_file, single_clip
from mograft.io.npz_archive import NpzArchive, open_npz_archive
from mograft.io.units import check_single_precision
from mograft.motion import limits
from mograft.motion.motion import Motion
from mograft.motion.skeleton import EndSite, Skeleton

_FORMAT = "mograft.motion/1"


def write_npz(motion: Motion, path: str | os.PathLike[str]) -> None:
    """Write a motion as compressed NumPy arrays.

    Parameters
    ----------
    motion : Motion
        The motion.
    path : str or path
        The file to write.

    Raises
    ------
    ValueError
        If a coordinate exceeds 1e38.
    OSError
        If the file cannot be written.

    Notes
    -----
    The arrays, for F frames and J joints, with lengths in the unit of the motion:

    - ``rotations`` (F, J, 4), local, xyzw; ``positions`` (F, J, 3), local; ``world_positions``
      (F, J, 3); all float32
    - ``offsets`` (J, 3) and ``frame_time``, float64
    - ``parents`` (J,), ``names`` (J,), ``channels`` (J,): the channels of each joint, separated
      by spaces
    - ``end_parents``, ``end_offsets``, ``end_before`` and ``end_names`` of the end sites, with the
      meaning of the fields of `EndSite`
    - ``name`` of the motion, and ``format``, which identifies this format

    No array is pickled.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from mograft.dancer import dance
    >>> target = Path(tempfile.mkdtemp()) / "dance.npz"
    >>> write_npz(dance(strides=1).motion, target)
    >>> read_npz(target)
    Motion(dance: 18 joints, 1508 frames, 30 fps, 50.23 s)
    """
    skeleton = motion.skeleton
    sites = skeleton.end_sites
    world_positions = motion.world_positions()
    check_single_precision("position", motion.positions, skeleton)
    check_single_precision("world position", world_positions, skeleton)
    buffer = io.BytesIO()
    np.savez_compressed(
        buffer,
        format=np.array(_FORMAT),
        name=_to_strings([motion.name])[0],
        frame_time=np.array(motion.frame_time),
        names=_to_strings(skeleton.names),
        parents=skeleton.parents,
        offsets=skeleton.offsets,
        channels=_to_strings([" ".join(channels) for channels in skeleton.channels]),
        end_parents=np.array([site.parent for site in sites], np.int64),
        end_offsets=np.array([site.offset for site in sites]).reshape(-1, 3),
        end_before=np.array([site.before for site in sites], np.int64),
        end_names=_to_strings([site.name for site in sites]),
        rotations=motion.rotations.astype(np.float32),
        positions=motion.positions.astype(np.float32),
        world_positions=world_positions.astype(np.float32),
    )
    write_bytes(Path(path), buffer.getvalue())


def read_npz(path: str | os.PathLike[str]) -> Motion:
    """Read a motion that `write_npz` wrote.

    Parameters
    ----------
    path : str or path
        The file.

    Returns
    -------
    Motion
        The motion; rotations and positions have the precision of float32.

    Raises
    ------
    FormatError
        If the file is damaged or was not written by `write_npz`.
    OSError
        If the file cannot be read.
    """
    archive = open_npz_archive(Path(path))
    if "format" not in archive.headers:
        raise FormatError(
            "expected the arrays of mograft (`format`), AMASS (`poses`, `trans`) or Kimodo "
            "(`posed_joints`, `global_rot_mats`), got "
            f"{join_names(sorted(archive.headers)) or 'no arrays'}",
            archive.path,
        )
    given = str(archive.read("format", ()))
    if given != _FORMAT:
        raise archive.error("format", f"expected {_FORMAT}, got {given}")
    with errors_of_file(archive.path):
        return _to_motion(archive)


def open_npz(path: Path, *, rate: float | None, skeleton: Skeleton | None) -> Clips:  # noqa: ARG001
    """Return the clip of an NPZ file; see `mograft.io.formats.Opener`."""
    return single_clip(path, "NPZ", lambda: read_npz(path), rate)


def _to_motion(archive: NpzArchive) -> Motion:
    """Return the motion in a file; if it has no name, it is named after the file."""
    (n_joints,) = archive.header("names", ("n_joints",)).shape
    (n_sites,) = archive.header("end_parents", ("n_end_sites",)).shape
    n_frames = archive.header("rotations", ("n_frames", n_joints, 4)).shape[0]
    limits.check_joints(n_joints)
    limits.check_frames(n_frames)
    sites = map(
        EndSite,
        archive.read_integers("end_parents", (n_sites,)).tolist(),
        archive.read_floats("end_offsets", (n_sites, 3)),
        archive.read_integers("end_before", (n_sites,)).tolist(),
        archive.read_strings("end_names", (n_sites,)),
    )
    skeleton = Skeleton(
        tuple(archive.read_strings("names", (n_joints,))),
        archive.read_integers("parents", (n_joints,)),
        archive.read_floats("offsets", (n_joints, 3)),
        tuple(tuple(own.split()) for own in archive.read_strings("channels", (n_joints,))),
        tuple(sites),
    )
    quats = archive.read_floats("rotations", (n_frames, n_joints, 4))
    norms = np.linalg.norm(quats, axis=-1, keepdims=True)
    return Motion(
        skeleton,
        float(archive.read_floats("frame_time", ())),
        quats / np.where(norms > 0, norms, 1.0),
        archive.read_floats("positions", (n_frames, n_joints, 3)),
        name=str(archive.read("name", (), "U", "text")) or archive.path.stem,
        path=archive.path,
    )


def _to_strings(values: Sequence[str]) -> npt.NDArray[np.str_]:
    """Return an array of strings; lone surrogates, which UTF-8 cannot encode, become ``?``."""
    return np.array([v.encode("utf-8", "replace").decode() for v in values], dtype=np.str_)
