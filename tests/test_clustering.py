"""Laws of complete linkage: one tree, SciPy's where there are no ties, and its cuts."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst
from scipy.cluster import hierarchy
from scipy.spatial.distance import pdist

import mograft as mg

COORDINATES = {
    "lattice": st.integers(-2, 2).map(float),
    "single precision": st.floats(-1e3, 1e3, width=32),
    "near duplicates": st.sampled_from([0.0, -0.0, 1e-12, 1.0, 1 + 2**-52, 1e8]),
    "wide": st.floats(-1e100, 1e100),
}


@st.composite
def clouds(draw, max_points=40, kinds=tuple(COORDINATES)):
    """Points of few axes: scattered, tied, near to each other or repeated."""
    elements = COORDINATES[draw(st.sampled_from(kinds))]
    shape = (draw(st.integers(2, max_points)), draw(st.integers(1, 8)))
    points = draw(npst.arrays(np.float64, shape, elements=elements))
    if draw(st.booleans()):
        rows = st.lists(st.integers(0, len(points) - 1), min_size=2, max_size=max_points)
        points = points[draw(rows)]
    return points


def greedy(points):
    """Merge the pair of least (squared distance, lower index, higher index), again and again.

    Scaled by a power of two, and with the tiniest coordinates taken for 0, so that no square
    comes near the ends of the range of floats.
    """
    n = len(points)
    exponent = np.frexp(np.abs(points).max())[1]
    points = np.ldexp(points, -exponent)
    points[np.abs(points) < 2.0**-440] = 0.0
    gaps = np.full((n, n), np.inf)
    for a in range(n):
        for b in range(a + 1, n):
            total = 0.0
            for x, y in zip(points[a], points[b], strict=True):
                total += (x - y) * (x - y)
            gaps[a, b] = total
    clusters = {i: (i, 1) for i in range(n)}
    rows = []
    while len(clusters) > 1:
        low, high = np.unravel_index(np.argmin(gaps), gaps.shape)
        (a, size_a), (b, size_b) = clusters[low], clusters.pop(high)
        rows.append(
            [min(a, b), max(a, b), np.ldexp(np.sqrt(gaps[low, high]), exponent), size_a + size_b]
        )
        clusters[low] = (n + len(rows) - 1, size_a + size_b)
        for other in clusters.keys() - {low}:
            pair, gone = tuple(sorted((low, other))), tuple(sorted((high, other)))
            gaps[pair] = max(gaps[pair], gaps[gone])
        gaps[high, :] = gaps[:, high] = gaps[low, high] = np.inf
    return np.array(rows).reshape(-1, 4)


def by_first_appearance(labels):
    """Number clusters from 0 in the order in which their first members stand."""
    _, first, inverse = np.unique(labels, return_index=True, return_inverse=True)
    return np.argsort(np.argsort(first))[inverse]


@st.composite
def scattered(draw, max_points=200):
    """Points of which no two pairs are equally far."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    shape = draw(st.integers(2, max_points)), draw(st.integers(1, 20))
    points = draw(st.sampled_from([rng.standard_normal, rng.standard_cauchy]))(shape)
    distances = pdist(points)
    assume(len(np.unique(distances)) == len(distances))
    return points


@given(clouds(max_points=12))
def test_the_tree_is_that_of_greedy_search(points):
    np.testing.assert_array_equal(mg.linkage(points), greedy(points))


@given(scattered())
def test_the_tree_is_scipys_where_no_distances_are_equal(points):
    np.testing.assert_array_equal(mg.linkage(points), hierarchy.complete(pdist(points)))


@given(clouds(kinds=["lattice", "single precision"]), st.floats(0, 1))
def test_the_cut_is_that_of_the_tree(points, quantile):
    tree = mg.linkage(points)
    height = np.quantile(tree[:, 2], quantile)
    for diameter in (height, np.nextafter(height, 0), np.nextafter(height, np.inf)):
        wanted = hierarchy.fcluster(tree, diameter, "distance")
        np.testing.assert_array_equal(mg.cut(points, diameter), by_first_appearance(wanted))


@given(clouds(kinds=["lattice", "single precision"]))
def test_the_condensed_tree_is_that_of_the_points(points):
    tree = mg.linkage(points)
    assert hierarchy.is_valid_linkage(tree)
    np.testing.assert_array_equal(mg.linkage_condensed(pdist(points)), tree)


@pytest.mark.parametrize("n", [0, 1, 2])
def test_a_few_points_are_no_special_case(n):
    points = np.arange(2.0 * n).reshape(n, 2)
    np.testing.assert_array_equal(mg.cut(points, 1.0), np.arange(n))
    np.testing.assert_array_equal(mg.cut(points, 9.0), np.zeros(n))
    if n:
        np.testing.assert_array_equal(mg.linkage(points), greedy(points))
    else:
        with pytest.raises(ValueError, match="points must have shape"):
            mg.linkage(points)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_values_that_are_not_finite_are_refused_by_their_place(bad):
    points = np.zeros((4, 3))
    points[2, 1] = bad
    for refuse in (mg.linkage, lambda points: mg.cut(points, 1.0)):
        with pytest.raises(ValueError, match=r"points must be finite, got -?(nan|inf) at \[2, 1\]"):
            refuse(points)


@pytest.mark.parametrize("diameter", [-1.0, np.nan])
def test_a_diameter_below_zero_is_refused(diameter):
    with pytest.raises(ValueError, match="max_diameter must be 0 or more, got"):
        mg.cut([[0.0]], diameter)


def test_a_matrix_that_is_not_condensed_is_refused():
    with pytest.raises(ValueError, match=r"distances must be n\(n-1\)/2 in number, got 4"):
        mg.linkage_condensed(np.ones(4))
    with pytest.raises(ValueError, match=r"distances must be finite and not negative.* at \[1\]"):
        mg.linkage_condensed([1.0, -1.0, 1.0])


def test_threshold_is_sigma_about_the_mean_point():
    rng = np.random.default_rng(14)
    points = rng.normal(size=(50, 3))
    away = np.linalg.norm(points - points.mean(axis=0), axis=1)
    assert mg.threshold(points) == pytest.approx(np.sqrt(np.mean(away**2)))
    assert mg.threshold(points, "literal", scale=0.5) == pytest.approx(0.5 * np.sqrt(away.mean()))
    assert mg.threshold(points, 2.5, scale=3.0) == 2.5
    with pytest.raises(ValueError, match="kind must be 'rms', 'literal' or a number, got 'std'"):
        mg.threshold(points, "std")
