"""Properties of poses and velocities at the ends of segments."""

from itertools import pairwise

import numpy as np
from hypothesis import given

from mograft.search.boundary_states import (
    pose_gaps,
    pose_gaps_along,
    velocity_gaps,
    velocity_gaps_along,
)
from tests.oracles import search as oracle
from tests.strategies import SEEDS, quaternions


@given(quaternions((3, 2)), quaternions((4, 2)))
def test_pose_gaps_match_the_oracle_and_are_symmetric(ends, starts):
    gaps = pose_gaps(ends, starts)
    expected = [[oracle.seam_angle(end, start) for start in starts] for end in ends]
    np.testing.assert_allclose(gaps, expected, atol=1e-9)
    np.testing.assert_allclose(pose_gaps(starts, ends), gaps.T, atol=1e-12)


def test_velocity_gaps_match_numpy_norms():
    rng = np.random.default_rng(0)
    ends, starts = rng.normal(size=(4, 2, 3)), rng.normal(size=(3, 2, 3))
    expected = np.linalg.norm(ends[:, None] - starts, axis=-1).mean(axis=-1)
    np.testing.assert_allclose(velocity_gaps(ends, starts), expected, atol=1e-12)


@given(SEEDS)
def test_gaps_along_are_bit_for_bit_those_of_neighbouring_positions(make_pool, seed):
    boundary, rng = make_pool(seed).boundary, np.random.default_rng(seed)
    counts = rng.integers(1, 20, 4)
    lists = [rng.integers(0, len(boundary), count) for count in counts]
    for along, gaps, ends, starts in (
        (pose_gaps_along, pose_gaps, boundary.last, boundary.first),
        (velocity_gaps_along, velocity_gaps, boundary.last_velocity, boundary.first_velocity),
    ):
        pairs = pairwise(lists)
        expected = [gaps(ends[left], starts[right]).ravel() for left, right in pairs]
        found = along(ends, starts, np.concatenate(lists), counts)
        np.testing.assert_array_equal(found, np.concatenate(expected))
