"""Donors that are shown in place, and the commands of all choices, for every format."""

import shlex
from dataclasses import replace

import numpy as np
import pytest

import mograft as mg
from mograft import Library, graft, replay, view
from mograft.cli import main
from mograft.io.formats import read_clip
from mograft.io.glb import write_glb
from mograft.viewing.report import report_page
from tests.browser import open_page, wait_until
from tests.viewing.page_content import clip_positions, page_data

pytestmark = pytest.mark.browser

DASH = "\N{EN DASH}"


def data_of(path):
    return page_data(mg.Page("", path.read_text(encoding="utf-8")))


def click(page, selector):
    page.evaluate(f"document.querySelector(`{selector}`).click()")


def pin(page, row, part):
    """Select a segment, as a click on its block does."""
    page.evaluate(f"mograft.pin({row}, {part})")
    page.evaluate("mograft.seek(mograft.frame())")  # Draws at once.
    wait_until(page, "!document.querySelector('[data-part=candidates]').hidden")


def with_donor(motion, joints, span, donor, first, last):
    """Return a motion in which joints rotate as in frames of a donor, stretched to a span."""
    start, stop = span
    at = first + np.linspace(0, 1, stop - start + 1) * (last - first)
    low = np.floor(at).astype(int)
    high, part = np.minimum(low + 1, donor.n_frames - 1), (at - low)[:, None, None]
    quats = motion.rotations.copy()
    a = donor.rotations[low][:, joints]
    b = donor.rotations[high][:, joints]
    b = np.where((a * b).sum(-1, keepdims=True) < 0, -b, b)
    mixed = a + part * (b - a)
    quats[start : stop + 1, joints] = mixed / np.linalg.norm(mixed, axis=-1, keepdims=True)
    return replace(motion, rotations=quats, channel_values=None)


def test_viewer_preview_moves_the_group_as_the_donor(browser, takes, tmp_path):
    """Donors of the base, and of a clip that the page does not show."""
    library = Library.build(takes)
    new = graft(library, "take0", seed=1)
    path = view(new, show=False).save(tmp_path / "page.html")
    data = data_of(path)
    assert list(data["windows"]) == ["take1"]
    joints = library.joints("upper")
    seen = set()
    with open_page(browser, path) as page:
        for part, own in enumerate(new.substitutions):
            for candidate in mg.candidates(library, own.segment, "upper").allowed[:20]:
                name = library.names[candidate.clip]
                if (name in seen and part % 9) or candidate.segment == own.segment:
                    continue
                seen.add(name)
                span, donor = (own.start, own.stop), takes[candidate.clip]
                want = with_donor(new.motion, joints, span, donor, candidate.start, candidate.stop)
                given = f"{{clip: '{name}', from: {candidate.start}, to: {candidate.stop}}}"
                page.evaluate(f"mograft.preview(2, {part}, {given})")
                if name == "take1":
                    wait_until(page, "mograft.isWindowLoaded('take1')")
                frames = sorted({own.start, (own.start + own.stop) // 2, own.stop, own.stop + 3})
                for frame in frames:
                    got = np.reshape(page.evaluate(f"mograft.pose(1, {frame})"), (-1, 3))
                    positions = want.world_positions()[frame]
                    np.testing.assert_allclose(got[: new.motion.n_joints], positions, atol=0.02)
                page.evaluate("mograft.preview(2, 0, null)")
                got = np.reshape(page.evaluate(f"mograft.pose(1, {own.start})"), (-1, 3))
                want = clip_positions(data["clips"][1])[own.start]
                np.testing.assert_allclose(got, want, atol=0.02)
    assert seen == {"take0", "take1"}


@pytest.mark.parametrize(("suffix", "count"), [(".bvh", 2), (".glb", 2), (".glb", 5)])
def test_viewer_commands_replay_all_choices(
    browser, takes, tmp_path, monkeypatch, capsys, suffix, count
):
    monkeypatch.chdir(tmp_path)
    names = [f"take0_graft{index}" for index in range(count)]
    if suffix == ".glb":
        write_glb(takes, "clips.glb")
        words, target = ["clips.glb", "-o", "long.glb"], "long.html"
    else:
        (tmp_path / "clips").mkdir()
        for own in takes:
            mg.write_bvh(own, f"clips/{own.name}.bvh")
        words, target = ["clips", "-o", "."], "index.html"
    words += ["--base", "take0", "-n", str(count), "--report", "--seed", "1"]
    assert main(["graft", *words]) == 0, capsys.readouterr().err
    capsys.readouterr()
    page_path = tmp_path / target
    data = data_of(page_path)
    assert [clip["name"] for clip in data["clips"]] == ["take0", *names]
    monkeypatch.chdir(page_path.parent)
    with open_page(browser, page_path) as page:
        row = data["clips"][2]["rows"][0]
        table = data["candidates"][data["clips"][2]["candidates"]]["upper"]
        part = next(i for i, count in enumerate(table["counts"]) if count > 2 and i > 5)
        pin(page, 3, part)
        click(page, "[data-part=donors] tr:nth-child(2) button[data-choice^=take]")
        pin(page, 3, part)
        click(page, "[data-part=ranges] button:nth-child(1)")  # Replaces the donor.
        click(page, "[data-part=donors] tr:nth-child(2) button[data-choice^=take]")
        pin(page, 3, part + 3)
        click(page, "[data-part=ranges] button:nth-child(1)")
        pin(page, 3, part + 6)
        click(page, "[data-part=donors] tr:nth-child(2) button[data-choice^=ban]")
        page.evaluate("mograft.state.range = [300, 340]")
        page.evaluate("mograft.seek(300)")
        wait_until(page, "document.querySelector('[data-part=ranges]').textContent.includes('300')")
        click(page, "[data-part=ranges] button:nth-child(2)")
        command = page.evaluate("mograft.command(2)")
        click(page, ".caption:nth-child(3) [data-mark=star]")
        fields = page.locator("[data-part=commands] input")
        keep = fields.nth(1).input_value()
        assert fields.nth(0).input_value() == command
        click(page, ".caption:nth-child(3) [data-mark=star]")
        click(page, ".caption:nth-child(3) [data-mark=reject]")
        others = fields.nth(1).input_value()
    given = [word for word in shlex.split(command) if word.startswith("--")]
    flags = ["--from", "--take", "--keep", "--ban", "--change"]
    assert [word for word in given if word != "--as"] == flags
    for line in (command, *(keep.split(" && ") if suffix == ".glb" else ())):
        program, *rest = shlex.split(line)
        assert program == "mograft"
        assert main(rest) == 0, (line, capsys.readouterr().err)
    written = "long.glb#take0_graft1_new" if suffix == ".glb" else "take0_graft1_new.json"
    new = replay(written)
    upper = new.substitutions

    def donors(at):
        """The second listed donor of a segment, and its donor in the new motion."""
        listed, own = sum(table["counts"][:at]) + 1, upper[at]
        name = data["donors"][table["source"][listed]]
        second = (name, table["first"][listed], table["last"][listed])
        return second, (own.clip, own.donor_start, own.donor_stop)

    assert len(set(donors(part))) == 1  # taken
    assert len(set(donors(part + 6))) == 2  # banned
    assert upper[part + 3].is_own
    assert [change.frames for change in new.changes] == [(300, 340)]
    assert len(row["start"]) == len(upper)
    if suffix == ".glb":
        paths = ("long.glb#take0_graft1", "kept/take0_graft1.glb#take0_graft1")
        first, second = (read_clip(path) for path in paths)
        np.testing.assert_array_equal(first.rotations, second.rotations)
        assert "take0_graft0" in others
        assert "take0_graft1" not in others
    else:
        assert keep == "mkdir -p kept && cp take0_graft1.bvh take0_graft1.json kept"
        assert others == "mkdir -p kept && cp take0_graft0.bvh take0_graft0.json kept"


def test_viewer_shows_changes_as_blocks(browser, takes, tmp_path):
    library = Library.build(takes)
    new = mg.change(graft(library, "take0", seed=1), "upper", (100, 160), ("take1", 200, 260))
    path = report_page([new]).save(tmp_path / "report.html")
    data = data_of(path)
    (change,) = data["clips"][1]["rows"][0]["changes"]
    source = data["donors"][change.pop("source")]
    assert (source, change) == ("take1", {"start": 100, "stop": 160, "first": 200, "last": 260})
    with open_page(browser, path) as page:
        row = data["clips"][1]["rows"][0]
        part = next(i for i, stop in enumerate(row["stop"]) if stop > 110)
        assert f"changed in 100{DASH}160: take1 200{DASH}260" in page.evaluate(
            f"mograft.describe(2, {part})"
        )
