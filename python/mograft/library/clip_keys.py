"""Tables from names and paths of clips to tags, descriptions or frame rates."""

import csv
import re
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
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
    rows = _parquet_rows(path, columns) if is_parquet else _csv_rows(path, columns)
    table: dict[str, tuple[str, ...]] = {}
    twice: dict[str, None] = {}
    for clip, tags in rows:
        if clip in table:
            twice[clip] = None
        table[clip] = (*table.get(clip, ()), *tags)
    if twice:
        names = join_names(list(twice), _N_NAMED)
        warnings.warn(
            f"{len(twice)} clips of {path} are in several rows, whose tags are joined: {names}",
            stacklevel=2,
        )
    return table


def _csv_rows(
    path: str | PathLike[str], columns: Sequence[str] | None
) -> Iterator[tuple[str, list[str]]]:
    with open(path, encoding="utf-8-sig", newline="") as stream:
        rows = csv.reader(stream)
        heading: list[str] = []
        at, wanted = 0, None if columns is None else list[int]()
        try:
            for row in rows:
                cells = [cell.strip() for cell in row]
                if not any(cells):
                    continue
                if not heading and rows.line_num == 1 and _is_heading(cells):
                    heading = cells
                    at, wanted = _choose(heading, columns, path)
                    continue
                if wanted is not None and not heading:
                    raise ValueError(
                        f"{path}:1: expected a heading with {join_names(columns or ())}"
                    )
                tags = [
                    _tag(cell, heading[index] if index < len(heading) else "")
                    for index, cell in enumerate(cells)
                    if cell and index != at and (wanted is None or index in wanted)
                ]
                is_whole = bool(heading) and len(cells) == len(heading) > 1
                if at >= len(cells) or not cells[at] or not (tags or is_whole):
                    raise ValueError(
                        f"{path}:{rows.line_num}: expected a clip and its tags, got {row}"
                    )
                yield cells[at], tags
        except csv.Error as error:
            raise ValueError(f"{path}:{rows.line_num}: expected CSV: {error}") from error


def _parquet_rows(
    path: str | PathLike[str], columns: Sequence[str] | None
) -> Iterator[tuple[str, list[str]]]:
    arrow = import_extra("pyarrow", "Parquet needs pyarrow", "parquet")
    parquet = import_extra("pyarrow.parquet", "Parquet needs pyarrow", "parquet")
    with open(path, "rb") as stream:
        try:
            file = parquet.ParquetFile(stream)
            schema = file.schema_arrow
            at, wanted = _choose(schema.names, columns, path)
            texts = [
                index
                for index, kind in enumerate(schema.types)
                if arrow.types.is_string(kind)
                or arrow.types.is_large_string(kind)
                or arrow.types.is_dictionary(kind)
            ]
            used = [own for own in (texts if wanted is None else wanted) if own != at]
            names = [schema.names[index] for index in (at, *used)]
            number = 0
            for batch in file.iter_batches(columns=list(dict.fromkeys(names))):
                lists = [batch.column(name).to_pylist() for name in names]
                for clip, *cells in zip(*lists, strict=True):
                    number += 1
                    if clip is None or not str(clip).strip():
                        raise ValueError(f"{path}, row {number}: expected a clip, got {clip!r}")
                    pairs = zip(cells, names[1:], strict=True)
                    given = [(str(cell).strip(), name) for cell, name in pairs if cell is not None]
                    yield str(clip).strip(), [_tag(cell, name) for cell, name in given if cell]
        except arrow.ArrowException as error:
            raise ValueError(f"{path}: expected Parquet: {error}") from error


def _is_heading(cells: Sequence[str]) -> bool:
    return cells[0].lower() in _CLIP_COLUMNS or "filename" in [cell.lower() for cell in cells]


def _choose(
    heading: Sequence[str], columns: Iterable[str] | None, path: str | PathLike[str]
) -> tuple[int, list[int] | None]:
    """Return the column of the clips, and those of `columns`, by the names of all columns."""
    known = [name.lower() for name in heading]
    clip = next((name for name in _CLIP_COLUMNS if name in known), None)
    if clip is None:
        raise ValueError(
            f"{path}: expected a column named {', '.join(_CLIP_COLUMNS)}; got {join_names(heading)}"
        )
    if columns is None:
        return known.index(clip), None
    for name in columns:
        if name not in heading:
            hint = suggest_name(name, heading)
            raise ValueError(f"{path}: no column is named {name!r}{hint}: {join_names(heading)}")
    return known.index(clip), [list(heading).index(name) for name in columns]


def _tag(cell: str, column: str) -> str:
    """Return a cell as a tag; the first letter of its column's heading may be upper case."""
    words = re.sub(r"[^a-z]+", " ", column.lower())
    return f"{TEXT_TAG}{cell}" if _TEXT_COLUMN.search(words) else cell
