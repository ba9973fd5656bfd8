"""Clips cut, compared and labelled: what donors are chosen from."""

import glob
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from os import PathLike, fspath
from typing import TYPE_CHECKING

import numpy as np

from mograft import rotations
from mograft._arrays import BoolArray, FloatArray, IntArray
from mograft.anatomy import feature_joints
from mograft.body import body, up_axis
from mograft.bvh import read_bvh
from mograft.clustering import cut, threshold
from mograft.config import Config
from mograft.embedding import Embedding, Samples, embed, features, normalise
from mograft.faults import find_faults
from mograft.groups import JointGroups
from mograft.motion import Motion
from mograft.segmentation import Segments, segment
from mograft.substitution import Candidates, Pool

if TYPE_CHECKING:
    from mograft.constraints import Constraint

__all__ = ["Library"]

Source = Motion | str | PathLike[str]
Progress = Callable[[str, int, int], None]


@dataclass(frozen=True, eq=False)
class Library:
    """Clips of one skeleton, cut into segments whose parts are compared and labelled.

    Made by `Library.build`.

    Attributes
    ----------
    clips : tuple of Motion
        The clips; of one hierarchy and one frame rate, each with its own offsets.
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
    """

    clips: tuple[Motion, ...]
    groups: JointGroups
    config: Config
    segments: Segments
    is_donor: BoolArray
    embedding: Mapping[str, Embedding | None]
    labels: Mapping[str, IntArray]
    sigma: Mapping[str, float]
    root: int
    up: int

    def __repr__(self) -> str:
        groups = ", ".join(
            f"{name} {labels.max() + 1} clusters" for name, labels in self.labels.items()
        )
        clips = "1 clip" if len(self.clips) == 1 else f"{len(self.clips)} clips"
        return f"Library({clips}, {len(self.segments)} segments, {groups})"

    @classmethod
    def build(
        cls,
        sources: Source | Iterable[Source],
        groups: JointGroups | str = "lower_upper",
        config: Config | None = None,
        *,
        progress: Progress | None = None,
    ) -> "Library":
        """Read, cut, compare and label clips.

        Parameters
        ----------
        sources : Motion, path or glob, or several
            The clips; what a glob finds is taken in order of name.
        groups : JointGroups or str
            The joint groups, or the name of a preset.
        config : Config, optional
            The configuration.
        progress : callable, optional
            Called with a stage's name, what is done of it and the whole.

        Returns
        -------
        Library
            In memory.

        Raises
        ------
        BvhError
            If a file is no BVH motion.
        FileNotFoundError
            If a path or glob finds no file.
        SkeletonMismatchError
            If the clips differ in joint names or hierarchy.
        ValueError
            If the groups do not fit the skeleton, or a clip has a single frame.

        Warns
        -----
        UserWarning
            Of clips of another frame rate, which are resampled to the commonest; of faults
            such as a T-pose first frame; of groups with nothing to compare.

        Examples
        --------
        >>> from mograft.dancer import dance
        >>> library = Library.build(dance(strides=1).motion)
        >>> sorted(library.labels)
        ['lower', 'upper']
        """
        config = Config() if config is None else config
        tell = progress or (lambda *_: None)
        clips = _one_rate(_named(_read(sources, tell)))
        first = clips[0]
        for clip in clips:
            first.skeleton.check_same_hierarchy(clip.skeleton, clip.name or "a clip")
            if clip.n_frames < 2:
                raise ValueError(f"{clip.name or 'a clip'} must have at least 2 frames, got 1")
        if isinstance(groups, str):
            groups = JointGroups.preset(groups, first.skeleton)
        members = groups.resolve(first.skeleton)

        cuts = []
        for index, clip in enumerate(clips):
            tell("segmenting", index, len(clips))
            cuts.append(segment(clip, config))
        segments = _joined(cuts)
        is_donor = _without_faults(clips, segments)
        root, up = _locomotion_root(clips), up_axis(max(clips, key=len))
        heights = [body(clip.skeleton).height for clip in clips]
        tell("comparing", 0, len(members))
        samples = normalise(clips, segments, config, root=root, up=up, heights=heights)
        embedding: dict[str, Embedding | None] = {}
        for index, (name, joints) in enumerate(members.items()):
            tell("comparing", index, len(members))
            counted = feature_joints(first.skeleton, joints)
            if root in joints:
                counted = np.union1d(counted, [root])
            embedding[name] = embed(samples, counted, config, root=root, group=name)
        tell("comparing", len(members), len(members))
        labels, sigma = _clusters(embedding, len(segments), config)
        return cls(
            tuple(clips), groups, config, segments, is_donor, embedding, labels, sigma, root, up
        )

    @property
    def rate(self) -> float:
        """Frames per second of all clips."""
        return self.clips[0].rate

    def joints(self, group: str) -> IntArray:
        """Return the joints of a group, ascending."""
        members = self.groups.resolve(self.clips[0].skeleton)
        if group not in members:
            raise ValueError(f"group must be one of {', '.join(members)}, got {group!r}")
        return members[group]

    def pool(self, group: str) -> Pool:
        """Return the segments as the search for one group's donors sees them."""
        joints = feature_joints(self.clips[0].skeleton, self.joints(group))
        n = len(self.segments)
        first, last = np.empty((n, len(joints), 4)), np.empty((n, len(joints), 4))
        leaving, reaching = np.empty((n, len(joints), 3)), np.empty((n, len(joints), 3))
        for index, clip in enumerate(self.clips):
            own = self.segments.of_clip(index)
            start, stop = self.segments.start[own], self.segments.stop[own]
            first[own] = clip.rotations[start[:, None], joints]
            last[own] = clip.rotations[stop[:, None], joints]
            leaving[own] = _velocities(clip, start, joints)
            reaching[own] = _velocities(clip, stop, joints)
        base = self.groups.base
        compared = self.embedding[base]
        return Pool(
            self.segments,
            self.labels[base],
            self.is_donor,
            first,
            last,
            self.rate,
            leaving,
            reaching,
            None if compared is None else compared.points,
            self.sigma[base],
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
        labels, sigma = _clusters(self.embedding, len(self.segments), config)
        return replace(self, config=config, labels=labels, sigma=sigma)

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
            names = [clip.name for clip in self.clips]
            if base not in names:
                raise ValueError(f"base must be a clip, one of {', '.join(names)}; got {base!r}")
            return self, names.index(base)
        self.clips[0].skeleton.check_same_hierarchy(base.skeleton, base.name or "the base")
        for index, clip in enumerate(self.clips):
            if base is clip or (
                np.array_equal(base.rotations, clip.rotations)
                and np.array_equal(base.positions, clip.positions)
            ):
                return self, index
        return self.extended(base), len(self.clips)

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
        self.clips[0].skeleton.check_same_hierarchy(motion.skeleton, name)
        if not _same_rate(motion.rate, self.rate):
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
        embedding = {
            group: None if seen is None else _with_points(seen, samples)
            for group, seen in self.embedding.items()
        }
        labels = {
            group: np.concatenate(
                [known, _nearest_cluster(embedding[group], known, len(own), self.sigma[group])]
            )
            for group, known in self.labels.items()
        }
        cuts = [self.segments, replace(own, clip=np.full(len(own), len(self.clips)))]
        return replace(
            self,
            clips=(*self.clips, motion),
            segments=Segments(
                *(np.concatenate([getattr(c, f) for c in cuts]) for f in ("start", "stop", "clip"))
            ),
            is_donor=np.concatenate([self.is_donor, np.zeros(len(own), bool)]),
            embedding=embedding,
            labels=labels,
        )


SPOILING = ("first_frame", "teleport", "glitch", "flip")
"""Kinds of faults that make the frames they are in unfit to be used elsewhere."""

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


def _read(sources: Source | Iterable[Source], tell: Progress) -> list[Motion]:
    several = [sources] if isinstance(sources, Motion | str | PathLike) else list(sources)
    found: list[Motion | str] = []
    for source in several:
        if isinstance(source, Motion):
            found.append(source)
            continue
        path = fspath(source)
        matches = sorted(glob.glob(path, recursive=True)) if glob.has_magic(path) else []
        if glob.has_magic(path) and not matches and not glob.glob(glob.escape(path)):
            raise FileNotFoundError(f"no file matches {path}")
        found += matches or [path]
    if not found:
        raise ValueError("sources must hold at least one clip, got none")
    clips = []
    for index, item in enumerate(found):
        tell("reading", index, len(found))
        clips.append(item if isinstance(item, Motion) else read_bvh(item))
    return clips


def _named(clips: Sequence[Motion]) -> list[Motion]:
    """Give every clip a name of its own."""
    taken: set[str] = set()
    named = []
    for index, clip in enumerate(clips):
        name = plain = clip.name or f"clip{index}"
        count = 1
        while name in taken:
            count += 1
            name = f"{plain}~{count}"
        taken.add(name)
        named.append(clip if name == clip.name else replace(clip, name=name))
    return named


def _same_rate(a: float, b: float) -> bool:
    # A tenth of a percent: 23.976 and 24 or 29.97 and 30 are told apart no more finely
    # than files that give 0.033 for 1/30 need.
    return abs(a - b) <= 1e-3 * b


def _one_rate(clips: Sequence[Motion]) -> list[Motion]:
    """Resample clips to the frame rate of most frames, if they differ."""
    frames: dict[float, int] = {}
    for clip in clips:
        key = next((rate for rate in frames if _same_rate(clip.rate, rate)), clip.rate)
        frames[key] = frames.get(key, 0) + clip.n_frames
    rate = max(frames, key=lambda key: frames[key])
    others = [clip.name for clip in clips if not _same_rate(clip.rate, rate)]
    if others:
        warnings.warn(
            f"resampled to {rate:.6g} fps, the rate of most frames: {', '.join(others)}",
            stacklevel=3,
        )
    return [clip if _same_rate(clip.rate, rate) else clip.resample(rate) for clip in clips]


def _joined(cuts: Sequence[Segments]) -> Segments:
    return Segments(
        np.concatenate([own.start for own in cuts]),
        np.concatenate([own.stop for own in cuts]),
        np.repeat(np.arange(len(cuts)), [len(own) for own in cuts]),
    )


def _locomotion_root(clips: Sequence[Motion]) -> int:
    """Return the first joint that moves through the world in any clip."""
    roots = [clip.locomotion_root() for clip in clips if np.ptp(clip.positions, axis=0).any()]
    return min(roots, default=0)


def _without_faults(clips: Sequence[Motion], segments: Segments) -> BoolArray:
    """Tell which segments hold no fault; warn of those that do."""
    good = np.ones(len(segments), bool)
    for index, clip in enumerate(clips):
        own = segments.of_clip(index)
        faults = [fault for fault in find_faults(clip) if fault.kind in SPOILING]
        for fault in faults:
            first, last = fault.frames
            good[own[(segments.start[own] <= last) & (segments.stop[own] >= first)]] = False
        if faults:
            warnings.warn(
                f"{clip.name}: "
                + "; ".join(fault.message for fault in faults[:3])
                + (f"; and {len(faults) - 3} more" if len(faults) > 3 else "")
                + ". These frames lend nothing to others",
                stacklevel=3,
            )
    return good


def _velocities(clip: Motion, frames: IntArray, joints: IntArray) -> FloatArray:
    """Return joints' angular velocities in their own frames, in radians per second."""
    before, after = np.maximum(frames - 1, 0), np.minimum(frames + 1, clip.n_frames - 1)
    turned = rotations.multiply(
        rotations.inverse(clip.rotations[before[:, None], joints]),
        clip.rotations[after[:, None], joints],
    )
    per_second: FloatArray = rotations.log(turned) * (clip.rate / (after - before))[:, None, None]
    return per_second


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
