"""Properties of features and principal components."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst
from sklearn.decomposition import PCA

from mograft import Config, Segments, segment
from mograft._util.linalg import GRID
from mograft.analysis.embedding import (
    Samples,
    Spread,
    embed,
    features,
    mean_rotations,
    moments,
    normalise,
)
from mograft.analysis.embedding import pca as components_of
from mograft.motion import rotations
from tests.oracles import analysis as oracle
from tests.strategies import (
    SEEDS,
    few_examples,
    motions,
    random_star_clip,
    smooth_rotations,
    tile_segments,
)

ROBUST, PAPER = Config(), Config.paper()
LONG = motions(min_frames=60, max_frames=150, min_joints=2)
NORMALISATION = {"root": 0, "up": 1, "heights": [1.7]}


def pca(matrix, n_components, floors):
    spread = Spread.of([matrix])
    return spread.mean, *components_of(spread, n_components, floors)


def matrix_of(motion, config, joints=None):
    joints = np.arange(motion.n_joints) if joints is None else joints
    samples = normalise([motion], segment(motion, config), config, **NORMALISATION)
    reference = mean_rotations([samples])[joints]
    if not config.keep_heading:
        reference[joints == 0] = rotations.IDENTITY
    return features(samples, joints, reference, has_root=0 in joints)


def embed_all(samples, joints):
    means = mean_rotations([samples])
    return embed(samples, np.array(joints), means, ROBUST, root=0, group="all")


@given(SEEDS, st.integers(1, 300), st.integers(1, 3), st.integers(1, 4), st.booleans())
def test_kernels_any_precision_and_joint_order_equal_numpy(seed, n, n_samples, n_joints, is_single):
    """`moments` and `features` equal NumPy formulas for any precision and order of joints."""
    rng = np.random.default_rng(seed)
    quats = smooth_rotations(rng, n * n_samples, n_joints).reshape(n, n_samples, n_joints, 4)
    rest = rng.normal(size=(n, 3 * n_samples + 1))
    rows = np.concatenate([quats.reshape(n, -1), rest], axis=1)
    samples = Samples(rows.astype(np.float32) if is_single else rows, n_samples, n_joints)
    quats, rest = (
        samples.rotations.astype(np.float64),
        samples.displacements_and_length.astype(np.float64),
    )
    products = quats[..., :, None] * quats[..., None, :]
    summed = products.reshape(-1, n_joints, 4, 4).cumsum(axis=0)[-1]
    np.testing.assert_array_equal(moments(samples), summed)
    joints = rng.permutation(n_joints)[: rng.integers(n_joints + 1)]
    reference = smooth_rotations(rng, 1, len(joints))[0]
    unit = quats[:, :, joints] / np.linalg.norm(quats[:, :, joints], axis=-1, keepdims=True)
    vectors = rotations.log(rotations.multiply(rotations.inverse(reference), unit))
    vectors = vectors.swapaxes(1, 2).reshape(n, -1)
    for has_root, tail in ((False, rest[:, -1:]), (True, rest)):
        matrix = features(samples, joints, reference, has_root=has_root)
        np.testing.assert_allclose(matrix[:, : vectors.shape[1]], vectors, atol=1e-12)
        np.testing.assert_array_equal(matrix[:, vectors.shape[1] :], tail)


@few_examples(20)
@given(LONG, st.sampled_from((ROBUST, PAPER)), SEEDS)
def test_features_equal_oracle_for_any_signs_of_quaternions(motion, config, seed):
    segments = segment(motion, config)
    bounds = np.array([*segments.start, segments.stop[-1]])
    joints = np.arange(motion.n_joints)
    places, seconds = motion.positions[:, 0], motion.frame_time
    expected = oracle.features(motion.rotations, places, bounds, joints, 0, 1, 1.7, seconds, config)
    signs = np.random.default_rng(seed).choice([-1.0, 1.0], (*motion.rotations.shape[:2], 1))
    flipped = replace(motion, rotations=signs * motion.rotations)
    np.testing.assert_allclose(matrix_of(flipped, config), expected, atol=1e-9)


MATRICES = npst.arrays(
    np.float64,
    st.tuples(st.integers(4, 40), st.integers(2, 12)),
    elements=st.floats(-10, 10).map(lambda x: round(x, 3)),
).filter(lambda m: ((m.std(axis=0) > 1e-3) | (m.std(axis=0) == 0)).all() and m.std(axis=0).any())


@few_examples(40)
@given(MATRICES, SEEDS)
def test_pca_matches_scikit_learn_in_any_order_of_segments(matrix, seed):
    floors = np.zeros(matrix.shape[1])
    mean, scale, components, variances = pca(matrix, 3, floors)
    kept = np.isfinite(scale)
    standard = ((matrix - mean) / scale)[:, kept]
    expected = PCA(components.shape[1], svd_solver="full").fit(standard)
    np.testing.assert_allclose(
        expected.explained_variance_, variances[: components.shape[1]], atol=1e-8
    )
    gaps = -np.diff(variances[: components.shape[1] + 1])
    for column in range(components.shape[1]):
        is_single = (gaps[max(column - 1, 0) : column + 1] > 1e-3).all()
        if is_single:
            ours, theirs = components[kept, column], expected.components_[column]
            # The cosine of vectors that differ by d is 1 - d²/2, that of unrounded ones 1.
            assert abs(ours @ theirs) == pytest.approx(1.0, abs=GRID * np.sqrt(len(ours)))
            assert np.abs(ours - theirs * np.sign(ours @ theirs)).max() <= GRID / 2 + 1e-9
    order = np.random.default_rng(seed).permutation(len(matrix))
    shuffled = pca(matrix[order], 3, floors)
    np.testing.assert_allclose(shuffled[3], variances, atol=1e-8)


def test_pca_components_of_negligible_variance_are_dropped():
    rng = np.random.default_rng(4)
    axes = rng.normal(size=(60, 2)) * [1.0, 1e-4]
    matrix = axes @ np.linalg.qr(rng.normal(size=(6, 6)))[0][:2]
    assert pca(matrix, 6, np.ones(6))[2].shape == (6, 1)
    assert pca(axes @ np.eye(2, 6) * [1.0, 1e2, 1, 1, 1, 1], 6, np.ones(6))[2].shape == (6, 2)


@given(LONG, st.integers(1, 5), st.booleans(), st.integers(0, 1))
def test_normalise_any_number_of_segments_at_a_time_gives_same_bits(
    motion, length, keep_heading, root
):
    config = Config(keep_heading=keep_heading)
    keywords = {**NORMALISATION, "root": root}
    expected = normalise([motion], segment(motion), config, **keywords)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("mograft.analysis.embedding.CHUNK", length)
        found = normalise([motion], segment(motion), config, **keywords)
        packed = normalise([motion], segment(motion), config, **keywords, is_packed=True)
    np.testing.assert_array_equal(found.rows, expected.rows)
    np.testing.assert_array_equal(packed.rows, expected.pack(), strict=True)


def test_embed_too_few_or_equal_segments_warns_and_returns_none():
    motion = random_star_clip(np.random.default_rng(3), tile_segments([199]))
    for segments, message in (
        (Segments([0, 9], [9, 20]), "group all: 2 segments are too few"),
        (Segments([0, 0, 0], [9, 9, 9]), "group all: all 3 segments are alike"),
    ):
        samples = normalise([motion], segments, ROBUST, **NORMALISATION)
        with pytest.warns(UserWarning, match=message):
            assert embed_all(samples, range(4)) is None


def test_embed_cached_features_do_not_change_result(monkeypatch):
    from mograft.analysis import embedding

    monkeypatch.setattr(embedding, "CHUNK", 3)
    motion = random_star_clip(np.random.default_rng(3), tile_segments([199]))
    samples = normalise([motion], segment(motion), ROBUST, **NORMALISATION)
    assert len(samples) % 3
    expected = None
    for room in (0, 8 * 700, 8 * 1500, 1 << 30):
        monkeypatch.setattr(embedding, "CACHE_BYTES", room)
        result = embed_all(samples, range(4))
        expected = result.points if expected is None else expected
        np.testing.assert_array_equal(result.points, expected)
