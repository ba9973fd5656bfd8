"""A headless Chromium for the tests of pages; the tests skip without one."""

import contextlib
import os
import shutil
from pathlib import Path

import pytest

from tests.clients import FETCHED

TIMEOUT_MILLISECONDS = 120_000
"""Long enough for a busy machine."""


def executable():
    """Return the path of an installed Chromium, or None for the one of playwright."""
    names = ("chromium", "chromium-browser", "google-chrome")
    return os.environ.get("MOGRAFT_CHROMIUM") or next(filter(None, map(shutil.which, names)), None)


@contextlib.contextmanager
def chromium():
    """Start Chromium; skip the test if it or playwright is not installed."""
    api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    if (FETCHED / "browsers").is_dir():
        os.environ.setdefault("PLAYWRIGHT_BROWSERS_PATH", str(FETCHED / "browsers"))
    switches = ["no-sandbox", "use-angle=swiftshader", "enable-unsafe-swiftshader", "disable-sync"]
    switches += ["disable-background-networking", "disable-component-update"]
    with api.sync_playwright() as playwright:
        path = executable() or playwright.chromium.executable_path
        if not Path(path).exists():
            pytest.skip("no Chromium: playwright install chromium, or set MOGRAFT_CHROMIUM")
        try:
            browser = playwright.chromium.launch(
                executable_path=path,
                args=[f"--{switch}" for switch in switches],
                timeout=TIMEOUT_MILLISECONDS,
            )
        except api.Error as error:
            # Usually a system library is missing.
            pytest.skip(f"{path} does not start: {str(error).splitlines()[0]}")
        try:
            yield browser
        finally:
            browser.close()


HELPERS = """() => {
  const { scene, state, timeline, actorOf, commandOf, describe, preview } = mograft;
  const { clips } = scene;
  const segment = (row, part) => ({ line: timeline.lines[row], part });
  const given = { describe, preview };
  Object.assign(mograft, {
    pose: (index, frame) => {
      const clip = clips[index];
      const pose = mograft.setPose(clip, frame, mograft.makePose(clip));
      const nodes = Array.from({ length: clip.parents.length + clip.ends.length }, (_, i) => i);
      return nodes.flatMap((node) => mograft.nodePlace(clip, pose, node));
    },
    skin: (index) => {
      const { meshes } = actorOf(clips[index]);
      const { skeleton } = meshes.find(({ userData }) => !userData.isRigid);
      skeleton.update();
      return Array.from(skeleton.boneMatrices);
    },
    pin: (row, part) => { state.pinned = segment(row, part); },
    describe: (row, part) => given.describe(segment(row, part)),
    preview: (row, part, own) => given.preview(segment(row, part), own),
    command: (index) => commandOf(clips[index]),
    offset: (row) => timeline.offsets[row],
    isLoaded: (index) => Boolean(clips[index].values),
    isWindowLoaded: (name) => Boolean(scene.windows[name].values),
  });
}"""
"""Functions of the tests, in terms of those of the page."""


@contextlib.contextmanager
def new_page(browser, width=1280, height=800, theme="light", expected=(), **options):
    """Open an empty page; fail on console output, except for `expected` words.

    The attribute ``requests`` of the page has the addresses that it requests.
    """
    size = {"width": width, "height": height}
    page = browser.new_page(viewport=size, color_scheme=theme, **options)
    page.set_default_timeout(TIMEOUT_MILLISECONDS)
    messages, page.requests = [], []
    page.on("console", lambda message: messages.append(message.text))
    page.on("pageerror", lambda error: messages.append(str(error)))
    page.on("request", lambda request: page.requests.append(request.url))
    try:
        yield page
    finally:
        page.close()
    assert [own for own in messages if not any(word in own for word in expected)] == []


@contextlib.contextmanager
def open_page(browser, path, width=1280, height=800, theme="light"):
    """Open a page; fail on console output and on requests other than for the page."""
    with new_page(browser, width, height, theme) as page:
        page.goto(path.as_uri())
        page.wait_for_selector("#mograft[data-ready]", state="attached")
        page.evaluate(HELPERS)
        yield page
    assert page.requests == [path.as_uri()]


def wait_until(page, condition):
    """Poll a condition from outside, as the page's policy forbids the script of playwright."""
    for _ in range(TIMEOUT_MILLISECONDS // 20):
        if page.evaluate(condition):
            return
        page.wait_for_timeout(20)
    raise AssertionError(f"the condition never held: {condition}")
