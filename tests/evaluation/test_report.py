"""The page of an evaluation, its sentences and its figures."""

import re

import pytest

from mograft.evaluation.estimate import Estimate
from mograft.evaluation.kappa import Difference
from mograft.viewing.evaluation_report import compare_methods, evaluation_page
from mograft.viewing.plot import evaluation_plots as plots
from tests.browser import chromium

pytest.importorskip("matplotlib", reason="matplotlib is not installed")


def test_evaluation_page_has_all_sections_and_no_script(evaluation):
    page = evaluation_page(evaluation, "A <b>bold</b> title")
    assert "<h1>A &lt;b&gt;bold&lt;/b&gt; title</h1>" in page.html
    for method in evaluation.parameters["ways"]:
        assert method in page.html
    for heading in ("Summary", "Balance", "Quality", "Enrichment"):
        assert f"<h2>{heading}</h2>" in page.html
    assert page.html.count("<img") >= 3
    assert re.findall(r"<script[^>]*>(.*?)</script>", page.html, re.DOTALL) == [""]
    assert not re.search(r"\bnan\b", page.html)


def difference(first, second, low, high):
    kappa = Estimate(
        value=(low + high) / 2, low=low, high=high, n=40, unit="segments", interval_method="y"
    )
    return Difference(first, second, kappa, kappa)


class StubCompatibility:
    """Has only the differences of a compatibility."""

    def __init__(self, *differences):
        self.differences = {(d.first, d.second): d for d in differences}

    def difference(self, first, second):
        return self.differences[first, second]


def test_compare_methods_sentences_state_position_of_interval():
    above = difference("analogy", "contact pattern", 0.1, 0.6)
    undecided = difference("contact pattern", "random", -0.1, 0.3)
    below = difference("contact pattern", "random", -0.5, -0.3)
    first, second, third = compare_methods(StubCompatibility(above, undecided))
    assert "the interval is above 0" in first
    assert "undecided" in second
    assert "not both compared" in third
    assert "the interval is below 0" in compare_methods(StubCompatibility(above, below))[1]


def test_difference_without_interval_is_undecided():
    assert difference("analogy", "random", float("nan"), float("nan")).verdict == "undecided"


def test_draw_quality_same_rows_give_same_small_svg(evaluation):
    first, second = (plots.as_svg(plots.draw_quality(evaluation.quality)) for _ in range(2))
    assert first == second
    assert len(first) < 60_000


def test_draw_counts_has_one_legend_entry_for_each_number_of_groups(evaluation):
    svg = plots.as_svg(plots.draw_counts({"x": evaluation.sweep}, {2: [4.2]}))
    assert svg.count("K = ") == 4


@pytest.mark.browser
def test_evaluation_page_in_browser_shows_figures_without_errors(evaluation, tmp_path):
    path = evaluation_page(evaluation).save(tmp_path / "page.html")
    messages = []
    with chromium() as browser:
        page = browser.new_page()
        page.on("console", lambda message: messages.append(message.text))
        page.on("pageerror", lambda error: messages.append(str(error)))
        page.goto(path.as_uri())
        widths = page.evaluate("[...document.images].map((i) => i.naturalWidth)")
        page.close()
    assert len(widths) >= 3
    assert min(widths) > 100
    assert messages == []
