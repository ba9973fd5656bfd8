"""Measures of quality: what a copy scores, what can be computed by hand, plain versions."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mograft import InsufficientDataError, Library
from mograft.body.anatomy import feature_joints
from mograft.dancer import dance
from mograft.evaluation.baselines import ByCost, Captured, RandomLength, grafts_by
from mograft.evaluation.quality import (
    angular_derivatives,
    coordination,
    diversity,
    nearest_windows,
    quality,
)
from mograft.motion import rotations
from tests.evaluation.test_balance import moved
from tests.strategies import SEEDS


@pytest.fixture(scope="module")
def library():
    return Library.build([take.motion for take in dance(seed=6, strides=1).takes(2)])


def test_a_copy_differs_in_nothing(library):
    copies = [list(grafts_by(Captured(), library, clip.name, 2)) for clip in library.clips]
    own = quality("same", copies)
    assert own.new_segments.value == 0
    assert own.seam_gap.n == 0
    assert math.isnan(own.seam_gap_p90.value)
    assert own.acceleration.value == own.jerk.value == 1
    assert own.foot_skate.value == own.coordination.value == own.lag.value == 0
    assert own.diversity.value == pytest.approx(0, abs=1e-9)
    assert own.local_diversity.value == pytest.approx(0, abs=1e-6)


def test_measures_are_those_of_the_grafts(library):
    names = [clip.name for clip in library.clips]
    made = [list(grafts_by(RandomLength(), library, name, 3, seed=2)) for name in names]
    own = quality("x", made)
    every = [graft for several in made for graft in several]
    parts = [s for graft in every for s in graft.substitutions]
    assert own.new_segments.value == pytest.approx(np.mean([not s.is_own for s in parts]))
    gaps = np.degrees([seam.gap for graft in every for seam in graft.seams])
    assert own.seam_gap.value == pytest.approx(gaps.mean())
    assert own.seam_gap_p90.value == pytest.approx(np.percentile(gaps, 90))
    assert own.seam_gap_p90.low <= own.seam_gap_p90.value <= own.seam_gap_p90.high
    joints = feature_joints(library.clips[0].skeleton, library.joints("upper"))
    ratios = [
        angular_derivatives(g.motion.rotations[:, joints], library.rate)[0]
        / angular_derivatives(g.base.rotations[:, joints], library.rate)[0]
        for g in every
    ]
    assert own.acceleration.value == pytest.approx(np.mean(ratios))
    assert own.acceleration.n == len(every)
    assert own.foot_skate.value == 0  # the base keeps the legs
    assert own.runs == 3
    chosen = quality("y", [list(grafts_by(ByCost(), library, name, 3, seed=2)) for name in names])
    assert chosen.seam_gap.value < own.seam_gap.value


@given(st.floats(0.1, 40), st.floats(0.2, 3))
def test_a_joint_that_speeds_up_evenly_has_that_acceleration_and_no_jerk(bend, seconds):
    rate = 60.0
    time = np.arange(round(seconds * rate) + 5) / rate
    turned = np.outer(0.5 * bend * time**2, [0.0, 1.0, 0.0])
    if bend * time[-1] / rate > 3:  # a step of half a turn has no one way
        return
    acceleration, jerk = angular_derivatives(rotations.exp(turned)[:, None], rate)
    assert acceleration == pytest.approx(bend, rel=1e-6)
    assert jerk == pytest.approx(0, abs=bend * 1e-3)


@given(SEEDS)
def test_nearest_windows_are_those_of_all_pairs(seed):
    rng = np.random.default_rng(seed)
    source = [rng.normal(size=(n, 12)) * 0.6 for n in (14, 9, 25)]
    made = rng.normal(size=(18, 12)) * 0.6
    covered, local = nearest_windows(source, made)

    def distance(a, b, i, j, n):
        return np.linalg.norm(a[i : i + n] - b[j : j + n], axis=1).mean()

    near, best = [], np.full(14, np.inf)
    for own in source:
        if len(own) < 10:
            continue
        near += [
            min(distance(own, made, i, j, 10) for j in range(9)) < 2.0 for i in range(len(own) - 9)
        ]
        for j in range(14):
            best[j] = min(best[j], *(distance(own, made, i, j, 5) for i in range(len(own) - 4)))
    assert covered == pytest.approx(np.mean(near))
    assert local == pytest.approx(best.mean() / math.sqrt(2))
    assert nearest_windows([made], made) == pytest.approx((1.0, 0.0), abs=1e-6)
    assert math.isnan(nearest_windows(source, made[:5])[0])


def test_diversity_is_the_mean_angle_of_pairs():
    clip = dance(seed=1, strides=1).motion[:50]
    turned = clip.rotations.copy()
    turned[:, 7] = rotations.multiply(turned[:, 7], rotations.exp(np.array([0.0, 0.3, 0.0])))
    other = replace(clip, rotations=turned, channel_values=None)
    assert diversity([clip, other], np.array([7])) == pytest.approx(math.degrees(0.3))
    assert diversity([clip, other, clip], np.array([7])) == pytest.approx(math.degrees(0.2))
    assert math.isnan(diversity([clip], np.array([7])))


def walking(lag=0.0, flip=1.0):
    """A figure whose arms and opposite legs swing by sines, the arms some seconds later."""
    clip = dance(seed=1, strides=1).motion[:1]
    time = np.arange(200) / 30
    quats = np.repeat(clip.rotations, 200, axis=0)
    names = clip.skeleton.names
    quats[:] = rotations.IDENTITY
    for side, sign in (("Left", 1.0), ("Right", -1.0)):
        leg = -sign * 0.4 * np.sin(2 * np.pi * time)
        arm = sign * flip * 0.3 * np.sin(2 * np.pi * (time - lag))
        hang = rotations.exp(np.array([0.0, 0.0, -sign * np.pi / 2]))
        quats[:, names.index(f"{side}UpLeg")] = rotations.exp(leg[:, None] * [1.0, 0, 0])
        quats[:, names.index(f"{side}Arm")] = rotations.multiply(
            rotations.exp(arm[:, None] * [1.0, 0, 0]), hang
        )
    places = np.repeat(clip.positions, 200, axis=0)
    return replace(clip, frame_time=1 / 30, rotations=quats, positions=places, channel_values=None)


@pytest.mark.parametrize("flip", [1.0, -1.0])
def test_arms_that_swing_with_the_legs_are_coordinated(flip):
    together, lag = coordination(walking(flip=flip))
    assert together > 0.95
    assert lag == 0
    late, by = coordination(walking(lag=4 / 30, flip=flip))
    assert late < 0.8
    assert by == pytest.approx(4 / 30, abs=1 / 30)


def test_coordination_knows_no_scale_heading_or_place():
    one = coordination(walking(lag=0.1))
    two = coordination(moved(walking(lag=0.1), 0.02, 1.1, (3.0, 0.0, -5.0)))
    assert two == pytest.approx(one, abs=1e-9)
    assert all(math.isnan(v) for v in coordination(walking()[:6]))


def test_nothing_to_measure_is_refused(library):
    with pytest.raises(InsufficientDataError, match="at least one graft"):
        quality("x", [])
    with pytest.raises(InsufficientDataError, match="at least one graft"):
        quality("x", [[]])
    with pytest.warns(UserWarning, match="too few"):
        short = Library.build(library.clips[0][:3])
    with pytest.raises(InsufficientDataError, match="4 frames"):
        quality("x", [list(grafts_by(Captured(), short))])
