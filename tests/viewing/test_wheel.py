"""In a notebook, the wheel scrolls the notebook until the view has the focus; then it zooms."""

import pytest

from tests.browser import TIMEOUT_MILLISECONDS

pytestmark = pytest.mark.browser

N_TRIES = 20
"""Clicks until Chromium moves the focus; usually the first one suffices."""

HAS_FOCUS = (
    "(document.hasFocus() && document.querySelector('#mograft').contains(document.activeElement))"
)

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
    yield page
    page.close()


def test_notebook_wheel_scrolls_until_view_has_focus(notebook):
    view = notebook.frames[1]
    stage = notebook.frame_locator("iframe").locator(".stage canvas")
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
