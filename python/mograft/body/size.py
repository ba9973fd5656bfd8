"""Sizes of figures: motions of figures of one hierarchy that differ in size or unit."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from mograft._util.containers import remember
from mograft.body.mass import mass_model, path_length
from mograft.errors import join_names
from mograft.motion.motion import Motion
from mograft.motion.skeleton import Skeleton


def figure_size(skeleton: Skeleton) -> float:
    """Return the mean length of the legs along the bones; without legs, the stature."""

    def compute() -> float:
        body = mass_model(skeleton)
        legs = [path_length(skeleton, body.hips, foot.ankle) for foot in body.feet]
        return float(np.mean(legs)) if any(legs) else body.height

    return remember(skeleton, "figure size", compute)


def resize(motion: Motion, skeleton: Skeleton) -> Motion:
    """Return a motion with all lengths multiplied so that the figure has the size of `skeleton`.

    The motion itself is returned if the sizes are equal. Otherwise the result is kept as long as
    the motion.
    """
    own, ratio = motion.skeleton, figure_size(skeleton) / figure_size(motion.skeleton)

    def scale() -> Motion:
        sites = tuple(replace(site, offset=ratio * site.offset) for site in own.end_sites)
        scaled = replace(own, offsets=ratio * own.offsets, end_sites=sites)
        places = ratio * motion.positions
        return Motion(scaled, motion.frame_time, motion.rotations, places, name=motion.name)

    return motion if ratio == 1.0 else remember(motion, ("size", ratio), scale)


def describe_sizes(skeletons: Mapping[str, Skeleton]) -> list[str]:
    """Return a line that names figures of other sizes, probably other units, or no line.

    The keys of `skeletons` are the names of motions. A size differs if it is more than twice, or
    less than half, the median of the figures with the same joints.
    """
    sizes: dict[tuple[str, ...], dict[str, float]] = {}
    for name, own in skeletons.items():
        sizes.setdefault(tuple(own.names), {})[name] = figure_size(own)
    others = []
    for same in sizes.values():
        median = sorted(same.values())[(len(same) - 1) // 2]
        ratios = {name: size / median for name, size in same.items()}
        others += [f"{name} ({x:.3g} times)" for name, x in ratios.items() if not 0.5 <= x <= 2.0]
    return [f"legs are not as long as the median: {join_names(others)}"] if others else []
