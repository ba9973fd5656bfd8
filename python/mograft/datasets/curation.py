"""Choose clips of a library that are near all others."""

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial
from math import sqrt

import numpy as np

from mograft._standalone.mograft_linkage import cut as cut_tree
from mograft._util.arrays import FloatArray, IntArray
from mograft._util.validate import as_integer, check_type
from mograft.datasets.executors import call_each, check_executor
from mograft.errors import InsufficientDataError
from mograft.library.library import Library

_RADII = (0.25, 8.0)
"""Radii between which a share is searched, in cluster diameter thresholds."""

_N_STEPS = 7  # of the search for the radius of a share: a factor of about 1.03
_ROUNDING = 1e-9
_PAIRS_PER_BATCH = 1 << 16
_COPY_DISTANCE = 0.05  # in cluster diameter thresholds; copies differ by rounding and resampling


@dataclass(frozen=True)
class Choice:
    """What happens to a clip.

    Attributes
    ----------
    clip : str
        Name of the clip.
    is_kept : bool
        Whether it is kept.
    frames : int
        Number of frames.
    reason : str
        What a kept clip adds, or why it is dropped.
    nearest : float
        Greatest distance of its segments from a segment of a kept clip, in cluster diameter
        thresholds; NaN if all its segments have faults.
    """

    clip: str
    is_kept: bool
    frames: int
    reason: str
    nearest: float


@dataclass(frozen=True, eq=False)
class Curation:
    """A choice of clips; made by `mograft.datasets.curate`.

    Attributes
    ----------
    choices : tuple of Choice
        One for each clip, in the order of the library.
    radius : float
        Every segment without faults of a dropped clip is within this distance of a segment of a
        kept clip, in cluster diameter thresholds.
    curve : tuple of (int, float)
        The number of frames and the share of covered clusters after each kept clip, in the order in
        which they were chosen.
    """

    choices: tuple[Choice, ...]
    radius: float
    curve: tuple[tuple[int, float], ...]

    @property
    def kept(self) -> list[str]:
        """Names of the kept clips."""
        return [own.clip for own in self.choices if own.is_kept]

    @property
    def kept_share(self) -> float:
        """Share of the frames in kept clips."""
        kept = sum(own.frames for own in self.choices if own.is_kept)
        return kept / sum(own.frames for own in self.choices)

    def __repr__(self) -> str:
        counts = f"{len(self.kept)} of {len(self.choices)} clips"
        return f"Curation({counts}, {self.kept_share:.0%} of the frames)"


def curate(
    library: Library,
    *,
    radius: float | None = None,
    keep: float | None = None,
    part: str | None = None,
    shards: int = 1,
    executor: Executor | None = None,
) -> Curation:
    """Choose clips so that each segment of the others is near a segment of a chosen one.

    Segments with faults do not count. The others are clustered by exact complete linkage: no two
    of a cluster are farther apart than the radius, and copies are in one cluster. Clips are then
    chosen one by one: next is the clip that adds most clusters, weighted by the complexity of their
    segments, for its number of frames. Clips that add none are dropped.

    Parameters
    ----------
    library : Library
        The library.
    radius : float, optional
        The radius in cluster diameter thresholds of the library. Default: 1.
    keep : float, optional
        Greatest share of frames to keep, 0 to 1, instead of `radius`: the smallest radius is
        searched that needs at most this share.
    part : str, optional
        The joint group that is compared. Default: all groups, whose squared distances are added.
    shards : int
        Number of shards of clips. Of several, clips are first chosen in each shard and then among
        the chosen ones, each time with half of the radius: no tree has the segments of all clips,
        the bound is the same, and more clips are kept.
    executor : concurrent.futures.Executor, optional
        The workers that choose in the shards, as for `write`. The result does not depend on it.
        Default: the calling thread.

    Returns
    -------
    Curation
        The choice.

    Raises
    ------
    ValueError
        If `radius` or `keep` is invalid, or both are given, or no radius up to 8 keeps so little.
    InsufficientDataError
        If the library has too few segments to compare.

    Notes
    -----
    The selection of clips is the greedy one for set cover: it needs at most 1 + ln(n) times as many
    frames as the best choice for n clusters (Chvátal, 1979).

    Examples
    --------
    >>> import mograft as mg
    >>> from mograft.dancer import dance
    >>> take = dance(strides=1).motion
    >>> curate(mg.Library.build([take, take]), radius=1.0).kept
    ['dance']
    """
    check_type("library", library, Library)
    if radius is not None and keep is not None:
        raise ValueError("`keep` must not be given together with `radius`")
    if keep is not None and not 0 < float(keep) <= 1:
        raise ValueError(f"`keep` must be a share of the frames, above 0 and at most 1, got {keep}")
    if radius is not None and not 0 < float(radius) < np.inf:
        raise ValueError(f"`radius` must be a finite number above 0, got {radius}")
    check_executor(executor, library)
    choose = partial(_choose, library, part, as_integer("shards", shards, 1), executor)
    if keep is None:
        return choose(1.0 if radius is None else float(radius))
    low, high = _RADII
    best = choose(high)
    if best.kept_share > keep:
        raise ValueError(
            f"`keep` must be at least {best.kept_share:.4f} ({best.kept_share:.1%} of the frames), "
            f"the least that a radius up to {high:g} keeps; got {keep:g}"
        )
    for _ in range(_N_STEPS):
        middle = sqrt(low * high)
        found = choose(middle)
        if found.kept_share <= keep:
            best, high = found, middle
        else:
            low = middle
    return best


def _choose(
    library: Library, part: str | None, shards: int, executor: Executor | None, radius: float
) -> Curation:
    """Return the choice of clips for a radius."""
    cover = _Cover.of(library, part)
    if shards == 1:
        return cover.choose(radius)
    blocks = np.array_split(np.arange(len(library.entries)), shards)
    items = [(own, radius / 2.0) for own in blocks if len(own)]
    kept = np.concatenate(list(call_each(executor, _choose_in_shard, (library, part), items)))
    return cover.within(kept).choose(radius / 2.0, cover)


def _choose_in_shard(context: tuple[Library, str | None], item: tuple[IntArray, float]) -> IntArray:
    clips, radius = item
    cover = _Cover.of(*context).within(clips)
    return np.array(list(cover.select(radius)[1]), np.int64) if len(cover.clips) else clips[:0]


@dataclass(frozen=True, eq=False)
class _Cover:
    """The segments that count, as points whose distances are in cluster diameter thresholds."""

    library: Library
    clips: IntArray  # of the segments without faults
    points: FloatArray

    @classmethod
    def of(cls, library: Library, part: str | None) -> "_Cover":
        groups: Sequence[str] = library.groups.names if part is None else (part,)
        spaces = []
        for group in groups:
            library.joints(group)  # raises ValueError for an unknown group
            embedding = library.embedding[group]
            if embedding is None or not library.sigma[group] > 0:
                raise InsufficientDataError(f"group {group} has too few segments to compare")
            spaces.append(embedding.points / library.sigma[group])
        segments = np.flatnonzero(library.is_donor)
        if not len(segments):
            raise InsufficientDataError("all segments have faults")
        points = np.concatenate(spaces, axis=1)[segments]
        return cls(library, library.segments.clip[segments], points)

    def within(self, clips: IntArray) -> "_Cover":
        """Return the segments of some clips."""
        rows = np.isin(self.clips, clips)
        return replace(self, clips=self.clips[rows], points=self.points[rows])

    def choose(self, radius: float, whole: "_Cover | None" = None) -> Curation:
        """Return the choice of clips for a radius; `whole` has the segments of all clips."""
        labels, added = self.select(radius)
        frames = np.array([self.library.entries[clip].n_frames for clip in added])
        n_clusters = int(labels.max()) + 1
        covered = np.cumsum(list(added.values())) / n_clusters
        curve = zip(np.cumsum(frames).tolist(), covered.tolist(), strict=True)
        choices = (whole or self).describe(None if whole else labels, added, n_clusters)
        return Curation(tuple(choices), radius * (2.0 if whole else 1.0), tuple(curve))

    def select(self, radius: float) -> tuple[IntArray, dict[int, int]]:
        """Return the clusters of the segments, and the chosen clips with how many each adds.

        The clips are in the order in which they were chosen.
        """
        labels, entries = cut_tree(self.points, radius), self.library.entries
        # Complex segments vary more: their distance from the mean point.
        spread = np.linalg.norm(self.points - self.points.mean(axis=0), axis=1)
        weights = np.zeros(labels.max() + 1)
        np.maximum.at(weights, labels, 1.0 + spread)
        # The clusters of each clip, each once.
        pairs = np.unique(np.stack([self.clips, labels], axis=1), axis=0)
        members = np.split(pairs[:, 1], np.searchsorted(pairs[:, 0], np.arange(1, len(entries))))
        frames = np.array([entry.n_frames for entry in entries])
        is_new, added = np.ones(len(weights), bool), dict[int, int]()
        gains = np.array([weights[own].sum() for own in members]) / frames
        while is_new.any():
            clip = int(np.argmax(gains))
            current = float(weights[members[clip]][is_new[members[clip]]].sum() / frames[clip])
            if current < gains[clip] * (1.0 - _ROUNDING):
                gains[clip] = current  # gains only fall: others are computed when they are greatest
                continue
            added[clip] = int(is_new[members[clip]].sum())
            is_new[members[clip]] = False
            gains[clip] = 0.0
        return labels, added

    def describe(
        self, labels: IntArray | None, added: dict[int, int], n_clusters: int
    ) -> list[Choice]:
        """Return the choice of each clip, with the distance to the nearest kept segment.

        With `labels` the nearest is searched in the cluster of each segment.
        """
        labels = np.zeros(len(self.clips), np.int64) if labels is None else labels
        is_kept = np.isin(self.clips, list(added))
        distances = np.zeros(len(labels))
        # The nearest kept segment of a cluster; it has one, at most `radius` away.
        order = np.argsort(labels, kind="stable")
        bounds = np.flatnonzero(np.diff(labels[order], prepend=-1, append=-1))
        for low, high in zip(bounds[:-1].tolist(), bounds[1:].tolist(), strict=True):
            own = order[low:high]
            others, kept = own[~is_kept[own]], own[is_kept[own]]
            step = _PAIRS_PER_BATCH // max(len(kept), 1) + 1
            for start in range(0, len(others), step):
                chunk = others[start : start + step]
                gaps = self.points[chunk, None] - self.points[kept][None]
                distances[chunk] = np.sqrt((gaps**2).sum(axis=2).min(axis=1))
        worst, found = np.full(len(self.library.entries), np.nan), list[Choice]()
        np.fmax.at(worst, self.clips, distances)
        for clip, entry in enumerate(self.library.entries):
            number = added.get(clip)
            reason = f"adds {number} of {n_clusters} clusters"
            if number is None and np.isnan(worst[clip]):
                reason = "all segments have faults: " + "; ".join(entry.faults)
            elif number is None:
                reason = f"all segments are within {worst[clip]:.3f} of kept ones"
                if worst[clip] <= _COPY_DISTANCE:
                    reason = "all segments are copies of kept ones"
            is_chosen = number is not None
            found.append(Choice(entry.name, is_chosen, entry.n_frames, reason, float(worst[clip])))
        return found
