"""Laws of `Hinges.keep`: axes, limits, what stays, continuity."""

from dataclasses import replace

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from mograft import Motion
from mograft.io.robots.poses import Pose, to_motion
from mograft.motion import rotations
from mograft.motion.hinges import Hinges, TableLayout
from mograft.motion.skeleton import Skeleton
from tests.io.robot_files import smooth_angles
from tests.strategies import SEEDS, few_examples, smooth_rotations

RATE = 30.0


def skeleton_of(parents, offsets, joints, axes, limits):
    """A skeleton with hinges of any speed at some joints; the other ones are fixed."""
    n, n_joints = len(joints), len(parents)
    hinges = Hinges(
        tuple(f"h{joint}" for joint in joints),
        np.asarray(joints),
        axes,
        limits=limits,
        speeds=np.full(n, 1e9),
        bodies=np.array([0, *joints]),
        frames=np.tile(rotations.IDENTITY, (n_joints, 1)),
        origins=np.zeros((n_joints, 3)),
        centers=np.zeros((n_joints, 3)),
        masses=np.ones(n_joints),
    )
    return Skeleton([f"b{j}" for j in range(n_joints)], parents, offsets, hinges=hinges)


def random_skeleton(rng, n_joints=7):
    """A skeleton with hinges at random axes; some joints are fixed."""
    parents = np.array([-1, *(int(rng.integers(joint)) for joint in range(1, n_joints))])
    is_hinge = rng.random(n_joints) < 0.8
    is_hinge[[0, 1]] = False, True
    joints = np.flatnonzero(is_hinge)
    n = len(joints)
    axes = rng.normal(size=(n, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    limits = np.stack([rng.uniform(-2.0, -1.0, n), rng.uniform(0.0, 1.0, n)], axis=1)
    return skeleton_of(parents, rng.uniform(-0.3, 0.3, (n_joints, 3)), joints, axes, limits)


def motion_on_hinges(skeleton, rng, n_frames, share=0.8):
    angles = smooth_angles(skeleton.hinges, rng, n_frames, share)
    root = np.tile(rotations.IDENTITY, (n_frames, 1))
    return to_motion(skeleton, Pose(np.zeros((n_frames, 3)), root, angles), TableLayout())


def kept(skeleton, quats, reference, is_moved):
    return skeleton.hinges.keep(skeleton.parents, quats, reference, is_moved, RATE)


def off_axis(hinges, quats):
    """The largest angle of rotations from a rotation about their hinge."""
    own = quats[:, hinges.joints]
    along = (own[..., :3] * hinges.axes).sum(axis=-1, keepdims=True) * hinges.axes
    return 2 * np.arcsin(np.minimum(np.linalg.norm(own[..., :3] - along, axis=-1), 1)).max()


def assert_within_limits(hinges, quats, reference, rate=RATE, atol=1e-9):
    """Hinges turn about their axes; angles and speeds exceed limits at most as the reference."""
    assert off_axis(hinges, quats) <= 1e-9
    angles, known = hinges.angles(quats), hinges.angles(reference)
    low, high = hinges.limits.T
    assert (angles >= np.minimum(low, known.min(axis=0)) - atol).all()
    assert (angles <= np.maximum(high, known.max(axis=0)) + atol).all()
    steps, most = (np.abs(np.diff(own, axis=0)).max(axis=0, initial=0) for own in (angles, known))
    assert (steps <= np.maximum(hinges.speeds / rate, most) + 1e-9).all()


@few_examples(40)
@given(seed=SEEDS, n_frames=st.integers(1, 60))
def test_hinges_keep_random_rotations_turn_about_axes_within_limits(seed, n_frames):
    rng = np.random.default_rng(seed)
    skeleton = random_skeleton(rng)
    hinges = skeleton.hinges
    base = motion_on_hinges(skeleton, rng, n_frames, share=1.2)
    is_moved = rng.random(skeleton.n_joints) < 0.6
    quats = base.rotations.copy()
    turned = smooth_rotations(rng, n_frames, skeleton.n_joints)
    quats[:, is_moved] = turned[:, is_moved]
    result = kept(skeleton, quats, base.rotations, is_moved)
    fixed = np.setdiff1d(np.flatnonzero(is_moved), [0, *hinges.joints])
    np.testing.assert_array_equal(result[:, fixed, :3], 0)
    np.testing.assert_array_equal(result[:, ~is_moved], quats[:, ~is_moved])
    np.testing.assert_array_equal(result[:, 0], quats[:, 0])
    assert_within_limits(hinges, result, base.rotations, atol=1e-12)


@few_examples(30)
@given(seed=SEEDS)
def test_hinges_keep_motion_on_hinges_is_unchanged_bit_for_bit(seed):
    rng = np.random.default_rng(seed)
    skeleton = random_skeleton(rng)
    speeds = rng.choice([1e-3, 1e9], len(skeleton.hinges.names))  # exceeded by all
    skeleton = replace(skeleton, hinges=replace(skeleton.hinges, speeds=speeds))
    base = motion_on_hinges(skeleton, rng, 20)
    result = kept(skeleton, base.rotations, base.rotations, np.ones(skeleton.n_joints, bool))
    np.testing.assert_array_equal(result, base.rotations)


@few_examples(25)
@given(seed=SEEDS, amount=st.floats(0.1, 0.9), kind=st.sampled_from(["angle", "speed"]))
def test_hinges_keep_limits_without_jumps_and_far_frames_stay(seed, amount, kind):
    """At a high frame rate, a jump of velocity or speed would be far larger than the bound."""
    rate, n_frames = 2000.0, 4000
    skeleton = random_skeleton(np.random.default_rng(seed))
    hinges, n = skeleton.hinges, len(skeleton.hinges.names)
    time = np.arange(n_frames)[:, None] / rate - 1.0
    if kind == "angle":
        angles = hinges.limits[:, 1] - 0.5 + (0.5 + amount) * np.exp(-((time / 0.3) ** 2))
        jump, reach = 7 * amount / (0.1 * rate) ** 2, 0.3 * np.sqrt(np.log(1 + 2 * amount)) + 0.21
    else:
        limit, angles = 10.0 * amount, np.tanh(time / 0.1) * np.ones(n)
        hinges = replace(hinges, limits=np.tile([-3.0, 3.0], (n, 1)), speeds=np.full(n, limit))
        jump, reach = 2e-2 * limit / rate, 1.0 / limit + 0.6
    still = np.tile(rotations.IDENTITY, (n_frames, skeleton.n_joints, 1))
    quats = still.copy()
    quats[:, hinges.joints] = hinges.rotations(angles)
    moved = np.ones(skeleton.n_joints, bool)
    result = hinges.angles(hinges.keep(skeleton.parents, quats, still, moved, rate))
    assert (result <= hinges.limits[:, 1] + 1e-12).all()
    assert (np.abs(np.diff(result, axis=0)) * rate <= hinges.speeds * (1 + 1e-6)).all()
    before, after = (np.abs(np.diff(own, 2, axis=0)).max() for own in (angles, result))
    assert after <= before + jump
    is_far = np.abs(time[:, 0]) > reach
    np.testing.assert_allclose(result[is_far], angles[is_far], atol=1e-9)


@few_examples(30)
@given(seed=SEEDS, share=st.floats(0.1, 1.0), is_fast=st.booleans())
def test_hinges_keep_speeds_stay_within_limits_or_those_of_the_base(seed, share, is_fast):
    rng, n_frames = np.random.default_rng(seed), 80
    skeleton = random_skeleton(rng)
    base = motion_on_hinges(skeleton, rng, n_frames)
    given_angles = skeleton.hinges.angles(base.rotations)
    quats = base.rotations.copy()
    turned = smooth_rotations(rng, n_frames, skeleton.n_joints)
    quats[:, 1:] = turned[:, 1:]
    everything = np.ones(skeleton.n_joints, bool)
    free = skeleton.hinges.angles(kept(skeleton, quats, base.rotations, everything))
    fastest = np.abs(np.diff(np.concatenate([free, given_angles]), axis=0)).max(axis=0) * RATE
    hinges = replace(skeleton.hinges, speeds=share * fastest)
    limited = replace(skeleton, hinges=hinges)
    if is_fast:
        base = replace(base, skeleton=limited)
    else:
        base = Motion(limited, base.frame_time, base.rotations[[0] * n_frames], base.positions)
    result = kept(limited, quats, base.rotations, everything)
    assert_within_limits(hinges, result, base.rotations)


@few_examples(30)
@given(seed=SEEDS, size=st.floats(0.01, 0.3))
def test_hinges_keep_three_hinges_follow_a_rotation(seed, size):
    """Yaw, roll and pitch of a waist take over a rotation of the first joint, to second order."""
    rng = np.random.default_rng(seed)
    n, axes, limits = 4, np.eye(3)[[2, 0, 1]], np.tile([-3.0, 3.0], (3, 1))
    skeleton = skeleton_of(np.arange(-1, 3), np.zeros((n, 3)), [1, 2, 3], axes, limits)
    quats = np.tile(rotations.IDENTITY, (5, n, 1))
    axis = rng.normal(size=3)
    wanted = rotations.from_axis_angle(axis, size)
    turned = quats.copy()
    turned[:, 1] = wanted
    result = kept(skeleton, turned, quats, np.ones(n, bool))
    end = Motion(skeleton, 1.0, result, np.zeros((5, n, 3))).world_transforms()[0][:, -1]
    assert rotations.angle(end, wanted).max() <= size**2


@few_examples(30)
@given(seed=SEEDS, rate=st.floats(5, 200))
def test_resample_robot_keeps_hinges_and_limits(seed, rate):
    rng = np.random.default_rng(seed)
    skeleton = random_skeleton(rng)
    base = motion_on_hinges(skeleton, rng, 30, share=1.1)
    new = base.resample(rate).rotations
    assert_within_limits(skeleton.hinges, new, base.rotations, rate, 1e-12)


@few_examples(30)
@given(seed=SEEDS)
def test_hinges_angles_of_rotations_are_the_angles(seed):
    rng = np.random.default_rng(seed)
    hinges = random_skeleton(rng).hinges
    angles = rng.uniform(*hinges.limits.T, (10, len(hinges.names)))
    quats = np.zeros((10, 7, 4))
    quats[:, hinges.joints] = hinges.rotations(angles) * rng.choice([-1, 1], (10, 1, 1))
    np.testing.assert_allclose(hinges.angles(quats), angles, atol=1e-14)
    # Without limits, angles continue beyond a full turn.
    free = replace(hinges, limits=np.tile([-1e9, 1e9], (len(hinges.names), 1)))
    angles = np.linspace(0.0, 12.0, 60)[:, None] * np.ones(len(hinges.names))
    quats = np.zeros((60, 7, 4))
    quats[:, hinges.joints] = free.rotations(angles)
    np.testing.assert_allclose(free.angles(quats), angles, atol=1e-12)
