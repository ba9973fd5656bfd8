"""The tables of a library, for tools that read Parquet, CSV or NPZ."""

import contextlib
import csv
import os
import secrets
import shutil
from collections.abc import Iterator, Mapping
from os import PathLike
from pathlib import Path
from typing import IO, Any, Literal

import numpy as np
import numpy.typing as npt

from mograft.library.library import Library

__all__ = ["export_tables", "library_tables"]

Column = npt.NDArray[Any] | list[Any]


def library_tables(library: Library) -> dict[str, dict[str, Column]]:
    """Return what a library knows as tables.

    Parameters
    ----------
    library : Library
        The library.

    Returns
    -------
    dict of str to dict of str to column
        ``clips``, ``segments`` (with a cluster ``label_GROUP`` for each joint group) and
        ``points`` (with ``GROUP_0`` and on, the segment as a point). Row `i` of the two
        latter is segment `i`; ``clip`` counts the rows of ``clips``.
    """
    segments = library.segments
    points: dict[str, Column] = {"segment": np.arange(len(segments))}
    for group, own in library.embedding.items():
        if own is not None:
            for axis, column in enumerate(np.ascontiguousarray(own.points.T)):
                points[f"{group}_{axis}"] = column
    entries = library.entries
    origins = [entry.source_file for entry in entries]
    return {
        "clips": {
            "clip": np.arange(len(entries)),
            "name": [entry.name for entry in entries],
            "file": ["" if origin is None else origin.path for origin in origins],
            "sha256": ["" if origin is None else origin.sha256 for origin in origins],
            "frames": np.array([entry.n_frames for entry in entries], np.int64),
            "own_rate": np.array([entry.source_rate for entry in entries], np.float64),
            "tags": [" ".join(entry.tags) for entry in entries],
            "faults": ["; ".join(entry.faults) for entry in entries],
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
    """Write the tables of a library.

    Parameters
    ----------
    library : Library
        The library.
    path : path
        For ``npz`` the file, else the folder of one file per table. What is there is replaced.
    kind : {"parquet", "csv", "npz"}
        Parquet needs pyarrow, the extra ``parquet``. In the NPZ file the arrays are named
        ``TABLE/COLUMN``.

    Returns
    -------
    list of Path
        The files.

    Raises
    ------
    ModuleNotFoundError
        If pyarrow is wanted and not installed; says how to install it.
    ValueError
        If there is no such kind.
    """
    if kind not in ("parquet", "csv", "npz"):
        raise ValueError(f"kind must be 'parquet', 'csv' or 'npz', got {kind!r}")
    found = library_tables(library)
    target = Path(path)
    with _replacing(target) as draft:
        if kind == "npz":
            arrays = {
                f"{table}/{name}": np.asarray(column)
                for table, columns in found.items()
                for name, column in columns.items()
            }
            with draft.open("wb") as stream:
                _save(stream, arrays)
            return [target]
        draft.mkdir()
        write = _write_parquet if kind == "parquet" else _write_csv
        for name, columns in found.items():
            write(draft / f"{name}.{kind}", columns)
    return [target / f"{name}.{kind}" for name in found]


def _save(stream: IO[bytes], arrays: Mapping[str, npt.NDArray[Any]]) -> None:
    np.savez_compressed(stream, allow_pickle=False, **arrays)


def _write_csv(path: Path, columns: Mapping[str, Column]) -> None:
    with path.open("w", encoding="utf-8", newline="") as stream:
        rows = csv.writer(stream)
        rows.writerow(columns)
        listed = [own if isinstance(own, list) else own.tolist() for own in columns.values()]
        rows.writerows(zip(*listed, strict=True))


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


@contextlib.contextmanager
def _replacing(target: Path) -> Iterator[Path]:
    """Write to another name, which takes the target's when all is written."""
    draft = target.with_name(f".{target.name}.{secrets.token_hex(4)}")
    try:
        yield draft
        if target.is_dir() and draft.is_dir():
            # Only the tables are replaced: other files in the folder are not ours.
            for path in draft.iterdir():
                os.replace(path, target / path.name)
        else:
            os.replace(draft, target)
    finally:
        if draft.is_dir():
            shutil.rmtree(draft, ignore_errors=True)
        else:
            draft.unlink(missing_ok=True)
