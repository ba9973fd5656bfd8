"""Orders and truncation of trees, without recursion.

The functions take any tree in SciPy's format whose heights do not decrease. Time and memory are at
most n log n for n points.
"""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ._checks import FloatArray, IntArray, as_count, as_floats, as_height

__all__ = ["TruncatedTree", "leaves_list", "truncate"]


def leaves_list(tree: npt.ArrayLike) -> IntArray:
    """Return the points of a tree from left to right, so that no branches of a drawing cross.

    Parameters
    ----------
    tree : array_like, shape (n - 1, 4)
        A tree as returned by `linkage`.

    Returns
    -------
    ndarray of int64, shape (n,)
        The points, as from `scipy.cluster.hierarchy.leaves_list`.

    Raises
    ------
    TypeError, ValueError
        If `tree` is not a tree, or heights decrease.

    Examples
    --------
    >>> leaves_list([[0, 2, 1.0, 2], [1, 3, 5.0, 3]])
    array([1, 0, 2])
    """
    checked = _as_tree(tree)
    n = len(checked) + 1
    order = np.empty(n, dtype=np.int64)
    order[_positions(checked)[0][:n]] = np.arange(n)
    return order


class TruncatedTree(NamedTuple):
    """The upper part of a tree, whose leaves are clusters of the whole tree.

    Attributes
    ----------
    tree : ndarray, shape (m - 1, 4)
        The merges of m clusters in SciPy's format, input of `scipy.cluster.hierarchy.dendrogram`.
        The last column counts clusters, not points.
    sizes : ndarray of int64, shape (m,)
        The number of points of each cluster.
    labels : ndarray of int64, shape (n,)
        The cluster of each point, from 0.
    """

    tree: FloatArray
    sizes: IntArray
    labels: IntArray


def truncate(
    tree: npt.ArrayLike, *, p: int | None = None, distance: float | None = None
) -> TruncatedTree:
    """Replace the lower merges of a tree by leaves, for drawings of large trees.

    Parameters
    ----------
    tree : array_like, shape (n - 1, 4)
        A tree as returned by `linkage`.
    p : int, optional
        The number of leaves that remain, as ``truncate_mode="lastp"`` of
        `scipy.cluster.hierarchy.dendrogram`. All leaves remain if it exceeds n.
    distance : float, optional
        The height up to which merges are replaced, inclusive, instead of `p`.

    Returns
    -------
    TruncatedTree
        The remaining merges, the sizes of their leaves, and the leaf of each point.

    Raises
    ------
    TypeError, ValueError
        If `tree` is not a tree, heights decrease, not exactly one of `p` and `distance` is given,
        or it is out of range.

    Examples
    --------
    >>> upper = truncate([[0, 2, 1.0, 2], [1, 3, 5.0, 3]], p=2)
    >>> upper.tree, upper.sizes, upper.labels
    (array([[0., 1., 5., 2.]]), array([1, 2]), array([1, 0, 1]))
    """
    checked = _as_tree(tree)
    n = len(checked) + 1
    if (p is None) == (distance is None):
        raise ValueError(f"exactly one of `p` and `distance` must be given, got {p} and {distance}")
    if distance is None:
        n_replaced = n - min(as_count("p", p, 1), n)
    else:
        limit = as_height("distance", distance)
        n_replaced = int(np.searchsorted(checked[:, 2], limit, side="right"))
    top = top_clusters(checked, n_replaced)[:n]
    leaves, labels, sizes = np.unique(top, return_inverse=True, return_counts=True)
    # The order of numbers remains, so left remains left.
    number = np.zeros(2 * n - 1)
    number[leaves] = np.arange(len(leaves))
    number[n + n_replaced :] = np.arange(len(leaves), 2 * len(leaves) - 1)
    rest = checked[n_replaced:].copy()
    rest[:, :2] = number[rest[:, :2].astype(np.int64)]
    first, size = _positions(checked)
    starts, uppers = np.sort(first[leaves]), np.s_[n + n_replaced :]
    rest[:, 3] = np.searchsorted(starts, first[uppers] + size[uppers])
    rest[:, 3] -= np.searchsorted(starts, first[uppers])
    return TruncatedTree(rest, sizes.astype(np.int64), labels.astype(np.int64))


def _as_tree(tree: npt.ArrayLike) -> FloatArray:
    """Return a tree as a float64 array.

    Raises ValueError unless each cluster except the last is merged by exactly one later row,
    heights do not decrease, and the last column has the numbers of points.
    """
    array = as_floats("tree", tree).astype(np.float64, copy=False)
    if array.ndim != 2 or array.shape[0] < 1 or array.shape[1] != 4:
        raise ValueError(f"`tree` must have shape (n - 1 >= 1, 4), got {array.shape}")
    n = len(array) + 1
    limits = np.arange(n, 2 * n - 1)[:, None]
    pairs, heights = array[:, :2], array[:, 2]
    if not ((pairs >= 0) & (pairs < limits) & (pairs == np.floor(pairs))).all():
        raise ValueError("`tree` must merge clusters that exist: row i clusters below n + i")
    if (np.bincount(pairs.astype(np.int64).ravel(), minlength=2 * n - 2) != 1).any():
        raise ValueError("`tree` must merge each cluster once")
    if not (np.isfinite(heights).all() and heights[0] >= 0 and (np.diff(heights) >= 0).all()):
        raise ValueError("`tree` must have finite heights of at least 0 that do not decrease")
    with np.errstate(invalid="ignore"):  # a size that is no int64 also fails the test
        size = _sizes(array)
    if (size[pairs.astype(np.int64)].sum(axis=1) != array[:, 3]).any():
        raise ValueError("`tree` must have the number of points of each cluster in column 3")
    return array


def _sizes(tree: FloatArray) -> IntArray:
    """Return the number of points of each cluster."""
    return np.concatenate([np.ones(len(tree) + 1, np.int64), tree[:, 3].astype(np.int64)])


def _parents(tree: FloatArray, n_merges: int) -> IntArray:
    """Return the parent of each cluster after `n_merges` merges, or itself if it has no parent."""
    n = len(tree) + 1
    parents = np.arange(2 * n - 1)
    merged = tree[:n_merges, :2].astype(np.int64)
    parents[merged] = np.arange(n, n + n_merges)[:, None]
    return parents


def top_clusters(tree: FloatArray, n_merges: int) -> IntArray:
    """Return, for each cluster, the largest cluster that contains it after `n_merges` merges."""
    top = _parents(tree, n_merges)
    while True:
        # Each round doubles the number of levels that the pointers pass.
        above = top[top]
        if (above == top).all():
            return top
        top = above


def labels_after_merges(tree: FloatArray, n_merges: int) -> IntArray:
    """Return the cluster of each point after the first `n_merges` merges of a tree.

    Clusters are numbered from 0 in the order of their first points.
    """
    top = top_clusters(tree, n_merges)[: len(tree) + 1]
    _, first, cluster = np.unique(top, return_index=True, return_inverse=True)
    return np.argsort(np.argsort(first))[cluster].astype(np.int64)


def _positions(tree: FloatArray) -> tuple[IntArray, IntArray]:
    """Return the position of the first leaf of each cluster, and the number of its leaves."""
    n = len(tree) + 1
    parents = _parents(tree, n - 1)
    left, right = tree[:, :2].astype(np.int64).T
    size = _sizes(tree)
    first = np.zeros(2 * n - 1, dtype=np.int64)
    first[right] = size[left]
    while True:
        above = parents[parents]
        if (above == parents).all():
            return first, size
        first += first[parents]
        parents = above
