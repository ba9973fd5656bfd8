"""Complete linkage: one tree for any resources, condensed distances, interrupts and thresholds.

rust/linkage/tests compare the tree with greedy search, tests/linkage with SciPy.
"""

import signal

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst
from scipy.cluster import hierarchy
from scipy.spatial.distance import pdist

from mograft import clustering

COORDINATES = {
    "lattice": st.integers(-2, 2).map(float),
    "single precision": st.floats(-1e3, 1e3, width=32),
    "near duplicates": st.sampled_from([0.0, -0.0, 1e-12, 1.0, 1 + 2**-52, 1e8]),
    "wide": st.floats(-1e100, 1e100),
}


@st.composite
def clouds(draw, max_points=40, kinds=tuple(COORDINATES)):
    """Points of few axes: random, with ties, nearly equal or repeated."""
    elements = COORDINATES[draw(st.sampled_from(kinds))]
    shape = (draw(st.integers(2, max_points)), draw(st.integers(1, 8)))
    points = draw(npst.arrays(np.float64, shape, elements=elements))
    if draw(st.booleans()):
        rows = st.lists(st.integers(0, len(points) - 1), min_size=2, max_size=max_points)
        points = points[draw(rows)]
    return points


RESOURCES = st.fixed_dictionaries(
    {"n_threads": st.integers(1, 3), "memory_limit": st.sampled_from([0, None])}
)
"""Arguments that change the running time only. rust/linkage/tests vary the tuning parameters."""


def by_first_appearance(labels):
    """Number clusters from 0 in the order of their first members."""
    _, first, inverse = np.unique(labels, return_index=True, return_inverse=True)
    return np.argsort(np.argsort(first))[inverse]


@settings(max_examples=300)
@given(clouds(max_points=100), RESOURCES)
def test_linkage_any_threads_and_memory_limit_gives_one_valid_tree(points, resources):
    tree = clustering.linkage(points, **resources)
    np.testing.assert_array_equal(tree, clustering.linkage(points))
    assert hierarchy.is_valid_linkage(tree)
    assert hierarchy.is_monotonic(tree)


@given(clouds(kinds=["lattice", "single precision"]))
def test_linkage_condensed_equals_linkage_of_points(points):
    distances = pdist(points)
    # Different squares may have equal rounded roots; such points have other ties here.
    assume(len(np.unique(distances)) == len(np.unique(pdist(points, "sqeuclidean"))))
    tree = clustering.linkage(points)
    np.testing.assert_array_equal(clustering.linkage_condensed(distances), tree)
    np.testing.assert_array_equal(clustering.linkage_condensed(distances, memory_limit=0), tree)


@pytest.mark.parametrize("error", [LookupError, KeyboardInterrupt])
def test_linkage_progress_exception_or_interrupt_ends_call(error):
    points = np.random.default_rng(0).standard_normal((20_000, 12))
    reported = []

    def progress(done):
        reported.append(done)
        if len(reported) == 2 and error is KeyboardInterrupt:
            signal.raise_signal(signal.SIGINT)
        elif len(reported) == 2:
            raise error

    with pytest.raises(error):
        clustering.linkage(points, progress=progress, n_threads=1)
    assert all(0.0 <= done <= 1.0 for done in reported)


@pytest.mark.parametrize("n", [0, 1, 2])
def test_cut_up_to_two_points(n):
    points = np.arange(2.0 * n).reshape(n, 2)
    np.testing.assert_array_equal(clustering.cut(points, 1.0), np.arange(n))
    np.testing.assert_array_equal(clustering.cut(points, 9.0), np.zeros(n))


def test_threshold_equals_deviation_from_mean_point():
    rng = np.random.default_rng(14)
    points = rng.normal(size=(50, 3))
    distances = np.linalg.norm(points - points.mean(axis=0), axis=1)
    assert clustering.threshold(points) == pytest.approx(np.sqrt(np.mean(distances**2)))
    assert clustering.threshold(points, "literal", scale=0.5) == pytest.approx(
        0.5 * np.sqrt(distances.mean())
    )
    with pytest.raises(ValueError, match="`kind` must be 'rms' or 'literal', got 'std'"):
        clustering.threshold(points, "std")
