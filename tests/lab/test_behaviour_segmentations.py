"""Cuts between behaviours: the methods of Barbič et al. 2004."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst

from lab.segmentations import METHODS as KINDS
from lab.segmentations import beats, gmm, pca, ppca
from lab.segmentations.poses import pose_features, principal_scores
from mograft import Motion, Skeleton, rotations
from tests.lab.behaviours import RATE, behaviours
from tests.oracles import behaviour_cuts as oracle
from tests.strategies import SEEDS, few_examples, motions, quaternions


def name_of(module):
    return module.__name__.rpartition(".")[2]


METHODS = pytest.mark.parametrize("method", [pca, ppca], ids=name_of)
WITH_BEATS = pytest.mark.parametrize("method", [beats, pca, ppca], ids=name_of)
DURATIONS = st.lists(st.floats(4.5, 7.0), min_size=2, max_size=4)


def found(method, motion, **parameters):
    """The cut frames that a method finds with given parameters."""
    return method.cut_frames(motion, KINDS[name_of(method)][1](**parameters))


@WITH_BEATS
@few_examples(10)
@given(motions(min_joints=1, max_frames=60))
def test_cut_frames_short_motion_has_none(method, motion):
    assert not len(found(method, motion))


@WITH_BEATS
@few_examples(10)
@given(SEEDS, st.integers(2, 400), quaternions((5,)))
def test_cut_frames_constant_motion_has_none(method, seed, n_frames, pose):
    motion, _ = behaviours(seed, [5.0])
    quats = motion.rotations[:1].copy()
    quats[0, 1:] = pose
    jitter = np.random.default_rng(seed).normal(size=(n_frames, 6, 3)) * 1e-4
    held = rotations.multiply(np.repeat(quats, n_frames, axis=0), rotations.exp(jitter))
    positions = np.repeat(motion.positions[:1], n_frames, axis=0)
    still = Motion(motion.skeleton, motion.frame_time, held, positions)
    assert not len(found(method, still))


@METHODS
@few_examples(4)
@given(SEEDS, DURATIONS, quaternions(()))
def test_cut_frames_ignore_root_quaternion_signs_and_constant_joints(method, seed, seconds, turn):
    motion, _ = behaviours(seed, seconds)
    rng = np.random.default_rng(seed)
    own, quats = motion.skeleton, motion.rotations
    offsets = np.vstack([own.offsets, [[1.0, 0, 0]]])
    skeleton = Skeleton([*own.names, "still"], [*own.parents, 0], offsets)
    quats = np.concatenate([quats, quats[:1, :1].repeat(len(motion), 0)], 1)
    quats[:, 0] = rotations.multiply(turn, rotations.exp(rng.normal(size=(len(motion), 3))))
    quats *= rng.choice([-1.0, 1.0], size=quats.shape[:2])[..., None]
    positions = np.tile(skeleton.offsets, (len(motion), 1, 1))
    positions[:, 0] += rng.normal(size=(len(motion), 3))
    moved = Motion(skeleton, motion.frame_time, quats, positions)
    np.testing.assert_array_equal(found(method, moved), found(method, motion))


@METHODS
@few_examples(10)
@given(SEEDS, DURATIONS)
def test_cut_frames_known_changes_are_found(method, seed, seconds):
    motion, changes = behaviours(seed, seconds)
    cuts = found(method, motion)
    assert cuts.dtype == np.int64
    assert (np.diff(np.concatenate([[0], cuts, [motion.n_frames - 1]])) > 0).all()
    assert all(
        np.abs(cuts - change).min(initial=motion.n_frames) <= 0.6 * RATE for change in changes
    )


@few_examples(15)
@given(SEEDS, DURATIONS, st.integers(2, 700))
def test_pca_cut_frames_do_not_depend_on_later_frames(seed, seconds, n_frames):
    motion, _ = behaviours(seed, seconds)
    cuts = found(pca, motion)
    np.testing.assert_array_equal(found(pca, motion[:n_frames]), cuts[cuts < n_frames])


@few_examples(8)
@given(SEEDS, DURATIONS)
def test_pca_cut_frames_equal_oracle(seed, seconds):
    motion, _ = behaviours(seed, seconds)
    expected = oracle.pca_cuts(pose_features(motion), 60, 0.9, 2, 5, 3.0, 6)
    np.testing.assert_array_equal(found(pca, motion, step=0.2), expected)


@few_examples(6)
@given(SEEDS, DURATIONS, st.floats(0.6, 1.5), st.sampled_from([0.1, 0.2, 0.3]))
def test_ppca_cut_frames_equal_oracle_that_computes_one_distance_at_a_time(
    seed, seconds, window, step
):
    motion, _ = behaviours(seed, seconds)
    parameters = ppca.PpcaParameters(window=window, step=step, directions="forward")
    scores = principal_scores(pose_features(motion), 0.999)
    frames = (round(window * RATE), round(step * RATE))
    expected = oracle.ppca_cuts(scores, *frames, parameters)
    np.testing.assert_array_equal(ppca.cut_frames(motion, parameters), expected)


@few_examples(4)
@given(SEEDS, DURATIONS)
def test_ppca_cut_frames_reversed_motion_are_reversed(seed, seconds):
    motion, _ = behaviours(seed, seconds)
    back = replace(motion, rotations=motion.rotations[::-1], positions=motion.positions[::-1])
    expected = motion.n_frames - 1 - found(ppca, motion)[::-1]
    np.testing.assert_allclose(found(ppca, back), expected, atol=1)


def test_ppca_poses_within_the_behaviour_before_are_found_backwards_only():
    motion, _ = behaviours(3, [6.0], rate=10 * RATE)
    swing = 1500 + np.round(20 * np.sin(np.arange(150) / 5)).astype(int)
    frames = np.concatenate([np.arange(0, 1500, 10), swing])
    narrowed = Motion(motion.skeleton, 1 / RATE, motion.rotations[frames], motion.positions[frames])
    assert not len(found(ppca, narrowed, directions="forward"))
    (cut,) = found(ppca, narrowed)
    assert abs(cut - 150) <= 0.3 * RATE


@given(st.lists(st.integers(0, 300)), st.integers(1, 30))
def test_unite_near_cuts_replaces_runs_by_their_means(cuts, gap):
    united = ppca.unite_near_cuts(np.array(cuts, np.int64), gap)
    assert (np.diff(united) > 0).all()
    alone = {cut for cut in cuts if all(abs(cut - other) >= gap for other in cuts if other != cut)}
    assert alone <= set(united.tolist())
    assert all(min(abs(cut - own) for cut in cuts) <= gap for own in united)


@pytest.mark.parametrize("seed", range(3))
def test_gmm_known_changes_are_found(seed):
    motion, changes = behaviours(seed, [6.0, 5.0, 6.0])
    cuts = found(gmm, motion)
    assert len(cuts) >= 1
    assert max(np.abs(changes - cut).min() for cut in cuts) <= 0.6 * RATE


@given(npst.arrays(np.int64, st.integers(1, 60), elements=st.integers(0, 3)), st.integers(1, 12))
def test_merge_short_runs_keeps_long_runs_and_leaves_no_short_one(labels, min_length):
    def runs(values):
        return np.split(values, np.flatnonzero(np.diff(values)) + 1)

    merged = gmm.merge_short_runs(labels, min_length)
    lengths = [len(run) for run in runs(merged)]
    assert len(lengths) == 1 or min(lengths) >= min_length
    if min(len(run) for run in runs(labels)) >= min_length:
        np.testing.assert_array_equal(merged, labels)
    assert set(merged.tolist()) <= set(labels.tolist())
    # A run that is longer than all others together keeps its label.
    longest = max(runs(labels), key=len)
    if 2 * len(longest) > len(labels):
        assert longest[0] in merged
