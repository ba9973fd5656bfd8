"""In a notebook, the wheel scrolls the notebook until the view has the focus; then it zooms."""

import pytest

from tests.browser import TIMEOUT_MILLISECONDS

pytestmark = pytest.mark.browser

N_TRIES = 20
"""Gestures until Chromium sends one to the expected target; usually the first one suffices."""

HAS_FOCUS = (
    "(document.hasFocus() && document.querySelector('#mograft').contains(document.activeElement))"
)

RECORD_WHEEL = f"""() => {{
  window.wheels = [];
  addEventListener("wheel", (event) => wheels.push(
    {{cancelable: event.cancelable, prevented: event.defaultPrevented, focus: {HAS_FOCUS}}}));
}}"""

DISPATCH_WHEEL = """() => {
  mograft.state.zoom = 1;
  const event = new WheelEvent("wheel", {deltaY: 100, bubbles: true, cancelable: true});
  document.querySelector(".stage canvas").dispatchEvent(event);
  return [event.defaultPrevented, mograft.state.zoom < 1];
}"""


@pytest.fixture
def notebook(browser, new, tmp_path):
    """A page that shows a graft above a long text."""
    path = tmp_path / "notebook.html"
    filler = "<div id='text' style='height:3000px'>text</div>"
    path.write_text(f"<!doctype html>{new._repr_html_()}{filler}", encoding="utf-8")
    page = browser.new_page(viewport={"width": 1000, "height": 800})
    page.set_default_timeout(TIMEOUT_MILLISECONDS)
    page.goto(path.as_uri())
    page.frame_locator("iframe").locator("#mograft[data-ready='1']").wait_for()
    page.frames[1].evaluate(RECORD_WHEEL)
    yield page
    page.close()


def describe(page):
    """Return the state of the notebook and of the view in it, for the message of a failure."""
    state = "focus: document.hasFocus(), active: document.activeElement.outerHTML.slice(0, 60)"
    outer = page.evaluate(f"({{scrollY, {state}}})")
    return outer, page.frames[1].evaluate(f"({{{state}, zoom: mograft.state.zoom, wheels}})")


def rest_at_top(page):
    """Scroll to the top, and wait until no earlier gesture moves the page any more."""
    n_at_rest = 0
    for _ in range(2_000):
        moved = page.evaluate("() => { const at = scrollY; scrollTo(0, 0); return at !== 0; }")
        n_at_rest = 0 if moved else n_at_rest + 1
        if n_at_rest == 10:
            return
        page.wait_for_timeout(50)
    raise AssertionError(f"the page never rested: {describe(page)}")


def give_focus(page, locator, *, to_view):
    """Click until the view has the focus, or has lost it."""
    for _ in range(N_TRIES):
        rest_at_top(page)
        locator.click(position={"x": 300, "y": 40})
        for _ in range(50):
            if page.frames[1].evaluate(HAS_FOCUS) == to_view:
                return
            page.wait_for_timeout(20)
    raise AssertionError(f"the focus did not move by a click: {describe(page)}")


def turn_wheel(page):
    """Turn the wheel above the view; return whether the page scrolls, and whether the view zooms.

    The result is a pair of truth values. Both are false if Chromium does not react within a second.
    """
    rest_at_top(page)
    page.frames[1].evaluate("mograft.state.zoom = 1")
    page.mouse.move(400, 200)
    page.wait_for_timeout(500)
    page.mouse.wheel(0, 100)
    effect = (False, False)
    for _ in range(50):
        before = effect
        page.wait_for_timeout(20)
        zooms = page.frames[1].evaluate("mograft.state.zoom !== 1")
        effect = (page.evaluate("scrollY > 50"), zooms)
        if any(effect) and effect == before:
            break
    return effect


def turn_wheel_until(page, expected):
    """Turn the wheel until it has the expected effect.

    Chromium sends all wheel events of a gesture to one target, and a pause ends the gesture. A
    gesture may have the wrong target if the machine is busy.
    """
    effects = []
    for _ in range(N_TRIES):
        effects.append(turn_wheel(page))
        if effects[-1] == expected:
            return
    raise AssertionError(f"expected {expected}, got {effects}: {describe(page)}")


def test_notebook_wheel_scrolls_until_view_has_focus(notebook):
    view = notebook.frames[1]
    stage = notebook.frame_locator("iframe").locator(".stage canvas")
    text = notebook.locator("#text")
    assert view.evaluate(DISPATCH_WHEEL) == [False, False]
    for has_focus in (False, True, False):
        give_focus(notebook, stage if has_focus else text, to_view=has_focus)
        assert view.evaluate(DISPATCH_WHEEL) == [has_focus, has_focus]
        turn_wheel_until(notebook, (not has_focus, has_focus))
    # Chromium ignores the answer to events of a gesture that it has already begun to scroll by.
    for wheel in view.evaluate("wheels"):
        assert wheel["prevented"] == wheel["focus"] or not wheel["cancelable"], describe(notebook)
