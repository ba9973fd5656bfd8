"""Compatibility of parts whose dependence is known."""

from dataclasses import replace

import numpy as np
import pytest

from lab.donors import classifier, held_out
from lab.donors import compatibility as module
from lab.donors.compatibility import compatibility
from lab.donors.donor_methods import RandomLength
from lab.donors.held_out import fold_groups
from lab.donors.methods import Analogy, Ball, ByCost, Captured, Nearest, Random
from mograft import InsufficientDataError, Library
from mograft.evaluation.detectability import assign_folds

METHODS = (Random(), RandomLength(), Analogy())


@pytest.fixture
def library(single_clip_library):
    return single_clip_library


@pytest.fixture(autouse=True)
def two_parameters(monkeypatch):
    monkeypatch.setattr(classifier, "PARAMETER_GRID", {"C": (1.0, 10.0), "gamma": (0.03,)})


def replace_features(monkeypatch, library, *, is_dependent):
    """Replace the features by noise around one point for each cluster of the base parts.

    The features of the upper part are around the same point as those of its lower part, or
    around that of a random segment.
    """
    rng = np.random.default_rng(0)
    labels = library.labels["lower"]
    centers = rng.normal(size=(labels.max() + 1, 6))
    n = len(labels)
    lower = centers[labels] + 0.3 * rng.normal(size=(n, 6))
    order = np.arange(n) if is_dependent else rng.permutation(n)
    upper = centers[labels][order] + 0.3 * rng.normal(size=(n, 6))
    features = {"lower": lower, "upper": upper}
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
    assert found.auc.value > 0.75
    assert found.auc.low > 0.5


def test_compatibility_independent_parts_raises_insufficient_data_error(monkeypatch, library):
    replace_features(monkeypatch, library, is_dependent=False)
    with pytest.raises(InsufficientDataError, match="defined only if"):
        compatibility(library, methods=METHODS)


def test_compatibility_same_seed_gives_same_numbers(monkeypatch, library):
    replace_features(monkeypatch, library, is_dependent=True)
    methods = (*METHODS, ByCost())
    first, second = (compatibility(library, methods=methods, seed=4).as_dict() for _ in range(2))
    assert first == second
    names = [score["method"] for score in first["scores"]]
    assert names == ["random", "random, length limit", "analogy", "analogy, by cost"]


def test_compatibility_method_without_exchanges_has_no_score(monkeypatch, library):
    replace_features(monkeypatch, library, is_dependent=True)
    found = compatibility(library, methods=(Random(), Captured()))
    score = found.scores[1]
    assert score.exchangeable == 0
    assert score.kappa.n == 0
    assert score.as_dict()["kappa"]["value"] is None
    assert found.difference("captured", "random").verdict == "undecided"
    with pytest.raises(KeyError, match="difference random minus wings was not computed"):
        found.difference("random", "wings")


def test_compatibility_few_segments_raises_insufficient_data_error(library):
    with pytest.raises(InsufficientDataError, match="60 segments"):
        compatibility(Library.build(library.clips[0][:200]), methods=METHODS)


def test_compatibility_few_donors_raises_insufficient_data_error(library):
    faulty = replace(library, is_donor=np.arange(len(library.segments)) < 30)
    with pytest.raises(InsufficientDataError, match="60 segments"):
        compatibility(faulty, methods=METHODS)


def test_compatibility_invalid_arguments_raise_value_error(library):
    with pytest.raises(ValueError, match="`group` must be one of upper, got 'wings'"):
        compatibility(library, "wings")
    with pytest.raises(ValueError, match="`group` must be one of upper, got 'lower'"):
        compatibility(library, "lower", METHODS)


def test_compatibility_single_block_raises_insufficient_data_error(monkeypatch, library):
    monkeypatch.setattr(held_out, "GROUP_SEGMENTS", 100_000)
    with pytest.raises(InsufficientDataError, match=r"at least 3 clips or blocks of .* got 1"):
        compatibility(library, methods=METHODS)


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
