"""``torso="balanced"``: a grafted trunk responds to the sway of the pelvis below it."""

from dataclasses import replace

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from mograft import Config
from mograft.blend.recombine import recombine
from mograft.blend.transplant import GraftedGroup, transplant
from mograft.motion import rotations
from mograft.motion.motion import Motion
from tests.hierarchies import human
from tests.strategies import (
    SEEDS,
    assert_same_rotations,
    few_examples,
    person,
    tile_segments,
    transform_motion,
)

UPPER = GraftedGroup(np.arange(7, 18))  # the chest and all joints below it
CHEST, HEAD = 7, 17
RATE, N_FRAMES = 60.0, 121
# Sway is what a Gaussian of 0.1 s removes. It keeps 4 % of an oscillation of 4 Hz: with shares up
# to 0.9 in two motions, less than 0.08 of the sway remains, and errors near the ends of the clip.
FREQUENCIES = st.floats(4.0, 7.0)
SHARES = st.floats(-0.9, 0.9)


def swaying(frequency, share, axis=0, phase=0.0):
    """A human whose pelvis sways along a horizontal axis; the chest moves the head against it.

    The head moves, relative to the pelvis, by -`share` times the sway.
    """
    skeleton = human()
    seconds = np.arange(N_FRAMES) / RATE
    sway = 0.02 * np.sin(2 * np.pi * frequency * seconds + phase)
    positions = np.tile(skeleton.offsets, (N_FRAMES, 1, 1))
    height = rest_height(skeleton)
    positions[:, 0, axis] += sway * height
    quats = np.tile(rotations.IDENTITY, (N_FRAMES, skeleton.n_joints, 1))
    turn = np.zeros((N_FRAMES, 3))
    turn[:, 2 - axis] = np.arcsin(share * sway) * (1 if axis == 0 else -1)
    quats[:, CHEST] = rotations.exp(turn)
    return Motion(skeleton, 1 / RATE, quats, positions, name=f"{frequency} {axis}")


def rest_height(skeleton):
    """Height of the head above the chest at rest."""
    places = skeleton.rest_positions()
    return places[HEAD, 1] - places[CHEST, 1]


def graft_upper(base, donor, torso):
    cut = tile_segments(np.array([base.n_frames - 1]))
    part = transplant(base, cut, cut, [donor], UPPER, Config(torso=torso))
    return recombine(base, [part], torso)


def head_sway(motion):
    """Horizontal positions of the head without their mean, away from the ends of the clip."""
    path = motion.world_transforms()[1][20:-20, HEAD][:, [0, 2]]
    return path - path.mean(axis=0)


@few_examples(7)
@given(FREQUENCIES, FREQUENCIES, SHARES, SHARES, st.sampled_from([0, 2]), st.floats(0, 6))
def test_balanced_trunk_responds_to_pelvis_of_base_as_trunk_of_base(
    own, other, base_share, donor_share, axis, phase
):
    """The donor's response to its own pelvis is gone, that of the base has taken its place."""
    base, donor = swaying(own, base_share, axis), swaying(other, donor_share, axis, phase)
    found, expected = head_sway(graft_upper(base, donor, "balanced")), head_sway(base)
    scale = 0.02 * rest_height(base.skeleton)
    assert np.abs(found - expected).max() < 0.12 * scale


def test_balanced_trunk_sways_less_than_one_that_keeps_only_its_lean():
    base, donor = swaying(4.0, 0.9), swaying(5.3, 0.9, phase=1.0)
    balanced, leaning = (head_sway(graft_upper(base, donor, t)) for t in ("balanced", "world"))
    assert balanced.std() < 0.2 * leaning.std()


@few_examples(7)
@given(SEEDS, SEEDS, FREQUENCIES)
def test_balanced_equals_world_without_sway(a, b, frequency):
    """Without sway, or without a response to it, there is nothing to balance."""
    base, donor = person(a), person(b)
    new, world = (graft_upper(base, donor, t).rotations for t in ("balanced", "world"))
    np.testing.assert_array_equal(new, world)
    base, donor = swaying(frequency, 0.0), swaying(5.0, 0.0)
    assert_same_rotations(*(graft_upper(base, donor, t).rotations for t in ("balanced", "world")))


@few_examples(7)
@given(SEEDS, SEEDS, st.floats(-3, 3), st.floats(-50, 50))
def test_balanced_is_independent_of_place_and_heading_of_donor(a, b, yaw, shift):
    base, donor = (with_walk(person(seed), seed) for seed in (a, b))
    other = transform_motion(donor, yaw=yaw, offset=(shift, 0.0, -shift))
    found = (graft_upper(base, one, "balanced").rotations for one in (donor, other))
    assert_same_rotations(*found, 1e-9)


def with_walk(motion, seed):
    """The same motion with random root positions."""
    positions = motion.positions.copy()
    positions[:, 0] += np.random.default_rng(seed).normal(size=(motion.n_frames, 3)).cumsum(0)
    return replace(motion, positions=positions, channel_values=None)


@given(st.integers(2, 6), SEEDS)
def test_balanced_is_finite_on_short_clips(n_frames, seed):
    base, donor = person(seed, n_frames), with_walk(person(seed + 1, n_frames), seed)
    assert np.isfinite(graft_upper(base, donor, "balanced").rotations).all()
