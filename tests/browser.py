"""A headless Chromium for the tests of pages, or the reason why there is none."""

import contextlib
import os
import shutil

import pytest


@contextlib.contextmanager
def chromium():
    """Start Chromium; skip the test where it or playwright is absent."""
    api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    path = os.environ.get("MOGRAFT_CHROMIUM") or next(
        filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None
    )
    if path is None:
        pytest.skip("no Chromium: install it, or set MOGRAFT_CHROMIUM to its path")
    switches = ["no-sandbox", "disable-gpu", "disable-sync"]
    switches += ["disable-background-networking", "disable-component-update"]
    with api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=path, args=[f"--{switch}" for switch in switches]
        )
        try:
            yield browser
        finally:
            browser.close()


@contextlib.contextmanager
def opened(browser, path, width=1280, height=800, theme="light"):
    """Open a page; fail on a word in its console and on any request but its own."""
    page = browser.new_page(viewport={"width": width, "height": height}, color_scheme=theme)
    said, asked = [], []
    page.on("console", lambda message: said.append(message.text))
    page.on("pageerror", lambda error: said.append(str(error)))
    page.on("request", lambda request: asked.append(request.url))
    page.goto(path.as_uri())
    page.wait_for_selector("#mograft[data-ready]", timeout=30_000)
    try:
        yield page
    finally:
        page.close()
    assert said == []
    assert asked == [path.as_uri()]
