"""Laws of rest poses: conversion between world and local transforms, and between rest poses."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from mograft.io.rest_pose import RestPose, rebase, restore, to_local
from mograft.motion import rotations
from mograft.motion.motion import forward_kinematics


def random_figure(seed, n_joints, n_frames):
    """Return random parents, and rotations and positions of the joints in some frames."""
    rng = np.random.default_rng(seed)
    parents = np.array([-1, *(int(rng.integers(joint)) for joint in range(1, n_joints))])
    quats = rng.normal(size=(n_frames, n_joints, 4))
    quats /= np.linalg.norm(quats, axis=-1, keepdims=True)
    return parents, quats, rng.normal(size=(n_frames, n_joints, 3))


@given(st.integers(0, 2**32 - 1), st.integers(1, 9), st.integers(0, 5))
def test_to_local_is_the_inverse_of_forward_kinematics(seed, n_joints, n_frames):
    parents, quats, places = random_figure(seed, n_joints, n_frames)
    local, positions = to_local(parents, *forward_kinematics(parents, quats, places))
    np.testing.assert_allclose(local, quats, atol=1e-13)
    np.testing.assert_allclose(positions, places, atol=1e-12)


@given(st.integers(0, 2**32 - 1), st.integers(1, 9), st.integers(1, 5))
def test_restore_of_rebase_returns_the_world_transforms(seed, n_joints, n_frames):
    parents, quats, places = random_figure(seed, n_joints, n_frames + 1)
    names = tuple(f"joint {i}" for i in range(n_joints))
    rest = RestPose(names, parents, quats[-1], places[-1])
    motion = rebase(rest, quats[:-1], places[:-1], 0.1)
    turned, positions = restore(rest, motion)
    same = np.abs(np.einsum("fji,fji->fj", turned, quats[:-1]))
    np.testing.assert_allclose(same, 1.0, atol=1e-12)
    np.testing.assert_allclose(positions, places[:-1], atol=1e-10)


@given(st.integers(0, 2**32 - 1), st.integers(1, 4))
def test_rebase_of_the_rest_pose_has_identity_rotations(seed, n_joints):
    parents, quats, places = random_figure(seed, n_joints, 1)
    rest = RestPose(tuple("abcd"[:n_joints]), parents, quats[0], places[0])
    motion = rebase(rest, quats, places, 0.1)
    identity = np.broadcast_to(rotations.IDENTITY, motion.rotations.shape)
    np.testing.assert_allclose(motion.rotations, identity, atol=1e-13)
    np.testing.assert_allclose(motion.world_positions()[0], places[0], atol=1e-12)
    # Rounding does not give joints position channels.
    assert [len(own) for own in motion.skeleton.channels] == [6, *[3] * (n_joints - 1)]
