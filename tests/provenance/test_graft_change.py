"""Changes of a graft: a range gets another part of a clip, all other frames stay bit for bit."""

from dataclasses import replace
from functools import cache
from itertools import combinations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

import mograft as mg
import mograft.constraints as mc
from mograft._util.runs import dilate
from mograft.body.loops import is_loop
from mograft.dancer import dance
from mograft.motion import rotations
from mograft.provenance.graft_change import plan_of
from mograft.search.costs import NOVEL_ANGLE, SeamScales
from mograft.solve.donor_spans import DISTINCT_ANGLE, MAX_RATIO, ChangedPart, find_donor_spans
from tests.provenance.checks import assert_replays
from tests.strategies import SEEDS, few_examples
from tests.synthesis.test_loops import library_of_cycles


@pytest.fixture(scope="module")
def library():
    motion = dance(seed=1, strides=2).motion[:1200]
    clips = [motion[:700], replace(motion[700:], name="second")]
    return mg.Library.build(clips, "lower_torso_larm_rarm")


@pytest.fixture(scope="module")
def graft(library):
    return mg.graft(library, seed=3)


@st.composite
def changes(draw, library, n_frames=700):
    """A group, a range of frames, and a part of a clip with which it may be replaced."""
    group = draw(st.sampled_from([own for own in library.groups.names if own != "lower"]))
    n = draw(st.integers(1, 120))
    start = draw(st.integers(0, n_frames - 1 - n))
    clip = draw(st.integers(0, 1))
    most = library.clips[clip].n_frames - 1
    length = draw(st.integers(max(int(np.ceil(n / MAX_RATIO)), 1), min(int(n * MAX_RATIO), most)))
    first = draw(st.integers(0, most - length))
    return group, (start, start + n), (library.names[clip], first, first + length)


def assert_kept(graft, changed, frames, joints):
    """Compare the rotations outside of a range of frames, and in it those of other joints."""
    first, last = frames
    at = np.arange(graft.motion.n_frames)
    is_kept = np.ones(graft.motion.rotations.shape[:2], bool)
    is_kept[np.ix_((at >= first) & (at <= last), joints)] = False
    assert_array_equal(changed.motion.rotations[is_kept], graft.motion.rotations[is_kept])


def angles_between(first, second, frames, joints, others=None):
    """The angles between joints of two motions in frames; `others` are those of the second."""
    others = frames if others is None else others
    return rotations.angle(first.rotations[frames][:, joints], second.rotations[others][:, joints])


@few_examples(25)
@given(st.data())
def test_change_frames_outside_range_and_other_groups_keep_every_bit(library, graft, data):
    group, frames, donor = data.draw(changes(library))
    changed = mg.change(graft, group, frames, donor)
    assert_kept(graft, changed, frames, library.joints(group))
    far = np.delete(np.arange(graft.motion.n_frames), slice(frames[0], frames[1] + 1))
    assert_array_equal(changed.motion.channel_numbers()[far], graft.motion.channel_numbers()[far])
    assert_array_equal(changed.motion.positions, graft.motion.positions)
    assert changed.donors.keys() == graft.donors.keys()
    assert_replays(changed)


@few_examples(30)
@given(st.integers(0, 1), st.integers(16, 120), st.booleans(), st.data())
def test_change_of_equal_length_moves_as_donor_far_from_both_ends(
    library, graft, which, n, is_back, data
):
    """Seams are closed within `seam_blend`, in a short range within a quarter of it.

    An eighth is enough to put a captured part back. Arms have no lean that the base sets.
    """
    which, start = which * (not is_back), data.draw(st.integers(0, 699 - n))
    donor = library.clips[which]
    first = start if is_back else data.draw(st.integers(0, donor.n_frames - 1 - n))
    span = (library.names[which], first, first + n)
    changed = mg.change(graft, "larm", (start, start + n), span)
    blend = int(np.ceil(library.config.seam_blend * graft.motion.rate))
    edge = 2 * min(blend, int(np.ceil(n / (8 if is_back else 4)))) + 1
    near = np.arange(edge, n - edge + 1)
    joints = library.joints("larm")
    angles = angles_between(changed.motion, donor, start + near, joints, first + near)
    assert angles.max(initial=0.0) < 1e-6


@few_examples(12)
@given(st.data())
def test_several_changes_and_edits_replay_to_the_same_bytes(library, graft, data):
    """One request with all changes, as replayed, equals the changes one after the other."""
    current, spans = graft, []
    for group, frames, donor in data.draw(st.lists(changes(library), min_size=2, max_size=4)):
        current = mg.change(current, group, frames, donor)
        spans.append(frames)
        if data.draw(st.booleans()):
            current = mg.edit(current, mg.constraints.Ban(data.draw(st.integers(0, 20))))
    assert_replays(current)
    pristine = current.unchanged
    for own in current.changes:
        pristine = mg.change(pristine, own.group, own.frames, (own.clip, *own.clip_frames))
    assert_array_equal(pristine.motion.rotations, current.motion.rotations)


@pytest.mark.parametrize("choice", ["viterbi", "nearest"])
@few_examples(15)
@given(seed=SEEDS, n=st.integers(1, 60))
def test_first_donor_span_has_least_cost_of_all(library, graft, choice, seed, n):
    """The oracle computes the cost of each span by itself, sample by sample."""
    graft = graft if choice == "viterbi" else nearest_graft(library)
    rng = np.random.default_rng(seed)
    start = int(rng.integers(1, 600))
    group, problem, motion = "rarm", plan_of(graft, ()).problem, graft.motion
    spans = list(
        find_donor_spans(problem, motion, ChangedPart.find(problem, group), (start, start + n), [0])
    )
    costs = [span_cost(problem, motion, group, (start, start + n), own) for own in spans]
    assert_allclose([own.cost for own in spans], costs, rtol=1e-6, atol=1e-6)
    assert costs == sorted(costs) or np.diff(costs).min() > -1e-6
    shortest, longest = np.round(n * np.array([0.85, 1.15])).astype(int).clip(1)
    assert {own.stop - own.start for own in spans} <= {*range(shortest, longest + 1)}
    # Spans of the same length anywhere in the part cost no less than the first.
    length = spans[0].stop - spans[0].start
    for first in rng.integers(0, 700 - length, 5).tolist():
        other = replace(spans[0], start=first, stop=first + length)
        cost = span_cost(problem, motion, group, (start, start + n), other)
        assert cost >= costs[0] - 1e-6


@cache
def nearest_graft(library):
    return mg.graft(library.relabelled(replace(library.config, choice="nearest")), seed=3)


def span_cost(problem, motion, group, frames, span):
    """The cost of one span (oracle)."""
    model = problem.cost_models[group]
    config = model.config
    clip, n, m = problem.library.clips[span.clip], frames[1] - frames[0], span.stop - span.start
    joints, base = problem.library.joints(group), problem.base_joints

    def angle(frame, own, which):
        return rotations.angle(motion.rotations[frame, which], clip.rotations[own, which]).mean()

    def speed(source, frame):
        now, then = source.rotations[frame, joints], source.rotations[frame + 1, joints]
        return rotations.log(rotations.multiply(rotations.inverse(now), then)) * source.rate

    shares = np.linspace(0.0, 1.0, 8)
    pairs = [(frames[0] + round(s * n), span.start + round(s * m)) for s in shares.tolist()]
    new = np.mean([angle(*pair, joints) for pair in pairs])
    scales = SeamScales.from_typical_gaps(*problem.pools[group].typical_gaps, config)
    distance = np.mean([angle(*pair, base) for pair in pairs]) / scales.angle
    cost = config.length_weight * (1 - min(n, m) / max(n, m)) + config.distance_weight * distance
    cost -= config.novelty * (1 + min(1, new / NOVEL_ANGLE)) / 2
    before, after = max(frames[0] - 1, 0), min(frames[1], motion.n_frames - 2)
    for frame, own, mine, theirs in (
        (frames[0], span.start, before, span.start),
        (frames[1], span.stop, after, span.stop - 1),
    ):
        gap = speed(motion, mine) - speed(clip, min(theirs, clip.n_frames - 2))
        gap = np.linalg.norm(gap, axis=-1).mean()
        cost += model.pairwise(np.array(angle(frame, own, joints)), np.array(gap))
    return float(cost)


def test_change_without_donor_is_new_and_alternatives_differ(library, graft):
    """Frames of the range itself are left out."""
    joints, middle = library.joints("larm"), np.arange(155, 196)
    made = [mg.change(graft, "larm", (150, 200), rank=rank) for rank in range(4)]
    for first, second in combinations([*(own.motion for own in (*made, graft)), graft.base], 2):
        assert angles_between(first, second, middle, joints).max() > np.radians(0.5)
    for own in made:
        first, last = own.changes[0].clip_frames
        is_other = own.changes[0].clip != graft.base.name
        assert is_other or min(last, 200) - max(first, 150) <= 25


@few_examples(8)
@given(st.integers(0, 600), st.integers(10, 90), st.sampled_from(["larm", "head", "arms"]))
def test_change_of_part_of_a_group_moves_no_other_joint(start, n, name):
    library = mg.Library.build(dance(seed=1, strides=2).motion[:700])
    graft = mg.graft(library, seed=3)
    frames = (start, min(start + n, 699))
    changed = mg.change(graft, name, frames)
    whole = "lower_torso_arms" if name == "arms" else "lower_torso_head_larm_rarm"
    joints = mg.JointGroups.preset(whole, library.skeleton).resolve(library.skeleton)[name]
    assert_kept(graft, changed, frames, joints)
    assert (changed.motion.rotations[:, joints] != graft.motion.rotations[:, joints]).any()
    assert_replays(changed)


def span_differences(problem, motion, frames, spans):
    """The mean angles between spans and a range of a motion, of the joints of "larm" (oracle)."""
    joints, rows = problem.library.joints("larm"), np.round(np.linspace(*frames, 8)).astype(int)
    found = []
    for own in spans:
        times = np.round(np.linspace(0, own.stop - own.start, 8)).astype(int) + own.start
        poses = problem.library.clips[own.clip].rotations[times][:, joints]
        found.append(rotations.angle(motion.rotations[rows][:, joints], poses).mean())
    return np.array(found)


@few_examples(12)
@given(st.integers(6, 640), st.integers(12, 59), st.sampled_from(["larm", "rarm", ""]), st.data())
def test_change_without_donor_prefers_distinct_parts_then_clips_without_donor_in_the_range(
    library, graft, start, n, changed, data
):
    """Changes of a part of the range count as donors, those before it or of other groups do not."""
    rank = data.draw(st.sampled_from([0, 1, 5, 30]))
    frames = (start, start + n)
    if changed or data.draw(st.booleans()):
        graft = mg.graft(library, constraints=[mc.KeepOriginal()])
    first = start + data.draw(st.sampled_from([3, -6]))
    if changed:
        graft = mg.change(graft, changed, (first, first + 6), ("second", 40, 46))
    used = {
        library.names.index(own.clip)
        for own in graft.substitutions
        if own.group == "larm" and own.start < frames[1] and own.stop > start
    } | ({1} if changed == "larm" and first > start else set())
    problem = plan_of(graft, ()).problem
    part = ChangedPart.find(problem, "larm")
    spans = list(find_donor_spans(problem, graft.motion, part, frames))
    is_near = span_differences(problem, graft.motion, frames, spans) < DISTINCT_ANGLE
    ranks = [(near, own.clip in used, own.cost) for near, own in zip(is_near, spans, strict=True)]
    expected = spans[sorted(range(len(spans)), key=ranks.__getitem__)[rank]]
    made = mg.change(graft, "larm", frames, rank=rank).changes[-1]
    assert (made.clip, *made.clip_frames) == (
        library.names[expected.clip],
        expected.start,
        expected.stop,
    )


@pytest.fixture(scope="module")
def loops():
    """A library of loops on nearly the same legs."""
    return library_of_cycles(3)


RANGES_AT_ENDS = st.just((0, 32)) | st.integers(12, 31).flatmap(
    lambda length: st.sampled_from([(0, length), (32 - length, 32)])
)


@few_examples(12)
@given(st.integers(0, 9), st.integers(0, 5), RANGES_AT_ENDS)
def test_named_part_holds_to_the_ends_of_a_loop_and_the_report_states_it(
    loops, seed, which, frames
):
    donor = loops.clips[which]
    changed = mg.change(mg.graft(loops, seed=seed), "arms", frames, (donor.name, *frames))
    preset = mg.JointGroups.preset("lower_torso_arms", loops.skeleton)
    joints = preset.resolve(loops.skeleton)["arms"]
    at, edge = np.arange(33), 2 * int(np.ceil((frames[1] - frames[0]) / 4)) + 1
    is_held = at >= frames[0] + edge * (frames[0] > 0)
    is_held &= at <= frames[1] - edge * (frames[1] < 32)
    assert angles_between(changed.motion, donor, is_held, joints).max() < 1e-6
    assert ("the loop is open" in changed.report()) == (not is_loop(changed.motion))
    assert_replays(changed)


@few_examples(6)
@given(st.integers(0, 9), RANGES_AT_ENDS, st.sampled_from([None, ("other2", 2, 25)]))
def test_change_without_donor_or_with_loop_on_closes_the_loop(loops, seed, frames, donor):
    config = replace(loops.config, max_angle=3.0, loop="on" if donor else "auto")
    changed = mg.change(mg.graft(loops.relabelled(config), seed=seed), "upper", frames, donor)
    assert rotations.angle(*changed.motion.rotations[[0, -1]]).max() < np.radians(0.01)
    assert "the loop is open" not in changed.report()
    assert_replays(changed)


def test_change_respects_constraints_on_donors(graft):
    only = mg.change(graft, "larm", (150, 200), constraints=[mc.OnlyFrom("second")])
    assert only.changes[0].clip == "second"
    banned = mc.Ban(frames=(150, 200), donor="second", group="larm")
    other = mg.change(graft, "larm", (150, 200), "*", constraints=[banned])
    assert other.changes[0].clip != "second"


def test_change_takes_first_part_that_satisfies_constraints_on_poses(graft):
    hand = graft.motion.world_positions()[:, graft.motion.skeleton.index("LeftHand")]
    top = float(hand[150:200, 1].max())
    low = mc.KeepOut("LeftHand", mc.HalfSpace((0, top - 1.0, 0), (0, -1.0, 0)), frames=(160, 190))
    plain = mg.change(graft, "larm", (140, 210))
    limited = mg.change(graft, "larm", (140, 210), constraints=[low])
    assert len(limited.violations) <= len(plain.violations)
    poses = limited.motion.world_positions()[160:191, limited.motion.skeleton.index("LeftHand"), 1]
    if not limited.violations:
        assert poses.max() <= top - 1.0 + 0.005 * 200
    assert_replays(limited)


def test_change_of_root_moves_later_frames_rigidly(root_library):
    graft, root = mg.graft(root_library, constraints=[mc.KeepOriginal()]), root_library.root
    changed = mg.change(graft, "lower", (150, 230), ("second", 20, 95))
    far = np.delete(np.arange(graft.motion.n_frames), slice(150, 231))
    others = np.ix_(far, np.delete(np.arange(graft.motion.n_joints), root))
    assert_array_equal(changed.motion.rotations[others], graft.motion.rotations[others])
    steps = [
        np.linalg.norm(np.diff(m.positions[300:, root], axis=0), axis=1)
        for m in (graft.motion, changed.motion)
    ]
    assert_allclose(*steps, atol=1e-6)
    assert_replays(changed)


def test_edit_keeps_changes_of_other_segments_and_drops_those_of_its_own(library, graft):
    first = mg.change(graft, "larm", (150, 200), ("second", 10, 60))
    both = mg.change(first, "rarm", (300, 350), ("second", 100, 150))
    kept = mg.edit(both, mc.KeepOriginal(frames=(150, 200), group="larm"))
    assert [own.group for own in kept.changes] == ["rarm"]
    middle = np.ix_(np.arange(160, 190), library.joints("larm"))
    assert_array_equal(kept.motion.rotations[middle], graft.base.rotations[middle])
    assert_replays(kept)


@pytest.mark.parametrize(
    ("constraint", "selects"),
    [
        (mc.NotFrom("second"), lambda own: own.clip == "second"),
        (mc.MaxStretch(0.02), lambda own: abs(own.stretch) > 0.021),
    ],
)
def test_edit_with_constraint_on_donors_changes_only_segments_that_violate_it(
    graft, constraint, selects
):
    edited = mg.edit(graft, constraint)
    assert not [own for own in edited.violations if own.constraint is constraint]
    assert any(selects(own) and not own.is_own for own in graft.substitutions)
    for group in graft.donors:
        old = [own for own in graft.substitutions if own.group == group]
        is_violating = np.array([selects(own) and not own.is_own for own in old])
        is_changed = graft.donors[group] != edited.donors[group]
        assert not (is_changed & ~dilate(is_violating)).any()


def test_edit_with_reach_moves_hand_and_keeps_frames_far_away(library):
    own = library.relabelled(mg.Config.from_dict(library.config.as_dict() | {"reach_ik": 1.0}))
    graft = mg.graft(own, seed=3)
    hand = graft.motion.world_positions()[200, graft.motion.skeleton.index("LeftHand")]
    reach = mc.Reach("LeftHand", (hand[0], hand[1] + 12.0, hand[2]), frames=(200, 200))
    edited = mg.edit(graft, reach)
    assert not edited.violations
    assert all((edited.donors[name] == own).all() for name, own in graft.donors.items())
    assert_kept(graft, edited, (170, 230), np.arange(graft.motion.n_joints))
    assert_replays(edited)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("arms", (10, 20)), "`group` must be an exchanged group"),
        (("larm", (10, 10)), "`frames` must be at least two frames"),
        (("larm", (10, 700)), "`frames` must be at least two frames from 0 to 699"),
        (("larm", (10, 20), "secnd"), "`donor` must match .*; got 'secnd'.*second"),
        (("larm", (10, 480), "second", 99), "only [1-9][0-9]* parts of 'second' can replace larm"),
        (("larm", (10, 20), ("second", 5, 500)), "at least two frames from 0 to 499"),
        (("larm", (10, 20), ("second", 5, 100)), "at most 3 times as long"),
    ],
)
def test_change_bad_arguments_raise(graft, arguments, message):
    *given, rank = arguments if len(arguments) == 4 else (*arguments, 0)
    with pytest.raises(ValueError, match=message):
        mg.change(graft, *given, rank=rank)


@pytest.mark.parametrize("key", ["group", "clip", "frames", "clip_frames"])
def test_replay_damaged_change_raises(library, graft, key):
    document = mg.graft_record(mg.change(graft, "larm", (150, 200), ("second", 10, 60)))
    document["changes"][0][key] = {"frames": [150, 9999], "clip_frames": [10, 9999]}.get(key, "no")
    with pytest.raises(mg.ProvenanceError, match=r"does not exist|must be an exchanged group"):
        mg.replay(document, library)


@few_examples(8)
@given(st.data(), st.sampled_from([{"seam_blend": 0.6}, {"seam": "offset"}, {"torso": "pelvis"}]))
def test_replay_with_other_blending_keeps_donors_and_replays(library, graft, data, fields):
    edited = mg.change(mg.edit(graft, mg.constraints.Ban(9)), *data.draw(changes(library)))
    config = replace(library.config, **fields)
    other = mg.replay(mg.graft_record(edited), library, config=config)
    assert all((other.donors[name] == own).all() for name, own in edited.donors.items())
    assert other.changes == edited.changes
    assert mg.advise(other) == mg.advise(edited)
    for name, counts in edited.alternatives.items():
        assert_array_equal(other.alternatives[name], counts)
    assert (other.motion.rotations != edited.motion.rotations).any()
    assert_replays(other)


def test_replay_with_other_search_raises(library, graft):
    config = replace(library.config, novelty=1.0)
    with pytest.raises(ValueError, match="`config` must differ in fields of blending only"):
        mg.replay(mg.graft_record(graft), library, config=config)
