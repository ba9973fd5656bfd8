"""Properties of zero-moment shifts, support margins and added imbalances."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mograft import Config, Segments
from mograft.analysis.embedding import normalise
from mograft.analysis.zero_moment import (
    N_DIRECTIONS,
    ZeroMomentTrack,
    added_imbalances,
    mass_offsets,
    support_margins,
    zero_moment_operators,
)
from mograft.body.contacts import Ground
from mograft.body.mass import center_of_mass, mass_model
from mograft.body.support_polygon import support_polygons
from mograft.dancer import dance
from mograft.evaluation.balance import dynamic_balance
from mograft.motion import rotations
from tests.hierarchies import with_joint_above_root
from tests.oracles import balance as balance_oracle
from tests.oracles import search as oracle
from tests.strategies import SEEDS, few_examples, turn_motion
from tests.strategies import transform_motion as move

SHIFT = (100.0, 0.0, -30.0)
CAPTURED = Config(keep_heading=True)
CUT = Segments(np.array([0, 45, 90]), np.array([45, 90, 180]))
ANGLES = 2.0 * np.pi * np.arange(N_DIRECTIONS) / N_DIRECTIONS
AXES = np.stack([np.cos(ANGLES), np.sin(ANGLES)], axis=1)


@few_examples(20)
@given(SEEDS, st.floats(0.1, 2.0))
def test_zero_moment_operators_match_quadrature(seed, seconds):
    base, donors = 0.01 * np.random.default_rng(seed).normal(size=(2, 3, 10, 2))
    expected = [oracle.zero_moment_shift(*pair, seconds) for pair in zip(base, donors, strict=True)]
    found = balance_oracle.zero_moment_shifts(base, donors, np.full(3, seconds))
    np.testing.assert_allclose(found, expected, atol=1e-3 * np.abs(expected).max())


def margins_of(motion, config=CAPTURED):
    track = ZeroMomentTrack.of(motion, CUT, Ground.of(motion), config, root=0, up=1)
    return support_margins(motion, CUT, track, config, up=1)


def test_support_margins_are_distances_of_one_point_to_the_support_polygon(motion):
    margins, support = margins_of(motion).reshape(-1, N_DIRECTIONS), support_polygons(motion)
    frames = np.rint(CUT.start[:, None] + CUT.lengths[:, None] * np.linspace(0, 1, 10))
    frames = frames.ravel().astype(int)
    quarter = N_DIRECTIONS // 4
    for margin, frame in zip(margins, frames, strict=True):
        polygon = support.polygons[frame][: support.sizes[frame], ::-1]  # x, z
        if not np.isfinite(margin).all():
            continue
        extents = (polygon @ AXES.T).max(axis=0) / support.height
        # The zero-moment point of the base, from the margins along both axes.
        base = extents[[0, quarter]] - margin[[0, quarter]]
        np.testing.assert_allclose(extents - AXES @ base, margin, atol=1e-9)
    assert support.axes == (2, 0)


@given(st.floats(-3.0, 3.0))
def test_margins_and_offsets_do_not_depend_on_position_and_heading(motion, angle):
    joints, moved = np.arange(5, motion.n_joints), move(motion, yaw=angle, offset=SHIFT)
    margins, expected = margins_of(moved, Config()), margins_of(motion, Config())
    np.testing.assert_allclose(margins, expected, atol=1e-9)
    offsets, expected = sampled_offsets(moved, joints), sampled_offsets(motion, joints)
    np.testing.assert_allclose(offsets, expected, atol=1e-9)


@given(st.sampled_from([(0, 2), (2, 2), (0, 1), (0, -1), (2, 1), (2, -1)]))
def test_zero_moment_points_of_rotated_world_are_rotated(motion, turn):
    """Each axis, positive and negative, points up in one of the rotated worlds."""
    axis, quarters = turn
    world = rotations.exp(0.5 * np.pi * quarters * np.eye(3)[axis])
    other = turn_motion(motion, world)
    ground, turned = Ground.of(motion), Ground.of(other)
    np.testing.assert_allclose(turned.up, rotations.rotate(world, ground.up), atol=1e-12)
    up = int(np.abs(turned.up).argmax())
    expected = ZeroMomentTrack.of(motion, CUT, ground, CAPTURED, root=0, up=1)
    found = ZeroMomentTrack.of(other, CUT, turned, CAPTURED, root=0, up=up)
    np.testing.assert_array_equal(found.is_loaded, expected.is_loaded)
    np.testing.assert_allclose(found.points, rotations.rotate(world, expected.points), atol=1e-9)
    distances = [dynamic_balance(own).distance for own in (motion, other)]
    np.testing.assert_allclose(distances[1], distances[0], atol=1e-9)


def test_support_margins_are_infinite_in_flight(motion):
    ground = Ground.of(motion)
    lifted = replace(motion, positions=motion.positions + np.array([0.0, ground.height, 0.0]))
    track = ZeroMomentTrack.of(lifted, CUT, ground, Config(), root=0, up=1)
    margins = support_margins(lifted, CUT, track, Config(), up=1)
    assert (margins == np.inf).all()


@given(SEEDS, st.integers(2, 12), st.lists(st.integers(0, 20), max_size=6), st.floats(0.0, 0.2))
def test_added_imbalances_match_those_of_numpy(seed, n_samples, counts, size):
    rng = np.random.default_rng(seed)
    offsets = size * rng.normal(size=(9, n_samples, 2))
    margins = rng.normal(0.05, 0.05, (len(counts), n_samples, N_DIRECTIONS))
    margins[rng.random(margins.shape[:2]) < 0.2] = np.inf
    bases, donors = rng.integers(0, 9, len(counts)), rng.integers(0, 9, sum(counts))
    seconds, rows = rng.uniform(0.05, 3.0, len(counts)), np.repeat(np.arange(len(counts)), counts)
    operators = zero_moment_operators(n_samples, seconds)
    found = added_imbalances(offsets, (bases, operators, margins), donors, np.array(counts, int))
    tracks = offsets[bases[rows]], offsets[donors]
    shifts = balance_oracle.zero_moment_shifts(*tracks, seconds[rows])
    expected = balance_oracle.added_imbalances(shifts, margins, rows)
    np.testing.assert_allclose(found, expected, atol=1e-11)
    assert (found[bases[rows] == donors] == 0.0).all()


@pytest.fixture(scope="module")
def motion():
    return dance(strides=1).motion[:200]


def sampled_offsets(motion, joints, root=0):
    heights = [mass_model(motion.skeleton).height]
    samples = normalise([motion], CUT, Config(), root=root, up=1, heights=heights)
    return mass_offsets(samples, motion.skeleton, joints, root, 1)


def test_mass_offsets_add_up_to_those_of_the_center_of_mass(motion):
    joints = np.arange(motion.n_joints)
    offsets = sampled_offsets(motion, joints)
    parts = [sampled_offsets(motion, part) for part in (joints[:7], joints[7:])]
    np.testing.assert_allclose(sum(parts), offsets, atol=1e-12)
    height = mass_model(motion.skeleton).height
    center = (center_of_mass(motion) - motion.world_positions()[:, 0]) / height
    for start, stop, found in zip(CUT.start, CUT.stop, offsets, strict=True):
        turn = rotations.inverse(rotations.twist(motion.rotations[start : start + 1, 0], 1))
        frames = np.arange(start, stop + 1, (stop - start) // 9)
        expected = rotations.rotate(turn, center[frames])[:, [0, 2]]
        np.testing.assert_allclose(found, expected, atol=1e-9)


def test_mass_offsets_do_not_depend_on_a_joint_above_the_root(motion):
    below = with_joint_above_root(motion, 0.0)
    offsets, quats = below.skeleton.offsets.copy(), below.rotations.copy()
    offsets[1] = [7.0, 0.0, 3.0]
    angles = np.linspace(0.0, 2.0, motion.n_frames)
    quats[:, 0] = rotations.from_axis_angle([1.0, 0.0, 0.0], angles)
    quats[:, 1] = rotations.multiply(rotations.inverse(quats[:, 0]), quats[:, 1])
    positions = np.broadcast_to(offsets, below.positions.shape)
    skeleton = below.skeleton.with_offsets(offsets)
    below = replace(below, skeleton=skeleton, rotations=quats, positions=positions)
    joints = np.arange(5, motion.n_joints)
    expected = sampled_offsets(motion, joints)
    np.testing.assert_allclose(sampled_offsets(below, joints + 1, root=1), expected, atol=1e-9)
