"""Rigid alignment of roots: place, heading, preserved height and lean."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

import mograft as mg
from mograft.blend.rigid_alignment import AlignmentTransform, RootTransforms, joint_track
from mograft.dancer import dance
from mograft.motion import rotations
from tests.strategies import SEEDS, motions, quaternions, vectors

ROOTS = st.builds(RootTransforms, quaternions((5,)), vectors((5,), 200.0))
UPS = st.integers(0, 2)


def headings(turns, up):
    """The twist about the up axis, in radians."""
    return 2 * np.arctan2(turns[:, up], turns[:, 3])


@given(ROOTS, ROOTS, UPS)
def test_alignment_gives_place_and_heading_and_keeps_height_and_lean(own, wanted, up):
    moved = AlignmentTransform.from_roots(own, wanted, up).apply(own)
    level = np.arange(3) != up
    np.testing.assert_allclose(moved.positions[:, level], wanted.positions[:, level], atol=1e-9)
    np.testing.assert_allclose(moved.positions[:, up], own.positions[:, up], atol=1e-9)
    upward = np.eye(3)[up]
    leans = [
        rotations.rotate(rotations.inverse(q), np.tile(upward, (5, 1)))
        for q in (own.rotations, moved.rotations)
    ]
    np.testing.assert_allclose(*leans, atol=1e-9)
    left = rotations.multiply(wanted.rotations, rotations.inverse(moved.rotations))
    # A half turn about a level axis has no heading.
    known = np.hypot(left[:, up], left[:, 3]) > 1e-3
    off = np.angle(np.exp(1j * headings(left, up)))
    np.testing.assert_allclose(off[known], 0.0, atol=1e-6)


@given(motions(max_frames=12), st.data())
def test_root_transforms_match_forward_kinematics_and_return_to_local(motion, data):
    joint = data.draw(st.integers(0, motion.n_joints - 1))
    root = RootTransforms.from_motion(motion, joint)
    turned, placed = (world[:, joint] for world in motion.world_transforms())
    for quats, positions in (joint_track(motion, joint), (root.rotations, root.positions)):
        np.testing.assert_allclose(quats, turned, atol=1e-12)
        np.testing.assert_allclose(positions, placed, atol=1e-12 * (1 + np.abs(placed).max()))
    for found, expected in zip(motion.world_track(joint), (turned, placed), strict=True):
        np.testing.assert_array_equal(found, expected)
    frames = np.array(data.draw(st.lists(st.integers(0, motion.n_frames - 1), max_size=5)), int)
    local = root[frames].relative_to_parent(motion, frames, joint)
    np.testing.assert_allclose(local.rotations, motion.rotations[frames, joint], atol=1e-9)
    np.testing.assert_allclose(local.positions, motion.positions[frames, joint], atol=1e-8)


@settings(max_examples=10)
@given(SEEDS)
def test_apply_to_poses_moves_bodies_rigidly(seed):
    rng = np.random.default_rng(seed)
    motion = dance(strides=1).motion[:6]
    poses, root = mg.Poses.from_motion(motion), RootTransforms.from_motion(motion, 0)
    wanted = RootTransforms(rng.permutation(root.rotations), rng.normal(size=(6, 3)) * 100)
    goes = AlignmentTransform.from_roots(root, wanted, 1)
    moved = goes.apply_to_poses(poses)
    np.testing.assert_allclose(moved.positions[:, 0], goes.apply(root).positions, atol=1e-9)
    np.testing.assert_allclose(moved.rotations[:, 0], goes.apply(root).rotations, atol=1e-9)
    for name in ("positions", "rotations"):
        own = [getattr(some, name) for some in (moved, poses)]
        distances = [
            np.linalg.norm(values[:, :, None] - values[:, None], axis=-1) for values in own
        ]
        np.testing.assert_allclose(*distances, atol=1e-9)
