"""Laws of lists of candidates that are computed when they are read."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mograft.search.candidate_lists import ComputedLists


@given(st.lists(st.integers(0, 4), max_size=30), st.integers(1, 9), st.data())
def test_computed_lists_equal_stored_ones(lengths, block_length, data):
    """For blocks of any length, read in any order; and no more than one block is computed."""
    stored = [np.arange(n) + 10 * position for position, n in enumerate(lengths)]
    computed = []

    def compute(block):
        computed.append(block)
        return stored[block]

    lists = ComputedLists(compute, len(stored), block_length)
    assert len(lists) == len(stored)
    for found, expected in zip(lists, stored, strict=True):
        np.testing.assert_array_equal(found, expected)
    assert len(computed) == -(-len(stored) // block_length)
    np.testing.assert_array_equal(lists.lengths(), lengths)
    assert len(computed) == -(-len(stored) // block_length)
    chosen = data.draw(st.slices(len(stored)))
    for found, expected in zip(lists[chosen], stored[chosen], strict=True):
        np.testing.assert_array_equal(found, expected)
    with pytest.raises(IndexError):
        lists[len(stored)]


def test_lengths_of_computed_lists_that_were_not_read_are_computed():
    lists = ComputedLists(lambda block: [np.arange(i) for i in range(5)][block], 5, 2)
    np.testing.assert_array_equal(lists.lengths(), [0, 1, 2, 3, 4])
