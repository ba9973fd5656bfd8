"""The table of labels that the labelling page saves."""

import csv
import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mograft._util.arrays import BoolArray, IntArray
from mograft.evaluation.baselines import grafted_group
from mograft.library.library import Library

# Columns that identify a labelled piece; `label` and `seconds` follow them.
COLUMNS = ("clip", "first", "last", "group", "donor_clip", "donor_first", "donor_last")

_Key = tuple[str, int, int]  # clip name, first frame and last frame of a segment


@dataclass(frozen=True, eq=False)
class Labels:
    """Labels that a person gave to pairs of a base segment and a donor; arrays of shape (n,)."""

    segment: IntArray
    donor: IntArray
    natural: BoolArray  # False for the label "unnatural".
    group: str


def label_row(library: Library, group: str, segment: int, donor: int) -> tuple[str, ...]:
    """Return the first seven cells of a row of the label table, for a base segment and a donor.

    `segment` and `donor` are segment indices of the library. In the table, the clip name, first
    and last frame identify a segment.
    """
    cut = library.segments
    cells: list[str] = []
    for index in (segment, donor):
        frames = (str(int(cut.start[index])), str(int(cut.stop[index])))
        cells += [library.clips[int(cut.clip[index])].name, *frames]
    return (*cells[:3], group, *cells[3:])


def read_labels(path: str | os.PathLike[str], library: Library) -> Labels:
    """Read the labels that a person gave to pieces of motion.

    Parameters
    ----------
    path : str or path
        CSV table that the labelling page saved.
    library : Library
        Library from the same files and configuration as that of the page.

    Returns
    -------
    Labels
        One label for each row.

    Raises
    ------
    ValueError
        If the file is not a table of labels, or if a row is invalid or refers to a segment
        that is not in the library. The message has the line number.
    """
    try:
        text = Path(path).read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise ValueError(f"{path}: not UTF-8: {error}") from error
    try:
        rows = iter(list(csv.reader(text.splitlines())))
    except csv.Error as error:
        raise ValueError(f"{path}: not a CSV table: {error}") from error
    header = next(rows, [])
    if tuple(header[: len(COLUMNS) + 1]) != (*COLUMNS, "label"):
        expected = ",".join((*COLUMNS, "label"))
        raise ValueError(
            f"{path}:1: header must begin with {expected}, got {','.join(header)[:120]}"
        )
    cut = library.segments
    names = [clip.name for clip in library.clips]
    columns = (cut.clip.tolist(), cut.start.tolist(), cut.stop.tolist())
    numbers = {
        (names[clip], start, stop): index
        for index, (clip, start, stop) in enumerate(zip(*columns, strict=True))
    }
    pairs: list[tuple[int, int, bool]] = []
    groups: set[str] = set()
    for line, row in enumerate(rows, start=2):
        if not row:
            continue
        pairs.append(_parse_row(row, numbers, f"{path}:{line}"))
        groups.add(row[3])
    if len(groups) > 1 or not groups <= set(library.groups.names):
        raise ValueError(
            f"{path}: all labels must be of the same joint group of the library, "
            f"got {', '.join(sorted(groups))}"
        )
    table = np.array(pairs, np.int64).reshape(-1, 3)
    group = groups.pop() if groups else grafted_group(library)
    return Labels(table[:, 0], table[:, 1], table[:, 2].astype(bool), group)


def _parse_row(row: list[str], numbers: dict[_Key, int], place: str) -> tuple[int, int, bool]:
    """Return the indices of base segment and donor, and whether the label is "natural".

    `numbers` has the index of each segment, by clip name, first and last frame. Error messages
    begin with `place`, the file and the line.
    """
    if len(row) < len(COLUMNS) + 1:
        raise ValueError(f"{place}: must have {len(COLUMNS) + 1} columns, got {len(row)}")
    keys: list[_Key] = []
    for clip, first, last in (row[:3], row[4:7]):
        if not (first.isdecimal() and last.isdecimal()):
            raise ValueError(f"{place}: frames must be whole numbers, got {first}, {last}")
        keys.append((clip, int(first), int(last)))
    label = row[len(COLUMNS)]
    if label not in ("natural", "unnatural"):
        raise ValueError(f"{place}: label must be natural or unnatural, got {label!r}")
    for key in keys:
        if key not in numbers:
            raise ValueError(
                f"{place}: {key[0]} has no segment {key[1]}-{key[2]} in this library; read labels "
                "with the same files and options as those of the page"
            )
    return numbers[keys[0]], numbers[keys[1]], label == "natural"
