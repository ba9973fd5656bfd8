"""NPZ: motions as NumPy arrays."""

import io
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from mograft._util.atomic import write_bytes
from mograft.errors import FormatError, join_names
from mograft.io.clips import Clips
from mograft.io.npz_archive import NpzArchive, open_npz_archive
from mograft.motion.motion import Motion
from mograft.motion.skeleton import EndSite, Skeleton

_FORMAT = "mograft.motion/1"
_ARRAYS = (
    *("name", "frame_time", "names", "parents", "offsets", "channels", "rotations", "positions"),
    *("end_parents", "end_offsets", "end_before", "end_names"),
)


def write_npz(motion: Motion, path: str | os.PathLike[str]) -> None:
    """Write a motion as compressed NumPy arrays.

    Parameters
    ----------
    motion : Motion
        The motion.
    path : str or path
        The file to write.

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
    >>> from mograft.dancer import dance
    >>> target = Path(tempfile.mkdtemp()) / "dance.npz"
    >>> write_npz(dance(strides=1).motion, target)
    >>> read_npz(target)
    Motion(dance: 18 joints, 1508 frames, 30 fps, 50.23 s)
    """
    skeleton = motion.skeleton
    sites = skeleton.end_sites
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
        world_positions=motion.world_positions().astype(np.float32),
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
        raise FormatError(_describe_unknown(archive), os.fspath(path))
    given = str(archive.read("format", ()))
    if given != _FORMAT:
        raise FormatError(f"expected {_FORMAT}, got {given}", os.fspath(path), "array `format`")
    arrays = {
        name: archive.read(name, header.shape)
        for name, header in archive.headers.items()
        if name in _ARRAYS
    }
    try:
        return _to_motion(arrays, Path(path))
    except KeyError as error:
        raise FormatError(f"the array {error} is missing", os.fspath(path)) from error
    except (ValueError, TypeError) as error:
        raise FormatError(str(error), os.fspath(path)) from error


def open_npz(path: Path, *, rate: float | None, skeleton: Skeleton | None) -> Clips:  # noqa: ARG001
    """Return the clip of an NPZ file; see `mograft.io.formats.Opener`."""

    def load(_: int) -> Motion:
        motion = read_npz(path)
        return motion if rate is None else motion.resample(rate)

    return Clips(path, (path.stem,), load, "NPZ")


def _describe_unknown(archive: NpzArchive) -> str:
    """Return the error message for an NPZ file of no known format."""
    headers = archive.headers
    message = (
        "expected the arrays of mograft (`format`), AMASS (`poses`, `trans`) or Kimodo "
        f"(`posed_joints`, `global_rot_mats`), got {join_names(sorted(headers)) or 'no arrays'}"
    )
    quats = [
        name
        for name, header in headers.items()
        if "quat" in name.lower() or (len(header.shape) > 1 and header.shape[-1] == 4)
    ]
    if quats:
        message += (
            f"; {join_names(quats)} may hold quaternions, but the file does not state whether they "
            "are xyzw or wxyz, and mograft does not guess it"
        )
    return message


def _to_motion(arrays: Mapping[str, npt.NDArray[Any]], path: Path) -> Motion:
    """Return the motion in the arrays of a file; a motion without a name is named after it."""
    fields = (arrays[f"end_{name}"].tolist() for name in ("parents", "offsets", "before", "names"))
    skeleton = Skeleton(
        arrays["names"].tolist(),
        arrays["parents"],
        arrays["offsets"],
        tuple(tuple(channels.split()) for channels in arrays["channels"].tolist()),
        tuple(EndSite(*site) for site in zip(*fields, strict=True)),
    )
    rotations = arrays["rotations"].astype(np.float64)
    rotations /= np.linalg.norm(rotations, axis=-1, keepdims=True)
    return Motion(
        skeleton,
        float(arrays["frame_time"]),
        rotations,
        arrays["positions"].astype(np.float64),
        name=str(arrays["name"]) or path.stem,
        path=path,
    )


def _to_strings(values: Sequence[str]) -> npt.NDArray[np.str_]:
    """Return an array of strings; lone surrogates, which UTF-8 cannot encode, become ``?``."""
    return np.array([v.encode("utf-8", "replace").decode() for v in values], dtype=np.str_)
