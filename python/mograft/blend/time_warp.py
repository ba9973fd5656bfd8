"""When a donor does what: its time bent to that of the segment whose place it takes."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray, IntArray
from mograft.analysis.segmentation import Segments
from mograft.motion.motion import Motion
from mograft.motion.resample import resample_segments
from mograft.search.candidates import pose_gaps

__all__ = ["TimeWarp", "warping_path"]

_BAND = 0.2
"""Share of a segment by which a donor may be ahead or behind."""
_GAIN = 0.05
_KNOTS = 5
"""Moments of the bent time that are kept, ends included: a path from frame to frame would shake."""


def warping_path(distances: FloatArray) -> FloatArray:
    """Find when one motion is most like another, by dynamic time warping.

    Parameters
    ----------
    distances : ndarray, shape (n + 1, 2 n + 1)
        How far each frame of the one is from each of the other, which has twice as many.

    Returns
    -------
    ndarray of int, shape (n + 1,)
        For each frame of the one the frame of the other, from the first to the last: of all
        with the least sum of distances that go on by 1 to 4 from frame to frame (half to twice
        the pace), and are never ahead or behind by more than a fifth.

    Notes
    -----
    Sakoe and Chiba, Dynamic programming algorithm optimization for spoken word recognition
    (1978), with a slope of ½ to 2 and a band.

    Examples
    --------
    >>> align(np.abs(np.arange(5)[:, None] * 2 - np.arange(9)))
    array([0, 2, 4, 6, 8])
    """
    n = len(distances) - 1
    at = np.arange(2 * n + 1)
    reach = max(round(2 * n * _BAND), 1)
    sums = np.full((n + 1, 2 * n + 1), np.inf)
    sums[0, 0] = distances[0, 0]
    came = np.zeros((n + 1, 2 * n + 1), np.int64)
    for frame in range(1, n + 1):
        before = np.concatenate([np.full(4, np.inf), sums[frame - 1]])
        # The even pace first, so that of equals it is taken.
        steps = np.stack([before[4 - step : 4 - step + len(at)] for step in _STEPS])
        best = steps.argmin(axis=0)
        came[frame] = np.array(_STEPS)[best]
        own = steps[best, at] + distances[frame]
        sums[frame] = np.where(np.abs(at - 2 * frame) <= reach, own, np.inf)
    path = np.full(n + 1, 2 * n)
    for frame in range(n, 0, -1):
        path[frame - 1] = path[frame] - came[frame, path[frame]]
    return path


_STEPS = (2, 1, 3, 4)


@dataclass(frozen=True, eq=False)
class TimeWarp:
    """How far each donor has come at any moment of the segment whose place it takes.

    Attributes
    ----------
    done : ndarray, shape (n_segments, 5)
        The shares of the donor that are over after 0, ¼, ½, ¾ and all of the segment.
    paces : ndarray, shape (n_segments, 5)
        How fast it goes on there; 1 is an even pace.
    is_bent : ndarray of bool, shape (n_segments,)
        Whether a donor's time is bent at all.
    """

    done: FloatArray
    paces: FloatArray
    is_bent: BoolArray

    @classmethod
    def of(
        cls,
        base: Motion,
        cut: Segments,
        donors: Segments,
        clips: Sequence[Motion],
        joints: IntArray,
    ) -> "TimeWarp":
        """Bend donors' times so that some joints do in them what they do in the base.

        Parameters
        ----------
        base : Motion
            The base.
        cut, donors : Segments
            Its segments and those that take their places.
        clips : sequence of Motion
            What `donors.clip` counts.
        joints : ndarray of int
            The joints that tell: those of the base group.

        Returns
        -------
        TimeWarp
            Bent only where that brings the joints nearer by 5 % or more, on the mean.
        """
        even = np.linspace(0.0, 1.0, _KNOTS)
        done = np.tile(even, (len(cut), 1))
        is_bent = np.zeros(len(cut), bool)
        lengths = cut.lengths
        for clip in np.unique(donors.clip):
            mine = np.flatnonzero((donors.clip == clip) & (lengths >= _KNOTS - 1))
            if not len(mine) or not len(joints):
                continue
            counts = 2 * lengths[mine] + 1
            track = np.ascontiguousarray(clips[clip].rotations[:, joints])
            rows = resample_segments(track, donors.start[mine], donors.stop[mine], counts)
            for at, poses in zip(mine, np.split(rows, np.cumsum(counts)[:-1]), strict=True):
                own = base.rotations[cut.start[at] : cut.stop[at] + 1, joints]
                bent = _bent(pose_gaps(own, poses))
                if bent is not None:
                    done[at], is_bent[at] = bent, True
        return cls(done, _slopes(done), is_bent)

    def at(self, segment: IntArray, share: FloatArray) -> FloatArray:
        """Return the shares of donors that are over after shares of their segments."""
        knot = np.minimum((share * (_KNOTS - 1)).astype(np.int64), _KNOTS - 2)
        width = 1.0 / (_KNOTS - 1)
        t = share / width - knot
        s = 1.0 - t
        a, b = self.done[segment, knot], self.done[segment, knot + 1]
        u, v = self.paces[segment, knot], self.paces[segment, knot + 1]
        over: FloatArray = (
            a * (s * s * (1.0 + 2.0 * t))
            + b * (t * t * (1.0 + 2.0 * s))
            + width * (u * t * s * s - v * t * t * s)
        )
        return over


def _bent(distances: FloatArray) -> FloatArray | None:
    """Return what is over at the knots, or None where an even pace is nearly as good."""
    n = len(distances) - 1
    even = float(distances[np.arange(n + 1), 2 * np.arange(n + 1)].sum())
    path = warping_path(distances) / (2 * n)
    shares = np.arange(n + 1) / n
    done = np.interp(np.linspace(0.0, 1.0, _KNOTS), shares, path)
    whole = TimeWarp(done[None], _slopes(done[None]), np.ones(1, bool))
    where = whole.at(np.zeros(n + 1, np.int64), shares) * (2 * n)
    low = np.minimum(where.astype(np.int64), 2 * n - 1)
    rows = np.arange(n + 1)
    near = distances[rows, low] * (low + 1 - where) + distances[rows, low + 1] * (where - low)
    return done if near.sum() < (1.0 - _GAIN) * even else None


def _slopes(done: FloatArray) -> FloatArray:
    """Return slopes at the knots of a curve that only rises (Fritsch and Carlson 1980)."""
    rises = np.diff(done, axis=1) * (_KNOTS - 1)
    inner = 2.0 * rises[:, 1:] * rises[:, :-1] / (rises[:, 1:] + rises[:, :-1])
    ends = [
        np.clip(1.5 * near - 0.5 * far, 0.0, 3.0 * near)
        for near, far in ((rises[:, 0], inner[:, 0]), (rises[:, -1], inner[:, -1]))
    ]
    slopes: FloatArray = np.column_stack([ends[0], inner, ends[1]])
    return slopes
