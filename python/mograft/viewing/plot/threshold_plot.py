"""The curve from which the scale of the cluster diameter threshold is chosen."""

from typing import TYPE_CHECKING

from mograft.analysis.scale_choice import MIN_SEGMENTS, scale_curve
from mograft.io.palette import PALETTE
from mograft.library.library import Library
from mograft.viewing.plot.cluster_plots import group_labels
from mograft.viewing.plot.figure_axes import ensure_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def threshold(library: Library, group: str | None = None, *, ax: "Axes | None" = None) -> "Axes":
    """Draw the error of exchanged parts against the scale of the cluster diameter threshold.

    Parameters
    ----------
    library : Library
        The library whose segments are compared.
    group : str, optional
        The joint group whose clusters restrict the donors. Default: the base group.
    ax : matplotlib Axes, optional
        Axes to draw into. Default: new axes.

    Returns
    -------
    matplotlib Axes
        The axes. The curve shows, for each scale, the error between segments of one cluster,
        relative to the error between random segments. The solid horizontal line is the error of
        repetitions, the dashed one the limit, 1.1 times that error. The solid vertical line is the
        scale that "auto" chooses. A dotted line is the scale of the library, if it differs. See
        `Config.sigma_scale`.

    Raises
    ------
    ValueError
        If the group does not exist, the library has fewer than 20 segments, or no other group can
        be compared.

    Examples
    --------
    >>> from mograft import Library, plot
    >>> from mograft.dancer import dance
    >>> axes = plot.threshold(Library.build(dance(strides=1).motion))
    >>> axes.get_xlabel()
    'sigma_scale'
    """
    name, _ = group_labels(library, group)
    curve = scale_curve(library.embedding, name, library.config)
    if curve is None:
        raise ValueError(
            f"the scale of group {name!r} needs at least {MIN_SEGMENTS} segments and an embedding "
            f"of this and of another group; the library has {len(library.segments)} segments"
        )
    axes = ensure_axes(ax, (6, 4))
    axes.plot(curve.scales, curve.errors, color=PALETTE[0], label="within clusters")
    axes.axhline(curve.repetition_error, color=PALETTE[2], label="repetitions")
    axes.axhline(curve.limit, color=PALETTE[2], linestyle="--", linewidth=1, label="limit")
    axes.axvline(curve.scale, color=PALETTE[1], label=f"auto: {curve.scale:.2f}")
    own = library.sigma_scales[name]
    if isinstance(library.config.sigma, str) and own != curve.scale:
        axes.axvline(own, color="0.5", linestyle=":", label=f"library: {own:.2f}")
    axes.set_xscale("log")
    ticks = [0.3, 0.5, 0.75, 1.0, 1.5]
    axes.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    axes.set_xticks([], minor=True)
    axes.set_ylim(bottom=0.0)
    axes.set_xlabel("sigma_scale")
    axes.set_ylabel("error of other parts / chance")
    axes.set_title(f"{name}: {len(library.segments)} segments", loc="left", fontsize=10)
    axes.legend(frameon=False, fontsize=8)
    return axes
