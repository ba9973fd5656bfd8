"""Save pictures of all visual output, for review: ``python -m tests.looks FOLDER [FILE]``.

The viewer and the report in Chromium, every kind of plot, and the first second of a film, each
light and dark and 1280 and 480 pixels wide, of a BVH file or the built-in dancer.
``python -m tests.looks --readme`` makes the film in the README and the picture of the demo page.
"""

import sys
import tempfile
import warnings
from pathlib import Path

import matplotlib as mpl
from matplotlib import pyplot
from PIL import Image

import mograft as mg
from mograft.cli import main as command
from mograft.dancer import dance
from mograft.viewing import plot
from tests.browser import chromium, open_page

THEMES = ("light", "dark")
WIDTHS = {1280: 800, 480: 850}
DPI = 100


def pages(folder, grafts):
    """Save the viewer with one and two figures, overlaid and with its keys, and the report."""
    new, *_ = grafts
    paths = {
        "viewer": mg.view(new, show=False).save(folder / "viewer.html", force=True),
        "one": mg.view(new.base, show=False).save(folder / "one.html", force=True),
        "report": mg.report_page(grafts).save(folder / "report.html", force=True),
    }
    with chromium() as browser:
        for theme in THEMES:
            for width, height in WIDTHS.items():
                for name, path in paths.items():
                    with open_page(browser, path, width, height, theme) as page:
                        page.evaluate("mograft.seek(Math.min(75, mograft.frames - 1))")
                        target = folder / f"{name}-{theme}-{width}.png"
                        page.screenshot(path=target, full_page=name == "report")
                        if name == "viewer":
                            page.keyboard.press("o")
                            page.keyboard.press("t")
                            page.evaluate("mograft.seek(90)")
                            page.screenshot(path=folder / f"overlay-{theme}-{width}.png")
                            page.keyboard.press("?")
                            page.screenshot(path=folder / f"keys-{theme}-{width}.png")


def plots(folder, new):
    """Draw every kind of plot."""
    library, motion = new.library, new.motion[:900]
    last = min(300, motion.n_frames - 1)
    kinds = {
        "strip": (2.2, lambda ax, poses: plot.strip(motion, poses, groups="lower_upper", ax=ax)),
        "energy": (2.8, lambda ax, _: plot.energy(motion[: last + 1], ax=ax)),
        "timeline": (1.7, lambda ax, _: plot.timeline(new, frames=(0, last), ax=ax)),
        "pca": (5.0, lambda ax, _: plot.pca(library, ax=ax)),
        "dendrogram": (4.0, lambda ax, _: plot.dendrogram(library, ax=ax)),
        "clusters": (3.0, lambda ax, _: plot.clusters(library, ax=ax)),
    }
    for theme in THEMES:
        style = "dark_background" if theme == "dark" else "default"
        with mpl.rc_context(), pyplot.style.context(style):
            for width in WIDTHS:
                for name, (height, draw) in kinds.items():
                    size = (width / DPI, height)
                    figure, ax = pyplot.subplots(figsize=size, layout="constrained")
                    draw(ax, 12 if width > 600 else 5)
                    figure.savefig(folder / f"{name}-{theme}-{width}.png", dpi=DPI)
                    pyplot.close(figure)


def films(folder, new):
    """Save the first second as a GIF."""
    for theme in THEMES:
        for width in WIDTHS:
            mg.write_video(
                [new.base[:30], new.motion[:30]],
                folder / f"film-{theme}-{width}.gif",
                size=(width, width * 5 // 8),
                dark=theme == "dark",
            )


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


def main(words):
    if words == ["--readme"]:
        readme_pictures()
        return
    folder = Path(words[0])
    folder.mkdir(parents=True, exist_ok=True)
    mpl.use("agg")
    motion = mg.read_bvh(words[1]) if len(words) > 1 else dance(seed=0, strides=2).motion
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        grafts = list(mg.graft_many(mg.Library.build(motion), count=2, seed=7))
    plots(folder, grafts[0])
    films(folder, grafts[0])
    pages(folder, grafts)
    for path in sorted(folder.iterdir()):
        print(path)


if __name__ == "__main__":
    main(sys.argv[1:])
