"""Files of a data set: several windows in a shard."""

import io
import os
import tempfile
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from mograft._util.atomic import write_bytes
from mograft._util.names import portable_stem
from mograft.datasets.augmentation import Encode, Window
from mograft.io.bvh.writer import write_bvh
from mograft.io.glb import write_glb
from mograft.io.lerobot import episode_file, meta_files, to_parquet
from mograft.motion.motion import Motion

SHARD_SIZE = 64
"""Windows in a shard."""

Files = list[tuple[str, bytes]]
"""Names of files relative to the folder of the data set, and their contents."""


class ShardFormat(NamedTuple):
    """A format in which shards are stored; the same windows give the same bytes."""

    files: Callable[[int, int, Sequence[Window], float], Files]
    """Function of the number of a shard, the index of its first window, its windows and rate."""
    encode: Encode | None = None  # converts the motion of a window; None: only features are stored
    meta: Callable[[Path, dict[str, Any]], Files] | None = None  # of the folder and its manifest


def _npz_files(number: int, _first: int, windows: Sequence[Window], _rate: float) -> Files:
    """Return an NPZ file: for each feature an array whose first axis is the window."""
    buffer, names = io.BytesIO(), windows[0].features
    arrays = {name: np.stack([own.features[name] for own in windows]) for name in names}
    np.savez(buffer, allow_pickle=False, **arrays)
    return [(f"shard-{number:05d}.npz", buffer.getvalue())]


def _parquet_files(number: int, first: int, windows: Sequence[Window], _rate: float) -> Files:
    """Return a Parquet file: a row per window, and a list of numbers for each feature."""
    columns: dict[str, Any] = {"window": np.arange(first, first + len(windows))}
    for name in windows[0].features:
        columns[name] = np.stack([own.features[name].reshape(-1) for own in windows])
    return [(f"shard-{number:05d}.parquet", to_parquet(columns))]


def _lerobot_files(number: int, first: int, windows: Sequence[Window], rate: float) -> Files:
    """Return the data of LeRobot: a state has all features, one after the other."""
    states = [
        np.concatenate([row.reshape(len(row), -1) for row in own.features.values()], axis=1)
        for own in windows
    ]
    return [episode_file(np.stack(states).astype(np.float32), number, first, rate)]


def _lerobot_meta(folder: Path, document: dict[str, Any]) -> Files:
    names = [
        ".".join(map(str, (name, *index)))
        for name, own in document["features"].items()
        for index in np.ndindex(*own["shape"][1:])
    ]
    counts, request = [shard["windows"] for shard in document["shards"]], document["request"]
    return meta_files(folder, counts, request["frames"], request["rate"], names)


def _motion_files(
    number: int, first: int, windows: Sequence[Window], _rate: float, *, suffix: str
) -> Files:
    """Return a file for each window, with its encoded motion."""
    folder = f"shard-{number:05d}"
    return [
        (f"{folder}/{first + k:06d}_{portable_stem(own.name)}{suffix}", own.data)
        for k, own in enumerate(windows)
    ]


def _encode(motion: Motion, *, suffix: str) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"motion{suffix}"
        (write_bvh if suffix == ".bvh" else write_glb)(motion, path)
        return path.read_bytes()


FORMATS = {
    "npz": ShardFormat(_npz_files),
    "parquet": ShardFormat(_parquet_files),
    "lerobot": ShardFormat(_lerobot_files, meta=_lerobot_meta),
    "bvh": ShardFormat(partial(_motion_files, suffix=".bvh"), partial(_encode, suffix=".bvh")),
    "glb": ShardFormat(partial(_motion_files, suffix=".glb"), partial(_encode, suffix=".glb")),
}
"""The formats by name."""


def write_files(folder: Path, files: Files) -> None:
    """Write the files of a shard, each atomically, and replace what an interrupted run left."""
    for name, data in files:
        path = folder / name
        os.makedirs(path.parent, exist_ok=True)
        write_bytes(path, data)
