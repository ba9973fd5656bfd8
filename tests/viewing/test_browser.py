"""The viewer as a browser shows it."""

import io
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import mograft as mg
from mograft import JointGroups, Library, graft, graft_many, view
from mograft.constraints import Avoid, Box, Capsule, Character, Face, HalfSpace, Reach, Sphere
from mograft.dancer import dance
from mograft.viewing.figure import ShownConstraint
from mograft.viewing.report import report_page
from mograft.viewing.scene import Scene
from tests.browser import new_page, open_page, wait_until
from tests.strategies import HOSTILE_NAMES
from tests.viewing.page_content import node_positions

DASH = "\N{EN DASH}"

pytestmark = pytest.mark.browser


@pytest.fixture(scope="module")
def path(new, tmp_path_factory):
    return view(new, show=False).save(tmp_path_factory.mktemp("page") / "two.html")


def pixels(page, selector):
    """Return a screenshot of an element as an array."""
    image = pytest.importorskip("matplotlib.image", reason="matplotlib reads the screenshots")
    shot = page.locator(selector).screenshot()
    return image.imread(io.BytesIO(shot), format="png")[..., :3]


@pytest.mark.parametrize("theme", ["light", "dark"])
@pytest.mark.parametrize("width", [1280, 480])
def test_viewer_figures_have_group_colours_and_move(browser, path, theme, width):
    with open_page(browser, path, width, theme=theme) as page:
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        before = pixels(page, ".stage")
        paper = before[-1, 3]
        assert (paper.mean() > 0.5) == (theme == "light")
        colours = page.evaluate(
            "['--group0','--group1'].map(n => getComputedStyle(document.body).getPropertyValue(n))"
        )
        for colour in colours:
            want = np.array([int(colour.strip()[i : i + 2], 16) for i in (1, 3, 5)]) / 255
            for half in np.array_split(before, 2, axis=1):
                shown = (np.abs(half - want).max(axis=-1) < 0.04).mean()
                assert 0.001 < shown < 0.2, (colour, shown)
        page.keyboard.press("Shift+ArrowRight")
        wait_until(page, "mograft.frame() === 10")
        page.evaluate("mograft.seek(60)")
        after = pixels(page, ".stage")
        assert (np.abs(after - before).max(axis=-1) > 0.1).mean() > 0.005
        assert page.locator("[data-part=rows]").get_attribute("aria-valuenow") == "60"
        # With a fixed camera and without a floor, only the figures move.
        page.keyboard.press("f")
        page.keyboard.press("g")
        page.evaluate("mograft.seek(60)")
        before = pixels(page, ".stage")
        page.evaluate("mograft.seek(75)")
        after = pixels(page, ".stage")
        assert (np.abs(after - before).max(axis=-1) > 0.1).mean() > 0.002


def pin(page, row, part):
    """Click the middle of a segment of the timeline."""
    page.evaluate(f"mograft.seek({part.start + 1})")
    box = page.locator("[data-part=rows]").bounding_box()
    first, last = page.evaluate("mograft.state.window")
    x = 160 + (0.5 * (part.start + part.stop) - first) / (last - first) * (box["width"] - 168)
    offset = page.evaluate(f"mograft.offset({row})")
    page.mouse.click(box["x"] + x, box["y"] + offset + 9)
    page.mouse.move(5, 5)
    wait_until(page, "mograft.state.hovered === null && mograft.state.pinned !== null")


def test_viewer_click_describes_segment_and_lists_candidates_with_command(
    browser, path, new, library
):
    index, part = next((i, s) for i, s in enumerate(new.substitutions) if not s.is_own)
    want = mg.candidates(library, part.segment, "upper").allowed
    with open_page(browser, path) as page:
        assert not page.locator("[data-part=candidates]").is_visible()
        pin(page, 2, part)
        page.evaluate("mograft.seek(mograft.frame())")  # Draws at once, also on a busy machine.
        text = page.evaluate(f"mograft.describe(2, {index})")
        assert f"donor dance {part.donor_start}{DASH}{part.donor_stop}" in text
        assert f"frames {part.start}{DASH}{part.stop}" in text
        assert page.locator("[data-part=detail]").text_content() == text
        assert part.start <= page.evaluate("mograft.frame()") <= part.stop
        rows = page.locator("[data-part=donors] tr")
        wait_until(
            page, f"document.querySelectorAll('[data-part=donors] tr').length === {len(want)}"
        )
        for shown, candidate in zip(rows.all(), want, strict=True):
            name, *numbers = shown.locator("td").all_text_contents()
            assert name.startswith(f"dance {candidate.start}-{candidate.stop}")
            assert ("(captured)" in name) == (candidate.segment == part.segment)
            assert ("in use" in name) == (candidate.segment == part.donor)
            before, after = np.degrees([candidate.gap_before, candidate.gap_after])
            assert numbers[:2] == [f"{candidate.cost:.2f}", f"{candidate.stretch:.2f}"]
            assert numbers[2] == f"{before:.0f}°/{after:.0f}°"
        candidate = want[1]
        texts = []
        for kind in ("take", "ban"):
            button = rows.nth(1).locator(f"[data-choice^={kind}]")
            button.click()
            texts.append(page.evaluate("mograft.command(1)"))
            assert button.get_attribute("aria-pressed") == "true"
            assert page.locator("[data-part=commands] input").input_value() == texts[-1]
            button.click()  # The second click takes the choice back.
            assert page.locator("[data-part=commands] input").count() == 0
        page.keyboard.press("Space")  # Also beside a button.
        assert page.evaluate("mograft.state.playing")
        page.locator("details summary").click()
        # The browser reports the opened table, which fills it, some time after the click.
        n_rows = 3 * len(new.substitutions)
        wait_until(page, f"document.querySelectorAll('[data-part=table] tr').length === {n_rows}")
    donors = [eval(own, {"mg": mg, "graft": new}).substitutions[index] for own in texts]
    assert (donors[0].donor_start, donors[0].donor_stop) == (candidate.start, candidate.stop)
    assert donors[1].donor_start != candidate.start


def test_viewer_further_figures_are_decoded_when_shown(browser, library, tmp_path):
    grafts = list(graft_many(library, count=10, seed=3))
    path = report_page(grafts).save(tmp_path / "report.html")
    with open_page(browser, path) as page:
        buttons = page.locator("[data-part=figures] button")
        assert buttons.all_text_contents() == ["dance", *(own.motion.name for own in grafts)]
        loaded = "Array.from({length: 11}, (_, i) => mograft.isLoaded(i))"
        assert page.evaluate(loaded) == [True] * 5 + [False] * 6
        for number in range(1, 11):
            buttons.nth(number).click(modifiers=["Shift"])
            wait_until(page, f"mograft.state.shown.join() === '0,{number}'")
            names = page.locator(".caption bdi").all_text_contents()
            assert names == ["dance", grafts[number - 1].motion.name]
            frame = (number - 1) * (grafts[0].motion.n_frames - 1) // 9
            want = node_positions(grafts[number - 1].motion)[frame]
            got = np.reshape(page.evaluate(f"mograft.pose({number}, {frame})"), (-1, 3))
            # Half a quantization step, which is a ten-thousandth of the height, and float32.
            np.testing.assert_allclose(got, want, atol=0.0125)
            assert page.evaluate("mograft.describe(2, 0)").startswith(names[1])
        assert page.evaluate(loaded) == [True] * 11
        buttons.nth(0).click()
        wait_until(page, "mograft.state.shown.join() === '10'")
        buttons.nth(10).click()  # One figure always remains.
        buttons.nth(3).click()
        wait_until(page, "mograft.state.shown.join() === '3,10'")
        pressed = [button.get_attribute("aria-pressed") for button in buttons.all()]
        assert [i for i, value in enumerate(pressed) if value == "true"] == [3, 10]


@pytest.mark.parametrize(
    "focus", ["body", "a", "[data-part=trails]", "[data-part=speed]", "details summary"]
)
def test_report_space_plays_wherever_the_focus_is(browser, new, tmp_path, focus):
    path = report_page([new], [Path("new.bvh")]).save(tmp_path / "report.html")
    with open_page(browser, path) as page:
        if focus != "body":
            page.locator(focus).first.focus()
        scrolled = page.evaluate("scrollY")
        page.keyboard.press("Space")
        wait_until(page, "mograft.frame() > 2")
        page.keyboard.press("Space")
        assert not page.evaluate("mograft.state.playing")
        assert page.evaluate("scrollY") == scrolled
        assert page.locator("[data-part=trails]").get_attribute("aria-pressed") == "false"
        page.locator("[data-part=frame]").focus()
        page.keyboard.press("Space")
        assert not page.evaluate("mograft.state.playing")


OBSTACLES = {
    "sphere": Avoid(Sphere((0, 100, 0), 30), weight=1.0),
    "capsule": Avoid(Capsule((-80, 0, 0), (-80, 150, 0), 15), weight=1.0),
    "box": Avoid(Box((70, 60, 0), (20, 30, 20), (0, 0.6, 0, 0.8)), weight=1.0),
    "plane": Avoid(HalfSpace((0, 0, -100), (0, 0, 1)), weight=1.0),
    "figure": Avoid(Character(dance(seed=2, strides=1).motion[:60], (90, 0, 0)), weight=1.0),
    "target": Reach("LeftHand", (50, 120, 60), frame=0, weight=1.0),
    "face": Face((-60, 150, 80), frames=(0, 40), weight=1.0),
}


@pytest.mark.parametrize("name", OBSTACLES)
def test_viewer_draws_obstacles_and_targets(browser, motion, tmp_path, name):
    """The colour of objects is on the stage only if there is an object."""
    plain = Scene.of([motion[:60]])
    scene = replace(plain, constraints=(ShownConstraint(OBSTACLES[name], motion),))
    kind = {"target": "accent", "face": "accent", "figure": "character"}.get(name, "obstacle")
    shares = []
    for index, shown in enumerate((plain, scene)):
        path = view(shown, show=False).save(tmp_path / f"{index}.html")
        # Without labels, which have the same colours.
        text = re.sub(r'"label":"[^"]*"', '"label":""', path.read_text(encoding="utf-8"))
        path.write_text(text, encoding="utf-8")
        with open_page(browser, path) as page:
            text = page.evaluate(
                f"getComputedStyle(document.body).getPropertyValue('--{kind}').trim()"
            )
            colour = np.array([int(text[i : i + 2], 16) for i in (1, 3, 5)]) / 255
            stage = pixels(page, ".stage")
        # Lines are translucent and smoothed: of the hue of the colour, at a part of its strength.
        away, full = stage - stage[-1, 3], colour - stage[-1, 3]
        strength = (away @ full) / (full @ full)
        residual = np.abs(away - strength[..., None] * full).max(axis=-1)
        shares.append(((strength > 0.25) & (strength < 1.1) & (residual < 0.06)).mean())
    assert shares[1] > shares[0] + 2e-4, shares


def test_viewer_range_is_selected_by_drag_and_repeats(browser, path):
    with open_page(browser, path) as page:
        first, last = page.evaluate("mograft.state.window")
        box = page.locator("[data-part=rows]").bounding_box()
        ends = [first + (last - first) * share for share in (0.3, 0.5)]
        right, left = (box["x"] + 160 + share * (box["width"] - 168) for share in (0.5, 0.3))
        height = box["y"] + page.evaluate("mograft.offset(2)") + 9
        page.mouse.move(right, height)
        page.mouse.down()
        page.mouse.move(left, height)
        page.mouse.up()
        selected = page.evaluate("mograft.state.range")
        np.testing.assert_allclose(selected, ends, atol=1.5)
        page.evaluate("mograft.seek(mograft.frame())")
        detail = page.locator("[data-part=detail]").text_content()
        assert f"range {selected[0]}{DASH}{selected[1]}" in detail
        page.locator("[data-part=loop]").click()
        page.evaluate(f"mograft.seek({selected[1] - 2})")
        page.locator("[data-part=play]").click()
        wait_until(page, f"mograft.frame() < {selected[1] - 2}")
        assert page.evaluate("mograft.frame()") >= selected[0]
        page.keyboard.press("Space")
        page.keyboard.press("Escape")
        assert page.evaluate("[mograft.state.range, mograft.state.pinned]") == [None, None]
        page.evaluate("mograft.seek(50)")
        page.keyboard.press("i")
        page.evaluate("mograft.seek(80)")
        page.keyboard.press("u")
        assert page.evaluate("mograft.state.range") == [50, 80]
        # Two fingers apart enlarge the timeline, and leave the range.
        page.evaluate(PINCH)
        start, stop = page.evaluate("mograft.state.window")
        assert stop - start < 0.6 * (last - first) or stop - start == 20
        assert page.evaluate("mograft.state.range") == [50, 80]


def test_viewer_keys_and_buttons_change_state(browser, path, new):
    with open_page(browser, path) as page:
        for key, name in (("o", "overlay"), ("f", "follow"), ("t", "trails"), ("g", "floor")):
            button = page.locator(f"[data-part={name}]")
            was = button.get_attribute("aria-pressed")
            page.keyboard.press(key)
            assert button.get_attribute("aria-pressed") != was
            button.click()
            assert button.get_attribute("aria-pressed") == was
        page.keyboard.press("End")
        assert page.evaluate("mograft.frame()") == new.motion.n_frames - 1
        page.keyboard.press("Home")
        page.keyboard.press("]")
        assert page.evaluate("mograft.frame()") == new.substitutions[0].stop
        page.keyboard.press("[")
        assert page.evaluate("mograft.frame()") == 0
        page.locator("[data-part=frame]").fill("42")
        page.locator("[data-part=frame]").press("Enter")
        assert page.evaluate("mograft.frame()") == 42
        unnamed = page.evaluate(
            "[...document.querySelectorAll('button, select, input, canvas:not([aria-hidden])')]"
            ".filter(e => "
            "!e.textContent.trim() && !e.getAttribute('aria-label') && !e.labels?.length).length"
        )
        assert unnamed == 0
        page.keyboard.press("?")
        assert page.locator("dialog").is_visible()
        page.keyboard.press("Escape")
        assert not page.locator("dialog").is_visible()


@pytest.mark.parametrize("has_policy", [True, False])
def test_viewer_hostile_names_run_no_script(browser, tmp_path, has_policy):
    """Also without the policy of the page: names of groups, donors, candidates and commands."""
    names = [name for name in HOSTILE_NAMES if "<" in name][:2]
    takes = [
        replace(dance(seed=seed, strides=1).motion[:300], name=name)
        for seed, name in enumerate(names)
    ]
    legs = ["Hips", "*Leg", "*Foot"]
    groups = JointGroups({names[0]: legs, names[1]: list(range(7, 18))}, base=names[0])
    new = graft(Library.build(takes, groups), names[0], seed=1)
    text = report_page([new], [Path(f"{names[0]}.bvh")]).html
    if not has_policy:
        text = re.sub(r'<meta http-equiv="Content-Security-Policy".*?">', "", text, flags=re.DOTALL)
    path = tmp_path / "evil.html"
    path.write_text(text, encoding="utf-8")
    with open_page(browser, path) as page:
        assert page.locator(".caption bdi").all_text_contents() == [names[0], new.motion.name]
        page.evaluate("mograft.pin(2, 5); mograft.seek(mograft.frame())")
        page.locator("[data-part=donors] tr button").first.click()
        page.locator("[data-mark=star]").click()
        page.locator("[data-part=parts] summary").click()
        wait_until(page, "document.querySelectorAll('[data-part=table] tr').length > 5")
        assert page.locator("[data-part=commands] input").count() == 2
        assert page.title() != "owned"
        assert page.locator(".viewer img, .viewer script").count() == 0


def test_viewer_without_webgl_shows_stills_and_reason(browser, path):
    with new_page(browser) as page:
        page.add_init_script(
            "const given = HTMLCanvasElement.prototype.getContext;"
            "HTMLCanvasElement.prototype.getContext = function (kind, ...rest) {"
            "return kind.startsWith('webgl') ? null : given.call(this, kind, ...rest); };"
        )
        page.goto(path.as_uri())
        page.wait_for_selector("#mograft[data-ready='1']")
        assert page.locator("[data-part=reason]").is_visible()
        assert "no WebGL" in page.locator("[data-part=reason]").text_content()
        before = pixels(page, ".stage")
        page.evaluate("mograft.seek(60)")
        after = pixels(page, ".stage")
        assert (np.abs(after - before).max(axis=-1) > 0.1).mean() > 0.003
        assert page.locator("[data-part=donors]").count() == 1


PINCH = """() => {
  const rows = document.querySelector("[data-part=rows]");
  rows.setPointerCapture = () => {};
  const clientY = rows.getBoundingClientRect().top + 5;
  const send = (kind, pointerId, clientX) =>
    rows.dispatchEvent(new PointerEvent(kind, {pointerId, clientX, clientY}));
  send("pointerdown", 1, 400); send("pointerdown", 2, 500); send("pointermove", 2, 501);
  send("pointermove", 2, 600); send("pointermove", 1, 300);
  send("pointerup", 1, 300); send("pointerup", 2, 600);
}"""

N_TRIES = 20
"""Clicks until Chromium moves the focus; usually the first one suffices."""

HAS_FOCUS = (
    "(document.hasFocus() && document.querySelector('#mograft').contains(document.activeElement))"
)

DISPATCH_WHEEL = """() => {
  mograft.state.zoom = 1;
  const event = new WheelEvent("wheel", {deltaY: 100, bubbles: true, cancelable: true});
  document.querySelector("[data-part=stage]").dispatchEvent(event);
  return [event.defaultPrevented, mograft.state.zoom < 1];
}"""


@pytest.fixture
def notebook(browser, new, tmp_path):
    """A page that shows a graft above a long text."""
    path = tmp_path / "notebook.html"
    filler = "<div id='text' style='height:3000px'>text</div>"
    path.write_text(f"<!doctype html>{new._repr_html_()}{filler}", encoding="utf-8")
    with new_page(browser, 1000) as page:
        page.goto(path.as_uri())
        frame = page.frame_locator("iframe")
        frame.locator("#mograft[data-ready='1']").wait_for()
        assert frame.locator(".caption").count() == 2
        yield page


def test_notebook_wheel_scrolls_until_view_has_focus(notebook):
    view = notebook.frames[1]
    stage = notebook.frame_locator("iframe").locator("[data-part=stage]")
    text = notebook.locator("#text")
    assert view.evaluate(DISPATCH_WHEEL) == [False, False]
    for has_focus in (False, True, False):
        for _ in range(N_TRIES):
            notebook.evaluate("scrollTo(0, 0)")
            (stage if has_focus else text).click(position={"x": 300, "y": 40})
            notebook.wait_for_timeout(100)
            if view.evaluate(HAS_FOCUS) == has_focus:
                break
        # The browser scrolls by an event whose default the view does not prevent.
        assert view.evaluate(DISPATCH_WHEEL) == [has_focus, has_focus]
