"""The pictures of docs/studio.md: ``python -m tests.studio.pictures KNIGHT.glb docs/figures``."""

import sys
import tempfile
from pathlib import Path

from PIL import Image

from tests.browser import chromium
from tests.studio.story import studio


def main(source, target):
    """Play the story on a character, and write a picture of each state."""
    with tempfile.TemporaryDirectory() as name, chromium() as browser:
        folder = Path(name)

        def save(page, picture):
            page.wait_for_timeout(1500)  # until the figures and cards are drawn
            page.screenshot(path=folder / "page.png")
            with Image.open(folder / "page.png") as found:
                found.save(target / f"studio-{picture}.webp", quality=72, method=6)

        with studio(browser, folder / "session") as person:
            page = person.page
            person.drop(source)
            page.get_by_role("tab", name="New motions").click()
            page.get_by_role("combobox", name="base motion", exact=True).first.select_option(
                "Walking_A"
            )
            person.button("Make 12 motions").click()
            person.until("state.motions.length >= 12 && !state.jobs.length")
            page.locator(".card .preview").nth(1).click()
            page.get_by_role("button", name="Favourite").nth(1).click()
            page.get_by_role("button", name="Reject").nth(2).click()
            save(page, "motions")
            person.blocks("upper").nth(2).click()
            page.locator("table.donors tbody tr").nth(1).hover()
            save(page, "donors")
            page.locator("table.donors button:enabled", has_text="Use").first.click()
            person.until_second("motion.constraints.length")
            person.button("Lock").click()
            person.until_second("motion.locks.length")
            page.keyboard.press("Escape")
            page.get_by_role("tab", name="Obstacles, targets").click()
            person.button("Add").click()
            person.until_second("motion.constraints.length > 1")
            save(page, "obstacle")
            page.get_by_role("tab", name="New motions").click()
            page.locator(".card").nth(1).get_by_label("Keep").check()
            person.button("Export 1 motion…").click()
            person.button("Export").click()
            page.locator(".dialog .result bdi").wait_for()
            save(page, "export")


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:]))
