"""The contents of a library, and queries on them."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import Any, Literal, Self, SupportsIndex

import numpy as np
import numpy.typing as npt

from mograft._util.arrays import BoolArray, FloatArray, IntArray
from mograft._util.html_table import notebook_table
from mograft.analysis.channel_groups import restrict_ends
from mograft.analysis.embedding import Embedding, Samples
from mograft.body.contacts import find_legs
from mograft.body.groups import JointGroups, suggest_groups
from mograft.config import Config
from mograft.library.clip_table import ClipInfo
from mograft.library.files.stored_clips import JoinedSamples
from mograft.library.segment_balance import LibraryBalance
from mograft.library.spec import LibrarySpec
from mograft.motion.motion import Motion
from mograft.motion.segments import Segments
from mograft.motion.skeleton import Skeleton
from mograft.search.boundary_states import BoundaryStates
from mograft.search.copies import SegmentParts
from mograft.search.segment_pool import SegmentBalance, SegmentPool

Column = npt.NDArray[Any] | list[str]


class Columns(dict[str, Column]):
    """The columns of a table by name, of equal length: arrays of numbers, or lists of texts.

    ``pandas.DataFrame``, ``polars.DataFrame`` and ``pyarrow.table`` accept it like any other dict.
    Notebooks show its first rows.
    """

    def __repr__(self) -> str:
        return f"Columns({len(next(iter(self.values()), ()))} rows: {', '.join(self)})"

    def _repr_html_(self) -> str:
        n_rows = len(next(iter(self.values()), ()))
        lists = [own if isinstance(own, list) else own.tolist() for own in self.values()]
        return notebook_table(f"{n_rows} rows", tuple(self), zip(*lists, strict=True), n_rows)


_RECIPE = "_recipe"
"""Name of the attribute that `LibraryData.set_recipe` sets: a function and its arguments."""


@dataclass(frozen=True, eq=False)
class LibraryData:
    """The contents of a library; `mograft.Library` documents the attributes."""

    clips: Sequence[Motion]
    entries: tuple[ClipInfo, ...]
    segments: Segments
    is_donor: BoolArray
    groups: JointGroups
    config: Config
    spec: LibrarySpec
    embedding: Mapping[str, Embedding | None]
    labels: Mapping[str, IntArray]
    sigma: Mapping[str, float]
    boundary_states: Mapping[str, Mapping[str, FloatArray]]
    samples: Samples | JoinedSamples
    refused: Mapping[str, str]
    folder: Path | None

    def __reduce_ex__(self, protocol: SupportsIndex) -> str | tuple[Any, ...]:
        """Pickle the call that `set_recipe` stored; if there is none, pickle the fields."""
        recipe: tuple[Any, ...] | None = self.__dict__.get(_RECIPE)
        return super().__reduce_ex__(protocol) if recipe is None else recipe

    def set_recipe(self, function: Callable[..., Any], *arguments: object) -> Self:
        """Make `pickle` store the call ``function(*arguments)`` instead of the fields.

        Unpickling repeats the call, whose result must be this library. `dataclasses.replace` does
        not copy the call. Return this library.
        """
        self.__dict__[_RECIPE] = (function, arguments)
        return self

    @property
    def has_recipe(self) -> bool:
        """Whether `pickle` stores a call instead of the fields."""
        return _RECIPE in self.__dict__

    def __repr__(self) -> str:
        groups = ", ".join(f"{name} {own.max() + 1} clusters" for name, own in self.labels.items())
        n = len(self.entries)
        clips = "1 clip" if n == 1 else f"{n} clips"
        return f"{type(self).__name__}({clips}, {len(self.segments)} segments, {groups})"

    def _repr_html_(self) -> str:
        names, segments = self.skeleton.names, self.segments
        n_segments = np.bincount(segments.clip, minlength=len(self.entries)).tolist()
        clips = (
            (info.name, info.n_frames, (info.n_frames - 1) / self.rate, count, " ".join(info.tags))
            for info, count in zip(self.entries, n_segments, strict=True)
        )
        groups = [
            (
                f"{group} (base)" if group == self.groups.base else group,
                ", ".join(names[joint] for joint in self.joints(group)),
                int(labels.max(initial=-1)) + 1,
            )
            for group, labels in self.labels.items()
        ]
        columns = ("clip", "frames", "seconds", "segments", "tags")
        caption = f"{self!r}, {self.rate:.6g} fps"
        return notebook_table(caption, columns, clips, len(self.entries)) + notebook_table(
            "Joint groups", ("group", "joints", "clusters"), groups, len(groups)
        )

    @property
    def skeleton(self) -> Skeleton:
        """A skeleton with the joint names and the hierarchy of all clips."""
        return self.spec.skeleton

    @property
    def rate(self) -> float:
        """Frames per second of all clips, up to the rounding of frame times in files."""
        return self.spec.rate

    @property
    def root(self) -> int:
        """Index of the joint that carries the body through the world."""
        return self.spec.root

    @property
    def up(self) -> int:
        """The axis that points up: 0, 1 or 2."""
        return self.spec.up

    @property
    def names(self) -> tuple[str, ...]:
        """The name of each clip."""
        return tuple(info.name for info in self.entries)

    @property
    def tags(self) -> tuple[frozenset[str], ...]:
        """The tags of each clip."""
        return tuple(frozenset(info.tags) for info in self.entries)

    def to_dataframe(self, table: Literal["segments", "clips", "points"] = "segments") -> Columns:
        """Return a table of the library as columns, for pandas, Polars or PyArrow.

        Parameters
        ----------
        table : {"segments", "clips", "points"}
            ``segments`` has a row per segment: its number ``segment``; ``clip``, the index of its
            clip; its first and last frame, ``start`` and ``stop``; its duration in ``seconds``;
            ``is_donor``; and its cluster ``label_GROUP`` for each joint group. ``clips`` has a row
            per clip: its index ``clip``; its ``name``; its ``file`` and its name in the file,
            ``file_clip``; the hash ``sha256`` of the file; the number of ``frames`` at the
            library's rate; ``own_rate``, the frames per second before resampling; ``tags`` and
            ``faults``. ``points`` has a row per segment: ``segment``, and its coordinates
            ``GROUP_0``, ``GROUP_1``... in the embedding of each group.

        Returns
        -------
        dict of str to ndarray or list of str
            The columns by name. Pass it to ``pandas.DataFrame``, ``polars.DataFrame`` or
            ``pyarrow.table``; mograft itself needs none of them.

        Raises
        ------
        ValueError
            If there is no table of this name.

        Examples
        --------
        >>> from mograft import Library
        >>> from mograft.dancer import dance
        >>> library = Library.build(dance(strides=1).motion)
        >>> library.to_dataframe()["seconds"].shape == (len(library.segments),)
        True
        """
        tables = library_tables(self)
        if table not in tables:
            raise ValueError(f"`table` must be one of {', '.join(tables)}, got {table!r}")
        return tables[table]

    def file_name(self, clip: int) -> str | None:
        """Return the name of the file from which a clip was read, or None if it is unknown."""
        file = self.entries[clip].source_file
        path = self.clips[clip].path if file is None else Path(file.path)
        return None if path is None else path.name

    def joints(self, group: str) -> IntArray:
        """Return the joints of a group, ascending."""
        if group not in self._members:
            names = ", ".join(self._members)
            hint = suggest_groups(group, self._members)
            raise ValueError(f"`group` must be one of {names}, got {group!r}{hint}")
        return self._members[group].copy()

    @cached_property
    def _members(self) -> dict[str, IntArray]:
        return self.groups.resolve(self.skeleton)

    @cached_property
    def _pools(self) -> dict[str, SegmentPool]:
        return {}

    def pool(self, group: str) -> SegmentPool:
        """Return all segments with the data for the donor search of a group; built on first use."""
        if group in self._pools:
            return self._pools[group]
        base = self.groups.base
        embedding, joints = self.embedding[base], self.joints(group)
        held = self.groups.divided_channels(self.skeleton)[group]
        states = restrict_ends(self.boundary_states[group], joints, self.skeleton, held)
        boundary = BoundaryStates(**states)
        pool = self._pools[group] = SegmentPool(
            self.segments,
            self.labels[base],
            self.is_donor,
            boundary,
            rate=self.rate,
            points=None if embedding is None else embedding.points,
            sigma=self.sigma[base],
            balance=self._balance_of(joints),
            parts=SegmentParts(self.samples, boundary, self.skeleton, joints, self.root, held),
        )
        return pool

    def _balance_of(self, joints: IntArray) -> SegmentBalance | None:
        """Return what the donor search needs to compare the balance of donors for these joints.

        The result is None if the joints include the root or an ankle, or the skeleton has no legs.
        """
        fixed = [self.root, *(leg.ankle for leg in find_legs(self.skeleton))]
        if len(fixed) == 1 or np.isin(fixed, joints).any():
            return None
        known = self._balance
        return SegmentBalance(partial(known.mass_offsets, joints), known.support_margins)

    @cached_property
    def _balance(self) -> LibraryBalance:
        return LibraryBalance(self.clips, self.segments, self.samples, self.spec, self.config)

    def find_clip(self, motion: Motion) -> int | None:
        """Return the index of the first clip with the poses of a motion; None if there is none."""
        alike = (k for k, info in enumerate(self.entries) if info.n_frames == motion.n_frames)
        return next((k for k in alike if has_same_poses(self.clips[k], motion)), None)


def has_same_poses(motion: Motion, other: Motion) -> bool:
    """Return whether two motions have equal rotations and positions."""
    return motion is other or (
        np.array_equal(motion.rotations, other.rotations)
        and np.array_equal(motion.positions, other.positions)
    )


def library_tables(library: LibraryData) -> dict[str, Columns]:
    """Return the tables ``clips``, ``segments`` and ``points`` of a library by name.

    `LibraryData.to_dataframe` describes them.
    """
    segments, entries = library.segments, library.entries
    files = [info.source_file for info in entries]
    points = Columns(segment=np.arange(len(segments)))
    for group, embedding in library.embedding.items():
        if embedding is not None:
            for axis, column in enumerate(np.ascontiguousarray(embedding.points.T)):
                points[f"{group}_{axis}"] = column
    return {
        "clips": Columns(
            clip=np.arange(len(entries)),
            name=list(library.names),
            file=["" if file is None else file.path for file in files],
            file_clip=["" if file is None or file.clip is None else file.clip for file in files],
            sha256=["" if file is None else file.sha256 for file in files],
            frames=np.array([info.n_frames for info in entries], np.int64),
            own_rate=np.array([info.source_rate for info in entries], np.float64),
            tags=[" ".join(info.tags) for info in entries],
            faults=["; ".join(info.faults) for info in entries],
        ),
        "segments": Columns(
            segment=np.arange(len(segments)),
            clip=segments.clip,
            start=segments.start,
            stop=segments.stop,
            seconds=segments.lengths / library.rate,
            is_donor=library.is_donor,
            **{f"label_{group}": labels for group, labels in library.labels.items()},
        ),
        "points": points,
    }
