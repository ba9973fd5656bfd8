"""NPZ and CSV: motions as arrays and as a table."""

import csv
import io
import os
from pathlib import Path

import numpy as np

from mograft._util.atomic import write_bytes
from mograft.motion.motion import Motion
from mograft.motion.skeleton import EndSite, Skeleton

__all__ = ["read_npz", "write_csv", "write_npz"]

_FORMAT = "mograft.motion/1"


def write_npz(motion: Motion, path: str | os.PathLike[str]) -> None:
    """Write a motion as NumPy arrays, for learning and other computing.

    Parameters
    ----------
    motion : Motion
        The motion.
    path : str or path
        The file to write.

    Notes
    -----
    The arrays, lengths in the motion's unit: ``rotations`` (F, J, 4), local, xyzw;
    ``positions`` (F, J, 3), local; ``world_positions`` (F, J, 3); all float32. ``offsets``
    (J, 3) and ``frame_time``, float64. ``parents`` (J,), ``names`` (J,), ``channels`` (J,)
    with the channels of each joint divided by blanks. ``end_parents``, ``end_offsets``,
    ``end_before`` and ``end_names`` of the end sites. ``name``, ``format``. None is pickled.

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
        name=_text([motion.name])[0],
        frame_time=np.array(motion.frame_time),
        names=_text(skeleton.names),
        parents=skeleton.parents,
        offsets=skeleton.offsets,
        channels=_text([" ".join(own) for own in skeleton.channels]),
        end_parents=np.array([site.parent for site in sites], np.int64),
        end_offsets=np.array([site.offset for site in sites]).reshape(-1, 3),
        end_before=np.array([site.before for site in sites], np.int64),
        end_names=_text([site.name for site in sites]),
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
        With rotations and translations as exact as float32 is.

    Raises
    ------
    ValueError
        If it is no such file.
    OSError
        If it cannot be read.

    Examples
    --------
    >>> import tempfile
    >>> from mograft.dancer import dance
    >>> target = Path(tempfile.mkdtemp()) / "dance.npz"
    >>> write_npz(dance(strides=1).motion[:30], target)
    >>> read_npz(target).n_frames
    30
    """
    try:
        with open(path, "rb") as file, np.load(file, allow_pickle=False) as data:
            arrays = {name: data[name] for name in data.files}
    except (ValueError, EOFError, AttributeError, TypeError) as error:
        raise ValueError(f"{path}: no NPZ of a motion: {error}") from error
    except Exception as error:
        # A damaged archive: the modules that notice it have no error in common.
        if isinstance(error, OSError):
            raise
        raise ValueError(f"{path}: a damaged NPZ: {error}") from error
    if str(arrays.get("format", "")) != _FORMAT:
        raise ValueError(f"{path}: must be of format {_FORMAT}, got {arrays.get('format', 'none')}")
    try:
        sites = zip(
            arrays["end_parents"].tolist(),
            arrays["end_offsets"],
            arrays["end_before"].tolist(),
            arrays["end_names"].tolist(),
            strict=True,
        )
        skeleton = Skeleton(
            arrays["names"].tolist(),
            arrays["parents"],
            arrays["offsets"],
            tuple(tuple(own.split()) for own in arrays["channels"].tolist()),
            tuple(EndSite(*site) for site in sites),
        )
        quats = arrays["rotations"].astype(np.float64)
        quats /= np.linalg.norm(quats, axis=-1, keepdims=True)
        return Motion(
            skeleton,
            float(arrays["frame_time"]),
            quats,
            arrays["positions"].astype(np.float64),
            name=str(arrays["name"]),
        )
    except KeyError as error:
        raise ValueError(f"{path}: lacks the array {error}") from error


def write_csv(motion: Motion, path: str | os.PathLike[str]) -> None:
    """Write where the joints are in the world, a line for each frame.

    Parameters
    ----------
    motion : Motion
        The motion.
    path : str or path
        The file to write.

    Notes
    -----
    The columns: ``frame``, from 0; ``time`` in seconds; then ``joint.x``, ``joint.y`` and
    ``joint.z`` of each joint, in the motion's unit and axes. Joints of the same name are told
    apart by their index, as ``Spine~4.x``. Where a name begins as a formula does, in
    spreadsheets, an apostrophe stands before it.

    Examples
    --------
    >>> import tempfile
    >>> from mograft.dancer import dance
    >>> target = Path(tempfile.mkdtemp()) / "dance.csv"
    >>> write_csv(dance(strides=1).motion[:2], target)
    >>> target.read_text().split(",")[:3]
    ['frame', 'time', 'Hips.x']
    """
    names = motion.skeleton.names
    columns = ["frame", "time"]
    for joint, name in enumerate(names):
        own = name if names.count(name) == 1 else f"{name}~{joint}"
        if own[:1] in ("=", "+", "-", "@", "\t", "\r"):
            own = f"'{own}"
        columns += [f"{own}.{axis}" for axis in "xyz"]
    buffer = io.StringIO(newline="")
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(columns)
    table = motion.world_positions().reshape(motion.n_frames, -1)
    for frame, row in enumerate(table.tolist()):
        time = f"{frame * motion.frame_time:.9g}"
        writer.writerow([frame, time, *(f"{value:.9g}" for value in row)])
    write_bytes(Path(path), buffer.getvalue().encode("utf-8", "replace"))


def _text(values: "list[str] | tuple[str, ...]") -> np.ndarray[tuple[int], np.dtype[np.str_]]:
    """Return strings as an array of them, which holds no half of a pair of surrogates."""
    return np.array([v.encode("utf-8", "replace").decode() for v in values], dtype=np.str_)
