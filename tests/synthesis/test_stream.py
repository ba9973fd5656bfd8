"""Laws of streams: what is committed depends on what was known, however it came."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import mograft as mg
from mograft._util.gaussian import gaussian_filter
from mograft.analysis.online_segmentation import OnlineSegmenter
from mograft.analysis.segmentation import extrema
from mograft.blend.donor_timeline import sample_states
from mograft.blend.transplant import GraftedGroup, transplant
from mograft.blend.value_spaces import ROTATIONS
from mograft.dancer import dance
from mograft.motion import rotations
from mograft.motion.resample import cubic
from mograft.synthesis.donor_trellis import build_trellis
from mograft.synthesis.search_problem import SearchProblem
from mograft.synthesis.stream import _MOMENT, _Laid, _Sampled, _with_neighbours, joined
from tests.oracles import search as oracle
from tests.strategies import SEEDS, same_rotations, wander

HAND = "LeftHand"
LIGHT = settings(max_examples=12)


@pytest.fixture(scope="module")
def library():
    clips = [dance(seed=seed, strides=1).motion for seed in (0, 1)]
    return mg.Library.build([replace(clip, name=f"clip{i}") for i, clip in enumerate(clips)])


@pytest.fixture(scope="module")
def base():
    return replace(dance(seed=2, strides=1).motion[:260], name="base")


def streamed(library, base, chunks=(10_000,), **options):
    """Push a base in chunks of some sizes, over and over; return what was committed."""
    stream = mg.Stream(library, **options)
    pieces, at, turn = [], 0, 0
    while at < base.n_frames:
        size = chunks[turn % len(chunks)]
        stream.push(base[at : at + size])
        pieces += stream.pieces()
        at, turn = at + size, turn + 1
    stream.close()
    return pieces + stream.pieces()


def with_choice(library, choice, **changes):
    return replace(library, config=replace(library.config, choice=choice, **changes))


def donors_of(pieces):
    return [s.donor for piece in pieces for s in piece.substitutions]


def same_bits(a, b):
    np.testing.assert_array_equal(a.rotations, b.rotations)
    np.testing.assert_array_equal(a.positions, b.positions)


def in_the_way(base, frame=100):
    place = base.world_positions()[frame, base.skeleton.index(HAND)]
    return mg.Avoid(mg.Sphere(tuple(place + np.array([0.0, 6.0, 0.0])), 8.0))


# What is committed


@LIGHT
@given(
    st.lists(st.integers(1, 60), min_size=1, max_size=8),
    st.sampled_from(["viterbi", "sample", "random", "nearest"]),
    st.integers(1, 10),
    st.booleans(),
)
def test_however_frames_come_the_output_is_the_same(library, base, chunks, choice, horizon, hard):
    options = {"horizon": horizon, "constraints": [in_the_way(base)] if hard else []}
    chosen = with_choice(library, choice)
    whole = streamed(chosen, base, **options)
    pieces = streamed(chosen, base, chunks, **options)
    assert repr([p.substitutions for p in pieces]) == repr([p.substitutions for p in whole])
    assert [p.violations for p in pieces] == [p.violations for p in whole]
    same_bits(joined(pieces), joined(whole))


@LIGHT
@given(st.integers(2, 259), st.integers(1, 8))
def test_what_is_committed_does_not_depend_on_what_comes(library, base, n, horizon):
    """The future is another dance: what was committed before it is the same to the bit."""
    stream = mg.Stream(library, horizon=horizon)
    stream.push(base[:n])
    before = stream.pieces()
    stream.push(dance(seed=7, strides=1).motion[300:500])
    after = stream.pieces()
    whole = streamed(library, base, horizon=horizon)
    assert len(before) <= len(whole)
    for own, expected in zip(before, whole, strict=False):
        assert repr(own.substitutions) == repr(expected.substitutions)
        same_bits(own.motion, expected.motion)
    stops = [piece.stop for piece in before + after]
    assert stops == sorted(set(stops))


@pytest.mark.parametrize("choice", ["viterbi", "sample"])
def test_pieces_tile_the_base_and_keep_all_but_the_grafted_group(library, base, choice):
    pieces = streamed(with_choice(library, choice), base, (17,))
    assert pieces[0].start == 0
    assert pieces[-1].stop == base.n_frames - 1
    assert all(a.stop == b.start for a, b in pairwise(pieces))
    assert [p.motion.n_frames for p in pieces[1:]] == [p.stop - p.start for p in pieces[1:]]
    motion = joined(pieces)
    assert motion.n_frames == base.n_frames
    kept = library.joints("lower")
    np.testing.assert_array_equal(motion.rotations[:, kept], base.rotations[:, kept])
    np.testing.assert_array_equal(motion.positions, base.positions)
    columns = np.concatenate([base.skeleton.channel_columns[joint] for joint in kept])
    old, new = base.channel_numbers(), motion.channel_numbers()
    np.testing.assert_array_equal(new[:, columns], old[:, columns])
    assert sum(not s.is_own for p in pieces for s in p.substitutions) > len(pieces) / 2


def test_equal_seeds_are_equal_and_others_are_not(library, base):
    first, again, other = (streamed(library, base, seed=seed) for seed in (5, 5, 6))
    same_bits(joined(first), joined(again))
    assert donors_of(first) != donors_of(other)


def test_a_stream_that_may_take_nothing_is_its_base(library, base):
    pieces = streamed(library, base, (9,), constraints=[mg.NotFrom("*")])
    motion = joined(pieces)
    same_bits(motion, base)
    np.testing.assert_array_equal(motion.channel_numbers(), base.channel_numbers())
    assert all(s.is_own and s.clip == "base" for p in pieces for s in p.substitutions)


# What is chosen


def offline(library, base):
    """All that a search that knows the whole base sees."""
    longer, at = library.resolve_base(base)
    scenario = longer.segments.of_clip(at)
    cut = longer.segments[scenario]
    problem = SearchProblem.build(longer, longer.clips[at], scenario, cut, ["upper"], [])
    return problem, build_trellis(problem, "upper", {})


def test_with_all_in_sight_it_chooses_as_the_search_does(library, base):
    chosen = with_choice(library, "viterbi")
    pieces = streamed(chosen, base, horizon=1000)
    graft = mg.graft(chosen, base)
    assert donors_of(pieces) == [s.donor for s in graft.substitutions]
    for piece, expected in zip(pieces, graft.substitutions, strict=True):
        (own,) = piece.substitutions
        assert (own.start, own.stop, own.clip) == (expected.start, expected.stop, expected.clip)
        assert own.cost == pytest.approx(expected.cost)
        assert own.gap_before == pytest.approx(expected.gap_before)
    _, row = offline(chosen, base)
    greedy = [int(row.costs.unary[0].argmin())]
    for alone, after in zip(row.costs.unary[1:], row.costs.pairwise, strict=True):
        greedy.append(int((alone + after[greedy[-1]]).argmin()))
    found = row.path(np.array(donors_of(pieces)))
    assert row.costs.cost(found) <= row.costs.cost(np.array(greedy)) + 1e-9


def test_several_groups_are_chosen_each_by_itself(library, base):
    several = mg.Library.build(list(library.clips), "lower_torso_larm_rarm")
    chosen = with_choice(several, "viterbi")
    pieces = streamed(chosen, base, (11,), horizon=1000)
    graft = mg.graft(chosen, base)
    groups = [s.group for s in pieces[0].substitutions]
    assert len(groups) == 3
    for group in groups:
        found = [s.donor for p in pieces for s in p.substitutions if s.group == group]
        assert found == [s.donor for s in graft.substitutions if s.group == group]
    avoid = in_the_way(base)
    pieces = streamed(several, base, (11,), constraints=[avoid, mg.AvoidSelf()])
    same_bits(joined(pieces), joined(streamed(several, base, constraints=[avoid, mg.AvoidSelf()])))
    told = sum(v.frames[1] - v.frames[0] + 1 for p in pieces for v in p.violations)
    assert told < (avoid.errors(mg.Poses.from_motion(base))[0] > 1).sum()


@pytest.mark.parametrize("horizon", [1, 3, 8])
def test_each_choice_is_the_first_of_the_best_plan_in_sight(library, base, horizon):
    chosen = with_choice(library, "viterbi")
    _, row = offline(chosen, base)
    alone, after, taken = row.costs.unary, row.costs.pairwise, []
    for at in range(len(alone)):
        seen = list(alone[at : at + horizon])
        if taken:
            seen[0] = seen[0] + after[at - 1][taken[-1]]
        taken.append(int(oracle.cheapest_sequence(seen, list(after[at : at + len(seen) - 1]))[0]))
    found = streamed(chosen, base, (25,), horizon=horizon)
    assert donors_of(found) == row.donor_sequence(np.array(taken)).tolist()


@pytest.mark.parametrize("seam", ["inertial", "dead"])
def test_seams_are_those_of_two_segments_put_together(library, base, seam):
    """The oracle knows nothing but the donor before, this one, and whole clips.

    So it can tell only where no segment is too short for its seam.
    """
    chosen = with_choice(library, "sample", seam=seam, seam_blend=library.config.min_length)
    problem, _ = offline(chosen, base)
    longer, joints = problem.library, problem.library.joints("upper")
    pieces = streamed(chosen, base)
    motion, donors = joined(pieces), np.array(donors_of(pieces))
    for at in range(1, len(donors)):
        two = slice(at - 1, at + 1)
        cut = mg.Segments(problem.base_segments.start[two], problem.base_segments.stop[two])
        start, stop = int(cut.start[0]), int(cut.stop[1])
        moved = mg.Segments(cut.start - start, cut.stop - start)
        part = transplant(
            problem.base[start : stop + 1],
            moved,
            longer.segments[donors[two]],
            longer.clips,
            GraftedGroup(joints),
            longer.config,
        )
        own = motion.rotations[cut.start[1] + 1 : stop + 1][:, joints]
        expected = part.rotations[moved.start[1] + 1 :]
        gap = rotations.log(rotations.multiply(rotations.inverse(own), expected))
        if len(part.seams):  # else the oracle lends the change two segments' time
            assert np.linalg.norm(gap, axis=-1).max() < 1e-9
        else:
            before = longer.segments.stop[donors[at - 1]], longer.segments.clip[donors[at - 1]]
            this = longer.segments.start[donors[at]], longer.segments.clip[donors[at]]
            assert before == this


@pytest.mark.parametrize("seam", ["inertial", "dead"])
def test_no_frame_leaps_at_a_seam(library, base, seam):
    """Not more than in a graft that knows the whole base and has the same donors."""
    chosen = with_choice(library, "viterbi", seam=seam)
    graft = mg.graft(chosen, base)
    motion = joined(streamed(chosen, base, horizon=1000))

    def leaps(rotated):
        before, here, after = rotated[:-2], rotated[1:-1], rotated[2:]
        ways = [
            rotations.log(rotations.multiply(rotations.inverse(a), b))
            for a, b in ((before, here), (here, after))
        ]
        return np.linalg.norm(ways[1] - ways[0], axis=-1)

    expected, found = leaps(graft.motion.rotations), leaps(motion.rotations)
    assert found.max() < 1.25 * expected.max()
    assert np.percentile(found, 99) < 1.25 * np.percentile(expected, 99)


@given(SEEDS, st.integers(2, 12))
def test_a_segment_with_its_neighbours_is_as_good_as_its_clip(seed, n):
    """Values between frames and velocities at both ends, also where a clip begins or ends."""
    rng = np.random.default_rng(seed)
    clip = wander(rng, n, 2)
    start, stop = sorted(rng.choice(n, 2, replace=False).tolist())
    track = _with_neighbours(clip, start, stop)
    assert len(track) == stop - start + 3
    np.testing.assert_array_equal(track[1:-1], clip[start : stop + 1])
    at = rng.uniform(0, stop - start, 5)
    same_rotations(
        cubic(np.arange(len(track)), track, 1 + at), cubic(np.arange(n), clip, start + at), 1e-9
    )
    ends = np.array([0, stop - start])
    _, expected = sample_states(ROTATIONS, [clip], np.zeros(2, int), start + ends)
    before, here, after = (track[ends + 1 + step] for step in (-1, 0, 1))
    found = 0.5 * (ROTATIONS.delta(before, here) + ROTATIONS.delta(here, after))
    np.testing.assert_allclose(found, expected, atol=1e-9)


@given(SEEDS, st.sampled_from([24.0, 120.0]))
def test_a_donor_ends_with_the_slope_of_its_curve_and_where_no_seam_reaches_with_its_own(
    seed, rate
):
    rng = np.random.default_rng(seed)
    pose, speed, pull = wander(rng, 4, 3), rng.normal(size=(4, 3, 3)), rng.normal(size=(4, 3, 3))
    times = np.array([-1.0, 0.0, -_MOMENT, -2 * _MOMENT])[:, None, None, None] / rate
    curve = rotations.multiply(pose, rotations.exp(speed * times + 0.5 * pull * times**2))
    values, own = np.moveaxis(curve, 0, 1), rng.normal(size=(4, 3, 3))
    raw = values.copy()
    raw[:2, 1:] = wander(rng, 3, 3)
    laid = _Laid(_Sampled(raw, own, own), values, rate)
    np.testing.assert_allclose(laid.speed[:2], speed[:2], atol=1e-4)
    np.testing.assert_array_equal(laid.speed[2:], own[2:])
    for at in range(4):
        np.testing.assert_array_equal(laid.only(at).speed[0], laid.speed[at])
        np.testing.assert_array_equal(laid.only(at).pose[0], pose[at])


# Constraints


@pytest.mark.parametrize("choice", ["viterbi", "sample"])
def test_hard_constraints_are_met_or_told(library, base, choice):
    chosen = with_choice(library, choice)
    free = mg.Poses.from_motion(joined(streamed(chosen, base)))
    before, after = 0, 0
    for frame in (40, 100, 160, 220):
        avoid = in_the_way(base, frame)
        pieces = streamed(chosen, base, constraints=[avoid])
        error, _ = avoid.errors(mg.Poses.from_motion(joined(pieces)))
        told = np.zeros(base.n_frames, bool)
        for violation in (v for piece in pieces for v in piece.violations):
            told[violation.frames[0] : violation.frames[1] + 1] = True
        np.testing.assert_array_equal(told, error > 1.0)
        before += (avoid.errors(free)[0] > 1.0).sum()
        after += told.sum()
    assert after < before


def test_what_is_missed_no_donor_meets(library, base, monkeypatch):
    """The cheapest plan has no donor that misses where the first place has one that does not."""
    seen = []
    looked = mg.Stream._misses

    def looking(stream, place, *rest):
        cost = looked(stream, place, *rest)
        seen.append((place.start, cost))
        return cost

    monkeypatch.setattr(mg.Stream, "_misses", looking)
    pieces = streamed(
        with_choice(library, "viterbi"), base, constraints=[in_the_way(base)], horizon=1
    )
    exact = dict(seen)  # the last look at a place is with its seam
    assert any((cost > 0).any() and (cost == 0).any() for cost in exact.values())
    for piece in pieces:
        assert bool(piece.violations) == (exact[piece.start] > 0).all()


@LIGHT
@given(
    st.sampled_from(["viterbi", "sample", "random", "nearest"]),
    st.sampled_from(["inertial", "dead"]),
    st.integers(1, 8),
)
def test_what_no_donor_can_miss_changes_nothing(library, base, choice, seam, horizon):
    """All donors are put together for it, and without it only the one that is taken."""
    chosen = with_choice(library, choice, seam=seam)
    far = mg.Avoid(mg.Sphere((1e5, 0.0, 0.0), 1.0))
    pieces = streamed(chosen, base, horizon=horizon)
    looked = streamed(chosen, base, horizon=horizon, constraints=[far])
    assert donors_of(looked) == donors_of(pieces)
    same_rotations(joined(looked).rotations, joined(pieces).rotations, 1e-9)


def test_new_constraints_hold_for_all_that_is_not_committed(library, base):
    stream = mg.Stream(library, horizon=2)
    stream.push(base)
    first = [stream.advance() for _ in range(10)]
    stream.constraints = [mg.OnlyFrom("clip1")]
    then = [stream.advance() for _ in range(5)]
    stream.constraints = [mg.KeepOriginal()]
    last = stream.pieces()
    stream.close()
    last += stream.pieces()
    plainly = streamed(library, base, horizon=2)
    assert donors_of(first) == donors_of(plainly)[:10]
    assert "clip0" in {s.clip for p in first for s in p.substitutions}
    assert {s.clip for p in then for s in p.substitutions} <= {"clip1", "base"}
    assert all(s.is_own for p in last for s in p.substitutions)
    assert joined(first + then + last).n_frames == base.n_frames


def test_wide_seams_are_told(library, base):
    """A limit that comes after a donor has been committed may be missed at the next seam."""
    limit = np.radians(0.01)
    stream = mg.Stream(with_choice(library, "viterbi"))
    stream.push(base)
    while stream.advance().substitutions[0].is_own:
        pass
    stream.constraints = [mg.MaxAngle(limit), mg.KeepOriginal()]  # back to the base at once
    pieces = stream.pieces()
    for piece in pieces:
        wide = [s for s in piece.substitutions if s.gap_before > limit]
        assert len(piece.violations) == len(wide)
        for violation, s in zip(piece.violations, wide, strict=True):
            assert violation.frames == (piece.start, piece.start)
            assert violation.error == pytest.approx(s.gap_before / limit)
    assert pieces[0].violations
    assert not pieces[-1].violations


def test_signs_of_rotations_go_on_from_piece_to_piece(library, base):
    quats = base.rotations.copy()
    quats[:, library.joints("upper")[1::2]] *= -1.0
    motion = joined(streamed(library, replace(base, rotations=quats)))
    assert (np.einsum("fji,fji->fj", motion.rotations[1:], motion.rotations[:-1]) > 0).all()


# Libraries in folders, and memory


def test_a_library_in_a_folder_gives_the_same_and_reads_what_it_needs(library, base, tmp_path):
    library.save(tmp_path / "two.mograft")
    stored = mg.Library.open(tmp_path / "two.mograft")
    same_bits(joined(streamed(stored, base)), joined(streamed(library, base)))

    asked = set()

    class Clips:
        def __getitem__(self, index):
            asked.add(int(index))
            return library.clips[index]

    only = replace(library, clips=Clips())
    pieces = streamed(only, base, constraints=[mg.OnlyFrom("clip1")])
    assert any(not s.is_own for p in pieces for s in p.substitutions)
    assert asked == {1}


def test_what_is_past_is_forgotten(library):
    long = dance(seed=3, strides=1).motion
    stream = mg.Stream(library)
    most = 0
    for at in range(long.n_frames):
        stream.push(long[at : at + 1])
        stream.pieces()
        most = max(most, len(stream._base._tracks["rotations"]), len(stream._cutter._energies))
    assert most < 400 < long.n_frames


# Cutting


@given(SEEDS, st.integers(1, 300), st.lists(st.integers(1, 50), min_size=1, max_size=5))
def test_cuts_of_a_growing_curve_are_settled_and_long_enough(seed, n, chunks):
    rng = np.random.default_rng(seed)
    energies = np.abs(np.cumsum(rng.normal(size=n + 1)))
    energies[rng.integers(n) :][:80] = 1.0  # a stretch where nothing turns
    config = mg.Config(max_length=1.0)
    cutter, seen = OnlineSegmenter(30.0, config), []
    at, turn = 0, 0
    while at < len(energies):
        size = chunks[turn % len(chunks)]
        cutter.push(energies[at : at + size])
        assert cutter.bounds[: len(seen)] == seen
        seen, at, turn = list(cutter.bounds), at + size, turn + 1
    cutter.close()
    assert cutter.bounds[: len(seen)] == seen
    whole = OnlineSegmenter(30.0, config)
    whole.push(energies)
    whole.close()
    assert whole.bounds == cutter.bounds
    bounds = np.array(cutter.bounds)
    assert bounds[0] == 0
    assert bounds[-1] == n
    if n >= 3:
        assert np.diff(bounds).min() >= 3
    assert np.diff(bounds).max() <= 30


@given(SEEDS, st.integers(40, 300))
def test_where_nothing_is_merged_cuts_are_those_of_the_whole_motion(seed, n):
    rng = np.random.default_rng(seed)
    phase, pace = rng.uniform(0, 6), rng.uniform(0.15, 0.4)
    energies = 2.0 + np.cos(phase + pace * np.arange(n)) + 0.3 * np.sin(0.05 * np.arange(n))
    config = mg.Config(min_length=1 / 30, max_length=100.0)
    cutter = OnlineSegmenter(30.0, config)
    cutter.push(energies)
    cutter.close()
    inner = extrema(gaussian_filter(energies, config.smoothing * 30.0))
    assert cutter.bounds == [0, *(int(at) for at in inner if 0 < at < n - 1), n - 1]


@pytest.mark.parametrize("seed", [0, 4])
def test_a_growing_dance_is_cut_as_the_whole_one(seed):
    motion = dance(seed=seed, strides=1).motion
    cutter = OnlineSegmenter(motion.rate, mg.Config())
    cutter.push(mg.kinetic_energy(motion))
    cutter.close()
    expected = mg.segment(motion)
    assert cutter.bounds == [0, *expected.stop.tolist()]


def test_where_nothing_turns_it_is_cut_all_the_same():
    cutter = OnlineSegmenter(30.0, mg.Config(max_length=1.0))
    cutter.push(np.linspace(1.0, 2.0, 200))
    assert cutter.bounds[:5] == [0, 30, 60, 90, 120]


# What is refused


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"horizon": 0}, ValueError, "horizon must be a whole number from 1, got 0"),
        ({"seed": -1}, ValueError, "seed must be a whole number from 0, got -1"),
        ({"swap": ["lower"]}, ValueError, "swap must name groups other than the base 'lower'"),
        ({"constraints": ["none"]}, TypeError, "constraints must be mograft constraints, got 'n"),
        ({"constraints": [mg.NotFrom("waltz")]}, ValueError, "clips must match names of clip0, "),
        ({"constraints": [mg.Reach("Wing", (0, 0, 0), 5)]}, ValueError, "no joint is named 'Wing'"),
    ],
)
def test_bad_arguments_are_refused_by_name(library, options, error, message):
    with pytest.raises(error, match=message):
        mg.Stream(library, **options)


def test_frames_that_do_not_fit_are_refused(library, base):
    stream = mg.Stream(library)
    with pytest.raises(ValueError, match="a stream needs at least 2 frames, got 0"):
        stream.close()
    with pytest.raises(ValueError, match="frames must come at the library's 30 per second, got 15"):
        stream.push(base[::2])
    stream.push(base[:1])
    with pytest.raises(ValueError, match="a stream needs at least 2 frames, got 1"):
        stream.close()
    longer = replace(base.skeleton, offsets=base.skeleton.offsets * 2)
    with pytest.raises(ValueError, match="frames must all be of one skeleton"):
        stream.push(replace(base, skeleton=longer))
    stream.push(base[1:2])
    stream.close()
    stream.close()
    assert joined(stream.pieces()).n_frames == 2
    assert stream.advance() is None
    with pytest.raises(ValueError, match="before the stream is closed"):
        stream.push(base[2:4])
    odd = mg.Motion(mg.Skeleton(["a"], [-1], [[0, 0, 0]]), 1 / 30, [[[0, 0, 0, 1]]], [[[0, 0, 0]]])
    with pytest.raises(mg.SkeletonMismatchError):
        mg.Stream(library).push(odd)


def test_groups_that_hold_legs_or_root_are_refused(library):
    members = library.groups.resolve(library.skeleton)
    names = {group: [library.skeleton.names[j] for j in own] for group, own in members.items()}
    turned = mg.Library.build(library.clips[0], mg.JointGroups(names, base="upper"))
    with pytest.raises(ValueError, match=r"groups without root and legs.*got 'lower'"):
        mg.Stream(turned)


@pytest.mark.parametrize(("field", "value"), [("torso", "world"), ("alignment", "dtw")])
def test_ways_that_a_stream_does_not_know_are_refused(library, field, value):
    other = replace(library, config=replace(library.config, **{field: value}))
    with pytest.raises(ValueError, match=rf"config\.{field} must be .* in a stream, got '{value}'"):
        mg.Stream(other)


def test_only_grafted_groups_must_be_of_whole_joints(base):
    """A joint of the base group and one that is grafted: either may be divided or neither."""
    short = base[:120]
    spine = [name for name in short.skeleton.names if name != "Spine"]
    groups = {
        "body": [n for n in spine if n not in ("Head", "LeftForeArm")],
        "head": ["Head"],
        "roll": ["Spine.Yrotation"],
        "arm": ["LeftForeArm"],
    }
    groups["body"] += [f"Spine.{axis}rotation" for axis in "XZ"]
    library = mg.Library.build(short, mg.JointGroups(groups, base="body"))
    with pytest.raises(ValueError, match=r"of whole joints.*got 'roll'.*single channels of Spine"):
        mg.Stream(library)
    with pytest.raises(ValueError, match="got 'roll'"):
        mg.Stream(library, swap=["arm", "roll"])
    pieces = streamed(library, short, swap=["arm", "head"])
    spine = short.skeleton.index("Spine")
    motion = joined(pieces)
    np.testing.assert_array_equal(motion.rotations[:, spine], short.rotations[:, spine])
