"""Methods of segmentation: behaviours after Barbič et al. 2004, beats, contacts, centre of mass."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst

from lab.segmentations import METHODS, beats, gmm, method, pca, ppca
from lab.segmentations.poses import pose_features, principal_scores
from lab.studies.behaviour_pieces import metronome
from mograft import Config, Motion, Skeleton, rotations, segment
from mograft._util.runs import find_runs
from mograft.body.mass import mass_model
from mograft.dancer import dance
from tests.oracles import behaviour_cuts as oracle
from tests.strategies import SEEDS, few_examples, quaternions, star_skeleton

RATE = 30.0


def behaviours(seed, seconds, rate=RATE, n_joints=6, blend=0.3):
    """A motion of periodic behaviours and the frames in the middle of their changes.

    `seconds` are the durations of the behaviours. In each, every joint below the root oscillates
    about a mean orientation, with its own axis, amplitude and phase and one period for all.
    Neighbouring behaviours are cross-faded over `blend` seconds.
    """
    rng = np.random.default_rng(seed)
    changes = np.cumsum(seconds)
    times = np.arange(round(changes[-1] * rate)) / rate
    angles = np.zeros((len(times), n_joints, 3))
    starts = [-np.inf, *changes[:-1]]
    for start, stop in zip(starts, [*changes[:-1], np.inf], strict=True):
        weight = ramp((times - start) / blend) * (1 - ramp((times - stop) / blend))
        period = rng.uniform(0.6, 1.4)
        mean, first, second = rng.uniform(-0.5, 0.5, size=(3, n_joints, 3))
        phase = 2 * np.pi * times[:, None, None] / period
        wave = mean + first * np.sin(phase) + second * np.cos(phase)
        angles += weight[:, None, None] * wave
    quats = rotations.exp(angles)
    quats[:, 0] = rotations.IDENTITY
    skeleton = star_skeleton(n_joints)
    positions = np.tile(skeleton.offsets, (len(times), 1, 1))
    motion = Motion(skeleton, 1 / rate, quats, positions)
    return motion, (changes[:-1] * rate).round().astype(int)


def ramp(values):
    """A smooth step from 0 to 1 whose middle is at 0 and whose width is 1."""
    x = (values + 0.5).clip(0, 1)
    return x * x * (3 - 2 * x)


def name_of(module):
    return module.__name__.rpartition(".")[2]


TWO_METHODS = pytest.mark.parametrize("method", [pca, ppca], ids=name_of)
DURATIONS = st.lists(st.floats(4.5, 7.0), min_size=2, max_size=4)


def found(method, motion, **parameters):
    """The cut frames that a method finds with given parameters."""
    return method.cut_frames(motion, METHODS[name_of(method)][1](**parameters))


@TWO_METHODS
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


@TWO_METHODS
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


DEFAULT = beats.BeatParameters()


@few_examples(25)
@given(SEEDS, st.floats(0.35, 1.3), st.sampled_from([30.0, 60.0, 120.0]))
def test_beats_known_tempo_is_found_within_two_percent(seed, interval, rate):
    motion = metronome(seed, interval, rate)
    assert beats.beat_interval(motion, DEFAULT) == pytest.approx(interval, rel=0.02)
    # The acceleration is zero in the middle between two poses.
    seconds = beats.cut_frames(motion, DEFAULT) / rate
    offsets = (seconds / interval) % 1.0 - 0.5
    assert np.abs(offsets).max() <= 0.2
    assert abs(len(seconds) - 16.0 / interval) <= 2


@few_examples(60)
@given(
    npst.arrays(np.float64, st.integers(8, 13), elements=st.floats(0, 5)),
    st.floats(2.0, 4.0),
    st.floats(0.1, 20.0),
)
def test_fit_beats_equals_search_of_all_sequences(strength, interval, tightness):
    def total(chosen):
        gaps = np.diff(chosen)
        return strength[list(chosen)].sum() - tightness * (np.log(gaps / interval) ** 2).sum()

    shortest, longest = max(round(interval / 2), 1), round(2 * interval)
    n = len(strength)
    best = max(
        total(chosen)
        for count in range(1, n + 1)
        for chosen in itertools.combinations(range(n), count)
        if all(shortest <= gap <= longest for gap in np.diff(chosen))
        and chosen[0] < interval
        and chosen[-1] >= n - int(np.ceil(interval))
    )
    found = beats.fit_beats(strength, interval, tightness)
    assert total(found) == pytest.approx(best, abs=1e-9)


WHOLE = Config(max_length=np.inf)
DANCER = dance(strides=1, seed=3).motion


def flight(n_frames, rate):
    """The heights of a jump, in statures."""
    time = np.arange(n_frames) / rate
    return 0.5 * 5.6 * time * (time[-1] - time)


def still_motion(n_frames, heights=0.0, rate=30.0):
    """A figure in its rest pose, raised by `heights` statures."""
    skeleton = DANCER.skeleton
    quats = np.tile(rotations.IDENTITY, (n_frames, skeleton.n_joints, 1))
    positions = np.tile(skeleton.offsets, (n_frames, 1, 1))
    positions[:, 0, 1] += np.asarray(heights) * mass_model(skeleton).height
    return Motion(skeleton, 1.0 / rate, quats, positions, name="still")


@pytest.mark.parametrize("name", METHODS)
@pytest.mark.parametrize("n_frames", [2, 30, 400])
def test_constant_motion_has_no_cut_frames(name, n_frames):
    assert len(segment(still_motion(n_frames), method=method(name, WHOLE))) == 1


@pytest.mark.parametrize("name", METHODS)
def test_segments_of_every_method_are_within_the_length_limits(name):
    segments = segment(DANCER, method=method(name))
    assert segments.lengths.min() >= 3
    if name in ("com", "contacts"):
        assert segments.lengths.max() <= 60


@few_examples(20)
@given(lengths=st.lists(st.integers(6, 30), min_size=1, max_size=6))
def test_contacts_finds_the_frames_in_which_a_figure_is_lifted_and_put_down(lengths):
    # At least one frame in ten stands, so that the 5th percentile is the floor.
    lengths = [max(sum(lengths), 10), *lengths]
    is_up = np.repeat(np.arange(len(lengths)) % 2 == 1, lengths)
    motion = still_motion(len(is_up), 0.2 * is_up)
    changes = np.flatnonzero(np.diff(is_up)) + 1
    methods = (method("contacts", WHOLE, events=events) for events in ("both", "touchdown"))
    both, downs = (segment(motion, method=own).start[1:] for own in methods)
    # A foot in the frame beside a change has a high speed, and is not in contact.
    assert all(np.abs(changes[:, None] - both).min(axis=0) <= 1)
    assert len(downs) == len(changes) // 2


@few_examples(20)
@given(
    jumps=st.lists(st.floats(0.3, 0.6), min_size=1, max_size=3),
    rate=st.sampled_from([30.0, 60.0, 120.0]),
)
def test_com_finds_planted_jumps(jumps, rate):
    pieces = [np.zeros(int(rate))]
    for seconds in jumps:
        pieces += [flight(round(seconds * rate) + 1, rate), np.zeros(int(rate))]
    heights = np.concatenate(pieces)
    motion = still_motion(len(heights), heights, rate=rate)
    found = segment(motion, method=method("com", WHOLE, min_depth=1))
    flights = find_runs(heights >= 0.03) - [0, 1]  # feet are in contact below 0.03 statures
    np.testing.assert_array_equal(found.start[1:], flights.ravel())
