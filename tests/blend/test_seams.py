"""Laws of every seam treatment: continuity, reach, causality, root velocity."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mograft import Config
from mograft.blend.donor_timeline import DonorTimeline
from mograft.blend.seam_treatments import SEAM_TREATMENTS
from mograft.blend.seams import ROTATIONS, TRANSLATIONS, PieceTimes, SeamBoundaries
from mograft.motion import rotations
from tests.blend.continuity import close_at, jumps, random_donors
from tests.strategies import SEEDS, SEGMENT_LENGTHS, few_examples, smooth_rotations, tile_segments

NAMES = tuple(SEAM_TREATMENTS)
SMOOTH = [name for name in NAMES if name not in ("displacement", "paper")]


@pytest.mark.parametrize("space", [ROTATIONS, TRANSLATIONS])
@few_examples(40)
@given(SEGMENT_LENGTHS, SEEDS, st.sampled_from(NAMES), st.floats(0.05, 1.0))
def test_close_any_treatment_makes_values_continuous(space, lengths, seed, seam, blend):
    timeline, tracks = random_donors(lengths, seed, seam=seam, seam_blend=blend)
    value, velocity = jumps(timeline, space, tracks[space])
    assert value < 1e-9
    if seam in SMOOTH:
        assert velocity < 1e-5


@settings(deadline=None)
@given(SEGMENT_LENGTHS, SEEDS, st.sampled_from(NAMES))
def test_close_frames_out_of_reach_are_unchanged(lengths, seed, seam):
    (timeline, tracks), treatment = random_donors(lengths, seed, seam=seam), SEAM_TREATMENTS[seam]
    times, blend = timeline.frame_times(), timeline.config.seam_blend
    source = timeline.sample(ROTATIONS, tracks[ROTATIONS], *times)
    values = close_at(timeline, ROTATIONS, tracks[ROTATIONS], times)
    np.testing.assert_allclose(np.linalg.norm(values, axis=-1), 1.0, atol=1e-12)
    every = np.concatenate([[False], timeline.seams, [False]])
    if treatment.spans_segments:
        # Segments without a seam at either end.
        unchanged = ~(every[:-1] | every[1:])[times[0]]
    else:
        pieces = timeline.piece_times(*times)
        unchanged = (pieces.seconds >= blend) | (pieces.piece == 0)
        if not treatment.is_causal:
            last = len(pieces.durations) - 1
            unchanged &= (pieces.seconds_left >= blend) | (pieces.piece == last)
    np.testing.assert_array_equal(values[unchanged], source[unchanged])


@given(SEEDS, st.sampled_from(NAMES))
def test_close_pieces_that_already_meet_are_unchanged(seed, seam):
    rng = np.random.default_rng(seed)
    pose, speed = smooth_rotations(rng, 1, 3), rng.normal(size=(1, 3, 3))
    boundaries = SeamBoundaries(ROTATIONS, pose, pose, speed, speed)
    seconds = np.array([0.1, 0.2, 0.0, 0.1])
    times = PieceTimes(np.array([0, 0, 1, 1]), seconds, np.array([0.2, 0.3]), 0.3)
    values = smooth_rotations(rng, 4, 3)
    closed = SEAM_TREATMENTS[seam].close(values, times, boundaries)
    np.testing.assert_array_equal(closed, values)


@given(st.lists(st.floats(0.0, 1.0), min_size=2, max_size=20), st.sampled_from(NAMES))
def test_root_velocity_weights_fall_from_the_seam_to_zero(shares, seam):
    treatment = SEAM_TREATMENTS[seam]
    weights = treatment.root_velocity_weights(np.sort([0.0, 1.0, *shares]))
    for side in weights:
        assert side[0] == 0.0
        assert (np.diff(side) >= 0.0).all()
    assert sum(side[-1] for side in weights) in (0.0, 1.0)
    if treatment.is_causal:
        assert not weights[0].any()


@given(SEGMENT_LENGTHS, SEEDS)
def test_find_seams_are_where_poses_do_not_continue(lengths, seed):
    """Donors of two takes; the second equals the first but for some frames of one joint."""
    rng = np.random.default_rng(seed)
    cut = tile_segments(lengths)
    n = int(cut.stop[-1]) + 1
    track = smooth_rotations(rng, n, 3)
    other = track.copy()
    joint, is_off = int(rng.integers(3)), rng.random(n) < 0.15
    other[is_off, joint] = rotations.multiply(other[is_off, joint], rotations.exp([0.01, 0.0, 0.0]))
    clip = rng.integers(0, 2, len(cut))
    timeline = DonorTimeline(cut, replace(cut, clip=clip), 30.0, Config())
    expected = []
    for before, after, frame in zip(clip[:-1], clip[1:], cut.start[1:], strict=True):
        near = is_off[max(frame - 1, 0) : frame + 2]  # a clip's first frame has one neighbour
        expected.append(before != after and near.any())
    np.testing.assert_array_equal(timeline.find_seams([track, other]), expected)
    others = np.delete(np.arange(3), joint)
    assert not timeline.find_seams([track, other], others).any()
