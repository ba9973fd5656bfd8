"""Time warps: monotone, fixed at both ends, used only if they reduce the distance."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst

from mograft import Config, Segments
from mograft.blend.donor_timeline import DonorLayout, DonorTimeline, SegmentTimes
from mograft.blend.recombine import recombine
from mograft.blend.seam_treatments import SEAM_TREATMENTS
from mograft.blend.seams import ROTATIONS, TRANSLATIONS
from mograft.blend.time_warp import TimeWarp, gaps_in_band, warping_path
from mograft.blend.transplant import GraftedGroup, transplant
from mograft.motion import rotations
from mograft.motion.resample import cubic
from mograft.search.boundary_states import pose_gaps
from tests.blend.continuity import jumps
from tests.strategies import (
    SEEDS,
    SEGMENT_LENGTHS,
    random_star_clip,
    smooth_rotations,
    tile_segments,
)

JOINTS = np.array([1, 3])
BASE_JOINTS = np.array([0, 2])
GROUP = GraftedGroup(JOINTS, base_joints=BASE_JOINTS)
SMOOTH = sorted({*SEAM_TREATMENTS} - {"displacement", "paper"})
DTW = Config(alignment="dtw")


def distances(most=12):
    shapes = st.integers(2, most).map(lambda n: (n + 1, 2 * n + 1))
    return npst.arrays(np.float64, shapes, elements=st.floats(0, 3))


@given(distances(30))
def test_warping_path_is_monotone_within_band_and_keeps_ends(gaps):
    path, n = warping_path(gaps), len(gaps) - 1
    assert path[0] == 0
    assert path[-1] == 2 * n
    assert set(np.diff(path)) <= {1, 2, 3, 4}
    assert np.abs(path - 2 * np.arange(n + 1)).max() <= max(round(0.4 * n), 1)


@given(npst.arrays(np.float64, (3, 2, 9, 17), elements=st.floats(0, 3)))
def test_warping_path_of_several_is_that_of_each(gaps):
    paths = warping_path(gaps)
    for index in np.ndindex(gaps.shape[:2]):
        assert np.array_equal(paths[index], warping_path(gaps[index]))


@settings(max_examples=25)
@given(distances(6))
def test_warping_path_is_shortest_of_all_paths(gaps):
    """The oracle enumerates all paths."""
    n = len(gaps) - 1
    rows = np.arange(n + 1)
    best = np.inf
    for steps in product((1, 2, 3, 4), repeat=n):
        path = np.concatenate([[0], np.cumsum(steps)])
        near = np.abs(path - 2 * rows).max() <= max(round(0.4 * n), 1)
        if path[-1] == 2 * n and near:
            best = min(best, gaps[rows, path].sum())
    assert gaps[rows, warping_path(gaps)].sum() == pytest.approx(best)


@given(st.integers(1, 40), st.integers(1, 3), SEEDS)
def test_gaps_in_band_give_the_path_of_all_gaps(n, n_others, seed):
    rng = np.random.default_rng(seed)
    poses, *others = (smooth_rotations(rng, 2 * n + 1, 2) for _ in range(n_others + 1))
    expected = np.stack([pose_gaps(poses[: n + 1], other) for other in others])
    gaps = gaps_in_band(poses[: n + 1], np.stack(others))
    path = warping_path(gaps)
    np.testing.assert_array_equal(path, warping_path(expected))
    for row in range(n_others):
        used = np.arange(n + 1), path[row]
        np.testing.assert_array_equal(gaps[row][used], expected[row][used])


@given(SEGMENT_LENGTHS, SEEDS)
def test_by_dtw_segment_onto_itself_is_not_warped(lengths, seed):
    cut = tile_segments(lengths)
    base = random_star_clip(np.random.default_rng(seed), cut)
    warp = TimeWarp.by_dtw(base, cut, cut, [base], BASE_JOINTS)
    assert not warp.is_warped.any()
    part = transplant(base, cut, cut, [base], GROUP, DTW)
    np.testing.assert_array_equal(part.rotations, base.rotations[:, JOINTS])


@given(SEGMENT_LENGTHS, SEEDS)
def test_donor_share_is_monotone_and_keeps_ends(lengths, seed):
    rng = np.random.default_rng(seed)
    cut = tile_segments(lengths)
    base = random_star_clip(rng, cut)
    donors = cut[rng.integers(0, len(cut), len(cut))]
    warp = TimeWarp.by_dtw(base, cut, donors, [base], BASE_JOINTS)
    shares = np.linspace(0.0, 1.0, 201)
    for at in range(len(cut)):
        over = warp.donor_share(np.full(201, at), shares)
        assert over[0] == 0.0
        assert over[-1] == 1.0
        assert (np.diff(over) > 0).all()
        assert np.abs(over - shares).max() < 0.3
        if not warp.is_warped[at]:
            np.testing.assert_allclose(over, shares, atol=1e-12)


@given(SEEDS)
def test_slopes_of_reversed_time_are_reversed(seed):
    """Reversing time takes share s after t to 1 - s after 1 - t: slopes in opposite order."""
    steps = np.random.default_rng(seed).uniform(0.05, 1.0, (6, 4))
    shares = np.cumsum(steps / steps.sum(axis=1, keepdims=True), axis=1)
    shares = np.column_stack([np.zeros(6), shares])
    slopes, back = (
        TimeWarp(own, np.ones(6, bool)).slopes for own in (shares, 1.0 - shares[:, ::-1])
    )
    np.testing.assert_allclose(back, slopes[:, ::-1], atol=1e-12)
    steepest = 4.0 * np.diff(shares, axis=1)
    assert (slopes >= 0.0).all()
    assert (slopes[:, :-1] <= 3.0 * steepest).all()
    assert (slopes[:, 1:] <= 3.0 * steepest).all()


@given(SEEDS, st.floats(-0.6, 0.6))
def test_transplant_dtw_undoes_a_known_time_warp(seed, bend):
    """The donor is the base with warped time; the graft removes most of the warp."""
    rng = np.random.default_rng(seed)
    n = 40
    cut = tile_segments(np.array([n]))
    base = random_star_clip(rng, cut)
    shares = np.arange(n + 1) / n
    late = shares + bend * 0.15 * np.sin(np.pi * shares) ** 2
    quats = cubic(np.arange(n + 1), base.rotations, (late * n).clip(0, n))
    donor = recombine(base, [], "donor")
    donor = replace(donor, rotations=rotations.continuous_signs(quats), channel_values=None)
    even, warped = (
        transplant(base, cut, cut, [donor], GROUP, Config(alignment=own))
        for own in ("uniform", "dtw")
    )
    off = [rotations.angle(p.rotations, base.rotations[:, JOINTS]).mean() for p in (even, warped)]
    assert off[1] <= 1.05 * off[0] + 1e-9
    if abs(bend) > 0.4:
        assert off[1] < 0.6 * off[0]


@settings(deadline=None, max_examples=20)
@given(SEGMENT_LENGTHS, SEEDS, st.sampled_from(SMOOTH))
def test_close_warped_pieces_are_continuous(lengths, seed, seam):
    rng = np.random.default_rng(seed)
    cut = tile_segments(lengths)
    base = random_star_clip(rng, cut)
    donors = cut[rng.integers(0, len(cut), len(cut))]
    track = np.ascontiguousarray(base.rotations[:, JOINTS])
    timeline = DonorTimeline(
        cut, donors, 30.0, warp=TimeWarp.by_dtw(base, cut, donors, [base], BASE_JOINTS)
    )
    seams = timeline.find_seams([track])
    layout = DonorLayout(timeline, [track], [track[:, :0, :3]], seams, Config(seam=seam))
    value, velocity = jumps(layout, ROTATIONS)
    assert value < 1e-9
    assert velocity < 1e-4


@given(SEEDS, st.floats(0.5, 2.0), st.floats(0.5, 2.0))
def test_boundaries_of_warped_donors_follow_their_curves(seed, first, last):
    """Velocities are scaled by the slope of the warp; accelerations are of three warped frames."""
    cut, track = (
        tile_segments(np.array([8, 12])),
        smooth_rotations(np.random.default_rng(seed), 21, 3),
    )
    track = np.ascontiguousarray(rotations.log(track))
    rises = np.array([[1.0, 1.0, 1.0, last], [first, 1.0, 1.0, 1.0]])
    shares = np.pad((rises / rises.sum(axis=1, keepdims=True)).cumsum(axis=1), ((0, 0), (1, 0)))
    even = DonorTimeline(cut, cut, 30.0)
    warped = replace(even, warp=TimeWarp(shares, np.ones(2, bool)))
    own, other = (each.boundaries(TRANSLATIONS, [track], np.array([0])) for each in (warped, even))
    slopes = warped.warp.slopes
    np.testing.assert_allclose(own.velocity_before, slopes[0, -1] * other.velocity_before)
    np.testing.assert_allclose(own.velocity_after, slopes[1, 0] * other.velocity_after)
    for side, frames in ((0, [6.0, 7.0, 8.0]), (1, [0.0, 1.0, 2.0])):
        times = SegmentTimes(np.full(3, side), np.array(frames))
        second = np.diff(warped.sample(TRANSLATIONS, [track], times), 2, axis=0)
        np.testing.assert_allclose(own.accelerations[side], second, atol=1e-12)


def test_find_seams_one_warped_neighbour_makes_a_seam():
    """Both donors have the length of their base segments, but one is warped."""
    cut = tile_segments(np.array([20, 20, 20, 20]))
    base = random_star_clip(np.random.default_rng(8), cut)
    donors = cut[np.array([2, 3, 2, 3])]
    timeline = DonorTimeline(cut, donors, 30.0)
    track = np.ascontiguousarray(base.rotations[:, JOINTS])
    even = TimeWarp.by_dtw(base, cut, donors, [base], np.zeros(0, np.int64))
    warped = replace(even, is_warped=np.array([True, False, False, False]))
    assert timeline.find_seams([track]).tolist() == [False, True, False]
    assert replace(timeline, warp=even).find_seams([track]).tolist() == [False, True, False]
    assert replace(timeline, warp=warped).find_seams([track]).tolist() == [True, True, False]


def test_transplant_dtw_without_base_joints_equals_uniform():
    cut = tile_segments(np.array([9, 12]))
    base = random_star_clip(np.random.default_rng(5), cut)
    donors = Segments(cut.start[::-1], cut.stop[::-1])
    even = transplant(base, cut, donors, [base], GROUP, Config())
    for joints in (None, np.zeros(0, np.int64)):
        group = replace(GROUP, base_joints=joints)
        part = transplant(base, cut, donors, [base], group, DTW)
        np.testing.assert_array_equal(part.rotations, even.rotations)
