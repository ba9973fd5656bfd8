"""Splice: kept frames, ranges that grow until the motions agree, and the signs of quaternions."""

from dataclasses import replace

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from mograft.blend.recombine import MAX_ANGLE, splice
from mograft.motion import rotations
from tests.strategies import (
    SEEDS,
    assert_same_rotations,
    few_examples,
    random_star_clip,
    tile_segments,
)

HEIGHT = 10.0
ROOT = frozenset({0})


def versions(seed, n_frames=40):
    """Two motions that differ by clear steps or by far less than the limits, and frames asked."""
    rng = np.random.default_rng(seed)
    before = random_star_clip(rng, tile_segments(np.array([n_frames - 1])), moving=(3,))
    is_off = np.repeat(rng.random(n_frames // 4) < 0.4, 4)
    joint = int(rng.integers(1, 4))
    # Just on one side of the limit or just on the other.
    angle = MAX_ANGLE * np.where(is_off, 1.02, 0.98)
    quats, positions = before.rotations.copy(), before.positions.copy()
    if rng.random() < 0.5:
        turn = rotations.from_axis_angle(np.eye(3)[rng.integers(3)], angle)
        quats[:, joint] = rotations.multiply(turn, quats[:, joint])
    else:
        positions[:, 3, rng.integers(3)] += 1e-4 * HEIGHT * np.where(is_off, 1.02, 0.98)
    quats *= rng.choice([-1.0, 1.0], (1, before.n_joints, 1))
    after = replace(before, rotations=quats, positions=positions, name="after", channel_values=None)
    return before, after, is_off, rng.random(n_frames) < rng.choice([0.0, 0.1])


def grow_frame_by_frame(is_new, is_off):
    """Add frames beside a new frame in which the motions differ until there are none (oracle)."""
    grown = is_new.copy()
    while True:
        beside = np.zeros_like(grown)
        beside[1:] |= grown[:-1]
        beside[:-1] |= grown[1:]
        more = grown | (beside & is_off)
        if (more == grown).all():
            return grown
        grown = more


@few_examples(60)
@given(SEEDS)
def test_splice_takes_exactly_frames_up_to_where_motions_agree(seed):
    before, after, is_off, is_new = versions(seed)
    spliced = splice(before, after, is_new, HEIGHT, ())
    assert spliced.name == after.name
    grown = grow_frame_by_frame(is_new, is_off)
    np.testing.assert_array_equal(spliced.rotations[~grown], before.rotations[~grown])
    np.testing.assert_array_equal(spliced.positions[~grown], before.positions[~grown])
    np.testing.assert_array_equal(spliced.channel_numbers()[~grown], before.channel_values[~grown])
    np.testing.assert_array_equal(spliced.positions[grown], after.positions[grown])
    assert_same_rotations(spliced.rotations[grown], after.rotations[grown], 1e-15)
    # Quaternions do not change sign where a range begins.
    for frame in np.flatnonzero(grown[1:] & ~grown[:-1]) + 1:
        assert ((spliced.rotations[frame] * before.rotations[frame]).sum(axis=1) > 0).all()


@few_examples(30)
@given(SEEDS, st.integers(0, 39))
def test_splice_takes_moving_joints_from_first_new_frame_on(seed, first):
    before, after, _, _ = versions(seed)
    shift = np.zeros_like(after.positions)
    shift[:, 0] = [0.3 * HEIGHT, 0.0, 0.0]
    after = replace(after, positions=before.positions + shift, rotations=before.rotations)
    is_new = np.arange(before.n_frames) == first
    spliced = splice(before, after, is_new, HEIGHT, ROOT)
    np.testing.assert_array_equal(spliced.positions[:first], before.positions[:first])
    np.testing.assert_array_equal(spliced.positions[first:, 0], after.positions[first:, 0])
    np.testing.assert_array_equal(spliced.positions[:, 1:], before.positions[:, 1:])
