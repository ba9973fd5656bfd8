"""Tables as columns by name."""

from typing import Any

import numpy.typing as npt

from mograft._util.html_table import notebook_table

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
        return notebook_table(f"{self.n_rows} rows", tuple(self), rows, self.n_rows)


def _items(column: Column) -> list[Any]:
    return column if isinstance(column, list) else column.tolist()
