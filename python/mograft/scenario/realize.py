"""From a scenario to its motion: segments one after the other, on their feet."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray, IntArray
from mograft.analysis.segmentation import Segments
from mograft.blend.foot_planting import plant_feet
from mograft.blend.recombine import recombine
from mograft.blend.transplant import GraftedGroup, transplant
from mograft.body.contacts import detect_contacts, find_legs, foot_heights
from mograft.library.library import Library
from mograft.motion import rotations
from mograft.motion.motion import Motion
from mograft.scenario.walks import Scenario

__all__ = ["donor_contacts", "realize_scenario"]


def realize_scenario(library: Library, scenario: Scenario) -> tuple[Motion, Segments]:
    """Return the motion of segments one after the other, on its feet, and where they are in it."""
    own = library.segments[scenario.segments]
    stops = np.cumsum(own.lengths if scenario.lengths is None else scenario.lengths)
    cut = Segments(np.concatenate([[0], stops[:-1]]), stops)
    # Each clip is read once: a stored library's are only there while they are asked for.
    clips = {int(index): library.clips[int(index)] for index in np.unique(own.clip)}
    numbers, at = np.unique(own.clip, return_inverse=True)
    own = replace(own, clip=at)
    several = [clips[index] for index in numbers.tolist()]
    first = several[at[0]]
    n_frames = int(stops[-1]) + 1
    bare = replace(
        first,
        rotations=np.repeat(first.rotations[own.start[:1]], n_frames, axis=0),
        positions=np.repeat(first.positions[own.start[:1]], n_frames, axis=0),
        channel_values=None,
        name=f"{first.name}_scenario",
        path=None,
        repairs=(),
    )
    if scenario.place is not None or scenario.turn:
        bare = _moved(bare, scenario, library.root, library.up)
    group = GraftedGroup(np.arange(first.n_joints), library.root, library.up)
    part = transplant(bare, cut, own, several, group, library.config)
    motion = recombine(bare, [part], bare.name)
    if library.config.feet != "never" and len(part.seams):
        sources = [scenario.segments] * len(find_legs(first.skeleton))
        stood, heights = donor_contacts(library, cut, sources)
        motion, _ = plant_feet(motion, stood, min_heights=heights)
    return motion, cut


def donor_contacts(
    library: Library, cut: Segments, sources: Sequence[IntArray]
) -> tuple[BoolArray, FloatArray]:
    """Return when feet stand and how high they are, as in the segments that legs come from."""
    n_frames = int(cut.stop[-1]) + 1
    stood = np.empty((n_frames, len(sources), 2), bool)
    heights = np.empty((n_frames, len(sources), 2))
    known: dict[int, tuple[BoolArray, FloatArray]] = {}
    taken = library.segments
    for index, donors in enumerate(sources):
        for place, donor in enumerate(donors.tolist()):
            clip = int(taken.clip[donor])
            if clip not in known:
                own = library.clips[clip]
                known[clip] = detect_contacts(own), foot_heights(own)
            n, m = int(cut.lengths[place]), int(taken.lengths[donor])
            frames = taken.start[donor] + (np.arange(n + 1) * m + n // 2) // n
            rows = slice(int(cut.start[place]), int(cut.stop[place]) + 1)
            stood[rows, index] = known[clip][0][frames, index]
            heights[rows, index] = known[clip][1][frames, index]
    return stood, heights


def _moved(motion: Motion, scenario: Scenario, root: int, up: int) -> Motion:
    """Return a still figure with its root turned about up and put in its place."""
    turned, placed = motion.world_transforms()
    spot, above = placed[0, root].copy(), int(motion.skeleton.parents[root])
    if scenario.place is not None:
        height = spot[up]
        spot = scenario.place.copy()
        spot[up] = height
    quat = rotations.multiply(
        rotations.from_axis_angle(np.eye(3)[up], scenario.turn), turned[0, root]
    )
    if above >= 0:
        back = rotations.inverse(turned[0, above])
        quat = rotations.multiply(back, quat)
        spot = rotations.rotate(back, spot - placed[0, above])
    quats, places = motion.rotations.copy(), motion.positions.copy()
    quats[:, root], places[:, root] = quat, spot
    return replace(motion, rotations=quats, positions=places)
