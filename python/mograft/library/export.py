"""Export the tables of a library to Parquet or CSV."""

import csv
import os
from collections.abc import Mapping
from os import PathLike
from pathlib import Path
from typing import Literal

import numpy as np

from mograft._util.atomic import atomic_folder, checked_path, draft_folder, sync
from mograft._util.extras import import_extra
from mograft._util.validate import check_choice
from mograft.io.csv import without_formula
from mograft.library.data import Column, library_tables
from mograft.library.library import Library


def export_tables(
    library: Library, path: str | PathLike[str], kind: Literal["parquet", "csv"]
) -> list[Path]:
    """Write the tables of a library, replacing existing files, and return the paths of the files.

    `path` is a folder that gets one file per table. Texts in CSV that a spreadsheet would read as a
    formula are prefixed with an apostrophe. Raise ValueError for another `kind`, and
    ModuleNotFoundError if "parquet" is requested without pyarrow.
    """
    check_choice("kind", kind, ("parquet", "csv"))
    tables = library_tables(library)
    target = Path(path)
    write = _write_parquet if kind == "parquet" else _write_csv
    is_new = not target.is_dir()
    with (atomic_folder if is_new else draft_folder)(target) as draft:
        for name, columns in tables.items():
            write(draft / f"{name}.{kind}", columns)
            sync(draft / f"{name}.{kind}")
        if not is_new:  # other files in the folder stay
            for file in draft.iterdir():
                os.replace(file, target / file.name)
            sync(target)
    return [target / f"{name}.{kind}" for name in tables]


def _write_csv(path: Path, columns: Mapping[str, Column]) -> None:
    with path.open("w", encoding="utf-8", newline="") as stream:
        rows = csv.writer(stream)
        rows.writerow(columns)
        lists = [np.asarray(column).tolist() for column in columns.values()]
        for row in zip(*lists, strict=True):
            rows.writerow([without_formula(v) if isinstance(v, str) else v for v in row])


def _write_parquet(path: Path, columns: Mapping[str, Column]) -> None:
    pyarrow = import_extra("pyarrow", "Parquet needs pyarrow", "parquet")
    parquet = import_extra("pyarrow.parquet", "Parquet needs pyarrow", "parquet")
    table = pyarrow.table({name: pyarrow.array(column) for name, column in columns.items()})
    with checked_path(path, lambda draft: table.equals(parquet.read_table(draft))) as draft:
        parquet.write_table(table, draft)
