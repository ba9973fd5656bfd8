"""Complete linkage with the interface of a scikit-learn estimator."""

from typing import Self

import numpy as np
import numpy.typing as npt

from ._checks import Floats, IntArray, as_count, as_height
from ._metrics import Metric
from .clustering import linkage
from .dendrogram import labels_after_merges

_PARAMETERS = ("n_clusters", "distance_threshold", "metric", "n_threads", "memory_limit")


class CompleteLinkage:
    """Complete linkage with the interface of a scikit-learn estimator.

    Parameters
    ----------
    n_clusters : int or None
        Number of clusters. Must be None if `distance_threshold` is given.
    distance_threshold : float, optional
        Height at and above which clusters are not merged, in the unit of the metric.
    metric : {"euclidean", "sqeuclidean", "cosine", "correlation"}
        As for `linkage`.
    n_threads, memory_limit : int, optional
        As for `linkage`.

    Attributes
    ----------
    labels_ : ndarray of int64, shape (n,)
        The cluster of each point, numbered from 0 in the order of their first points.
    n_clusters_, n_leaves_, n_features_in_ : int
        The number of clusters, of points and of axes.
    n_connected_components_ : int
        Always 1: any two clusters may be merged.
    children_ : ndarray of int64, shape (n - 1, 2)
        The clusters of each merge, as in `linkage`.
    distances_ : ndarray, shape (n - 1,)
        The heights of the merges.
    feature_names_in_ : ndarray of str, shape (n_axes,)
        The names of the columns. Exists only if the points are a data frame whose column names
        are all strings.

    See Also
    --------
    cut : The labels alone, for a greatest diameter, faster.

    Notes
    -----
    Differences from ``sklearn.cluster.AgglomerativeClustering(linkage="complete")``:

    - labels are numbered in the order of first points; there the same partition has other numbers;
    - `distances_` always exists;
    - with tied distances, the tree may be another valid one, see `linkage`;
    - there are no parameters `linkage`, `connectivity`, `memory`, `compute_distances` and
      `compute_full_tree`, and no metric "precomputed": `linkage_condensed` takes distances.

    The class does not inherit from scikit-learn's `BaseEstimator` and works without scikit-learn.

    Examples
    --------
    >>> model = CompleteLinkage(n_clusters=2).fit([[0.0], [9.0], [1.0], [8.0]])
    >>> model.labels_, model.distances_
    (array([0, 1, 0, 1]), array([1., 1., 9.]))
    """

    _estimator_type = "clusterer"

    def __init__(
        self,
        n_clusters: int | None = 2,
        *,
        distance_threshold: float | None = None,
        metric: Metric = "euclidean",
        n_threads: int | None = None,
        memory_limit: int | None = None,
    ) -> None:
        self.n_clusters = n_clusters
        self.distance_threshold = distance_threshold
        self.metric = metric
        self.n_threads = n_threads
        self.memory_limit = memory_limit

    def __repr__(self) -> str:
        default = CompleteLinkage().get_params()
        given = (f"{k}={v!r}" for k, v in self.get_params().items() if v is not default[k])
        return f"{type(self).__name__}({', '.join(given)})"

    def get_params(self, deep: bool = True) -> dict[str, object]:  # noqa: ARG002, FBT001, FBT002
        """Return the parameters by name; `deep` exists because scikit-learn passes it."""
        return {name: getattr(self, name) for name in _PARAMETERS}

    def set_params(self, **params: object) -> Self:
        """Set parameters by name and return the estimator; an unknown name raises ValueError."""
        for name, value in params.items():
            if name not in _PARAMETERS:
                raise ValueError(f"`params` must be among {', '.join(_PARAMETERS)}, got {name!r}")
            setattr(self, name, value)
        return self

    def fit(self, X: npt.ArrayLike, y: object = None) -> Self:  # noqa: ARG002
        """Cluster at least two points, shape (n, n_axes), and return the estimator; `y` is ignored.

        Raises
        ------
        TypeError, ValueError
            As for `linkage`, and if not exactly one of `n_clusters` and `distance_threshold` is
            given, or it is out of range.
        """
        names, points = _feature_names(X), _as_samples(X)
        n = len(points)
        limit = self._limit(n)
        n_threads, memory_limit = self.n_threads, self.memory_limit
        tree = linkage(points, metric=self.metric, n_threads=n_threads, memory_limit=memory_limit)
        heights = tree[:, 2].copy()
        # scikit-learn does not merge at the threshold itself.
        n_merges = int(np.searchsorted(heights, limit)) if self.n_clusters is None else n - limit
        self.labels_ = labels_after_merges(tree, int(n_merges))
        self.n_clusters_ = n - int(n_merges)
        self.n_leaves_ = n
        self.n_connected_components_ = 1
        self.n_features_in_ = points.shape[1]
        if names is not None:
            self.feature_names_in_ = names
        elif hasattr(self, "feature_names_in_"):
            del self.feature_names_in_
        self.children_ = tree[:, :2].astype(np.int64)
        self.distances_ = heights
        return self

    def fit_predict(self, X: npt.ArrayLike, y: object = None) -> IntArray:
        """Cluster points and return `labels_`; see `fit`."""
        return self.fit(X, y).labels_

    def _limit(self, n: int) -> float:
        """Check the parameters that depend on each other; return the one that is given."""
        if (self.n_clusters is None) == (self.distance_threshold is None):
            raise ValueError(
                "Exactly one of n_clusters and distance_threshold must be set, and the other must "
                f"be None, got {self.n_clusters} and {self.distance_threshold}"
            )
        if self.n_clusters is None:
            assert self.distance_threshold is not None
            return as_height("distance_threshold", self.distance_threshold)
        n_clusters = as_count("n_clusters", self.n_clusters, 1)
        if n_clusters > n:
            raise ValueError(f"`n_clusters` must be at most n_samples = {n}, got {n_clusters}")
        return n_clusters

    def __sklearn_tags__(self) -> object:
        # Only scikit-learn calls this, so it is installed.
        from sklearn.utils import Tags, TargetTags  # type: ignore[import-untyped,unused-ignore]

        return Tags(estimator_type="clusterer", target_tags=TargetTags(required=False))


def _feature_names(points: object) -> npt.NDArray[np.object_] | None:
    """Return the column names of a data frame if all are strings, as scikit-learn does."""
    names = list(getattr(points, "columns", ()))
    n_strings = sum(isinstance(name, str) for name in names)
    if 0 < n_strings < len(names):
        raise TypeError("X must have column names that are all strings, or none that is a string")
    return np.array(names, dtype=object) if n_strings else None


def _as_samples(points: npt.ArrayLike) -> Floats:
    """Check points; the messages have the phrases that scikit-learn's estimator checks expect."""
    if hasattr(points, "toarray"):
        raise TypeError(
            "Sparse data was passed for X, but dense data is required. Use '.toarray()' to "
            "convert to a dense numpy array"
        )
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
    floats = array if array.dtype.kind in "f" else array.astype(np.float64)
    if not np.isfinite(floats).all():
        row, axis = (int(i) for i in np.argwhere(~np.isfinite(floats))[0])
        raise ValueError(
            f"X must be finite, got NaN or infinity (inf): {floats[row, axis]} at [{row}, {axis}]"
        )
    return floats
