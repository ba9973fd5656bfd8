"""Positions relative to the figure: how they move with it, and what they are named after."""

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

import mograft as mg
import mograft.constraints as mc
from mograft.body.anatomy import find_joint
from mograft.body.mass import mass_model
from mograft.dancer import dance
from mograft.search.pose_constraints import anchor_reaches
from mograft.synthesis.graft import kept_violations
from tests.hierarchies import skeleton_from_text
from tests.strategies import transform_motion

MOTION = dance(seed=1, strides=1).motion[:120]
HEIGHT = mass_model(MOTION.skeleton).height
OFFSETS = st.tuples(*[st.floats(-1.0, 1.0)] * 3)
PARTS = st.sampled_from(["chest", "Hips", "head", "left hand", "RightFoot", "neck"])
OTHER_NAMES = {
    "Hips": "pelvis",
    "LeftHand": "hand.l",
    "RightHand": "wrist_R",
    "LeftForeArm": "elbow_l",
    "RightArm": "r_upperarm",
    "LeftUpLeg": "thigh.L",
    "RightLeg": "calf_r",
    "LeftFoot": "Bip01 L Foot",
    "Head": "skull",
}


def located(motion, part, offset):
    positions = motion.world_positions()
    return mc.FigurePosition(part, offset).locate(motion.skeleton, positions, 1)


@given(PARTS | st.just("LeftHand"), OFFSETS, st.integers(0, MOTION.n_frames - 1))
def test_reach_relative_to_its_own_joint_is_anchored_where_the_joint_is(part, offset, frame):
    own = mc.Reach("LeftHand", mc.FigurePosition(part, offset), frame)
    absolute = mc.Reach("LeftHand", (1.0, 2.0, 3.0), frame)
    anchored, other = anchor_reaches([own, absolute], MOTION)
    assert other is absolute
    if part == "LeftHand":
        assert anchored.target == pytest.approx(tuple(located(MOTION, part, offset)[frame]))
        assert (anchored.joint, anchored.frames) == (own.joint, own.frames)
    else:
        assert anchored is own


@given(PARTS, OFFSETS, st.floats(-4.0, 4.0), st.floats(0.2, 5.0), st.floats(-90.0, 90.0))
def test_figure_position_moves_turns_and_scales_with_the_figure(part, offset, yaw, scale, shift):
    moved = transform_motion(MOTION, scale, yaw, (shift, 2.0 * shift, -shift))
    before, after = located(MOTION, part, offset), located(moved, part, offset)
    origin, moved_origin = located(MOTION, part, (0, 0, 0)), located(moved, part, (0, 0, 0))
    turned = before - origin
    expected = scale * turned @ Rotation.from_rotvec([0.0, yaw, 0.0]).as_matrix().T
    assert_allclose(after - moved_origin, expected, atol=1e-6 * scale * HEIGHT)
    assert_allclose(np.linalg.norm(turned, axis=1), HEIGHT * np.linalg.norm(offset), atol=1e-6)


def test_figure_position_axes_are_left_up_and_forward():
    skeleton = MOTION.skeleton
    quats = np.tile([0, 0, 0, 1.0], (1, skeleton.n_joints, 1))
    rest = mg.Motion(skeleton, 1 / 30, quats, skeleton.offsets[None])
    positions = rest.world_positions()[0]
    left, up, forward = (located(rest, "Hips", own)[0] - positions[0] for own in np.eye(3).tolist())
    foot = skeleton.index("LeftFoot")
    (toe,) = (site.offset for site in skeleton.end_sites if site.parent == foot)
    hands = positions[skeleton.index("LeftHand")] - positions[skeleton.index("RightHand")]
    assert hands @ left > 0 < toe @ forward
    assert_allclose(up, [0, HEIGHT, 0], atol=1e-9)
    assert_allclose(np.cross(up, forward), left * HEIGHT, atol=1e-6)


def test_reach_of_figure_position_is_met_in_every_frame_and_replayed():
    library = mg.Library.build(MOTION, config=mg.Config(reach_ik=1.0))
    target = mc.FigurePosition("chest", (0.12, 0.1, 0.15))
    reach = mc.Reach("LeftHand", target, frames=(40, 60))
    graft = mg.graft(library, constraints=[reach])
    assert not graft.violations
    hand = graft.motion.skeleton.index("LeftHand")
    places = located(graft.motion, "chest", target.offset)
    distances = np.linalg.norm(graft.motion.world_positions()[:, hand] - places, axis=1)
    assert distances[40:61].max() <= 0.03 * HEIGHT
    (completion,) = graft.reach_completions
    assert completion.after == pytest.approx(distances[40:61].max() / HEIGHT, abs=1e-9)
    record = mg.graft_record(graft)
    again = mg.replay(record, library)
    assert again.request.constraints == (reach,)
    assert (again.motion.rotations == graft.motion.rotations).all()


def test_find_joint_of_other_names_is_the_same_body_part():
    skeleton = MOTION.skeleton
    other = replace(skeleton, names=tuple(OTHER_NAMES.get(name, name) for name in skeleton.names))
    for name, counterpart in OTHER_NAMES.items():
        index = skeleton.index(name)
        for own, words in ((skeleton, counterpart), (other, name)):
            assert find_joint(own, words, is_part=True) == index
            expected = f"no joint is named '{words}'; did you mean '{own.names[index]}', the same"
            with pytest.raises(ValueError, match=re.escape(expected)):
                find_joint(own, words)
            with pytest.raises(ValueError, match=re.escape(expected)):
                mg.JointGroups({"lower": ["*"], "upper": [words]}).resolve(own)


TRUNKS = ("Spine > Spine1 > Spine2", "Spine > Chest", "Torso", "spine_01 > spine_02", "J_L3 > J_T8")


@pytest.mark.parametrize("trunk", TRUNKS)
def test_find_joint_chest_is_the_top_of_the_trunk(trunk):
    limbs = (f"{side}Arm > {side}ForeArm > {side}Hand" for side in ("Left", "Right"))
    legs = (f"{side}UpLeg > {side}Leg > {side}Foot" for side in ("Left", "Right"))
    text = f"Hips {{{trunk} {{Neck > Head | {' | '.join(limbs)}}} | {' | '.join(legs)}}}"
    skeleton, _ = skeleton_from_text(text)
    assert skeleton.names[find_joint(skeleton, "chest", is_part=True)] == trunk.split()[-1]


def test_kept_violations_ignore_targets_that_donors_may_move():
    library = mg.Library.build(MOTION)
    place = located(MOTION, "chest", (0.0, 0.0, 0.0))[10]
    for target, n_kept in ((tuple(place), 1), (mc.FigurePosition("chest", (0, 0, 0)), 0)):
        reach = mc.Reach("LeftFoot", target, 10)
        assert len(kept_violations(library, constraints=[reach])) == n_kept


@pytest.mark.parametrize("name", ["hand", "wing", "LeftHnd", ""])
@pytest.mark.parametrize("is_part", [False, True])
def test_find_joint_unknown_name_or_part_without_side_is_refused(name, is_part):
    with pytest.raises(ValueError, match=f"no joint( or body part)? is named '{name}'"):
        find_joint(MOTION.skeleton, name, is_part=is_part)
