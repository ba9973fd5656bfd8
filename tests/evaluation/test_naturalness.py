"""Compatibility: on parts whose dependence is known, and on features that leak nothing."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mograft import InsufficientDataError, Library
from mograft.dancer import dance
from mograft.evaluation import naturalness
from mograft.evaluation.baselines import Analogy, ByCost, Captured, Random, RandomLength
from mograft.evaluation.naturalness import (
    _Kappas,
    _split,
    compatibility,
    fold_groups,
    part_features,
)
from mograft.motion import rotations
from tests.evaluation.test_balance import moved
from tests.strategies import SEEDS

pytest.importorskip("sklearn", reason="scikit-learn is not installed")

WAYS = (Random(), RandomLength(), Analogy())


@pytest.fixture(scope="module")
def library():
    return Library.build(dance(seed=7, strides=1).motion)


@pytest.fixture(autouse=True)
def few_parameters(monkeypatch):
    """The search over 25 pairs of parameters is scikit-learn's and takes most of the time."""
    monkeypatch.setattr(naturalness, "_GRID", {"C": (1.0, 10.0), "gamma": (0.03,)})


def made_up(monkeypatch, library, depends, noise=0.3, seed=0):
    """Features of two parts: of each cluster a place, the upper's that of the lower if wanted."""
    rng = np.random.default_rng(seed)
    labels = library.labels["lower"]
    places = rng.normal(size=(labels.max() + 1, 6))
    n = len(labels)
    lower = places[labels] + noise * rng.normal(size=(n, 6))
    order = np.arange(n) if depends else rng.permutation(n)
    upper = places[labels][order] + noise * rng.normal(size=(n, 6))
    known = {"lower": lower, "upper": upper}
    monkeypatch.setattr(naturalness, "part_features", lambda _, group: known[group])


def test_parts_that_go_by_their_clusters_go_with_their_mates(monkeypatch, library):
    made_up(monkeypatch, library, depends=True)
    own = compatibility(library, ways=WAYS)
    scores = {score.method: score for score in own.scores}
    assert abs(scores["random"].kappa.value) < 0.15
    # A mate's part is drawn as its own is: no classifier can tell them apart.
    assert scores["analogy"].matched.value == pytest.approx(1.0, abs=0.2)
    assert own.difference("analogy", "random").verdict == "above"
    assert own.auc.value > 0.75
    assert own.auc.low > 0.5


def test_parts_that_do_not_depend_on_each_other_are_refused(monkeypatch, library):
    made_up(monkeypatch, library, depends=False)
    with pytest.raises(InsufficientDataError, match="no meaning"):
        compatibility(library, ways=WAYS)


def test_the_same_seed_gives_the_same_numbers(monkeypatch, library):
    made_up(monkeypatch, library, depends=True)
    several = [compatibility(library, ways=(*WAYS, ByCost()), seed=4).as_dict() for _ in range(2)]
    assert several[0] == several[1]
    names = [score["method"] for score in several[0]["scores"]]
    assert names == ["random", "random, length limit", "analogy", "analogy, by cost"]


def test_a_way_that_exchanges_nothing_has_no_score(monkeypatch, library):
    made_up(monkeypatch, library, depends=True)
    own = compatibility(library, ways=(Random(), Captured()))
    score = own.scores[1]
    assert score.exchangeable == 0
    assert score.kappa.n == 0
    assert score.as_dict()["kappa"]["value"] is None
    assert own.difference("captured", "random").verdict == "undecided"
    with pytest.raises(KeyError, match="not compared"):
        own.difference("random", "wings")


def test_too_little_is_refused(library):
    with pytest.raises(InsufficientDataError, match="60 segments"):
        compatibility(Library.build(library.clips[0][:200]), ways=WAYS)
    with pytest.raises(ValueError, match="must not be the base"):
        compatibility(library, "lower", WAYS)
    faulty = replace(library, is_donor=np.arange(len(library.segments)) < 30)
    with pytest.raises(InsufficientDataError, match="60 segments"):
        compatibility(faulty, ways=WAYS)


def test_a_single_block_is_refused(monkeypatch, library):
    monkeypatch.setattr(naturalness, "_BLOCK", 100_000)
    with pytest.raises(InsufficientDataError, match="there is one"):
        compatibility(library, ways=WAYS)


@given(st.lists(st.integers(1, 30), min_size=1, max_size=30), st.integers(1, 6), SEEDS)
def test_folds_hold_whole_groups_of_about_equal_size(sizes, n_folds, seed):
    together = np.repeat(np.arange(len(sizes)), sizes)
    folds = _split(together, n_folds, seed)
    for group in range(len(sizes)):
        assert len(set(folds[together == group].tolist())) == 1
    counts = np.bincount(folds)
    assert len(counts) == min(n_folds, len(sizes))
    assert counts.min() > 0
    assert counts.max() - counts.min() <= max(sizes)
    np.testing.assert_array_equal(folds, _split(together, n_folds, seed))


def test_fold_groups_are_blocks_of_forty_neighbours(library):
    sizes = np.bincount(fold_groups(library))
    assert sizes.max() == 40
    assert (sizes[:-1] == 40).all()


@settings(max_examples=10)
@given(SEEDS)
def test_features_of_a_part_know_nothing_of_the_other(seed):
    rng = np.random.default_rng(seed)
    clip = dance(seed=7, strides=1).motion[:300]
    own = Library.build(clip)
    lower, upper = (own.joints(group) for group in ("lower", "upper"))
    before = {group: part_features(own, group) for group in ("lower", "upper")}

    def shaken(joints):
        quats = clip.rotations.copy()
        turns = rotations.exp(rng.normal(size=(len(clip), len(joints), 3)) * 0.5)
        quats[:, joints] = rotations.multiply(quats[:, joints], turns)
        places = clip.positions.copy()
        if 0 in joints:
            places[:, 0] += rng.normal(size=(len(clip), 3)) * 10
        return replace(clip, rotations=quats, positions=places, channel_values=None)

    # The same segments of another recording.
    other = replace(own, clips=(shaken(upper),))
    np.testing.assert_allclose(part_features(other, "lower"), before["lower"], atol=1e-9)
    assert np.abs(part_features(other, "upper") - before["upper"]).max() > 1e-3
    other = replace(own, clips=(shaken(lower),))
    np.testing.assert_allclose(part_features(other, "upper"), before["upper"], atol=1e-9)
    assert np.abs(part_features(other, "lower") - before["lower"]).max() > 1e-3


@settings(max_examples=10)
@given(st.floats(-3, 3), st.floats(-500, 500), st.floats(0.01, 50))
def test_features_know_no_heading_place_or_scale(turn, x, scale):
    clip = dance(seed=7, strides=1).motion[:300]
    own = Library.build(clip)
    other = replace(own, clips=(moved(clip, scale, turn, (x, 0.0, -x)),))
    for group in ("lower", "upper"):
        np.testing.assert_allclose(
            part_features(other, group), part_features(own, group), atol=1e-6
        )


@given(SEEDS)
def test_kappa_is_what_its_definition_says(seed):
    rng = np.random.default_rng(seed)
    n = 60
    real, random = rng.uniform(0.5, 1, (3, n)), rng.uniform(0, 0.4, (3, n))
    way = rng.uniform(0, 1, (3, n))
    way[rng.random((3, n)) < 0.4] = np.nan
    own = _Kappas(real, random, {"x": way, "y": real, "z": random}, np.arange(n) // 5, seed)
    whole = (np.nanmean(way) - random.mean()) / (real.mean() - random.mean())
    assert own.of("x").value == pytest.approx(whole)
    has = np.isfinite(way)
    matched = (way[has].mean() - random[has].mean()) / (real[has].mean() - random[has].mean())
    assert own.of("x", matched=True).value == pytest.approx(matched)
    assert own.of("y").value == pytest.approx(1)
    assert own.of("z").value == pytest.approx(0)
    gap = own.difference("x", "z").kappa
    assert gap.value == pytest.approx(whole)
    assert gap.low <= gap.value <= gap.high
    assert own.of("x").n == int(has.any(axis=0).sum())
    assert own.mean(way, "y").value == pytest.approx(np.nanmean(way))


def test_splits_that_disagree_widen_the_interval():
    rng = np.random.default_rng(0)
    real, random = np.ones((3, 200)), np.zeros((3, 200))
    way = np.tile(rng.uniform(0.4, 0.6, 200), (3, 1))
    block = np.arange(200) // 5
    apart = way + np.array([[-0.3], [0.0], [0.3]])
    one, two = (_Kappas(real, random, {"x": own}, block, 0).of("x") for own in (way, apart))
    assert one.value == pytest.approx(two.value)
    assert two.low < one.low - 0.1
    assert two.high > one.high + 0.1
