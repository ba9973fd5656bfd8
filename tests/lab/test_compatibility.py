"""Compatibility of parts whose dependence is known, its terms, and counts of combinations."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lab.donors import compatibility as module
from lab.donors.compatibility import compatibility
from lab.donors.enrichment import PAPER_TABLES, enrichment, moment_laws, sweep
from lab.donors.held_out import fold_groups
from lab.donors.kappa import Kappas
from lab.donors.methods import Analogy, Ball, Nearest, Random
from lab.donors.part_features import part_features
from mograft import InsufficientDataError, Library, rotations
from mograft.dancer import dance
from mograft.evaluation import RandomLength
from mograft.evaluation.detectability import assign_folds
from mograft.solve.candidates import count_combinations
from tests.strategies import SEEDS, few_examples, transform_motion

METHODS = (Random(), RandomLength(), Analogy())


@pytest.fixture
def library(single_clip_library):
    return single_clip_library


def replace_features(monkeypatch, library, *, is_dependent):
    """Replace the features by noise around one point for each cluster of the base parts.

    The features of the upper part are around the same point as those of its lower part, or
    around that of a random segment.
    """
    rng, labels = np.random.default_rng(0), library.labels["lower"]
    centers = rng.normal(size=(labels.max() + 1, 6))[labels]
    lower = centers + 0.3 * rng.normal(size=centers.shape)
    order = np.arange(len(labels)) if is_dependent else rng.permutation(len(labels))
    features = {"lower": lower, "upper": centers[order] + 0.3 * rng.normal(size=lower.shape)}
    monkeypatch.setattr(module, "part_features", lambda _, group: features[group])


def test_compatibility_parts_that_depend_on_cluster_gives_analogy_kappa_one(monkeypatch, library):
    replace_features(monkeypatch, library, is_dependent=True)

    def keep_clusters(library, is_fitted):
        return replace(library, is_donor=library.is_donor & is_fitted)

    monkeypatch.setattr(module, "fit_on", keep_clusters)
    found = compatibility(library, methods=METHODS)
    scores = {score.method: score for score in found.scores}
    assert abs(scores["random"].kappa.value) < 0.15
    # The parts of one cluster have the same distribution.
    assert scores["analogy"].matched.value == pytest.approx(1.0, abs=0.2)
    assert found.difference("analogy", "random").verdict == "above"
    assert found.auc.low > 0.5


def test_compatibility_independent_parts_raises_insufficient_data_error(monkeypatch, library):
    replace_features(monkeypatch, library, is_dependent=False)
    with pytest.raises(InsufficientDataError, match="defined only if"):
        compatibility(library, methods=METHODS)


def test_compatibility_few_donors_raises_insufficient_data_error(library):
    faulty = replace(library, is_donor=np.arange(len(library.segments)) < 30)
    for few in (faulty, Library.build(library.clips[0][:200])):
        with pytest.raises(InsufficientDataError, match="60 segments"):
            compatibility(few, methods=METHODS)


def test_compatibility_shuffled_parts_have_no_difference(monkeypatch, library):
    replace_features(monkeypatch, library, is_dependent=True)
    found = compatibility(library, methods=(*METHODS, Nearest(), Ball()), is_null=True)
    for difference in found.differences:
        assert difference.accepted.low <= 0 <= difference.accepted.high, difference.first


def test_compatibility_bases_donors_and_training_are_disjoint(library):
    groups = fold_groups(library)
    folds = assign_folds(groups, 5, 0)
    for fold in range(5):
        roles = module._Roles.of(folds, fold, library.is_donor)
        parts = [roles.bases, np.flatnonzero(roles.is_library), roles.training]
        joined = np.concatenate(parts)
        assert sorted(joined.tolist()) == np.flatnonzero(library.is_donor).tolist()
        used = [set(groups[part].tolist()) for part in parts]
        assert sum(map(len, used)) == len(set.union(*used))


@few_examples(40)
@given(SEEDS)
def test_kappas_random_rates_equal_definition(seed):
    rng = np.random.default_rng(seed)
    n = 60
    captured, random = rng.uniform(0.5, 1, (3, n)), rng.uniform(0, 0.4, (3, n))
    accepted = rng.uniform(0, 1, (3, n))
    accepted[rng.random((3, n)) < 0.4] = np.nan
    by_method = {"x": accepted, "captured": captured, "random": random}
    kappas = Kappas(captured, random, by_method, np.arange(n) // 5, seed)
    expected = (np.nanmean(accepted) - random.mean()) / (captured.mean() - random.mean())
    assert kappas.kappa("x").value == pytest.approx(expected)
    has_donor = np.isfinite(accepted)
    low, high = random[has_donor].mean(), captured[has_donor].mean()
    matched = (accepted[has_donor].mean() - low) / (high - low)
    assert kappas.kappa("x", is_matched=True).value == pytest.approx(matched)
    assert kappas.kappa("captured").value == pytest.approx(1)
    assert kappas.kappa("random").value == pytest.approx(0)
    found = kappas.difference("x", "random")
    assert found.accepted.value == pytest.approx(accepted[has_donor].mean() - low)
    assert found.kappa.value == pytest.approx(matched)
    assert found.kappa.low <= found.kappa.value <= found.kappa.high
    assert found.kappa.n == kappas.kappa("x").n == has_donor.any(axis=0).sum()
    assert kappas.mean(accepted, "segments").value == pytest.approx(np.nanmean(accepted))


def test_kappas_splits_that_differ_widen_interval():
    rng = np.random.default_rng(0)
    captured, random = np.ones((3, 200)), np.zeros((3, 200))
    equal = np.tile(rng.uniform(0.4, 0.6, 200), (3, 1))
    different = equal + np.array([[-0.3], [0.0], [0.3]])
    blocks = np.arange(200) // 5
    kappas = (Kappas(captured, random, {"x": own}, blocks, 0) for own in (equal, different))
    narrow, wide = (own.kappa("x") for own in kappas)
    assert narrow.value == pytest.approx(wide.value)
    assert wide.low < narrow.low - 0.1
    assert wide.high > narrow.high + 0.1


CLIP = dance(seed=7, strides=1).motion[:300]
LIBRARY = Library.build(CLIP)


def perturb(joints, rng):
    """Return the clip with random rotations of joints, and a random path if the root is one."""
    quats = CLIP.rotations.copy()
    noise = rotations.exp(rng.normal(size=(len(CLIP), len(joints), 3)) * 0.5)
    quats[:, joints] = rotations.multiply(quats[:, joints], noise)
    positions = CLIP.positions.copy()
    if 0 in joints:
        positions[:, 0] += rng.normal(size=(len(CLIP), 3)) * 10
    return replace(CLIP, rotations=quats, positions=positions, channel_values=None)


@settings(max_examples=10)
@given(SEEDS)
def test_part_features_perturbed_group_leaves_other_group_unchanged(seed):
    rng = np.random.default_rng(seed)
    before = {group: part_features(LIBRARY, group) for group in ("lower", "upper")}
    for changed, unchanged in (("upper", "lower"), ("lower", "upper")):
        other = replace(LIBRARY, clips=(perturb(LIBRARY.joints(changed), rng),))
        np.testing.assert_allclose(part_features(other, unchanged), before[unchanged], atol=1e-9)
        assert np.abs(part_features(other, changed) - before[changed]).max() > 1e-3


@settings(max_examples=10)
@given(st.floats(-3, 3), st.floats(-500, 500), st.floats(0.01, 50))
def test_part_features_transformed_motion_are_unchanged(yaw, x, scale):
    other = replace(LIBRARY, clips=(transform_motion(CLIP, scale, yaw, (x, 0.0, -x)),))
    for group in ("lower", "upper"):
        found, expected = part_features(other, group), part_features(LIBRARY, group)
        np.testing.assert_allclose(found, expected, atol=1e-6)


LABELS = st.lists(st.integers(0, 4), min_size=1, max_size=40)


@given(LABELS)
def test_moment_laws_counts_of_clustering_hold(labels):
    counts = {k: count_combinations(np.array(labels), k) for k in (2, 3, 4, 5)}
    assert all(law.holds for law in moment_laws(len(labels), counts))


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda own: sweep(own, groups=(2, 1)), "`groups` must contain numbers of at least 2"),
        (lambda own: sweep(own, ("rms", "mean")), "`readings` must be among .*, got 'mean'"),
        (lambda own: enrichment(own, [1]), "at least 2"),
        (lambda _: moment_laws(3, {2: 0}), "at least 1"),
    ],
)
def test_invalid_arguments_raise_value_error(library, call, message):
    with pytest.raises(ValueError, match=message):
        call(library)


def test_moment_laws_paper_tables_fail_for_five_groups():
    for _, segments, counts in PAPER_TABLES.values():
        failed = {law.name for law in moment_laws(segments, counts) if not law.holds}
        assert "Cauchy-Schwarz: B_3 B_5 >= B_4^2" in failed
    _, segments, counts = PAPER_TABLES["table 2"]
    assert all(law.holds for law in moment_laws(segments, {k: counts[k] for k in (2, 3, 4)}))


def test_enrichment_counts_are_sizes_of_candidate_lists_also_in_a_sweep(library):
    pool = library.pool("upper")
    config = replace(library.config, neighbourhood="cluster")
    candidates = pool.candidate_lists(np.arange(len(library.segments)), config)
    found = enrichment(library)
    for count in found.counts:
        k = count.groups
        assert count.filtered == sum(len(own) ** (k - 1) for own in candidates)
        assert count.unfiltered == count_combinations(library.labels["lower"], k)
        assert count.new == count.filtered - found.segments
    rows = {(row.sigma, row.sigma_scale): row.counts for row in sweep(library)}
    assert rows[library.config.sigma, library.config.sigma_scale] == found.counts
