"""A cache of limited size drops its oldest values, and is not copied to other processes."""

import pickle

from hypothesis import given
from hypothesis import strategies as st

from mograft._util.containers import SizedCache

ITEMS = st.lists(st.tuples(st.integers(0, 5), st.integers(0, 40)), max_size=30, unique_by=id)


@given(st.integers(0, 100), ITEMS)
def test_sized_cache_keeps_the_newest_values_within_its_limit(limit, items):
    cache, newest = SizedCache(limit), {}
    for number, (key, size) in enumerate(items):
        if cache.get(key) is None:
            assert cache.put(key, number, size) == number
            newest[key] = number, size
        kept = {key: own for key, own in newest.items() if cache.get(key) == own[0]}
        dropped = newest.keys() - kept.keys()
        assert all(cache.get(own) is None for own in dropped)
        total = sum(size for _, size in kept.values())
        assert total <= limit or len(kept) == 1
        oldest = min((own for own, _ in kept.values()), default=0)
        assert all(newest[own][0] < oldest for own in dropped)
        # The newest of the dropped ones did not fit.
        if dropped:
            again = max(dropped, key=lambda own: newest[own][0])
            assert total + newest[again][1] > limit
        newest = kept
    assert pickle.loads(pickle.dumps(cache)).get(items[0][0] if items else 0) is None
    assert pickle.loads(pickle.dumps(cache)).limit == limit
