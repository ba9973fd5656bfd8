"""Texts of JSON and TOML: the content, or a ValueError for what Python cannot handle."""

import json
import sys

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mograft._util.documents import MAX_LEVELS, MAX_TOML_CHARACTERS, parse_document

DOCUMENTS = st.recursive(
    st.none() | st.booleans() | st.integers(-(10**30), 10**30) | st.floats(allow_nan=False)
    | st.text(max_size=3),
    lambda own: st.lists(own, max_size=3) | st.dictionaries(st.text(max_size=3), own, max_size=3),
)  # fmt: skip


@given(DOCUMENTS)
def test_parse_document_equals_json_loads(document):
    text = json.dumps(document)
    assert parse_document(text) == parse_document(text.encode()) == document


@given(st.integers(1, 20_000), st.sampled_from(["JSON", "TOML", "keys", "tables"]))
def test_parse_document_any_depth_is_content_or_valueerror(depth, kind):
    text = {
        "JSON": "[" * depth + "]" * depth,
        "TOML": f"a = {'[' * depth}{']' * depth}",
        "keys": f"{'.'.join('a' * depth)} = 1",
        "tables": f"[{'.'.join('a' * depth)}]",
    }[kind]
    if depth < MAX_LEVELS:
        assert repr(parse_document(text, "JSON" if kind == "JSON" else "TOML"))
    else:
        with pytest.raises(ValueError, match="expected at most 100 levels, got more"):
            parse_document(text, "JSON" if kind == "JSON" else "TOML")


@given(st.integers(290, 4_200), st.sampled_from(["", "-"]))
def test_parse_document_integer_fits_a_float_or_raises(n_digits, sign):
    text = f'{{"a": [{sign}{"9" * n_digits}]}}'
    if n_digits > 300:
        with pytest.raises(ValueError, match="at most 300 digits"):
            parse_document(text)
    else:
        assert abs(float(parse_document(text)["a"][0])) < sys.float_info.max


@given(st.integers(101, 100_000), st.sampled_from([".", " . ", '".', "-."]))
def test_parse_document_long_key_is_refused_before_it_is_parsed(depth, separator):
    # Python needs minutes for 100,000 levels.
    with pytest.raises(ValueError, match="expected at most 100 levels, got more"):
        parse_document(separator.join("a" * depth) + " = 1", "TOML")


def test_parse_document_long_toml_raises():
    with pytest.raises(ValueError, match="at most 1048576 characters"):
        parse_document("#" * (MAX_TOML_CHARACTERS + 1), "TOML")
