"""Paths on the floor: distance of the root, and the time limit."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from mograft import graft
from mograft.body.mass import mass_model
from mograft.scenario import follow
from tests.scenario.graphs import is_walk
from tests.strategies import few_examples

CORNERS = st.lists(
    st.tuples(st.floats(-2.0, 2.0), st.floats(-2.0, 2.0)), min_size=2, max_size=4, unique=True
)


def to_path(points, path):
    """The distance of points from a polyline."""
    nearest = np.full(len(points), np.inf)
    for a, b in pairwise(path):
        t = ((points - a) @ (b - a) / max((b - a) @ (b - a), 1e-12)).clip(0, 1)
        nearest = np.minimum(nearest, np.linalg.norm(points - a - t[:, None] * (b - a), axis=1))
    return nearest


@few_examples(6)
@given(CORNERS)
def test_follow_any_polyline_root_stays_near_path_and_reaches_end(library, graph, corners):
    height = mass_model(library.skeleton).height
    path = np.array(corners) * height
    legs = np.linalg.norm(np.diff(path, axis=0), axis=1)
    assume(legs.min() >= 0.3 * height)
    chosen = follow(library, path, graph=graph)
    assert is_walk(graph, chosen.segments)
    bare = replace(library, config=replace(library.config, feet="never"))
    new = graft(bare, scenario=chosen)
    places = new.base.world_positions()[:, library.root][:, [0, 2]]
    np.testing.assert_allclose(places[0], path[0], atol=1e-9 * height)
    assert to_path(places, path).mean() < 0.4 * height
    assert np.linalg.norm(places[-1] - path[-1]) < 0.7 * height


@few_examples(3)
@given(st.floats(0.3, 1.0) | st.floats(0.0, 0.001), st.floats(0.3, 1.0))
def test_follow_slow_segments_keep_time_limit_or_raise_value_error(library, graph, share, length):
    """Segments that hardly move cannot reach the end; the message names distance and time."""
    height, rate = mass_model(library.skeleton).height, library.rate
    slower = replace(graph, displacements=share * graph.displacements)
    lasts = library.segments.lengths[graph.segments] / rate
    speeds = np.linalg.norm(slower.displacements, axis=1) / height / lasts
    fast = speeds >= 0.25
    usual = (length + 1) / (np.average(speeds[fast], weights=lasts[fast]) if fast.any() else 0.25)
    path = [[0.0, 0.0], [length * height, 0.0]]
    if share < 0.01:
        message = rf"follows the whole path: .* units in {10 * usual:.4g} s; add"
        with pytest.raises(ValueError, match=message):
            follow(library, path, graph=slower)
        return
    chosen = follow(library, path, graph=slower)
    assert library.segments.lengths[chosen.segments].sum() / rate <= 10 * usual + 1e-9


def test_follow_invalid_path_raises_value_error(library):
    for path, message in (
        ([[1.0, 2.0], [1.0, 2.0]], "`path` must have at least two different points"),
        ([[1.0, 2.0, 3.0]], r"`path` must have shape \(n_points, 2\)"),
    ):
        with pytest.raises(ValueError, match=message):
            follow(library, path)
