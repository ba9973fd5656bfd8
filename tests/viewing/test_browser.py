"""The viewer as a browser shows it."""

import io
from dataclasses import replace

import numpy as np
import pytest

from mograft import JointGroups, view
from mograft.dancer import dance
from mograft.motion import rotations
from tests.browser import TIMEOUT_MILLISECONDS, chromium, open_page, wait_until
from tests.strategies import HOSTILE_NAMES

DASH = "\N{EN DASH}"

pytestmark = pytest.mark.browser


@pytest.fixture(scope="module")
def browser():
    with chromium() as found:
        yield found


@pytest.fixture(scope="module")
def path(new, tmp_path_factory):
    return view(new, show=False).save(tmp_path_factory.mktemp("page") / "two.html")


def pixels(page, selector):
    """Return a screenshot of an element as an array."""
    image = pytest.importorskip("matplotlib.image", reason="matplotlib reads the screenshots")
    shot = page.locator(selector).screenshot()
    return image.imread(io.BytesIO(shot), format="png")[..., :3]


def nodes(motion):
    turns, joints = motion.world_transforms()
    sites = [
        joints[:, s.parent] + rotations.rotate(turns[:, s.parent], s.offset)
        for s in motion.skeleton.end_sites
    ]
    return np.concatenate([joints, *(s[:, None] for s in sites)], axis=1)


def test_viewer_poses_equal_world_positions(browser, path, new):
    with open_page(browser, path) as page:
        assert page.evaluate("mograft.frames") == new.motion.n_frames
        for clip, motion in enumerate((new.base, new.motion)):
            want = nodes(motion)
            for frame in (0, 1, 137, motion.n_frames - 1):
                got = np.reshape(page.evaluate(f"mograft.pose({clip}, {frame})"), (-1, 3))
                # Half a quantization step, which is a ten-thousandth of the height, and float32.
                np.testing.assert_allclose(got, want[frame], atol=0.0125)


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


def test_viewer_play_advances_and_pause_stops(browser, path):
    with open_page(browser, path) as page:
        page.locator("[data-part=play]").click()
        wait_until(page, "mograft.frame() > 5")
        page.locator("[data-part=play]").click()
        at = page.evaluate("mograft.frame()")
        page.wait_for_timeout(200)
        assert page.evaluate("mograft.frame()") == at


def test_viewer_segment_description_names_donor_and_click_selects(browser, path, new):
    upper = [s for s in new.substitutions if s.group == "upper"]
    index = next(i for i, s in enumerate(upper) if not s.is_own)
    part = upper[index]
    with open_page(browser, path) as page:
        page.evaluate(f"mograft.seek({part.start + 1})")
        text = page.evaluate(f"mograft.describe(2, {index})")
        assert f"donor dance {part.donor_start}{DASH}{part.donor_stop}" in text
        assert f"frames {part.start}{DASH}{part.stop}" in text
        box = page.locator("[data-part=rows]").bounding_box()
        first, last = page.evaluate("mograft.state.window")
        middle = 0.5 * (part.start + part.stop)
        x = 160 + (middle - first) / (last - first) * (box["width"] - 168)
        page.mouse.click(box["x"] + x, box["y"] + box["height"] - 9)
        page.mouse.move(5, 5)
        wait_until(page, "mograft.state.hovered === null && mograft.state.pinned !== null")
        page.evaluate("mograft.seek(mograft.frame())")  # Draws at once, also on a busy machine.
        assert page.locator("[data-part=detail]").text_content() == text
        assert part.start <= page.evaluate("mograft.frame()") <= part.stop
        page.locator("summary").click()
        # The browser reports the opened table, which fills it, some time after the click.
        wait_until(
            page, f"document.querySelectorAll('[data-part=table] tr').length === {3 * len(upper)}"
        )


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
        cut = next(s.stop for s in new.substitutions if s.group == "upper")
        assert page.evaluate("mograft.frame()") == cut
        page.keyboard.press("[")
        assert page.evaluate("mograft.frame()") == 0
        page.locator("[data-part=frame]").fill("42")
        page.locator("[data-part=frame]").press("Enter")
        assert page.evaluate("mograft.frame()") == 42
        unnamed = page.evaluate(
            "[...document.querySelectorAll('button, select, input, canvas')].filter(e => "
            "!e.textContent.trim() && !e.getAttribute('aria-label') && !e.labels?.length).length"
        )
        assert unnamed == 0
        page.keyboard.press("?")
        assert page.locator("dialog").is_visible()
        page.keyboard.press("Escape")
        assert not page.locator("dialog").is_visible()


@pytest.mark.parametrize("name", [name for name in HOSTILE_NAMES if name])
def test_viewer_hostile_names_remain_text(browser, name, tmp_path):
    motion = dance(strides=1).motion[:40]
    groups = JointGroups({name: ["Hips", "*Leg", "*Foot"], "rest": list(range(7, 18))}, base=name)
    evil = replace(motion, name=name)
    path = view(evil, groups=groups, title=name, show=False).save(tmp_path / "evil.html")
    with open_page(browser, path) as page:
        assert page.title() != "owned"
        shown = page.locator(".caption bdi").text_content()
        assert shown == name.replace("\ud800", "\ufffd") or "\ud800" in name
        assert page.locator("img").count() == 0


def test_notebook_iframe_works_in_sandbox(browser, new, tmp_path):
    path = tmp_path / "notebook.html"
    path.write_text(f"<!doctype html><title>n</title>{new._repr_html_()}", encoding="utf-8")
    page = browser.new_page()
    page.set_default_timeout(TIMEOUT_MILLISECONDS)
    messages = []
    page.on("console", lambda message: messages.append(message.text))
    page.goto(path.as_uri())
    frame = page.frame_locator("iframe")
    frame.locator("#mograft[data-ready='1']").wait_for()
    assert frame.locator(".caption").count() == 2
    page.close()
    assert messages == []
