"""The kinetic energy of a motion and its segments."""

from typing import TYPE_CHECKING

import numpy as np

from mograft._util.gaussian import gaussian_filter
from mograft.analysis.segmentation import kinetic_energy, segment
from mograft.config import Config
from mograft.io.palette import PALETTE
from mograft.motion.motion import Motion
from mograft.plot.figure_axes import ensure_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["energy"]


def energy(motion: Motion, config: Config | None = None, *, ax: "Axes | None" = None) -> "Axes":
    """Draw the kinetic energy of a motion and the boundaries of its segments.

    Parameters
    ----------
    motion : Motion
        The motion, of at least two frames.
    config : Config, optional
        Parameters of the segmentation.
    ax : matplotlib Axes, optional
        Axes to draw into. Default: new axes.

    Returns
    -------
    matplotlib Axes
        Time in seconds; the energy before (grey) and after smoothing; a point at each segment
        boundary; every second segment shaded.

    Raises
    ------
    ValueError
        If the motion has a single frame.
    ImportError
        If matplotlib is not installed.
    """
    config = Config() if config is None else config
    axes = ensure_axes(ax, (10, 2.8))
    values = kinetic_energy(motion, omega=config.omega, inertia=config.inertia)
    smooth = gaussian_filter(values, config.smoothing * motion.rate)
    time = np.arange(motion.n_frames) * motion.frame_time
    segments = segment(motion, config)
    bounds = np.append(segments.start, segments.stop[-1])
    for start, stop in zip(segments.start[::2], segments.stop[::2], strict=True):
        axes.axvspan(time[start], time[stop], color="0.5", alpha=0.13, linewidth=0)
    axes.plot(time, values, color="0.5", linewidth=0.8, label="measured")
    axes.plot(time, smooth, color=PALETTE[0], linewidth=1.4, label="smoothed")
    x, y = time[bounds], smooth[bounds]
    axes.plot(x, y, ".", color=PALETTE[1], markersize=4, label="segment boundaries")
    axes.set_xlim(time[0], time[-1])
    axes.set_ylim(bottom=0)
    axes.set_xlabel("time (s)")
    axes.set_ylabel("kinetic energy")
    axes.set_title(f"{motion.name or 'motion'}: {len(segments)} segments", loc="left", fontsize=10)
    axes.legend(loc="upper right", fontsize=8)
    return axes
