"""Complete linkage with the interface of a scikit-learn estimator."""

from typing import Self

import numpy as np
import numpy.typing as npt

from ._checks import FloatArray, IntArray, check_amount
from .clustering import linkage, threshold


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
            check_amount("max_diameter", diameter)
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
