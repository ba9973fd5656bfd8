"""Metrics whose trees are Euclidean trees with other heights.

If a metric is an increasing function of the Euclidean distance of converted points, the order of
merges is that of the converted points, and only heights are converted.
"""

from collections.abc import Iterator
from typing import Literal, TypeAlias, get_args

import numpy as np

from ._checks import FloatArray, Floats, raise_not_finite

Metric: TypeAlias = Literal["euclidean", "sqeuclidean", "cosine", "correlation"]

METRICS: tuple[str, ...] = get_args(Metric)

# Coordinates that are converted at a time: 1 MiB of float64.
_BLOCK = 1 << 17


def check_metric(metric: str) -> None:
    """Raise ValueError if a metric is not among `METRICS`."""
    if metric not in METRICS:
        raise ValueError(f"`metric` must be one of {', '.join(METRICS)}, got {metric!r}")


def converted_points(points: Floats, metric: str) -> Floats:
    """Return points whose Euclidean distances have the same order as the distances of a metric.

    For "cosine" and "correlation" the result is a float64 copy with rows of length 1. For other
    metrics it is `points` itself. Raises ValueError if a row cannot be scaled to length 1.
    """
    if metric in ("euclidean", "sqeuclidean"):
        return points
    unit = np.empty(points.shape)
    for start, rows in _blocks(unit):
        rows[...] = points[start : start + len(rows)]
        if metric == "correlation":
            _centre(rows)
        largest = np.abs(rows).max(axis=1)
        if not np.isfinite(largest).all():
            raise_not_finite(points)
        if not largest.all():
            row = start + int(np.argmin(largest))
            kind = "constant rows" if metric == "correlation" else "zero rows"
            raise ValueError(f"`points` must have no {kind} for metric {metric!r}, got row {row}")
        _scale(rows, largest)
        rows /= np.sqrt(np.einsum("ij,ij->i", rows, rows))[:, None]
    return unit


def convert_heights(heights: FloatArray, metric: str) -> None:
    """Convert ascending heights of `converted_points`, in place, to distances of `metric`."""
    _convert(heights, metric)
    if len(heights) and np.isinf(heights[-1]):
        raise ValueError("`points` must have squared distances below 1.8e308; scale the points")


def euclidean_limit(height: float, metric: str) -> float:
    """Return the largest Euclidean height that `convert_heights` converts to at most `height`."""
    # The bits of floats of at least 0 have the order of the floats.
    low, high = 0, int(np.array(np.inf).view(np.int64)) + 1
    while high - low > 1:
        middle = (low + high) // 2
        converted = np.array([middle]).view(np.float64)
        _convert(converted, metric)
        low, high = (middle, high) if converted[0] <= height else (low, middle)
    return float(np.array(low).view(np.float64))


def _convert(heights: FloatArray, metric: str) -> None:
    """Convert Euclidean heights to those of a metric, in place; an overflow gives infinity."""
    if metric == "euclidean":
        return
    with np.errstate(over="ignore", under="ignore"):
        np.square(heights, out=heights)
    if metric != "sqeuclidean":
        # |u - v|^2 = 2 (1 - u.v) for vectors of length 1.
        heights *= 0.5
        np.minimum(heights, 2.0, out=heights)


def _blocks(rows: FloatArray) -> Iterator[tuple[int, FloatArray]]:
    """Yield consecutive views of rows, each with the index of its first row."""
    step = max(1, _BLOCK // rows.shape[1])
    for start in range(0, len(rows), step):
        yield start, rows[start : start + step]


def _centre(rows: FloatArray) -> None:
    """Subtract from each row its mean, in place; equal coordinates become 0."""
    lowest, highest = rows.min(axis=1), rows.max(axis=1)
    _scale(rows, np.maximum(np.abs(lowest), np.abs(highest)))
    rows -= rows.mean(axis=1, keepdims=True)
    rows[lowest == highest] = 0.0


def _scale(rows: FloatArray, largest: FloatArray) -> None:
    """Scale each row by a power of two, in place, to a largest magnitude of about 1."""
    exponents = np.frexp(np.where(np.isfinite(largest), largest, 1.0))[1]
    np.ldexp(rows, -exponents[:, None], out=rows)
