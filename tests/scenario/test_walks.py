"""Laws of scenarios: what may follow what, and that rearranged motions do not jump."""

import re
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst
from scipy.sparse.csgraph import connected_components

from mograft import Config, Library, graft
from mograft.body.mass import mass_model
from mograft.dancer import dance
from mograft.motion import rotations
from mograft.scenario.transition_graph import _ends, _strongest
from mograft.scenario.walks import (
    Scenario,
    Transitions,
    _pace,
    fill,
    follow,
    to_beats,
    transitions,
    walk,
)
from tests.hierarchies import DANCES, DATA, recording
from tests.strategies import SEEDS


@pytest.fixture(scope="module")
def library():
    return Library.build(dance(seed=1, strides=1).motion)


@pytest.fixture(scope="module")
def graph(library):
    return transitions(library)


def dense(graph):
    """The costs of a graph as a matrix, infinite where there is no transition."""
    n = len(graph.segments)
    costs = np.full((n, n), np.inf)
    costs[graph.source, graph.to] = graph.costs
    return costs


def graph_of(costs):
    """A graph of segments 0 to n - 1 that stay where they are."""
    n = len(costs)
    source, to = np.nonzero(np.isfinite(costs))
    first = np.searchsorted(source, np.arange(n + 1))
    ways, turns = np.zeros((n, 3)), np.zeros(len(to))
    shifts, rests = np.zeros((len(to), 3)), np.ones(n, bool)
    return Transitions(np.arange(n), first, to, costs[source, to], 0.0, ways, turns, shifts, rests)


@given(npst.arrays(bool, st.integers(1, 12).map(lambda n: (n, n))))
def test_the_strongest_component_is_scipys(edges):
    n, labels = connected_components(edges, connection="strong")
    sizes = np.bincount(labels, minlength=n)
    found = _strongest(len(edges), *np.nonzero(edges))
    assert len(found) == sizes.max()
    assert len(np.unique(labels[found])) == 1


def test_a_long_chain_does_not_exhaust_the_stack():
    at = np.arange(50_000)
    assert len(_strongest(len(at), at, np.append(at[1:], 0))) == len(at)


def cost(library, i, j):
    """What a transition costs, by the words of the docstring."""
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
        way = rotations.rotate(back, np.gradient(placed[:, root], axis=0)[frame]) * clip.rate
        return (
            clip.rotations[frame, joints],
            rotations.multiply(back, quat),
            placed[frame, root, up] / height,
            velocity(clip.rotations[:, joints], frame) * clip.rate,
            velocity(turned[:, root], frame) * clip.rate,
            way / height,
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


def test_transitions_are_those_that_are_allowed(library, graph):
    costs = dense(graph)
    at = {int(segment): index for index, segment in enumerate(graph.segments)}
    for segment, index in at.items():
        assert not np.isfinite(costs[index, index])
        if segment - 1 in at:
            assert costs[at[segment - 1], index] == 0.0
            assert not np.isfinite(costs[index, at[segment - 1]])
    assert graph.costs.max() <= graph.limit <= np.radians(45) * 1.25
    assert connected_components(np.isfinite(costs), connection="strong")[0] == 1
    assert len(graph.segments) > len(library.segments) / 2
    np.testing.assert_allclose(
        np.bincount(graph.source, graph.chances(), minlength=len(costs)), 1.0
    )


def test_costs_are_what_the_plain_version_says(library, graph):
    for edge in np.random.default_rng(0).choice(len(graph.to), 40):
        i, j = graph.segments[graph.source[edge]], graph.segments[graph.to[edge]]
        expected = 0.0 if j == i + 1 else cost(library, i, j)
        assert graph.costs[edge] == pytest.approx(expected, abs=1e-9)


def test_points_are_as_far_apart_as_the_cost_says_of_one_joint(library):
    """The root mean square of a single term is that term, so far as angles are small."""
    starts, _ = _ends(library, np.arange(3))
    n_joints = starts.poses.shape[1]
    turned = rotations.multiply(starts.poses, rotations.exp(np.full((1, n_joints, 3), 1e-4)))
    moved = replace(starts, poses=-turned)  # the sign of a quaternion means nothing
    apart = np.linalg.norm(moved.points() - starts.points(), axis=1)
    np.testing.assert_allclose(apart, np.sqrt(3) * 1e-4, rtol=1e-3)
    moved = replace(starts, heights=starts.heights + 0.3)
    np.testing.assert_allclose(np.linalg.norm(moved.points() - starts.points(), axis=1), 0.6)


def test_a_graph_of_many_clips_keeps_only_the_nearest_and_reads_each_once(library, monkeypatch):
    asked = []

    class Counted(tuple):
        def __getitem__(self, index):
            asked.append(index)
            return super().__getitem__(index)

    copies = 12
    clip = library.clips[0]
    several = Library.build([replace(clip[at : at + 300], name=f"c{at}") for at in range(copies)])
    counted = replace(several, clips=Counted(several.clips))
    whole = transitions(counted)
    assert sorted(asked) == list(range(copies))
    assert len(whole.to) <= 65 * len(whole.segments)
    some = transitions(several, ["c1*", "c2"])
    names = {several.entries[c].name for c in several.segments.clip[some.segments]}
    assert names <= {"c1", "c10", "c11", "c2"}
    monkeypatch.setattr("mograft.scenario.transition_graph._FOLLOWERS", len(several.segments))
    full, few = dense(transitions(several)), dense(whole)
    # What is kept costs what it costs, and of each segment the cheapest is kept.
    if full.shape == few.shape:
        kept = np.isfinite(few)
        np.testing.assert_array_equal(few[kept], full[kept])
    monkeypatch.setattr("mograft.scenario.transition_graph._MOST", 10)
    with pytest.raises(ValueError, match="a graph may be found of 10 segments, the library has"):
        transitions(several)


@settings(max_examples=20, deadline=None)
@given(SEEDS, st.floats(0.1, 90.0))
def test_a_walk_goes_only_where_it_may_and_as_long_as_it_should(library, graph, seed, duration):
    way = walk(library, duration, seed, graph=graph)
    places = np.searchsorted(graph.segments, way)
    assert np.isfinite(dense(graph)[places[:-1], places[1:]]).all()
    lengths = library.segments.lengths[way]
    assert lengths.sum() >= duration * library.rate > lengths[:-1].sum()
    np.testing.assert_array_equal(walk(library, duration, seed, graph=graph), way)


def test_a_walk_comes_back_late_where_it_has_a_choice(library):
    costs = np.zeros((5, 5))
    np.fill_diagonal(costs, np.inf)
    way = walk(library, 60.0, graph=graph_of(costs))
    for gap in (1, 2):
        assert (way[gap:] != way[:-gap]).all()


def test_a_walk_does_not_stay_where_it_is_cheap(library):
    """Five segments that stand, one way out of them and one back: it is taken, now and then."""
    costs = np.full((10, 10), np.inf)
    costs[:5, :5] = 0.0
    costs[4, 5] = np.radians(25)
    costs[np.arange(5, 10), [6, 7, 8, 9, 0]] = 0.0
    np.fill_diagonal(costs, np.inf)
    ways = [walk(library, 60.0, seed, graph=graph_of(costs)) for seed in range(10)]
    assert all((way >= 5).any() for way in ways)


def is_way(graph, way):
    places = np.searchsorted(graph.segments, way)
    return np.isfinite(dense(graph)[places[:-1], places[1:]]).all()


@settings(max_examples=20, deadline=None)
@given(SEEDS, st.integers(60, 2000))
def test_a_filled_walk_is_of_exactly_so_many_frames(library, graph, seed, frames):
    way = fill(library, frames, seed, graph=graph)
    assert library.segments.lengths[way].sum() == frames - 1
    assert is_way(graph, way)
    np.testing.assert_array_equal(fill(library, frames, seed, graph=graph), way)


@settings(max_examples=30, deadline=None)
@given(SEEDS, st.integers(3, 8), st.integers(2, 40))
def test_it_is_filled_wherever_that_can_be(library, seed, n, frames):
    """All walks, one after the other, of a graph of a few segments."""
    rng = np.random.default_rng(seed)
    costs = np.where(rng.random((n, n)) < 0.4, rng.random((n, n)), np.inf)
    costs[np.arange(n), (np.arange(n) + 1) % n] = 0.0
    graph, lengths = graph_of(costs), library.segments.lengths[:n]
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
        with pytest.raises(ValueError, match=rf"no row of segments has {frames} frames; the near"):
            fill(library, frames, graph=graph)


def test_a_filled_walk_is_drawn_by_its_chance(library):
    """Two ways of the same length, one of them half as likely: the counts say so."""
    likely, rarer = 0.0, float(np.radians(5) * np.log(2))
    same = int(np.flatnonzero(np.bincount(library.segments.lengths) >= 6)[0])
    own = np.flatnonzero(library.segments.lengths == same)[:6]
    costs = np.full((6, 6), np.inf)
    costs[0, 1], costs[0, 2] = likely, rarer
    costs[1, 3], costs[2, 4], costs[3, 5], costs[4, 5], costs[5, 0] = 0.0, 0.0, 0.0, 0.0, 0.0
    graph = replace(graph_of(costs), segments=own)
    ways = [fill(library, 4 * same + 1, seed, graph=graph) for seed in range(600)]
    through = [int(way[1]) for way in ways if way[0] == own[0]]
    share = through.count(int(own[1])) / len(through)
    assert share == pytest.approx(2 / 3, abs=4 * np.sqrt(2 / 9 / len(through)))


@settings(max_examples=20, deadline=None)
@given(SEEDS, st.floats(0.35, 1.2), st.integers(2, 40))
def test_segments_end_at_rest_on_every_beat(library, graph, seed, period, count):
    beats = period * np.arange(count)
    way = to_beats(library, beats, seed, graph=graph)
    assert is_way(graph, way.segments)
    ends = np.cumsum(way.lengths)
    frames = np.round(beats * library.rate)
    assert set(frames[1:]) <= set(ends)
    assert ends[-1] == frames[-1]
    rests = graph.rests[np.searchsorted(graph.segments, way.segments)]
    assert rests[np.isin(ends, frames[1:])].all()
    own = library.segments.lengths[way.segments]
    assert (np.abs(way.lengths - own) <= 0.18 * own + 1).all()
    assert (way.lengths >= 1).all()


def test_a_beat_that_cannot_be_met_is_named(library, graph):
    with pytest.raises(ValueError, match=r"come to rest at the beats from 1 s on"):
        to_beats(library, [0.0, 1.0, 1.034, 2.0], graph=graph)


def test_rests_are_where_the_energy_is_least(library, graph):
    from mograft.analysis.segmentation import gaussian, kinetic_energy

    motion, config = library.clips[0], library.config
    energy = gaussian(kinetic_energy(motion), config.smoothing * motion.rate)
    stops = library.segments.stop[graph.segments]
    inner = (stops > 2) & (stops < motion.n_frames - 3)
    least = energy[stops[inner]] <= np.minimum(energy[stops[inner] - 2], energy[stops[inner] + 2])
    assert least[graph.rests[inner]].all()


CORNERS = st.lists(
    st.tuples(st.floats(-2.0, 2.0), st.floats(-2.0, 2.0)), min_size=2, max_size=4, unique=True
)


def to_path(points, path):
    """How far points are from a polyline."""
    nearest = np.full(len(points), np.inf)
    for a, b in pairwise(path):
        t = ((points - a) @ (b - a) / max((b - a) @ (b - a), 1e-12)).clip(0, 1)
        nearest = np.minimum(nearest, np.linalg.norm(points - a - t[:, None] * (b - a), axis=1))
    return nearest


@settings(max_examples=15, deadline=None)
@given(CORNERS)
def test_a_path_is_followed_to_its_end(library, graph, corners):
    height = mass_model(library.skeleton).height
    path = np.array(corners) * height
    legs = np.linalg.norm(np.diff(path, axis=0), axis=1)
    if legs.min() < 0.3 * height:
        return
    way = follow(library, path, graph=graph)
    assert is_way(graph, way.segments)
    bare = replace(library, config=replace(library.config, feet="never"))
    new = graft(bare, scenario=way)
    places = new.base.world_positions()[:, library.root][:, [0, 2]]
    np.testing.assert_allclose(places[0], path[0], atol=1e-9 * height)
    assert to_path(places, path).mean() < 0.4 * height
    assert np.linalg.norm(places[-1] - path[-1]) < 0.7 * height


@settings(max_examples=10, deadline=None)
@given(st.floats(0.3, 1.0) | st.floats(0.0, 0.001), st.floats(0.3, 2.0))
def test_a_path_takes_no_longer_than_ten_times_its_time(library, graph, share, length):
    """Those who stand do not get along it, whatever it costs them: that is said, with numbers."""
    height, rate = mass_model(library.skeleton).height, library.rate
    slower = replace(graph, ways=share * graph.ways)
    lasts = library.segments.lengths[graph.segments] / rate
    speeds = np.linalg.norm(slower.ways, axis=1) / height / lasts
    fast = speeds >= 0.25
    usual = (length + 1) / (np.average(speeds[fast], weights=lasts[fast]) if fast.any() else 0.25)
    path = [[0.0, 0.0], [length * height, 0.0]]
    if share < 0.01:
        message = rf"along the path of .* in {10 * usual:.4g} s, ten times"
        with pytest.raises(ValueError, match=message):
            follow(library, path, graph=slower)
        return
    way = follow(library, path, graph=slower)
    assert library.segments.lengths[way.segments].sum() / rate <= 10 * usual + 1e-9


SPANS = st.lists(st.tuples(st.floats(0.0, 3.0), st.floats(0.1, 2.0)), max_size=8)


@given(SPANS, SPANS)
def test_those_who_stand_do_not_slow_the_pace(segments, more):
    """The pace is the way of those that travel by the time that they take."""
    ways, lasts = np.array(segments).reshape(-1, 2).T
    idle = np.array(more).reshape(-1, 2).T * [[0.05], [1.0]]
    idle = idle[:, idle[0] < 0.2 * idle[1]]
    pace = _pace(ways, lasts)
    assert pace >= 0.25 * (1 - 1e-12)
    both = np.concatenate([[ways, lasts], idle], axis=1)
    assert _pace(*both) == pytest.approx(pace, rel=1e-12)
    if (ways >= 0.25 * lasts).all() and len(ways):
        assert pace == pytest.approx(ways.sum() / lasts.sum())


def test_a_walk_does_not_tire_of_few_segments(library):
    """After hours every segment was used too often for a number; what counts is which more."""
    costs = np.zeros((5, 5))
    np.fill_diagonal(costs, np.inf)
    few = graph_of(costs)
    way = walk(library, 3000.0, 1, graph=few)
    uses = np.bincount(way, minlength=5)
    assert uses.min() > 800
    assert uses.max() - uses.min() < 10
    assert (np.diff(way) != 0).all()


@pytest.mark.parametrize("seam", ["offset", "inertial", "displacement"])
def test_the_root_goes_where_the_search_says(library, seam):
    """Turned to the same side, and within a few hundredths of its height, after any seams."""
    bare = replace(library, config=replace(library.config, feet="never", seam=seam))
    graph = transitions(bare)
    way = Scenario(walk(bare, 60.0, 2, graph=graph), None, np.array([5.0, 0.0, 7.0]), 0.4)
    at = np.searchsorted(graph.segments, way.segments)
    assert (np.diff(way.segments) != 1).sum() >= 20
    turn, spot = way.turn, way.place
    turned, places = (
        own[:, library.root] for own in graft(bare, scenario=way).base.world_transforms()
    )
    for place, then in pairwise(at):
        edges = graph.after(int(place))
        edge = edges.start + int(np.flatnonzero(graph.to[edges] == then)[0])
        on = graph.ways[place] + graph.shifts[edge]
        spot = spot + rotations.rotate(rotations.from_axis_angle([0, 1, 0], turn), on)
        turn += graph.turns[edge]
    spot = spot + rotations.rotate(rotations.from_axis_angle([0, 1, 0], turn), graph.ways[at[-1]])
    assert np.linalg.norm((places[-1] - spot)[[0, 2]]) < 0.03 * mass_model(library.skeleton).height
    captured = library.clips[0].world_transforms()[0][
        library.segments.stop[way.segments[-1]], library.root
    ]
    apart = rotations.multiply(turned[-1], rotations.inverse(captured))
    off = rotations.multiply(rotations.inverse(rotations.from_axis_angle([0, 1, 0], turn)), apart)
    assert rotations.angle(off, rotations.IDENTITY) < 1e-9


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
    turned, placed = motion.world_transforms()
    steps = np.linalg.norm(np.delete(np.diff(placed[:, root], axis=0), up, axis=1), axis=1)
    turns = rotations.multiply(turned[1:, root], rotations.inverse(turned[:-1, root]))
    yaws = rotations.log(rotations.twist(turns, up))
    return steps, np.linalg.norm(yaws, axis=1)


ALL_DANCES = sorted(
    str(path.relative_to(DATA).with_suffix("")) for path in DATA.glob("dance_*/*.bvh")
)
FEW = "can follow one another in a circle|but as they were captured"


@pytest.mark.filterwarnings("ignore")  # of faults in the recordings
@pytest.mark.parametrize(
    "name",
    [
        "dancer",
        *DANCES,
        *(pytest.param(n, marks=pytest.mark.thorough) for n in ALL_DANCES if n not in DANCES),
    ],
)
def test_a_minute_of_each_dance_goes_no_faster_than_the_dance(name, library):
    """Than those of its segments that are in it, even, and after feet were planted."""
    if name != "dancer":
        library = Library.build(recording(name))
    try:
        graph, cut = transitions(library), library.segments
    except ValueError as error:
        if not re.search(FEW, str(error)):
            raise
        pytest.skip(f"{name} is too short to walk in")
    captured = speeds(library.clips[0], library.root, library.up)
    for seed in (1, 2, 3):
        new = graft(library, scenario=walk(library, 60.0, seed, graph=graph))
        assert new.motion.duration >= 60.0 - 1e-6
        used = np.zeros(library.clips[0].n_frames - 1, bool)
        for segment in new.scenario:
            used[cut.start[segment] : cut.stop[segment]] = True
        for own, most in zip(speeds(new.motion, library.root, library.up), captured, strict=True):
            assert own.max() <= most[used].max() * (1 + 1e-9)


@pytest.mark.filterwarnings("ignore:group")  # twenty frames are little to compare
def test_bad_arguments_are_refused_by_name(library):
    n = len(library.segments)
    with pytest.raises(ValueError, match="duration must be above 0 seconds, got 0"):
        walk(library, 0)
    for endless in (np.inf, np.nan):
        with pytest.raises(ValueError, match="duration must be finite"):
            walk(library, endless)
    with pytest.raises(ValueError, match="1000000001 frames are too many to plan among"):
        fill(library, 10**9 + 1)
    with pytest.raises(ValueError, match="frames are too many to plan among"):
        to_beats(library, [0.0, 1.0, 1e9])
    with pytest.raises(ValueError, match="seed must be a whole number from 0, got -1"):
        walk(library, 1.0, -1)
    assert len(walk(library, np.int64(1), np.int64(3))) > 0
    with pytest.raises(ValueError, match=f"scenario must be of segments 0 to {n - 1}, got {n}"):
        graft(library, scenario=[0, n])
    with pytest.raises(ValueError, match="scenario must hold at least one segment, got none"):
        graft(library, scenario=[])
    with pytest.raises(ValueError, match="base must not be given with a scenario"):
        graft(library, library.clips[0], scenario=[0, 1])
    for frames in (1, 2.5, True):
        with pytest.raises(ValueError, match=f"frames must be a whole number from 2, got {frames}"):
            fill(library, frames)
    for beats in ([0.0], [0.0, 1.0, 1.0]):
        with pytest.raises(ValueError, match="beats must be two or more times in seconds"):
            to_beats(library, beats)
    with pytest.raises(ValueError, match="path must have at least two different points"):
        follow(library, [[1.0, 2.0], [1.0, 2.0]])
    with pytest.raises(ValueError, match=r"path must have shape \(n_points, 2\)"):
        follow(library, [[1.0, 2.0, 3.0]])
    with pytest.raises(ValueError, match="clips must name clips of the library, got 'waltz'"):
        transitions(library, "waltz")
    with pytest.raises(ValueError, match="segments must hold at least one, got none"):
        Scenario([])
    with pytest.raises(ValueError, match="lengths must be at least 1, got 0"):
        Scenario([1, 2], [3, 0])
    with pytest.raises(ValueError, match=f"scenario must be of segments 0 to {n - 1}, got {n}"):
        graft(library, scenario=Scenario([n]))
    short = replace(library.clips[0][:20], name="short")
    with pytest.raises(ValueError, match=FEW):
        transitions(Library.build(short, config=Config()))
