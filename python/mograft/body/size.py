"""Sizes of figures: motions of figures of one hierarchy that differ in size or unit."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from mograft._util.containers import remember
from mograft.body.mass import mass_model, path_length
from mograft.errors import join_names
from mograft.motion.motion import Motion
from mograft.motion.skeleton import Skeleton

_MAX_SIZE_RATIO = 2.0
"""Ratio of sizes above which `describe_sizes` names a figure: an inch has 2.54 centimetres, and
adults are less than twice as large as school children."""

_MAX_NAMES = 8


def figure_size(skeleton: Skeleton) -> float:
    """Return the mean length of the legs along the bones; without legs, the stature."""
    body = mass_model(skeleton)
    legs = [path_length(skeleton, body.hips, foot.ankle) for foot in body.feet]
    return float(np.mean(legs)) if any(legs) else body.height


def size_ratio(skeleton: Skeleton, other: Skeleton) -> float:
    """Return the `figure_size` of a skeleton divided by that of another one."""
    return figure_size(skeleton) / figure_size(other)


def resize(motion: Motion, skeleton: Skeleton) -> Motion:
    """Return a motion with all lengths multiplied so that the figure has the size of `skeleton`.

    The motion itself is returned if the sizes are equal. Otherwise the result is kept as long as
    the motion.
    """
    ratio = size_ratio(skeleton, motion.skeleton)
    if ratio == 1.0:
        return motion
    return remember(motion, ("size", ratio), lambda: _scale(motion, ratio))


def _scale(motion: Motion, ratio: float) -> Motion:
    own = motion.skeleton
    sites = tuple(replace(site, offset=ratio * site.offset) for site in own.end_sites)
    return replace(
        motion,
        skeleton=replace(own, offsets=ratio * own.offsets, end_sites=sites),
        positions=ratio * motion.positions,
        channel_values=None,
        computed_values=None,
    )


def describe_sizes(skeletons: Mapping[str, Skeleton]) -> list[str]:
    """Return for each hierarchy a line that names figures of other sizes, probably other units.

    The keys of `skeletons` are the names of motions. A size differs if it is more than twice, or
    less than half, the median; if no size does, there is no line.
    """
    hierarchies: dict[object, list[tuple[float, str]]] = {}
    for name, own in skeletons.items():
        key = own.names, own.parents.tobytes()
        hierarchies.setdefault(key, []).append((figure_size(own), name))
    lines = []
    for sizes in hierarchies.values():
        median, reference = sorted(sizes)[(len(sizes) - 1) // 2]
        ratios = [(size / median, name) for size, name in sizes]
        others = [
            f"{name} ({ratio:.3g} times)"
            for ratio, name in ratios
            if max(ratio, 1.0 / ratio) > _MAX_SIZE_RATIO
        ]
        if others:
            names = join_names(others, _MAX_NAMES)
            lines.append(f"the legs are longer or shorter than in {reference}: {names}")
    return lines
