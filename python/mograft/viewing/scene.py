"""Figures that are shown together, their joint groups, and the timelines of their segments."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray, IntArray
from mograft.analysis.segmentation import segment
from mograft.body.groups import JointGroups
from mograft.library.library import Library
from mograft.motion.motion import Motion
from mograft.motion.skeleton import Skeleton
from mograft.synthesis.graft_result import Graft

_PRESETS = ("lower_torso_larm_rarm", "lower_torso_arms", "lower_upper")
"""Joint groups of a motion without a library: the first preset that fits the skeleton."""


@dataclass(frozen=True, eq=False, kw_only=True)
class TimelineRow:
    """One row of the timeline: the segments of one joint group of a motion."""

    group: str
    start: IntArray  # First and last frame of each segment, both inclusive.
    stop: IntArray
    cluster: IntArray  # Of each segment, in grafts of its donor; -1 without clusters.
    donor_clips: tuple[str, ...]  # Name of each donor's clip; empty if nothing was grafted.
    donor_start: IntArray  # First and last frame of each donor in its clip.
    donor_stop: IntArray
    is_exchanged: BoolArray  # Whether the donor is another segment.
    stretch: FloatArray  # Relative change of each donor's duration.
    seam_angles: FloatArray  # Before and after each segment (n, 2), degrees; NaN without a seam.
    n_alternatives: IntArray  # Number of donors other than the segment itself; -1 if unknown.

    @classmethod
    def without_donors(
        cls, group: str, start: IntArray, stop: IntArray, cluster: IntArray
    ) -> "TimelineRow":
        """Return the row of captured segments."""
        zeros = np.zeros(len(start), np.int64)
        return cls(
            group=group,
            start=start,
            stop=stop,
            cluster=cluster,
            donor_clips=(),
            donor_start=zeros,
            donor_stop=zeros,
            is_exchanged=np.zeros(len(start), bool),
            stretch=np.zeros(len(start)),
            seam_angles=np.full((len(start), 2), np.nan),
            n_alternatives=zeros - 1,
        )


@dataclass(frozen=True, eq=False)
class Figure:
    """One moving figure."""

    motion: Motion
    name: str  # Name on the page.
    members: Mapping[str, IntArray]  # The joints of each group.
    rows: tuple[TimelineRow, ...]  # The rows of the figure in the timeline.

    def group_of_nodes(self, parents: Sequence[int]) -> list[int]:
        """Return the index of the joint group of each node.

        `parents` holds the parent of each node: of the joints, then of the end sites. An end site
        belongs to the group of its parent.
        """
        groups = np.zeros(len(parents), np.int64)
        for index, joints in enumerate(self.members.values()):
            groups[joints] = index
        for node in range(self.motion.n_joints, len(parents)):
            groups[node] = groups[max(parents[node], 0)]
        indices: list[int] = groups.tolist()
        return indices


@dataclass(frozen=True, eq=False)
class Scene:
    """Figures that are shown together; frame numbers on the page are those of the first figure."""

    figures: tuple[Figure, ...]

    @classmethod
    def of(
        cls,
        items: "Iterable[Motion | Graft | Library | Scene]",
        groups: JointGroups | str | None = None,
    ) -> "Scene":
        """Return a scene of the figures of motions, grafts, libraries and other scenes.

        A graft adds its base and then itself; a library adds all of its clips. Each motion is added
        once. `groups`, joint groups or the name of a preset, set the colours of motions. By
        default, these are the groups of the first library with the same joint names (an item, or
        the library of a graft), otherwise trunk, arms and legs. Grafts and clips of these libraries
        always have the colours of their library's groups, and the figures of a scene keep their
        colours. Raise a TypeError if an item has another type, and a ValueError if there is no item
        or the groups do not fit a skeleton.
        """
        items = list(items)
        sources = [item.library if isinstance(item, Graft) else item for item in items]
        libraries = [source for source in sources if isinstance(source, Library)]
        figures: list[Figure] = []
        for item in items:
            if isinstance(item, Graft):
                found = [_clip_figure(item.library, item.base), _graft_figure(item)]
            elif isinstance(item, Library):
                found = [_clip_figure(item, clip) for clip in item.clips]
            elif isinstance(item, Motion):
                found = [_motion_figure(item, groups, libraries)]
            elif isinstance(item, Scene):
                found = list(item.figures)
            else:
                raise TypeError(
                    f"`items` must be motions, grafts, libraries or scenes, got {item!r}"
                )
            for figure in found:
                _add(figures, figure)
        if not figures:
            raise ValueError("`items` must contain at least one motion, got none")
        return cls(tuple(figures))

    @classmethod
    def of_clips(cls, library: Library, clips: Iterable[int]) -> "Scene":
        """Return a scene of the clips of a library that have the given indices."""
        return cls(tuple(_clip_figure(library, library.clips[clip]) for clip in clips))

    @property
    def groups(self) -> tuple[str, ...]:
        """Names of the joint groups of all figures, each once."""
        return tuple(dict.fromkeys(name for figure in self.figures for name in figure.members))


def _add(figures: list[Figure], new: Figure) -> None:
    """Append a figure; if the list contains its motion, keep the figure with more timeline rows."""
    for index, old in enumerate(figures):
        if _is_same(old.motion, new.motion):
            if len(new.rows) > len(old.rows):
                figures[index] = replace(new, name=old.name)
            return
    names = {figure.name for figure in figures}
    name = stem = new.name or "motion"
    count = 1
    while name in names:
        count += 1
        name = f"{stem} ({count})"
    figures.append(replace(new, name=name))


def _is_same(a: Motion, b: Motion) -> bool:
    return a is b or (
        a.name == b.name
        and a.frame_time == b.frame_time
        and a.skeleton.names == b.skeleton.names
        and np.array_equal(a.rotations, b.rotations)
        and np.array_equal(a.positions, b.positions)
        and np.array_equal(a.skeleton.offsets, b.skeleton.offsets)
    )


def _motion_figure(
    motion: Motion, groups: JointGroups | str | None, libraries: Sequence[Library]
) -> Figure:
    for library in libraries:
        for clip in library.clips:
            if _is_same(clip, motion):
                return _clip_figure(library, clip)
    rows: tuple[TimelineRow, ...] = ()
    if motion.n_frames >= 2:
        found = segment(motion)
        unclustered = np.full(len(found), -1)
        rows = (TimelineRow.without_donors("segments", found.start, found.stop, unclustered),)
    return Figure(motion, motion.name, _members(motion.skeleton, groups, libraries), rows)


def _members(
    skeleton: Skeleton, groups: JointGroups | str | None, libraries: Sequence[Library]
) -> dict[str, IntArray]:
    if isinstance(groups, str):
        groups = JointGroups.preset(groups, skeleton)
    if groups is not None:
        return groups.resolve(skeleton)
    for library in libraries:
        if library.skeleton.names == skeleton.names:
            return library.groups.resolve(skeleton)
    for preset in _PRESETS:
        try:
            return JointGroups.preset(preset, skeleton).resolve(skeleton)
        except ValueError:
            continue
    return {"body": np.arange(skeleton.n_joints)}


def _clip_figure(library: Library, clip: Motion) -> Figure:
    library, index = library.resolve_base(clip)
    segments = library.segments.of_clip(index)
    start, stop = library.segments.start[segments], library.segments.stop[segments]
    rows = tuple(
        TimelineRow.without_donors(group, start, stop, labels[segments])
        for group, labels in library.labels.items()
    )
    motion = library.clips[index]
    return Figure(motion, motion.name, library.groups.resolve(motion.skeleton), rows)


def _graft_figure(graft: Graft) -> Figure:
    groups = dict.fromkeys(s.group for s in graft.substitutions)
    members = graft.library.groups.resolve(graft.motion.skeleton)
    rows = tuple(_graft_row(graft, group) for group in groups)
    return Figure(graft.motion, graft.motion.name, members, rows)


def _graft_row(graft: Graft, group: str) -> TimelineRow:
    substitutions = [s for s in graft.substitutions if s.group == group]
    angles = {seam.frame: np.degrees(seam.gap) for seam in graft.seams if seam.group == group}
    return TimelineRow(
        group=group,
        start=np.array([s.start for s in substitutions]),
        stop=np.array([s.stop for s in substitutions]),
        cluster=graft.library.labels[group][[s.donor for s in substitutions]],
        donor_clips=tuple(s.clip for s in substitutions),
        donor_start=np.array([s.donor_start for s in substitutions]),
        donor_stop=np.array([s.donor_stop for s in substitutions]),
        is_exchanged=np.array([not s.is_own for s in substitutions]),
        stretch=np.array([s.stretch for s in substitutions]),
        seam_angles=np.array(
            [[angles.get(frame, np.nan) for frame in (s.start, s.stop)] for s in substitutions]
        ),
        n_alternatives=np.asarray(graft.alternatives[group]),
    )
