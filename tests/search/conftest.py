"""Fixtures for the tests of the search."""

import numpy as np
import pytest

from mograft import Segments
from mograft.analysis.zero_moment import N_DIRECTIONS
from mograft.search.boundary_states import BoundaryStates
from mograft.search.segment_pool import SegmentBalance, SegmentPool
from tests.strategies import smooth_rotations


@pytest.fixture(scope="session")
def make_pool():
    """Return a function that makes a pool of segments with random lengths, labels and poses."""

    def make(seed, n=12, n_labels=3, spread=0.5):
        rng = np.random.default_rng(seed)
        lengths = rng.integers(1, 12, n)
        stops = np.cumsum(lengths)
        poses = smooth_rotations(rng, n + 1, 3, speed=spread)
        velocities = rng.normal(size=(n + 1, 3, 3))
        return SegmentPool(
            segments=Segments(stops - lengths, stops),
            labels=rng.integers(0, n_labels, n),
            is_donor=np.ones(n, bool),
            boundary=BoundaryStates(
                first=poses[:-1],
                last=poses[1:],
                first_velocity=velocities[:-1],
                last_velocity=velocities[1:],
            ),
            rate=30.0,
            points=rng.normal(size=(n, 4)),
            sigma=2.0,
            balance=SegmentBalance(
                mass_offsets=(0.01 * rng.normal(size=(n, 10, 2))).__getitem__,
                support_margins=rng.normal(0.05, 0.05, (n, 10, N_DIRECTIONS)).__getitem__,
            ),
        )

    return make
