"""Read data sets that `mograft.datasets.write` has written."""

from dataclasses import dataclass, field
from os import PathLike, fspath
from pathlib import Path
from typing import Any

import numpy as np

from mograft._util.containers import LazySequence, SizedCache
from mograft._util.documents import read_document
from mograft.datasets.features import Array
from mograft.datasets.writing import MANIFEST, SCHEMA
from mograft.errors import MograftError

_CACHED_BYTES = 1 << 28
"""Size of the shards that stay in the memory of a process."""


@dataclass(frozen=True, eq=False)
class DataSet(LazySequence[dict[str, Array]]):
    """The windows of a data set in a folder, read when they are accessed.

    An item is a dict with an array for each feature, and its ``index``. The object may be pickled
    and used in any number of threads and processes; PyTorch accepts it as a map-style data set.

    Attributes
    ----------
    folder : Path
        The folder.
    manifest : dict
        The manifest, with the options and a report.
    """

    folder: Path
    manifest: dict[str, Any]
    _shards: SizedCache[int, dict[str, Array]] = field(
        default_factory=lambda: SizedCache(_CACHED_BYTES), init=False, repr=False
    )

    def __len__(self) -> int:
        return int(self.manifest["report"]["windows"])

    def __repr__(self) -> str:
        return f"DataSet({len(self)} windows in {self.folder})"

    def item(self, index: int) -> dict[str, Array]:
        """Return a window."""
        size = self.manifest["shards"][0]["windows"]
        number, row = divmod(index, size)
        shard = self._shards.get(number)
        if shard is None:
            shard = self._read(number)
            self._shards.put(number, shard, sum(own.nbytes for own in shard.values()))
        return {**{name: own[row] for name, own in shard.items()}, "index": np.array(index)}

    def _read(self, number: int) -> dict[str, Array]:
        (file,) = self.manifest["shards"][number]["files"]
        path = self.folder / file["file"]
        if not path.is_file() or path.stat().st_size != file["bytes"]:
            raise MograftError(f"{path} is missing or has changed since it was written")
        with np.load(path, allow_pickle=False) as archive:
            return {name: archive[name] for name in self.manifest["features"]}


def read_set(folder: str | PathLike[str]) -> DataSet:
    """Open a data set of the format npz.

    Parameters
    ----------
    folder : path
        The folder that `write`, or ``mograft augment``, has written.

    Returns
    -------
    DataSet
        Its windows.

    Raises
    ------
    FileNotFoundError
        If the folder has no manifest.
    ValueError
        If the data set is not complete, or of another format.
    """
    path = Path(fspath(folder))
    document = read_document(path / MANIFEST)
    if document.get("schema") != SCHEMA or "report" not in document:
        raise ValueError(f"{path}: expected a complete data set of {SCHEMA}; resume the run")
    if (kind := document["request"]["format"]) != "npz":
        raise ValueError(f"{path}: expected a data set of the format npz, got {kind}")
    return DataSet(path.absolute(), document)
