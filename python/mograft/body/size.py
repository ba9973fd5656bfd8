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
    less than half, the median.
    """
    sizes = {name: figure_size(own) for name, own in skeletons.items()}
    reference = sorted(sizes, key=lambda name: sizes[name])[(len(sizes) - 1) // 2 :][:1]
    ratios = {name: size / sizes[reference[0]] for name, size in sizes.items()}
    others = [
        f"{name} ({ratio:.3g} times)"
        for name, ratio in ratios.items()
        if max(ratio, 1.0 / ratio) > _MAX_SIZE_RATIO
    ]
    names = join_names(others, _MAX_NAMES)
    return [f"the legs are longer or shorter than in {reference[0]}: {names}"] if others else []
