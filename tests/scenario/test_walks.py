"""Random walks: allowed transitions, exact lengths, beats, probabilities and repeated runs."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import mograft as mg
from mograft import graft
from mograft.scenario import Scenario, fill, repetition, to_beats, walk
from tests.scenario.graphs import graph_from_costs, is_walk
from tests.strategies import SEEDS


@settings(max_examples=10, deadline=None)
@given(SEEDS, st.floats(0.1, 90.0), st.integers(60, 2000))
def test_walk_and_fill_use_transitions_and_reach_duration_or_frames(
    library, graph, seed, duration, frames
):
    for make, wanted in ((walk, duration), (fill, frames)):
        chosen = make(library, wanted, seed, graph=graph)
        assert is_walk(graph, chosen)
        np.testing.assert_array_equal(make(library, wanted, seed, graph=graph), chosen)
        lengths = library.segments.lengths[chosen]
        least = frames - 1 if make is fill else duration * library.rate
        assert lengths.sum() >= least > lengths[:-1].sum()
        assert make is walk or lengths.sum() == least


@settings(max_examples=15, deadline=None)
@given(SEEDS, st.integers(3, 8), st.integers(2, 40))
def test_fill_small_graph_succeeds_exactly_where_enumeration_does(library, seed, n, frames):
    """The oracle enumerates all walks."""
    rng = np.random.default_rng(seed)
    costs = np.where(rng.random((n, n)) < 0.4, rng.random((n, n)), np.inf)
    costs[np.arange(n), (np.arange(n) + 1) % n] = 0.0
    graph, lengths = graph_from_costs(costs), library.segments.lengths[:n]
    there = {(i, int(lengths[i])) for i in range(n)}
    sums = set()
    while there:
        sums |= {total for _, total in there}
        there = {
            (j, total + int(lengths[j]))
            for i, total in there
            for j in range(n)
            if np.isfinite(costs[i, j]) and total + lengths[j] <= frames - 1
        }
    if frames - 1 in sums:
        assert lengths[fill(library, frames, graph=graph)].sum() == frames - 1
    else:
        message = rf"has {frames} frames; the nearest"
        with pytest.raises(ValueError, match=message):
            fill(library, frames, graph=graph)


def test_fill_equal_lengths_are_drawn_with_walk_probabilities(library):
    """Two paths of equal length; the transition to one has half the probability."""
    likely, rarer = 0.0, float(np.radians(5) * np.log(2))
    same = int(np.flatnonzero(np.bincount(library.segments.lengths) >= 6)[0])
    own = np.flatnonzero(library.segments.lengths == same)[:6]
    costs = np.full((6, 6), np.inf)
    costs[0, 1], costs[0, 2] = likely, rarer
    costs[1, 3], costs[2, 4], costs[3, 5], costs[4, 5], costs[5, 0] = 0.0, 0.0, 0.0, 0.0, 0.0
    graph = replace(graph_from_costs(costs), segments=own)
    walks = [fill(library, 4 * same + 1, seed, graph=graph) for seed in range(600)]
    through = [int(chosen[1]) for chosen in walks if chosen[0] == own[0]]
    share = through.count(int(own[1])) / len(through)
    assert share == pytest.approx(2 / 3, abs=4 * np.sqrt(2 / 9 / len(through)))


@settings(max_examples=10, deadline=None)
@given(SEEDS, st.floats(0.35, 1.2), st.integers(2, 40))
def test_to_beats_segments_end_at_rest_on_every_beat(library, graph, seed, period, count):
    beats = period * np.arange(count)
    chosen = to_beats(library, beats, seed, graph=graph)
    assert is_walk(graph, chosen.segments)
    ends = np.cumsum(chosen.lengths)
    frames = np.round(beats * library.rate)
    assert set(frames[1:]) <= set(ends)
    assert ends[-1] == frames[-1]
    rests = graph.is_at_rest[np.searchsorted(graph.segments, chosen.segments)]
    assert rests[np.isin(ends, frames[1:])].all()
    own = library.segments.lengths[chosen.segments]
    assert (np.abs(chosen.lengths - own) <= 0.18 * own + 1).all()
    assert (chosen.lengths >= 1).all()


def test_walk_long_duration_on_few_segments_uses_all_evenly(library, monkeypatch):
    """Visit counts grow beyond the range of exp(-uses); only differences may matter."""
    monkeypatch.setattr("mograft.scenario.walks._MAX_COMPARED_VISITS", 3)  # to save time
    costs = np.zeros((5, 5))
    np.fill_diagonal(costs, np.inf)
    few = graph_from_costs(costs)
    chosen = walk(library, 3000.0, 1, graph=few)
    uses = np.bincount(chosen, minlength=5)
    assert uses.min() > 800
    assert uses.max() - uses.min() < 10
    for gap in (1, 2):
        assert (chosen[gap:] != chosen[:-gap]).all()


TABLE = r"a walk on \d+ segments must have at most \d+ frames"
SPAN = "`beats` must span at most 86400 s"
DURATION = r"`duration` must be (above 0 and at most 86400 s|finite)"


@pytest.mark.parametrize(
    ("make", "argument", "seed", "message"),
    [
        *((walk, own, 0, DURATION) for own in (1e300, 86_400.1, np.inf, np.nan, 0, -1.0, True)),
        (walk, 1.0, -1, "`seed` must be .*, got -1"),
        (fill, 10**9 + 1, 0, TABLE + ", got 1000000001"),
        *((fill, own, 0, f"`frames` must be .*, got {own}") for own in (1, 2.5, True)),
        (to_beats, [0.0], 0, "`beats` must contain at least two times in seconds, got 1"),
        (to_beats, [0.0, 1.0, 1.0], 0, "`beats` must ascend, got 1 after 1"),
        (to_beats, [0.0, 1.0, 1.01], 0, "`beats` must be at least a frame apart, got 1 "),
        *((to_beats, [0.0, last], 0, SPAN) for last in (1e300, 1.7e308, 86_401.0)),
        (to_beats, [0.0, 1.0, 1.034, 2.0], 0, "comes to rest on all beats from that at 1 s"),
    ],
)
def test_walks_invalid_argument_raises_value_error(library, graph, make, argument, seed, message):
    with pytest.raises(ValueError, match=message):
        make(library, argument, seed, graph=graph)


def test_to_beats_table_above_limit_raises_value_error(library, graph, monkeypatch):
    monkeypatch.setattr("mograft.scenario.walks._MAX_TABLE", 1 << 10)
    with pytest.raises(ValueError, match=TABLE):
        to_beats(library, [0.0, 1.0, 100.0], graph=graph)


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
