"""Complete linkage, exactly, in memory that grows with the number of points and no faster.

The distance of two clusters is that of their farthest points, so the height at which a cluster
is made is its diameter. Among merges of equal height the one of the lowest indices goes first:
with (squared distance, smallest index of one cluster, smallest index of the other), the smaller
index first, as the key, the tree is unique. Threads, instruction sets and memory change how
soon it is there, and nothing else. `docs/linkage.md` tells how it is found.
"""

import operator
import os
from collections.abc import Callable
from typing import Self

import numpy as np
import numpy.typing as npt

from mograft import _core
from mograft._util.arrays import FloatArray, IntArray, as_floats

__all__ = ["CompleteLinkage", "cut", "linkage", "linkage_condensed", "threshold"]

# A matrix of so many bytes is grown faster than the stages that save it: 1,448 points.
_MATRIX = 16 << 20


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
        Threads to compute on; the tree does not depend on it. Default: one per processor.
    memory_limit : int, optional
        Bytes that a matrix of all distances may take, on top of memory that grows with n.
        Where the matrix of ``8 * n**2`` bytes fits, the tree is grown on it: faster for few
        points, and for many axes, where distances are much alike. Default: 16 MiB.
    progress : callable, optional
        Called a few times a second with the share of the merges that are made, 0 to 1. What
        it raises ends the call.

    Returns
    -------
    ndarray, shape (n - 1, 4)
        The tree as SciPy writes it: row `i` joins clusters `Z[i, 0] < Z[i, 1]` into cluster
        `n + i` at height `Z[i, 2]`, the distance of their farthest points in the unit of the
        points; it has `Z[i, 3]` points. Clusters below `n` are the points themselves.

    Raises
    ------
    TypeError
        If the points are no real numbers.
    ValueError
        If there is no point, if one has no coordinate or one that is not finite, or if a
        number of threads or bytes makes no sense.

    See Also
    --------
    cut : The clusters at one height, without the tree.
    linkage_condensed : The same over distances of your own.

    Notes
    -----
    Heights are those of ``scipy.cluster.hierarchy.linkage(points, "complete")`` bit for bit,
    and where no two distances are equal the tree is. Of merges of equal height the one of the
    least (smallest index in the one cluster, smallest index in the other) goes first; SciPy's
    choice among them depends on its walk through the matrix.

    Coordinates smaller than 2**-440 of the largest count as 0; there SciPy's squares vanish.

    Examples
    --------
    >>> linkage([[0.0], [1.0], [5.0]])
    array([[0., 1., 1., 2.],
           [2., 3., 5., 3.]])
    """
    memory = _MATRIX if memory_limit is None else _as_count("memory_limit", memory_limit, 0)
    return _core.linkage(_as_points(points), _as_threads(threads), memory, progress)


def cut(
    points: npt.ArrayLike,
    max_diameter: float,
    *,
    threads: int | None = None,
    memory_limit: int | None = None,
    progress: Callable[[float], object] | None = None,
) -> IntArray:
    """Cut the tree of `linkage` at a height, without growing the part above it.

    Parameters
    ----------
    points : array_like, shape (n, n_axes)
        The points, in any unit; none at all is no error.
    max_diameter : float
        No two points of a cluster are farther apart than this, in the unit of the points;
        at exactly this distance they may be together. 0 joins equal points only.
    threads, memory_limit, progress
        As for `linkage`.

    Returns
    -------
    ndarray of int64, shape (n,)
        The cluster of each point. Clusters are numbered from 0 in the order in which their
        first points stand.

    Raises
    ------
    TypeError
        If the points are no real numbers.
    ValueError
        As for `linkage`, and if `max_diameter` is negative or not a number.

    Notes
    -----
    The partition is that of ``scipy.cluster.hierarchy.fcluster(linkage(points),
    max_diameter, "distance")``. scikit-learn's `distance_threshold` differs: there a merge
    at exactly the threshold is not made.

    Examples
    --------
    >>> cut([[0.0], [9.0], [1.0], [8.0]], max_diameter=2.0)
    array([0, 1, 0, 1])
    """
    diameter = float(max_diameter)
    if not diameter >= 0.0:
        raise ValueError(f"max_diameter must be 0 or more, got {max_diameter}")
    memory = _MATRIX if memory_limit is None else _as_count("memory_limit", memory_limit, 0)
    array = _as_points(points, at_least=0)
    return _core.cut(array, diameter, _as_threads(threads), memory, progress)


def linkage_condensed(
    distances: npt.ArrayLike,
    *,
    threads: int | None = None,
    memory_limit: int | None = None,
    progress: Callable[[float], object] | None = None,
) -> FloatArray:
    """Cluster hierarchically by complete linkage under distances of your own.

    Parameters
    ----------
    distances : array_like, shape (n * (n - 1) / 2,)
        The distance of each pair once, as `scipy.spatial.distance.pdist` gives them: (0, 1),
        (0, 2), ..., (1, 2), .... They need not obey the triangle inequality.
    threads, progress
        As for `linkage`.
    memory_limit : int, optional
        Bytes that the full matrix may take, twice as many as `distances` take. Where it does
        not fit, a copy of `distances` is made and the work done on one thread, several times
        slower. Default: any.

    Returns
    -------
    ndarray, shape (n - 1, 4)
        The tree, as for `linkage`.

    Raises
    ------
    TypeError
        If the distances are no real numbers.
    ValueError
        If one is negative or not finite, if their number is no n(n-1)/2, or if a number of
        threads or bytes makes no sense.

    Examples
    --------
    >>> linkage_condensed([2.0, 6.0, 5.0])
    array([[0., 1., 2., 2.],
           [2., 3., 6., 3.]])
    """
    condensed = as_floats("distances", distances, ("n_pairs",))
    # The full matrix is twice the condensed one and its diagonal, n of 8 bytes.
    memory = 4 * condensed.nbytes + 64 if memory_limit is None else memory_limit
    memory = _as_count("memory_limit", memory, 0)
    return _core.linkage_condensed(condensed, _as_threads(threads), memory, progress)


def threshold(points: npt.ArrayLike, kind: str | float = "rms", scale: float = 1.0) -> float:
    """Choose a diameter for `cut` by how far the points lie from their mean.

    Parameters
    ----------
    points : array_like, shape (n, n_axes)
        The points, at least one.
    kind : {"rms", "literal"} or float
        With d the distance of each point from the mean of all: "rms" is the root of the mean
        of d squared; "literal" is the root of the mean of d. A number is taken as it is.
    scale : float
        What the two named kinds are multiplied by.

    Returns
    -------
    float
        The diameter, in the unit of the points for "rms".

    Raises
    ------
    TypeError
        If the points are no real numbers.
    ValueError
        If there is no point or one is not finite, if `kind` is another word, or if a number
        is negative or not finite.

    Notes
    -----
    "literal" is equation 14 of the paper as printed. A root of a length is no length: with
    it the same points in another unit fall into other clusters. "rms", the standard
    deviation, grows with the points.

    Examples
    --------
    >>> threshold([[-1.0], [1.0], [-7.0], [7.0]])
    5.0
    >>> threshold([[-1.0], [1.0], [-7.0], [7.0]], "literal")
    2.0
    """
    _check_amount("scale", scale)
    if not isinstance(kind, str):
        _check_amount("kind", kind)
        return float(kind)
    if kind not in ("rms", "literal"):
        raise ValueError(f"kind must be 'rms', 'literal' or a number, got {kind!r}")
    cloud = _as_points(points)
    squared = np.square(cloud - cloud.mean(axis=0)).sum(axis=1)
    return float(scale * np.sqrt(np.mean(squared if kind == "rms" else np.sqrt(squared))))


class CompleteLinkage:
    """Complete linkage as an estimator in the manner of scikit-learn.

    Parameters
    ----------
    max_diameter : float, optional
        Merge no higher than this, in the unit of the points; at exactly this height a merge is
        made. Default: `threshold` of the points, unless `n_clusters` is given.
    n_clusters : int, optional
        Merge until so many clusters are left, instead.
    threads : int, optional
        As for `linkage`.

    Attributes
    ----------
    labels_ : ndarray of int64, shape (n,)
        The cluster of each point, numbered from 0 in the order in which their first points
        stand.
    n_clusters_ : int
        How many there are.
    n_leaves_ : int
        The number of points.
    children_ : ndarray of int64, shape (n - 1, 2)
        The clusters that each merge joins, as in `linkage`.
    distances_ : ndarray, shape (n - 1,)
        The heights of the merges.
    n_features_in_ : int
        The number of axes.

    See Also
    --------
    cut : The labels alone, sooner.

    Notes
    -----
    Where scikit-learn's ``AgglomerativeClustering(distance_threshold=t)`` does not merge at a
    height of exactly `t`, this does: ``max_diameter=np.nextafter(t, 0)`` is the same.

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
        """Return the parameters by name; `deep` is there because scikit-learn passes it."""
        return {name: getattr(self, name) for name in ("max_diameter", "n_clusters", "threads")}

    def set_params(self, **params: object) -> Self:
        """Set parameters by name and return the estimator.

        Raises
        ------
        ValueError
            If there is no parameter of that name.
        """
        for name, value in params.items():
            if name not in self.get_params():
                known = ", ".join(self.get_params())
                raise ValueError(f"params must be among {known}, got {name!r}")
            setattr(self, name, value)
        return self

    def fit(self, X: npt.ArrayLike, y: object = None) -> Self:  # noqa: ARG002
        """Cluster points.

        Parameters
        ----------
        X : array_like, shape (n, n_axes)
            The points, at least two.
        y : object, optional
            Ignored; pipelines pass it.

        Returns
        -------
        CompleteLinkage
            The estimator itself, with its attributes set.

        Raises
        ------
        TypeError, ValueError
            As for `linkage`, and if there are both a diameter and a number of clusters, or more
            clusters wanted than there are points.
        """
        if self.max_diameter is not None and self.n_clusters is not None:
            raise ValueError(
                "max_diameter and n_clusters must not both be given, got "
                f"{self.max_diameter} and {self.n_clusters}"
            )
        points = _as_samples(X)
        n = len(points)
        if self.n_clusters is not None and not 1 <= self.n_clusters <= n:
            raise ValueError(f"n_clusters must be 1 to n_samples = {n}, got {self.n_clusters}")
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
        # Called by scikit-learn alone, which is therefore there.
        from sklearn.utils import Tags, TargetTags  # type: ignore[import-untyped,unused-ignore]

        return Tags(estimator_type="clusterer", target_tags=TargetTags(required=False))


def _labels(tree: FloatArray, n_merges: int) -> IntArray:
    """Label the points by the clusters that the first merges of a tree leave."""
    n = len(tree) + 1
    # Each merge made goes where its union goes: from the last one down to the points.
    top = np.arange(2 * n - 1)
    for i in range(n_merges - 1, -1, -1):
        top[tree[i, :2].astype(np.int64)] = top[n + i]
    _, first, cluster = np.unique(top[:n], return_index=True, return_inverse=True)
    return np.argsort(np.argsort(first))[cluster].astype(np.int64)


def _as_samples(points: npt.ArrayLike) -> FloatArray:
    """Check points in the words that scikit-learn's users, and its checks, know."""
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


def _as_points(points: npt.ArrayLike, at_least: int = 1) -> FloatArray:
    array = as_floats("points", points, ("n", "n_axes"))
    if array.shape[0] < at_least or array.shape[1] < 1:
        raise ValueError(
            f"points must have shape (n >= {at_least}, n_axes >= 1), got {array.shape}"
        )
    return array


def _as_threads(threads: int | None) -> int:
    return os.cpu_count() or 1 if threads is None else _as_count("threads", threads, 1)


def _as_count(name: str, value: int, least: int) -> int:
    count = operator.index(value)
    if count < least:
        raise ValueError(f"{name} must be {least} or more, got {value}")
    return count


def _check_amount(name: str, value: float) -> None:
    if not 0.0 <= value < np.inf:
        raise ValueError(f"{name} must be a finite number, 0 or more, got {value}")
