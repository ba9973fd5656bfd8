"""NPZ: motions as NumPy arrays."""

import io
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from mograft._util.atomic import write_bytes
from mograft.errors import FormatError
from mograft.io.clips import Clips
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
    try:
        with open(path, "rb") as file, np.load(file, allow_pickle=False) as data:
            arrays = {name: data[name] for name in data.files}
    except (ValueError, EOFError, AttributeError, TypeError) as error:
        raise FormatError(f"expected an NPZ file of a motion: {error}", os.fspath(path)) from error
    except Exception as error:
        # zipfile and zlib raise unrelated exceptions for damaged archives.
        if isinstance(error, OSError):
            raise
        raise FormatError(f"damaged NPZ file: {error}", os.fspath(path)) from error
    if str(arrays.get("format", "")) != _FORMAT:
        given = arrays.get("format", "none")
        raise FormatError(f"expected {_FORMAT}, got {given}", os.fspath(path), "array `format`")
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
