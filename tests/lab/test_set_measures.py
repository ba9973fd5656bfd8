"""Laws of the measures that compare sets of motions."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from lab.baselines import body_mixing
from lab.measures import contacts, two_sets
from lab.measures.distributions import density_and_coverage, frechet_distance
from lab.measures.nearest_patches import nearest_patches
from lab.measures.nearest_windows import nearest_windows
from lab.measures.tracks import rotations_6d
from mograft.dancer import dance
from tests.strategies import SEEDS

POINTS = st.builds(
    lambda seed, n, d: np.random.default_rng(seed).normal(size=(n, d)),
    SEEDS,
    st.integers(8, 40),
    st.integers(1, 6),
)


def exhaustive_patches(track, examples, min_length):
    """Return the result of `nearest_patches`, by trying every cut of the motion."""
    totals = []
    for marks in itertools.product([False, True], repeat=len(track) - 1):
        pieces = np.split(track, np.flatnonzero(marks) + 1)
        if min(map(len, pieces)) >= min_length:
            totals.append(sum(min(distances(own, examples), default=np.inf) for own in pieces))
    return min(totals) / len(track)


def distances(piece, examples):
    """Return the summed distances of a piece to every part of the examples."""
    return [
        np.linalg.norm(piece - example[k : k + len(piece)], axis=1).sum()
        for example in examples
        for k in range(len(example) - len(piece) + 1)
    ]


@given(SEEDS, st.integers(3, 9), st.integers(1, 3), st.integers(1, 3))
def test_nearest_patches_small_inputs_match_exhaustive_search(seed, n, min_length, n_examples):
    rng = np.random.default_rng(seed)
    track = rng.normal(size=(n, 2))
    examples = [rng.normal(size=(rng.integers(1, 7), 2)) for _ in range(n_examples)]
    found = nearest_patches(track, examples, min_length)
    is_possible = n >= min_length <= max(map(len, examples))
    expected = exhaustive_patches(track, examples, min_length) if is_possible else np.nan
    assert found == pytest.approx(expected, abs=1e-7, nan_ok=True)


@given(POINTS, st.just(0) | st.floats(-5, 5))
def test_frechet_distance_of_a_shift_is_its_squared_length(points, shift):
    expected = points.shape[1] * shift**2
    assert frechet_distance(points, points[::-1] + shift) == pytest.approx(expected, abs=1e-6)


@given(POINTS)
def test_frechet_distance_weights_equal_repeated_points(points):
    counts = np.random.default_rng(1).integers(0, 4, len(points)) + (np.arange(len(points)) == 0)
    other = points[::2] * 2
    repeated = frechet_distance(other, np.repeat(points, counts, axis=0))
    assert frechet_distance(other, points, None, counts) == pytest.approx(repeated, abs=1e-6)


@given(POINTS)
def test_density_and_coverage_are_those_of_equal_and_distant_sets(points):
    density, coverage = density_and_coverage(points, points)
    assert coverage == 1
    # Each ball holds its centre and at least as many neighbours as density divides by.
    assert density >= 1
    assert density_and_coverage(points, points + 1e3) == (0.0, 0.0)


@pytest.fixture(scope="module")
def clips():
    return [take.motion for take in dance(seed=4, strides=2).takes(4)]


def test_rotations_6d_are_columns_of_the_matrix():
    matrices = Rotation.random(5, random_state=0)
    columns = np.moveaxis(matrices.as_matrix()[..., :2], 1, 2).reshape(5, 6)
    np.testing.assert_allclose(rotations_6d(matrices.as_quat()), columns, atol=1e-12)


@given(SEEDS, st.integers(1, 4))
def test_nearest_windows_match_a_loop_over_windows(seed, length):
    rng = np.random.default_rng(seed)
    tracks = [rng.normal(size=(n, 2)) for n in (7, 3)]
    others = [rng.normal(size=(n, 2)) for n in (5, 2, 6)]
    for track, nearest in zip(tracks, nearest_windows(tracks, others, length), strict=True):
        windows = [track[i : i + length] for i in range(len(track) - length + 1)]
        expected = [min(distances(own, others)) / length for own in windows]
        np.testing.assert_allclose(nearest, expected, atol=1e-7)


def test_toe_skate_sliding_body_skates_in_every_contact(clips):
    motion = clips[0]
    tracks, n = (motion.rotations, motion.positions), motion.n_frames
    quats, positions = (np.repeat(own[:1], n, axis=0) for own in tracks)
    still = replace(motion, rotations=quats, positions=positions.copy(), channel_values=None)
    n_contacts, n_skating = contacts.toe_skate(still)
    assert n_contacts.sum() > 0
    assert n_skating.sum() == 0
    positions[:, motion.locomotion_root(), 0] += np.arange(motion.n_frames) / motion.rate * 3400
    n_contacts, n_skating = contacts.toe_skate(replace(still, positions=positions))
    np.testing.assert_array_equal(n_skating, n_contacts)
    assert n_skating.sum() > 0


def read_windows(clips):
    """Return the windows of clips, in three blocks of frames for each clip."""
    blocks = [np.arange(clip.n_frames) * 3 // clip.n_frames + 3 * k for k, clip in enumerate(clips)]
    return two_sets.read_windows(clips, blocks)


def test_compare_sets_random_halves_are_not_distinguished(clips):
    tested = two_sets.compare_sets(*two_sets.split_at_random(read_windows(clips), 0))
    weights = np.ones((1, 3 * len(clips)))
    n = min(tested.is_new.sum(), (1 - tested.is_new).sum())
    # Four standard errors of the AUC of two equal sets of n independent scores.
    bound = 4 * np.sqrt((2 * n + 1) / (12 * n * n))
    assert all(abs(tested.auc(kind, weights)[0] - 0.5) < bound for kind in (0, 1))


def test_compare_sets_copies_are_not_distinguished_and_noise_is(clips):
    captured = read_windows(clips)
    weights = np.ones((1, 3 * len(clips)))
    copied = two_sets.assign_blocks(captured, captured)
    np.testing.assert_array_equal(copied.block, captured.block)
    tested = two_sets.compare_sets(captured, copied)
    assert tested.auc(0, weights) == pytest.approx(0.5, abs=1e-9)
    noisy = [body_mixing.add_noise(clip, 3.0, np.random.default_rng(0)) for clip in clips]
    shaken = two_sets.assign_blocks(read_windows(noisy), captured)
    assert two_sets.compare_sets(captured, shaken).auc(1, weights) > 0.9


def test_auc_leaves_out_folds_without_weight():
    tested = two_sets.TestedWindows(
        scores=(np.array([0.0, 1.0, 1.0, 0.0]),) * 2,
        is_new=np.array([0.0, 1.0, 0.0, 1.0]),
        unit=np.array([0, 0, 1, 1]),
        fold=np.array([0, 0, 1, 1]),
    )
    weights = np.array([[1.0, 1.0], [1.0, 0.0], [0.0, 2.0], [0.0, 0.0]])
    np.testing.assert_array_equal(tested.auc(0, weights), [0.5, 1.0, 0.0, np.nan])
