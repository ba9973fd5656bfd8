"""Copies of training clips, and the comparison of classifiers that learn from them."""

import numpy as np
import pytest
from scipy.stats import ttest_1samp

from lab.baselines.augmentation import N_COPIES, SCHEMES, LabelledClips, swap_sides
from lab.experiments import learning
from lab.measures.clip_features import clip_features
from mograft import mirror, rotations
from mograft.dancer import dance
from tests.strategies import transform_motion


@pytest.fixture(scope="module")
def labelled_clips():
    """Eight clips of two dancers: those of one label are slow, those of the other fast."""
    clips = [take.motion for take in dance(seed=3, strides=1).takes(8)]
    return LabelledClips(tuple(clips), np.array(["wave-left-hand", "run"] * 4))


@pytest.mark.parametrize("name", SCHEMES)
def test_scheme_adds_copies_of_every_clip_with_its_label(labelled_clips, name):
    added = SCHEMES[name](labelled_clips, np.random.default_rng(0))
    n = 0 if name == "none" else N_COPIES * len(labelled_clips)
    assert len(added) == len(added.labels) == n
    if name == "mirror and noise":
        assert list(added.labels[: len(labelled_clips)]) == ["wave-right-hand", "run"] * 4
    else:
        assert sorted(added.labels) == sorted([*labelled_clips.labels] * (n // len(labelled_clips)))


@pytest.mark.parametrize("name", ["CutMix", "CutMix, same label", "grafts", "grafts, same label"])
def test_scheme_keeps_legs_and_label_and_changes_the_arms(labelled_clips, name):
    added = SCHEMES[name](labelled_clips, np.random.default_rng(0))
    pairs = zip(labelled_clips.clips, labelled_clips.labels, strict=True)
    originals = {clip.rotations[:, 0].tobytes(): (clip, label) for clip, label in pairs}
    changes = []
    for clip, label in zip(added.clips, added.labels, strict=True):
        base, expected = originals[clip.rotations[:, 0].tobytes()]
        assert label == expected
        changes.append(rotations.angle(clip.rotations, base.rotations).max())
    assert np.median(changes) > 0.2


def test_swap_sides_is_an_involution():
    for label in ("walk", "wave-left-hand", "walk-turn-right", "raise-up-both-hands"):
        assert swap_sides(swap_sides(label)) == label
    assert swap_sides("walk-turn-right") == "walk-turn-left"


def test_clip_features_do_not_depend_on_place_and_heading(labelled_clips):
    clip = labelled_clips.clips[0]
    moved = transform_motion(clip, yaw=1.0, offset=(50.0, 0.0, 0.0))
    np.testing.assert_allclose(clip_features(moved), clip_features(clip), atol=1e-6)
    assert np.abs(clip_features(mirror(clip)) - clip_features(clip)).max() > 0.01


def test_run_share_finds_planted_gain_and_no_gain_of_nothing(monkeypatch):
    """Training clips of one class are few and atypical; one scheme adds typical ones."""
    rng = np.random.default_rng(0)

    def draw(n, shift):
        labels = np.array(["a", "b"] * (n // 2))
        rows = (labels == "b")[:, None] + shift + rng.normal(0, 0.6, (n, 6))
        return LabelledClips(tuple(map(tuple, rows)), labels)

    pool, test = draw(200, 0.8), draw(200, 0.0)
    monkeypatch.setattr(learning.clip_features, "clip_features", np.array)
    learning._captured_features.cache_clear()
    schemes = {name: SCHEMES[name] for name in ("none", "repeated")}
    schemes["planted"] = lambda train, own: draw(2 * len(train), 0.0)  # noqa: ARG005
    found = learning.run_share(lambda seed: (pool, test), 0.1, 5, schemes)  # noqa: ARG005
    learning._captured_features.cache_clear()
    assert (found["train"], found["test"]) == (20, 200)
    for scores in found["scores"].values():
        assert learning.differences(scores, "planted")["interval"][0] > 0.05
        assert abs(learning.differences(scores, "none")["value"]) < 0.1
        assert learning.differences(scores, "repeated")["value"] == 0


def test_split_actions_tests_on_one_performer_only(labelled_clips):
    groups = np.array([0, 0, 0, 1, 1, 1, 2, 2])
    for seed in range(6):
        pool, test = learning.split_actions(labelled_clips, groups, seed)
        own = {groups[k] for k, clip in enumerate(labelled_clips.clips) if clip in test.clips}
        assert own == {seed % 3}
        assert len(pool) + len(test) == len(labelled_clips)


def test_mean_estimate_interval_is_students():
    values = np.random.default_rng(0).normal(size=10)
    expected = ttest_1samp(values, 0).confidence_interval(0.95)
    assert learning.mean_estimate(values)["interval"] == pytest.approx([*expected])
