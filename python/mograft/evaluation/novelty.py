"""Novelty, coverage and diversity of grafts: distances of half-second windows of the body."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from mograft._util.arrays import FloatArray, IntArray
from mograft.errors import InsufficientDataError
from mograft.evaluation import estimate
from mograft.evaluation.body_tracks import BodyTracks, FrameBlocks, clip_indices
from mograft.evaluation.estimate import Estimate, Record
from mograft.library.library import Library
from mograft.synthesis.graft_result import Graft

_OFFSETS = np.array([-7, -4, 0, 4, 7])  # samples at which a window has positions
_STEP = 5  # samples between windows
_MIN_SEPARATION_SECONDS = 1.5  # between captured windows whose distance is a reference
_MIN_CHANGE = 0.003  # distance from the window of the base, in heights, of a changed window
_MIN_REFERENCE = 1e-6  # least reference distance, in heights; computed distances of 0 are smaller
_MAX_CAPTURED = 8_000  # above this only every k-th captured window is compared
_N_RANDOM_PAIRS = 2000
_CHUNK = 500  # rows of a distance matrix that are computed at once


@dataclass(frozen=True)
class Novelty(Record):
    """Novelty of grafts, the share of the recordings that they cover, and their diversity.

    A window is about half a second of motion; see `novelty`. The distance of two windows is the
    root mean square distance of their bone ends in skeleton heights. A measure that is
    relative to a distance of captured windows is NaN if this distance is 0. For example, `novelty`
    and `coverage` are NaN if the library contains every motion twice.

    Attributes
    ----------
    changed : Estimate
        Share of changed windows among the windows of grafts. A window is changed if its distance
        from the base's window at the same frame is at least 0.003 skeleton heights.
    novelty : Estimate
        Mean distance of the changed windows from the nearest captured window, divided by the
        median distance of a captured window from the nearest one of another clip or 1.5 s or more
        away.
    coverage : Estimate
        Share of the captured windows whose distance from the nearest changed window is less than
        the median distance that `novelty` is divided by.
    between : Estimate
        Mean distance of the windows of two grafts of one base at the same frame, divided by the
        mean distance of two random captured windows.
    """

    changed: Estimate
    novelty: Estimate
    coverage: Estimate
    between: Estimate


def novelty(grafts: Sequence[Sequence[Graft]], seed: int = 0) -> Novelty:
    """Measure the novelty, coverage and diversity of grafts.

    Parameters
    ----------
    grafts : sequence of sequence of Graft
        For each base, its grafts; all from one library.
    seed : int
        Seed of the random captured pairs and of the resampling.

    Returns
    -------
    Novelty
        The measures. Their intervals resample blocks of five seconds: blocks of the bases, and
        for `Novelty.coverage` blocks of all clips.

    Raises
    ------
    InsufficientDataError
        If a base has no graft, or the clips are too short for two windows 1.5 s apart.

    Notes
    -----
    A window has the positions of bone ends relative to the hips at five instants within 0.5 s,
    rotated so that the heading at its centre is 0. If the library has more than 8,000 windows,
    every k-th of them is used, with the smallest k that gives at most 8,000.
    """
    if not grafts or not all(grafts):
        raise InsufficientDataError("novelty needs at least one graft on every base")
    library = grafts[0][0].library
    reference = captured_windows(library, seed)
    clips = clip_indices(library)
    changed, change_blocks = list[float](), list[int]()
    new, new_blocks = list[FloatArray](), list[int]()
    between, between_blocks = list[float](), list[int]()
    for index, several in enumerate(grafts):
        base, centers = body_windows(BodyTracks.of(several[0].base))
        clip = clips.get(several[0].base.name)
        blocks = np.full(len(centers), -1 - index)  # One block for a base that is not a clip.
        if clip is not None:
            blocks = reference.frames.block[reference.frames.offsets[clip] + centers]
        windows = [body_windows(BodyTracks.of(graft.motion))[0] for graft in several]
        for number, own in enumerate(windows):
            is_changed = np.linalg.norm(own - base, axis=1) >= _MIN_CHANGE
            changed += is_changed.tolist()
            change_blocks += blocks.tolist()
            new.append(own[is_changed])
            new_blocks += blocks[is_changed].tolist()
            for other in windows[:number]:
                between += (np.linalg.norm(own - other, axis=1) / reference.spread).tolist()
                between_blocks += blocks.tolist()
    moved = np.concatenate(new)
    distances = nearest_distances(moved, reference.windows) / reference.scale
    to_changed = nearest_distances(reference.windows, moved)
    covered = np.where(np.isfinite(reference.scale), to_changed < reference.scale, np.nan)
    return Novelty(
        changed=estimate.block_mean(changed, change_blocks, "windows", seed),
        novelty=estimate.block_mean(distances, new_blocks, "changed windows", seed),
        coverage=estimate.block_mean(covered, reference.block, "captured windows", seed),
        between=estimate.block_mean(between, between_blocks, "pairs of windows", seed),
    )


@dataclass(frozen=True, eq=False)
class CapturedWindows:
    """Every k-th window of the clips of a library, and typical distances between them."""

    frames: FrameBlocks
    windows: FloatArray  # (n_windows, n_features)
    block: IntArray  # block of each window, as in `FrameBlocks`
    scale: float  # median distance to the nearest window of another clip or 1.5 s or more away
    spread: float  # mean distance of random pairs of windows; like `scale`, NaN instead of 0


@lru_cache(maxsize=1)
def captured_windows(library: Library, seed: int) -> CapturedWindows:
    """Return every k-th window of all clips; `seed` is that of the random pairs of `spread`."""
    frames = FrameBlocks.of(library)
    found = [body_windows(BodyTracks.of(clip)) for clip in library.clips]
    windows = np.concatenate([own for own, _ in found])
    center = np.concatenate(
        [offset + own for offset, (_, own) in zip(frames.offsets, found, strict=True)]
    )
    step = max(math.ceil(len(windows) / _MAX_CAPTURED), 1)
    windows, center = windows[::step], center[::step]
    # Windows of different clips are far apart, even if their frames are adjacent.
    clip, _ = frames.clip_of(center)
    order = center + clip * math.ceil(_MIN_SEPARATION_SECONDS * library.rate)
    separation = _MIN_SEPARATION_SECONDS * library.rate
    natural = nearest_distances(windows, windows, order, separation)
    natural = natural[np.isfinite(natural)]
    if not len(natural):
        raise InsufficientDataError(
            f"novelty needs captured windows at least {_MIN_SEPARATION_SECONDS} s apart, "
            "but the clips are too short"
        )
    first, second = np.random.default_rng(seed).integers(len(windows), size=(2, _N_RANDOM_PAIRS))
    return CapturedWindows(
        frames=frames,
        windows=windows,
        block=frames.block[center],
        scale=_nan_if_zero(float(np.median(natural))),
        spread=_nan_if_zero(float(np.linalg.norm(windows[first] - windows[second], axis=1).mean())),
    )


def _nan_if_zero(distance: float) -> float:
    """Return a distance, or NaN if it is 0 up to rounding, since distances are divided by it."""
    return distance if distance > _MIN_REFERENCE else math.nan


def body_windows(tracks: BodyTracks) -> tuple[FloatArray, IntArray]:
    """Return the windows of a motion, (n_windows, n_features), and the frames at their centres.

    They are scaled so that the Euclidean distance of two windows is the root mean square distance
    of their bone ends.
    """
    reach = int(_OFFSETS[-1]) * tracks.stride
    centers = np.arange(reach, len(tracks) - reach, _STEP * tracks.stride)
    positions = tracks.points[centers[:, None] + _OFFSETS * tracks.stride]
    local = tracks.facing_forward(positions, centers)
    n_points = len(_OFFSETS) * tracks.points.shape[1]
    return local.reshape(len(centers), 3 * n_points) / math.sqrt(n_points), centers


def nearest_distances(
    rows: FloatArray, others: FloatArray, order: IntArray | None = None, separation: float = 0.0
) -> FloatArray:
    """Return the distance of each row to the nearest row of `others`; infinity if there is none.

    `order` may be given if `rows` and `others` are the same array. It has a number for each row,
    and rows are compared only if their numbers differ by at least `separation`.
    """
    found = np.full(len(rows), np.inf)
    if not len(others):
        return found
    squares = (others**2).sum(axis=1)
    for start in range(0, len(rows), _CHUNK):
        part = slice(start, start + _CHUNK)
        squared = (rows[part] ** 2).sum(axis=1)[:, None] + squares - 2 * rows[part] @ others.T
        if order is not None:
            squared[np.abs(order[part, None] - order) < separation] = np.inf
        found[part] = np.sqrt(np.maximum(squared.min(axis=1), 0.0))
    return found
