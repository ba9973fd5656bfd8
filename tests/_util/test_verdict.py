"""The verdict on a number: within a range exactly if it lies between its ends."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from mograft._util.verdict import compare, compare_with_most

NUMBERS = st.floats(-1e6, 1e6)


@given(value=NUMBERS, ends=st.tuples(NUMBERS, NUMBERS).map(sorted))
def test_compare_is_within_exactly_between_both_ends(value, ends):
    low, high = ends
    word, *_ = compare(value, low, high).split()
    assert (word == "within") == (low <= value <= high)
    assert (word == "above") == (value > high)
    assert compare(low, low, high).startswith("within ")
    assert compare(high, low, high).startswith("within ")


@given(st.lists(NUMBERS, min_size=1, max_size=60), st.randoms())
def test_compare_with_most_is_within_for_most_steps_in_any_order(steps, random):
    words = [compare_with_most(step, np.array(steps)).split()[0] for step in steps]
    assert words.count("within") >= 0.9 * len(steps) - 2
    assert words.count("above") <= 0.05 * len(steps) + 1
    shuffled = random.sample(steps, len(steps))
    assert compare_with_most(0.0, np.array(shuffled)) == compare_with_most(0.0, np.array(steps))
