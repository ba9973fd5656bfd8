"""Make the film in the README and the picture of the demo page: ``python -m tests.looks``."""

import tempfile
from pathlib import Path

from PIL import Image

import mograft as mg
from mograft.cli import main as command
from tests.browser import chromium, open_page


def readme_pictures():
    """Run ``mograft demo``; save a film as ``docs/demo.gif`` and its page as ``docs/demo.png``."""
    target = Path(__file__).parents[1] / "docs" / "demo.png"
    with tempfile.TemporaryDirectory() as folder, chromium() as browser:
        command(["demo", "-o", folder])
        names = ("dance", "dance_graft1", "dance_graft2")
        motions = [mg.read_bvh(f"{folder}/{name}.bvh")[1080:1156] for name in names]
        film, look = target.with_suffix(".gif"), {"size": (720, 280), "groups": "lower_upper"}
        film.unlink(missing_ok=True)
        mg.write_video(motions, film, rate=10, **look)
        with open_page(browser, Path(folder) / "index.html", 1000, 720) as page:
            page.evaluate("mograft.seek(150)")
            page.screenshot(path=target)
    image = Image.open(target).quantize(64, dither=Image.Dither.NONE)
    image.save(target, optimize=True)
    for path in (film, target):
        print(path, path.stat().st_size, "bytes")


if __name__ == "__main__":
    readme_pictures()
