"""Figures that are shown together, their joint groups, and the timelines of their segments."""

import os
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import chain, count
from pathlib import Path
from typing import Any

import numpy as np

from mograft._util.arrays import IntArray
from mograft.analysis.segmentation import segment
from mograft.body.groups import JointGroups
from mograft.config import Config
from mograft.errors import FormatError
from mograft.io.formats import find_addresses, find_format, read_clip, split_address
from mograft.io.gltf.document import read_gltf_file
from mograft.library.library import Library
from mograft.motion.motion import Motion
from mograft.motion.skeleton import Skeleton
from mograft.search.constraints import Constraint
from mograft.synthesis.graft_result import Graft
from mograft.synthesis.newness import newness
from mograft.viewing.figure import (
    CandidateTable,
    Figure,
    ShownConstraint,
    TimelineRow,
    candidate_table,
    read_recorded,
    recorded_base,
    recorded_constraints,
)

_PRESETS = ("lower_torso_larm_rarm", "lower_torso_arms", "lower_upper")
"""Joint groups of a motion without a library: the first preset that fits the skeleton."""


@dataclass(frozen=True, eq=False)
class Scene:
    """Figures that are shown together; frame numbers on the page are those of the first figure."""

    figures: tuple[Figure, ...]
    constraints: tuple[ShownConstraint, ...] = ()  # Their obstacles and targets are drawn.
    character: Path | None = None  # A glTF file with the mesh of the figures.

    @classmethod
    def of(
        cls,
        items: "Iterable[Item]",
        groups: JointGroups | str | None = None,
        config: Config | None = None,
        skeleton: Skeleton | None = None,
    ) -> "Scene":
        """Return a scene of the figures of motions, grafts, libraries and other scenes.

        A graft adds its base and then itself; a library adds all of its clips. An address adds
        the motions of its clips, or a graft if ``mograft graft`` wrote a .json file beside it. Each
        motion is added once.

        `groups`, joint groups or the name of a preset, set the colours of motions. By default,
        these are the groups of the first library with the same joint names (an item, or the library
        of a graft), otherwise trunk, arms and legs. `groups` have no effect on grafts, their bases
        and the clips of these libraries, which have the colours of their library or .json file, and
        on the figures of scenes. `config` holds the parameters of the segmentation of motions that
        are in none of these libraries. `skeleton` is the rest pose for files that store none.

        Raise a TypeError if an item has another type, and a ValueError if there is no item or the
        groups do not fit a skeleton.
        """
        items = list(items)
        sources = [item.library if isinstance(item, Graft) else item for item in items]
        libraries = [source for source in sources if isinstance(source, Library)]
        scene = _Builder(groups, libraries, config, skeleton)
        for item in items:
            scene.add(item)
        if not scene.figures:
            raise ValueError("`items` must contain at least one motion, got none")
        given = [item.character for item in items if isinstance(item, Scene) and item.character]
        return cls(tuple(scene.figures), tuple(scene.constraints), *given[:1])

    @classmethod
    def of_clips(cls, library: Library, clips: Iterable[int]) -> "Scene":
        """Return a scene of the clips of a library that have the given indices."""
        return cls(tuple(clip_figure(library, library.clips[clip]) for clip in clips))

    def with_character(self, path: Path | None) -> "Scene":
        """Return the scene with the mesh of a glTF file for all figures of its joints."""
        if path is not None:
            if find_format(path).name != "glTF":
                raise FormatError("expected a glTF file (.glb, .gltf) with a mesh", path)
            read_gltf_file(path)  # Raises an error if the file is invalid or has no joints.
        return replace(self, character=path)

    def with_files(self, files: Mapping[int, Path]) -> "Scene":
        """Return the scene with the commands of files, which are given by the `id` of motions."""
        figures = (
            own.with_file(files[id(own.motion)]) if id(own.motion) in files else own
            for own in self.figures
        )
        return replace(self, figures=tuple(figures))

    @property
    def groups(self) -> tuple[str, ...]:
        """Names of the joint groups of all figures, each once."""
        return tuple(dict.fromkeys(name for figure in self.figures for name in figure.members))


Item = Motion | Graft | Library | Scene | str | os.PathLike[str]
"""What a scene can contain."""


@dataclass(frozen=True, eq=False)
class _Builder:
    """The figures and constraints of a scene, collected item by item."""

    groups: JointGroups | str | None = None
    libraries: Sequence[Library] = ()
    config: Config | None = None
    skeleton: Skeleton | None = None
    figures: list[Figure] = field(default_factory=list)
    constraints: list[ShownConstraint] = field(default_factory=list)
    tables: dict[tuple[int, ...], CandidateTable] = field(default_factory=dict)
    grafts: list[Motion] = field(default_factory=list)

    def add(self, item: Item) -> None:
        """Add an item; raise a TypeError if its type is not one of `Item`."""
        if isinstance(item, Graft):
            self._add_figure(clip_figure(item.library, item.base))
            figure = graft_figure(item, self._candidates(item))
            note = str(newness(item, self.grafts))
            self.grafts.append(item.motion)
            self._add_figure(replace(figure, note=note))
            self._add_constraints(item.request.constraints, item.motion)
        elif isinstance(item, Library):
            for clip in item.clips:
                self._add_figure(clip_figure(item, clip))
        elif isinstance(item, Motion):
            self._add_figure(self.motion_figure(item))
        elif isinstance(item, Scene):
            for figure in item.figures:
                self._add_figure(figure)
            for constraint, motion in item.constraints:
                self._add_constraints([constraint], motion)
        elif isinstance(item, str | os.PathLike):
            for address in find_addresses(os.fspath(item), skeleton=self.skeleton):
                self._add_clip(address)
        else:
            raise TypeError(
                f"`items` must be motions, grafts, libraries, scenes or paths, got {item!r}"
            )

    def _add_clip(self, address: str) -> None:
        motion = read_clip(address, skeleton=self.skeleton)
        recorded = read_recorded(motion, Path(split_address(address)[0]))
        if recorded is None:
            self.add(motion)
            return
        figure, record = recorded
        base = recorded_base(motion, record, self.skeleton)
        if base is not None:
            shown = _Builder(config=record.config).motion_figure(base)
            self._add_figure(replace(shown, members=figure.members))
        self._add_figure(figure)
        self._add_constraints(recorded_constraints(record), motion)

    def _candidates(self, graft: Graft) -> CandidateTable:
        """Return the candidates of a graft; grafts of the same base segments share them."""
        key = (id(graft.library), *(s.segment for s in graft.substitutions))
        if key not in self.tables:
            self.tables[key] = candidate_table(graft)
        return self.tables[key]

    def _add_constraints(self, constraints: Iterable[Constraint], motion: Motion) -> None:
        for constraint in constraints:
            if constraint not in [shown.constraint for shown in self.constraints]:
                self.constraints.append(ShownConstraint(constraint, motion))

    def _add_figure(self, new: Figure) -> None:
        """Add a figure; if its motion was added before, keep the one with more timeline rows."""
        for index, old in enumerate(self.figures):
            if _is_same(old.motion, new.motion):
                if len(new.rows) > len(old.rows):
                    self.figures[index] = replace(new, name=old.name)
                return
        taken, stem = {figure.name for figure in self.figures}, new.name or "motion"
        names = chain([stem], (f"{stem} ({number})" for number in count(2)))
        name = next(name for name in names if name not in taken)
        self.figures.append(replace(new, name=name))

    def motion_figure(self, motion: Motion) -> Figure:
        """Return the figure of a motion; if a library has the motion, that of the clip."""
        for library in self.libraries:
            for clip in library.clips:
                if _is_same(clip, motion):
                    return clip_figure(library, clip)
        rows: tuple[TimelineRow, ...] = ()
        if motion.n_frames >= 2:
            found = segment(motion, self.config)
            unclustered = np.full(len(found), -1)
            rows = (TimelineRow.of_clip("segments", found.start, found.stop, unclustered),)
        return Figure(motion, motion.name, self._members(motion.skeleton), rows)

    def _members(self, skeleton: Skeleton) -> dict[str, IntArray]:
        groups = self.groups
        if isinstance(groups, str):
            groups = JointGroups.preset(groups, skeleton)
        fitting = (own.groups for own in self.libraries if own.skeleton.names == skeleton.names)
        groups = next(fitting, None) if groups is None else groups
        if groups is not None:
            return groups.resolve(skeleton)
        for preset in _PRESETS:
            with suppress(ValueError):
                return JointGroups.preset(preset, skeleton).resolve(skeleton)
        return {"body": np.arange(skeleton.n_joints)}


def _is_same(a: Motion, b: Motion) -> bool:
    return a is b or (
        a.name == b.name
        and a.frame_time == b.frame_time
        and a.skeleton.names == b.skeleton.names
        and np.array_equal(a.rotations, b.rotations)
        and np.array_equal(a.positions, b.positions)
        and np.array_equal(a.skeleton.offsets, b.skeleton.offsets)
    )


def motion_figure(motion: Motion, library: Library) -> Figure:
    """Return the figure of a motion, which has the skeleton of a library, with its groups."""
    return _Builder(library.groups, config=library.config).motion_figure(motion)


def clip_figure(library: Library, clip: Motion | str) -> Figure:
    """Return the figure of a clip of a library; a name is found sooner than a motion."""
    library, index = library.resolve_base(clip)
    segments = library.segments.of_clip(index)
    start, stop = library.segments.start[segments], library.segments.stop[segments]
    rows = tuple(
        TimelineRow.of_clip(group, start, stop, labels[segments])
        for group, labels in library.labels.items()
    )
    motion = library.clips[index]
    return Figure(motion, motion.name, library.groups.resolve(motion.skeleton), rows)


def graft_figure(graft: Graft, candidates: CandidateTable | None = None) -> Figure:
    """Return the figure of a graft."""
    groups = dict.fromkeys(s.group for s in graft.substitutions)
    motion, library = graft.motion, graft.library
    return Figure(
        motion,
        motion.name,
        library.groups.resolve(motion.skeleton),
        tuple(_graft_row(graft, group) for group in groups),
        candidates=candidates,
        clip_of=lambda name: library.clips[library.names.index(name)],
    )


def _graft_row(graft: Graft, group: str) -> TimelineRow:
    seams = (seam for seam in graft.seams if seam.group == group)
    angles = {seam.frame: round(float(np.degrees(seam.gap)), 2) for seam in seams}
    donors = [s for s in graft.substitutions if s.group == group]
    parts: dict[str, list[Any]] = {
        "start": [s.start for s in donors],
        "stop": [s.stop for s in donors],
        "cluster": graft.library.labels[group][[s.donor for s in donors]].tolist(),
        "clip": [s.clip for s in donors],
        "first": [s.donor_start for s in donors],
        "last": [s.donor_stop for s in donors],
        "is_exchanged": [not s.is_own for s in donors],
        "stretch": [s.stretch for s in donors],
        "before": [angles.get(s.start) for s in donors],
        "after": [angles.get(s.stop) for s in donors],
        "others": graft.alternatives[group].tolist(),
    }
    changes = [
        {
            "start": own.frames[0],
            "stop": own.frames[1],
            "first": own.clip_frames[0],
            "last": own.clip_frames[1],
            "source": own.clip if own.part is None else f"{own.part}: {own.clip}",
        }
        for own in graft.changes
        if own.group == group
    ]
    return TimelineRow(group, parts, changes)
