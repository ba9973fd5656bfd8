"""`Stream`: chunks, later frames, donor choice, seams, constraints, memory, invalid arguments."""

from dataclasses import replace
from itertools import pairwise, product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import mograft as mg
import mograft.constraints as mc
from mograft.blend.transplant import GraftedGroup, transplant
from mograft.dancer import dance
from mograft.motion import rotations
from mograft.solve.plan import GraftPlan
from mograft.stream.server import StreamServer
from tests.oracles import search as oracle
from tests.strategies import assert_same_rotations, with_config

HAND = "LeftHand"
FEW_EXAMPLES = settings(max_examples=6)


@pytest.fixture(scope="module")
def library(two_dances):
    return two_dances


@pytest.fixture(scope="module")
def base(short_base):
    return short_base


@pytest.fixture(scope="module")
def several(library):
    return mg.Library.build(list(library.clips), "lower_torso_larm_rarm", library.config)


def stream_pieces(library, base, chunks=(10_000,), **options):
    """Push a base in chunks whose sizes repeat; return all pieces."""
    stream = mg.Stream(library, **{"delay": np.inf, **options})
    pieces, first, n_pushes = [], 0, 0
    while first < base.n_frames:
        size = chunks[n_pushes % len(chunks)]
        stream.push(base[first : first + size])
        pieces += stream.pieces()
        first, n_pushes = first + size, n_pushes + 1
    stream.close()
    return pieces + stream.pieces()


def list_donors(pieces):
    return [s.donor for piece in pieces for s in piece.substitutions]


def assert_identical(a, b):
    np.testing.assert_array_equal(a.rotations, b.rotations)
    np.testing.assert_array_equal(a.positions, b.positions)


def ball_at_hand(base, frame=100):
    """Return a constraint that the base violates in a frame."""
    center = base.world_positions()[frame, base.skeleton.index(HAND)] + np.array([0.0, 6.0, 0.0])
    return mc.Avoid(mc.Sphere(tuple(center), 8.0))


# Committed pieces


@FEW_EXAMPLES
@given(
    st.lists(st.integers(1, 60), min_size=1, max_size=8),
    st.sampled_from(["viterbi", "sample", "random", "nearest"]),
    st.integers(1, 10),
    st.sampled_from([0.0, 0.6, 1.2, np.inf]),
    st.sampled_from([(False, False), (True, False), (True, True)]),
)
def test_stream_any_chunks_give_identical_pieces(
    library, several, base, chunks, choice, horizon, delay, kind
):
    """Committed pieces then do not depend on later frames, either."""
    is_constrained, has_several_groups = kind
    constraints = [ball_at_hand(base), mc.AvoidSelf()] if is_constrained else []
    options = {"horizon": horizon, "delay": delay, "constraints": constraints}
    configured = with_config(several if has_several_groups else library, choice=choice)
    expected = stream_pieces(configured, base, **options)
    pieces = stream_pieces(configured, base, chunks, **options)
    assert repr([p.substitutions for p in pieces]) == repr([p.substitutions for p in expected])
    assert [p.violations for p in pieces] == [p.violations for p in expected]
    assert_identical(mg.join_pieces(pieces), mg.join_pieces(expected))


def test_stream_pieces_cover_the_base_and_keep_its_other_joints(library, base):
    pieces = stream_pieces(with_config(library, choice="sample"), base, (17,))
    assert pieces[0].start == 0
    assert pieces[-1].stop == base.n_frames - 1
    assert all(a.stop + 1 == b.start for a, b in pairwise(pieces))
    for piece in pieces:
        assert piece.motion.n_frames == piece.stop - piece.start + 1
        for substitution in piece.substitutions:
            assert (substitution.start, substitution.stop) == (max(piece.start - 1, 0), piece.stop)
    motion = mg.join_pieces(pieces)
    assert motion.n_frames == base.n_frames
    kept = library.joints("lower")
    np.testing.assert_array_equal(motion.rotations[:, kept], base.rotations[:, kept])
    np.testing.assert_array_equal(motion.positions, base.positions)
    columns = np.concatenate([base.skeleton.channel_columns[joint] for joint in kept])
    expected, values = base.channel_numbers(), motion.channel_numbers()
    np.testing.assert_array_equal(values[:, columns], expected[:, columns])
    assert sum(not s.is_own for p in pieces for s in p.substitutions) > len(pieces) / 2


def test_stream_other_seeds_give_other_donors(library, base):
    first, other = (stream_pieces(library, base, seed=seed) for seed in (5, 6))
    assert list_donors(first) != list_donors(other)


def test_stream_base_with_computed_values_equals_that_without(library, base):
    values = base.channel_numbers()
    edited = replace(base, channel_values=values, computed_values=np.zeros(values.shape, bool))
    pieces = stream_pieces(library, edited, (3,))
    assert_identical(mg.join_pieces(pieces), mg.join_pieces(stream_pieces(library, base, (3,))))


def test_stream_all_donors_excluded_returns_the_base(library, base):
    pieces = stream_pieces(library, base, (9,), constraints=[mc.NotFrom("*")])
    motion = mg.join_pieces(pieces)
    assert_identical(motion, base)
    np.testing.assert_array_equal(motion.channel_numbers(), base.channel_numbers())
    assert all(s.is_own and s.clip == "base" for p in pieces for s in p.substitutions)


# Donor choice


def whole_base_search(library, base):
    """Return the search problem and the trellis for the whole base."""
    plan = GraftPlan.build(library, base, None, ())
    return plan.problem, plan.trellises["upper"]


@pytest.mark.parametrize("neighbourhood", ["cluster", "ball"])
@pytest.mark.parametrize("fixture", ["library", "several"])
def test_stream_horizon_beyond_the_end_chooses_the_donors_of_graft(
    request, base, neighbourhood, fixture
):
    changes = {"neighbourhood": neighbourhood, "self_repair": False}
    configured = with_config(request.getfixturevalue(fixture), choice="viterbi", **changes)
    pieces, graft = stream_pieces(configured, base, horizon=1000), mg.graft(configured, base)
    assert len(pieces[0].substitutions) == len(graft.donors)
    for group in graft.donors:
        found = [s for p in pieces for s in p.substitutions if s.group == group]
        expected = [s for s in graft.substitutions if s.group == group]
        for own, other in zip(found, expected, strict=True):
            names = ("start", "stop", "donor", "clip")
            assert [getattr(own, n) for n in names] == [getattr(other, n) for n in names]
            assert own.cost == pytest.approx(other.cost)
            assert own.gap_before == pytest.approx(other.gap_before)


@pytest.mark.parametrize("seam", ["inertial", "gradient"])
@pytest.mark.parametrize("horizon", [1, 2, 3, 8])
def test_stream_each_donor_is_of_the_cheapest_sequence_in_the_horizon(library, base, horizon, seam):
    """With "gradient", the second donor of a sequence is the first one of the next."""
    configured = with_config(library, choice="viterbi", seam=seam)
    _, trellis = whole_base_search(configured, base)
    unary, pairwise_costs, path = trellis.costs.unary, trellis.costs.pairwise, []
    following = None
    for position in range(len(unary)):
        known = list(unary[position : position + horizon])
        if following is not None:
            is_other = np.arange(len(known[0])) != following
            known[0] = np.where(is_other, np.inf, known[0])
        if path:
            known[0] = known[0] + pairwise_costs[position - 1][path[-1]]
        seams = list(pairwise_costs[position : position + len(known) - 1])
        cheapest = oracle.cheapest_sequence(known, seams)
        path.append(int(cheapest[0]))
        following = cheapest[1] if seam == "gradient" and len(cheapest) > 1 else None
    pieces = stream_pieces(configured, base, (25,), horizon=horizon)
    assert list_donors(pieces) == trellis.donor_sequence(np.array(path)).tolist()


# Seams


def test_stream_seams_equal_those_of_transplanted_segment_pairs(library, base):
    """The oracle transplants two donors at a time, from whole clips.

    `seam_blend` is the minimum segment length, because a blend that outlasts a segment differs.
    """
    options = {"seam": "inertial", "torso": "pelvis", "seam_blend": library.config.min_length}
    configured = with_config(library, choice="sample", **options)
    problem, _ = whole_base_search(configured, base)
    longer, joints = problem.library, problem.library.joints("upper")
    pieces = stream_pieces(configured, base)
    motion, donors = mg.join_pieces(pieces), np.array(list_donors(pieces))
    for left, right in pairwise(range(len(donors))):
        pair = problem.base_segments[np.array([left, right])]
        start, stop = int(pair.start[0]), int(pair.stop[1])
        shifted = mg.Segments(pair.start - start, pair.stop - start)
        base_part, own = problem.base[start : stop + 1], longer.segments[donors[[left, right]]]
        group, clips = GraftedGroup(joints), longer.clips
        part = transplant(base_part, shifted, own, clips, group, longer.config)
        if len(part.seams):
            after = motion.rotations[pair.start[1] + 1 : stop + 1][:, joints]
            # Components of quaternions: angles below 1e-9 rad.
            assert_same_rotations(after, part.rotations[shifted.start[1] + 1 :], 2.5e-10)
        else:  # the donors are neighbours; the blend of an earlier seam may still go on
            before, after = longer.segments[donors[[left]]], longer.segments[donors[[right]]]
            assert before.stop == after.start
            assert before.clip == after.clip


@pytest.mark.parametrize("horizon", [2, 8])
def test_stream_gradient_seams_are_as_smooth_as_those_of_all_segments_together(
    library, base, horizon
):
    configured = with_config(library, choice="sample", seam="gradient", torso="pelvis")
    pieces = stream_pieces(configured, base, horizon=horizon)
    motion, joints = mg.join_pieces(pieces), library.joints("upper")
    problem, _ = whole_base_search(configured, base)
    longer, donors = problem.library, np.array(list_donors(pieces))
    group, config = GraftedGroup(joints), replace(configured.config, seam="gradient")
    cut, sources = problem.base_segments, longer.segments[donors]
    part = transplant(problem.base, cut, sources, longer.clips, group, config)

    def greatest_changes(quats):
        steps = rotations.log(rotations.multiply(rotations.inverse(quats[:-1]), quats[1:]))
        changes = np.linalg.norm(np.diff(steps, axis=0), axis=-1).max(axis=1)
        around = part.seams[:, None] + np.arange(-3, 4) - 1
        return changes[around.clip(0, len(changes) - 1)].max(axis=1)

    tracks = part.rotations, motion.rotations[:, joints]
    offline, streamed = (greatest_changes(track) for track in tracks)
    assert len(part.seams) > 5
    assert np.median(streamed / offline) < 1.1
    assert streamed.max() < 1.25 * offline.max()


def test_stream_quaternions_of_opposite_signs_continue_between_pieces(library, base):
    quats = base.rotations.copy()
    quats[:, library.joints("upper")[1::2]] *= -1.0
    motion = mg.join_pieces(stream_pieces(library, replace(base, rotations=quats)))
    assert (np.einsum("fji,fji->fj", motion.rotations[1:], motion.rotations[:-1]) > 0).all()


# Constraints


@pytest.mark.parametrize(
    ("fixture", "choice"), [("library", "viterbi"), ("library", "sample"), ("several", "viterbi")]
)
def test_stream_hard_constraint_violations_are_listed_and_fewer_than_without(
    request, base, fixture, choice
):
    configured = with_config(request.getfixturevalue(fixture), choice=choice)
    unconstrained = mg.Poses.from_motion(mg.join_pieces(stream_pieces(configured, base)))
    n_without, n_with = 0, 0
    for frame in (40, 100, 160, 220):
        avoid = ball_at_hand(base, frame)
        pieces = stream_pieces(configured, base, constraints=[avoid])
        errors, _ = avoid.errors(mg.Poses.from_motion(mg.join_pieces(pieces)))
        is_violated = np.zeros(base.n_frames, bool)
        for violation in (v for piece in pieces for v in piece.violations):
            is_violated[violation.frames[0] : violation.frames[1] + 1] = True
        np.testing.assert_array_equal(is_violated, errors > 1.0)
        n_without += (avoid.errors(unconstrained)[0] > 1.0).sum()
        n_with += is_violated.sum()
    assert n_with < n_without


@FEW_EXAMPLES
@given(st.sampled_from(["viterbi", "sample", "random", "nearest"]), st.integers(1, 8))
def test_stream_constraint_that_all_candidates_satisfy_changes_nothing(
    library, base, choice, horizon
):
    """With a pose constraint all candidates are placed, without one only the chosen donor.

    With it, the treatment "gradient" is that of "inertial".
    """
    far = mc.Avoid(mc.Sphere((1e5, 0.0, 0.0), 1.0))
    inertial, gradient = (
        with_config(library, choice=choice, seam=s) for s in ("inertial", "gradient")
    )
    expected = stream_pieces(inertial, base, horizon=horizon)
    for own in (inertial, gradient):
        pieces = stream_pieces(own, base, horizon=horizon, constraints=[far])
        assert list_donors(pieces) == list_donors(expected)
        found, motion = mg.join_pieces(pieces), mg.join_pieces(expected)
        assert_same_rotations(found.rotations, motion.rotations, 1e-9)


def test_stream_changed_constraints_apply_to_segments_that_are_not_committed(library, base):
    stream = mg.Stream(library, horizon=2, delay=np.inf)
    stream.push(base)
    unconstrained = [stream.advance() for _ in range(10)]
    stream.constraints = [mc.OnlyFrom("clip1")]
    from_one_clip = [stream.advance() for _ in range(5)]
    stream.constraints = [mc.KeepOriginal()]
    kept = stream.pieces()
    stream.close()
    kept += stream.pieces()
    expected = stream_pieces(library, base, horizon=2)
    assert list_donors(unconstrained) == list_donors(expected)[:10]
    assert "clip0" in {s.clip for p in unconstrained for s in p.substitutions}
    assert {s.clip for p in from_one_clip for s in p.substitutions} <= {"clip1", "base"}
    assert all(s.is_own for p in kept for s in p.substitutions)
    assert mg.join_pieces(unconstrained + from_one_clip + kept).n_frames == base.n_frames


def test_stream_max_angle_set_after_a_donor_lists_the_violated_seam(library, base):
    limit = np.radians(0.01)
    stream = mg.Stream(with_config(library, choice="viterbi"))
    stream.push(base)
    while stream.advance().substitutions[0].is_own:
        pass
    # The seam from the committed donor to the base cannot satisfy the limit.
    stream.constraints = [mc.MaxAngle(limit), mc.KeepOriginal()]
    pieces = stream.pieces()
    for piece in pieces:
        wide = [s for s in piece.substitutions if s.gap_before > limit]
        assert len(piece.violations) == len(wide)
        for violation, substitution in zip(piece.violations, wide, strict=True):
            assert violation.frames == (substitution.start, substitution.start)
            assert violation.error == pytest.approx(substitution.gap_before / limit)
    assert pieces[0].violations
    assert not pieces[-1].violations


@FEW_EXAMPLES
@given(st.integers(1, 8), st.integers(0, 259), st.integers(0, 30))
def test_stream_target_before_the_first_free_frame_raises_error_that_names_it(
    library, base, horizon, frame, length
):
    stream = mg.Stream(library, horizon=horizon, delay=np.inf)
    stream.push(base[:200])
    old = mc.Reach(HAND, (0.0, 0.0, 0.0), 3)
    stream.constraints = [old]
    pieces, last = stream.pieces(), frame + length
    free = stream.first_free_frame
    assert free == (pieces[-1].stop + 1 if pieces else 0)
    target = mc.Face((0.0, 0.0, 0.0), frames=(frame, last))
    if last >= free:
        stream.constraints = [old, target]
        return
    message = f"the first free frame, {free}, or later, got Face up to frame {last}"
    with pytest.raises(ValueError, match=message):
        stream.constraints = [old, target]
    assert stream.constraints == (old,)


# Frames


def longer(motion):
    """Return a motion whose skeleton is twice as long."""
    skeleton = replace(motion.skeleton, offsets=motion.skeleton.offsets * 2)
    return replace(motion, skeleton=skeleton)


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        (lambda m: (m.rotations,), TypeError, "`positions` must be given with an array"),
        (lambda m: (m.rotations[:, :-1], m.positions), ValueError, r"shape \(n_frames, 18, 4\)"),
        (lambda m: (m.rotations[0, 0], m.positions), ValueError, r"must have shape .*got \(4,\)"),
        (lambda m: (m.rotations * 2, m.positions), ValueError, "unit quaternions, got norm 2"),
        (lambda m: (m.rotations, m.positions + np.inf), ValueError, "`positions` must be finite"),
        (lambda m: (m.rotations, m.positions[:1]), ValueError, r"\(3, 18, 3\) or \(3, 3"),
        (lambda m: (m.rotations[0], m.positions), ValueError, r"shape \(18, 3\) or \(3\)"),
        (lambda m: (m.rotations[:0], m.positions[:0]), ValueError, "at least one frame"),
        (lambda m: ("walk.bvh", m.positions), TypeError, "`frames` must"),
        (lambda m: (m, m.positions), TypeError, "`positions` must be None if `frames` is a motion"),
        (lambda m: (m[::2],), ValueError, "the library's rate of 30 frames/s, got 15"),
        (lambda m: (longer(m),), ValueError, "`frames` must all have the same skeleton"),
    ],
)
def test_stream_push_of_invalid_frames_raises_error_and_keeps_those_before(
    library, base, change, error, message
):
    stream = mg.Stream(library, delay=np.inf)
    stream.push(base[:50])
    with pytest.raises(error, match=message):
        stream.push(*change(base[50:53]))
    assert stream.n_known == 50
    stream.push(base[50:])
    stream.close()
    expected = stream_pieces(library, base)
    assert_identical(mg.join_pieces(stream.pieces()), mg.join_pieces(expected))


# Stored libraries and memory


def test_stream_stored_library_gives_identical_motion(library, base, tmp_path):
    library.save(tmp_path / "two.mograft")
    stored = mg.Library.open(tmp_path / "two.mograft")
    motions = (mg.join_pieces(stream_pieces(own, base)) for own in (stored, library))
    assert_identical(*motions)


def test_stream_excluded_clips_are_not_read(library, base):
    read = set()

    class Clips:
        def __getitem__(self, index):
            read.add(int(index))
            return library.clips[index]

    recorded = replace(library, clips=Clips())
    pieces = stream_pieces(recorded, base, constraints=[mc.OnlyFrom("clip1")])
    assert any(not s.is_own for p in pieces for s in p.substitutions)
    assert read == {1}


def test_stream_long_base_holds_limited_frames(library):
    long = dance(seed=3, strides=1).motion
    stream = mg.Stream(library, delay=np.inf)
    most = 0
    for frame in range(long.n_frames):
        stream.push(long[frame : frame + 1])
        stream.pieces()
        most = max(most, len(stream._base))
    assert most < 400 < long.n_frames


# Invalid arguments


OF_GROUP = mc.KeepOriginal(frames=(0, 9), group="upper")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"delay": -1.0}, "`delay` must be at least 0 seconds, got -1.0"),
        ({"horizon": 0}, "`horizon` must be a whole number of at least 1, got 0"),
        ({"swap": ["lower"]}, "`swap` must not have the base group 'lower'"),
        ({"swap": [1]}, "`swap` must name groups other than .*, got 1: choose from"),
        ({"constraints": ["none"]}, "`constraints` must contain only constraints, got 'n"),
        ({"constraints": [mc.NotFrom("waltz")]}, "must match at least one of clip0, "),
        ({"constraints": [mc.Ban(3)]}, "of a stream must not contain Ban"),
        ({"constraints": [OF_GROUP]}, "must have no group, got KeepOriginal with one"),
        ({"constraints": [mc.Reach("Wing", (0, 0, 0), 5)]}, "no joint is named 'Wing'"),
    ],
)
def test_stream_invalid_argument_raises_error_that_names_it(library, options, message):
    with pytest.raises(TypeError if "only constraints" in message else ValueError, match=message):
        mg.Stream(library, **options)


def waits(library, base, delay):
    """Return how many frames later the first frame of each piece is committed."""
    stream, found = mg.Stream(library, delay=delay), []
    for frame in range(base.n_frames):
        stream.push(base[frame : frame + 1])
        found += [frame - piece.start for piece in stream.pieces()]
    return found


@pytest.mark.parametrize("delay", [0.6, 1.2])
def test_stream_delay_bounds_the_wait_beyond_the_end_of_each_segment(library, base, delay):
    least, found = waits(library, base, 0.0), waits(library, base, delay)
    assert len(found) > 3
    limit = round(delay * library.rate) + 2
    assert all(own <= max(limit, first) for own, first in zip(found, least, strict=False))
    assert max(waits(library, base, np.inf)) > max(found)


def test_stream_close_below_two_frames_raises_value_error(library, base):
    stream = mg.Stream(library)
    for n in range(2):
        with pytest.raises(ValueError, match=f"a stream needs at least 2 frames, got {n}"):
            stream.close()
        stream.push(base[n : n + 1])
    stream.close()
    stream.close()
    assert mg.join_pieces(stream.pieces()).n_frames == 2
    assert stream.advance() is None
    with pytest.raises(ValueError, match="`frames` must be pushed before the stream is closed"):
        stream.push(base[2:4])


def test_stream_first_frames_of_another_hierarchy_raise_error(library):
    odd = mg.Motion(mg.Skeleton(["a"], [-1], [[0, 0, 0]]), 1 / 30, [[[0, 0, 0, 1]]], [[[0, 0, 0]]])
    with pytest.raises(mg.SkeletonMismatchError):
        mg.Stream(library).push(odd)


def test_stream_group_with_legs_or_root_raises_value_error(library):
    members = library.groups.resolve(library.skeleton)
    joints = {group: own.tolist() for group, own in members.items()}
    upper_base = mg.Library.build(library.clips[0], mg.JointGroups(joints, base="upper"))
    with pytest.raises(ValueError, match="not name the root or legs in a stream, got 'lower'"):
        mg.Stream(upper_base)


def test_stream_unsupported_config_raises_value_error(library):
    others = (with_config(library, segmentation=own) for own in ({"a": [3]}, lambda _: [3]))
    for make, other in product((mg.Stream, StreamServer), others):
        with pytest.raises(
            ValueError, match=r"`Config\.segmentation` must be 'energy' in a stream"
        ):
            make(other)


def test_stream_grafted_group_of_single_channels_raises_value_error(base):
    """A joint divided between the base group and a group that is not grafted is accepted."""
    divided = base.skeleton.index("Spine")
    others = {"head": ["Head"], "roll": ["Spine.Yrotation"], "arm": ["LeftForeArm"]}
    kept = [name for name in base.skeleton.names if name not in ("Spine", "Head", "LeftForeArm")]
    body = [*kept, "Spine.Xrotation", "Spine.Zrotation"]
    library = mg.Library.build(base[:120], mg.JointGroups({"body": body, **others}, base="body"))
    with pytest.raises(ValueError, match=r"of whole joints.*got 'roll'.*single channels of Spine"):
        mg.Stream(library, swap=["arm", "roll"])
    motion = mg.join_pieces(stream_pieces(library, base[:120], swap=["arm", "head"]))
    np.testing.assert_array_equal(motion.rotations[:, divided], base.rotations[:120, divided])
