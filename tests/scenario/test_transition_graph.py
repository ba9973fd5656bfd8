"""Transition graphs: allowed transitions, their costs, and strong components."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst
from scipy.sparse.csgraph import connected_components

from mograft import Library
from mograft._util.gaussian import gaussian_filter
from mograft.analysis.segmentation import kinetic_energy
from mograft.body.mass import mass_model
from mograft.motion import rotations
from mograft.scenario import transitions
from mograft.scenario.transition_graph import _exits, largest_strong_component
from tests.scenario.graphs import cost_matrix
from tests.strategies import SEEDS


@given(npst.arrays(bool, st.integers(1, 12).map(lambda n: (n, n))))
def test_largest_strong_component_random_graph_matches_scipy(edges):
    n, labels = connected_components(edges, connection="strong")
    sizes = np.bincount(labels, minlength=n)
    found = largest_strong_component(len(edges), *np.nonzero(edges))
    assert len(found) == sizes.max()
    assert len(np.unique(labels[found])) == 1


def test_largest_strong_component_long_cycle_needs_no_recursion():
    at = np.arange(50_000)
    assert len(largest_strong_component(len(at), at, np.append(at[1:], 0))) == len(at)


def cost(library, i, j):
    """The cost of a transition, computed from the docstring of `transitions`."""
    cut, root, up = library.segments, library.root, library.up
    (clip,) = library.clips
    height = mass_model(clip.skeleton).height
    joints = np.setdiff1d(library.joints("lower"), [root])
    turned, placed = clip.world_transforms()

    def velocity(quats, frame):
        steps = rotations.log(rotations.multiply(rotations.inverse(quats[:-1]), quats[1:]))
        if frame == 0:
            return 1.5 * steps[0] - 0.5 * steps[1]
        if frame == len(steps):
            return 1.5 * steps[-1] - 0.5 * steps[-2]
        return (steps[frame - 1] + steps[frame]) / 2

    def state(frame):
        quat = turned[frame, root]
        back = rotations.inverse(rotations.twist(quat, up))
        chosen = rotations.rotate(back, np.gradient(placed[:, root], axis=0)[frame]) * clip.rate
        return (
            clip.rotations[frame, joints],
            rotations.multiply(back, quat),
            placed[frame, root, up] / height,
            velocity(clip.rotations[:, joints], frame) * clip.rate,
            velocity(turned[:, root], frame) * clip.rate,
            chosen / height,
        )

    a, b = state(cut.stop[i]), state(cut.start[j])
    return (
        rotations.angle(a[0], b[0]).mean()
        + rotations.angle(a[1], b[1])
        + 2 * abs(a[2] - b[2])
        + 0.1 * np.linalg.norm(a[3] - b[3], axis=1).mean()
        + 0.1 * np.linalg.norm(a[4] - b[4])
        + 0.2 * np.linalg.norm(a[5] - b[5])
    )


def test_transitions_dancer_graph_is_strongly_connected_and_allowed(library, graph):
    costs = cost_matrix(graph)
    at = {int(segment): index for index, segment in enumerate(graph.segments)}
    for segment, index in at.items():
        assert not np.isfinite(costs[index, index])
        if segment - 1 in at:
            assert costs[at[segment - 1], index] == 0.0
            assert not np.isfinite(costs[index, at[segment - 1]])
    assert graph.limit <= np.radians(45) * 1.25
    assert graph.costs.max() <= np.radians(60)
    assert connected_components(np.isfinite(costs), connection="strong")[0] == 1
    assert len(graph.segments) > len(library.segments) / 2
    np.testing.assert_allclose(
        np.bincount(graph.sources, graph.probabilities(), minlength=len(costs)), 1.0
    )


def test_transitions_costs_match_oracle(library, graph):
    for edge in np.random.default_rng(0).choice(len(graph.targets), 40):
        i, j = graph.segments[graph.sources[edge]], graph.segments[graph.targets[edge]]
        expected = 0.0 if j == i + 1 else cost(library, i, j)
        assert graph.costs[edge] == pytest.approx(expected, abs=1e-9)


def test_transitions_never_meet_at_the_greatest_root_accelerations(library, graph):
    """The acceleration is computed from the docstring of `transitions`."""
    (clip,), cut, up = library.clips, library.segments, library.up
    places = np.delete(clip.world_transforms()[1][:, library.root], up, axis=1)
    twice = np.gradient(np.gradient(places, axis=0), axis=0) * clip.rate**2
    acceleration = np.linalg.norm(twice, axis=1)
    count = round(0.15 * clip.rate)
    starts = np.array([acceleration[frame : frame + count + 1].max() for frame in cut.start])
    ends = np.array([acceleration[max(frame - count, 0) : frame + 1].max() for frame in cut.stop])
    limit = np.quantile(np.concatenate([starts, ends]), 0.95)
    sources, targets = graph.segments[graph.sources], graph.segments[graph.targets]
    is_seam = targets != sources + 1
    assert is_seam.sum() > 100
    assert max(ends[sources[is_seam]].max(), starts[targets[is_seam]].max()) <= limit * (1 + 1e-9)


@given(npst.arrays(int, st.integers(2, 30), elements=st.integers(4, 32)), SEEDS)
def test_exits_are_the_cheapest_of_each_period_without_choice(sixteenths, seed):
    seconds = sixteenths / 16.0
    rng = np.random.default_rng(seed)
    n = len(seconds)
    n_edges = rng.choice([1, 1, 1, 2], n)
    sources = np.repeat(np.arange(n), n_edges + 3)
    costs = rng.uniform(0, np.radians(90), len(sources))
    is_edge = np.concatenate([np.arange(count + 3) < count for count in n_edges])
    found = _exits(sources, costs, is_edge, seconds)
    choice, elapsed, options = -1, 0.0, {}
    for node, run in enumerate(np.split(np.arange(len(sources)), np.cumsum(n_edges + 3)[:-1])):
        elapsed += seconds[node]
        if n_edges[node] > 1:
            choice, elapsed = node, 0.0
        options.setdefault((choice, int(elapsed // 2.0)), []).extend(run[n_edges[node] :])
    for (_, period), edges in options.items():
        cheapest = min(edges, key=lambda edge: costs[edge])
        is_exit = period >= 1 and costs[cheapest] <= np.radians(60)
        assert found[edges].tolist() == [is_exit and edge == cheapest for edge in edges]
    assert not found[is_edge].any()


def test_transitions_many_clips_keep_the_nearest(library, monkeypatch):
    clip = library.clips[0]
    several = Library.build([replace(clip[at : at + 300], name=f"c{at}") for at in range(12)])
    whole = transitions(several)
    assert len(whole.targets) <= 65 * len(whole.segments)
    some = transitions(several, ["c1*", "c2"])
    names = {several.entries[c].name for c in several.segments.clip[some.segments]}
    assert names <= {"c1", "c10", "c11", "c2"}
    monkeypatch.setattr("mograft.scenario.transition_graph._MAX_SUCCESSORS", len(several.segments))
    full, few = cost_matrix(transitions(several)), cost_matrix(whole)
    # The costs of the kept transitions are unchanged.
    if full.shape == few.shape:
        kept = np.isfinite(few)
        np.testing.assert_array_equal(few[kept], full[kept])
    monkeypatch.setattr("mograft.scenario.transition_graph._MAX_SEGMENTS", 10)
    with pytest.raises(ValueError, match="a graph must have at most 10 segments, got"):
        transitions(several)


def test_transitions_is_at_rest_marks_energy_minima(library, graph):
    motion, config = library.clips[0], library.config
    energy = gaussian_filter(kinetic_energy(motion), config.smoothing * motion.rate)
    stops = library.segments.stop[graph.segments]
    inner = (stops > 2) & (stops < motion.n_frames - 3)
    least = energy[stops[inner]] <= np.minimum(energy[stops[inner] - 2], energy[stops[inner] + 2])
    assert least[graph.is_at_rest[inner]].all()


@pytest.mark.filterwarnings("ignore:group")  # twenty frames are too few for an embedding
def test_transitions_invalid_clips_raise_value_error(library):
    for empty in ([], iter([]), np.array([], str)):
        with pytest.raises(ValueError, match="`clips` must have segments that are not excluded"):
            transitions(library, empty)
    excluded = replace(library, is_donor=np.zeros(len(library.segments), bool))
    with pytest.raises(ValueError, match="the library must have segments that are not excluded"):
        transitions(excluded)
    with pytest.raises(ValueError, match="`clips` must match at least one of dance; got 'waltz'"):
        transitions(library, "waltz")
    short = replace(library.clips[0][:20], name="short")
    with pytest.raises(ValueError, match=r"reachable from one another|equal foot contacts"):
        transitions(Library.build(short))
