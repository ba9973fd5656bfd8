"""Complete linkage, exactly, in memory that grows with the number of points and no faster.

The distance of two clusters is that of their farthest points, so a cluster's diameter is
the height at which it was made. Among merges of equal height the one of the lowest indices
goes first: with (squared distance, smallest index of one cluster, smallest index of the
other, the smaller first) as the key, the tree is unique, whatever the number of threads.
"""

import os

import numpy as np
import numpy.typing as npt

from mograft import _core
from mograft._arrays import FloatArray, IntArray, as_floats

__all__ = ["cut", "linkage", "linkage_condensed", "threshold"]


def linkage(points: npt.ArrayLike, *, threads: int | None = None) -> FloatArray:
    """Cluster points hierarchically by complete linkage under the Euclidean distance.

    Parameters
    ----------
    points : array_like, shape (n, n_axes)
        The points, at least one, in any unit.
    threads : int, optional
        Threads to compute on; the tree does not depend on it. Default: one per processor.

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
        If there is no point, or one has no coordinate or one that is not finite.

    See Also
    --------
    cut : The clusters at one height, without the tree.
    linkage_condensed : The same over distances of your own.

    Notes
    -----
    Of merges of equal height the one of the least (smallest index in the one cluster,
    smallest index in the other) goes first. SciPy's choice among them depends on its walk;
    where no two distances are equal, both trees are the same.

    Examples
    --------
    >>> linkage([[0.0], [1.0], [5.0]])
    array([[0., 1., 1., 2.],
           [2., 3., 5., 3.]])
    """
    return _core.linkage(_as_points(points), _as_threads(threads))


def cut(points: npt.ArrayLike, max_diameter: float, *, threads: int | None = None) -> IntArray:
    """Cut the tree of `linkage` at a height, without growing the part above it.

    Parameters
    ----------
    points : array_like, shape (n, n_axes)
        The points, in any unit; none at all is no error.
    max_diameter : float
        No two points of a cluster are farther apart than this, in the unit of the points;
        at exactly this distance they may be together. 0 joins equal points only.
    threads : int, optional
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
        If a point has no coordinate or one that is not finite, or if `max_diameter` is
        negative or not a number.

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
    return _core.cut(_as_points(points, at_least=0), diameter, _as_threads(threads))


def linkage_condensed(distances: npt.ArrayLike, *, threads: int | None = None) -> FloatArray:
    """Cluster hierarchically by complete linkage under distances of your own.

    Parameters
    ----------
    distances : array_like, shape (n * (n - 1) / 2,)
        The distance of each pair once, as `scipy.spatial.distance.pdist` gives them: (0, 1),
        (0, 2), ..., (1, 2), ....
    threads : int, optional
        As for `linkage`.

    Returns
    -------
    ndarray, shape (n - 1, 4)
        The tree, as for `linkage`.

    Raises
    ------
    TypeError
        If the distances are no real numbers.
    ValueError
        If one is negative or not finite, or their number is no n(n-1)/2.

    Examples
    --------
    >>> linkage_condensed([2.0, 6.0, 5.0])
    array([[0., 1., 2., 2.],
           [2., 3., 6., 3.]])
    """
    condensed = as_floats("distances", distances, ("n_pairs",))
    return _core.linkage_condensed(condensed, _as_threads(threads))


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


def _as_points(points: npt.ArrayLike, at_least: int = 1) -> FloatArray:
    array = as_floats("points", points, ("n", "n_axes"))
    if array.shape[0] < at_least or array.shape[1] < 1:
        raise ValueError(
            f"points must have shape (n >= {at_least}, n_axes >= 1), got {array.shape}"
        )
    return array


def _as_threads(threads: int | None) -> int:
    if threads is None:
        return os.cpu_count() or 1
    if threads < 1:
        raise ValueError(f"threads must be 1 or more, got {threads}")
    return threads


def _check_amount(name: str, value: float) -> None:
    if not 0.0 <= value < np.inf:
        raise ValueError(f"{name} must be a finite number, 0 or more, got {value}")
