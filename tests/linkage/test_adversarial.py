"""Trees and partitions against SciPy on difficult sets of points, for every metric."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.cluster import hierarchy
from scipy.spatial.distance import pdist, squareform

from mograft import clustering
from tests.analysis.test_clustering import by_first_appearance

METRICS = ("euclidean", "sqeuclidean", "cosine", "correlation")

KINDS = {
    "normal": lambda rng, n, d: rng.standard_normal((n, d)),
    "tails": lambda rng, n, d: rng.standard_cauchy((n, d)),
    "lattice": lambda rng, n, d: rng.integers(-2, 3, (n, d)).astype(float),
    "binary": lambda rng, n, d: rng.integers(0, 2, (n, d)).astype(float),
    "one-hot": lambda rng, n, d: np.eye(max(n, d))[:n, rng.permutation(max(n, d))[:d]],
    "duplicates": lambda rng, n, d: rng.standard_normal((n, d))[rng.integers(0, 1 + n // 3, n)],
    "near duplicates": lambda rng, n, d: 1.0 + 1e-12 * rng.integers(0, 9, (n, d)),
    "scale-free": lambda rng, n, d: rng.normal(size=(n, d)) * 10.0 ** -rng.uniform(0, 8, (n, 1)),
    "clumps": lambda rng, n, d: np.round(rng.normal(size=(n, d))) + rng.normal(0, 1e-9, (n, d)),
    "line": lambda rng, n, d: rng.random((n, 1)) * rng.standard_normal(d),
    "far from the origin": lambda rng, n, d: 1e8 + rng.standard_normal((n, d)),
}


@st.composite
def difficult_points(draw):
    """Points of 1 to 2,000 axes, often few and often many."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    n = draw(st.integers(2, 70))
    n_axes = int(10 ** draw(st.floats(0, np.log10(2000))))
    return KINDS[draw(st.sampled_from(list(KINDS)))](rng, n, n_axes)


def rows_without_direction(points, metric):
    """Return which points the metric is not defined for."""
    if metric == "cosine":
        return ~points.any(axis=1)
    if metric == "correlation":
        return points.min(axis=1) == points.max(axis=1)
    return np.zeros(len(points), bool)


def with_comparable_rows(points, metric):
    """Return the points for which SciPy computes the metric with few wrong digits."""
    if metric != "correlation":
        return points
    # Rounding dominates the correlation of nearly constant rows.
    spread = points.max(axis=1) - points.min(axis=1)
    return points[spread > 1e-3 * np.abs(points).max(axis=1)]


def rounding(points, metric):
    """Return a bound of the relative and of the absolute rounding of SciPy's distances."""
    epsilon = np.finfo(float).eps
    if metric in ("euclidean", "sqeuclidean"):
        return (0.0 if metric == "euclidean" else 2 * epsilon), 0.0
    # SciPy subtracts means without scaling, which costs 1e3 for the spreads above.
    return 0.0, 8 * epsilon * points.shape[1] * (1 if metric == "cosine" else 1e3)


def assert_is_complete_linkage(tree, distances, relative, absolute):
    """Check that each merge has the distance of its clusters, and that no pair is nearer."""
    n = len(tree) + 1
    gaps = squareform(distances)
    np.fill_diagonal(gaps, np.inf)
    row_of = dict(enumerate(range(n)))
    for i, (a, b, height, _) in enumerate(tree):
        kept, removed = row_of.pop(int(a)), row_of.pop(int(b))
        allowed = absolute + relative * height
        assert abs(gaps[kept, removed] - height) <= allowed
        assert gaps.min() >= height - allowed
        gaps[kept] = gaps[:, kept] = np.maximum(gaps[kept], gaps[removed])
        gaps[removed] = gaps[:, removed] = gaps[kept, kept] = np.inf
        row_of[n + i] = kept


def assert_trees_and_partitions_equal_scipy(points, metric, quantiles):
    """Compare the tree by stages, that on a matrix and cuts of both with SciPy."""
    distances = pdist(points, metric)
    relative, absolute = rounding(points, metric)
    tree = clustering.linkage(points, metric=metric)
    np.testing.assert_array_equal(clustering.linkage(points, metric=metric, memory_limit=0), tree)
    assert hierarchy.is_valid_linkage(tree)
    assert_is_complete_linkage(tree, distances, relative, absolute)
    ordered = np.sort(distances)
    allowed = absolute + relative * ordered[-1]
    if len(ordered) == 1 or np.diff(ordered).min() > 4 * allowed:
        # No ties: the tree is SciPy's.
        expected = hierarchy.complete(distances)
        np.testing.assert_array_equal(tree[:, [0, 1, 3]], expected[:, [0, 1, 3]])
        np.testing.assert_allclose(tree[:, 2], expected[:, 2], rtol=relative, atol=absolute)
    else:
        expected = tree
    for quantile, memory_limit in zip(quantiles, (0, None, 0), strict=True):
        limit = np.quantile(ordered, quantile)
        if expected is tree or np.abs(expected[:, 2] - limit).min() > allowed:
            labels = by_first_appearance(hierarchy.fcluster(expected, limit, "distance"))
            ours = clustering.cut(points, limit, metric=metric, memory_limit=memory_limit)
            np.testing.assert_array_equal(ours, labels)


@settings(max_examples=max(100, settings.default.max_examples))
@given(difficult_points(), st.lists(st.floats(0, 1), min_size=3, max_size=3))
def test_linkage_and_cut_difficult_points_equal_scipy_for_every_metric(points, quantiles):
    for metric in METRICS:
        is_refused = rows_without_direction(points, metric)
        if is_refused.any() and len(points) > 1:
            with pytest.raises(ValueError, match=f"got row {np.argmax(is_refused)}$"):
                clustering.linkage(points, metric=metric)
        comparable = with_comparable_rows(points[~is_refused], metric)
        if len(comparable) > 1:
            assert_trees_and_partitions_equal_scipy(comparable, metric, quantiles)
