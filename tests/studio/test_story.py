"""The whole story in Chromium: open, make, exchange, lock, avoid, loop and export."""

import hashlib
import json

import pytest

import mograft as mg
from mograft.cli import main
from mograft.dancer import dance
from tests import clients
from tests.io.recorded_files import DATA
from tests.studio.story import AVOIDS, LISTED, studio

pytestmark = pytest.mark.browser

SOURCES = ["kaykit_Knight.glb", "dance.bvh"]


@pytest.fixture(params=SOURCES)
def source(request, tmp_path):
    """A character with 69 clips, or a dance without a mesh."""
    if request.param == "dance.bvh":
        mg.write(dance(seed=3, strides=4).motion[:600], tmp_path / "dance.bvh")
        return tmp_path / "dance.bvh", "dance"
    path = DATA / "glb" / request.param
    if not path.exists():
        pytest.skip(f"{path} is missing")
    return path, "Walking_A"


def digest(path):
    return hashlib.sha256(path.read_bytes()).hexdigest()


def check_export(person, folder):
    """Compare the exported file with that of the command, and read it."""
    state = person.state()
    (kept,) = [own for own in state["motions"] if own["isKept"]]
    (name,) = person.page.locator(".dialog .result bdi").all_inner_texts()
    exported = folder / name
    again = folder / "again" / exported.name  # its provenance has relative paths
    target = again.parent if again.suffix == ".bvh" else again
    project = folder / state["file"]
    person.session.flush()
    assert main(["graft", "--project", str(project), "-o", str(target), "--quiet"]) == 0
    assert digest(again) == digest(exported)
    motion = next(own for own in mg.read(exported) if own.name == kept["name"])
    assert motion.n_frames == kept["frames"]
    if exported.suffix == ".glb":
        assert len(mg.read(exported)) == len(mg.read(DATA / "glb" / SOURCES[0])) + 1
        messages = clients.gltf_validator()(exported)
        assert [own for own in messages if own["severity"] == 0] == []
    else:
        record = json.loads(exported.with_suffix(".json").read_text(encoding="utf-8"))
        assert record["name"] == kept["name"]


def test_story_by_pointer_exports_what_the_command_makes(browser, source, tmp_path):
    with studio(browser, tmp_path / "session") as person:
        person.play_story(*source)
        check_export(person, tmp_path / "session")


def test_story_by_keyboard_alone_exports_what_the_command_makes(browser, source, tmp_path):
    path, base = source
    folder = tmp_path / "session"
    with studio(browser, folder) as person:
        page = person.page
        (folder / "dropped").mkdir()
        (folder / "dropped" / path.name).write_bytes(path.read_bytes())
        page.keyboard.press("Control+o")
        person.tab_to(page.get_by_label("Path on this computer"))
        page.keyboard.type(f"dropped/{path.name}")
        page.keyboard.press("Enter")
        person.until("state.library.status === 'ready'")
        person.tab_to(page.locator('[role="tab"][aria-selected="true"]').first)
        page.keyboard.press("Home")
        person.tab_to(page.get_by_role("combobox", name="base motion", exact=True).first)
        page.keyboard.type(base)
        person.press(person.button("Make 12 motions"))
        person.until("state.motions.length >= 12 && !state.jobs.length")

        person.press(page.locator(".card .preview").nth(1))
        person.press(page.locator(".card").nth(1).get_by_role("button", name="Favourite"))
        person.until_second("motion.mark === 'star'")
        person.tab_to(page.locator(".block[tabindex='0']"))
        for _ in range(2):
            page.keyboard.press("ArrowRight")
        take = page.locator(f"{LISTED} button:enabled", has_text="Use").first
        old = person.state()["motions"][1]["hash"]
        person.press(take)
        person.until_second(f"motion.hash !== '{old}'")
        page.keyboard.press("k")
        (lock,) = person.until_second("motion.locks.length")["locks"]
        person.press(person.button("Repeat selection"))
        person.press(person.button("Play"))
        person.check_played(lock)
        person.press(person.button("Pause"))

        person.tab_to(page.get_by_role("tab", name="Selected part"))
        page.keyboard.press("ArrowRight")
        person.press(person.button("Add"))
        before = len(person.until_second(AVOIDS)["constraints"])
        page.keyboard.press("Control+z")
        person.until_second(f"motion.constraints.length === {before - 1}")
        page.locator("button:enabled", has_text="Redo").wait_for()
        page.keyboard.press("Control+Shift+z")
        motion = person.until_second(f"motion.constraints.length === {before}")
        assert motion["locks"] == [lock]

        person.press(page.locator(".card").nth(1).get_by_label("Keep"), "Space")
        person.until_second("motion.isKept")
        page.keyboard.press("Control+e")
        person.press(person.button("Export"))
        page.locator(".dialog .result bdi").wait_for()
        check_export(person, folder)


NAMELESS = """() => [...document.querySelectorAll("button, input, select, [tabindex='0']")]
  .filter((own) => own.checkVisibility() && !(
    own.getAttribute("aria-label") || own.innerText?.trim() ||
    [...(own.labels || [])].some((each) => each.innerText.trim())))
  .map((own) => own.outerHTML.slice(0, 120))"""
WORDLESS = """() => [...document.querySelectorAll("button")]
  .filter((own) => !own.matches(".preview, .block, .bar-range, .violated"))
  .filter((own) => own.checkVisibility() && !/[a-z]{2}/i.test(own.innerText))
  .map((own) => own.outerHTML.slice(0, 120))"""
AXE = """async () => (await axe.run({ resultTypes: ["violations"] })).violations
  .filter(({ impact }) => ["serious", "critical"].includes(impact))
  .map(({ id, nodes }) => [id, nodes.map(({ html }) => html.slice(0, 200))])"""


@pytest.mark.parametrize("width", [1280, 480])
@pytest.mark.parametrize("theme", ["light", "dark"])
def test_every_state_fits_its_width_names_its_controls_and_has_no_serious_fault_of_axe(
    browser, tmp_path, theme, width
):
    mg.write(dance(seed=3, strides=4).motion[:600], tmp_path / "dance.bvh")
    with studio(browser, tmp_path / "session", (width, 800), theme) as person:
        page = person.page
        checks = [NAMELESS, WORDLESS]
        if clients.AXE.exists():
            page.evaluate(clients.AXE.read_text(encoding="utf-8"))
            checks.append(AXE)
        paper = page.evaluate("getComputedStyle(document.body).backgroundColor")
        assert (sum(map(int, paper[4:-1].split(","))) > 382) == (theme == "light")

        def look(name):
            assert page.evaluate("document.documentElement.scrollWidth") <= width, name
            for own in checks:
                assert page.evaluate(own) == [], name

        look("empty")
        person.button("Open files…").first.click()
        look("open")
        page.keyboard.press("Escape")
        person.play_story(tmp_path / "dance.bvh", "dance", look)
        page.keyboard.press("Escape")
        for tab in ("Captured clips", "Along a path"):
            page.get_by_role("tab", name=tab).click()
            look(tab)
        person.button("Help").click()
        look("keys")
    if AXE not in checks:
        pytest.skip("axe-core is not installed: python -m tests fetches it by npm")
