"""The scale of the cluster diameter threshold, chosen from the error of exchanged parts."""

import warnings
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from mograft._standalone.mograft_linkage import linkage, threshold
from mograft._standalone.mograft_linkage.dendrogram import fcluster
from mograft._util.arrays import FloatArray, IntArray
from mograft._util.linalg import product
from mograft.analysis.embedding import Embedding
from mograft.config import Config, variety_fields

SCALES: FloatArray = np.geomspace(
    variety_fields(0.0)["sigma_scale"], variety_fields(1.0)["sigma_scale"], 39
)
"""Scales that are tried, ascending: from variety 0 to variety 1; the one in the middle is 0.75."""
TOLERANCE = 0.1
"""Share by which the error within clusters may exceed that of repetitions."""
MIN_SEGMENTS = 20
"""Number of segments below which no scale is chosen."""
_MAX_SEGMENTS = 3000
_CHUNK = 256


@dataclass(frozen=True, eq=False)
class ScaleCurve:
    """The error of exchanged parts for each scale of the threshold, and the scale that is chosen.

    The held-out parts of a segment are its parts in all other groups. An error is the mean squared
    distance between the held-out parts of two segments, divided by that of two random segments. An
    error of 1 is therefore that of chance.

    Attributes
    ----------
    scales : ndarray, shape (n_scales,)
        The scales, ascending.
    errors : ndarray, shape (n_scales,)
        The error between segments of one cluster; NaN if no cluster has two segments.
    repetition_error : float
        The error between a segment and its repetition: the nearest other segment in this group
        that is not next to it in time.
    """

    scales: FloatArray
    errors: FloatArray
    repetition_error: float

    @property
    def limit(self) -> float:
        """1.1 times `repetition_error`."""
        return (1.0 + TOLERANCE) * self.repetition_error

    @property
    def scale(self) -> float:
        """The largest scale whose error is at most `limit`; the smallest scale if none is."""
        return self.scale_at(TOLERANCE)

    def scale_at(self, tolerance: float) -> float:
        """Return the largest scale whose error exceeds `repetition_error` by at most `tolerance`.

        `tolerance` is a share of `repetition_error`. The result is the smallest scale if none fits.
        """
        within = np.flatnonzero(self.errors <= (1.0 + tolerance) * self.repetition_error)
        return float(self.scales[within[-1] if len(within) else 0])


def cluster_thresholds(
    embedding: Mapping[str, Embedding | None], config: Config
) -> dict[str, float]:
    """Return the cluster diameter threshold of each group; 0 for a group without an embedding.

    If `config.sigma_scale` is "auto", a scale is chosen for each group. A group for which this is
    impossible has the default scale, with a warning.
    """
    sigma: dict[str, float] = {}
    for group, embedded in embedding.items():
        if embedded is None:
            sigma[group] = 0.0
            continue
        scale = config.sigma_scale
        if isinstance(scale, str):
            # A number as `sigma` is the threshold itself, without a scale.
            is_scaled = isinstance(config.sigma, str)
            scale = _chosen_scale(embedding, group, config) if is_scaled else 1.0
        sigma[group] = threshold(embedded.points, config.sigma, scale)
    return sigma


def scale_of_threshold(embedded: Embedding | None, sigma: float, config: Config) -> float:
    """Return the scale that gave a group the cluster diameter threshold `sigma`.

    It is `config.sigma_scale` if that is a number. If it is "auto", the result is the scale of
    `SCALES` that is nearest to the quotient of the threshold and the spread of the points.
    """
    given = config.sigma_scale
    if not isinstance(given, str):
        return given
    spread = 0.0 if embedded is None else threshold(embedded.points, config.sigma)
    if not (spread > 0 and sigma > 0):
        return float(Config.sigma_scale)
    return float(SCALES[np.abs(np.log(SCALES * spread / sigma)).argmin()])


def scale_curve(
    embedding: Mapping[str, Embedding | None], group: str, config: Config
) -> ScaleCurve | None:
    """Return the error of exchanged parts for the clusters of a group at each scale.

    `embedding` holds the embeddings of all groups for the same segments, in order of time. The
    result is None if there are fewer than 20 segments, or if no other group has an embedding. Of
    more than 3000 segments, 3000 at equal intervals are clustered.

    Notes
    -----
    The repetition of a segment is the nearest other segment in `group`, without the segments
    immediately before and after it. For the points x of another group, the error of two segments is
    |x_i - x_j|² / (2 · total variance of x), which is 1 on average for independent segments. Errors
    are means over the other groups, and over segments: each segment contributes the mean over the
    other members of its cluster.
    """
    own = embedding[group]
    parts = [known.points for name, known in embedding.items() if name != group and known]
    if own is None or not parts or len(own.points) < MIN_SEGMENTS:
        return None
    n = len(own.points)
    rows = np.unique(np.linspace(0, n - 1, _MAX_SEGMENTS).round().astype(int))
    held_out = _joined_parts(parts)
    nearest = _nearest_repetitions(own.points, rows)
    repetition_error = float(np.square(held_out[rows] - held_out[nearest]).sum(axis=1).mean())
    tree = linkage(own.points[rows])
    diameters = threshold(own.points, config.sigma) * SCALES
    errors = np.array(
        [_error_within(held_out[rows], fcluster(tree, float(d)) - 1) for d in diameters]
    )
    return ScaleCurve(SCALES, errors, repetition_error)


def _chosen_scale(embedding: Mapping[str, Embedding | None], group: str, config: Config) -> float:
    """Return the scale of a group; warn and return the default if none can be chosen."""
    curve = scale_curve(embedding, group, config)
    if curve is not None:
        return curve.scale
    own = embedding[group]
    n = 0 if own is None else len(own.points)
    reason = "no other group can be compared"
    if n < MIN_SEGMENTS:
        reason = f"{n} segments are fewer than {MIN_SEGMENTS}"
    warnings.warn(
        f"group {group}: sigma_scale cannot be chosen, because {reason}; "
        f"{Config.sigma_scale} is used",
        stacklevel=2,
    )
    return float(Config.sigma_scale)


def _joined_parts(parts: list[FloatArray]) -> FloatArray:
    """Join the points of each segment in several groups to one point; groups have equal weights.

    The mean squared distance of two random rows is 1. Groups without variance are left out.
    """
    centred = [points - points.mean(axis=0) for points in parts]
    spreads = [2.0 * float(np.square(points).sum()) / (len(points) - 1) for points in centred]
    kept = [points / np.sqrt(s) for points, s in zip(centred, spreads, strict=True) if s > 0]
    if not kept:
        return np.zeros((len(parts[0]), 1))
    joined: FloatArray = np.concatenate(kept, axis=1) / np.sqrt(len(kept))
    return joined


def _nearest_repetitions(points: FloatArray, rows: IntArray) -> IntArray:
    """Return for each of `rows` the nearest point that is not the row or a row next to it."""
    squares = np.square(points).sum(axis=1)
    nearest = []
    for start in range(0, len(rows), _CHUNK):
        chunk = rows[start : start + _CHUNK]
        distances = squares[None] - 2.0 * product(points[chunk], points.T)
        for offset in (-1, 0, 1):
            beside = np.clip(chunk + offset, 0, len(points) - 1)
            distances[np.arange(len(chunk)), beside] = np.inf
        nearest.append(distances.argmin(axis=1))
    return np.concatenate(nearest)


def _error_within(points: FloatArray, labels: IntArray) -> float:
    """Return the mean squared distance of a point to the other points of its cluster.

    The mean is over all points in clusters of two or more; NaN if there is none.
    """
    sizes = np.bincount(labels)
    sums = np.stack([np.bincount(labels, axis) for axis in points.T], axis=1)
    squares = np.bincount(labels, np.square(points).sum(axis=1))
    is_several = sizes > 1
    n = sizes[is_several]
    if not len(n):
        return float("nan")
    # The sum over pairs i < j of |x_i - x_j|² is n Σ|x|² - |Σx|².
    pairs = n * squares[is_several] - np.square(sums[is_several]).sum(axis=1)
    return float((2.0 * np.maximum(pairs, 0.0) / (n - 1)).sum() / n.sum())
