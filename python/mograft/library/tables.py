"""The tables of a library as columns: clips, segments and embedded points."""

from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from mograft._util.html_table import html_table

if TYPE_CHECKING:
    from mograft.library.data import LibraryData

Column = npt.NDArray[Any] | list[str]


class Columns(dict[str, Column]):
    """The columns of a table by name, of equal length: arrays of numbers, or lists of texts.

    ``pandas.DataFrame``, ``polars.DataFrame`` and ``pyarrow.table`` accept it like any other dict.
    Notebooks show its first rows.
    """

    @property
    def n_rows(self) -> int:
        """Number of rows."""
        return len(next(iter(self.values()), ()))

    def __repr__(self) -> str:
        return f"Columns({self.n_rows} rows: {', '.join(self)})"

    def _repr_html_(self) -> str:
        rows = zip(*map(_items, self.values()), strict=True)
        return html_table(f"{self.n_rows} rows", tuple(self), rows, self.n_rows)


def library_tables(library: "LibraryData") -> dict[str, Columns]:
    """Return the tables ``clips``, ``segments`` and ``points`` of a library by name.

    `LibraryData.to_dataframe` describes them.
    """
    segments, entries = library.segments, library.entries
    files = [info.source_file for info in entries]
    points = Columns(segment=np.arange(len(segments)))
    for group, embedding in library.embedding.items():
        if embedding is not None:
            for axis, column in enumerate(np.ascontiguousarray(embedding.points.T)):
                points[f"{group}_{axis}"] = column
    return {
        "clips": Columns(
            clip=np.arange(len(entries)),
            name=list(library.names),
            file=["" if file is None else file.path for file in files],
            file_clip=["" if file is None or file.clip is None else file.clip for file in files],
            sha256=["" if file is None else file.sha256 for file in files],
            frames=np.array([info.n_frames for info in entries], np.int64),
            own_rate=np.array([info.source_rate for info in entries], np.float64),
            tags=[" ".join(info.tags) for info in entries],
            faults=["; ".join(info.faults) for info in entries],
        ),
        "segments": Columns(
            segment=np.arange(len(segments)),
            clip=segments.clip,
            start=segments.start,
            stop=segments.stop,
            seconds=segments.lengths / library.rate,
            is_donor=library.is_donor,
            **{f"label_{group}": labels for group, labels in library.labels.items()},
        ),
        "points": points,
    }


def library_html(library: "LibraryData") -> str:
    """Return two HTML tables: the clips of a library, and its joint groups with their clusters."""
    names, segments = library.skeleton.names, library.segments
    n_segments = np.bincount(segments.clip, minlength=len(library.entries)).tolist()
    clips = (
        (info.name, info.n_frames, (info.n_frames - 1) / library.rate, count, " ".join(info.tags))
        for info, count in zip(library.entries, n_segments, strict=True)
    )
    groups = [
        (
            f"{group} (base)" if group == library.groups.base else group,
            ", ".join(names[joint] for joint in library.joints(group)),
            int(labels.max(initial=-1)) + 1,
        )
        for group, labels in library.labels.items()
    ]
    columns = ("clip", "frames", "seconds", "segments", "tags")
    caption = f"{library!r}, {library.rate:.6g} fps"
    return html_table(caption, columns, clips, len(library.entries)) + html_table(
        "Joint groups", ("group", "joints", "clusters"), groups, len(groups)
    )


def _items(column: Column) -> list[Any]:
    return column if isinstance(column, list) else column.tolist()
