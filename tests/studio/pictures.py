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

        with studio(browser, folder / "session") as person:

            def save(picture):
                person.page.wait_for_timeout(1500)  # until the figures and cards are drawn
                person.page.screenshot(path=folder / "page.png")
                with Image.open(folder / "page.png") as found:
                    found.save(target / f"studio-{picture}.webp", quality=72, method=6)

            person.play_story(source, "Walking_A", save)


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:]))
