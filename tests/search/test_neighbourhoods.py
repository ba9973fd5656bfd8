"""Properties of neighbourhoods."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from mograft.search.neighbourhoods import NEIGHBOURHOODS, ClusterMembers
from tests.strategies import SEEDS

N = 30
SIGMAS = st.sampled_from([0.0, 0.5, 2.0, 4.0, 1e3])


def find_members(name, seed, sigma, *, is_grid=False):
    """Return labels and points of random segments, and the members that a neighbourhood finds."""
    rng = np.random.default_rng(seed)
    # On the grid many distances are equal, also to the radius.
    points = rng.integers(0, 4, (N, 3)) * 0.5 if is_grid else rng.normal(size=(N, 3))
    points.setflags(write=False)  # the last sorted points are kept: another array is not these
    labels = rng.integers(0, 5, N)
    members = NEIGHBOURHOODS[name].find_members(labels, points, sigma, np.arange(N))
    return labels, points, members


@given(SEEDS, SIGMAS, st.booleans())
def test_ball_members_match_the_oracle(seed, sigma, is_grid):
    _, points, members = find_members("ball", seed, sigma, is_grid=is_grid)
    for base, found in enumerate(members):
        distances = [np.linalg.norm(point - points[base]) for point in points]
        expected = [k for k in range(N) if distances[k] <= sigma]
        assert found.tolist() == expected


@given(SEEDS, st.floats(100, 308), st.integers(0, 3))
def test_ball_members_are_found_beside_points_of_any_size(seed, exponent, column):
    """The points of a damaged library are far from all others, and cause no warning."""
    rng, ball = np.random.default_rng(seed), NEIGHBOURHOODS["ball"]
    points = rng.normal(size=(N, 4))
    huge = rng.random(N) < 0.1
    points[huge, column] = rng.choice([-1.0, 1.0], huge.sum()) * 10.0**exponent
    members = ball.find_members(np.arange(N), points, 1.0, np.arange(N))
    usual = np.flatnonzero(~huge)
    alone = ball.find_members(np.arange(len(usual)), points[usual], 1.0, np.arange(len(usual)))
    for index, own in zip(usual, alone, strict=True):
        assert members[index].tolist() == usual[own].tolist()


@given(SEEDS, SIGMAS)
def test_ball_near_a_new_point_is_that_of_a_segment_at_the_point(seed, sigma):
    labels, points, members = find_members("ball", seed, sigma, is_grid=True)
    by_cluster = ClusterMembers.from_labels(labels, points)
    for base, expected in enumerate(members):
        found, distances = NEIGHBOURHOODS["ball"].find_near(by_cluster, points[base], sigma)
        np.testing.assert_array_equal(found, expected)
        np.testing.assert_allclose(distances, np.linalg.norm(points[found] - points[base], axis=1))


def test_ball_without_an_embedding_is_the_base_segment():
    members = NEIGHBOURHOODS["ball"].find_members(np.arange(4), None, 0.0, np.array([2, 0]))
    assert [own.tolist() for own in members] == [[2], [0]]
