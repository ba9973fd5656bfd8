"""Laws of the measures of newness."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import mograft as mg
from mograft.dancer import dance
from mograft.motion import rotations
from mograft.synthesis.newness import newness
from tests.strategies import few_examples


@pytest.fixture(scope="module")
def graft():
    return mg.graft(mg.Library.build(dance(seed=2, strides=1).motion), seed=1)


def turned(graft, angle, frames=slice(None)):
    """The graft's base with all exchanged joints turned by an angle in some frames."""
    joints, quats = graft.library.joints("upper"), graft.base.rotations.copy()
    turn = rotations.exp(np.array([0.0, angle, 0.0]))
    for joint in joints:
        quats[frames, joint] = rotations.multiply(quats[frames, joint], turn)
    motion = replace(graft.base, rotations=quats, channel_values=None, name=f"turned{angle}")
    return replace(graft, motion=motion)


@few_examples(20)
@given(angle=st.floats(0.0, 3.0), share=st.floats(0.0, 1.0))
def test_turned_joints_are_measured(graft, angle, share):
    n = round(share * graft.base.n_frames)
    found = newness(turned(graft, angle, slice(n)))
    assert found.changed == pytest.approx(angle * n / graft.base.n_frames, abs=1e-6)
    if abs(angle - np.radians(5.0)) > 1e-6:
        assert found.new == (n / graft.base.n_frames if angle > np.radians(5.0) else 0.0)
    assert (found.apart, found.nearest) == (None, "")


@few_examples(20)
@given(angles=st.lists(st.floats(0.0, 1.5), min_size=2, max_size=5, unique=True))
def test_nearest_other_motion_is_named(graft, angles):
    own, *others = (turned(graft, angle) for angle in angles)
    found = newness(own, [graft.base[:10], *(other.motion for other in others)])
    gap = min(abs(angles[0] - angle) for angle in angles[1:])
    assert found.apart == pytest.approx(gap, abs=1e-6)
    assert found.nearest in {other.motion.name for other in others}
    assert f"° from {found.nearest}" in str(found)
    assert found.as_dict()["apart"] == found.apart


@few_examples(8)
@given(degrees=st.floats(0.5, 40.0), seed=st.integers(0, 100))
def test_distinct_motions_are_apart_and_keep_their_order(graft, degrees, seed):
    library, joints = graft.library, graft.library.joints("upper")
    library = library.relabelled(replace(library.config, self_repair=False))
    options = {"seed": seed, "widen": False, "distinct": np.radians(degrees)}
    grafts = mg.graft_many(library, count=4, **options)
    motions = [own.motion.rotations[:, joints] for own in grafts]
    for one, two in combinations(motions, 2):
        cosines = np.abs((one * two).sum(axis=-1)).clip(max=1.0)
        assert np.degrees(2 * np.arccos(cosines).mean()) >= degrees - 1e-3
    first = mg.graft_many(library, count=1, seed=seed)[0]
    np.testing.assert_array_equal(grafts[0].motion.rotations, first.motion.rotations)


@pytest.mark.parametrize("distinct", [-0.1, 4.0, True, "1", float("nan")])
def test_distinct_that_is_no_angle_raises_value_error(graft, distinct):
    with pytest.raises(ValueError, match="`distinct` must be an angle from 0 to π"):
        mg.graft_many(graft.library, count=2, distinct=distinct)
