"""Laws of bent time: it only goes on, keeps its ends, and is bent only where that helps."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst

from mograft import Config, Library, Segments, graft
from mograft.blend.time_warp import TimeWarp, warping_path
from mograft.blend.transplant import DonorTimeline, recombine, transplant
from mograft.blend.value_spaces import ROTATIONS
from mograft.dancer import dance
from mograft.motion import rotations
from mograft.motion.resample import cubic
from tests.blend.test_seams import jumps
from tests.blend.test_transplant import JOINTS, LENGTHS, clip, pick, tiles
from tests.strategies import SEEDS, same_rotations

GUIDES = np.array([0, 2])
DTW = Config(alignment="dtw")


def distances(most=12):
    shapes = st.integers(2, most).map(lambda n: (n + 1, 2 * n + 1))
    return npst.arrays(np.float64, shapes, elements=st.floats(0, 3))


@given(distances(30))
def test_a_path_only_goes_on_and_keeps_its_ends(gaps):
    path, n = warping_path(gaps), len(gaps) - 1
    assert path[0] == 0
    assert path[-1] == 2 * n
    assert set(np.diff(path)) <= {1, 2, 3, 4}
    assert np.abs(path - 2 * np.arange(n + 1)).max() <= max(round(0.4 * n), 1)


@settings(max_examples=50)
@given(distances(6))
def test_no_path_is_shorter(gaps):
    """All paths, one after the other."""
    n = len(gaps) - 1
    rows = np.arange(n + 1)
    best = np.inf
    for steps in product((1, 2, 3, 4), repeat=n):
        path = np.concatenate([[0], np.cumsum(steps)])
        near = np.abs(path - 2 * rows).max() <= max(round(0.4 * n), 1)
        if path[-1] == 2 * n and near:
            best = min(best, gaps[rows, path].sum())
    assert gaps[rows, warping_path(gaps)].sum() == pytest.approx(best)


@given(LENGTHS, SEEDS)
def test_a_segment_is_not_bent_to_itself(lengths, seed):
    cut = tiles(lengths)
    base = clip(np.random.default_rng(seed), cut)
    warp = TimeWarp.of(base, cut, cut, [base], GUIDES)
    assert not warp.is_bent.any()
    part = transplant(base, cut, cut, [base], JOINTS, DTW, guides=GUIDES)
    np.testing.assert_array_equal(part.rotations, base.rotations[:, JOINTS])


@given(LENGTHS, SEEDS)
def test_time_goes_on_and_keeps_its_ends(lengths, seed):
    rng = np.random.default_rng(seed)
    cut = tiles(lengths)
    base = clip(rng, cut)
    donors = pick(cut, rng.integers(0, len(cut), len(cut)))
    warp = TimeWarp.of(base, cut, donors, [base], GUIDES)
    shares = np.linspace(0.0, 1.0, 201)
    for at in range(len(cut)):
        over = warp.at(np.full(201, at), shares)
        assert over[0] == 0.0
        assert over[-1] == 1.0
        assert (np.diff(over) > 0).all()
        assert np.abs(over - shares).max() < 0.3
        if not warp.is_bent[at]:
            np.testing.assert_allclose(over, shares, atol=1e-12)


@given(SEEDS, st.floats(-0.6, 0.6))
def test_a_donor_that_does_the_same_at_another_time_does_it_at_the_same(seed, bend):
    """A clip and the same clip in bent time: the graft undoes the better part of it."""
    rng = np.random.default_rng(seed)
    n = 40
    cut = tiles(np.array([n]))
    base = clip(rng, cut)
    shares = np.arange(n + 1) / n
    late = shares + bend * 0.15 * np.sin(np.pi * shares) ** 2
    quats = cubic(np.arange(n + 1), base.rotations, (late * n).clip(0, n))
    donor = recombine(base, [], "donor")
    donor = replace(donor, rotations=rotations.continuous_signs(quats), channel_values=None)
    even, bent = (
        transplant(base, cut, cut, [donor], JOINTS, Config(alignment=own), guides=GUIDES)
        for own in ("uniform", "dtw")
    )
    off = [rotations.angle(p.rotations, base.rotations[:, JOINTS]).mean() for p in (even, bent)]
    assert off[1] <= 1.05 * off[0] + 1e-9
    if abs(bend) > 0.4:
        assert off[1] < 0.6 * off[0]


@settings(deadline=None, max_examples=40)
@given(LENGTHS, SEEDS, st.sampled_from(["offset", "inertial", "dead"]))
def test_bent_pieces_meet_smoothly_too(lengths, seed, seam):
    rng = np.random.default_rng(seed)
    cut = tiles(lengths)
    base = clip(rng, cut)
    donors = pick(cut, rng.integers(0, len(cut), len(cut)))
    track = np.ascontiguousarray(base.rotations[:, JOINTS])
    laid = DonorTimeline(cut, donors, 30.0, warp=TimeWarp.of(base, cut, donors, [base], GUIDES))
    value, velocity = jumps(laid, ROTATIONS, [track], laid.true_seams([track]), Config(seam=seam))
    assert value < 1e-9
    assert velocity < 1e-4


def test_neighbours_of_which_one_is_bent_meet_at_a_seam():
    """They are as long as the places they take, but one of them is not at its own pace."""
    cut = tiles(np.array([20, 20, 20, 20]))
    base = clip(np.random.default_rng(8), cut)
    donors = pick(cut, np.array([2, 3, 2, 3]))
    laid = DonorTimeline(cut, donors, 30.0)
    track = np.ascontiguousarray(base.rotations[:, JOINTS])
    even = TimeWarp.of(base, cut, donors, [base], np.zeros(0, np.int64))
    bent = replace(even, is_bent=np.array([True, False, False, False]))
    assert laid.true_seams([track]).tolist() == [False, True, False]
    assert replace(laid, warp=even).true_seams([track]).tolist() == [False, True, False]
    assert replace(laid, warp=bent).true_seams([track]).tolist() == [True, True, False]


def test_grafts_can_be_aligned():
    motion = dance(seed=3, strides=1).motion
    even, bent = (
        graft(Library.build(motion, config=Config(alignment=own)), seed=2)
        for own in ("uniform", "dtw")
    )
    assert [s.donor for s in even.substitutions] == [s.donor for s in bent.substitutions]
    assert (even.motion.rotations != bent.motion.rotations).any()
    np.testing.assert_array_equal(bent.motion.rotations[:, :7], motion.rotations[:, :7])
    same_rotations(bent.motion.rotations[:1], even.motion.rotations[:1], 0.5)


def test_without_guides_nothing_is_bent():
    cut = tiles(np.array([9, 12]))
    base = clip(np.random.default_rng(5), cut)
    donors = Segments(cut.start[::-1], cut.stop[::-1])
    even = transplant(base, cut, donors, [base], JOINTS, Config())
    for guides in (None, np.zeros(0, np.int64)):
        part = transplant(base, cut, donors, [base], JOINTS, DTW, guides=guides)
        np.testing.assert_array_equal(part.rotations, even.rotations)
    with pytest.raises(ValueError, match=r"`alignment` must be one of .*'dtw'.*, got 'warp'"):
        Config(alignment="warp")
