"""Laws of scenarios: what may follow what, and that rearranged motions do not jump."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst
from scipy.sparse.csgraph import connected_components

from mograft import Config, Library, graft, rotations
from mograft.dancer import dance
from mograft.scenario import Transitions, _strongest, transitions, walk
from tests.hierarchies import DANCES, recording
from tests.strategies import SEEDS


@pytest.fixture(scope="module")
def library():
    return Library.build(dance(seed=1, strides=1).motion)


@pytest.fixture(scope="module")
def graph(library):
    return transitions(library)


@given(npst.arrays(bool, st.integers(1, 12).map(lambda n: (n, n))))
def test_the_strongest_component_is_scipys(edges):
    n, labels = connected_components(edges, connection="strong")
    sizes = np.bincount(labels, minlength=n)
    found = _strongest(edges)
    assert len(found) == sizes.max()
    assert len(np.unique(labels[found])) == 1


def test_a_long_chain_does_not_exhaust_the_stack():
    edges = np.eye(5000, k=1, dtype=bool)
    edges[-1, 0] = True
    assert len(_strongest(edges)) == 5000


def test_transitions_are_those_that_are_allowed(library, graph):
    n = len(graph.segments)
    at = {int(segment): index for index, segment in enumerate(graph.segments)}
    for segment, index in at.items():
        assert not np.isfinite(graph.costs[index, index])
        if segment - 1 in at:
            assert graph.costs[at[segment - 1], index] == 0.0
            assert not np.isfinite(graph.costs[index, at[segment - 1]])
    finite = graph.costs[np.isfinite(graph.costs)]
    assert finite.max() <= graph.limit <= np.radians(45) * 1.25
    assert connected_components(np.isfinite(graph.costs), connection="strong")[0] == 1
    assert n > len(library.segments) / 10


@settings(max_examples=20)
@given(SEEDS, st.floats(0.1, 90.0))
def test_a_walk_goes_only_where_it_may_and_as_long_as_it_should(library, graph, seed, duration):
    way = walk(library, duration, seed, graph=graph)
    places = np.searchsorted(graph.segments, way)
    assert np.isfinite(graph.costs[places[:-1], places[1:]]).all()
    lengths = library.segments.lengths[way]
    assert lengths.sum() >= duration * library.rate > lengths[:-1].sum()
    np.testing.assert_array_equal(walk(library, duration, seed, graph=graph), way)


def test_a_walk_comes_back_late_where_it_has_a_choice(library):
    costs = np.zeros((5, 5))
    np.fill_diagonal(costs, np.inf)
    way = walk(library, 60.0, graph=Transitions(np.arange(5), costs, 0.0))
    for gap in (1, 2):
        assert (way[gap:] != way[:-gap]).all()


def test_a_clips_own_order_gives_the_clip(library):
    """The base is then the clip to the bit, so the graft is that on the clip."""
    own = library.segments.of_clip(0)
    new, plain = graft(library, scenario=own, seed=3), graft(library, seed=3)
    np.testing.assert_array_equal(new.base.rotations, plain.base.rotations)
    np.testing.assert_array_equal(new.base.positions, plain.base.positions)
    np.testing.assert_array_equal(new.motion.rotations, plain.motion.rotations)


def test_the_base_group_of_a_scenario_is_kept(library, graph):
    new = graft(library, scenario=walk(library, 8.0, 1, graph=graph), seed=1)
    own = library.joints(library.groups.base)
    np.testing.assert_array_equal(new.motion.rotations[:, own], new.base.rotations[:, own])
    np.testing.assert_array_equal(new.motion.positions[:, own], new.base.positions[:, own])
    lengths = library.segments.lengths[list(new.scenario)]
    assert new.motion.n_frames == lengths.sum() + 1
    assert [s.start for s in new.substitutions] == [0, *np.cumsum(lengths)[:-1]]
    document = new.as_dict()
    assert len(document["scenario"]) == len(new.scenario)


def speeds(motion, root, up):
    """The root's speeds over the floor per frame, and its turns about up in radians."""
    turned, placed = motion.world()
    steps = np.linalg.norm(np.delete(np.diff(placed[:, root], axis=0), up, axis=1), axis=1)
    turns = rotations.multiply(turned[1:, root], rotations.inverse(turned[:-1, root]))
    yaws = rotations.log(rotations.twist(turns, up))
    return steps, np.linalg.norm(yaws, axis=1)


@pytest.mark.filterwarnings("ignore")  # of faults in the recordings
@pytest.mark.parametrize("name", ["dancer", *DANCES])
def test_a_minute_of_each_dance_goes_no_faster_than_the_dance(name, library):
    if name != "dancer":
        library = Library.build(recording(name))
    motion = library.clips[0]
    new = graft(library, scenario=walk(library, 60.0, seed=1))
    assert new.motion.duration >= 60.0 - 1e-6
    for own, captured in zip(
        speeds(new.motion, library.root, library.up),
        speeds(motion, library.root, library.up),
        strict=True,
    ):
        assert own.max() <= 1.15 * captured.max()


@pytest.mark.filterwarnings("ignore:group")  # twenty frames are little to compare
def test_bad_arguments_are_refused_by_name(library):
    n = len(library.segments)
    with pytest.raises(ValueError, match="duration must be above 0 seconds, got 0"):
        walk(library, 0)
    with pytest.raises(ValueError, match="seed must be a whole number from 0, got -1"):
        walk(library, 1.0, -1)
    with pytest.raises(ValueError, match=f"scenario must be of segments 0 to {n - 1}, got {n}"):
        graft(library, scenario=[0, n])
    with pytest.raises(ValueError, match="scenario must hold at least one segment, got none"):
        graft(library, scenario=[])
    with pytest.raises(ValueError, match="base must not be given with a scenario"):
        graft(library, library.clips[0], scenario=[0, 1])
    short = replace(library.clips[0][:20], name="short")
    with pytest.raises(ValueError, match=r"can follow one another|but as they were captured"):
        transitions(Library.build(short, config=Config()))
