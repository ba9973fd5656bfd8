"""The automatic scale of the threshold: planted repetitions, bounds, and libraries."""

import json
import warnings
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mograft import Config, Library, graft, repair
from mograft.analysis import scale_choice
from mograft.analysis.embedding import Embedding
from mograft.analysis.scale_choice import (
    MIN_SEGMENTS,
    SCALES,
    TOLERANCE,
    cluster_thresholds,
    scale_curve,
    scale_of_threshold,
)
from mograft.clustering import cut
from mograft.constraints import Reach
from mograft.dancer import dance
from tests.strategies import SEEDS, few_examples

AUTO = Config(sigma_scale="auto")


def embedding(points):
    """An embedding of which only the points matter."""
    return Embedding(
        points=points,
        joints=np.arange(1),
        has_root=False,
        reference=np.zeros((1, 4)),
        mean=np.zeros(1),
        scale=np.ones(1),
        components=np.ones((1, 1)),
        variances=np.ones(1),
    )


def repetitions(seed, noise, n_patterns=12, n_repeats=40, n_axes=8):
    """Patterns that are repeated in random order, apart from noise; the pattern of each row."""
    rng = np.random.default_rng(seed)
    pattern = rng.permutation(np.repeat(np.arange(n_patterns), n_repeats))
    parts = {}
    for group in ("lower", "upper"):
        centres = rng.normal(size=(n_patterns, n_axes))
        rows = centres[pattern] + noise * rng.normal(size=(len(pattern), n_axes))
        parts[group] = embedding(rows)
    return parts, pattern


def brute_curve(parts, group, scales, rows=None):
    """The errors and the repetition error, pair by pair; only `rows` are clustered."""
    own, n = parts[group].points, len(parts[group].points)
    rows = np.arange(n) if rows is None else rows
    others = [known.points for name, known in parts.items() if name != group]

    def error(i, j):
        return np.mean(
            [((x[i] - x[j]) ** 2).sum() / (2 * x.var(axis=0, ddof=1).sum()) for x in others]
        )

    spread = np.sqrt(((own - own.mean(axis=0)) ** 2).sum(axis=1).mean())
    errors = []
    for scale in scales:
        labels = cut(own[rows], scale * spread)
        means = []
        for i, label in zip(rows, labels, strict=True):
            members = [j for j in rows[labels == label] if j != i]
            if members:
                means.append(np.mean([error(i, j) for j in members]))
        errors.append(np.mean(means) if means else np.nan)
    nearest = [
        min((j for j in range(n) if abs(i - j) > 1), key=lambda j: ((own[i] - own[j]) ** 2).sum())
        for i in rows
    ]
    return errors, np.mean([error(i, j) for i, j in zip(rows, nearest, strict=True)])


@few_examples(5)
@given(SEEDS, st.integers(1, 3))
def test_scale_curve_equals_pairwise_oracle(seed, n_others):
    rng = np.random.default_rng(seed)
    parts = {
        str(k): embedding(rng.normal(size=(24, 3)).cumsum(axis=0)) for k in range(n_others + 1)
    }
    found = scale_curve(parts, "0", Config())
    errors, repetition = brute_curve(parts, "0", SCALES[::6])
    np.testing.assert_allclose(found.errors[::6], errors, rtol=1e-9)
    np.testing.assert_allclose(found.repetition_error, repetition, rtol=1e-9)


@few_examples(5)
@given(SEEDS, st.integers(5, 40), st.integers(1, 50))
def test_scale_curve_clusters_some_of_many_segments_and_searches_repetitions_in_all(
    seed, max_segments, chunk
):
    rng = np.random.default_rng(seed)
    parts = {name: embedding(rng.normal(size=(70, 3)).cumsum(axis=0)) for name in "ab"}
    parts["a"].points[-1] = parts["a"].points[0] + 1e-3  # neither is next to the other in time
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(scale_choice, "_MAX_SEGMENTS", max_segments)
        patch.setattr(scale_choice, "_CHUNK", chunk)
        found = scale_curve(parts, "a", Config())
    rows = np.unique(np.linspace(0, 69, max_segments).round().astype(int))
    errors, repetition = brute_curve(parts, "a", SCALES[::9], rows)
    np.testing.assert_allclose(found.errors[::9], errors, rtol=1e-9)
    np.testing.assert_allclose(found.repetition_error, repetition, rtol=1e-9)


@few_examples(15)
@given(SEEDS, st.floats(0.02, 0.08))
def test_scale_of_planted_repetitions_gives_planted_clusters(seed, noise):
    parts, pattern = repetitions(seed, noise)
    curve = scale_curve(parts, "lower", AUTO)
    sigma = cluster_thresholds(parts, AUTO)["lower"]
    labels = cut(parts["lower"].points, sigma)
    # Clusters hold one pattern each, and the next scales either the same or several.
    for label in range(labels.max() + 1):
        assert len(set(pattern[labels == label])) == 1
    assert labels.max() + 1 == len(set(pattern))
    larger = curve.errors[curve.scale < SCALES]
    assert (larger > curve.limit).all()


@few_examples(15)
@given(SEEDS, st.integers(MIN_SEGMENTS, 60), st.integers(2, 4))
def test_scale_is_a_tried_scale_and_the_largest_within_the_limit(seed, n, n_groups):
    rng = np.random.default_rng(seed)
    parts = {
        str(k): embedding(rng.normal(size=(n, 3)) * rng.uniform(0.1, 10)) for k in range(n_groups)
    }
    thresholds = cluster_thresholds(parts, AUTO)
    for group in parts:
        curve = scale_curve(parts, group, AUTO)
        assert SCALES[0] <= curve.scale <= SCALES[-1]
        np.testing.assert_allclose(curve.limit, (1 + TOLERANCE) * curve.repetition_error)
        for tolerance in (0.0, TOLERANCE, 0.5):
            within = curve.errors <= (1 + tolerance) * curve.repetition_error
            expected = SCALES[within][-1] if within.any() else SCALES[0]
            assert curve.scale_at(tolerance) == expected
        assert curve.scale == curve.scale_at(TOLERANCE)
        assert scale_of_threshold(parts[group], thresholds[group], AUTO) == curve.scale
    assert thresholds == cluster_thresholds(parts, AUTO)


@few_examples(10)
@given(SEEDS, st.integers(-6, 6))
def test_scale_unit_of_held_out_parts_does_not_matter(seed, exponent):
    parts, _ = repetitions(seed, 0.05, n_patterns=5, n_repeats=8)
    scaled = parts | {"upper": embedding(2.0**exponent * parts["upper"].points)}
    expected, found = (scale_curve(own, "lower", AUTO) for own in (parts, scaled))
    np.testing.assert_allclose(found.errors, expected.errors, rtol=1e-9)
    assert found.scale == expected.scale


@pytest.mark.parametrize(
    ("parts", "reason"),
    [
        ({"lower": 19, "upper": 19}, "19 segments are fewer than 20"),
        ({"lower": 40}, "no other group can be compared"),
        ({"lower": 40, "upper": None}, "no other group can be compared"),
    ],
)
def test_scale_that_cannot_be_chosen_warns_and_is_the_default(parts, reason):
    rng = np.random.default_rng(0)
    known = {
        name: None if n is None else embedding(rng.normal(size=(n, 3))) for name, n in parts.items()
    }
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        found = cluster_thresholds(known, AUTO)
    assert str(caught[0].message) == (
        f"group lower: sigma_scale cannot be chosen, because {reason}; 0.75 is used"
    )
    assert len(caught) == sum(n is not None for n in parts.values())
    assert found["lower"] == cluster_thresholds(known, Config())["lower"]


def test_threshold_given_as_number_has_priority_over_automatic_scale():
    parts, _ = repetitions(0, 0.1)
    assert set(cluster_thresholds(parts, replace(AUTO, sigma=2.5)).values()) == {2.5}


@pytest.fixture(scope="module")
def library():
    return Library.build(dance(seed=1, strides=1).motion, config=AUTO)


def test_library_remembers_scales_and_json_keeps_auto(library, tmp_path):
    library.save(tmp_path / "lib")
    opened = Library.open(tmp_path / "lib")
    assert opened.config == AUTO == Config.from_dict(json.loads(json.dumps(AUTO.as_dict())))
    assert opened.sigma == library.sigma
    assert opened.sigma_scales == library.sigma_scales
    assert set(library.sigma_scales) == {"lower", "upper"}
    fixed = library.relabelled(Config())
    assert fixed.sigma_scales == {"lower": 0.75, "upper": 0.75}
    again = fixed.relabelled(AUTO)
    assert again.sigma == library.sigma
    for group in library.labels:
        scale = library.sigma_scales[group]
        by_number = library.relabelled(Config(sigma_scale=scale))
        np.testing.assert_array_equal(by_number.labels[group], library.labels[group])


def test_library_with_automatic_scale_grafts_and_repairs(library):
    new = graft(library, seed=1)
    assert new.library.config.sigma_scale == "auto"
    out_of_reach = Reach("LeftHand", (1e4, 0.0, 0.0), 40)
    wider = repair(library, constraints=[out_of_reach], widest=2.0)
    assert wider.motion.n_frames == new.motion.n_frames
    assert wider.violations


@pytest.mark.parametrize("value", ["big", "", "AUTO", "0.75"])
def test_config_invalid_scale_word_raises_value_error(value):
    with pytest.raises(ValueError, match="`sigma_scale` must be a number above 0 or 'auto', got"):
        Config(sigma_scale=value)


@pytest.mark.parametrize("value", [0, -1.0, float("nan"), True, None])
def test_config_invalid_scale_number_raises_value_error(value):
    with pytest.raises(ValueError, match="`sigma_scale` must be"):
        Config(sigma_scale=value)
