"""Inverse kinematics for `Reach`: targets, blend windows, bone lengths, limits."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mograft import Motion, Poses
from mograft.blend.reach_completion import ReachLimits, complete_reaches, fade_corrections
from mograft.blend.two_bone_ik import flexion_angles, mean_bend_axis
from mograft.body.anatomy import anatomy, find_limb
from mograft.body.mass import mass_model
from mograft.constraints import Reach
from mograft.dancer import dance
from mograft.motion import rotations
from tests.strategies import SEEDS, few_examples

MOTION = dance(seed=1, strides=1).motion[:240]
POSES = Poses.from_motion(MOTION)
HEIGHT = mass_model(MOTION.skeleton).height
ENDS = ("LeftHand", "RightHand", "LeftFoot", "RightFoot")
N_BLEND = 9


def limits(motion=MOTION, distance=0.25, n_blend=N_BLEND, fixed=(), kept=()):
    """Limits with which all joints except `fixed` are movable in all frames except `kept`."""
    is_movable = np.ones(motion.n_joints, bool)
    is_movable[[motion.skeleton.index(name) for name in fixed]] = False
    is_kept = np.zeros(motion.n_frames, bool)
    is_kept[list(kept)] = True
    return ReachLimits(distance=distance, n_blend=n_blend, is_movable=is_movable, is_kept=is_kept)


def limb_length(motion, limb, frame=0):
    points = motion.world_positions()[frame, [limb.start, limb.middle, limb.end]]
    return np.linalg.norm(np.diff(points, axis=0), axis=1).sum()


def near_target(motion, joint, frames, rng, share=0.2):
    """A target that a limb can reach in all frames, near the joint's mean position.

    It is at most `share` of the limb's length from the joint; None if the limb moves farther.
    """
    limb = find_limb(motion.skeleton, motion.skeleton.index(joint))
    rows = slice(frames[0], frames[1] + 1)
    points = motion.world_positions()[rows][:, [limb.start, limb.middle, limb.end]]
    length = limb_length(motion, limb)
    middle = points[:, 2].mean(axis=0)
    for _ in range(50):
        target = middle + rng.normal(size=3) * share * length / 2
        distances = np.linalg.norm(points[:, 2] - target, axis=1)
        from_start = np.linalg.norm(points[:, 0] - target, axis=1)
        if distances.max() < share * length and from_start.max() < 0.99 * length:
            return tuple(target)
    return None


@st.composite
def near_reaches(draw):
    """A `Reach` of one frame or of several that is near enough to be completed."""
    joint, first = draw(st.sampled_from(ENDS)), draw(st.integers(0, MOTION.n_frames - 1))
    last = min(first + draw(st.integers(0, 6)), MOTION.n_frames - 1)
    rng = np.random.default_rng(draw(SEEDS))
    for frames in ((first, last), (first, first)):
        target = near_target(MOTION, joint, frames, rng)
        if target is not None:
            return Reach(joint, target, frames=frames)
    return Reach(joint, near_target(MOTION, joint, (60, 60), rng, 0.25), 60)


def changed_frames(before, after):
    return np.flatnonzero((before.rotations != after.rotations).any(axis=(1, 2)))


def bone_lengths(motion):
    positions, parents = motion.world_positions(), motion.skeleton.parents
    return np.linalg.norm(positions[:, 1:] - positions[:, parents[1:]], axis=-1)


@given(near_reaches(), st.integers(1, 20))
@few_examples(25)
def test_complete_reaches_near_target_is_met_by_two_joints_within_the_blend_window(reach, n_blend):
    result, (completion,) = complete_reaches(MOTION, [reach], limits(n_blend=n_blend), POSES)
    assert completion.is_moved
    first, last = reach.frames
    joint = MOTION.skeleton.index(reach.joint)
    positions = result.world_positions()[first : last + 1, joint]
    errors = np.linalg.norm(positions - reach.target, axis=1)
    assert errors.max() < 1e-9 * HEIGHT
    assert completion.after == pytest.approx(errors.max() / HEIGHT, abs=1e-12)
    assert (result.positions == MOTION.positions).all()
    np.testing.assert_allclose(bone_lengths(result), bone_lengths(MOTION), atol=1e-9 * HEIGHT)
    frames = changed_frames(MOTION, result)
    assert first - n_blend < frames.min() <= frames.max() < last + n_blend
    limb = find_limb(MOTION.skeleton, joint)
    is_changed = (result.rotations != MOTION.rotations).any(axis=(0, 2))
    assert set(np.flatnonzero(is_changed)) <= {limb.start, limb.middle}


@given(near_reaches(), st.floats(0.3, 0.99), st.floats(1.01, 3.0))
@few_examples(15)
def test_complete_reaches_limit_decides_whether_a_limb_moves(reach, smaller, larger):
    _, (found,) = complete_reaches(MOTION, [reach], limits(distance=10.0), POSES)
    limb = find_limb(MOTION.skeleton, MOTION.skeleton.index(reach.joint))
    share = found.before * HEIGHT / limb_length(MOTION, limb, reach.frames[0])
    result, (left,) = complete_reaches(MOTION, [reach], limits(distance=smaller * share), POSES)
    assert result is MOTION
    assert left.reason.startswith("the limit is ")
    assert left.before == left.after == found.before
    result, (moved,) = complete_reaches(MOTION, [reach], limits(distance=larger * share), POSES)
    assert moved.is_moved
    assert len(changed_frames(MOTION, result))


def waving(rate, seed):
    """Waving limbs for 1.5 s, sampled at a frame rate; elbows and knees are hinges."""
    rng = np.random.default_rng(seed)
    times = np.arange(int(1.5 * rate) + 1) / rate
    size, speed, phase = rng.uniform([0.05, 1, 0], [0.2, 6, 6], (3 * MOTION.n_joints, 3)).T
    angles = size * np.sin(np.outer(times, speed) + phase)
    vectors = angles.reshape(len(times), MOTION.n_joints, 3)
    for joint in anatomy(MOTION.skeleton).joints("forearm", "shank"):
        bone = MOTION.skeleton.offsets[joint]
        axis = np.cross(bone, np.eye(3)[np.abs(bone).argmin()])
        vectors[:, joint] = (0.8 + vectors[:, joint, :1]) * axis / np.linalg.norm(axis)
    places = np.tile(MOTION.positions[:1], (len(times), 1, 1))
    return Motion(MOTION.skeleton, 1.0 / rate, rotations.exp(vectors), places, name="waving")


@given(SEEDS, st.sampled_from(ENDS), st.integers(0, 3))
@few_examples(15)
def test_complete_reaches_hinge_keeps_its_bending_plane(seed, joint, hold):
    """The target is nearer to the first joint than the limb is, so that the limb is long enough."""
    motion = waving(30, seed)
    limb = find_limb(motion.skeleton, motion.skeleton.index(joint))
    start, end = motion.world_positions()[21, [limb.start, limb.end]]
    target = end + 0.15 * (start - end) + 0.03 * limb_length(motion, limb) * np.array([1, 0, 1])
    reach = Reach(joint, tuple(target), frames=(21, 21 + hold))
    result, (found,) = complete_reaches(
        motion, [reach], limits(motion, distance=10.0), Poses.from_motion(motion)
    )
    assert found.is_moved

    def local_normals(motion):
        turns, places = motion.world_transforms()
        start, middle, end = (places[:, own] for own in (limb.start, limb.middle, limb.end))
        normals = np.cross(start - middle, end - middle)
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        return rotations.rotate(rotations.inverse(turns[:, limb.start]), normals)

    np.testing.assert_allclose(local_normals(result), local_normals(motion), atol=1e-9)


@given(
    n_blend=st.integers(2, 40),
    n=st.integers(1, 10),
    first=st.integers(0, 60),
    value=st.floats(-2, 2),
    slope=st.floats(-0.2, 0.2),
)
def test_fade_corrections_has_bounded_second_differences(n_blend, n, first, value, slope):
    slope = slope if n > 1 else 0.0
    own = (value + slope * np.arange(n))[:, None]
    filled = fade_corrections(np.arange(first, first + n), own, 120, n_blend)
    assert (filled[first : first + n] == own).all()
    outside = np.r_[0 : max(first - n_blend + 1, 0), first + n - 1 + n_blend : 120]
    assert (filled[outside] == 0.0).all()
    # The greatest second derivative of a cubic from 0 to a value with a slope.
    bound = 6.0 * np.abs(own).max() / n_blend**2 + 4.0 * abs(slope) / n_blend
    assert np.abs(np.diff(filled[:, 0], 2)).max() <= bound + 1e-12


@given(st.integers(2, 12), st.integers(2, 23), st.floats(-1, 1), st.floats(-1, 1))
def test_fade_corrections_between_values_is_a_curve_without_overshoot(n_blend, gap, a, b):
    frames = np.array([30, 30 + gap])
    filled = fade_corrections(frames, np.array([[a], [b]]), 90, n_blend)[30 : 31 + gap, 0]
    assert filled[[0, -1]].tolist() == [a, b]
    assert (np.diff(filled) * np.sign(b - a) >= -1e-15).all()


def test_complete_reaches_adjacent_targets_of_one_hand_are_both_met():
    rng = np.random.default_rng(2)
    reaches = [
        Reach("LeftHand", near_target(MOTION, "LeftHand", (frame, frame), rng), frame)
        for frame in (100, 106)
    ]
    result, found = complete_reaches(MOTION, reaches, limits(), POSES)
    assert all(own.is_moved and own.after < 1e-9 for own in found)
    alone = [complete_reaches(MOTION, [own], limits(), POSES)[0] for own in reaches]
    changed = [changed_frames(MOTION, motion) for motion in alone]
    assert set(changed_frames(MOTION, result)) == set(np.concatenate(changed))


def test_complete_reaches_names_the_reason_for_every_limb_left_alone():
    rng = np.random.default_rng(4)
    target = near_target(MOTION, "LeftHand", (90, 90), rng)
    hand = Reach("LeftHand", target, 90)
    places = MOTION.world_positions()
    head = Reach("Head", tuple(places[90, MOTION.skeleton.index("Head")] + 1.0), 90)
    there = Reach("LeftHand", tuple(places[90, MOTION.skeleton.index("LeftHand")]), 90)
    for reach, own, reason in (
        (head, limits(), "the joint is not part of a hand or foot"),
        (there, limits(), "the donors reach the target"),
        (hand, limits(fixed=["LeftArm"]), "the limb is not exchanged"),
        (hand, limits(fixed=["LeftForeArm"]), "the limb is not exchanged"),
        (hand, limits(kept=[90]), "KeepOriginal keeps these frames"),
    ):
        result, (found,) = complete_reaches(MOTION, [reach], own, POSES)
        assert (found.reason, result is MOTION) == (reason, True)
    other = replace(hand, target=tuple(np.add(target, 1.0)))
    result, found = complete_reaches(MOTION, [hand, other], limits(), POSES)
    assert [own.reason for own in found] == ["", "another Reach moves the limb"]
    assert (
        result.rotations == complete_reaches(MOTION, [hand], limits(), POSES)[0].rotations
    ).all()


@given(SEEDS, st.floats(1.0, 1.3))
@few_examples(10)
def test_complete_reaches_target_beyond_the_arm_straightens_it(seed, share):
    motion = waving(30, seed)
    limb = find_limb(motion.skeleton, motion.skeleton.index("LeftHand"))
    start, end = motion.world_positions()[20, [limb.start, limb.end]]
    length = limb_length(motion, limb)
    target = start + share * length * (end - start) / np.linalg.norm(end - start)
    reach = Reach("LeftHand", tuple(target), 20)
    result, (found,) = complete_reaches(
        motion, [reach], limits(motion, distance=2.0), Poses.from_motion(motion)
    )
    # The limb is extended to all but 1e-4 of its length.
    assert found.after * HEIGHT == pytest.approx((share - 1.0) * length, abs=1.1e-4 * length)
    before, after = (hinge_flexions(own, limb) for own in (motion, result))
    # The documented limit of bending backwards is half of 0.1 rad.
    assert after.min() > -0.05
    # While the correction fades, the limb is straightened in proportion to the weight.
    t = np.minimum(np.abs(np.arange(motion.n_frames) - 20) / N_BLEND, 1.0)
    weights = 1.0 - t * t * (3.0 - 2.0 * t)
    assert (before - after <= weights * (before[20] + 0.1) + 1e-9).all()


def hinge_flexions(motion, limb):
    """The angles by which a hinge is bent in all frames."""
    turns, places = motion.world_transforms()
    points = [places[:, joint] for joint in (limb.start, limb.middle, limb.end)]
    usual = mean_bend_axis(turns[:, limb.start], *points)
    axes = rotations.rotate(turns[:, limb.start], np.tile(usual, (motion.n_frames, 1)))
    return flexion_angles(*points, axes)
