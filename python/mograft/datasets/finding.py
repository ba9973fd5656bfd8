"""Find spans of a library that move like a query, or clips by words."""

from collections.abc import Iterable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray, IntArray
from mograft._util.validate import as_integer, check_type
from mograft.body.anatomy import feature_joints
from mograft.datasets.executors import call_each, check_executor
from mograft.errors import suggest_frames
from mograft.library.clip_keys import find_words
from mograft.library.library import Library
from mograft.motion.motion import Motion
from mograft.motion.resample import sample_clips
from mograft.search.boundary_states import pose_gaps
from mograft.search.constraints import Span, as_span, overlaps

_REFINED = 2  # times as many spans as are wanted are compared by their frames
_N_BLOCKS = 16  # of clips, which workers search
_WARPED_PAIRS = 1 << 18  # of frames that are compared at once
_MAX_WARPED_FRAMES = 600  # of the query; longer ones are compared at fewer times
_BAND_SHARE = 0.2  # maximum deviation from the constant rate, as a share of the segment
_STEPS = (2, 1, 3, 4)  # in half frames; ties go to the first, the constant rate
_BAND_ROWS = 8  # whose distances are computed together


@dataclass(frozen=True)
class Hit:
    """A span of a clip.

    Attributes
    ----------
    clip : str
        Name of the clip.
    start, stop : int
        First and last frame.
    distance : float
        Distance of its segments from those of the query, in cluster diameter thresholds: the root
        mean square over the segments, summed over the groups. For words the negative BM25 score.
    angle : float
        Mean angle between the joints of the span and of the query after time warping, in radians;
        NaN for words.
    """

    clip: str
    start: int
    stop: int
    distance: float
    angle: float


def find(
    library: Library,
    query: Motion | str | None = None,
    *,
    frames: Span | None = None,
    part: str | None = None,
    text: str | None = None,
    top: int = 20,
    executor: Executor | None = None,
) -> list[Hit]:
    """Find the spans of a library that are nearest to a motion, or the clips of a description.

    Parameters
    ----------
    library : Library
        The library.
    query : Motion or str, optional
        A motion, or the name of a clip. Without `text` it is required.
    frames : tuple of int, optional
        First and last frame of the query; whole segments that overlap them are compared. Default:
        all frames.
    part : str, optional
        The joint group that is compared. Default: all groups.
    text : str, optional
        Words of names, tags and descriptions of clips, as SQLite's FTS5 accepts them. With `query`
        only spans of the clips that match are returned.
    top : int
        Greatest number of spans.
    executor : concurrent.futures.Executor, optional
        The workers that compare spans, as for `write`. The result does not depend on it. Default:
        the calling thread.

    Returns
    -------
    list of Hit
        The spans, nearest first by `Hit.angle`; no two overlap, and none overlaps the query. For
        `text` alone whole clips, best first.

    Raises
    ------
    ValueError
        If neither `query` nor `text` is given; if a clip, group, frame or expression is invalid.
    SkeletonMismatchError
        If the query has another hierarchy.

    Notes
    -----
    A span has as many segments as the query. Its distance compares the points of both, one by one.
    The nearest ones are exact: products of matrices only exclude spans that are farther than the
    worst of the best ones. Twice `top` of them are then compared by all frames.

    Examples
    --------
    >>> import mograft as mg
    >>> from mograft.dancer import dance
    >>> library = mg.Library.build(dance(strides=1).motion)
    >>> hits = find(library, "dance", frames=(300, 360), top=3)
    >>> len(hits), hits[0].angle <= hits[1].angle
    (3, True)
    """
    check_type("library", library, Library)
    top = as_integer("top", top, 1)
    words = None if text is None else find_words(library.entries, text)
    if query is None:
        if words is None:
            raise ValueError("`query` or `text` is required, got neither")
        return [
            Hit(library.names[clip], 0, library.entries[clip].n_frames - 1, score, np.nan)
            for clip, score in words[:top]
        ]
    groups = library.groups.names if part is None else (part,)
    joints = np.unique(np.concatenate([library.joints(group) for group in groups]))
    check_executor(executor, library)
    whole, clip = library.resolve_base(query)
    own = whole.segments.of_clip(clip)
    if frames is not None:
        frames = as_span("frames", frames)
        last = whole.entries[clip].n_frames - 1
        if frames[1] > last:
            raise ValueError(f"`frames` must be within 0 to {last}, {suggest_frames(frames, last)}")
        own = own[overlaps(whole.segments[own], frames)]
    is_wanted = np.ones(len(library.segments), bool)
    if words is not None:
        is_wanted = np.isin(library.segments.clip, [index for index, _ in words])
    if clip < len(library.entries):
        cut = library.segments
        low, high = int(cut.start[own[0]]), int(cut.stop[own[-1]])
        is_wanted &= (cut.clip != clip) | (cut.stop <= low) | (cut.start >= high)
    wanted = _Query(whole, own, groups, joints, is_wanted, _REFINED * top)
    n_blocks = 1 if executor is None else _N_BLOCKS
    bounds = np.linspace(0, len(library.entries), n_blocks + 1)[1:-1]
    firsts = np.searchsorted(library.segments.clip, bounds)
    blocks = np.split(np.arange(len(is_wanted)), firsts)
    runs = np.concatenate(list(call_each(executor, _Query.nearest_runs, wanted, blocks)))
    runs = runs[np.lexsort(runs.T)][: wanted.count]
    parts = np.array_split(runs, n_blocks)
    hits = [hit for part in call_each(executor, _Query.compare, wanted, parts) for hit in part]
    return sorted(hits, key=lambda hit: (hit.angle, hit.clip, hit.start))[:top]


@dataclass(frozen=True, eq=False)
class _Query:
    """What is searched in a library."""

    library: Library  # in which the query is a clip
    own: IntArray  # the segments of the query
    groups: Sequence[str]
    joints: IntArray  # of all groups
    is_wanted: BoolArray  # whether each segment may be in a span
    count: int  # greatest number of runs

    def nearest_runs(self, block: IntArray) -> FloatArray:
        """Return the first segments of the nearest runs of as many segments as the query.

        Runs begin in `block`, segments of whole clips. Those that overlap a nearer one are left
        out. The rows of the result have the first segment of a run, and its distance.
        """
        library, own = self.library, self.own
        n, cut = len(own), library.segments
        blocked = np.concatenate([[0], np.cumsum(~self.is_wanted)])
        runs = block[: max(len(block) - n + 1, 0)]
        spaces = [
            (embedding.points, library.sigma[group])
            for group in self.groups
            if (embedding := library.embedding[group]) is not None and library.sigma[group] > 0
        ]

        def exact(runs: IntArray) -> FloatArray:
            """Return the sums of squared distances of the segments of runs and the query."""
            sums = np.zeros(len(runs))
            for offset in range(n):
                pairs = [(points[runs + offset], points[own[offset]], s) for points, s in spaces]
                gaps = [run / sigma - query / sigma for run, query, sigma in pairs]
                sums += np.sum([np.einsum("ij,ij->i", gap, gap) for gap in gaps], axis=0)
            return sums

        # |p - q|² = |p|² + |q|² - 2 p·q, up to rounding errors: `slack` is far above them.
        sums, slack = np.zeros(len(runs)), 0.0
        for points, sigma in spaces if len(runs) else ():
            table, queries = points[block[0] : block[-1] + 1], points[own] / sigma**2
            norms = np.einsum("ij,ij->i", table, table) / sigma**2
            slack += 1e-9 * n * float(norms.max())
            for offset, query in enumerate(queries):
                sums += norms[offset : offset + len(runs)]
                sums -= 2.0 * (table[offset : offset + len(runs)] @ query)
            sums += float((points[own] * queries).sum())
        is_valid = cut.clip[runs] == cut.clip[runs + n - 1]
        is_valid &= blocked[runs + n] == blocked[runs]
        runs, sums = runs[is_valid], sums[is_valid]
        wanted = min(self.count * (2 * n - 1), len(runs))  # a run overlaps n - 1 on either side
        if 0 < wanted < len(runs):
            bound = exact(runs[np.argpartition(sums, wanted - 1)[:wanted]]).max()
            runs = runs[sums <= bound + slack]
        sums = exact(runs)
        found = list[tuple[int, float]]()
        is_free = np.ones(len(self.is_wanted), bool)
        for row in np.lexsort((runs, sums)).tolist():
            segments = slice(int(runs[row]), int(runs[row]) + n)
            if is_free[segments].all():
                is_free[segments] = False
                found.append((segments.start, float(np.sqrt(sums[row] / n))))
            if len(found) == self.count:
                break
        return np.array(found).reshape(-1, 2)

    def compare(self, runs: FloatArray) -> list[Hit]:
        """Return the hits of runs, with their mean joint angle after time warping."""
        library, own = self.library, self.own
        cut, compared = library.segments, feature_joints(library.skeleton, self.joints)
        compared = np.setdiff1d(compared, [library.root]) if len(compared) > 1 else compared
        span = int(cut.start[own[0]]), int(cut.stop[own[-1]])
        n = min(span[1] - span[0], _MAX_WARPED_FRAMES)
        poses = _sample([library.clips[int(cut.clip[own[0]])]], [span], n + 1, compared)[0]
        size, names, hits = _WARPED_PAIRS // n**2 + 1, library.names, list[Hit]()
        for low in range(0, len(runs), size):
            batch = runs[low : low + size]
            first = batch[:, 0].astype(int)
            spans = np.stack([cut.clip[first], cut.start[first], cut.stop[first + len(own) - 1]])
            clips = (library.clips[clip] for clip in spans[0].tolist())
            gaps = gaps_in_band(poses, _sample(clips, spans[1:].T.tolist(), 2 * n + 1, compared))
            path = warping_path(gaps).astype(np.int64)[..., None]
            angles = np.take_along_axis(gaps, path, axis=2)[..., 0].mean(axis=1)
            found = zip(spans.T.tolist(), batch[:, 1].tolist(), angles.tolist(), strict=True)
            hits += [Hit(names[clip], *frames, *own) for (clip, *frames), *own in found]
        return hits


def _sample(
    clips: Iterable[Motion], spans: Iterable[Span], count: int, joints: IntArray
) -> FloatArray:
    """Return poses of spans of clips at `count` equal steps, shape (n_spans, count, n_joints, 4).

    As `resample_segments` does, but the spans of several clips at once.
    """
    tracks = [
        clip.rotations[start : stop + 1, joints]
        for clip, (start, stop) in zip(clips, spans, strict=True)
    ]
    last, steps = np.array([len(track) - 1 for track in tracks])[:, None], np.arange(count)
    whole, rest = np.divmod(steps * last, count - 1)  # a whole frame is exactly that frame
    rows = np.repeat(np.arange(len(tracks)), count)
    found = sample_clips(tracks, rows, (whole + rest / (count - 1)).ravel())
    return found.reshape(len(tracks), count, -1, 4)


def _band(n: int) -> int:
    """Return by how many columns a path may differ from the constant rate."""
    return max(round(2 * n * _BAND_SHARE), 1)


def gaps_in_band(poses: FloatArray, samples: FloatArray) -> FloatArray:
    """Return the distances that `warping_path` uses, between a motion and several others.

    `poses`, shape (n + 1, n_joints, 4), are those of the frames of the first motion, `samples`,
    shape (n_others, 2 n + 1, n_joints, 4), those of the others. The result, shape (n_others, n + 1,
    2 n + 1), has the `pose_gaps`, in radians, and zeros where no path passes.
    """
    n_others, width, *joint = samples.shape
    gaps, band = np.zeros((n_others, len(poses), width)), _band(len(poses) - 1)
    least, most, n = min(_STEPS), max(_STEPS), len(poses) - 1
    for row in range(0, n + 1, _BAND_ROWS):
        last = min(row + _BAND_ROWS - 1, n)
        low = max(2 * row - band, least * row, 2 * n - most * (n - row))
        high = min(2 * last + band, most * last, 2 * n - least * (n - last))
        own = samples[:, low : high + 1].reshape(-1, *joint)
        found = pose_gaps(poses[row : last + 1], own).reshape(last + 1 - row, n_others, -1)
        gaps[:, row : last + 1, low : high + 1] = found.swapaxes(0, 1)
    return gaps


def warping_path(distances: FloatArray) -> FloatArray:
    """Match each row of `distances` to a column by dynamic time warping; return the columns.

    `distances`, shape (..., n + 1, 2 n + 1), are between the frames of a first motion (rows) and
    the samples of a second one (columns), which has two samples per frame. The path has the
    smallest sum of distances among the paths with steps of 1 to 4 columns (half to double speed)
    that differ from the constant rate by at most a fifth of the length.

    Sakoe and Chiba, Dynamic programming algorithm optimization for spoken word recognition (1978),
    with slopes from ½ to 2 and a band.

    >>> warping_path(np.abs(np.arange(5)[:, None] * 2 - np.arange(9)))
    array([0, 2, 4, 6, 8])
    """
    *several, n_rows, width = distances.shape
    n, columns, longest = n_rows - 1, np.arange(width), max(_STEPS)
    band = _band(n)
    sums = np.full((*several, longest + width), np.inf)
    sums[..., longest] = distances[..., 0, 0]
    step_to = np.zeros(distances.shape, np.int8)
    for frame in range(1, n_rows):
        options = np.stack([sums[..., longest - step :][..., :width] for step in _STEPS])
        step_to[..., frame, :] = np.array(_STEPS)[options.argmin(axis=0)]
        total = options.min(axis=0) + distances[..., frame, :]
        sums[..., longest:] = np.where(np.abs(columns - 2 * frame) <= band, total, np.inf)
    path = np.full((*several, n_rows), 2 * n)
    for frame in range(n, 0, -1):
        steps = np.take_along_axis(step_to[..., frame, :], path[..., frame, None], axis=-1)
        path[..., frame - 1] = path[..., frame] - steps[..., 0]
    return path
