"""Clips cut, compared and labelled: what donors are chosen from."""

import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray, IntArray
from mograft._util.validate import check_type, is_integer
from mograft.analysis.channel_groups import ends_alone, samples_alone
from mograft.analysis.clustering import cut, threshold
from mograft.analysis.embedding import Embedding, Samples, features, normalise
from mograft.analysis.segmentation import Segments, segment
from mograft.body.anatomy import feature_joints
from mograft.body.groups import JointGroups
from mograft.body.mass import mass_model
from mograft.config import Config
from mograft.errors import join_names
from mograft.library import storage as store
from mograft.library.clip_table import ClipInfo, ClipLocation, skeleton_fields, skeleton_of
from mograft.library.discover import ClipSource, find_clips
from mograft.library.ingest import ClipProperties, boundary_states, pack, rates_match
from mograft.motion.motion import Motion
from mograft.motion.skeleton import Skeleton
from mograft.search.candidates import Candidates, SegmentPool

if TYPE_CHECKING:
    from mograft.search.constraints import Constraint

__all__ = ["Library"]

Paths = str | PathLike[str] | Iterable[str | PathLike[str]]
Progress = Callable[[str, int, int], None]
BoundaryStates = Mapping[str, FloatArray]
Tags = Mapping[str, Iterable[str]]


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
        segments, as `SegmentPool` has them.
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
    entries: tuple[ClipInfo, ...]
    boundary_states: Mapping[str, BoundaryStates]
    samples: Samples | store.StoredSamples
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
        sources: ClipSource | Iterable[ClipSource],
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
        from mograft.library.indexing import build  # which stands on this module

        built = build(sources, groups, config, rate, frame_rates, tags, executor, progress)
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
        from mograft.library.indexing import IngestRun, write  # which stand on this module

        digesting = IngestRun.of(config, rate, executor, progress, strict=strict)
        with store.write_generation(Path(path), force=force) as draft:
            write(draft, None, find_clips(sources), groups, digesting, frame_rates, tags)
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
        from mograft.library.indexing import IngestRun, write  # which stand on this module

        with store.write_generation(self.folder, add=True) as draft:
            assert draft.base is not None  # as it was asked for
            # What is there now: another process may have added to it since this was opened.
            base = from_stored(draft.base)
            rate = draft.base.manifest["given_rate"]
            digesting = IngestRun.of(base.config, rate, executor, progress, strict=strict)
            write(draft, base, find_clips(sources), base.groups, digesting, frame_rates, tags)
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
            If a clip was put into the library by `with_clip`.

        Notes
        -----
        What `open` returns has the same numbers, bit for bit. Clips are written at the
        library's rate.
        """
        if len(self.samples) != len(self.segments):
            raise ValueError("a library that was extended by a base cannot be saved")
        with store.write_generation(Path(path), force=force) as draft:
            entries, places, row = [], [], 0
            counts = np.bincount(self.segments.clip, minlength=len(self.entries)).tolist()
            for index, entry in enumerate(self.entries):
                own = entry
                if isinstance(self.clips, store.StoredClips):
                    clip = self.clips.original(index, as_read=True)
                else:
                    clip = self.clips[index]
                    # At the library's rate: what it once was is not known any more.
                    own = replace(
                        entry,
                        source_rate=clip.rate,
                        rate_override=None,
                        source_frames=clip.n_frames,
                    )
                entries.append(own)
                places.append(draft.take_frames(pack(clip), row))
                row += counts[index]
            for chunk in self.samples.chunks():
                draft.take_samples(chunk.packed())
            write_and_commit(
                draft, replace(self, entries=tuple(entries)), places, self.boundary_states, None
            )

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
        return from_stored(store.read(Path(path)))

    @property
    def tags(self) -> tuple[frozenset[str], ...]:
        """The tags of each clip."""
        return tuple(frozenset(entry.tags) for entry in self.entries)

    def file_name(self, clip: int) -> str | None:
        """Return the name of the file that a clip was read from, if it was and that is known."""
        origin = self.entries[clip].source_file
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

    def pool(self, group: str) -> SegmentPool:
        """Return the segments as the search for one group's donors sees them."""
        if group not in self.boundary_states:
            raise ValueError(
                f"group must be one of {', '.join(self.boundary_states)}, got {group!r}"
            )
        base = self.groups.base
        compared = self.embedding[base]
        held, joints = self.groups.divided_channels(self.skeleton), self.joints(group)
        ends = ends_alone(self.boundary_states[group], joints, self.skeleton, held[group])
        return SegmentPool(
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
        if not is_integer(segment) or not 0 <= segment < len(self.segments):
            raise ValueError(f"segment must be 0 to {len(self.segments) - 1}, got {segment}")
        if group == self.groups.base:
            raise ValueError(f"group must not be the base group, {group!r}, which is kept")
        pool = self.pool(group)
        judged = pool.judge(segment, pool.points, self.config)
        if not constraints:
            return judged
        from mograft.synthesis.search_problem import reasons  # layer exception: judged in place

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
        labels, sigma = cluster_groups(self.embedding, len(self.segments), config)
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
        from mograft.library.indexing import mirror_library  # which stands on this module

        return mirror_library(self)

    def resolve_base(self, base: Motion | str | None) -> tuple["Library", int]:
        """Return a library that holds a motion, and which of its clips that is.

        Parameters
        ----------
        base : Motion or str, optional
            A motion, or the name of a clip. Default: the first clip.

        Returns
        -------
        library : Library
            This one, or where the motion is not in it the one of `with_clip`.
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
                raise ValueError(f"base must be a clip, one of {join_names(names)}; got {base!r}")
            return self, names.index(base)
        check_type("base", base, Motion)
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
        return self.with_clip(base), len(self.entries)

    def with_clip(self, motion: Motion) -> "Library":
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
        if not rates_match(motion.rate, self.rate):
            warnings.warn(
                f"{name} is resampled from {motion.rate:.6g} to the library's {self.rate:.6g} fps",
                stacklevel=2,
            )
            motion = motion.resample(self.rate)
        own = segment(motion, self.config)
        height = mass_model(motion.skeleton).height
        samples = normalise(
            [motion], own, self.config, root=self.root, up=self.up, heights=[height]
        )
        samples = replace(samples, rows=samples.packed())
        ends = boundary_states(motion, own)
        held = self.groups.divided_channels(self.skeleton)
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
            clips=store.ExtendedClips(self.clips, motion),
            segments=Segments(
                *(np.concatenate([getattr(c, f) for c in cuts]) for f in ("start", "stop", "clip"))
            ),
            is_donor=np.concatenate([self.is_donor, np.zeros(len(own), bool)]),
            embedding=embedding,
            labels=labels,
            entries=(*self.entries, _entry_of(motion, motion.name)),
            boundary_states={
                group: {
                    key: np.concatenate([known, ends[key][:, joints]])
                    for key, known in self.boundary_states[group].items()
                }
                for group, joints in feature_joints_by_group(self.groups, self.skeleton).items()
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


def cluster_groups(
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


def _entry_of(motion: Motion, name: str) -> ClipInfo:
    """Return what is known of a motion that is its own entry."""
    facts = ClipProperties.of(motion)
    return ClipInfo(
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


def feature_joints_by_group(groups: JointGroups, skeleton: Skeleton) -> dict[str, IntArray]:
    members = groups.resolve(skeleton)
    return {name: feature_joints(skeleton, joints) for name, joints in members.items()}


def write_and_commit(
    draft: store.GenerationWriter,
    library: Library,
    places: Sequence[ClipLocation],
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
            "skeleton": skeleton_fields(library.skeleton),
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


def from_stored(contents: store.StoredLibrary) -> Library:
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
        skeleton_of(about["skeleton"]),
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


@dataclass(frozen=True, eq=False)
class ClusterMembers:
    """Segments by their clusters, to find those that a new one belongs to.

    `order` has them cluster by cluster, ascending in each; `starts` is where each cluster
    begins in it, and `points` are theirs, in this order.
    """

    order: IntArray
    starts: IntArray
    points: FloatArray

    @classmethod
    def from_labels(cls, labels: IntArray, points: FloatArray) -> "ClusterMembers":
        order = np.argsort(labels, kind="stable")
        return cls(order, np.flatnonzero(np.diff(labels[order], prepend=-1)), points[order])

    def find_nearest_cluster(self, point: FloatArray, sigma: float) -> tuple[IntArray, FloatArray]:
        """Return the nearest cluster that stays within the diameter, and how far its members are.

        The nearest is that of the nearest member; of equals the first. None may be.
        """
        # A cluster fits with all its members or not at all: most do not with their first.
        first = np.linalg.norm(self.points[self.starts] - point, axis=1)
        ends = np.append(self.starts[1:], len(self.order))
        found = self.order[:0], np.zeros(0)
        for cluster in np.flatnonzero(first <= sigma).tolist():
            rows = slice(self.starts[cluster], ends[cluster])
            apart = np.linalg.norm(self.points[rows] - point, axis=1)
            if apart.max() <= sigma and (not len(found[0]) or apart.min() < found[1].min()):
                found = self.order[rows], apart
        return found


def _nearest_cluster(
    embedding: Embedding | None, labels: IntArray, n_new: int, sigma: float
) -> IntArray:
    """Return the cluster of each new segment: one that stays within the diameter, or a new one."""
    fresh: IntArray = labels.max(initial=-1) + 1 + np.arange(n_new)
    if embedding is None:
        return fresh
    known, points = embedding.points[:-n_new], embedding.points[-n_new:]
    members = ClusterMembers.from_labels(labels, known)
    chosen = fresh.copy()
    for index, point in enumerate(points):
        mates, _ = members.find_nearest_cluster(point, sigma)
        if len(mates):
            chosen[index] = labels[mates[0]]
    return chosen
