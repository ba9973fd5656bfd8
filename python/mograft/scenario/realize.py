"""Realization of a scenario: its segments in sequence, as one motion with planted feet."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray, IntArray
from mograft.blend.foot_planting import plant_feet
from mograft.blend.recombine import recombine
from mograft.blend.rigid_alignment import RootTransforms
from mograft.blend.transplant import GraftedGroup, transplant
from mograft.body.contacts import detect_contacts, find_legs, foot_heights
from mograft.library.library import Library
from mograft.motion import rotations
from mograft.motion.motion import Motion
from mograft.motion.segments import Segments
from mograft.scenario.scenario import Scenario


def realize_scenario(library: Library, scenario: Scenario) -> tuple[Motion, Segments]:
    """Return the motion of a scenario, and for each of its segments the frames in this motion.

    Gaps between consecutive segments are closed. Feet are planted unless `Config.feet` is "never".
    """
    donors = library.segments[scenario.segments]
    lengths = donors.lengths if scenario.lengths is None else scenario.lengths
    stops = np.cumsum(lengths)
    cut = Segments(np.concatenate([[0], stops[:-1]]), stops)
    # Clips of a stored library are read on access: each is read once.
    used, index = np.unique(donors.clip, return_inverse=True)
    clips = [library.clips[int(clip)] for clip in used]
    donors = replace(donors, clip=index)
    base = _still(clips[index[0]], int(donors.start[0]), int(stops[-1]) + 1)
    if scenario.place is not None or scenario.turn:
        base = _place_root(base, scenario, library.root, library.up)
    joints = joints_of_donors(library, np.arange(base.n_joints))
    group = GraftedGroup(joints, library.root, library.up)
    part = transplant(base, cut, donors, clips, group, library.config)
    motion = recombine(base, [part], base.name)
    if library.config.feet != "never" and len(part.seams):
        sources = [scenario.segments] * len(find_legs(base.skeleton))
        contacts, heights = donor_contacts(library, cut, sources)
        motion, _ = plant_feet(motion, contacts, min_heights=heights)
    return motion, cut


def joints_of_donors(library: Library, joints: IntArray) -> IntArray:
    """Return the joints whose motion donors replace: `joints` without the ancestors of the root.

    The ancestors keep the motion of the base. The root moves in the world as in the donors.
    """
    above = library.skeleton.ancestors(library.root)
    return np.setdiff1d(joints, above).astype(np.int64)


def donor_contacts(
    library: Library, cut: Segments, leg_donors: Sequence[IntArray]
) -> tuple[BoolArray, FloatArray]:
    """Return the foot contacts and foot heights that each leg has in its donors.

    `leg_donors` has, for every leg, the donor of each base segment in `cut`. Both results have
    shape (n_frames, n_legs, 2); see `detect_contacts` and `foot_heights`.
    """
    n_frames = int(cut.stop[-1]) + 1
    contacts = np.empty((n_frames, len(leg_donors), 2), bool)
    heights = np.empty((n_frames, len(leg_donors), 2))
    segments = library.segments

    @cache
    def clip_feet(clip: int) -> tuple[BoolArray, FloatArray]:
        motion = library.clips[clip]
        return detect_contacts(motion), foot_heights(motion)

    for leg, donors in enumerate(leg_donors):
        for position, donor in enumerate(donors.tolist()):
            clip_contacts, clip_heights = clip_feet(int(segments.clip[donor]))
            n, m = int(cut.lengths[position]), int(segments.lengths[donor])
            frames = segments.start[donor] + (np.arange(n + 1) * m + n // 2) // n
            rows = slice(int(cut.start[position]), int(cut.stop[position]) + 1)
            contacts[rows, leg] = clip_contacts[frames, leg]
            heights[rows, leg] = clip_heights[frames, leg]
    return contacts, heights


def _still(clip: Motion, frame: int, n_frames: int) -> Motion:
    """Return a motion that repeats one frame of a clip."""
    return replace(
        clip,
        rotations=np.repeat(clip.rotations[[frame]], n_frames, axis=0),
        positions=np.repeat(clip.positions[[frame]], n_frames, axis=0),
        channel_values=None,
        name="scenario",
        path=None,
        clip=None,
        repairs=(),
    )


def _place_root(motion: Motion, scenario: Scenario, root: int, up: int) -> Motion:
    """Rotate a motionless figure by `scenario.turn` and move its root to `scenario.place`."""
    world_quats, world_positions = motion.world_transforms()
    position, parent = world_positions[0, root], int(motion.skeleton.parents[root])
    if scenario.place is not None:
        position = np.where(np.arange(3) == up, position, scenario.place)
    yaw = rotations.from_axis_angle(np.eye(3)[up], scenario.turn)
    transform = RootTransforms(rotations.multiply(yaw, world_quats[0, root]), position)
    if parent >= 0:
        transform = transform.relative_to(
            RootTransforms(world_quats[0, parent], world_positions[0, parent])
        )
    quats, positions = motion.rotations.copy(), motion.positions.copy()
    quats[:, root], positions[:, root] = transform.rotations, transform.positions
    return replace(motion, rotations=quats, positions=positions)
