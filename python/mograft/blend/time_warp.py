"""Alignment of donors in time: at a constant rate, or by dynamic time warping."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray, IntArray
from mograft.motion.motion import Motion
from mograft.motion.resample import resample_segments
from mograft.motion.segments import Segments
from mograft.search.boundary_states import pose_gaps

_BAND_SHARE = 0.2  # maximum deviation from the constant rate, as a share of the segment
_MIN_GAIN = 0.05  # minimum relative reduction of the mean distance; else a donor is not warped
_N_KNOTS = 5  # knots of a warp, ends included; a knot in every frame would cause jitter
_STEPS = (2, 1, 3, 4)  # in half frames; ties go to the first, the constant rate


_BAND_ROWS = 8  # whose distances are computed together


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


@dataclass(frozen=True, eq=False)
class TimeWarp:
    """For each base segment, a map from its own elapsed fraction to that of its donor."""

    shares: FloatArray  # (n_segments, 5): of the donor, after 0, ¼, ½, ¾ and 1 of the segment
    is_warped: BoolArray  # (n_segments,)

    @cached_property
    def slopes(self) -> FloatArray:
        """Slopes of the map at its knots, shape (n_segments, 5); 1 if a donor is not warped.

        The map is a monotone cubic (Fritsch and Carlson 1980).
        """
        rises = np.diff(self.shares, axis=1) * (_N_KNOTS - 1)
        inner = 2.0 * rises[:, 1:] * rises[:, :-1] / (rises[:, 1:] + rises[:, :-1])
        first, last = (
            np.clip(1.5 * near - 0.5 * far, 0.0, 3.0 * near)
            for near, far in ((rises[:, 0], inner[:, 0]), (rises[:, -1], inner[:, -1]))
        )
        return np.column_stack([first, inner, last])

    @classmethod
    def by_dtw(
        cls,
        base: Motion,
        cut: Segments,
        donors: Segments,
        clips: Sequence[Motion],
        joints: IntArray,
    ) -> "TimeWarp":
        """Warp donors in time so that their poses of the given joints best match those of the base.

        A donor is warped only if this reduces its mean joint angle to the base by more than 5 %.
        """
        constant = np.linspace(0.0, 1.0, _N_KNOTS)
        shares = np.tile(constant, (len(cut), 1))
        is_warped = np.zeros(len(cut), bool)
        lengths = cut.lengths
        for clip in np.unique(donors.clip):
            rows = np.flatnonzero((donors.clip == clip) & (lengths >= _N_KNOTS - 1))
            if not len(rows) or not len(joints):
                continue
            counts = 2 * lengths[rows] + 1
            track = np.ascontiguousarray(clips[clip].rotations[:, joints])
            samples = resample_segments(track, donors.start[rows], donors.stop[rows], counts)
            for row, poses in zip(rows, np.split(samples, np.cumsum(counts)[:-1]), strict=True):
                base_poses = base.rotations[cut.start[row] : cut.stop[row] + 1, joints]
                knots = _warped_knots(pose_gaps(base_poses, poses))
                if knots is not None:
                    shares[row], is_warped[row] = knots, True
        return cls(shares, is_warped)

    def donor_share(self, segment: IntArray, share: FloatArray) -> FloatArray:
        """Return the elapsed fractions of donors, given those of their base segments, `share`."""
        knot = np.minimum((share * (_N_KNOTS - 1)).astype(np.int64), _N_KNOTS - 2)
        width = 1.0 / (_N_KNOTS - 1)
        t = share / width - knot
        s = 1.0 - t
        a, b = self.shares[segment, knot], self.shares[segment, knot + 1]
        u, v = self.slopes[segment, knot], self.slopes[segment, knot + 1]
        return (
            a * (s * s * (1.0 + 2.0 * t))
            + b * (t * t * (1.0 + 2.0 * s))
            + width * (u * t * s * s - v * t * t * s)
        )


Alignment = Callable[[Motion, Segments, Segments, Sequence[Motion], IntArray], TimeWarp]

ALIGNMENTS: dict[str, Alignment | None] = {"uniform": None, "dtw": TimeWarp.by_dtw}
"""The function of each value of `Config.alignment`; None for a constant rate."""


def _warped_knots(distances: FloatArray) -> FloatArray | None:
    """Return the donor's elapsed fractions at the knots, or None if warping gains too little."""
    n = len(distances) - 1
    rows = np.arange(n + 1)
    constant_sum = float(distances[rows, 2 * rows].sum())
    path = warping_path(distances) / (2 * n)
    shares = rows / n
    knots = np.interp(np.linspace(0.0, 1.0, _N_KNOTS), shares, path)
    warp = TimeWarp(knots[None], np.ones(1, bool))
    columns = warp.donor_share(np.zeros(n + 1, np.int64), shares) * (2 * n)
    low = np.minimum(columns.astype(np.int64), 2 * n - 1)
    warped = distances[rows, low] * (low + 1 - columns)
    warped += distances[rows, low + 1] * (columns - low)
    return knots if warped.sum() < (1.0 - _MIN_GAIN) * constant_sum else None
