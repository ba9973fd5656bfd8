"""Dynamic time warping: paths within the band, the shortest of all, and distances for them."""

from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst

from mograft.datasets.finding import gaps_in_band, warping_path
from mograft.search.boundary_states import pose_gaps
from tests.strategies import SEEDS, smooth_rotations


def distances(most=12):
    shapes = st.integers(2, most).map(lambda n: (n + 1, 2 * n + 1))
    return npst.arrays(np.float64, shapes, elements=st.floats(0, 3))


@given(distances(30))
def test_warping_path_is_monotone_within_band_and_keeps_ends(gaps):
    path, n = warping_path(gaps), len(gaps) - 1
    assert path[0] == 0
    assert path[-1] == 2 * n
    assert set(np.diff(path)) <= {1, 2, 3, 4}
    assert np.abs(path - 2 * np.arange(n + 1)).max() <= max(round(0.4 * n), 1)


@given(npst.arrays(np.float64, (3, 2, 9, 17), elements=st.floats(0, 3)))
def test_warping_path_of_several_is_that_of_each(gaps):
    paths = warping_path(gaps)
    for index in np.ndindex(gaps.shape[:2]):
        assert np.array_equal(paths[index], warping_path(gaps[index]))


@settings(max_examples=25)
@given(distances(6))
def test_warping_path_is_shortest_of_all_paths(gaps):
    """The oracle enumerates all paths."""
    n = len(gaps) - 1
    rows = np.arange(n + 1)
    best = np.inf
    for steps in product((1, 2, 3, 4), repeat=n):
        path = np.concatenate([[0], np.cumsum(steps)])
        near = np.abs(path - 2 * rows).max() <= max(round(0.4 * n), 1)
        if path[-1] == 2 * n and near:
            best = min(best, gaps[rows, path].sum())
    assert gaps[rows, warping_path(gaps)].sum() == pytest.approx(best)


@given(st.integers(1, 40), st.integers(1, 3), SEEDS)
def test_gaps_in_band_give_the_path_of_all_gaps(n, n_others, seed):
    rng = np.random.default_rng(seed)
    poses, *others = (smooth_rotations(rng, 2 * n + 1, 2) for _ in range(n_others + 1))
    expected = np.stack([pose_gaps(poses[: n + 1], other) for other in others])
    gaps = gaps_in_band(poses[: n + 1], np.stack(others))
    path = warping_path(gaps)
    np.testing.assert_array_equal(path, warping_path(expected))
    for row in range(n_others):
        used = np.arange(n + 1), path[row]
        np.testing.assert_array_equal(gaps[row][used], expected[row][used])
