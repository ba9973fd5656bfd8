"""Complete linkage with the interface of a scikit-learn estimator."""

import operator
from typing import Literal, Self

import numpy as np
import numpy.typing as npt

from ._checks import Floats, IntArray, as_height
from ._metrics import Metric
from .clustering import linkage
from .dendrogram import labels_after_merges

_PARAMETERS = (
    "n_clusters",
    "distance_threshold",
    "metric",
    "compute_full_tree",
    "n_threads",
    "memory_limit",
)


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
    compute_full_tree : {"auto", True, False}
        Has no effect, because the tree is always complete. As in scikit-learn, False must not
        be combined with `distance_threshold`.
    n_threads, memory_limit : int, optional
        As for `linkage`. `threads` is accepted as an older name of `n_threads`.

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
    - there are no parameters `linkage`, `connectivity`, `memory` and `compute_distances`, and no
      metric "precomputed": `linkage_condensed` takes distances.

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
        compute_full_tree: bool | Literal["auto"] = "auto",
        n_threads: int | None = None,
        memory_limit: int | None = None,
    ) -> None:
        self.n_clusters = n_clusters
        self.distance_threshold = distance_threshold
        self.metric = metric
        self.compute_full_tree = compute_full_tree
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
        names = _feature_names(X)
        points = _as_samples(X)
        n = len(points)
        limit = self._limit(n)
        tree = linkage(
            points, metric=self.metric, n_threads=self.n_threads, memory_limit=self.memory_limit
        )
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
        if self.compute_full_tree not in (True, False, "auto"):
            raise ValueError(
                f"`compute_full_tree` must be True, False or 'auto', got {self.compute_full_tree!r}"
            )
        if self.distance_threshold is not None:
            if not self.compute_full_tree:
                raise ValueError("compute_full_tree must be True if distance_threshold is set")
            return as_height("distance_threshold", self.distance_threshold)
        try:
            n_clusters = operator.index(self.n_clusters)  # type: ignore[arg-type]
        except TypeError:
            raise TypeError(
                f"`n_clusters` must be a whole number, got {self.n_clusters!r}"
            ) from None
        if not 1 <= n_clusters <= n:
            raise ValueError(
                f"`n_clusters` must be between 1 and n_samples = {n}, got {n_clusters}"
            )
        return n_clusters

    def __sklearn_tags__(self) -> object:
        # Only scikit-learn calls this, so it is installed.
        from sklearn.utils import Tags, TargetTags  # type: ignore[import-untyped,unused-ignore]

        return Tags(estimator_type="clusterer", target_tags=TargetTags(required=False))


def _feature_names(points: object) -> npt.NDArray[np.object_] | None:
    """Return the column names of a data frame if all are strings, as scikit-learn does."""
    columns = getattr(points, "columns", None)
    if columns is None:
        return None
    names = np.array(list(columns), dtype=object)
    are_strings = [isinstance(name, str) for name in names]
    if any(are_strings) and not all(are_strings):
        raise TypeError("X must have column names that are all strings, or none that is a string")
    return names if any(are_strings) else None


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
