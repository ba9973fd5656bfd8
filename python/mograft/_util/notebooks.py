"""How values of lower layers show themselves in a notebook cell.

A higher layer draws the page. The package registers the function, so that no lower layer imports
it.
"""

from collections.abc import Callable

_views: list[Callable[[object], str]] = []


def register_view(view: Callable[[object], str]) -> None:
    """Make `view` the function that returns the HTML of a motion or graft."""
    _views[:] = [view]


def notebook_html(item: object) -> str | None:
    """Return the HTML of a motion or graft; None if no view is registered."""
    return _views[0](item) if _views else None
