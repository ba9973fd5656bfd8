"""Trees, flat clusters and thresholds of exact complete linkage.

Memory is proportional to the number of points. Merges are ordered by the key (squared distance,
smaller of the two clusters' lowest point indices, larger of them), which makes the tree unique.
`docs/linkage.md` of mograft describes the algorithm.
"""

import os
import sys
from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from . import _checks
from ._kernels import kernels
from ._metrics import Metric, check_metric, convert_heights, converted_points, euclidean_limit


def linkage(
    points: npt.ArrayLike,
    *,
    metric: Metric = "euclidean",
    n_threads: int | None = None,
    memory_limit: int | None = None,
    max_memory: int | None = None,
    progress: Callable[[float], object] | None = None,
) -> _checks.FloatArray:
    """Cluster points hierarchically by complete linkage.

    Parameters
    ----------
    points : array_like, shape (n, n_axes)
        At least two points, in any unit.
    metric : {"euclidean", "sqeuclidean", "cosine", "correlation"}
        The distance of two points, as in `scipy.spatial.distance`. "cosine" is 1 minus the cosine
        of the angle between two points, seen from the origin. "correlation" is the same for points
        minus the mean of their coordinates.
    n_threads : int, optional
        Number of threads; the tree does not depend on it. Default: one per processor.
    memory_limit : int, optional
        Maximum size, in bytes, of a matrix of all distances, which takes ``8 * n**2``. The
        matrix is used for fewer than 1,449 points. It is also used if the algorithm without a
        matrix can exclude too few distances, as with many axes or equal distances. Other memory
        is proportional to n. Default: half of the available memory.
    max_memory : int, optional
        Number of bytes that the call may use beyond the points. Default: no limit.
    progress : callable, optional
        Called a few times per second with the fraction of finished merges, from 0 to 1. An
        exception that `progress` raises ends the computation.

    Returns
    -------
    ndarray, shape (n - 1, 4)
        The tree in SciPy's format: row `i` merges clusters `Z[i, 0] < Z[i, 1]` into cluster
        `n + i` of `Z[i, 3]` points at height `Z[i, 2]`, the greatest distance between their
        points, in the unit of the metric. The clusters 0 to `n` - 1 are the single points.

    Raises
    ------
    TypeError
        If the points are not real numbers.
    ValueError
        If there are fewer than two points, a point has no coordinate, a coordinate is not finite,
        `metric` is unknown, or `n_threads` or a limit is out of range. For "cosine", if all
        coordinates of a point are 0; for "correlation", if they are equal. For "sqeuclidean", if
        a height exceeds the range of float64.
    MemoryError
        If the call needs more than `max_memory`, estimated from the number of points before the
        computation, or the system refuses memory for the matrix.

    See Also
    --------
    cut : Flat clusters at one height, without computing the whole tree.

    Notes
    -----
    If all distances are different, the result equals
    ``scipy.cluster.hierarchy.linkage(points, "complete")`` bit for bit. If distances are equal,
    complete linkage has several valid trees, whose heights can differ: of 3,000 small point sets
    with ties, the heights of 167 differ from those of SciPy. Here, merges of equal height are
    ordered by the lowest point indices of the two clusters; the order in SciPy depends on its
    traversal of the matrix. Coordinates smaller than 2**-440 times the largest one count as 0;
    their squares underflow in SciPy.

    "sqeuclidean" has the tree of "euclidean" with squared heights. "cosine" and "correlation" have
    the Euclidean tree of a float64 copy of the points with rows of length 1, because
    ``|u - v|**2 == 2 * (1 - u @ v)`` for such rows; a height is half the square of the Euclidean
    one. Heights of these three metrics differ from those of SciPy by rounding.

    Examples
    --------
    >>> linkage([[0.0], [1.0], [5.0]])
    array([[0., 1., 1., 2.],
           [2., 3., 5., 3.]])
    """
    check_metric(metric)
    limits = _limits(n_threads, memory_limit, kernels.available_memory() // 2, max_memory)
    converted = converted_points(_checks.as_points(points, 2), metric)
    tree = kernels.linkage(converted, *limits, progress)
    convert_heights(tree[:, 2], metric)
    return tree


def cut(
    points: npt.ArrayLike,
    max_diameter: float,
    *,
    metric: Metric = "euclidean",
    n_threads: int | None = None,
    memory_limit: int | None = None,
    max_memory: int | None = None,
    progress: Callable[[float], object] | None = None,
) -> _checks.IntArray:
    """Return the flat clusters of `linkage` at a height, without computing the tree above it.

    Parameters
    ----------
    points : array_like, shape (n, n_axes)
        The points, in any unit; n may be 0.
    max_diameter : float
        Greatest distance between two points of a cluster, inclusive, in the unit of the metric.
        0 merges only equal points.
    metric, n_threads, memory_limit, max_memory, progress
        As for `linkage`.

    Returns
    -------
    ndarray of int64, shape (n,)
        The cluster of each point, numbered from 0 in the order of their first points.

    Raises
    ------
    TypeError, ValueError, MemoryError
        As for `linkage`, and if `max_diameter` is negative, NaN or not a number.

    Notes
    -----
    The partition equals ``scipy.cluster.hierarchy.fcluster(linkage(points), max_diameter,
    "distance")`` for all metrics. The `distance_threshold` of scikit-learn is exclusive: it does
    not merge at exactly the threshold.

    Examples
    --------
    >>> cut([[0.0], [9.0], [1.0], [8.0]], max_diameter=2.0)
    array([0, 1, 0, 1])
    """
    check_metric(metric)
    limit = euclidean_limit(_checks.as_height("max_diameter", max_diameter), metric)
    limits = _limits(n_threads, memory_limit, kernels.available_memory() // 2, max_memory)
    converted = converted_points(_checks.as_points(points, 0), metric)
    return kernels.cut(converted, limit, *limits, progress)


def linkage_condensed(
    distances: npt.ArrayLike,
    *,
    n_threads: int | None = None,
    memory_limit: int | None = None,
    max_memory: int | None = None,
    progress: Callable[[float], object] | None = None,
) -> _checks.FloatArray:
    """Cluster hierarchically by complete linkage under given distances.

    Parameters
    ----------
    distances : array_like, shape (n * (n - 1) / 2,)
        The distance of each pair, in the order of `scipy.spatial.distance.pdist`: (0, 1),
        (0, 2), ..., (1, 2), .... They need not satisfy the triangle inequality.
    n_threads, max_memory, progress
        As for `linkage`.
    memory_limit : int, optional
        Maximum size, in bytes, of the full matrix, which is twice as large as `distances`. If the
        limit is lower, a copy of `distances` is used on one thread, which is several times slower.
        Default: no limit.

    Returns
    -------
    ndarray, shape (n - 1, 4)
        The tree, as for `linkage`.

    Raises
    ------
    TypeError
        If the distances are not real numbers.
    ValueError
        If a distance is negative or not finite, the number of distances is not n(n-1)/2 for any
        n of at least 2, or `n_threads` or a limit is out of range.
    MemoryError
        As for `linkage`.

    Notes
    -----
    The result equals that of SciPy bit for bit if all distances are different; with ties, see
    `linkage`.

    Examples
    --------
    >>> linkage_condensed([2.0, 6.0, 5.0])
    array([[0., 1., 2., 2.],
           [2., 3., 6., 3.]])
    """
    condensed = _checks.as_floats("distances", distances)
    if condensed.ndim != 1 or len(condensed) < 1:
        raise ValueError(f"`distances` must have shape (n_pairs >= 1,), got {condensed.shape}")
    # The full matrix holds every distance twice, and a diagonal of n * 8 bytes.
    limits = _limits(n_threads, memory_limit, 32 * condensed.size + 64, max_memory)
    return kernels.linkage_condensed(condensed, *limits, progress)


def threshold(points: npt.ArrayLike, kind: str = "rms", scale: float = 1.0) -> float:
    """Return a diameter for `cut` from the distances between the points and their mean.

    Parameters
    ----------
    points : array_like, shape (n, n_axes)
        The points, at least one.
    kind : {"rms", "literal"}
        "rms" is the square root of the mean of d squared, where d is the distance of a point
        from the mean of all points. "literal" is the square root of the mean of d.
    scale : float
        Factor on the result.

    Returns
    -------
    float
        The diameter, in the unit of the points for "rms".

    Raises
    ------
    TypeError
        If the points are not real numbers, or `scale` is not a number.
    ValueError
        If there is no point or a coordinate is not finite, `kind` is another, or `scale` is
        negative or not finite.

    Notes
    -----
    "literal" is equation 14 of the paper on *analogic transplanting* (W. Jang, I.-K. Lee, J. Lee)
    as printed. It is the square root of a length, so the clusters depend on the unit of the points.
    "rms", the standard deviation, is proportional to the points.

    Examples
    --------
    >>> threshold([[-1.0], [1.0], [-7.0], [7.0]])
    5.0
    """
    _checks.check_amount("scale", scale)
    if kind not in ("rms", "literal"):
        raise ValueError(f"`kind` must be 'rms' or 'literal', got {kind!r}")
    cloud = _checks.as_points(points, 1).astype(np.float64, copy=False)
    if not np.isfinite(cloud).all():
        _checks.raise_not_finite(cloud)
    squared = np.square(cloud - cloud.mean(axis=0)).sum(axis=1)
    return float(scale * np.sqrt(np.mean(squared if kind == "rms" else np.sqrt(squared))))


def _limits(
    n_threads: int | None, memory_limit: int | None, default_limit: int, max_memory: int | None
) -> tuple[int, int, int | None]:
    """Return the number of threads, the maximum size of a matrix and `max_memory`, checked."""
    # The kernels take 64-bit integers, and no larger number has another effect.
    wanted = (os.cpu_count() or 1) if n_threads is None else n_threads
    n_threads = min(_checks.as_count("n_threads", wanted, 1), sys.maxsize)
    if max_memory is not None:
        max_memory = min(_checks.as_count("max_memory", max_memory, 0), sys.maxsize)
    limit = default_limit
    if memory_limit is not None:
        limit = min(_checks.as_count("memory_limit", memory_limit, 0), sys.maxsize)
    return n_threads, limit, max_memory
