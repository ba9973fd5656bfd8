"""HTML of pages and notebooks: tables, and the view of motions and grafts.

A higher layer draws this view. The package registers the function, so that no lower layer imports
it.
"""

import html
from collections.abc import Callable, Iterable, Sequence
from itertools import islice

MAX_ROWS = 20
"""Number of rows that a table shows at most."""

_views: list[Callable[[object], str]] = []


def html_table(head: Sequence[str], rows: Iterable[str]) -> str:
    """Return an HTML table; `head` holds plain texts, `rows` the HTML of the cells of each row."""
    top = "".join(f'<th scope="col">{_escape(name)}</th>' for name in head)
    body = "".join(f"<tr>{row}</tr>" for row in rows)
    return f"<table><thead><tr>{top}</tr></thead><tbody>{body}</tbody></table>"


def notebook_table(
    caption: str, columns: Sequence[str], rows: Iterable[Sequence[object]], n_rows: int
) -> str:
    """Return an HTML table of the first `MAX_ROWS` of `n_rows` rows; all texts are escaped.

    Numbers are aligned to the right. The result begins with a paragraph that has the caption. If
    there are more than `MAX_ROWS` rows, it ends with the number of rows that are not shown.
    """
    shown = ("".join(map(_cell, row)) for row in islice(rows, min(n_rows, MAX_ROWS)))
    more = f"<p>{n_rows - MAX_ROWS:,} more rows</p>" if n_rows > MAX_ROWS else ""
    return f"<p>{_escape(caption)}</p>{html_table(columns, shown)}{more}"


def _cell(value: object) -> str:
    """Return an HTML table cell with a value; floats have four significant digits."""
    if isinstance(value, str | bool):
        return f'<td style="text-align:left">{_escape(str(value))}</td>'
    text = f"{value:.4g}" if isinstance(value, float) else str(value)
    return f'<td style="text-align:right">{_escape(text)}</td>'


def _escape(text: str) -> str:
    """Escape HTML; replace lone surrogates, which UTF-8 cannot encode."""
    return html.escape(text).encode("utf-8", "replace").decode("utf-8")


def register_view(view: Callable[[object], str]) -> None:
    """Make `view` the function that returns the HTML of a motion or graft."""
    _views[:] = [view]


def notebook_html(item: object) -> str | None:
    """Return the HTML of a motion or graft; None if no view is registered."""
    return _views[0](item) if _views else None
