"""Detectability: of copies, of planted jitter, its null, and which windows are trained on."""

import sys
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lab.donors.methods import Captured
from mograft import InsufficientDataError, Library, graft
from mograft.dancer import dance
from mograft.evaluation import RandomLength, grafts_by
from mograft.evaluation.body_tracks import landmarks
from mograft.evaluation.detectability import (
    assign_folds,
    block_folds,
    detectability,
    pair_other_moments,
    score_fold,
    train_and_score,
    weighted_auc,
)
from mograft.evaluation.windows import GraftWindows
from tests.evaluation.planted import add_jitter, copy_base
from tests.strategies import SEEDS

metrics = pytest.importorskip("sklearn.metrics", reason="scikit-learn is not installed")


@pytest.fixture(scope="module")
def dances():
    """Return a library of six dance clips of eight seconds or more."""
    return Library.build([take.motion for take in dance(seed=4, strides=3).takes(6)])


@pytest.fixture(scope="module")
def grafts(dances):
    names = [entry.name for entry in dances.entries]
    return [list(grafts_by(RandomLength(), dances, name, 3, seed=1)) for name in names]


@pytest.fixture(scope="module")
def windows(grafts):
    """Return the windows at the seams of all grafts."""
    flat = [graft for several in grafts for graft in several]
    return GraftWindows.of(flat, "seams", 10_000, np.random.default_rng(0))


def change(grafts, function):
    return [[function(graft) for graft in several] for several in grafts]


@pytest.fixture(scope="module")
def captured_copies(grafts):
    return detectability("copies", change(grafts, copy_base), splits=1)


def test_detectability_copies_of_base_have_auc_one_half(captured_copies):
    found = captured_copies
    for place in (found.seams, found.between_seams):
        for auc in (place.gross, place.fine):
            assert auc.value == pytest.approx(0.5, abs=1e-9)
            assert auc.low - 1e-9 <= 0.5 <= auc.high + 1e-9
            assert auc.n > 30
    for null in (found.other_moments, found.donor_windows):
        for auc in (null.gross, null.fine):
            assert 0.35 < auc.value < 0.65
            assert auc.n > 30


def test_detectability_jitter_at_seams_is_detected_there_only(grafts, captured_copies):
    joint = landmarks(grafts[0][0].motion.skeleton)["chest"][0]
    copies = change(grafts, copy_base)
    jittered = change(copies, lambda g: add_jitter(g, joint, reach=2))
    jittered = detectability("jitter", jittered, splits=1)
    assert jittered.seams.fine.low > 0.8
    assert jittered.seams.gross.value > 0.6
    assert jittered.other_moments == captured_copies.other_moments
    assert jittered.donor_windows == captured_copies.donor_windows


def test_tested_windows_share_no_block_with_trained_ones(windows, monkeypatch):
    seen = []
    original = train_and_score

    def record(learned, labels, tested):
        seen.append((learned, tested))
        return original(learned, labels, tested)

    monkeypatch.setattr(sys.modules[detectability.__module__], "train_and_score", record)
    pairs = windows.pairs()
    # The frame and the origin of every window, instead of its features.
    rows = np.arange(len(windows), dtype=float)[:, None]
    marked = replace(pairs.new, blocks=(rows,) * 3)
    base_rows = -1.0 - np.arange(len(pairs.base), dtype=float)[:, None]
    marked_base = replace(pairs.base, blocks=(base_rows,) * 3)
    folds = block_folds(windows.frames, (0, 0))
    assert set(np.bincount(folds) > 0) == {True}
    for fold in range(3):
        score_fold(replace(pairs, new=marked, base=marked_base), folds, fold)
    assert len(seen) == 3

    def blocks_of(mark):
        if mark < 0:
            return {int(pairs.block[int(-1 - mark)])}
        number, center = (int(own[int(mark)]) for own in (windows.graft, windows.center))
        clip = windows.library.names.index(windows.grafts[number].base.name)
        frames = [np.array([windows.frames.offsets[clip] + center])]
        frames += [own.frames[center - 8 : center + 9] for own in windows.origins[number]]
        return set(windows.frames.block[np.concatenate(frames)].tolist())

    for learned, tested in seen:
        trained = set().union(*(blocks_of(mark) for mark in learned.blocks[0][:, 0]))
        used = set().union(*(blocks_of(mark) for mark in tested.blocks[0][:, 0]))
        assert trained
        assert used
        assert trained.isdisjoint(used)


def test_tested_windows_have_weight_of_captured_window_at_same_frame(windows):
    pairs = windows.pairs()
    # Without the blocks of donors, more windows at one frame are tested together.
    pairs = replace(pairs, blocks_used=tuple(pairs.block[pairs.row][:, None]))
    found = score_fold(pairs, block_folds(windows.frames, (0, 0)), 0)
    n = len(found.rows)
    assert n > len(found.weight) - n
    sums = np.bincount(pairs.row[found.rows], found.weight[:n])
    assert sums[sums > 0] == pytest.approx(np.ones(len(found.weight) - n))
    assert found.weight[n:].tolist() == [1.0] * (len(found.weight) - n)
    assert found.is_new.tolist() == [1.0] * n + [0.0] * (len(found.weight) - n)


def test_other_moments_pairs_disjoint_windows_of_one_block(windows):
    pairs = windows.pairs()
    indices = np.arange(len(pairs.base), dtype=float)[:, None]
    marked = replace(pairs, base=replace(pairs.base, blocks=(indices,) * 3))
    null = pair_other_moments(marked, np.random.default_rng(1))
    first, second = (own.blocks[0][:, 0].astype(int) for own in (null.base, null.new))
    assert len(np.unique([*first, *second])) == len(first) + len(second)
    np.testing.assert_array_equal(pairs.block[first], pairs.block[second])
    assert len(first) >= 0.4 * len(pairs.base)


@given(SEEDS, st.integers(4, 40), st.integers(1, 4))
def test_weighted_auc_equals_scikit_learn(seed, n, n_weightings):
    rng = np.random.default_rng(seed)
    scores = rng.integers(0, 6, n).astype(float)
    labels = np.concatenate([[0.0, 1.0], rng.integers(0, 2, n - 2)])
    weights = rng.integers(0, 3, size=(n_weightings, n)).astype(float)
    weights[:, :2] += 0.5
    found = weighted_auc(scores, labels, weights)
    expected = [metrics.roc_auc_score(labels, scores, sample_weight=row) for row in weights]
    assert found == pytest.approx(expected)
    assert np.isnan(weighted_auc(scores, labels, weights * labels)).all()


def test_detectability_unsupported_grafts_raise(dances, grafts):
    with pytest.raises(InsufficientDataError, match="60 windows at seams, but there are 0"):
        detectability("x", [list(grafts_by(Captured(), dances))])
    walk = graft(grafts[0][0].library, scenario=[0, 1])
    with pytest.raises(ValueError, match="`grafts` must have clips of the library as bases"):
        detectability("x", [[walk]])


@given(st.lists(st.integers(1, 30), min_size=1, max_size=30), st.integers(1, 6), SEEDS)
def test_assign_folds_keeps_groups_together_and_sizes_similar(sizes, n_folds, seed):
    groups = np.repeat(np.arange(len(sizes)), sizes)
    folds = assign_folds(groups, n_folds, seed)
    for group in range(len(sizes)):
        assert len(set(folds[groups == group].tolist())) == 1
    counts = np.bincount(folds)
    assert len(counts) == min(n_folds, len(sizes))
    assert counts.min() > 0
    assert counts.max() - counts.min() <= max(sizes)
    np.testing.assert_array_equal(folds, assign_folds(groups, n_folds, seed))
