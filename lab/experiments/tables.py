"""Tables of results: text cells with intervals, and their CSV files."""

import csv
import math
import re
from dataclasses import dataclass

_NUMBER = r"-?\d+(?:\.\d+)?"
_CELL = re.compile(
    rf"({_NUMBER}) ?(%|°|s)?(?: \(({_NUMBER}) to ({_NUMBER})\)| \(no interval\)| \(one set\))?"
    rf"(?:, n = (\d+))?(?: \(({_NUMBER}) %\))?"
)


@dataclass(frozen=True)
class Table:
    """A table: the titles of the columns, and rows of text."""

    head: tuple
    rows: list


def format_estimate(estimate, digits=2, scale=1.0, suffix="", *, has_n=True):
    """Return "0.07 (-0.11 to 0.29), n = 120" for the result of `Estimate.as_dict`, or a dash."""
    value, interval = estimate["value"], estimate["interval"]
    if value is None or not math.isfinite(value):
        return "-"
    text = f"{scale * value:.{digits}f}{suffix}"
    if interval is None:
        text += " (no interval)"
    else:
        low, high = (scale * end for end in interval)
        text += f" ({low:.{digits}f} to {high:.{digits}f})"
    return f"{text}, n = {estimate['n']}" if has_n else text


def spread(table):
    """Return the head and the rows with the parts of each estimate in columns of their own.

    A column of estimates becomes up to five: value, `low` and `high` of its interval, `n`, and
    `share` for a share in brackets behind them. A dash becomes empty, and a unit goes to the title.
    """
    if not table.rows:
        return list(table.head), []
    columns = []
    for title, cells in zip(table.head, zip(*table.rows, strict=True), strict=True):
        found = [_CELL.fullmatch(cell.strip()) for cell in cells]
        is_numeric = all(own or cell == "-" for own, cell in zip(found, cells, strict=True))
        if not is_numeric or not any(found):
            columns.append((title, list(cells)))
            continue
        parts = [own.groups() if own else (None,) * 6 for own in found]
        units = {own[1] for own in parts if own[1]}
        title = ", ".join([title, *units])
        for index, suffix in ((0, ""), (2, " low"), (3, " high"), (4, " n"), (5, " share")):
            values = [own[index] or "" for own in parts]
            if any(values):
                columns.append((title + suffix, values))
    heads = [title for title, _ in columns]
    return heads, list(zip(*(values for _, values in columns), strict=True))


def write_csv(table, path):
    """Write a table as CSV."""
    path.parent.mkdir(parents=True, exist_ok=True)
    head, rows = spread(table)
    with path.open("w", encoding="utf-8", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows([head, *rows])


def read_csv(path):
    """Return the rows of a CSV file as dictionaries of text by title."""
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))
