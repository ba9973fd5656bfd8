"""Roots: rigid alignment, blended velocities and the integrated path."""

from dataclasses import replace

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

import mograft as mg
from mograft import Config, Segments
from mograft.blend.rigid_alignment import AlignmentTransform, RootTransforms, joint_track
from mograft.blend.root_motion import blend_root_velocity, integrate_root, yaw_rates
from mograft.blend.seam_treatments import SEAM_TREATMENTS
from mograft.blend.transplant import GraftedGroup, transplant
from mograft.dancer import dance
from mograft.motion import rotations
from tests.oracles import blend as oracle
from tests.strategies import (
    SEEDS,
    SEGMENT_LENGTHS,
    few_examples,
    motions,
    quaternions,
    random_star_clip,
    tile_segments,
    vectors,
)

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


TREATMENTS = st.sampled_from(tuple(SEAM_TREATMENTS))
BLENDS = st.floats(0.02, 1.0)
ROOT = GraftedGroup(np.array([0]), root=0)


def random_velocities(rng, lengths, jumps=1.0):
    """Velocities with small changes within segments and large ones between them."""
    n = int(lengths.sum())
    base = np.repeat(rng.normal(size=(len(lengths), 4)) * jumps, lengths, axis=0)
    return base + 0.1 * np.cumsum(rng.normal(size=(n, 4)), axis=0) / np.sqrt(n)


@given(SEGMENT_LENGTHS, SEEDS, TREATMENTS, BLENDS)
def test_blend_root_velocity_matches_oracle(lengths, seed, seam, blend):
    rng = np.random.default_rng(seed)
    velocities = random_velocities(rng, lengths)
    seams = rng.random(len(lengths) - 1) < 0.7
    config = Config(seam=seam, seam_blend=blend)
    blended = blend_root_velocity(velocities, tile_segments(lengths), seams, config, 30.0)
    expected = oracle.fade_velocities(velocities, lengths, seams, seam, blend * 30.0)
    np.testing.assert_allclose(blended, expected, atol=1e-12)


@few_examples(10)
@given(SEGMENT_LENGTHS, SEEDS, st.sampled_from(sorted({*tuple(SEAM_TREATMENTS)} - {"inertial"})))
def test_transplant_height_of_an_aligned_root_is_that_without_alignment(lengths, seed, seam):
    """Alignment turns and moves donors over the floor; a seam in height is treated as any other.

    The duration of "inertial" depends on the direction of the whole gap.
    """
    rng = np.random.default_rng(seed)
    cut = tile_segments(lengths)
    clips = [random_star_clip(rng, cut), replace(random_star_clip(rng, cut), name="other")]
    order = rng.permutation(len(cut))
    donors = cut[order]
    donors = Segments(donors.start, donors.stop, rng.integers(0, 2, len(cut)))
    cut = tile_segments(lengths[order])
    plain = GraftedGroup(np.array([0]))
    heights = [
        transplant(clips[0], cut, donors, clips, group, Config(seam=seam)).positions[:, 0, 1]
        for group in (ROOT, plain)
    ]
    np.testing.assert_allclose(*heights, rtol=0, atol=1e-9)


@given(SEEDS, st.integers(3, 40))
def test_integrate_root_follows_given_velocities(seed, n):
    """The yaw of the closed motion has no influence."""
    rng = np.random.default_rng(seed)
    up = int(rng.integers(3))
    upright = rotations.from_axis_angle(np.eye(3)[up], rng.uniform(-3, 3, n))
    placed = np.cumsum(rng.normal(size=(n, 3)), axis=0)
    level = np.arange(3) != up
    captured = np.concatenate(
        [level * np.diff(placed, axis=0), yaw_rates(upright, up)[:, None]], axis=1
    )
    target = captured * rng.uniform(-1, 1, (n - 1, 1))
    closed_quats = rotations.multiply(
        rotations.from_axis_angle(np.eye(3)[up], rng.uniform(-1, 1, n)), upright
    )
    heights = rng.normal(size=(n, 3))
    source, closed = RootTransforms(upright, placed), RootTransforms(closed_quats, heights)
    root = integrate_root(target, captured, source, closed, up)
    quats, places = root.rotations, root.positions
    np.testing.assert_allclose(yaw_rates(quats, up), target[:, 3], atol=1e-9)
    np.testing.assert_array_equal(places[:, up], heights[:, up])
    steps = np.linalg.norm(level * np.diff(places, axis=0), axis=1)
    np.testing.assert_allclose(steps, np.linalg.norm(target[:, :3], axis=1), atol=1e-9)
    # Directions relative to the body are kept.
    ways = rotations.rotate(rotations.inverse(quats[:-1]), level * np.diff(places, axis=0))
    np.testing.assert_allclose(
        ways, rotations.rotate(rotations.inverse(upright[:-1]), target[:, :3]), atol=1e-9
    )
