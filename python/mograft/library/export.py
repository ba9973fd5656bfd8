"""Export the tables of a library to Parquet, CSV or NPZ."""

import csv
import os
from collections.abc import Mapping
from os import PathLike
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from mograft._util.atomic import atomic_path, draft_folder
from mograft.library.library import Library

Column = npt.NDArray[Any] | list[Any]


def library_tables(library: Library) -> dict[str, dict[str, Column]]:
    """Return the columns of each table of a library, by the names of table and column.

    The tables are ``clips``; ``segments``, with the cluster ``label_GROUP`` for each joint group;
    and ``points``, with the coordinates ``GROUP_0``, ``GROUP_1``... of each segment in the
    embedding of the group. Row `i` of ``segments`` and of ``points`` is segment `i`. The column
    ``clip`` of ``segments`` holds row numbers of ``clips``.
    """
    segments = library.segments
    points: dict[str, Column] = {"segment": np.arange(len(segments))}
    for group, embedding in library.embedding.items():
        if embedding is not None:
            for axis, column in enumerate(np.ascontiguousarray(embedding.points.T)):
                points[f"{group}_{axis}"] = column
    entries = library.entries
    files = [info.source_file for info in entries]
    return {
        "clips": {
            "clip": np.arange(len(entries)),
            "name": [info.name for info in entries],
            "file": ["" if file is None else file.path for file in files],
            "sha256": ["" if file is None else file.sha256 for file in files],
            "frames": np.array([info.n_frames for info in entries], np.int64),
            "own_rate": np.array([info.source_rate for info in entries], np.float64),
            "tags": [" ".join(info.tags) for info in entries],
            "faults": ["; ".join(info.faults) for info in entries],
        },
        "segments": {
            "segment": np.arange(len(segments)),
            "clip": segments.clip,
            "start": segments.start,
            "stop": segments.stop,
            "seconds": segments.lengths / library.rate,
            "is_donor": library.is_donor,
            **{f"label_{group}": labels for group, labels in library.labels.items()},
        },
        "points": points,
    }


def export_tables(
    library: Library, path: str | PathLike[str], kind: Literal["parquet", "csv", "npz"]
) -> list[Path]:
    """Write the tables of a library, replacing existing files, and return the paths of the files.

    For the kind "npz", `path` is the file, and its arrays are named ``TABLE/COLUMN``. For "parquet"
    and "csv", `path` is a folder that receives one file per table. Raise ValueError for another
    `kind`, and ModuleNotFoundError if "parquet" is requested without pyarrow.
    """
    if kind not in ("parquet", "csv", "npz"):
        raise ValueError(f"`kind` must be 'parquet', 'csv' or 'npz', got {kind!r}")
    tables = library_tables(library)
    target = Path(path)
    if kind == "npz":
        arrays: dict[str, Any] = {
            f"{table}/{name}": np.asarray(column)
            for table, columns in tables.items()
            for name, column in columns.items()
        }
        with atomic_path(target) as draft, draft.open("wb") as stream:
            np.savez_compressed(stream, allow_pickle=False, **arrays)
        return [target]
    write = _write_parquet if kind == "parquet" else _write_csv
    with draft_folder(target) as folder:
        draft = folder / target.name
        draft.mkdir()
        for name, columns in tables.items():
            write(draft / f"{name}.{kind}", columns)
        if target.is_dir():
            # Other files in the folder stay.
            for file in draft.iterdir():
                os.replace(file, target / file.name)
        else:
            os.replace(draft, target)
    return [target / f"{name}.{kind}" for name in tables]


def _write_csv(path: Path, columns: Mapping[str, Column]) -> None:
    with path.open("w", encoding="utf-8", newline="") as stream:
        rows = csv.writer(stream)
        rows.writerow(columns)
        lists = [np.asarray(column).tolist() for column in columns.values()]
        rows.writerows(zip(*lists, strict=True))


def _write_parquet(path: Path, columns: Mapping[str, Column]) -> None:
    try:
        import pyarrow
        import pyarrow.parquet
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(
            "Parquet needs pyarrow: pip install 'mograft[parquet]'", name="pyarrow"
        ) from error
    table = pyarrow.table({name: pyarrow.array(column) for name, column in columns.items()})
    pyarrow.parquet.write_table(table, path)
