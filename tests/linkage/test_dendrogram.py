"""Helpers for trees against those of SciPy, on trees of any shape."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.cluster import hierarchy

from mograft.clustering import dendrogram


@st.composite
def trees(draw, max_points=40):
    """Valid trees of any shape, from chains to balanced ones, with tied heights."""
    n = draw(st.integers(2, max_points))
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    bias = draw(st.sampled_from([0.0, 0.5, 1.0]))  # 1: the last cluster is always merged
    heights = np.sort(draw(st.sampled_from([rng.random, rng.standard_exponential]))(n - 1))
    if draw(st.booleans()):
        heights = np.floor(4 * heights) / 4
    roots, sizes, rows = list(range(n)), [1] * n, []
    for i in range(n - 1):
        first = len(roots) - 1 if rng.random() < bias else int(rng.integers(len(roots)))
        a = roots.pop(first)
        b = roots.pop(int(rng.integers(len(roots))))
        sizes.append(sizes[a] + sizes[b])
        rows.append([min(a, b), max(a, b), heights[i], sizes[-1]])
        roots.append(n + i)
    return np.array(rows)


@given(trees())
def test_leaves_list_equals_scipy(tree):
    np.testing.assert_array_equal(dendrogram.leaves_list(tree), hierarchy.leaves_list(tree))


@given(trees(), st.floats(0, 1), st.integers(1, 45))
def test_fcluster_equals_scipy(tree, quantile, k):
    height = np.quantile(tree[:, 2], quantile)
    for t in (height, np.nextafter(height, np.inf), 0.0, np.inf):
        expected = hierarchy.fcluster(tree, t, "distance")
        np.testing.assert_array_equal(dendrogram.fcluster(tree, t), expected)
    expected = hierarchy.fcluster(tree, k, "maxclust")
    np.testing.assert_array_equal(dendrogram.fcluster(tree, k, "maxclust"), expected)


@given(trees(), st.data())
def test_cophenet_equals_scipy(tree, data):
    n = len(tree) + 1
    expected = hierarchy.cophenet(tree)
    np.testing.assert_array_equal(dendrogram.cophenet(tree), expected)
    square = np.zeros((n, n))
    square[np.triu_indices(n, 1)] = expected
    square += square.T
    points = st.integers(0, n - 1)
    pairs = np.array(data.draw(st.lists(st.tuples(points, points)))).reshape(-1, 2).astype(int)
    np.testing.assert_array_equal(dendrogram.cophenet(tree, pairs), square[*pairs.T])


@given(trees(), st.integers(2, 45))
def test_truncate_draws_as_scipy_lastp(tree, p):
    upper = dendrogram.truncate(tree, p=p)
    ours = hierarchy.dendrogram(upper.tree, no_plot=True)
    theirs = hierarchy.dendrogram(tree, p, truncate_mode="lastp", no_plot=True)
    assert ours["icoord"] == theirs["icoord"]
    assert ours["dcoord"] == theirs["dcoord"]
    assert hierarchy.is_valid_linkage(upper.tree)


@given(trees(), st.floats(0, 1))
def test_truncate_at_distance_keeps_higher_merges_and_fcluster_partition(tree, quantile):
    distance = np.quantile(tree[:, 2], quantile)
    upper = dendrogram.truncate(tree, distance=distance)
    np.testing.assert_array_equal(upper.tree[:, 2], tree[tree[:, 2] > distance, 2])
    assert (np.bincount(upper.labels) == upper.sizes).all()
    pairs = np.stack([upper.labels, hierarchy.fcluster(tree, distance, "distance")])
    assert len(np.unique(pairs, axis=1).T) == len(upper.sizes) == pairs[1].max()
    if len(upper.tree):
        # Points of different leaves are merged at the same height as before.
        leaf_pairs = np.argwhere(upper.labels[:, None] != upper.labels)
        heights = dendrogram.cophenet(upper.tree, upper.labels[leaf_pairs])
        np.testing.assert_array_equal(heights, dendrogram.cophenet(tree, leaf_pairs))


@pytest.mark.parametrize("is_chain", [True, False])
@pytest.mark.parametrize("depth", [16, pytest.param(20, marks=pytest.mark.thorough)])
def test_helpers_million_leaves_without_recursion(is_chain, depth):
    n = 1 << depth
    merges = np.arange(n - 1)
    if is_chain:  # each merge adds one point, and SciPy's dendrogram would recurse n times
        pairs = np.stack([np.r_[0, merges[:-1] + 2], np.r_[1, n + merges[:-1]]], axis=1)
    else:
        pairs = np.stack([2 * merges, 2 * merges + 1], axis=1)
    levels = [np.full(n >> level, 2.0**level) for level in range(1, depth + 1)]
    sizes = merges + 2 if is_chain else np.concatenate(levels)
    tree = np.column_stack([pairs, merges + 1.0, sizes])
    order = dendrogram.leaves_list(tree)
    np.testing.assert_array_equal(np.sort(order), np.arange(n))
    assert dendrogram.fcluster(tree, 3, "maxclust").max() == 3
    heights = dendrogram.cophenet(tree, [[0, 1], [0, n - 1], [5, 5]])
    assert heights.tolist() == [1.0, float(n - 1), 0.0]
    upper = dendrogram.truncate(tree, p=20)
    assert len(hierarchy.dendrogram(upper.tree, no_plot=True)["leaves"]) == 20
    assert upper.sizes.sum() == n


TREE = np.array([[0.0, 2.0, 1.0, 2.0], [1.0, 3.0, 5.0, 3.0]])


@pytest.mark.parametrize(
    ("tree", "message"),
    [
        (np.zeros((0, 4)), r"`tree` must have shape \(n - 1 >= 1, 4\), got \(0, 4\)"),
        (TREE[:, :3], "`tree` must have shape"),
        (TREE[::-1], "`tree` must merge clusters that exist"),
        (TREE * [1, 1, 1, 1] + [[0.5, 0, 0, 0], [0, 0, 0, 0]], "must merge clusters that exist"),
        (TREE - [[0, 0, 0, 0], [0, 1, 0, 0]], "`tree` must merge each cluster once"),
        (TREE - [[0, 0, 0, 0], [0, 0, 4.5, 0]], "`tree` must have finite heights"),
        (TREE - [0, 0, 0, 1], "`tree` must have the number of points of each"),
        (TREE * [1, 1, -1, 1], "`tree` must have finite heights"),
        (TREE * [1, 1, np.nan, 1], "`tree` must have finite heights"),
        (TREE * [1, 1, 1, np.nan], "`tree` must have the number of points of each"),
        (TREE * [1, 1, 1, 1e300], "`tree` must have the number of points of each"),
    ],
)
def test_helpers_invalid_tree_raises_value_error(tree, message):
    for helper in (
        dendrogram.leaves_list,
        dendrogram.cophenet,
        lambda tree: dendrogram.fcluster(tree, 1.0),
        lambda tree: dendrogram.truncate(tree, p=2),
    ):
        with pytest.raises(ValueError, match=message):
            helper(tree)


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        (lambda: dendrogram.fcluster(TREE, -1.0), ValueError, "`t` must be 0 or more, got -1"),
        (lambda: dendrogram.fcluster(TREE, 0, "maxclust"), ValueError, "`t` must be 1 or more"),
        (lambda: dendrogram.fcluster(TREE, 1.5, "maxclust"), TypeError, "`t` must be a whole"),
        (lambda: dendrogram.fcluster(TREE, np.nan), ValueError, "`t` must be 0 or more, got nan"),
        (lambda: dendrogram.fcluster(TREE, 1, "inconsistent"), ValueError, "`criterion` must be"),
        (lambda: dendrogram.truncate(TREE), ValueError, "exactly one of `p` and `distance`"),
        (lambda: dendrogram.truncate(TREE, p=2, distance=1.0), ValueError, "exactly one of `p`"),
        (lambda: dendrogram.truncate(TREE, p=0), ValueError, "`p` must be 1 or more, got 0"),
        (lambda: dendrogram.truncate(TREE, distance=-1), ValueError, "`distance` must be 0 or"),
        (lambda: dendrogram.cophenet(TREE, [0, 1]), ValueError, "`pairs` must have shape"),
        (lambda: dendrogram.cophenet(TREE, [[0.5, 1]]), TypeError, "`pairs` must be whole numbers"),
        (lambda: dendrogram.cophenet(TREE, [[0, 3]]), IndexError, "between 0 and 2, got 3"),
        (lambda: dendrogram.cophenet(TREE, [[-1, 3]]), IndexError, "between 0 and 2, got -1"),
        (lambda: dendrogram.cophenet(TREE, [[0, 1], [2]]), ValueError, "`pairs` must be an array"),
        (lambda: dendrogram.fcluster(TREE, None), TypeError, "`t` must be a number, got None"),
        (lambda: dendrogram.fcluster(TREE, "2", "maxclust"), TypeError, "`t` must be a number"),
    ],
)
def test_helpers_invalid_argument_raises(call, error, message):
    with pytest.raises(error, match=message):
        call()
