"""Names that patterns select: against the definition, and without work per pair."""

import re
from fnmatch import fnmatchcase

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mograft._util.names import find_matches
from mograft.errors import suggest_frames

NAMES = st.lists(st.text("ab[]*?|", max_size=3), max_size=6)


@given(st.integers(0, 99), st.integers(0, 99), st.integers(1, 60), st.integers(0, 1))
def test_suggest_frames_names_frames_that_exist_nearest_to_those_given(first, n, last, shortest):
    """As many as fit, from the first given one, if that leaves two frames or enough."""
    given_frames = (first, first + n)
    text = suggest_frames(given_frames, last, shortest)
    pattern = r"got ([\d-]+); did you mean (\d+)(?:-(\d+))?\?"
    given_text, start, stop = re.fullmatch(pattern, text).groups()
    start, stop = int(start), int(stop or start)
    assert given_text == (f"{first}-{first + n}" if n else f"{first}")
    assert 0 <= start <= stop <= last
    assert stop - start >= min(max(n, shortest), 1)
    wanted = max(n, shortest)
    is_cut = first + min(wanted, 1) <= last
    ends = (first, min(first + wanted, last)) if is_cut else (max(last - wanted, 0), last)
    assert (start, stop) == ends


@given(known=NAMES, patterns=NAMES)
def test_find_matches_equals_its_definition(known, patterns):
    def selects(pattern, name):
        short = name.rpartition("|")[2]
        matches = fnmatchcase(name, pattern) or fnmatchcase(short, pattern)
        return name == pattern if pattern in known else matches

    missing = [p for p in patterns if not any(selects(p, name) for name in known)]
    if missing:
        with pytest.raises(ValueError, match="`clips` must match at least one of "):
            find_matches("clips", patterns, known)
        return
    expected = [i for i, name in enumerate(known) if any(selects(p, name) for p in patterns)]
    assert find_matches("clips", patterns, known) == expected
    if len(patterns) == 1:
        assert find_matches("clips", patterns[0], known) == expected
