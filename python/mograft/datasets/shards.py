"""Files of a data set: several windows in a shard."""

import io
import os
import tempfile
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mograft._util.atomic import write_bytes
from mograft._util.extras import import_extra
from mograft._util.names import portable_stem
from mograft.datasets.augmentation import Encode, Window
from mograft.io.bvh.writer import write_bvh
from mograft.io.glb import write_glb
from mograft.motion.motion import Motion

SHARD_SIZE = 64
"""Windows in a shard."""

Files = list[tuple[str, bytes]]
"""Names of files relative to the folder of the data set, and their contents."""


class ShardFormat(ABC):
    """A format in which shards are stored; the same windows give the same bytes."""

    encode: Encode | None = None  # converts the motion of a window; None: only features are stored

    @abstractmethod
    def files(self, number: int, first: int, windows: Sequence[Window]) -> Files:
        """Return the files of a shard, whose first window has the index `first`."""


class NpzShards(ShardFormat):
    """One NPZ file per shard: for each feature an array whose first axis is the window."""

    def files(self, number: int, first: int, windows: Sequence[Window]) -> Files:  # noqa: ARG002
        """As `ShardFormat.files`."""
        buffer = io.BytesIO()
        names = windows[0].features
        arrays = {name: np.stack([own.features[name] for own in windows]) for name in names}
        np.savez(buffer, allow_pickle=False, **arrays)
        return [(f"shard-{number:05d}.npz", buffer.getvalue())]


class ParquetShards(ShardFormat):
    """One Parquet file per shard: a row per window, and a list of numbers for each feature."""

    def files(self, number: int, first: int, windows: Sequence[Window]) -> Files:
        """As `ShardFormat.files`."""
        arrow = import_extra("pyarrow", "Parquet needs pyarrow", "parquet")
        parquet = import_extra("pyarrow.parquet", "Parquet needs pyarrow", "parquet")
        columns: dict[str, Any] = {"window": arrow.array(range(first, first + len(windows)))}
        for name in windows[0].features:
            rows = np.stack([own.features[name] for own in windows])
            flat = arrow.array(rows.reshape(-1))
            columns[name] = arrow.FixedSizeListArray.from_arrays(flat, rows[0].size)
        buffer = io.BytesIO()
        parquet.write_table(arrow.table(columns), buffer)
        return [(f"shard-{number:05d}.parquet", buffer.getvalue())]


class MotionShards(ShardFormat):
    """One motion file per window."""

    def __init__(self, suffix: str, write: Callable[[Motion, Path], object]) -> None:
        self._suffix, self._write = suffix, write
        self.encode = self._encode

    def _encode(self, motion: Motion) -> bytes:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / f"motion{self._suffix}"
            self._write(motion, path)
            return path.read_bytes()

    def files(self, number: int, first: int, windows: Sequence[Window]) -> Files:
        """As `ShardFormat.files`."""
        folder = f"shard-{number:05d}"
        return [
            (f"{folder}/{first + k:06d}_{portable_stem(own.name)}{self._suffix}", own.data)
            for k, own in enumerate(windows)
        ]


FORMATS: dict[str, ShardFormat] = {
    "npz": NpzShards(),
    "parquet": ParquetShards(),
    "bvh": MotionShards(".bvh", write_bvh),
    "glb": MotionShards(".glb", write_glb),
}
"""The formats by name."""


def write_files(folder: Path, files: Files) -> None:
    """Write the files of a shard, each atomically, and replace what an interrupted run left."""
    for name, data in files:
        path = folder / name
        os.makedirs(path.parent, exist_ok=True)
        write_bytes(path, data)
