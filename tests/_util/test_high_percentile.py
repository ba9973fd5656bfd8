"""Percentiles with rows left out equal those of NumPy for the remaining rows."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from mograft._util import high_percentile
from mograft._util.high_percentile import HighPercentile

MATRICES = hnp.arrays(
    np.float64,
    st.tuples(st.integers(1, 200), st.integers(1, 3)),
    elements=st.one_of(st.integers(0, 3).map(float), st.floats(-1e3, 1e3)),
)


@given(
    MATRICES,
    st.sampled_from([50.0, 90.0, 99.0, 99.9, 100.0]),
    st.lists(st.tuples(st.integers(-9, 210), st.integers(-9, 210)), min_size=1, max_size=4),
    st.integers(0, 250),
    st.data(),
)
def test_percentile_without_rows_equals_that_of_remaining_rows(
    values, percentile, ranges, slack, data
):
    columns = data.draw(st.permutations(range(values.shape[1])))[:2]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(high_percentile, "SLACK", slack)
        found = HighPercentile(values, percentile)
        for first, stop in ranges:
            rows = np.arange(len(values))
            rest = values[(rows < first) | (rows >= stop)][:, columns]
            result = found.without(first, stop, np.array(columns))
            if not len(rest):
                assert result is None
                continue
            np.testing.assert_array_equal(result, np.percentile(rest, percentile, axis=0))


def test_percentile_reads_all_rows_once_however_many_ranges_are_left_out(monkeypatch):
    values = np.random.default_rng(1).random((20_000, 1))
    found = HighPercentile(values, 99.9)
    kept = found.without(0, 0, np.array([0]))
    monkeypatch.setattr(np, "percentile", None)
    monkeypatch.setattr(np, "argpartition", None)
    for first in range(0, 19_000, 500):
        assert found.without(first, first + 1000, np.array([0])) <= values.max()
    np.testing.assert_array_equal(found.without(5, 5, np.array([0])), kept)
