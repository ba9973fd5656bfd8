"""Repeated runs of segments: their measure, and their penalty in walks."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import mograft as mg
from mograft import graft
from mograft.scenario import Scenario, fill, repetition, to_beats, walk
from tests.scenario.graphs import graph_from_costs, is_walk
from tests.strategies import SEEDS

SEQUENCES = st.lists(st.integers(0, 3), min_size=1, max_size=24)


def longest_repeat(items, lengths):
    """Compare all pairs of runs that do not overlap."""
    n = len(items)
    return max(
        (
            sum(lengths[item] for item in items[i : i + size])
            for size in range(1, n // 2 + 1)
            for i in range(n - size + 1)
            for j in range(i + size, n - size + 1)
            if items[i : i + size] == items[j : j + size]
        ),
        default=0,
    )


@given(SEQUENCES)
def test_repetition_random_sequence_matches_comparison_of_all_runs(library, items):
    lengths = library.segments.lengths[:4].tolist()
    found = repetition(library, items)
    assert found.longest_repeat * library.rate == pytest.approx(longest_repeat(items, lengths))
    assert found.distinct_share == len(set(items)) / len(items)
    assert repetition(library, Scenario(items)) == found
    for outside in (-1, 10**6):
        with pytest.raises(ValueError, match=f"must contain only segments 0 to .*{outside}"):
            repetition(library, [*items, outside])


def ring_graph(n):
    """Free transitions round a ring, and expensive ones between all others."""
    costs = np.full((n, n), np.radians(45.0))
    np.fill_diagonal(costs, np.inf)
    costs[np.arange(n), (np.arange(n) + 1) % n] = 0.0
    return graph_from_costs(costs)


@settings(max_examples=10, deadline=None)
@given(SEEDS, st.integers(20, 80))
def test_walk_many_alternatives_never_repeats_six_seconds(library, seed, n):
    graph = ring_graph(n)
    assert repetition(library, walk(library, 60.0, seed, graph=graph)).longest_repeat < 6.0


@settings(max_examples=20, deadline=None)
@given(SEEDS, st.integers(3, 12), st.sampled_from([0.0, 3.0, 1e6]))
def test_walk_any_penalty_and_connected_graph_reaches_duration(library, seed, n, penalty):
    """A ring has one successor each: all repeats are unavoidable."""
    rng = np.random.default_rng(seed)
    costs = np.where(rng.random((n, n)) < 0.1, rng.random((n, n)), np.inf)
    np.fill_diagonal(costs, np.inf)
    costs[np.arange(n), (np.arange(n) + 1) % n] = 0.0
    graph = graph_from_costs(costs)
    chosen = walk(library, 30.0, seed, graph=graph, repeat_penalty=penalty)
    assert is_walk(graph, chosen)
    assert library.segments.lengths[chosen].sum() >= 30.0 * library.rate
    frames = int(library.segments.lengths[chosen].sum()) + 1
    filled = fill(library, frames, seed, graph=graph, repeat_penalty=penalty)
    assert library.segments.lengths[filled].sum() == frames - 1


def test_walk_costly_new_run_is_preferred_to_free_repeated_run(library):
    """Two runs without a choice; the transition to the second costs 25°."""
    n = 41
    costs = np.full((n, n), np.inf)
    costs[np.arange(20), np.arange(1, 21)] = 0.0
    costs[20, 0], costs[20, 21] = 0.0, np.radians(25.0)
    costs[np.arange(21, n), [*range(22, n), 20]] = 0.0
    graph = graph_from_costs(costs)
    for seed in range(10):
        chosen = walk(library, 60.0, seed, graph=graph)
        entered = chosen[1:][chosen[:-1] == 20]
        assert set(entered[:3]) == {0, 21}


def test_walks_invalid_repeat_penalty_raises_value_error(library, graph):
    for make, argument in ((walk, 5.0), (fill, 300), (to_beats, [0.0, 1.0, 2.0])):
        for penalty in (-1.0, np.nan, np.inf):
            with pytest.raises(ValueError, match="`repeat_penalty` must"):
                make(library, argument, graph=graph, repeat_penalty=penalty)


def test_graft_report_of_scenario_has_repetition(library):
    new = graft(library, scenario=[0, 1, 5, 0, 1])
    seconds = library.segments.lengths[:2].sum() / library.rate
    assert f"5 segments, 60% different; longest repeat {seconds:.1f} s" in new.report()
    expected = {"longest_repeat_seconds": round(seconds, 4), "distinct_share": 0.6}
    assert mg.graft_record(new)["repetition"] == expected
    assert mg.graft_record(graft(library))["repetition"] is None
