"""Libraries that are fitted on some segments, against libraries of these segments."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given

from lab.donors.held_out import GROUP_SEGMENTS, fit_on, fold_groups, shuffle_parts
from mograft import Library
from tests.strategies import SEEDS, few_examples


def test_fit_on_all_clips_but_one_equals_library_with_appended_clip(library):
    held = library.segments.clip == 1
    fitted = fit_on(library, ~held)
    expected = Library.build(library.clips[0]).with_clip(library.clips[1])
    for group in library.groups.names:
        points, other = (own.embedding[group].points for own in (fitted, expected))
        np.testing.assert_allclose(points, other, atol=1e-4)
        np.testing.assert_array_equal(fitted.labels[group], expected.labels[group])
        assert fitted.sigma[group] == pytest.approx(expected.sigma[group], rel=1e-5)
    np.testing.assert_array_equal(fitted.is_donor, expected.is_donor)


def test_fit_on_interleaved_segments_ignores_the_others(library):
    is_fitted = np.arange(len(library.segments)) % 3 != 0
    fitted = fit_on(library, is_fitted)
    rows = library.samples.rows.copy()
    rows[~is_fitted] = rows[~is_fitted][::-1]
    changed = fit_on(replace(library, samples=replace(library.samples, rows=rows)), is_fitted)
    for group in library.groups.names:
        found, expected = changed.embedding[group].points, fitted.embedding[group].points
        np.testing.assert_array_equal(found[is_fitted], expected[is_fitted])
        np.testing.assert_array_equal(found[~is_fitted], expected[~is_fitted][::-1])
        assert changed.sigma[group] == fitted.sigma[group]


@few_examples(30)
@given(SEEDS)
def test_shuffle_parts_permutes_donors_within_groups(seed):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 60))
    groups, is_donor = rng.integers(0, 5, n), rng.random(n) < 0.8
    for within in (None, groups):
        shuffled = shuffle_parts(is_donor, rng, within)
        assert sorted(shuffled.tolist()) == list(range(n))
        np.testing.assert_array_equal(shuffled[~is_donor], np.flatnonzero(~is_donor))
    np.testing.assert_array_equal(groups[shuffled], groups)


def test_fold_groups_few_clips_has_blocks_of_neighbours(single_clip_library):
    sizes = np.bincount(fold_groups(single_clip_library))
    assert (sizes[:-1] == GROUP_SEGMENTS).all()
