"""Motions converted to another hierarchy: what stays the same."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mograft.body.joint_matching import match_joints
from mograft.body.mass import mass_model, up_axis
from mograft.dancer import dance
from mograft.io.smpl.body_models import SMPL, stand_in
from mograft.library.spec import conform
from mograft.motion import rotations
from tests.hierarchies import with_joint_above_root
from tests.library.other_figures import other_names, with_other_rest_pose
from tests.strategies import (
    SEEDS,
    assert_same_rotations,
    few_examples,
    transform_motion,
    turn_motion,
)

DANCE = dance(strides=1).motion[::20]
SCALES = [1.0, 0.01, 1 / 2.54]  # to centimetres, metres and inches


@few_examples(30)
@given(SEEDS, st.sampled_from(SCALES), st.integers(0, 2))
def test_conform_undoes_names_units_axes_and_rest_pose(seed, scale, up):
    rng = np.random.default_rng(seed)
    turn = rotations.shortest_arc(np.eye(3)[1], np.eye(3)[up])
    posed = with_other_rest_pose(turn_motion(transform_motion(DANCE, scale), turn), rng)
    skeleton = posed.skeleton
    posed = replace(posed, skeleton=replace(skeleton, names=tuple(other_names(skeleton))))
    assert not {*posed.skeleton.names} & {*DANCE.skeleton.names}
    assert up_axis(posed) == up
    result = conform(posed, DANCE.skeleton, up=1, root=0)
    size = mass_model(DANCE.skeleton).height
    np.testing.assert_allclose(result.world_positions(), DANCE.world_positions(), atol=1e-4 * size)
    assert_same_rotations(result.rotations, DANCE.rotations, atol=1e-6)
    assert result.skeleton.names == DANCE.skeleton.names
    offsets = result.skeleton.offsets[1:]
    np.testing.assert_allclose(offsets, DANCE.skeleton.offsets[1:], atol=1e-6 * size)


def test_conform_same_hierarchy_is_the_motion_itself():
    larger = DANCE.skeleton.with_offsets(2 * DANCE.skeleton.offsets)
    assert conform(DANCE, larger, up=2, root=0) is DANCE


def test_conform_absent_joints_rest_and_limbs_bend_and_are_as_long_as_in_the_clip():
    target = stand_in(SMPL)
    match = match_joints(target, DANCE.skeleton)
    assert match.absent
    result = conform(DANCE, target, up=2, root=0)
    for joint, source in enumerate(match.sources.tolist()):
        if source < 0:
            assert_same_rotations(result.rotations[:, joint], rotations.IDENTITY, atol=1e-12)
    own, theirs = result.world_transforms(), DANCE.world_transforms()
    turn = rotations.shortest_arc(np.eye(3)[1], np.eye(3)[2])
    expected = 0.01 * rotations.rotate(turn, theirs[1][:, 0])
    np.testing.assert_allclose(own[1][:, 0], expected, atol=1e-9)
    # The knees bend as they do in the clip: the turn between thigh and shank is the same.
    for upper, lower in (("left_hip", "left_knee"), ("right_shoulder", "right_elbow")):
        joints = [target.names.index(name) for name in (upper, lower)]
        sources = match.sources[joints]
        bends = [
            rotations.angle(world[:, pair[0]], world[:, pair[1]])
            for world, pair in ((own[0], joints), (theirs[0], sources))
        ]
        # The rest poses bend differently by less than 0.1 rad.
        np.testing.assert_allclose(*bends, atol=0.1)
        lengths = [
            np.linalg.norm(skeleton.offsets[pair[1]])
            for skeleton, pair in ((result.skeleton, joints), (DANCE.skeleton, sources))
        ]
        assert lengths[0] == pytest.approx(0.01 * lengths[1])
    height = 0.01 * mass_model(DANCE.skeleton).height
    assert mass_model(result.skeleton).height == pytest.approx(height, rel=0.05)


@pytest.mark.parametrize("root", [0, 1])
def test_conform_root_carrier_without_counterpart_moves_only_if_it_is_the_root(root):
    target = with_joint_above_root(DANCE, 0.0).skeleton
    result = conform(DANCE, target, up=1, root=root)
    np.testing.assert_allclose(result.world_positions()[:, 1:], DANCE.world_positions(), atol=1e-9)
    assert result.is_translated[:2].tolist() == [root == 0, root == 1]
    assert_same_rotations(result.rotations[:, 0], rotations.IDENTITY, atol=1e-12)


def test_conform_translated_joint_keeps_positions_and_gets_channels():
    positions = DANCE.positions.copy()
    joint = DANCE.skeleton.names.index("LeftForeArm")
    positions[:, joint] += np.linspace(0, 3, DANCE.n_frames)[:, None]
    moved = replace(DANCE, positions=positions, channel_values=None)
    names = tuple(other_names(moved.skeleton))
    renamed = replace(moved, skeleton=replace(moved.skeleton, names=names))
    result = conform(renamed, DANCE.skeleton, up=1, root=0)
    np.testing.assert_allclose(result.world_positions(), moved.world_positions(), atol=1e-6)
    assert result.skeleton.channels[joint][:3] == ("Xposition", "Yposition", "Zposition")
