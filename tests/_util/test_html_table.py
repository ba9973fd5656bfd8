"""Properties of HTML tables in notebooks."""

from dataclasses import replace
from html.parser import HTMLParser

import pytest
from hypothesis import given
from hypothesis import strategies as st

import mograft as mg
from mograft._util.html_table import MAX_ROWS, notebook_table
from mograft.dancer import dance
from tests.strategies import HOSTILE_NAMES


class Table(HTMLParser):
    """The tags of HTML, and the texts of its paragraphs and table rows, as a browser reads them."""

    def __init__(self, text):
        super().__init__()
        self.tags, self.rows = set(), []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag, attrs):  # noqa: ARG002 - the name is the parser's
        self.tags.add(tag)
        if tag in ("p", "tr"):
            self.rows.append([])
        if tag in ("p", "td", "th"):
            self.rows[-1].append("")

    def handle_data(self, data):
        self.rows[-1][-1] += data


TAGS = {"p", "table", "thead", "tbody", "tr", "th", "td"}
# The parser, like a browser, joins the two characters of a line end.
TEXTS = st.text(st.characters(codec="utf-8", exclude_characters="\r\0"), min_size=1)


@given(TEXTS, st.lists(st.tuples(TEXTS, st.integers(), st.booleans()), max_size=40))
def test_html_table_cells_hold_the_texts_and_no_other_tags(text, rows):
    table = Table(notebook_table(text, (text, "n", "b"), rows, len(rows)))
    assert table.tags <= TAGS
    expected = [[text], [text, "n", "b"], *([own, str(n), str(b)] for own, n, b in rows[:MAX_ROWS])]
    expected += [[f"{len(rows) - MAX_ROWS} more rows"]] if len(rows) > MAX_ROWS else []
    assert table.rows == expected


@pytest.mark.parametrize("name", HOSTILE_NAMES)
def test_repr_html_of_hostile_names_has_only_table_tags(name):
    motion = replace(dance(strides=1).motion, name=name)
    library = mg.Library.build(motion)
    graft = mg.graft(library, seed=3)
    (clip,) = library.names
    shown = clip.encode("utf-8", "replace").decode()
    for value in (library, library.to_dataframe("clips"), graft):
        html = value._repr_html_().rpartition("</iframe>")[2]
        assert Table(html).tags <= TAGS
        assert shown in [cell for row in Table(html).rows for cell in row]
    candidates = mg.candidates(library, 17, "upper", [mg.constraints.NotFrom(clip)])
    table = Table(candidates._repr_html_())
    assert table.tags <= TAGS
    n = len(candidates.allowed + candidates.refused)
    assert len(table.rows) == 2 + min(MAX_ROWS, n) + (n > MAX_ROWS)  # with caption and header
