"""Measures of quality: of copies, of motions with known values, and against direct computation."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from lab.donors.donor_methods import RandomLength, grafts_by
from mograft import InsufficientDataError, Library, rotations
from mograft.body.anatomy import feature_joints
from mograft.dancer import dance
from mograft.evaluation.limb_coordination import coordination
from mograft.evaluation.quality import angular_derivatives, diversity, nearest_windows, quality
from tests.evaluation.planted import ByCost, Captured
from tests.strategies import SEEDS, transform_motion


def test_quality_of_copies_equals_recording(library):
    copies = [list(grafts_by(Captured(), library, clip.name, 2)) for clip in library.clips]
    found = quality("same", copies)
    assert found.new_segments.value == 0
    assert found.seam_gap.n == 0
    assert math.isnan(found.seam_gap_p90.value)
    assert found.acceleration.value == found.jerk.value == 1
    assert found.foot_skate.value == found.coordination.value == found.lag.value == 0
    assert found.diversity.value == pytest.approx(0, abs=1e-9)
    assert found.local_diversity.value == pytest.approx(0, abs=1e-6)


def make_grafts(library, method):
    names = [clip.name for clip in library.clips]
    return [list(grafts_by(method, library, name, 3, seed=2)) for name in names]


def test_quality_of_random_grafts_equals_direct_computation(library):
    grafts = make_grafts(library, RandomLength())
    found = quality("x", grafts)
    every = [graft for several in grafts for graft in several]
    substitutions = [s for graft in every for s in graft.substitutions]
    assert found.new_segments.value == pytest.approx(np.mean([not s.is_own for s in substitutions]))
    gaps = np.degrees([seam.gap for graft in every for seam in graft.seams])
    assert found.seam_gap.value == pytest.approx(gaps.mean())
    assert found.seam_gap_p90.value == pytest.approx(np.percentile(gaps, 90))
    assert found.seam_gap_p90.low <= found.seam_gap_p90.value <= found.seam_gap_p90.high
    joints = feature_joints(library.clips[0].skeleton, library.joints("upper"))
    ratios = [
        angular_derivatives(g.motion.rotations[:, joints], library.rate)[0]
        / angular_derivatives(g.base.rotations[:, joints], library.rate)[0]
        for g in every
    ]
    assert found.acceleration.value == pytest.approx(np.mean(ratios))
    assert found.acceleration.n == len(every)
    assert found.foot_skate.value == 0  # the base group contains the legs
    assert found.runs == 3


def test_quality_choice_by_cost_has_smaller_seam_gap_than_random(library):
    random, by_cost = (
        quality("x", make_grafts(library, method)) for method in (RandomLength(), ByCost())
    )
    assert by_cost.seam_gap.value < random.seam_gap.value


@given(st.floats(0.1, 40), st.floats(0.2, 3))
def test_angular_derivatives_constant_acceleration_has_no_jerk(expected, seconds):
    rate = 60.0
    time = np.arange(round(seconds * rate) + 5) / rate
    assume(expected * time[-1] / rate <= 3)  # steps of half a turn are ambiguous
    angles = np.outer(0.5 * expected * time**2, [0.0, 1.0, 0.0])
    acceleration, jerk = angular_derivatives(rotations.exp(angles)[:, None], rate)
    assert acceleration == pytest.approx(expected, rel=1e-6)
    assert jerk == pytest.approx(0, abs=expected * 1e-3)


@given(SEEDS)
def test_nearest_windows_random_tracks_equal_all_pairs(seed):
    rng = np.random.default_rng(seed)
    source = [rng.normal(size=(n, 12)) * 0.6 for n in (14, 9, 25)]
    track = rng.normal(size=(18, 12)) * 0.6
    coverage, local = nearest_windows(source, track)

    def distance(clip, i, j, n):
        return np.linalg.norm(clip[i : i + n] - track[j : j + n], axis=1).mean()

    is_covered, nearest = [], np.full(14, np.inf)
    for clip in source:
        if len(clip) < 10:
            continue
        is_covered += [
            min(distance(clip, i, j, 10) for j in range(9)) < 2.0 for i in range(len(clip) - 9)
        ]
        for j in range(14):
            distances = (distance(clip, i, j, 5) for i in range(len(clip) - 4))
            nearest[j] = min(nearest[j], *distances)
    assert coverage == pytest.approx(np.mean(is_covered))
    assert local == pytest.approx(nearest.mean() / math.sqrt(2))


def test_nearest_windows_copy_is_covered_at_distance_zero():
    track = np.random.default_rng(0).normal(size=(18, 12))
    assert nearest_windows([track], track) == pytest.approx((1.0, 0.0), abs=1e-6)


def test_nearest_windows_short_motion_is_nan():
    track = np.zeros((18, 12))
    assert np.isnan(nearest_windows([track], track[:5])).all()


def test_diversity_known_rotations_is_mean_angle_of_pairs():
    clip = dance(seed=1, strides=1).motion[:50]
    quats = clip.rotations.copy()
    quats[:, 7] = rotations.multiply(quats[:, 7], rotations.exp(np.array([0.0, 0.3, 0.0])))
    other = replace(clip, rotations=quats, channel_values=None)
    assert diversity([clip, other], np.array([7])) == pytest.approx(math.degrees(0.3))
    assert diversity([clip, other, clip], np.array([7])) == pytest.approx(math.degrees(0.2))
    assert math.isnan(diversity([clip], np.array([7])))


def walking_figure(lag=0.0, sign=1.0):
    """Return a figure whose arms follow the sines of the opposite legs after `lag` seconds."""
    clip = dance(seed=1, strides=1).motion[:1]
    time = np.arange(200) / 30
    names = clip.skeleton.names
    quats = np.tile(rotations.IDENTITY, (200, clip.n_joints, 1))
    for side, direction in (("Left", 1.0), ("Right", -1.0)):
        leg = -direction * 0.4 * np.sin(2 * np.pi * time)
        arm = direction * sign * 0.3 * np.sin(2 * np.pi * (time - lag))
        hanging = rotations.exp(np.array([0.0, 0.0, -direction * np.pi / 2]))
        quats[:, names.index(f"{side}UpLeg")] = rotations.exp(leg[:, None] * [1.0, 0, 0])
        quats[:, names.index(f"{side}Arm")] = rotations.multiply(
            rotations.exp(arm[:, None] * [1.0, 0, 0]), hanging
        )
    positions = np.repeat(clip.positions, 200, axis=0)
    return replace(
        clip, frame_time=1 / 30, rotations=quats, positions=positions, channel_values=None
    )


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_coordination_synchronous_limbs_is_one_without_lag(sign):
    correlation, lag = coordination(walking_figure(sign=sign))
    assert correlation > 0.95
    assert lag == 0


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_coordination_delayed_arms_is_lower_with_lag(sign):
    correlation, lag = coordination(walking_figure(lag=4 / 30, sign=sign))
    assert correlation < 0.8
    assert lag == pytest.approx(4 / 30, abs=1 / 30)


def test_coordination_transformed_motion_is_unchanged():
    figure = walking_figure(lag=0.1)
    transformed = transform_motion(figure, 0.02, 1.1, (3.0, 0.0, -5.0))
    assert coordination(transformed) == pytest.approx(coordination(figure), abs=1e-9)


def test_coordination_six_frames_is_nan():
    assert np.isnan(coordination(walking_figure()[:6])).all()


@pytest.mark.parametrize("grafts", [[], [[]]])
def test_quality_without_grafts_raises_insufficient_data_error(grafts):
    with pytest.raises(InsufficientDataError, match="at least one graft"):
        quality("x", grafts)


def test_quality_three_frames_raises_insufficient_data_error(library):
    with pytest.warns(UserWarning, match="too few"):
        short = Library.build(library.clips[0][:3])
    with pytest.raises(InsufficientDataError, match="4 frames"):
        quality("x", [list(grafts_by(Captured(), short))])
