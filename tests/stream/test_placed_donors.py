"""Donors with neighbouring frames, and the velocities at the ends of placed donors."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from mograft.blend.seams import ROTATIONS
from mograft.motion import rotations
from mograft.motion.resample import clip_states, cubic
from mograft.stream.placed_donors import (
    VELOCITY_STEP,
    PlacedDonors,
    SampledDonors,
    frames_with_neighbours,
)
from tests.strategies import SEEDS, assert_same_rotations, smooth_rotations


@given(SEEDS, st.integers(2, 12))
def test_frames_with_neighbours_give_the_values_and_velocities_of_the_whole_clip(seed, n):
    """Also if the segment starts or ends with the clip."""
    rng = np.random.default_rng(seed)
    clip = smooth_rotations(rng, n, 2)
    start, stop = sorted(rng.choice(n, 2, replace=False).tolist())
    track = frames_with_neighbours(clip, start, stop)
    assert len(track) == stop - start + 3
    np.testing.assert_array_equal(track[1:-1], clip[start : stop + 1])
    times = rng.uniform(0, stop - start, 5)
    assert_same_rotations(
        cubic(np.arange(len(track)), track, 1 + times),
        cubic(np.arange(n), clip, start + times),
        1e-9,
    )
    ends = np.array([0, stop - start])
    _, expected, _ = clip_states([clip], np.zeros(2, int), start + ends)
    before, here, after = (track[ends + 1 + step] for step in (-1, 0, 1))
    velocities = 0.5 * (ROTATIONS.delta(before, here) + ROTATIONS.delta(here, after))
    np.testing.assert_allclose(velocities, expected, atol=1e-9)


@given(SEEDS, st.sampled_from([24.0, 120.0]))
def test_placed_donors_end_velocity_is_the_slope_if_changed_else_that_of_the_donor(seed, rate):
    rng = np.random.default_rng(seed)
    pose, velocity = smooth_rotations(rng, 4, 3), rng.normal(size=(4, 3, 3))
    acceleration = rng.normal(size=(4, 3, 3))
    frames = np.array([-1.0, 0.0, -VELOCITY_STEP, -2 * VELOCITY_STEP])
    seconds = frames[:, None, None, None] / rate
    change = velocity * seconds + 0.5 * acceleration * seconds**2
    values = np.moveaxis(rotations.multiply(pose, rotations.exp(change)), 0, 1)
    donor_velocity, donor_values = rng.normal(size=(4, 3, 3)), values.copy()
    donor_values[:2, 1:] = smooth_rotations(
        rng, 3, 3
    )  # seam treatment changes the first two donors
    sampled = SampledDonors(donor_values, donor_velocity, donor_velocity)
    placed = PlacedDonors(sampled, values, rate)
    np.testing.assert_allclose(placed.end_velocity[:2], velocity[:2], atol=1e-4)
    np.testing.assert_array_equal(placed.end_velocity[2:], donor_velocity[2:])
    for index in range(4):
        selected = placed.select(index)
        np.testing.assert_array_equal(selected.end_velocity[0], placed.end_velocity[index])
        np.testing.assert_array_equal(selected.end_pose[0], pose[index])
