"""Helpers for trees against those of SciPy, on trees of any shape."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.cluster import hierarchy
from scipy.spatial import distance

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


def distance_matrix(tree):
    return distance.squareform(hierarchy.cophenet(tree))


@given(trees())
def test_leaves_list_equals_scipy(tree):
    np.testing.assert_array_equal(dendrogram.leaves_list(tree), hierarchy.leaves_list(tree))


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
    height = np.quantile(tree[:, 2], quantile)
    upper = dendrogram.truncate(tree, distance=height)
    np.testing.assert_array_equal(upper.tree[:, 2], tree[tree[:, 2] > height, 2])
    assert (np.bincount(upper.labels) == upper.sizes).all()
    pairs = np.stack([upper.labels, hierarchy.fcluster(tree, height, "distance")])
    assert len(np.unique(pairs, axis=1).T) == len(upper.sizes) == pairs[1].max()
    if len(upper.tree):
        # Points of different leaves are merged at the same height as before.
        heights, old = map(distance_matrix, (upper.tree, tree))
        is_other = upper.labels[:, None] != upper.labels
        new = heights[upper.labels[:, None], upper.labels]
        np.testing.assert_array_equal(new[is_other], old[is_other])


@pytest.mark.parametrize("depth", [16, pytest.param(20, marks=pytest.mark.thorough)])
def test_helpers_million_leaves_without_recursion(depth):
    """Each merge adds one point, and SciPy's dendrogram would recurse n times."""
    n = 1 << depth
    merges = np.arange(n - 1)
    pairs = np.stack([np.r_[0, merges[:-1] + 2], np.r_[1, n + merges[:-1]]], axis=1)
    tree = np.column_stack([pairs, merges + 1.0, merges + 2])
    np.testing.assert_array_equal(np.sort(dendrogram.leaves_list(tree)), np.arange(n))
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
    for helper in (dendrogram.leaves_list, lambda tree: dendrogram.truncate(tree, p=2)):
        with pytest.raises(ValueError, match=message):
            helper(tree)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({}, "exactly one of `p` and `distance`"),
        ({"p": 2, "distance": 1.0}, "exactly one of `p`"),
        ({"p": 0}, "`p` must be 1 or more, got 0"),
        ({"distance": -1}, "`distance` must be 0 or more, got -1"),
        ({"distance": np.nan}, "`distance` must be 0 or more, got nan"),
    ],
)
def test_truncate_invalid_argument_raises_value_error(options, message):
    with pytest.raises(ValueError, match=message):
        dendrogram.truncate(TREE, **options)
