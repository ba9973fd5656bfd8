"""Tables from names and paths of clips to tags, descriptions or frame rates; their words."""

import csv
import re
import sqlite3
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from fnmatch import fnmatchcase
from os import PathLike, fspath
from pathlib import Path
from typing import Generic, TypeVar

from mograft._util.extras import import_extra
from mograft.errors import join_names, suggest_name
from mograft.io.formats import split_address
from mograft.library.clip_table import ClipInfo
from mograft.library.discover import FoundClip

T = TypeVar("T")

TEXT_TAG = "text:"
"""How a tag begins that is the description of a clip."""

_CLIP_COLUMNS = ("clip", "file", "path", "filename", "name")
"""Headings of the column that names the clips; the first that a table has is used."""

_TEXT_COLUMN = re.compile(r"(?<![a-z])(text|desc|description|caption|annotation)s?(?![a-z])")
_N_NAMED = 8  # names that a warning lists


def plain_tags(entry: ClipInfo) -> tuple[str, ...]:
    """Return the tags of a clip without descriptions."""
    return tuple(tag for tag in entry.tags if not tag.startswith(TEXT_TAG))


class ClipKeys(Generic[T]):
    """Values by the names of clips or files, the ends of their paths, or globs.

    A key is one of `FoundClip.keys`, a glob of one of these, or an end of the path of the file,
    with or without its suffix: ``clips/run/a.bvh`` is also ``a``, ``run/a`` and ``run/a.bvh``.
    """

    def __init__(self, table: Mapping[str, T] | None) -> None:
        self._values = list((table or {}).items())
        self._index = {key: index for index, (key, _) in enumerate(self._values)}
        self._globs = [k for k, (key, _) in enumerate(self._values) if set(key) & set("*?[")]
        self._files: dict[int, set[str]] = {}  # the folders of the files that match each value

    def match(self, clip: FoundClip) -> list[T]:
        """Return the values whose keys match a clip, in the order of the table."""
        if not self._values:
            return []
        keys, folder = list(clip.keys), ""
        if isinstance(clip.source, str):
            path, name = split_address(clip.source)
            *parents, stem = Path(path).absolute().with_suffix("").as_posix().split("/")
            folder, suffix = "/".join(parents), Path(path).suffix
            ends = ["/".join((*parents[i:], stem)) for i in range(len(parents))]
            keys += [f"{end}{more}" for end in ends for more in ("", suffix, f"{suffix}#{name}")]
        found = {self._index[key] for key in keys if key in self._index}
        for index in found:
            self._files.setdefault(index, set()).add(folder)
        for index in self._globs:
            if any(fnmatchcase(key, self._values[index][0]) for key in clip.keys):
                found.add(index)
                self._files.setdefault(index, set())
        return [self._values[index][1] for index in sorted(found)]

    def warn(self, argument: str, *, stacklevel: int) -> None:
        """Warn about keys that matched no clip so far, and names that matched several folders."""
        names = [key for key, _ in self._values]
        unused = [key for index, key in enumerate(names) if index not in self._files]
        several = [names[index] for index, own in sorted(self._files.items()) if len(own) > 1]
        counts = (
            (unused, "match no clip and have no effect"),
            (several, "match files in several folders, all of which are meant; paths select one"),
        )
        for listed, effect in counts:
            if listed:
                message = f"{len(listed)} of {len(names)} names of `{argument}` {effect}: "
                message += join_names(listed, _N_NAMED)
                warnings.warn(message, stacklevel=stacklevel + 1)


def read_tags(
    path: str | PathLike[str], columns: Sequence[str] | None = None
) -> dict[str, tuple[str, ...]]:
    """Read the `tags` for `Library.build` and `Library.index` from a CSV or Parquet file.

    A row has a clip and its tags. The first row of a CSV file is a heading if it begins with
    ``clip``, ``file``, ``path`` or ``name``, or has ``filename``; without one the first cell names
    the clip. With a heading, as in Parquet, the column of the first of these names does, and
    columns with a word such as ``text``, ``desc`` or ``caption`` are descriptions: ``text:`` is put
    before them. `columns` selects the columns; by default, all columns of texts are used.

    Raise ValueError with the number of the line if a row lacks the clip or the tags, and for a
    table that cannot be read or lacks a column. Warn about clips in several rows, whose tags are
    joined.
    """
    is_parquet = Path(fspath(path)).suffix.lower() in (".parquet", ".pq")
    table: dict[str, tuple[str, ...]] = {}
    heading, at, wanted, twice = list[str](), 0, list[int](), dict[str, None]()
    for number, (line, cells) in enumerate(
        _parquet_rows(path, columns) if is_parquet else csv_rows(path)
    ):
        names = [cell.lower() for cell in cells]
        if not number and (is_parquet or names[0] in _CLIP_COLUMNS or "filename" in names):
            heading = cells
            at = next((names.index(name) for name in _CLIP_COLUMNS if name in names), -1)
            for name in columns or ():
                if name not in heading:
                    hint = suggest_name(name, heading)
                    raise ValueError(f"{path}: no column {name!r} in {join_names(heading)}{hint}")
            wanted = [heading.index(name) for name in (heading if columns is None else columns)]
            continue
        if at < 0 or (columns is not None and not heading):
            expected = ", ".join(columns or _CLIP_COLUMNS)
            raise ValueError(f"{path}: expected a heading with one of {expected}")
        tags = [
            _tag(cells[index], heading[index] if index < len(heading) else "")
            for index in (wanted if columns is not None else range(len(cells)))
            if index != at and index < len(cells) and cells[index]
        ]
        is_whole = len(cells) == len(heading) > 1
        if at >= len(cells) or not cells[at] or not (tags or is_whole):
            raise ValueError(f"{path}:{line}: expected a clip and its tags, got {cells}")
        if cells[at] in table:
            twice[cells[at]] = None
        table[cells[at]] = (*table.get(cells[at], ()), *tags)
    if twice:
        clips = join_names(list(twice), _N_NAMED)
        warnings.warn(
            f"{len(twice)} clips of {path} are in several rows, whose tags are joined: {clips}",
            stacklevel=2,
        )
    return table


def csv_rows(path: str | PathLike[str]) -> Iterator[tuple[int, list[str]]]:
    """Yield the number of each line that is not empty, and its cells.

    Raise ValueError with the number of a line that is not CSV.
    """
    with open(path, encoding="utf-8-sig", newline="") as stream:
        rows = csv.reader(stream)
        try:
            for row in rows:
                if any(cells := [cell.strip() for cell in row]):
                    yield rows.line_num, cells
        except csv.Error as error:
            raise ValueError(f"{path}:{rows.line_num}: expected CSV: {error}") from error


def _parquet_rows(
    path: str | PathLike[str], columns: Sequence[str] | None
) -> Iterator[tuple[int, list[str]]]:
    """Yield the names of the columns of texts, of `columns` and of clips, and then the rows."""
    arrow = import_extra("pyarrow", "Parquet needs pyarrow", "parquet")
    parquet = import_extra("pyarrow.parquet", "Parquet needs pyarrow", "parquet")
    with open(path, "rb") as stream:
        try:
            file = parquet.ParquetFile(stream)
            used = [
                own.name
                for own in file.schema_arrow
                if "string" in str(own.type) or own.name in {*_CLIP_COLUMNS, *(columns or ())}
            ]
            yield 0, used
            number = 0
            for batch in file.iter_batches(columns=used):
                for cells in zip(*(batch.column(name).to_pylist() for name in used), strict=True):
                    number += 1
                    yield number, ["" if cell is None else str(cell).strip() for cell in cells]
        except arrow.ArrowException as error:
            raise ValueError(f"{path}: expected Parquet: {error}") from error


def _tag(cell: str, column: str) -> str:
    """Return a cell as a tag, a description if the heading of its column says so."""
    return f"{TEXT_TAG}{cell}" if _TEXT_COLUMN.search(column.lower()) else cell


def find_words(entries: Sequence[ClipInfo], text: str) -> list[tuple[int, float]]:
    """Return the clips whose name, tags or description match an expression of FTS5, best first.

    The second item is the negative score of BM25: smaller is better. Raise ValueError if the
    expression is invalid.
    """
    with closing(sqlite3.connect(":memory:")) as database:
        database.execute("CREATE VIRTUAL TABLE clip USING fts5(name, tags, text)")
        rows = []
        for index, entry in enumerate(entries):
            notes = [tag.removeprefix(TEXT_TAG) for tag in entry.tags if tag.startswith(TEXT_TAG)]
            name = entry.name.encode("utf-8", "replace").decode()
            rows.append((index + 1, name, " ".join(plain_tags(entry)), " ".join(notes)))
        database.executemany("INSERT INTO clip(rowid, name, tags, text) VALUES (?, ?, ?, ?)", rows)
        try:
            found = database.execute(
                "SELECT rowid, bm25(clip) FROM clip WHERE clip MATCH ? ORDER BY 2, 1", (text,)
            ).fetchall()
        except sqlite3.OperationalError as error:
            raise ValueError(
                f"`text` must be words, or an expression of FTS5, got {text!r}: {error}"
            ) from None
    return [(int(row) - 1, float(score)) for row, score in found]
