"""Axes and colours of all pictures."""

import colorsys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_GOLDEN_ANGLE_DEGREES = 137.508


def ensure_axes(ax: "Axes | None", size: tuple[float, float]) -> "Axes":
    """Return `ax`, or if it is None the axes of a new figure with a given size in inches."""
    if ax is not None:
        return ax
    try:
        from matplotlib import pyplot
    except ImportError as error:
        raise ImportError(
            "plots need matplotlib: pip install 'mograft[plot]'", name="matplotlib"
        ) from error
    axes: Axes = pyplot.subplots(figsize=size, layout="constrained")[1]
    return axes


def cluster_colour(cluster: int) -> str:
    """Return the colour of a cluster; the hues of successive clusters are a golden angle apart."""
    hue = ((cluster * _GOLDEN_ANGLE_DEGREES + 200) % 360) / 360
    rgb = colorsys.hls_to_rgb(hue, 0.6, 0.55)
    return "#" + "".join(f"{round(255 * value):02x}" for value in rgb)
