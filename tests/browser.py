"""A headless Chromium for the tests of pages, or the reason why there is none."""

import contextlib
import os
import shutil
from pathlib import Path

import pytest

from tests.clients import FETCHED

PATIENCE = 120_000
"""Milliseconds: a busy machine is no error."""


def executable():
    """Return the path of a Chromium that is there, or None for playwright's own."""
    names = ("chromium", "chromium-browser", "google-chrome")
    return os.environ.get("MOGRAFT_CHROMIUM") or next(filter(None, map(shutil.which, names)), None)


@contextlib.contextmanager
def chromium():
    """Start Chromium; skip the test where it or playwright is absent."""
    api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    if (FETCHED / "browsers").is_dir():
        os.environ.setdefault("PLAYWRIGHT_BROWSERS_PATH", str(FETCHED / "browsers"))
    switches = ["no-sandbox", "disable-gpu", "disable-sync"]
    switches += ["disable-background-networking", "disable-component-update"]
    with api.sync_playwright() as playwright:
        path = executable() or playwright.chromium.executable_path
        if not Path(path).exists():
            pytest.skip("no Chromium: playwright install chromium, or set MOGRAFT_CHROMIUM")
        try:
            browser = playwright.chromium.launch(
                executable_path=path,
                args=[f"--{switch}" for switch in switches],
                timeout=PATIENCE,
            )
        except api.Error as error:
            # Most often a library of the system that it needs is not there.
            pytest.skip(f"{path} does not start: {str(error).splitlines()[0]}")
        try:
            yield browser
        finally:
            browser.close()


@contextlib.contextmanager
def opened(browser, path, width=1280, height=800, theme="light"):
    """Open a page; fail on a word in its console and on any request but its own."""
    page = browser.new_page(viewport={"width": width, "height": height}, color_scheme=theme)
    page.set_default_timeout(PATIENCE)
    said, asked = [], []
    page.on("console", lambda message: said.append(message.text))
    page.on("pageerror", lambda error: said.append(str(error)))
    page.on("request", lambda request: asked.append(request.url))
    page.goto(path.as_uri())
    page.wait_for_selector("#mograft[data-ready]")
    try:
        yield page
    finally:
        page.close()
    assert said == []
    assert asked == [path.as_uri()]


def until(page, condition):
    """Wait for it from outside: the page's own rules allow no script that would."""
    for _ in range(PATIENCE // 20):
        if page.evaluate(condition):
            return
        page.wait_for_timeout(20)
    raise AssertionError(f"never: {condition}")
