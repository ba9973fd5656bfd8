"""The last steps of a graft: completed `Reach`, and violations by joints that no donor moves."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import mograft as mg
import mograft.constraints as mc
from mograft.dancer import dance
from mograft.search.obstacles import Sphere
from mograft.solve.finish import find_kept_violations
from tests.strategies import few_examples, with_config

HAND, FRAME = "LeftHand", 200


@pytest.fixture(scope="module")
def library():
    motion = dance(seed=1, strides=1).motion[:600]
    return mg.Library.build(motion, "lower_torso_larm_rarm")


def position(motion, joint=HAND, frame=FRAME):
    return motion.world_positions()[frame, motion.skeleton.index(joint)]


def aside(library, distance, joint=HAND, frame=FRAME):
    """A target at a distance, in skeleton heights, from a joint of the graft without targets.

    It is in the direction of the shoulder or hip, so that the limb is long enough.
    """
    motion = mg.graft(with_config(library, reach_ik=0.0), seed=3).motion
    here = position(motion, joint, frame)
    above = motion.skeleton.index("LeftArm" if "Hand" in joint else "LeftUpLeg")
    direction = motion.world_positions()[frame, above] - here
    height = mg.Poses.from_motion(motion).height
    return tuple(here + distance * height * direction / np.linalg.norm(direction))


@given(st.floats(0.0, 0.3), st.sampled_from([0.01, 0.03, 0.1]))
@few_examples(5)
def test_graft_reach_is_violated_only_beyond_its_tolerance_after_completion(
    library, distance, tolerance
):
    reach = mc.Reach(HAND, aside(library, distance), FRAME, tolerance)
    graft = mg.graft(library, constraints=[reach], seed=3)
    height = mg.Poses.from_motion(graft.base).height
    error = np.linalg.norm(position(graft.motion) - reach.target) / height
    (completion,) = graft.reach_completions
    assert completion.after == pytest.approx(error, abs=1e-9)
    assert bool(graft.violations) == (error > tolerance)
    assert completion.is_moved or completion.before == completion.after
    if completion.is_moved:
        assert error < 1e-9


def test_graft_reach_ik_changes_only_the_arm_near_the_frame(library):
    reach = mc.Reach(HAND, aside(library, 0.05), FRAME, 0.2)
    without = mg.graft(with_config(library, reach_ik=0.0), constraints=[reach], seed=3)
    graft = mg.graft(library, constraints=[reach], seed=3)
    assert without.reach_completions == ()
    assert graft.substitutions == without.substitutions
    changed = (graft.motion.rotations != without.motion.rotations).any(axis=2)
    names = {graft.motion.skeleton.names[joint] for joint in np.flatnonzero(changed.any(axis=0))}
    assert names == {"LeftArm", "LeftForeArm"}
    reached = round(library.config.seam_blend * graft.motion.rate)
    assert np.abs(np.flatnonzero(changed.any(axis=1)) - FRAME).max() < reached
    assert (graft.motion.positions == without.motion.positions).all()


@pytest.mark.parametrize("joint", ["LeftHand", "LeftFoot"])
def test_graft_kept_groups_are_never_moved(library, joint):
    reach = mc.Reach(joint, aside(library, 0.05, joint), FRAME)
    graft = mg.graft(library, constraints=[reach], swap=["torso", "rarm"], seed=3)
    (completion,) = graft.reach_completions
    assert completion.reason == "the limb is not exchanged"
    for group in ("lower", "larm"):
        joints = library.joints(group)
        assert (graft.motion.rotations[:, joints] == graft.base.rotations[:, joints]).all()
        assert (graft.motion.positions[:, joints] == graft.base.positions[:, joints]).all()


def test_graft_completion_that_breaks_another_constraint_is_not_made(library):
    target = aside(library, 0.05)
    reach = mc.Reach(HAND, target, FRAME, 0.2)
    height = mg.Poses.from_motion(library.clips[0]).height
    ball = mc.KeepOut(HAND, mc.Sphere(target, 0.02 * height), frames=(FRAME, FRAME))
    graft = mg.graft(library, constraints=[reach, ball], seed=3)
    (completion,) = graft.reach_completions
    assert (completion.reason, graft.violations) == ("KeepOut would be violated", ())
    soft = replace(ball, weight=1.0)
    graft = mg.graft(library, constraints=[reach, soft], seed=3)
    assert graft.reach_completions[0].is_moved


def test_graft_completions_are_reported_and_replayed_also_after_edits(library):
    near, far = aside(library, 0.05), aside(library, 0.3, "RightHand", 300)
    constraints = [mc.MaxAngle(0.7), mc.Reach("RightHand", far, 300), mc.Reach(HAND, near, FRAME)]
    graft = mg.graft(library, constraints=constraints, seed=3)
    left, moved = graft.reach_completions
    assert (left.is_moved, moved.is_moved) == (False, True)
    assert f"{HAND}, frame {FRAME}: {moved.before:.3f} heights" in graft.report()
    assert left.reason in graft.report()
    first, second = mg.graft_record(graft)["reach_ik"]
    assert (first["number"], second["number"]) == (1, 2)
    assert (second["joint"], second["frames"]) == (HAND, [FRAME, FRAME])
    assert second["before_heights"] == pytest.approx(moved.before, abs=1e-6)
    assert second["after_heights"] == pytest.approx(0.0, abs=1e-6)
    kept = mg.edit(graft, mc.KeepOriginal(frames=(FRAME - 5, FRAME + 5)))
    assert not any(own.is_moved for own in kept.reach_completions)
    assert kept.reach_completions[1].reason == "KeepOriginal keeps these frames"
    at_start = next(i for i, own in enumerate(graft.substitutions) if own.stop > 20)
    again = mg.edit(graft, mc.Ban(at_start))
    assert again.reach_completions[1].is_moved
    assert (position(again.motion) == position(graft.motion)).all()
    for own in (graft, kept, again, mg.edit(kept, mc.Ban(at_start))):
        replayed = mg.replay(mg.graft_record(own), library)
        assert (replayed.motion.rotations == own.motion.rotations).all()
        assert mg.graft_record(replayed) == mg.graft_record(own)


def test_replay_completion_of_another_constraint_raises_provenance_error(library):
    reach = mc.Reach(HAND, aside(library, 0.05), FRAME)
    document = mg.graft_record(mg.graft(library, constraints=[mc.MaxAngle(0.7), reach], seed=3))
    document["reach_ik"][0]["number"] = 0
    with pytest.raises(mg.ProvenanceError, match="Reach"):
        mg.replay(document, library)


def test_graft_reach_of_weight_zero_and_derived_class_is_not_completed(library):
    class Wish(mc.Reach):
        pass

    target = aside(library, 0.05)
    for reach in (mc.Reach(HAND, target, FRAME, weight=0.0), Wish(HAND, target, FRAME)):
        assert mg.graft(library, constraints=[reach], seed=3).reach_completions == ()


@pytest.fixture(scope="module")
def two_groups():
    return mg.Library.build(dance(seed=1, strides=1).motion[:400])


@settings(max_examples=7, deadline=None)
@given(
    joint=st.sampled_from(["LeftFoot", "RightLeg", "LeftHand", "Head", "Hips"]),
    frame=st.integers(0, 399),
    radius=st.floats(1, 40),
    seed=st.integers(0, 3),
)
def test_kept_violations_remain_in_every_graft(two_groups, joint, frame, radius, seed):
    """Any donors leave them as they are; and all other violations are by exchanged joints."""
    clip = two_groups.clips[0]
    _, positions = clip.world_transforms()
    avoid = mc.Avoid(Sphere(tuple(positions[frame, clip.skeleton.index(joint)]), radius))
    kept = find_kept_violations(two_groups, clip, ["upper"], [avoid])
    motion = mg.graft(two_groups, seed=seed).motion
    again = find_kept_violations(two_groups, motion, ["upper"], [avoid])
    assert [(own.frames, own.joint) for own in kept] == [(own.frames, own.joint) for own in again]
    legs = {clip.skeleton.names[index] for index in two_groups.joints("lower")}
    assert {own.joint for own in kept} <= legs
    if joint in legs:
        assert any(own.frames[0] <= frame <= own.frames[1] for own in kept)


def test_kept_violations_are_none_if_donors_hold_the_root(two_groups):
    groups = mg.JointGroups(two_groups.groups.groups, base="upper")
    other = mg.Library.build(two_groups.clips[0], groups)
    everywhere = mc.Avoid(Sphere((0.0, 0.0, 0.0), 9999.0))
    assert find_kept_violations(other, two_groups.clips[0], ["lower"], [everywhere]) == []
    assert find_kept_violations(two_groups, two_groups.clips[0], ["upper"], [everywhere]) != []
    soft = mc.Avoid(Sphere((0.0, 0.0, 0.0), 9999.0), weight=1.0)
    assert find_kept_violations(two_groups, two_groups.clips[0], ["upper"], [soft]) == []
