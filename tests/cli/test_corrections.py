"""Values of options with a typical mistake: the error ends with the value that was meant."""

import re
from argparse import ArgumentTypeError

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mograft.cli.syntax.arguments import arguments_of
from mograft.cli.syntax.options import GraftOptions
from tests.strategies import few_examples

VALUES = {own.dest: own.value for own in arguments_of(GraftOptions) if own.value}
VALUES = {name: value for name, value in VALUES.items() if value.has_parts}
VALID = {
    "reach": ["{a}:LeftHand:0,90,4", "{a}-{b}:LeftHand:@chest+0,0.1,0.4", "{a}s:LeftHand:1,2,3"],
    "avoid": ["sphere:0,90,0,20", "sphere:0,90,0,20@{a}-{b}", "box:0,1,2,3,4,5@{a}s-{b}s"],
    "face": ["0,90,4", "0,90,4@{a}-{b}", "0,90,4@{a}s-{b}s"],
    "change": ["upper@{a}-{b}", "upper@{a}s-{b}s", "upper@{a}-{b}=wave", "larm@{a}-{b}=wave:5-9"],
    "keep": ["{a}-{b}", "{a}s-{b}s"],
    "take": ["{a}=wave:5-9", "{a}=wave:{a}-{b}"],
    "ban": ["{a}=wave", "{a}=wave:5-9"],
}
"""Templates of valid values of each option; b is above a."""

MISTAKES = [
    (("avoid", "change", "keep", "take"), "swapped range", r"(\d+s?)-(\d+s?)$", r"\2-\1"),
    (("reach",), "swapped range", r"^(\d+)-(\d+)", r"\2-\1"),
    (("avoid", "face", "change", "keep"), "dots", r"(\d)-(\d)", r"\1..\2"),
    (("avoid", "face", "change", "keep"), "the word to", r"(\ds?)-(\d)", r"\1 to \2"),
    (("reach", "face", "change", "keep"), "long unit", r"(\d)s\b", r"\1sec"),
    (("reach", "avoid", "face"), "semicolons", r",", ";"),
    (("reach", "avoid", "face"), "blanks", r",", " "),
    (("reach", "take"), "wrong mark", r"^(\d+)[:=]", r"\1@"),
    (("reach",), "swapped parts", r"^(\d+s?):LeftHand:", r"LeftHand:\1:"),
    (("reach",), "missing colon", r"^(\d+):LeftHand", r"\1LeftHand"),
    (("change",), "colon", r"^(\w+)@", r"\1:"),
    (("change",), "missing @", r"^(\w+)@", r"\1"),
    (("take",), "@ of donor", r":(\d+)-(\d+)$", r" \1-\2"),
    (("change",), "swapped parts", r"^(\w+)@(\d+s?-\d+s?)$", r"\2@\1"),
    (("avoid",), "equals", r"^(\w+):", r"\1="),
    (("take",), "donor first", r"^(\d+)=(wave:5-9)$", r"\2=\1"),
    (("change",), "group second", r"^(\w+)@(\d+-\d+)=(\w+)$", r"\2:\1=\3"),
    (("reach",), "colon of a part", r":@(\w+)\+", r":@\1:"),
]
"""Options, a name, and the pattern and replacement that make the mistake."""


@pytest.mark.parametrize("mistake", MISTAKES, ids=[f"{own[0][0]} {own[1]}" for own in MISTAKES])
@few_examples(20)
@given(st.data())
def test_typical_mistake_is_refused_with_the_value_that_was_meant(mistake, data):
    options, _, pattern, replacement = mistake
    option = data.draw(st.sampled_from(options))
    first = data.draw(st.integers(10, 300))
    template = data.draw(
        st.sampled_from([own for own in VALID[option] if re.search(pattern, filled(own, 10, 20))])
    )
    meant = filled(template, first, first + data.draw(st.integers(1, 300)))
    given_text = re.sub(pattern, replacement, meant)
    VALUES[option].read(meant)
    with pytest.raises(ArgumentTypeError) as caught:
        VALUES[option].read(given_text)
    assert str(caught.value).endswith(f"; did you mean {meant!r}?")


@pytest.mark.parametrize(
    ("option", "text"),
    [
        ("reach", "120:LeftHand:0,100,30~0"),
        ("reach", "120:LeftHand:0,100,30~3cm"),
        ("reach", "9:LeftHand:@chest+0,30cm,0"),
        ("keep", "0:03-0:04"),
        ("keep", "-100"),
        ("keep", "3s-100"),
        ("avoid", "ball:0,100,30,10"),
        ("avoid", "box:0,100,30,10"),
        ("avoid", "full/walk.bvh@0,0"),
    ],
)
def test_value_whose_meaning_is_not_certain_has_no_suggestion(option, text):
    with pytest.raises(ArgumentTypeError) as caught:
        VALUES[option].read(text)
    assert "did you mean" not in str(caught.value)


def filled(template, first, last):
    return template.format(a=first, b=last)


@given(st.sampled_from(sorted(VALUES)), st.text("0123456789.-:@=,;~+s azLH()", max_size=24))
def test_every_suggestion_is_accepted_and_valid_values_are_unchanged(option, text):
    convert = VALUES[option].convert
    try:
        expected = convert(text)
    except ArgumentTypeError as error:
        plain = str(error)
    else:
        assert VALUES[option].read(text) == expected
        return
    with pytest.raises(ArgumentTypeError, match=re.escape(plain)) as caught:
        VALUES[option].read(text)
    suggested = str(caught.value).removeprefix(plain).removeprefix("; did you mean ")
    if suggested:
        convert(suggested[1:-2])
        numbers, given_numbers = (re.findall(r"\d+", own) for own in (suggested, text))
        assert sorted(numbers) == sorted(given_numbers)
