"""The figures of the evidence page, and the tables that the page names."""

import fnmatch
import re

import pytest

from lab import figures, plots
from lab.experiments.run import RESULTS, ROOT

PAGE = (ROOT / "docs" / "evidence.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("draw", figures.DRAWN, ids=lambda draw: draw.__name__)
def test_figure_is_small_and_the_same_twice(draw):
    first, second = (plots.as_svg(draw(RESULTS)) for _ in range(2))
    assert first == second
    assert len(first) < 60_000


def test_page_shows_every_figure_and_names_every_experiment():
    shown = re.findall(r"\]\(figures/(\w+)\.svg\)", PAGE)
    assert sorted(shown) == sorted(draw.__name__ for draw in figures.DRAWN)
    named = re.findall(r"`([\w*-]+)\.csv`", PAGE)
    stored = {path.stem for path in RESULTS.glob("*.csv")}
    for name in named:
        assert fnmatch.filter(stored, name), name
    studies = {name for name in stored if name.startswith(("segmentations", "behaviours"))}
    found = {name for pattern in named for name in fnmatch.filter(stored, pattern)}
    assert stored - studies - found <= {"refused"}
