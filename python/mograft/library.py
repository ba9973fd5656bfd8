"""Clips cut, compared and labelled: what donors are chosen from."""

import os
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from itertools import chain
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mograft import store
from mograft._arrays import BoolArray, FloatArray, IntArray
from mograft.anatomy import feature_joints
from mograft.body import body
from mograft.channels import HeldSamples, ends_alone, samples_alone
from mograft.clustering import cut, threshold
from mograft.config import Config
from mograft.digest import (
    Digest,
    Facts,
    Keep,
    Refusal,
    Task,
    Terms,
    ask,
    digest,
    digest_all,
    edges,
    joined,
    origin_of,
    pack,
    same_rate,
    settle,
)
from mograft.embedding import CHUNK, Embedding, Packed, Samples, embed, features, normalise
from mograft.embedding import Source as SampleSource
from mograft.errors import MograftError
from mograft.groups import JointGroups
from mograft.mirroring import MirroredClips
from mograft.motion import Motion
from mograft.segmentation import Segments, segment
from mograft.skeleton import Skeleton
from mograft.sources import Found, Source, by_path, find, matching, named, way_to
from mograft.store import Entry, Place
from mograft.substitution import Candidates, Pool

if TYPE_CHECKING:
    from mograft.constraints import Constraint

__all__ = ["Library"]

Paths = str | PathLike[str] | Iterable[str | PathLike[str]]
Progress = Callable[[str, int, int], None]
Edges = Mapping[str, FloatArray]
Tags = Mapping[str, Iterable[str]]


@dataclass(frozen=True)
class PackedSamples:
    """Samples of all segments in memory, in single precision."""

    packed: Packed
    n_samples: int
    n_joints: int

    def __len__(self) -> int:
        return len(self.packed)

    def rows(self) -> Iterator[Packed]:
        """Yield `CHUNK` rows at a time."""
        for start in range(0, len(self), CHUNK):
            yield self.packed[start : start + CHUNK]

    def chunks(self, joints: IntArray) -> Iterator[Samples]:
        """Yield `CHUNK` segments at a time, with the rotations of some joints alone."""
        for rows in self.rows():
            yield Samples.unpack(rows, self.n_samples, self.n_joints, joints)


@dataclass(frozen=True, eq=False)
class Library:
    """Clips of one skeleton, cut into segments whose parts are compared and labelled.

    Made in memory by `Library.build`, in a folder by `Library.index`; `Library.open` opens
    one that is in a folder.

    Attributes
    ----------
    clips : sequence of Motion
        The clips; of one hierarchy and one frame rate, each with its own offsets. Of a
        library in a folder each is read when it is asked for.
    groups : JointGroups
        The joint groups.
    config : Config
        The configuration that it was built by.
    segments : Segments
        The segments of all clips, clip by clip in order of time.
    is_donor : ndarray of bool, shape (n_segments,)
        Whether a segment may take another's place: not where a fault was found in it.
    embedding : dict of str to Embedding or None
        For each group the segments as points; None where there was nothing to compare.
    labels : dict of str to ndarray of int, shape (n_segments,)
        For each group the cluster of each segment, counted from 0 by first member.
    sigma : dict of str to float
        For each group the greatest diameter of a cluster.
    root : int
        The joint that carries the body through the world.
    up : int
        The axis that points up: 0, 1 or 2.
    skeleton : Skeleton
        One whose joint names and hierarchy all clips have.
    rate : float
        Frames per second of all clips, but for how files round frame times.
    entries : tuple of Entry
        What is known of each clip besides its frames: name, file, own rate, faults, tags.
    edges : dict of str to dict of str to ndarray
        For each group the poses and velocities of its feature joints at the ends of the
        segments, as `Pool` has them.
    samples : source of Samples
        The segments as they are compared.
    refused : dict of str to str
        Files that were left out, and why.
    folder : Path or None
        Where the library is; None in memory.
    """

    clips: Sequence[Motion]
    groups: JointGroups
    config: Config
    segments: Segments
    is_donor: BoolArray
    embedding: Mapping[str, Embedding | None]
    labels: Mapping[str, IntArray]
    sigma: Mapping[str, float]
    root: int
    up: int
    skeleton: Skeleton
    rate: float
    entries: tuple[Entry, ...]
    edges: Mapping[str, Edges]
    samples: PackedSamples | store.StoredSamples
    refused: Mapping[str, str]
    folder: Path | None = None

    def __repr__(self) -> str:
        groups = ", ".join(
            f"{name} {labels.max() + 1} clusters" for name, labels in self.labels.items()
        )
        n = len(self.entries)
        clips = "1 clip" if n == 1 else f"{n} clips"
        return f"Library({clips}, {len(self.segments)} segments, {groups})"

    @classmethod
    def build(
        cls,
        sources: Source | Iterable[Source],
        groups: JointGroups | str = "lower_upper",
        config: Config | None = None,
        *,
        rate: float | None = None,
        frame_rates: Mapping[str, float] | None = None,
        tags: Tags | None = None,
        executor: Executor | None = None,
        progress: Progress | None = None,
        mirrored: bool = False,
    ) -> "Library":
        """Read, cut, compare and label clips, in memory.

        Parameters
        ----------
        sources : Motion, path, folder or glob, or several
            The clips; what a folder or glob holds is taken in order of name.
        groups : JointGroups or str
            The joint groups, or the name of a preset.
        config : Config, optional
            The configuration.
        rate : float, optional
            Frames per second. Default: the rate of most frames.
        frame_rates : mapping of str to float, optional
            The true frames per second of clips whose file gives a wrong rate, by name,
            file name or glob of these.
        tags : mapping of str to iterable of str, optional
            Words to choose clips by, by name, file name or glob of these. The folders between
            a source and a file are tags of its clip anyway.
        executor : concurrent.futures.Executor, optional
            Who reads, cuts and samples the clips, each by itself: a pool of threads or of
            processes, or ``dask.distributed.Client.get_executor()``; its workers must see
            the files. The library does not depend on it. Default: this thread.
        progress : callable, optional
            Called with a stage's name, what is done of it and the whole.
        mirrored : bool
            Whether the mirror images of all clips are added; see `mirrored`.

        Returns
        -------
        Library
            In memory.

        Raises
        ------
        BvhError
            If a file is no BVH motion.
        FileNotFoundError
            If a path, folder or glob holds no file.
        SkeletonMismatchError
            If the clips differ in joint names or hierarchy.
        ValueError
            If the groups do not fit the skeleton, or a clip has a single frame.

        Warns
        -----
        UserWarning
            Of clips of another frame rate, which are resampled to the commonest; of faults
            such as a T-pose first frame; of groups with nothing to compare.

        See Also
        --------
        Library.index : The same into a folder, in memory that does not grow with the clips.

        Examples
        --------
        >>> from mograft.dancer import dance
        >>> library = Library.build(dance(strides=1).motion)
        >>> sorted(library.labels)
        ['lower', 'upper']
        """
        config = Config() if config is None else config
        tell = progress or _say_nothing
        found = find(sources)
        slots = [_Slot.of((index, ()), own, frame_rates) for index, own in enumerate(found)]
        taken: list[Digest] = []
        shelf: list[Entry] = []

        def take(slot: _Slot, own: Digest) -> None:
            taken.append(own)
            shelf.append(slot.entered(own, tags))

        def forget() -> None:
            taken.clear()
            shelf.clear()

        digesting = _Digesting(config, rate, executor, tell, strict=True, refused={})
        terms = digesting.settled(slots, "motion", take, forget)
        names = named([own.name for own in taken])
        skeleton = terms.skeleton
        if isinstance(groups, str):
            groups = JointGroups.preset(groups, skeleton)
        entries = tuple(replace(own, name=name) for own, name in zip(shelf, names, strict=True))
        _warn(entries, terms.rate)
        clips = tuple(
            own.clip if own.clip.name == name else replace(own.clip, name=name)
            for own, name in zip(taken, names, strict=True)
            if isinstance(own.clip, Motion)
        )
        segments = joined([own.segments for own in taken])
        samples = PackedSamples(
            np.concatenate([own.samples for own in taken]), config.samples, skeleton.n_joints
        )
        members = _feature_joints(groups, skeleton)
        embedding = _embedded(samples, groups, terms, tell)
        labels, sigma = _clusters(embedding, len(segments), config)
        built = cls(
            clips,
            groups,
            config,
            segments,
            np.concatenate([own.is_donor for own in taken]),
            embedding,
            labels,
            sigma,
            terms.root,
            terms.up,
            skeleton,
            terms.rate,
            entries,
            {
                group: {
                    key: np.concatenate([own.edges[key][:, joints] for own in taken])
                    for key in taken[0].edges
                }
                for group, joints in members.items()
            },
            samples,
            {},
        )
        return built.mirrored() if mirrored else built

    @classmethod
    def index(
        cls,
        sources: Paths,
        path: str | PathLike[str],
        groups: JointGroups | str = "lower_upper",
        config: Config | None = None,
        *,
        rate: float | None = None,
        frame_rates: Mapping[str, float] | None = None,
        tags: Tags | None = None,
        strict: bool = False,
        force: bool = False,
        executor: Executor | None = None,
        progress: Progress | None = None,
    ) -> "Library":
        """Build a library in a folder, clip by clip.

        Parameters
        ----------
        sources : path, folder or glob, or several
            The files. Their order does not matter: clips stand in the order of their paths.
        path : path
            The folder to make.
        groups, config, rate, frame_rates, tags, executor, progress
            As for `build`.
        strict : bool
            Refuse clips that cannot be read or do not fit, as `build` does. By default they
            are left out, with a warning, and stand in `refused`.
        force : bool
            Take the place of a library that is there.

        Returns
        -------
        Library
            Opened. Until it is complete there is what was there before.

        Raises
        ------
        FileExistsError
            If there is a library already.
        LibraryError
            If something else is there, or another process is writing to it.
        ValueError
            If the groups do not fit the skeleton, or no clip can be used.
        BvhError, FileNotFoundError, SkeletonMismatchError
            As for `build`, where it is strict.

        Examples
        --------
        >>> from tempfile import TemporaryDirectory
        >>> from mograft import write_bvh
        >>> from mograft.dancer import dance
        >>> with TemporaryDirectory() as folder:
        ...     write_bvh(dance(strides=1).motion, f"{folder}/dance.bvh")
        ...     library = Library.index(folder, f"{folder}/dance.mograft")
        ...     library.entries[0].name, len(library.clips)
        ('dance', 1)
        """
        config = Config() if config is None else config
        with store.writing(Path(path), force=force) as draft:
            digesting = _Digesting(
                config, rate, executor, progress or _say_nothing, strict=strict, refused={}
            )
            _write(draft, None, find(sources), groups, digesting, frame_rates, tags)
        return cls.open(path)

    def add(
        self,
        sources: Paths,
        *,
        frame_rates: Mapping[str, float] | None = None,
        tags: Tags | None = None,
        strict: bool = False,
        executor: Executor | None = None,
        progress: Progress | None = None,
    ) -> "Library":
        """Add clips to a library in a folder.

        Parameters
        ----------
        sources : path, folder or glob, or several
            The files. Those that are in the library and have not changed since are not read.
        frame_rates, tags, strict, executor, progress
            As for `index`.

        Returns
        -------
        Library
            Opened, as `index` would have made it of all the files. This one stays as it was.

        Raises
        ------
        LibraryError
            If the folder was damaged, or another process is writing to it.
        ValueError
            If the library is in memory.
        BvhError, FileNotFoundError, SkeletonMismatchError
            As for `build`, where it is strict.

        Notes
        -----
        A file counts as unchanged if its size and time of writing are the same, or else its
        bytes. Files that are gone stay in the library.
        """
        if self.folder is None:
            raise ValueError("the library is in memory: save it first, or build it of all clips")
        with store.writing(self.folder, add=True) as draft:
            assert draft.base is not None  # as it was asked for
            # What is there now: another process may have added to it since this was opened.
            base = _opened(draft.base)
            rate = draft.base.manifest["given_rate"]
            tell = progress or _say_nothing
            digesting = _Digesting(base.config, rate, executor, tell, strict=strict, refused={})
            _write(draft, base, find(sources), base.groups, digesting, frame_rates, tags)
        return Library.open(self.folder)

    def save(self, path: str | PathLike[str], *, force: bool = False) -> None:
        """Write the library to a folder.

        Parameters
        ----------
        path : path
            The folder to make.
        force : bool
            Take the place of a library that is there.

        Raises
        ------
        FileExistsError
            If there is a library already.
        LibraryError
            If something else is there, or another process is writing to it.
        ValueError
            If a clip was put into the library by `extended`.

        Notes
        -----
        What `open` returns has the same numbers, bit for bit. Clips are written at the
        library's rate.
        """
        if len(self.samples) != len(self.segments):
            raise ValueError("a library that was extended by a base cannot be saved")
        with store.writing(Path(path), force=force) as draft:
            entries, places, row = [], [], 0
            counts = np.bincount(self.segments.clip, minlength=len(self.entries)).tolist()
            for index, entry in enumerate(self.entries):
                own = entry
                if isinstance(self.clips, store.StoredClips):
                    clip = self.clips.original(index, as_read=True)
                else:
                    clip = self.clips[index]
                    # At the library's rate: what it once was is not known any more.
                    own = replace(entry, rate=clip.rate, given_rate=None, own_frames=clip.n_frames)
                entries.append(own)
                places.append(draft.take_frames(pack(clip), row))
                row += counts[index]
            for rows in self.samples.rows():
                draft.take_samples(rows)
            _finish(draft, replace(self, entries=tuple(entries)), places, self.edges, None)

    @classmethod
    def open(cls, path: str | PathLike[str]) -> "Library":
        """Open a library that is in a folder, to read from.

        Parameters
        ----------
        path : path
            The folder.

        Returns
        -------
        Library
            Of its arrays only those parts are read that are asked for. It stays as it is
            when another process adds to the folder.

        Raises
        ------
        LibraryError
            If it is damaged, foreign or was made by a newer mograft; says what to do.
        FileNotFoundError
            If there is nothing of that name.
        """
        return _opened(store.read(Path(path)))

    @property
    def tags(self) -> tuple[frozenset[str], ...]:
        """The tags of each clip."""
        return tuple(frozenset(entry.tags) for entry in self.entries)

    def file_name(self, clip: int) -> str | None:
        """Return the name of the file that a clip was read from, if it was and that is known."""
        origin = self.entries[clip].origin
        if origin is not None:
            return Path(origin.path).name
        if isinstance(self.clips, store.StoredClips):
            return None
        path = self.clips[clip].path
        return None if path is None else path.name

    def joints(self, group: str) -> IntArray:
        """Return the joints of a group, ascending."""
        members = self.groups.resolve(self.skeleton)
        if group not in members:
            raise ValueError(f"group must be one of {', '.join(members)}, got {group!r}")
        return members[group]

    def pool(self, group: str) -> Pool:
        """Return the segments as the search for one group's donors sees them."""
        if group not in self.edges:
            raise ValueError(f"group must be one of {', '.join(self.edges)}, got {group!r}")
        base = self.groups.base
        compared = self.embedding[base]
        held, joints = self.groups.held(self.skeleton), self.joints(group)
        ends = ends_alone(self.edges[group], joints, self.skeleton, held[group])
        return Pool(
            self.segments,
            self.labels[base],
            self.is_donor,
            rate=self.rate,
            points=None if compared is None else compared.points,
            sigma=self.sigma[base],
            **ends,
        )

    def candidates(
        self, segment: int, group: str, constraints: Sequence["Constraint"] = ()
    ) -> Candidates:
        """Return which segments may lend one their part of a group, and why others may not.

        Parameters
        ----------
        segment : int
            Index of the base segment.
        group : str
            The group to graft.
        constraints : sequence of Constraint, optional
            What a motion on the segment's clip must do; hard ones refuse donors that miss
            them as they are, put in the segment's place.

        Returns
        -------
        Candidates
            All members of the base segment's cluster, with what they cost.

        Raises
        ------
        ValueError
            If there is no such segment or group, or the group is the base.
        """
        if not 0 <= segment < len(self.segments):
            raise ValueError(f"segment must be 0 to {len(self.segments) - 1}, got {segment}")
        if group == self.groups.base:
            raise ValueError(f"group must not be the base group, {group!r}, which is kept")
        pool = self.pool(group)
        judged = pool.judge(segment, pool.points, self.config)
        if not constraints:
            return judged
        from mograft.planning import reasons  # which stands on this module

        return reasons(self, segment, group, judged, constraints)

    def relabelled(self, config: Config) -> "Library":
        """Return the library clustered anew, and used by, another configuration.

        Parameters
        ----------
        config : Config
            What it says of segments and embedding must be what the library was built by.

        Returns
        -------
        Library
            With labels by the configuration's `sigma` and `sigma_scale`.

        Raises
        ------
        ValueError
            If another field that segments or embedding depend on differs; names it.
        """
        for name in _BUILT_BY:
            if getattr(config, name) != getattr(self.config, name):
                raise ValueError(
                    f"{name} must be {getattr(self.config, name)!r}, as the library was built by; "
                    f"got {getattr(config, name)!r}"
                )
        if (config.sigma, config.sigma_scale) == (self.config.sigma, self.config.sigma_scale):
            return replace(self, config=config)
        labels, sigma = _clusters(self.embedding, len(self.segments), config)
        return replace(self, config=config, labels=labels, sigma=sigma)

    def mirrored(self) -> "Library":
        """Return the library with the mirror image of every clip behind its clips.

        What the left did, the right does: twice as many donors to choose from, clustered anew.

        Returns
        -------
        Library
            In memory; each mirror image is called as its clip, with ``_mirrored``.

        Raises
        ------
        ValueError
            If the skeleton's joints have no partners; see `mograft.mirror`.
        """
        n = len(self.entries)
        names = named(
            [*(e.name for e in self.entries), *(f"{e.name}_mirrored" for e in self.entries)]
        )
        clips = MirroredClips(self.clips, tuple(names))
        rows, ends = [*self.samples.rows()], []
        for index in range(n):
            clip, own = clips[n + index], self.segments.of_clip(index)
            cut = Segments(self.segments.start[own], self.segments.stop[own])
            sampled = normalise(
                [clip],
                cut,
                self.config,
                root=self.root,
                up=self.up,
                heights=[body(clip.skeleton).height],
            )
            rows.append(sampled.packed())
            ends.append(edges(clip, cut))
        samples = PackedSamples(np.concatenate(rows), self.config.samples, self.skeleton.n_joints)
        terms = Terms(self.skeleton, self.rate, self.root, self.up, self.config)
        embedding = _embedded(samples, self.groups, terms, _say_nothing)
        labels, sigma = _clusters(embedding, 2 * len(self.segments), self.config)
        twice = replace(self.segments, clip=self.segments.clip + n)
        return replace(
            self,
            clips=clips,
            segments=Segments(
                *(
                    np.concatenate([getattr(cut, part) for cut in (self.segments, twice)])
                    for part in ("start", "stop", "clip")
                )
            ),
            is_donor=np.concatenate([self.is_donor, self.is_donor]),
            embedding=embedding,
            labels=labels,
            sigma=sigma,
            entries=tuple(
                replace(e, name=name)
                for e, name in zip(self.entries + self.entries, names, strict=True)
            ),
            edges={
                group: {
                    key: np.concatenate([known, *(own[key][:, joints] for own in ends)])
                    for key, known in self.edges[group].items()
                }
                for group, joints in _feature_joints(self.groups, self.skeleton).items()
            },
            samples=samples,
            folder=None,
        )

    def holding(self, base: Motion | str | None) -> tuple["Library", int]:
        """Return a library that holds a motion, and which of its clips that is.

        Parameters
        ----------
        base : Motion or str, optional
            A motion, or the name of a clip. Default: the first clip.

        Returns
        -------
        library : Library
            This one, or where the motion is not in it the one of `extended`.
        index : int
            The index of the clip.

        Raises
        ------
        SkeletonMismatchError
            If the motion's hierarchy differs.
        ValueError
            If no clip has the name.
        """
        if base is None:
            return self, 0
        if isinstance(base, str):
            names = [entry.name for entry in self.entries]
            if base not in names:
                raise ValueError(f"base must be a clip, one of {', '.join(names)}; got {base!r}")
            return self, names.index(base)
        self.skeleton.check_same_hierarchy(base.skeleton, base.name or "the base")
        for index, entry in enumerate(self.entries):
            if entry.n_frames != base.n_frames:
                continue
            clip = self.clips[index]
            if base is clip or (
                np.array_equal(base.rotations, clip.rotations)
                and np.array_equal(base.positions, clip.positions)
            ):
                return self, index
        return self.extended(base), len(self.entries)

    def extended(self, motion: Motion) -> "Library":
        """Return the library with one more clip, whose segments lend nothing to others.

        The new segments are put where they belong among the clusters that are there: into
        one whose members are all within the greatest diameter, that of the nearest member if
        there are several, else into one of their own. Nothing else changes.

        Parameters
        ----------
        motion : Motion
            Of the library's hierarchy; resampled, with a warning, to its frame rate.

        Returns
        -------
        Library
            Its last clip is the motion.

        Raises
        ------
        SkeletonMismatchError
            If the hierarchy differs.
        """
        name = motion.name or "the base"
        self.skeleton.check_same_hierarchy(motion.skeleton, name)
        if not same_rate(motion.rate, self.rate):
            warnings.warn(
                f"{name} is resampled from {motion.rate:.6g} to the library's {self.rate:.6g} fps",
                stacklevel=2,
            )
            motion = motion.resample(self.rate)
        own = segment(motion, self.config)
        height = body(motion.skeleton).height
        samples = normalise(
            [motion], own, self.config, root=self.root, up=self.up, heights=[height]
        )
        m, n_joints = self.config.samples, motion.n_joints
        samples = Samples.unpack(samples.packed(), m, n_joints)
        ends = edges(motion, own)
        held = self.groups.held(self.skeleton)
        embedding = {
            group: None
            if seen is None
            else _with_points(seen, samples_alone(samples, self.skeleton, held[group]))
            for group, seen in self.embedding.items()
        }
        labels = {
            group: np.concatenate(
                [known, _nearest_cluster(embedding[group], known, len(own), self.sigma[group])]
            )
            for group, known in self.labels.items()
        }
        cuts = [self.segments, replace(own, clip=np.full(len(own), len(self.entries)))]
        return replace(
            self,
            clips=store.LongerClips(self.clips, motion),
            segments=Segments(
                *(np.concatenate([getattr(c, f) for c in cuts]) for f in ("start", "stop", "clip"))
            ),
            is_donor=np.concatenate([self.is_donor, np.zeros(len(own), bool)]),
            embedding=embedding,
            labels=labels,
            entries=(*self.entries, _entry_of(motion, motion.name)),
            edges={
                group: {
                    key: np.concatenate([known, ends[key][:, joints]])
                    for key, known in self.edges[group].items()
                }
                for group, joints in _feature_joints(self.groups, self.skeleton).items()
            },
        )


_BUILT_BY = (
    "smoothing",
    "min_length",
    "max_length",
    "omega",
    "inertia",
    "samples",
    "components",
    "keep_heading",
    "rotation_floor",
    "position_floor",
    "length_floor",
)


def _clusters(
    embedding: Mapping[str, Embedding | None], n_segments: int, config: Config
) -> tuple[dict[str, IntArray], dict[str, float]]:
    """Return each group's labels and the diameter that they were cut at."""
    labels: dict[str, IntArray] = {}
    sigma: dict[str, float] = {}
    for group, own in embedding.items():
        if own is None:
            labels[group], sigma[group] = np.arange(n_segments), 0.0
        else:
            sigma[group] = threshold(own.points, config.sigma, config.sigma_scale)
            labels[group] = cut(own.points, sigma[group])
    return labels, sigma


def _say_nothing(*_: object) -> None:
    pass


def _never_mind() -> None:
    pass


Key = tuple[int, tuple[str, ...]]


@dataclass(frozen=True, eq=False)
class _Slot:
    """A clip that is to be digested, and where it stands among the others.

    It is either found anew or one of the generation before.
    """

    key: Key
    found: Found | None
    given_rate: float | None
    entry: Entry | None = None

    @classmethod
    def of(cls, key: Key, found: Found, frame_rates: Mapping[str, float] | None) -> "_Slot":
        rates = matching(frame_rates, found.keys)
        if rates and not 0 < rates[-1] < float("inf"):
            raise ValueError(f"frame_rates must be above 0 frames per second, got {rates[-1]}")
        return cls(key, found, float(rates[-1]) if rates else None)

    def task(self) -> Task:
        if self.found is None:
            raise RuntimeError("clips of the generation before are read from there")
        source = self.found.source
        where = os.path.abspath(source) if isinstance(source, str) else source
        return Task(where, self.given_rate)

    def entered(self, own: Digest, tags: Tags | None) -> Entry:
        """Return what is known of the clip, now that it is digested; its name is not yet."""
        if self.entry is not None:
            return replace(self.entry, n_frames=own.n_frames, faults=own.faults)
        words = list(self.found.folders) if self.found is not None else []
        for more in matching(tags, self.found.keys if self.found is not None else ()):
            words += more
        return _entry(own, self.given_rate, tuple(dict.fromkeys(words)))


@dataclass(frozen=True, eq=False)
class _Digesting:
    """How clips are digested; collects what was refused."""

    config: Config
    rate: float | None
    executor: Executor | None
    tell: Progress
    strict: bool
    refused: dict[str, Exception]

    def settled(
        self,
        slots: Sequence[_Slot],
        keep: Keep,
        take: Callable[[_Slot, Digest], object],
        forget: Callable[[], object] = _never_mind,
    ) -> Terms:
        """Digest clips by terms that are guessed; again, if they turn out to be others."""
        tasks, terms = self._guess([slot.task() for slot in slots])
        while True:
            facts = self.once(slots, tasks, keep, take, terms)
            settled = settle(in_order(facts), self.config, self.rate)
            if settled.agrees(terms):
                self.check_refused()
                return terms
            forget()
            terms = settled

    def once(
        self,
        slots: Sequence[_Slot],
        tasks: Iterable[Task],
        keep: Keep,
        take: Callable[[_Slot, Digest], object],
        terms: Terms,
    ) -> list[tuple[Key, Facts]]:
        """Digest clips by some terms; return what they say of themselves."""
        facts: list[tuple[Key, Facts]] = []
        self.refused.clear()
        outcomes = digest_all(tasks, terms, keep, self.executor)
        for done, (slot, outcome) in enumerate(zip(slots, outcomes, strict=True)):
            self.tell("reading", done + 1, len(slots))
            if outcome.facts is not None:
                facts.append((slot.key, outcome.facts))
            if isinstance(outcome, Digest):
                take(slot, outcome)
                continue
            self.refused[outcome.what] = outcome.error
            if outcome.facts is None and self.strict:
                raise outcome.error
        return facts

    def check_refused(self) -> None:
        """Raise the first refusal, where clips that do not fit are not left out."""
        for error in self.refused.values():
            if self.strict:
                raise error

    def reasons(self) -> dict[str, str]:
        """Return the clips that were left out, and why."""
        return {what: str(error) for what, error in self.refused.items()}

    def _guess(self, tasks: list[Task]) -> tuple[list[Task], Terms]:
        """Ask a few clips spread over all what the terms may be; each is read but once."""
        spread = np.unique(np.linspace(0, len(tasks) - 1, 9).round().astype(int)).tolist()
        facts: list[Facts] = []
        for index in [*spread, *range(len(tasks))]:
            if facts and index not in spread:
                break
            try:
                tasks[index], found = ask(tasks[index])
            except (MograftError, OSError, ValueError):
                continue  # it will be refused, with the others of its kind
            facts.append(found)
        if not facts:
            refusal = digest(tasks[0], None, "numbers")
            if not isinstance(refusal, Refusal):
                raise RuntimeError("a clip was read that could not be read")
            if self.strict:
                raise refusal.error
            raise ValueError(f"no clip can be used: {refusal.error}") from refusal.error
        return tasks, settle(facts, self.config, self.rate)


def in_order(facts: Sequence[tuple[Key, Facts]]) -> list[Facts]:
    """Return facts in the order of their clips."""
    return [own for _, own in sorted(facts, key=lambda pair: pair[0])]


def _entry_of(motion: Motion, name: str) -> Entry:
    """Return what is known of a motion that is its own entry."""
    facts = Facts.of(motion)
    return Entry(
        name,
        motion.name,
        None,
        facts.rate,
        None,
        facts.n_frames,
        facts.n_frames,
        facts.root,
        facts.up,
        (),
        (),
    )


def _entry(own: Digest, given_rate: float | None, tags: tuple[str, ...]) -> Entry:
    return Entry(
        own.name,
        own.name,
        own.origin,
        own.facts.rate,
        given_rate,
        own.facts.n_frames,
        own.n_frames,
        own.facts.root,
        own.facts.up,
        own.faults,
        tags,
    )


_MOST_WARNINGS = 8


def _warn(entries: Sequence[Entry], rate: float) -> None:
    """Warn of clips that were resampled and of those with faults."""
    others = [entry.name for entry in entries if not same_rate(entry.rate, rate)]
    if others:
        more = len(others) - _MOST_WARNINGS
        listed = ", ".join(others[:_MOST_WARNINGS]) + (f" and {more} more" if more > 0 else "")
        warnings.warn(
            f"resampled to {rate:.6g} fps, the rate of most frames: {listed}", stacklevel=3
        )
    faulty = [entry for entry in entries if entry.faults]
    for entry in faulty[:_MOST_WARNINGS]:
        more = len(entry.faults) - 3
        rest = f"; and {more} more" if more > 0 else ""
        warnings.warn(
            f"{entry.name}: {'; '.join(entry.faults[:3])}{rest}. "
            "These frames lend nothing to others",
            stacklevel=3,
        )
    if len(faulty) > _MOST_WARNINGS:
        warnings.warn(
            f"faults in {len(faulty) - _MOST_WARNINGS} more clips; their frames lend nothing "
            "to others either",
            stacklevel=3,
        )


def _feature_joints(groups: JointGroups, skeleton: Skeleton) -> dict[str, IntArray]:
    members = groups.resolve(skeleton)
    return {name: feature_joints(skeleton, joints) for name, joints in members.items()}


def _embedded(
    samples: SampleSource, groups: JointGroups, terms: Terms, tell: Progress
) -> dict[str, Embedding | None]:
    embedding: dict[str, Embedding | None] = {}
    members, held = groups.resolve(terms.skeleton), groups.held(terms.skeleton)
    for index, (name, joints) in enumerate(members.items()):
        tell("comparing", index, len(members))
        counted = feature_joints(terms.skeleton, joints)
        if terms.root in joints:
            counted = np.union1d(counted, [terms.root])
        if terms.root in held[name]:
            raise ValueError(
                f"group {name!r}: {terms.skeleton.names[terms.root]} must be held whole: it "
                "carries the body"
            )
        source = HeldSamples(samples, terms.skeleton, held[name]) if held[name] else samples
        embedding[name] = embed(source, counted, terms.config, root=terms.root, group=name)
    tell("comparing", len(members), len(members))
    return embedding


# Libraries in folders.


@dataclass(frozen=True, eq=False)
class _Shelved:
    """A clip of the generation that is written.

    `row` is the first of its segments among those of the generation before, or among those
    that were taken afresh.
    """

    key: Key
    entry: Entry
    place: Place
    segments: Segments
    is_donor: BoolArray
    row: int
    is_fresh: bool


def _write(
    draft: store.Draft,
    base: Library | None,
    found: Sequence[Found],
    groups: JointGroups | str,
    digesting: _Digesting,
    frame_rates: Mapping[str, float] | None,
    tags: Tags | None,
) -> None:
    """Write a library of files, and of what the generation before has of others."""
    slots = [
        _Slot.of((0, way), own, frame_rates) for way, own in by_path(found, draft.final).items()
    ]
    fresh: list[_Shelved] = []

    def take(slot: _Slot, own: Digest) -> None:
        place, entry = draft.take(own), slot.entered(own, tags)
        fresh.append(
            _Shelved(slot.key, entry, place, own.segments, own.is_donor, place.row, is_fresh=True)
        )

    def forget() -> None:
        fresh.clear()
        draft.restart()

    kept: list[_Shelved] = []
    if base is None:
        terms = digesting.settled(slots, "numbers", take, forget)
    else:
        there = {own.origin.path: own for own in base.entries if own.origin is not None}
        slots = [slot for slot in slots if _is_new(slot, there)]
        if not slots and not tags:
            return
        kept = _kept(base, slots, tags)
        terms = Terms(base.skeleton, base.rate, base.root, base.up, base.config)
        draft.go_on()
        facts = [(own.key, own.entry.facts(base.skeleton)) for own in kept]
        new = digesting.once(slots, map(_Slot.task, slots), "numbers", take, terms)
        facts += [(key, own) for key, own in new if own.same_hierarchy(base.skeleton)]
        # A clip that is not what it was and does not fit any more is left out, unless no
        # other is left.
        settled = settle(in_order(facts), base.config, digesting.rate) if facts else terms
        if not settled.agrees(terms) or draft.is_scattered([own.place for own in kept]):
            # What clips have in common has changed: all are digested anew, the ones that are
            # here from what is here.
            forget()
            terms = settled
            slots = [_Slot(own.key, None, own.entry.given_rate, own.entry) for own in kept] + slots
            tasks = chain(_tasks_of(base, kept), map(_Slot.task, slots[len(kept) :]))
            kept = []
            digesting.once(slots, tasks, "numbers", take, terms)
        digesting.check_refused()

    if not kept and not fresh:
        why = next(iter(digesting.reasons().values()))
        raise ValueError(f"no clip can be used: {why}")
    shelved = sorted([*kept, *fresh], key=lambda own: own.key)
    names = named([own.entry.own_name for own in shelved])
    entries = tuple(replace(own.entry, name=name) for own, name in zip(shelved, names, strict=True))
    segments = joined([own.segments for own in shelved])
    places = [own.place for own in shelved]
    extents = [(own.place.shard, own.place.row, len(own.segments)) for own in shelved]
    samples = draft.samples(extents, terms.config.samples, terms.skeleton.n_joints)
    if isinstance(groups, str):
        groups = JointGroups.preset(groups, terms.skeleton)
    _warn(entries, terms.rate)
    embedding = _embedded(samples, groups, terms, digesting.tell)
    digesting.tell("clustering", 0, 1)
    labels, sigma = _clusters(embedding, len(segments), terms.config)
    digesting.tell("clustering", 1, 1)
    refused = {**(base.refused if base is not None else {}), **digesting.reasons()}
    library = Library(
        (),
        groups,
        terms.config,
        segments,
        np.concatenate([own.is_donor for own in shelved]),
        embedding,
        labels,
        sigma,
        terms.root,
        terms.up,
        terms.skeleton,
        terms.rate,
        entries,
        {},
        samples,
        refused,
    )
    _finish(draft, library, places, _edge_pieces(draft, base, shelved, library), digesting.rate)


def _is_new(slot: _Slot, there: Mapping[str, Entry]) -> bool:
    """Tell whether a file is not in a library as it is now."""
    path = os.path.abspath(str(slot.found.source)) if slot.found is not None else ""
    entry = there.get(path)
    if entry is None or entry.origin is None:
        return True
    if slot.given_rate is not None and slot.given_rate != entry.given_rate:
        return True
    try:
        now = os.stat(path)
        if (now.st_size, now.st_mtime_ns) == (entry.origin.size, entry.origin.mtime_ns):
            return False
        return origin_of(path).sha256 != entry.origin.sha256
    except OSError:
        return True  # reading it will say why


def _kept(base: Library, slots: Sequence[_Slot], tags: Tags | None) -> list[_Shelved]:
    """Return the clips of a library that no new ones take the place of."""
    if base.folder is None or not isinstance(base.clips, store.StoredClips):
        raise TypeError("the base must be a stored library")
    anew = {slot.key for slot in slots}
    bounds = np.searchsorted(base.segments.clip, np.arange(len(base.entries) + 1)).tolist()
    kept = []
    for index, (entry, place) in enumerate(zip(base.entries, base.clips.places, strict=True)):
        key: Key = (1, (f"{index:09}",))
        own = entry
        if entry.origin is not None:
            key = (0, way_to(entry.origin.path, base.folder))
            found = Found(entry.origin.path)
            words = [word for more in matching(tags, found.keys) for word in more]
            own = replace(entry, tags=tuple(dict.fromkeys([*entry.tags, *words])))
        if key in anew:
            continue
        first, stop = bounds[index], bounds[index + 1]
        cut = Segments(base.segments.start[first:stop], base.segments.stop[first:stop])
        is_donor = base.is_donor[first:stop]
        kept.append(_Shelved(key, own, place, cut, is_donor, first, is_fresh=False))
    return kept


def _tasks_of(base: Library, kept: Sequence[_Shelved]) -> Iterator[Task]:
    """Yield clips of a library to be digested anew, each read when it is its turn."""
    if not isinstance(base.clips, store.StoredClips):
        raise TypeError("the base must be a stored library")
    at = {place: index for index, place in enumerate(base.clips.places)}
    for own in kept:
        clip = base.clips.original(at[own.place], as_read=True)
        yield Task(clip, own.entry.given_rate, own.entry.origin)


def _edge_pieces(
    draft: store.Draft, base: Library | None, shelved: Sequence[_Shelved], library: Library
) -> dict[str, dict[str, Iterator[FloatArray]]]:
    """Return the edges of each group, a piece at a time, in the order of segments."""
    runs = store.merged([(int(own.is_fresh), own.row, len(own.segments)) for own in shelved])

    def pieces(group: str, key: str, joints: IntArray) -> Iterator[FloatArray]:
        for is_fresh, first, n in runs:
            for start in range(first, first + n, CHUNK):
                stop = min(start + CHUNK, first + n)
                if is_fresh:
                    yield draft.fresh_edges(key, start, stop)[:, joints]
                elif base is not None:
                    yield base.edges[group][key][start:stop]

    keys = tuple(draft.edge_keys() if base is None else next(iter(base.edges.values())))
    return {
        group: {key: pieces(group, key, joints) for key in keys}
        for group, joints in _feature_joints(library.groups, library.skeleton).items()
    }


def _finish(
    draft: store.Draft,
    library: Library,
    places: Sequence[Place],
    ends: Mapping[str, Mapping[str, FloatArray | Iterator[FloatArray]]],
    given_rate: float | None,
) -> None:
    """Write all but frames and samples, and commit."""
    segments = library.segments
    for name in ("start", "stop", "clip"):
        draft.write_array(f"{name}s", "<i8", getattr(segments, name))
    draft.write_array("donors", "|b1", library.is_donor)
    about: dict[str, Any] = {}
    for number, group in enumerate(library.groups.names):
        own = library.embedding[group]
        draft.write_array(f"{number}/labels", "<i8", library.labels[group])
        for key, pieces in ends[group].items():
            draft.write_array(f"{number}/{key}", "<f8", pieces)
        about[group] = {
            "folder": str(number),
            "sigma": library.sigma[group],
            "compared": own is not None,
            "has_root": own is not None and own.has_root,
            "clusters": int(library.labels[group].max(initial=-1)) + 1,
        }
        if own is not None:
            draft.write_array(f"{number}/joints", "<i8", own.joints)
            for name in _EMBEDDED:
                draft.write_array(f"{number}/{name}", "<f8", getattr(own, name))
    columns = (segments.clip, segments.start, segments.stop, library.is_donor.astype(np.int64))
    table = np.stack(columns, axis=1)
    draft.write_catalogue(library.entries, places, library.refused, table, library.labels)
    draft.commit(
        {
            "config": library.config.as_dict(),
            "groups": library.groups.to_toml(),
            "group": about,
            "skeleton": store.skeleton_fields(library.skeleton),
            "rate": library.rate,
            "given_rate": given_rate,
            "root": library.root,
            "up": library.up,
            "clips": len(library.entries),
            "frames": sum(entry.n_frames for entry in library.entries),
            "segments": len(segments),
        }
    )


_EMBEDDED = ("points", "reference", "mean", "scale", "components", "variances")


def _opened(contents: store.Contents) -> Library:
    about, arrays = contents.manifest, contents.arrays
    config, groups = Config.from_dict(about["config"]), JointGroups.from_toml(about["groups"])
    embedding: dict[str, Embedding | None] = {}
    labels, ends = {}, {}
    for group, own in about["group"].items():
        inside = {
            key.removeprefix(own["folder"] + "/"): array
            for key, array in arrays.items()
            if key.startswith(own["folder"] + "/")
        }
        labels[group] = inside.pop("labels")
        embedding[group] = None
        if own["compared"]:
            joints = np.array(inside.pop("joints"))
            parts = [inside.pop(name) for name in _EMBEDDED]
            embedding[group] = Embedding(parts[0], joints, own["has_root"], *parts[1:])
        ends[group] = inside
    frames = [arrays[f"frames-{shard}"] for shard in about["shards"]]
    clips = store.StoredClips(
        contents.entries, contents.places, contents.skeletons, frames, about["rate"]
    )
    return Library(
        clips,
        groups,
        config,
        Segments(arrays["starts"], arrays["stops"], arrays["clips"]),
        arrays["donors"],
        embedding,
        labels,
        {group: own["sigma"] for group, own in about["group"].items()},
        about["root"],
        about["up"],
        store.skeleton_of(about["skeleton"]),
        about["rate"],
        contents.entries,
        ends,
        contents.samples(),
        contents.refused,
        contents.folder,
    )


def _with_points(embedding: Embedding, samples: Samples) -> Embedding:
    """Return the embedding with new segments projected into it, behind those that are there."""
    matrix = features(samples, embedding.joints, embedding.reference, has_root=embedding.has_root)
    return replace(embedding, points=np.concatenate([embedding.points, embedding.project(matrix)]))


def _nearest_cluster(
    embedding: Embedding | None, labels: IntArray, n_new: int, sigma: float
) -> IntArray:
    """Return the cluster of each new segment: one that stays within the diameter, or a new one."""
    fresh: IntArray = labels.max(initial=-1) + 1 + np.arange(n_new)
    if embedding is None:
        return fresh
    known, points = embedding.points[:-n_new], embedding.points[-n_new:]
    order = np.argsort(labels, kind="stable")
    starts = np.flatnonzero(np.diff(labels[order], prepend=-1))
    chosen = fresh.copy()
    for index, point in enumerate(points):
        distances = np.linalg.norm(known[order] - point, axis=1)
        fits = np.maximum.reduceat(distances, starts) <= sigma
        if fits.any():
            nearest = np.where(fits, np.minimum.reduceat(distances, starts), np.inf)
            chosen[index] = labels[order][starts[int(nearest.argmin())]]
    return chosen
