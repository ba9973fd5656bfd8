"""A cache of limited size drops its oldest values, and is not copied to other processes."""

import pickle

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mograft._util.containers import SizedCache

ITEMS = st.lists(st.tuples(st.integers(0, 5), st.integers(0, 40)), max_size=30, unique_by=id)


@pytest.mark.parametrize("minimum", [1, 2])
@given(limit=st.integers(0, 100), items=ITEMS)
def test_sized_cache_keeps_the_newest_values_within_its_limit(minimum, limit, items):
    """A value that is stored again becomes the newest."""
    cache, stored = SizedCache(limit, minimum), []
    for number, (key, size) in enumerate(items):
        assert cache.put(key, number, size) == number
        stored = [own for own in stored if own[0] != key] + [(key, number, size)]
        while len(stored) > minimum and sum(size for *_, size in stored) > limit:
            del stored[0]
        expected = {key: number for key, number, _ in stored}
        assert [cache.get(key) for key in range(6)] == [*map(expected.get, range(6))]
    copy = pickle.loads(pickle.dumps(cache))
    assert (copy.get(0), copy.limit, copy.minimum) == (None, limit, minimum)
