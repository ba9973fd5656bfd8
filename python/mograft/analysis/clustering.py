"""Exact complete-linkage clustering in memory proportional to the number of points.

Merges are ordered by the key (squared distance, smaller of the two clusters' lowest point indices,
larger of them), which makes the tree unique. `docs/linkage.md` describes the algorithm.
"""

import operator
import os
from collections.abc import Callable
from typing import Self

import numpy as np
import numpy.typing as npt

from mograft import _core
from mograft._util.arrays import FloatArray, IntArray, as_floats


def linkage(
    points: npt.ArrayLike,
    *,
    threads: int | None = None,
    memory_limit: int | None = None,
    progress: Callable[[float], object] | None = None,
) -> FloatArray:
    """Cluster points hierarchically by complete linkage under the Euclidean distance.

    Parameters
    ----------
    points : array_like, shape (n, n_axes)
        The points, at least one, in any unit.
    threads : int, optional
        Number of threads; the tree does not depend on it. Default: one per processor.
    memory_limit : int, optional
        Maximum size, in bytes, of a matrix of all distances, which takes ``8 * n**2``. It is
        used for fewer than 1,449 points, and if too few distances can be excluded for the
        algorithm without a matrix, as with many axes and equal distances. Other memory is
        proportional to n. Default: half of the available memory.
    progress : callable, optional
        Called a few times per second with the fraction of finished merges, from 0 to 1. An
        exception that `progress` raises ends the computation.

    Returns
    -------
    ndarray, shape (n - 1, 4)
        The tree in SciPy's format: row `i` merges clusters `Z[i, 0] < Z[i, 1]` into cluster
        `n + i` of `Z[i, 3]` points at height `Z[i, 2]`, the greatest distance between their
        points, in the unit of the points. Clusters below `n` are single points.

    Raises
    ------
    TypeError
        If the points are not real numbers.
    ValueError
        If there is no point, a point has no coordinate, a coordinate is not finite, or `threads`
        or `memory_limit` is out of range.
    MemoryError
        If the system refuses memory for the matrix.

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

    Examples
    --------
    >>> linkage([[0.0], [1.0], [5.0]])
    array([[0., 1., 1., 2.],
           [2., 3., 5., 3.]])
    """
    memory = _as_memory(memory_limit, _core.available_memory() // 2)
    return _core.linkage(_as_points(points), _as_threads(threads), memory, progress)


def cut(
    points: npt.ArrayLike,
    max_diameter: float,
    *,
    threads: int | None = None,
    memory_limit: int | None = None,
    progress: Callable[[float], object] | None = None,
) -> IntArray:
    """Return the flat clusters of `linkage` at a height, without computing the tree above it.

    Parameters
    ----------
    points : array_like, shape (n, n_axes)
        The points, in any unit; n may be 0.
    max_diameter : float
        Greatest distance between two points of a cluster, inclusive, in the unit of the points.
        0 merges only equal points.
    threads, memory_limit, progress
        As for `linkage`.

    Returns
    -------
    ndarray of int64, shape (n,)
        The cluster of each point, numbered from 0 in the order of their first points.

    Raises
    ------
    TypeError, ValueError
        As for `linkage`, and if `max_diameter` is negative or NaN.

    Notes
    -----
    The partition equals ``scipy.cluster.hierarchy.fcluster(linkage(points), max_diameter,
    "distance")``. The `distance_threshold` of scikit-learn is exclusive: it does not merge at
    exactly the threshold.

    Examples
    --------
    >>> cut([[0.0], [9.0], [1.0], [8.0]], max_diameter=2.0)
    array([0, 1, 0, 1])
    """
    diameter = float(max_diameter)
    if not diameter >= 0.0:
        raise ValueError(f"`max_diameter` must be 0 or more, got {max_diameter}")
    memory = _as_memory(memory_limit, _core.available_memory() // 2)
    array = _as_points(points, min_points=0)
    return _core.cut(array, diameter, _as_threads(threads), memory, progress)


def linkage_condensed(
    distances: npt.ArrayLike,
    *,
    threads: int | None = None,
    memory_limit: int | None = None,
    progress: Callable[[float], object] | None = None,
) -> FloatArray:
    """Cluster hierarchically by complete linkage under given distances.

    Parameters
    ----------
    distances : array_like, shape (n * (n - 1) / 2,)
        The distance of each pair, in the order of `scipy.spatial.distance.pdist`: (0, 1),
        (0, 2), ..., (1, 2), .... They need not satisfy the triangle inequality.
    threads, progress
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
        n, or `threads` or `memory_limit` is out of range.

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
    condensed = as_floats("distances", distances, ("n_pairs",))
    # The full matrix holds every distance twice, and a diagonal of n * 8 bytes.
    memory = _as_memory(memory_limit, 4 * condensed.nbytes + 64)
    return _core.linkage_condensed(condensed, _as_threads(threads), memory, progress)


def threshold(points: npt.ArrayLike, kind: str | float = "rms", scale: float = 1.0) -> float:
    """Return a diameter for `cut` from the distances between the points and their mean.

    Parameters
    ----------
    points : array_like, shape (n, n_axes)
        The points, at least one.
    kind : {"rms", "literal"} or float
        "rms" is the square root of the mean of d squared, where d is the distance of a point
        from the mean of all points. "literal" is the square root of the mean of d. A number is
        returned unchanged.
    scale : float
        Factor for "rms" and "literal".

    Returns
    -------
    float
        The diameter, in the unit of the points for "rms".

    Raises
    ------
    TypeError
        If the points are not real numbers.
    ValueError
        If there is no point or a coordinate is not finite, `kind` is another string, or a number
        is negative or not finite.

    Notes
    -----
    "literal" is equation 14 of the paper as printed: the square root of a length, so the clusters
    depend on the unit of the points. "rms", the standard deviation, scales with the points.

    Examples
    --------
    >>> threshold([[-1.0], [1.0], [-7.0], [7.0]])
    5.0
    """
    _check_amount("scale", scale)
    if not isinstance(kind, str):
        _check_amount("kind", kind)
        return float(kind)
    if kind not in ("rms", "literal"):
        raise ValueError(f"`kind` must be 'rms', 'literal' or a number, got {kind!r}")
    cloud = _as_points(points)
    squared = np.square(cloud - cloud.mean(axis=0)).sum(axis=1)
    return float(scale * np.sqrt(np.mean(squared if kind == "rms" else np.sqrt(squared))))


class CompleteLinkage:
    """Complete linkage with the interface of a scikit-learn estimator.

    Parameters
    ----------
    max_diameter : float, optional
        Greatest height of a merge, inclusive, in the unit of the points. Default: `threshold` of
        the points, unless `n_clusters` is given.
    n_clusters : int, optional
        Number of clusters, instead of `max_diameter`.
    threads : int, optional
        As for `linkage`.

    Attributes
    ----------
    labels_ : ndarray of int64, shape (n,)
        The cluster of each point, numbered from 0 in the order of their first points.
    n_clusters_, n_leaves_, n_features_in_ : int
        The number of clusters, of points and of axes.
    children_ : ndarray of int64, shape (n - 1, 2)
        The clusters of each merge, as in `linkage`.
    distances_ : ndarray, shape (n - 1,)
        The heights of the merges.

    See Also
    --------
    cut : The labels alone, faster.

    Notes
    -----
    `max_diameter` is inclusive, and the `distance_threshold` of scikit-learn is exclusive:
    ``max_diameter=np.nextafter(t, 0)`` corresponds to
    ``AgglomerativeClustering(distance_threshold=t)``.

    Examples
    --------
    >>> model = CompleteLinkage(n_clusters=2).fit([[0.0], [9.0], [1.0], [8.0]])
    >>> model.labels_, model.distances_
    (array([0, 1, 0, 1]), array([1., 1., 9.]))
    """

    _estimator_type = "clusterer"

    def __init__(
        self,
        max_diameter: float | None = None,
        *,
        n_clusters: int | None = None,
        threads: int | None = None,
    ) -> None:
        self.max_diameter = max_diameter
        self.n_clusters = n_clusters
        self.threads = threads

    def __repr__(self) -> str:
        default = CompleteLinkage().get_params()
        given = (f"{k}={v!r}" for k, v in self.get_params().items() if v is not default[k])
        return f"{type(self).__name__}({', '.join(given)})"

    def get_params(self, deep: bool = True) -> dict[str, object]:  # noqa: ARG002, FBT001, FBT002
        """Return the parameters by name; `deep` exists because scikit-learn passes it."""
        return {name: getattr(self, name) for name in ("max_diameter", "n_clusters", "threads")}

    def set_params(self, **params: object) -> Self:
        """Set parameters by name and return the estimator; an unknown name raises ValueError."""
        for name, value in params.items():
            if name not in self.get_params():
                known = ", ".join(self.get_params())
                raise ValueError(f"`params` must be among {known}, got {name!r}")
            setattr(self, name, value)
        return self

    def fit(self, X: npt.ArrayLike, y: object = None) -> Self:  # noqa: ARG002
        """Cluster at least two points, shape (n, n_axes), and return the estimator; `y` is ignored.

        Raises
        ------
        TypeError, ValueError
            As for `linkage`, and if both `max_diameter` and `n_clusters` are given, or
            `n_clusters` is greater than the number of points.
        """
        if self.max_diameter is not None and self.n_clusters is not None:
            raise ValueError(
                "max_diameter and n_clusters must not both be given, got "
                f"{self.max_diameter} and {self.n_clusters}"
            )
        points = _as_samples(X)
        n = len(points)
        if self.n_clusters is not None and not 1 <= self.n_clusters <= n:
            raise ValueError(
                f"`n_clusters` must be between 1 and n_samples = {n}, got {self.n_clusters}"
            )
        tree = linkage(points, threads=self.threads)
        if self.n_clusters is not None:
            n_merges = n - self.n_clusters
        else:
            diameter = threshold(points) if self.max_diameter is None else self.max_diameter
            _check_amount("max_diameter", diameter)
            n_merges = int(np.searchsorted(tree[:, 2], diameter, side="right"))
        self.labels_ = _labels(tree, n_merges)
        self.n_clusters_ = n - n_merges
        self.n_leaves_ = n
        self.n_features_in_ = points.shape[1]
        self.children_ = tree[:, :2].astype(np.int64)
        self.distances_ = tree[:, 2].copy()
        return self

    def fit_predict(self, X: npt.ArrayLike, y: object = None) -> IntArray:
        """Cluster points and return `labels_`; see `fit`."""
        return self.fit(X, y).labels_

    def __sklearn_tags__(self) -> object:
        # Only scikit-learn calls this, so it is installed.
        from sklearn.utils import Tags, TargetTags  # type: ignore[import-untyped,unused-ignore]

        return Tags(estimator_type="clusterer", target_tags=TargetTags(required=False))


def _labels(tree: FloatArray, n_merges: int) -> IntArray:
    """Label the points by their clusters after the first `n_merges` merges of a tree."""
    n = len(tree) + 1
    # The cluster that contains each cluster at the end, from the last merge down to the points.
    top = np.arange(2 * n - 1)
    for i in range(n_merges - 1, -1, -1):
        top[tree[i, :2].astype(np.int64)] = top[n + i]
    _, first, cluster = np.unique(top[:n], return_index=True, return_inverse=True)
    return np.argsort(np.argsort(first))[cluster].astype(np.int64)


def _as_samples(points: npt.ArrayLike) -> FloatArray:
    """Check points; the messages have the phrases that scikit-learn's estimator checks expect."""
    if hasattr(points, "toarray"):
        raise TypeError("X must be dense, got a sparse matrix")
    array = np.asarray(points)
    if np.iscomplexobj(array):
        raise ValueError(f"X must be real: Complex data not supported, got {array.dtype}")
    if array.ndim != 2:
        raise ValueError(f"X must be 2-D, got {array.ndim}-D. Reshape your data")
    n, n_axes = array.shape
    if n_axes < 1:
        raise ValueError(
            f"X has 0 feature(s) (shape={array.shape}) while a minimum of 1 is required."
        )
    if n < 2:
        raise ValueError(f"X must hold 2 points or more, got {n} sample(s): n_samples = {n}")
    floats = array.astype(np.float64)
    if not np.isfinite(floats).all():
        raise ValueError("X must be finite, got NaN or infinity (inf)")
    return floats


def _as_points(points: npt.ArrayLike, min_points: int = 1) -> FloatArray:
    array = as_floats("points", points)
    if array.ndim == 1:
        raise ValueError(
            "`points` must have shape (n, n_axes), got one dimension; linkage_condensed takes the "
            "distances of scipy.spatial.distance.pdist"
        )
    array = as_floats("points", array, ("n", "n_axes"))
    if array.shape[0] < min_points or array.shape[1] < 1:
        raise ValueError(
            f"`points` must have shape (n >= {min_points}, n_axes >= 1), got {array.shape}"
        )
    return array


def _as_threads(threads: int | None) -> int:
    return os.cpu_count() or 1 if threads is None else _as_count("threads", threads, 1)


def _as_memory(limit: int | None, default: int) -> int:
    return default if limit is None else _as_count("memory_limit", limit, 0)


def _as_count(name: str, value: int, minimum: int) -> int:
    count = operator.index(value)
    if count < minimum:
        raise ValueError(f"`{name}` must be {minimum} or more, got {value}")
    return count


def _check_amount(name: str, value: float) -> None:
    if not 0.0 <= value < np.inf:
        raise ValueError(f"`{name}` must be a finite number of at least 0, got {value}")
