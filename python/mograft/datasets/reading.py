"""Read data sets that `mograft.datasets.write` has written, and measure their grafts."""

import csv
from dataclasses import dataclass, field
from os import PathLike, fspath
from pathlib import Path
from typing import Any

import numpy as np

from mograft._util.containers import LazySequence, SizedCache
from mograft._util.documents import read_document
from mograft._util.validate import check_type
from mograft.datasets.augmentation import Augmentation
from mograft.datasets.features import Array
from mograft.datasets.writing import MANIFEST, SCHEMA, TABLE
from mograft.errors import MograftError
from mograft.evaluation.detectability import Detectability, detectability
from mograft.io.csv import without_formula

_MAX_GRAFTS = 64  # that are built again; their seams give more windows than are compared
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


def measure(windows: Augmentation, folder: str | PathLike[str]) -> Detectability:
    """Measure whether classifiers distinguish the grafts of a data set from captured motion.

    Parameters
    ----------
    windows : Augmentation
        The windows that `write` has written.
    folder : path
        The folder of the data set.

    Returns
    -------
    Detectability
        The measures of `mograft.evaluation.detectability`, with intervals. They are those of 64 of
        the grafts at most, at equal intervals in the data set.

    Raises
    ------
    FileNotFoundError
        If the data set is not complete.
    ImportError
        If scikit-learn is not installed.
    InsufficientDataError
        If the grafts have too few seams.
    """
    check_type("windows", windows, Augmentation)
    with (Path(fspath(folder)) / TABLE).open(encoding="utf-8", newline="") as stream:
        found = dict.fromkeys((row["base"], int(row["draw"])) for row in csv.DictReader(stream))
    every = list(found)
    rows = np.unique(np.linspace(0, len(every) - 1, min(len(every), _MAX_GRAFTS)).round())
    draws: dict[str, list[int]] = {}
    for row in rows.astype(int).tolist():
        draws.setdefault(every[row][0], []).append(every[row][1])
    names = [without_formula(windows.library.entries[base].name) for base in windows.bases.tolist()]
    bases = {name: int(base) for name, base in zip(names, windows.bases, strict=True)}
    grafts = [
        windows.build(bases[name], sorted(own)) for name, own in draws.items() if name in bases
    ]
    return detectability("data set", grafts, windows.seed)
