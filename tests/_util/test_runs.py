"""Properties of runs of marked positions."""

from itertools import groupby

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from mograft._util.runs import dilate, find_runs

MASKS = st.lists(st.booleans(), max_size=30).map(lambda marks: np.array(marks, bool))


@given(MASKS)
def test_find_runs_matches_itertools_groupby(mask):
    groups = [(value, len(list(run))) for value, run in groupby(mask.tolist())]
    stops = np.cumsum([length for _, length in groups], dtype=int)
    expected = [
        [stop - length, stop]
        for (value, length), stop in zip(groups, stops.tolist(), strict=True)
        if value
    ]
    assert find_runs(mask).tolist() == expected


@given(MASKS, st.integers(0, 4))
def test_dilate_marks_positions_within_the_distance(mask, steps):
    marked = np.flatnonzero(mask)
    expected = [bool((np.abs(marked - i) <= steps).any()) for i in range(len(mask))]
    before = mask.copy()
    assert dilate(mask, steps).tolist() == expected
    np.testing.assert_array_equal(mask, before)
