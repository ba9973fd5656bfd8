"""The page of an evaluationand its sentences."""

import re

from mograft.viewing.evaluation_report import evaluation_page


def test_evaluation_page_has_all_sections_and_no_script(evaluation):
    page = evaluation_page(evaluation, "A <b>bold</b> title")
    assert "<h1>A &lt;b&gt;bold&lt;/b&gt; title</h1>" in page.html
    for method in evaluation.parameters["ways"]:
        assert method in page.html
    for heading in ("Summary", "Quality", "World space", "Detectability", "Balance"):
        assert f"<h2>{heading}</h2>" in page.html
    assert re.findall(r"<script[^>]*>(.*?)</script>", page.html, re.DOTALL) == [""]
    assert not re.search(r"\bnan\b", page.html)
