"""Grafts of robots: hinges, limits, legs and seams in every kind of graft."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import mograft as mg
from mograft import constraints
from mograft.blend.recombine import Part, recombine
from tests.io.robot_files import G1, G1_MODEL, needs_g1, write_walks
from tests.motion.test_hinges import (
    assert_within_limits,
    motion_on_hinges,
    off_axis,
    random_skeleton,
)
from tests.strategies import SEEDS, few_examples, smooth_rotations

pytestmark = pytest.mark.filterwarnings("ignore:frames per second of robot tables")


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    """A humanoid with narrow limits of angles and speeds, which grafts reach, and its walks."""
    path, files = write_walks(tmp_path_factory.mktemp("walks"))
    skeleton = mg.formats.read_model(path)
    clips = [mg.read(file, skeleton=skeleton)[0] for file in files]
    hinges = skeleton.hinges
    angles = np.concatenate([hinges.angles(clip.rotations) for clip in clips])
    narrow = np.percentile(angles, [2, 98], axis=0).T + np.array([-1e-3, 1e-3])
    steps = np.concatenate([np.diff(hinges.angles(clip.rotations), axis=0) for clip in clips])
    slow = np.percentile(np.abs(steps), 90, axis=0) * clips[0].rate + 1e-3
    return [
        replace(
            clip, skeleton=replace(skeleton, hinges=replace(hinges, limits=narrow, speeds=slow))
        )
        for clip in clips
    ]


def check(graft, kept):
    """Hinges turn about their axes, within limits or the base's own excess; `kept` are kept."""
    hinges, quats = graft.motion.skeleton.hinges, graft.motion.rotations
    fixed = np.setdiff1d(np.arange(1, graft.motion.n_joints), hinges.joints)
    np.testing.assert_array_equal(quats[:, fixed, :3], 0)
    assert_within_limits(hinges, quats, graft.base.rotations, graft.motion.rate)
    np.testing.assert_array_equal(quats[:, kept], graft.base.rotations[:, kept])
    if len(kept):
        np.testing.assert_array_equal(graft.motion.positions, graft.base.positions)


def legs(skeleton):
    return mg.JointGroups.preset("lower_upper", skeleton).resolve(skeleton)["lower"]


@pytest.mark.parametrize("seam", ["gradient", "offset", "inertial", "paper"])
@pytest.mark.parametrize("torso", ["world", "pelvis"])
def test_graft_robot_hinges_turn_about_axes_and_legs_are_kept(model, seam, torso):
    library = mg.Library.build(model, config=mg.Config(seam=seam, torso=torso))
    for graft in mg.graft_many(library, count=3, seed=1):
        assert any(not own.is_own for own in graft.substitutions)
        check(graft, legs(graft.motion.skeleton))


def test_graft_robot_other_kinds_of_grafts_keep_hinges(model):
    library = mg.Library.build(model)
    kept = legs(model[0].skeleton)
    check(mg.graft(library.with_mirror_images(), seed=2), kept)
    walk = mg.graft(library, scenario=mg.scenario.walk(library, 4.0, 0))
    check(walk, kept)
    hand = model[0].world_positions()[60, model[0].skeleton.index("left_wrist_yaw_link")]
    target = tuple(hand + np.array([0.03, 0.0, 0.03]))
    reach = constraints.Reach("left_wrist_yaw_link", target, frames=(60, 60))
    reached = mg.graft(library, constraints=[reach], seed=1)
    check(reached, kept)
    groups = replace(mg.JointGroups.preset("lower_upper", model[0].skeleton), base="upper")
    swapped = mg.graft(mg.Library.build(model, groups), seed=1)
    assert swapped.feet is None
    check(swapped, [])


def test_graft_robot_reach_brings_the_hand_near_the_target(model):
    """The hinges of a shoulder follow only nearly, so the hand is moved several times."""
    skeleton, n = model[0].skeleton, len(model[0].skeleton.hinges.names)
    wide, fast = np.tile([-3.0, 3.0], (n, 1)), np.full(n, 1e9)
    skeleton = replace(skeleton, hinges=replace(skeleton.hinges, limits=wide, speeds=fast))
    library = mg.Library.build([replace(clip, skeleton=skeleton) for clip in model])
    hand = model[0].world_positions()[60, skeleton.index("left_wrist_yaw_link")]
    target = tuple(hand + np.array([0.04, 0.0, 0.04]))
    reach = constraints.Reach("left_wrist_yaw_link", target, frames=(60, 60))
    (found,) = mg.graft(library, constraints=[reach], seed=1).reach_completions
    assert found.after < 0.25 * found.before


@few_examples(25)
@given(seed=SEEDS, spreads=st.booleans())
def test_recombine_robot_moves_only_the_joints_of_its_parts(seed, spreads):
    rng = np.random.default_rng(seed)
    skeleton = random_skeleton(rng)
    base = motion_on_hinges(skeleton, rng, 20)
    joints = np.flatnonzero(rng.random(skeleton.n_joints) < 0.4)
    joints = joints[joints > 0]
    turned = smooth_rotations(rng, 20, len(joints))
    result = recombine(base, [Part(joints, turned, None)], "new", spreads=spreads)
    assert off_axis(skeleton.hinges, result.rotations) <= 1e-9
    may_move = skeleton.subtree_mask(joints) if spreads else np.isin(np.arange(7), joints)
    kept = ~may_move
    np.testing.assert_array_equal(result.rotations[:, kept], base.rotations[:, kept])


def test_graft_robot_seams_are_continuous_in_position_and_velocity(model):
    """With eight times the frames, accelerations at seams stay about the same.

    A jump of the velocity would make them 8 times as large, one of the position 64 times.
    """
    hinges, changes = model[0].skeleton.hinges, []
    for rate in (30.0, 240.0):
        library = mg.Library.build([clip.resample(rate) for clip in model])
        graft = mg.graft(library, seed=3)
        assert len(graft.seams) > 3
        angles = hinges.angles(graft.motion.rotations)
        second = np.abs(np.diff(angles, 2, axis=0)) * graft.motion.rate**2
        frames = np.unique([own.frame for own in graft.seams])
        near = (frames[:, None] + [-2, -1, 0]).clip(0, len(second) - 1)
        changes.append(second[near].max())
    assert changes[1] <= 3.0 * changes[0]


@needs_g1()
@pytest.mark.filterwarnings("ignore:.*joints jump")
@pytest.mark.parametrize("family", ["g1moves", "kimodo"])
def test_graft_g1_is_no_rougher_at_seams_than_the_recordings(family):
    skeleton = mg.formats.read_model(G1_MODEL, rate={"g1moves*": 60})
    files = sorted(G1.glob(f"{family}_*.csv"))
    library = mg.Library.build(files, skeleton=skeleton)
    hinges, found = skeleton.hinges, []
    upper = [k for k, joint in enumerate(hinges.joints) if joint not in legs(skeleton)]

    def accelerations(motion):
        angles = hinges.angles(motion.rotations)[:, upper]
        return np.abs(np.diff(angles, 2, axis=0)) * motion.rate**2

    recorded = [mg.read(file, skeleton=skeleton)[0] for file in files]
    of_recordings = np.concatenate(list(map(accelerations, recorded)))
    limit = 1.3 * np.percentile(of_recordings, 95)
    for graft in mg.graft_many(library, count=10, seed=3):
        check(graft, legs(skeleton))
        frames = np.unique([own.frame for own in graft.seams])
        near = np.unique((frames[:, None] + np.arange(-4, 3)).clip(0, graft.motion.n_frames - 3))
        found.append(accelerations(graft.motion)[near])
        assert np.percentile(found[-1], 95) <= limit
    # Also each joint for itself: the waist, too, whose hinges carry the trunk upright.
    ratios = np.percentile(np.concatenate(found), 95, axis=0)
    ratios /= np.percentile(of_recordings, 95, axis=0)
    assert ratios.max() <= 1.3
