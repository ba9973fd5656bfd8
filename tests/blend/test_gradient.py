"""Seam treatment "gradient": what it minimises, and which frames it changes."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from mograft.blend.seams import ROTATIONS, TRANSLATIONS
from mograft.motion import rotations
from mograft.motion.resample import cubic, cubic_positions
from tests.blend.continuity import RATE, random_donors
from tests.strategies import SEEDS, SEGMENT_LENGTHS, few_examples

TAU = 4.0  # frames


def solutions(timeline, space, tracks):
    """Return the values of "offset", from which "gradient" starts, and those of "gradient"."""
    start = replace(timeline, config=replace(timeline.config, seam="offset"))
    return start.close(space, tracks), timeline.close(space, tracks)


def terms(timeline, space, track):
    """Donors' values, velocities and accelerations, frame by frame, in plain loops.

    Lists of (frames, coefficients, target) for values, velocities and accelerations; a frame that
    two donors share has two values of half weight. Beside a seam, half of the difference of the
    accelerations there is added or subtracted, less with each frame.
    """
    cut, donors = timeline.cut, timeline.donors
    values, velocities, accelerations = {}, [], {}
    for k in range(len(cut)):
        length, own = int(cut.lengths[k]), int(donors.lengths[k])
        times = donors.start[k] + np.arange(length + 1) * own / length
        rows = (cubic if space is ROTATIONS else cubic_positions)(
            np.arange(len(track)), track, times
        )
        steps = space.delta(rows[:-1], rows[1:])
        for f in range(length + 1):
            values.setdefault(int(cut.start[k]) + f, []).append(rows[f])
        velocities += list(steps)
        inner = np.diff(steps, axis=0)
        for f in range(1, length):
            accelerations[int(cut.start[k]) + f] = [inner[f - 1]]
        for frame, end in ((cut.start[k], donors.start[k]), (cut.stop[k], donors.stop[k])):
            if len(track) < 3:
                continue
            middle = min(max(int(end), 1), len(track) - 2)
            three = space.delta(track[middle - 1 : middle + 1], track[middle : middle + 2])
            accelerations.setdefault(int(frame), []).append(
                (three[1] - three[0]) * (own / length) ** 2
            )
    for k in np.flatnonzero(timeline.seams).tolist():
        seam = int(cut.stop[k])
        half = 0.5 * np.subtract(*accelerations[seam][::-1])
        for length, side in ((int(cut.lengths[k]), -1), (int(cut.lengths[k + 1]), 1)):
            reach = min(TAU, length)
            for f in range(1, length):
                if f < reach:
                    accelerations[seam + side * f][0] -= side * (1.0 - f / reach) * half
    return values, velocities, accelerations


def objective(timeline, space, track, solved):
    values, velocities, accelerations = terms(timeline, space, track)
    steps = space.delta(solved[:-1], solved[1:])
    total = sum(
        (space.delta(row, solved[f]) ** 2).sum() / len(rows)
        for f, rows in values.items()
        for row in rows
    )
    total += TAU**2 * ((steps - np.array(velocities)) ** 2).sum()
    for f in range(1, len(solved) - 1):
        target = np.mean(accelerations[f], axis=0)
        total += TAU**4 * ((steps[f] - steps[f - 1] - target) ** 2).sum()
    return total


@few_examples(15)
@given(SEGMENT_LENGTHS, SEEDS, st.floats(0.1, 1.0), SEEDS)
def test_gradient_translations_minimise_the_objective(lengths, seed, blend, other):
    """The sum is quadratic: equal on both sides of the minimum, in every direction."""
    timeline, tracks = random_donors(lengths, seed, seam="gradient", seam_blend=blend)
    places = tracks[TRANSLATIONS]
    closed, solved = solutions(timeline, TRANSLATIONS, places)
    changed = (solved != closed).any(axis=2, keepdims=True).any(axis=1, keepdims=True)
    way = np.where(changed, np.random.default_rng(other).normal(size=solved.shape), 0.0)
    before, after = (
        objective(timeline, TRANSLATIONS, places[0], solved + sign * way) for sign in (-1, 1)
    )
    assert after == pytest.approx(before, rel=1e-10)


@few_examples(15)
@given(SEGMENT_LENGTHS, SEEDS, st.floats(0.1, 1.0))
def test_gradient_small_rotations_are_solved_as_translations(lengths, seed, blend):
    timeline, tracks = random_donors(lengths, seed, seam="gradient", seam_blend=blend)
    vectors = 1e-6 * tracks[TRANSLATIONS][0]
    quats = timeline.close(ROTATIONS, [rotations.exp(vectors)])
    positions = timeline.close(TRANSLATIONS, [vectors])
    np.testing.assert_allclose(rotations.log(quats), positions, atol=1e-10)


@few_examples(15)
@given(SEGMENT_LENGTHS, SEEDS)
def test_gradient_rotations_have_smaller_objective_than_offset(lengths, seed):
    """At gaps and speeds of ordinary motion, where one Gauss-Newton step is enough."""
    timeline, tracks = random_donors(lengths, seed, speed=0.05, seam="gradient")
    own = ROTATIONS, tracks[ROTATIONS]
    gaps = timeline.boundaries(*own).gaps()
    assume(np.linalg.norm(gaps, axis=-1).max(initial=0.0) < np.radians(45.0))
    closed, solved = solutions(timeline, *own)
    np.testing.assert_allclose(np.linalg.norm(solved, axis=-1), 1.0, atol=1e-12)
    track = tracks[ROTATIONS][0]
    before, after = (objective(timeline, ROTATIONS, track, q) for q in (closed, solved))
    assert after <= before * (1.0 + 1e-9) + 1e-12


@few_examples(20)
@given(SEGMENT_LENGTHS, SEEDS, st.floats(0.0, 0.5))
def test_gradient_changes_only_moving_joints_near_seams(lengths, seed, blend):
    blend = max(blend, 1e-3)
    timeline, tracks = random_donors(lengths, seed, seam="gradient", seam_blend=blend)
    closed, solved = solutions(timeline, ROTATIONS, tracks[ROTATIONS])
    seams = timeline.cut.stop[:-1][timeline.seams]
    far = np.ones(len(closed), bool)
    for seam in seams:
        far &= np.abs(np.arange(len(closed)) - seam) > blend * RATE
    far[[0, -1]] = True
    np.testing.assert_array_equal(solved[far], closed[far])
    np.testing.assert_array_equal(solved[:, 2], closed[:, 2])


@few_examples(20)
@given(SEGMENT_LENGTHS, SEEDS, st.sampled_from([20.0, 30.0, 60.0, 120.0]))
def test_seam_accelerations_are_second_differences_over_a_thirtieth_of_a_second(
    lengths, seed, rate
):
    timeline, tracks = random_donors(lengths, seed)
    timeline, track = replace(timeline, rate=rate), tracks[TRANSLATIONS][0]
    step = max(1, round(rate / 30.0))
    found = timeline.boundaries(TRANSLATIONS, [track]).accelerations
    for index, seam in enumerate(np.flatnonzero(timeline.seams)):
        for side, segment, end in ((0, seam, "stop"), (1, seam + 1, "start")):
            frame = int(getattr(timeline.donors, end)[segment])
            if not step <= frame < len(track) - step:
                continue
            pace = timeline.donors.lengths[segment] / timeline.cut.lengths[segment]
            three = track[[frame - step, frame, frame + step]]
            wanted = (three[0] - 2.0 * three[1] + three[2]) * (pace / step) ** 2
            np.testing.assert_allclose(found[side, index], wanted, rtol=0, atol=1e-9)
