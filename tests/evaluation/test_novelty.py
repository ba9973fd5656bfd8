"""Novelty, coverage, diversity and quality: of copies, of known values, and against all pairs."""

import math
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from lab.donors.methods import ByCost, Captured
from mograft import InsufficientDataError, Library, rotations
from mograft.body.anatomy import feature_joints
from mograft.evaluation import RandomLength, grafts_by
from mograft.evaluation.body_tracks import BodyTracks
from mograft.evaluation.novelty import body_windows, captured_windows, novelty
from mograft.evaluation.quality import angular_derivatives, quality
from tests.evaluation.planted import copy_base, grafts_of_clips


def test_novelty_of_captured_motion_is_none(library):
    found = novelty(grafts_of_clips(library, Captured(), 1))
    assert (found.changed.value, found.coverage.value) == (0, 0)
    assert (found.novelty.n, found.between.n) == (0, 0)


def test_novelty_library_with_every_motion_twice_has_no_relative_measure(library):
    clip = library.clips[0]
    twice = Library.build([clip, replace(clip, name="again")])
    found = novelty(grafts_of_clips(twice, RandomLength(), 2))
    assert found.changed.value > 0
    assert math.isnan(found.novelty.value)
    assert math.isnan(found.coverage.value)


def test_novelty_copies_of_another_base_have_distance_zero(library):
    other = library.clips[1]
    graft = grafts_of_clips(library, RandomLength(), 1)[0][0]
    n = min(graft.motion.n_frames, other.n_frames)
    # A graft that equals other captured frames is changed, but not new.
    swapped = replace(graft, motion=other[:n], base=graft.base[:n])
    found = novelty([[swapped]])
    assert found.changed.value > 0.9
    assert found.novelty.value == pytest.approx(0, abs=1e-5)
    assert found.coverage.value > 0.3


def test_novelty_equal_grafts_have_no_difference(library):
    graft = grafts_of_clips(library, ByCost(), 1)[0][0]
    found = novelty([[graft, graft, copy_base(graft)]])
    windows = [body_windows(BodyTracks.of(motion))[0] for motion in (graft.motion, graft.base)]
    distance = np.linalg.norm(windows[0] - windows[1], axis=1).mean()
    spread = captured_windows(library, 0).spread
    assert found.between.value == pytest.approx(2 / 3 * distance / spread)
    assert found.between.n == 3 * len(windows[0])


def test_captured_windows_scale_equals_all_pairs(library):
    reference = captured_windows(library, 0)
    found = [body_windows(BodyTracks.of(clip)) for clip in library.clips]
    windows, centers = map(np.concatenate, zip(*found, strict=True))
    np.testing.assert_array_equal(reference.windows, windows)
    clips = np.repeat(np.arange(len(found)), [len(own) for own, _ in found])
    is_far = np.abs(centers[:, None] - centers) >= 1.5 * library.rate
    distances = np.linalg.norm(windows[:, None] - windows, axis=2)
    nearest = np.where(is_far | (clips[:, None] != clips), distances, np.inf).min(axis=1)
    assert reference.scale == pytest.approx(np.median(nearest))


def test_body_windows_distance_is_root_mean_square_of_points(library):
    tracks = BodyTracks.of(library.clips[0])
    moved = replace(tracks, points=tracks.points + np.array([0.03, 0.0, 0.04]))
    (first, _), (second, _) = body_windows(tracks), body_windows(moved)
    assert np.linalg.norm(first - second, axis=1) == pytest.approx(np.full(len(first), 0.05))


def test_novelty_short_clip_raises_insufficient_data_error(library):
    short = Library.build(library.clips[0][:40])
    with pytest.raises(InsufficientDataError, match=r"1\.5 s apart"):
        novelty([list(grafts_by(Captured(), short))])


def test_quality_of_copies_equals_recording(library):
    found = quality("same", grafts_of_clips(library, Captured(), 2))
    assert found.new_segments.value == 0
    assert found.seam_gap.n == 0
    assert found.acceleration.value == found.jerk.value == 1
    assert found.diversity.value == pytest.approx(0, abs=1e-9)


def test_quality_of_random_grafts_equals_direct_computation(library):
    grafts = grafts_of_clips(library, RandomLength())
    found = quality("x", grafts)
    every = [graft for several in grafts for graft in several]
    substitutions = [s for graft in every for s in graft.substitutions]
    assert found.new_segments.value == pytest.approx(np.mean([not s.is_own for s in substitutions]))
    gaps = np.degrees([seam.gap for graft in every for seam in graft.seams])
    assert found.seam_gap.value == pytest.approx(gaps.mean())
    joints = feature_joints(library.clips[0].skeleton, library.joints("upper"))
    ratios = [
        angular_derivatives(g.motion.rotations[:, joints], library.rate)[0]
        / angular_derivatives(g.base.rotations[:, joints], library.rate)[0]
        for g in every
    ]
    assert found.acceleration.value == pytest.approx(np.mean(ratios))
    assert found.acceleration.n == len(every)
    angles = [
        rotations.angle(*(graft.motion.rotations[:, joints] for graft in pair)).mean()
        for several in grafts
        for pair in combinations(several, 2)
    ]
    assert found.diversity.value == pytest.approx(math.degrees(np.mean(angles)), rel=0.02)
    assert found.runs == 3


@given(st.floats(0.1, 40), st.floats(0.2, 3))
def test_angular_derivatives_constant_acceleration_has_no_jerk(expected, seconds):
    rate = 60.0
    time = np.arange(round(seconds * rate) + 5) / rate
    assume(expected * time[-1] / rate <= 3)  # steps of half a turn are ambiguous
    angles = np.outer(0.5 * expected * time**2, [0.0, 1.0, 0.0])
    acceleration, jerk = angular_derivatives(rotations.exp(angles)[:, None], rate)
    assert acceleration == pytest.approx(expected, rel=1e-6)
    assert jerk == pytest.approx(0, abs=expected * 1e-3)


def test_quality_three_frames_raises_insufficient_data_error(library):
    with pytest.warns(UserWarning, match="too few"):
        short = Library.build(library.clips[0][:3])
    with pytest.raises(InsufficientDataError, match="4 frames"):
        quality("x", [list(grafts_by(Captured(), short))])
