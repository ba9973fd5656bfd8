"""Windows of grafts as a sequence: which bases, which donors, and what each window holds."""

import hashlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import zip_longest
from math import ceil
from typing import Any, NamedTuple

import numpy as np

from mograft._util.arrays import IntArray
from mograft._util.containers import LazySequence, SizedCache, remember
from mograft._util.names import find_matches
from mograft._util.runs import find_runs
from mograft._util.validate import as_integer, check_type
from mograft.datasets.features import (
    DEFAULT_FEATURES,
    Array,
    check_features,
    compute_tracks,
    cut_window,
)
from mograft.datasets.splits import Part, Split, select_part
from mograft.library.clip_keys import plain_tags
from mograft.library.files.stored_clips import StoredClips
from mograft.library.library import Library
from mograft.motion.motion import Motion
from mograft.search.trellis import DonorSequences
from mograft.solve.plan import GraftPlan
from mograft.synthesis.graft_building import build_graft
from mograft.synthesis.graft_result import Graft
from mograft.synthesis.newness import frame_newness

_CACHED_FRAMES = 1 << 15
"""Frames of clips that stay in the memory of a process: donors of other bases use them again."""

_MAX_DRAWS = 8  # of which an item takes the first that is new enough
_CACHED_BYTES = 1 << 27
"""Size of the features of whole grafts that stay in the memory of a process: other windows of the
same grafts are cut from them."""

PROVENANCE = (
    *("window", "base", "base_start", "base_stop", "draw", "group", "start", "stop"),
    *("clip", "clip_start", "clip_stop", "is_captured", "new", "changed", "gap"),
)
"""Columns of the provenance. The first four: the number of the window, the base clip, and the first
and last frame of the window in it. `draw` is the number of the graft, `start` and `stop` are those
of the base segment; `clip` and the next two give the donor, which may be the base segment itself.
The last three are those of the window: share of new frames, mean angle to the base and greatest
angle at a seam, in degrees."""

Encode = Callable[[Motion], bytes]


class Window(NamedTuple):
    """A window of a graft."""

    name: str
    features: dict[str, Array]
    provenance: list[tuple[Any, ...]]  # rows of `PROVENANCE` without the first column
    data: bytes  # the encoded motion; empty if it is not needed


class _Draw(NamedTuple):
    """What items need of a graft."""

    tracks: dict[str, Array]
    motion: Motion | None  # for features that are computed for each window
    n_new: IntArray  # of the frames before each frame, (n_frames + 1,)
    n_bytes: int


@dataclass(frozen=True, eq=False)
class Augmentation(LazySequence[dict[str, Array]]):
    """Windows of grafts, computed when they are accessed; made by `mograft.datasets.augment`.

    An item is a dict with an array for each feature; ``new``, the share of new frames; and
    ``index``. Windows of a graft share it as long as it is in memory, so that order matters only if
    the grafts of an epoch exceed 128 MB. The object may be pickled and used in any number of
    threads and processes, forked or spawned: nothing is read before the first access.

    Attributes
    ----------
    library : Library
        The library.
    part : Part
        The clips that are bases and donors.
    n_frames, stride : int
        Frames of a window, and from the first frame of a window to that of the next.
    features : tuple of str
        Names of the arrays.
    bases : ndarray of int
        The base clips, in the order in which they are used.
    starts : tuple of ndarray of int
        For each base the first frames of its windows.
    seed, epoch : int
        As for `augment` and `with_epoch`.
    min_new : float
        Smallest share of new frames.
    variants : int
        Number of grafts that are made of a base before the next base.
    """

    library: Library
    part: Part
    n_frames: int
    stride: int
    features: tuple[str, ...]
    bases: IntArray
    starts: tuple[IntArray, ...]
    seed: int
    min_new: float
    epoch: int = 0
    variants: int = 4
    _draws: SizedCache[Any, _Draw] = field(
        default_factory=lambda: SizedCache(_CACHED_BYTES), init=False, repr=False
    )
    _plans: SizedCache[int, GraftPlan] = field(  # further draws of a base are often needed next
        default_factory=lambda: SizedCache(1), init=False, repr=False
    )

    def __len__(self) -> int:
        return int(self._ends[-1])

    def __repr__(self) -> str:
        seconds = self.n_frames / self.library.rate
        return f"Augmentation({len(self)} windows of {seconds:.3g} s on {len(self.bases)} bases)"

    def with_epoch(self, epoch: int) -> "Augmentation":
        """Return the sequence with other grafts of the same bases, different for each epoch."""
        return replace(self, epoch=as_integer("epoch", epoch))

    def item(self, index: int) -> dict[str, Array]:
        """Return a window: of the draws of an epoch, the first that is new enough, else the newest.

        A base of which no more different grafts exist gives those of earlier epochs again.
        """
        number = int(np.searchsorted(self._ends, index, side="right"))
        before = int(self._ends[number - 1]) if number else 0
        base, start = int(self.bases[number]), int(self.starts[number][index - before])
        best, share, stop = None, -1.0, start + self.n_frames
        for draw in range(self.epoch * _MAX_DRAWS, (self.epoch + 1) * _MAX_DRAWS):
            found = self._cached_draw(base, draw)
            new = int(found.n_new[stop] - found.n_new[start]) / self.n_frames
            if new > share:
                best, share = found, new
            if new >= self.min_new:
                break
        assert best is not None
        frames, root = slice(start, stop), self.library.root
        row = cut_window(self.features, best.tracks, best.motion, frames, root)
        return {**row, "new": np.array(share, np.float32), "index": np.array(index)}

    def run_job(self, job: int, encode: Encode | None = None) -> tuple[list[Window], int]:
        """Return the windows of one base in one pass, which are new enough and different.

        Also return how many were not new enough, or repeated.

        Pass p uses draws p · variants to (p + 1) · variants - 1 of each base. `encode` converts
        the motion of a window to the bytes of a file.
        """
        turn, number = divmod(job, len(self.bases))
        base, starts = int(self.bases[number]), self.starts[number].tolist()
        first, windows, n_rejected = turn * self.variants, list[Window](), 0
        plan, drawn = self._draw(base, first + self.variants)
        known: set[tuple[int, bytes]] = set()
        for draw, donors in enumerate(drawn):
            keys = [(start, _key(plan, donors, start, self.n_frames)) for start in starts]
            if draw >= first:
                graft = build_graft(plan, donors, self.seed, draw)
                is_new = frame_newness(graft)[0]
                kept = [
                    start
                    for start, key in keys
                    if (start, key) not in known
                    and is_new[start : start + self.n_frames].mean() >= self.min_new
                ]
                n_rejected += len(starts) - len(kept)
                windows += self._windows(graft, draw, kept, encode)
            known.update(keys)
        n_rejected += len(starts) * max(first + self.variants - len(drawn), 0)
        return windows, n_rejected

    def _windows(
        self, graft: Graft, draw: int, starts: Sequence[int], encode: Encode | None
    ) -> Iterator[Window]:
        motion, root = graft.motion, self.library.root
        tracks = compute_tracks(self.features, motion, root)
        for start in starts:
            frames = slice(start, start + self.n_frames)
            name = f"{graft.base.name}_{draw}_{start}"
            provenance = provenance_rows(graft, draw, start, self.n_frames)
            row = cut_window(self.features, tracks, motion, frames, root)
            data = encode(replace(motion[frames], name=name)) if encode else b""
            yield Window(name, row, provenance, data)

    @cached_property
    def _ends(self) -> IntArray:
        return np.cumsum([len(own) for own in self.starts])

    @property
    def donors(self) -> Library:
        """The library in which only segments of the part are donors."""
        return remember(self, "donors", self._select_donors)

    def _select_donors(self) -> Library:
        library = self.library
        clips = library.clips
        if isinstance(clips, StoredClips):
            mean = sum(info.n_frames for info in library.entries) / len(library.entries)
            clips.cache.limit = max(clips.cache.limit, ceil(_CACHED_FRAMES / mean))
        return replace(library, is_donor=library.is_donor & self.part.clips[library.segments.clip])

    def _draw(self, base: int, count: int) -> tuple[GraftPlan, list[DonorSequences]]:
        """Return the plan of a base, and `count` different donor sequences, or all that exist.

        Of a larger `count` the first sequences are the same.
        """
        name = self.library.entries[base].name.encode("utf-8", "surrogatepass")
        digest = hashlib.sha256(b"%d %s" % (self.seed, name)).digest()
        plan = self._plans.get(base)
        if plan is None:
            plan = self._plans.put(base, GraftPlan.build(self.donors, base, None, ()), 1)
        return plan, plan.choose_donors(count, int.from_bytes(digest[:8], "big"))

    def build(self, base: int, draws: Sequence[int]) -> list[Graft]:
        """Return the grafts on a base clip with the numbers `draws`, as they are in data sets."""
        plan, drawn = self._draw(base, max(draws) + 1)
        return [build_graft(plan, drawn[draw], self.seed, draw) for draw in draws]

    def _cached_draw(self, base: int, draw: int) -> _Draw:
        """Return the features of a graft, which stay in memory; the oldest ones are dropped."""
        found = self._draws.get((base, draw))
        if found is None:
            plan, drawn = self._draw(base, draw + 1)
            own = min(draw, len(drawn) - 1) if draw < _MAX_DRAWS else draw % len(drawn)
            found = self._draws.get((base, own)) or self._compute_draw(plan, drawn[own], own)
            self._draws.put((base, draw), found, found.n_bytes)
        return found

    def _compute_draw(self, plan: GraftPlan, donors: DonorSequences, draw: int) -> _Draw:
        graft = build_graft(plan, donors, self.seed, draw)
        tracks = compute_tracks(self.features, graft.motion, self.library.root)
        n_new = np.append(0, np.cumsum(frame_newness(graft)[0]))
        motion = graft.motion if len(tracks) < len(self.features) else None
        size = 0 if motion is None else motion.rotations.nbytes + motion.positions.nbytes
        size += n_new.nbytes + sum(own.nbytes for own in tracks.values())
        return _Draw(tracks, motion, n_new, size)


def augment(
    library: Library,
    *,
    seconds: float = 4.0,
    stride: float | None = None,
    split: Split | None = None,
    part: str = "train",
    bases: str | Sequence[str] = "*",
    features: Sequence[str] = DEFAULT_FEATURES,
    seed: int = 0,
    min_new: float = 0.5,
) -> Augmentation:
    """Return windows of grafts as a sequence, from which models are trained.

    Bases and donors are clips of one part of a split. Clips whose motion also occurs in another
    part, as a copy, a piece or a mirrored take, are left out.

    Parameters
    ----------
    library : Library
        The library.
    seconds : float
        Duration of a window.
    stride : float, optional
        Seconds between the first frames of windows on one base. Default: `seconds`; less gives more
        windows, which overlap and are parts of the same grafts.
    split : path or mapping, optional
        A CSV file, or a mapping, from clips to parts; or ``auto:clip``, ``auto:file``, ``auto:tag``
        or ``auto:tag:GLOB``, by which clips, files, or clips with a tag in common are divided into
        the parts train, val and test. Default: all clips.
    part : str
        The part whose clips are bases and donors.
    bases : str or sequence of str
        Names of the base clips, or globs.
    features : sequence of str
        The arrays of a window: see `mograft.datasets.FEATURES`.
    seed : int
        Seed of automatic splits, of the order of bases and of the choice of donors.
    min_new : float
        Smallest share of the frames of a window in which an exchanged joint differs by more than 5
        degrees from the base.

    Returns
    -------
    Augmentation
        The windows; `write` stores them, faster than they are accessed in random order.

    Raises
    ------
    ValueError
        If an option is invalid, no base has a window, or the split leaves a part without donors.

    Examples
    --------
    >>> import mograft as mg
    >>> from mograft.dancer import dance
    >>> windows = augment(mg.Library.build(dance(strides=1).motion), seconds=2.0)
    >>> windows[3]["rotations"].shape
    (60, 18, 4)
    """
    check_type("library", library, Library)
    if not 0 < float(seconds) < 1e6 or round(seconds * library.rate) < 2:
        raise ValueError(f"`seconds` must give windows of at least 2 frames, got {seconds}")
    stride = float(seconds if stride is None else stride)
    if not 0.5 < stride * library.rate < np.inf:
        raise ValueError(f"`stride` must be at least one frame, got {stride}")
    if not 0 <= float(min_new) <= 1:
        raise ValueError(
            f"`min_new`, a share of frames that are new, must be 0 to 1, got {min_new}"
        )
    names = check_features(features, library)
    seed = as_integer("seed", seed)
    chosen = select_part(library, split, part, seed)
    n_frames, step = round(seconds * library.rate), round(stride * library.rate)
    matches = find_matches("bases", bases, library.names)
    wanted = [clip for clip in matches if chosen.clips[clip]]
    spans = _faultless_spans(library)
    starts = {
        clip: found
        for clip in wanted
        if (found := [k for a, b in spans[clip] for k in range(a, b - n_frames + 1, step)])
    }
    if not wanted:
        raise ValueError(f"`bases` must match a clip of the part {chosen.name}, got {bases!r}")
    if not starts:
        longest = max((stop - start for clip in wanted for start, stop in spans[clip]), default=0)
        raise ValueError(
            f"`seconds` must be at most {longest / library.rate:.6g}, the longest span without "
            f"faults of the base clips of {chosen.name}, got {seconds:g}"
        )
    order = _order_bases(library, starts, seed)
    return Augmentation(
        library=library,
        part=chosen,
        n_frames=n_frames,
        stride=step,
        features=names,
        bases=np.array(order),
        starts=tuple(np.array(starts[clip]) for clip in order),
        seed=seed,
        min_new=float(min_new),
    )


def provenance_rows(graft: Graft, draw: int, start: int, n_frames: int) -> list[tuple[Any, ...]]:
    """Return the provenance of a window: a row for each exchanged group and base segment."""
    stop = start + n_frames - 1
    is_new, angles = (own[start : stop + 1].mean() for own in frame_newness(graft))
    gap = max((seam.gap for seam in graft.seams if start <= seam.frame <= stop), default=0.0)
    measures = [round(float(own), 6) for own in (is_new, np.degrees(angles), np.degrees(gap))]
    return [
        (
            *(graft.base.name, start, stop, draw, own.group, own.start, own.stop),
            *(own.clip, own.donor_start, own.donor_stop, own.is_own, *measures),
        )
        for own in graft.substitutions
        if own.start < stop and own.stop > start
    ]


def _key(plan: GraftPlan, donors: DonorSequences, start: int, n_frames: int) -> bytes:
    """Return the donors of a window: two windows with the same ones are equal."""
    cut = plan.problem.base_segments
    inside = (cut.start < start + n_frames - 1) & (cut.stop > start)
    return b"".join(own[inside].tobytes() for own in donors.values())


def _faultless_spans(library: Library) -> list[list[list[int]]]:
    """Return for each clip the spans of frames without faults; the last frame is not included."""
    is_faultless = [np.ones(entry.n_frames, bool) for entry in library.entries]
    cut = library.segments[~library.is_donor]
    for clip, start, stop in zip(cut.clip.tolist(), cut.start, cut.stop, strict=True):
        is_faultless[clip][start : stop + 1] = False
    return [find_runs(own).tolist() for own in is_faultless]


def _order_bases(library: Library, starts: dict[int, list[int]], seed: int) -> list[int]:
    """Return base clips in the order of a pass: evenly over sets of tags, long clips rather first.

    The order within a set is a random one in which the chance to be next is proportional to the
    number of windows (Efraimidis and Spirakis, 2006). Sets take turns.
    """
    rng, clips = np.random.default_rng(seed), list(starts)
    n_windows = np.array([len(own) for own in starts.values()], float)
    ranks = np.argsort(-(rng.random(len(clips)) ** (1.0 / n_windows)), kind="stable")
    sets: dict[tuple[str, ...], list[int]] = {}
    for rank in ranks.tolist():
        sets.setdefault(plain_tags(library.entries[clips[rank]]), []).append(clips[rank])
    turns = zip_longest(*sets.values())
    return [clip for turn in turns for clip in turn if clip is not None]
