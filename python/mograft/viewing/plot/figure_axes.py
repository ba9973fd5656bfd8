"""Axes and colours of all pictures."""

import colorsys
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_GOLDEN_ANGLE_DEGREES = 137.508


def ensure_axes(ax: "Axes | None", size: tuple[float, float]) -> "Axes":
    """Return `ax`, or if it is None the axes of a new figure with a given size in inches."""
    if ax is not None:
        return ax
    axes: Axes = _pyplot().subplots(figsize=size, layout="constrained")[1]
    return axes


def ensure_two_axes(
    axes: "tuple[Axes, Axes] | None", size: tuple[float, float]
) -> "tuple[Axes, Axes]":
    """Return `axes`, or if it is None two axes side by side of a new figure."""
    if axes is not None:
        return axes
    options = {"layout": "constrained", "gridspec_kw": {"width_ratios": [2, 1]}}
    left, right = _pyplot().subplots(1, 2, figsize=size, **options)[1]
    return left, right


def _pyplot() -> Any:  # noqa: ANN401 - a module
    """Return `matplotlib.pyplot`; raise ImportError with the remedy if it is not installed."""
    try:
        from matplotlib import pyplot
    except ImportError as error:
        raise ImportError(
            "plots need matplotlib: pip install 'mograft[plot]'", name="matplotlib"
        ) from error
    return pyplot


def cluster_colour(cluster: int) -> str:
    """Return the colour of a cluster; the hues of successive clusters are a golden angle apart."""
    hue = ((cluster * _GOLDEN_ANGLE_DEGREES + 200) % 360) / 360
    rgb = colorsys.hls_to_rgb(hue, 0.6, 0.55)
    return "#" + "".join(f"{round(255 * value):02x}" for value in rgb)
