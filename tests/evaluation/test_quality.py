"""Measures of quality: of copies, of motions with known values, and against direct computation."""

import math
from itertools import combinations

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from lab.donors.donor_methods import RandomLength, grafts_by
from mograft import InsufficientDataError, Library, rotations
from mograft.body.anatomy import feature_joints
from mograft.evaluation.quality import angular_derivatives, quality
from tests.evaluation.planted import Captured, grafts_of_clips


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
