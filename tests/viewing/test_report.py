"""The report page: its numbers equal those of the grafts, its links point to the files."""

import html
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import mograft as mg
from mograft import Library, graft, graft_many, write_bvh
from mograft.body.mass import center_of_mass, mass_model
from mograft.constraints import OnlyFrom
from mograft.dancer import dance
from mograft.synthesis.newness import newness
from mograft.viewing.report import report_page
from tests.browser import chromium, open_page
from tests.strategies import HOSTILE_NAMES
from tests.viewing.page_content import Tags, page_data


@pytest.fixture(scope="module")
def grafts(library):
    return list(graft_many(library, count=2, seed=3))


def cells(page, heading):
    """Return the rows of the table below a heading."""
    text = page.html.split(f"<h2>{heading}</h2>")[1].split("</table>")[0]
    rows = re.findall(r"<tr>(.*?)</tr>", text)[1:]
    return [[re.sub(r"<.*?>", "", c) for c in re.findall(r"<td>(.*?)</td>", r)] for r in rows]


def test_report_motion_table_equals_grafts_and_has_further_columns(grafts):
    columns = [{"jerk <head>": "1 < 2"}, {"jerk <head>": "3"}]
    file = Path("javascript:alert(1)<b>.bvh")
    page = report_page(grafts, [file, None], columns=columns)
    rows = cells(page, "Motions")
    for own, row in zip(grafts, rows, strict=True):
        new = sum(not s.is_own for s in own.substitutions)
        gaps = np.degrees([seam.gap for seam in own.seams])
        (other,) = (graft.motion for graft in grafts if graft is not own)
        found = newness(own, [other])
        shift = (center_of_mass(own.motion) - center_of_mass(own.base))[:, [0, 2]]
        stray = 100 * np.linalg.norm(shift, axis=1) / mass_model(own.base.skeleton).height
        name = own.motion.name if own is grafts[1] else html.escape(file.name)
        assert row[:2] == [name, f"{new} of {len(own.substitutions)}"]
        assert row[3:-1] == [
            str(int((own.alternatives["upper"] == 0).sum())),
            f"{found.new:.0%}",
            f"{np.degrees(found.changed):.1f}°",
            f"{np.degrees(found.apart):.1f}°",
            str(len(own.seams)),
            f"{gaps.mean():.1f}°",
            f"{gaps.max():.1f}° (within 0 to 45)",
            f"{stray.mean():.1f} %",
            f"{stray.max():.1f} %",
        ]
        assert own.report().splitlines()[1] in page.html
    assert [row[-1] for row in rows] == ["1 &lt; 2", "3"]
    assert "jerk &lt;head&gt;" in page.html
    assert [own["href"][:15] for tag, own in Tags(page.html).found if tag == "a"] == [
        "./javascript%3A"
    ]
    assert page.title == "dance: 2 new motions"
    assert len(page_data(page)["clips"]) == 3
    kept = replace(grafts[0], motion=grafts[0].base, seams=())
    assert cells(report_page([kept]), "Motions")[0][8:] == ["none", "none", "0.0 %", "0.0 %"]


@pytest.mark.parametrize("neighbourhood", ["cluster", "ball"])
def test_report_donor_table_equals_candidates(library, neighbourhood):
    library = library.relabelled(replace(library.config, neighbourhood=neighbourhood))
    made = graft(library, seed=3)
    page = report_page([made])
    (row,) = cells(page, "Limits on donors")
    segments = range(len(library.segments))
    similar = library.pool("upper").neighbours(np.array(segments), library.config)
    judged = [mg.candidates(library, segment, "upper") for segment in segments]
    fitting = [
        sum(
            "length" not in own.refused and "fault" not in own.refused
            for own in (*found.allowed[1:], *found.refused)
        )
        for found in judged
    ]
    counts = made.alternatives["upper"]
    means = (np.mean(own) for own in ([len(own) - 1 for own in similar], fitting, counts))
    assert row[:4] == ["upper", *(f"{mean:.1f}" for mean in means)]
    assert row[4] == f"{(counts == 0).sum()} of {len(counts)}"
    assert ("within the ball of lower" in page.html) == (neighbourhood == "ball")


def test_report_clip_table_lists_contributing_clips_only():
    takes = [own.motion for own in dance(seed=1, strides=1).takes(2)]
    others = [replace(dance(seed=9, strides=1).motion[:60], name=f"other{i}") for i in range(30)]
    library = Library.build([*takes, *others])
    new = graft(library, takes[0].name, seed=1, constraints=[OnlyFrom([own.name for own in takes])])
    page = report_page([new])
    rows = cells(page, "Clips")
    assert [row[0] for row in rows] == ["dance_1", "dance_2"]
    assert sum(int(row[3]) for row in rows) == sum(not s.is_own for s in new.substitutions) > 0
    assert "30 other clips of the library are not used." in page.html
    used = {s.clip for s in new.substitutions} | {new.base.name}
    assert used == {"dance_1", "dance_2"}


@pytest.mark.parametrize("file", [Path("javascript:alert(1)<b>.bvh"), None])
@pytest.mark.parametrize("name", HOSTILE_NAMES)
def test_report_hostile_names_remain_text(name, file):
    tags = []
    for own in (name, "plain"):
        motion = replace(dance(strides=1).motion[:200], name=own, path=Path(f"{own}.bvh"))
        page = report_page([graft(Library.build(motion))], [file])
        tags.append([tag for tag, _ in Tags(page.html).found])
        page.html.encode()
    assert tags[0] == tags[1]


def test_report_wrong_number_of_grafts_or_files_raises_value_error(grafts):
    with pytest.raises(ValueError, match="`grafts` must contain at least one"):
        report_page([])
    for name, given in (("files", [None]), ("columns", [{}])):
        with pytest.raises(ValueError, match=f"`{name}` must have 2 entries, one per graft, got 1"):
            report_page(grafts, **{name: given})


def test_graft_and_demo_commands_write_reports(tmp_path, succeed, fail, monkeypatch):
    opened_pages = []
    monkeypatch.setattr("webbrowser.open", lambda url: opened_pages.append(url) or True)
    write_bvh(dance(seed=1, strides=1).motion[:500], tmp_path / "a b.bvh")
    out = tmp_path / "out"
    base = tmp_path / "a b.bvh"
    printed, _ = succeed("graft", base, "-o", out, "-n", 2, "--report")
    assert printed.split("\n")[2] == str(out / "index.html")
    links = re.findall(r'<a href="(.*?)">', (out / "index.html").read_text(encoding="utf-8"))
    assert links == ["./a%20b_graft0.bvh", "./a%20b_graft1.bvh"]
    words = ["graft", base, "-o", tmp_path / "new.bvh", "--report", "--json"]
    assert f'"report": "{tmp_path / "new.html"}"' in succeed(*words)[0]
    for name in ("new.bvh", "new.json"):
        (tmp_path / name).unlink()
    assert "new.html exists; use --force to overwrite" in fail(1, *words)
    assert not opened_pages
    succeed("demo", "-o", tmp_path / "demo", "--open")
    assert opened_pages == [(tmp_path / "demo" / "index.html").as_uri()]


@pytest.mark.browser
@pytest.mark.parametrize(("width", "theme"), [(1280, "light"), (480, "dark")])
def test_report_fits_screen_and_viewer_plays(grafts, tmp_path, width, theme):
    path = report_page(grafts).save(tmp_path / "report.html")
    with chromium() as browser, open_page(browser, path, width, theme=theme) as page:
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        assert page.locator(".caption").count() == (3 if width > 600 else 2)
        # Except for the space bar, the viewer receives keys only while it has the focus.
        page.keyboard.press("End")
        assert page.evaluate("mograft.frame()") == 0
        page.locator("[data-part=stage]").focus()
        page.keyboard.press("End")
        assert page.evaluate("mograft.frame()") == grafts[0].motion.n_frames - 1
