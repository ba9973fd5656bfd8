"""Every study runs to its end on a small input."""

import pytest

from lab.__main__ import SECTIONS, main
from lab.studies import compare

STUDIES = [name for name in SECTIONS if name not in ("experiments", "compare", "figures")]


@pytest.mark.parametrize("name", STUDIES)
def test_study_tiny_run_completes_without_output(name, capsys):
    assert not main([name, "--tiny"])
    assert capsys.readouterr().out == ""


def test_unknown_section_is_refused_with_the_known_ones():
    assert "behaviours" in main(["nothing"])


@pytest.mark.parametrize(
    "topics",
    [
        ("combinations", "quality", "balance"),
        pytest.param(compare.TOPICS, marks=pytest.mark.thorough),
    ],
    ids=len,
)
def test_compare_measures_every_topic_and_draws_figures(small_library, topics):
    found, figures = compare.compare(small_library, topics, runs=1 if len(topics) < 4 else 3)
    assert found.keys() == {*topics, "refused"}
    assert set(topics) & {"combinations", "quality", "detectability"} <= figures.keys()
