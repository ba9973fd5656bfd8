"""Pictures of the viewer in a browser without a window: characters with their meshes."""

import io
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from mograft._util.extras import import_extra
from mograft.body.groups import JointGroups
from mograft.motion.motion import Motion
from mograft.viewing.page import viewer_page
from mograft.viewing.scene import Scene

if TYPE_CHECKING:
    from PIL.Image import Image

_PROGRAMS = ("chromium", "chromium-browser", "google-chrome")

_SWITCHES = ("--use-angle=swiftshader", "--enable-unsafe-swiftshader")
"""Drawing by the processor: equal input gives equal pictures, also without a graphics card."""

_STYLE = """.viewer { position: fixed; inset: 0; }
.viewer > :not(.stage), .viewer .stage > :not(canvas) { display: none !important; }"""


def browser_pictures(
    motions: Sequence[Motion],
    size: tuple[int, int],
    groups: JointGroups | str | None,
    character: Path | None,
    *,
    dark: bool,
) -> "Iterator[Image]":
    """Yield one picture per frame of motions of one rate, as the viewer of a page shows them.

    `character` is a glTF file with the mesh of the figures; None means the files of the motions. A
    motion that has ended keeps its last frame. Raises ModuleNotFoundError without playwright, and
    OSError if Chromium does not start or does not draw.
    """
    api = import_extra("playwright.sync_api", "pictures of a browser need playwright", "browser")
    from PIL import Image

    scene = Scene.of(motions, groups).with_character(character)
    try:
        with (
            tempfile.TemporaryDirectory(prefix="mograft-") as folder,
            api.sync_playwright() as play,
        ):
            path = viewer_page(scene, "film").save(Path(folder) / "film.html")
            program = next(filter(None, map(shutil.which, _PROGRAMS)), None)
            browser = play.chromium.launch(executable_path=program, args=list(_SWITCHES))
            page = browser.new_page(
                viewport={"width": size[0], "height": size[1]},
                color_scheme="dark" if dark else "light",
                bypass_csp=True,  # for the style sheet that hides the controls
            )
            page.goto(path.as_uri())
            page.add_style_tag(content=_STYLE)
            page.wait_for_selector("#mograft[data-ready]")
            if page.evaluate("!document.querySelector('[data-part=reason]').hidden"):
                raise OSError("Chromium has no WebGL, which figures with meshes need")
            for frame in range(max(motion.n_frames for motion in motions)):
                page.evaluate(f"mograft.seek({frame})")
                picture = Image.open(io.BytesIO(page.screenshot()))
                yield picture.convert("RGB")
            browser.close()
    except api.Error as error:
        reason = str(error).strip().splitlines()[0]
        raise OSError(f"Chromium could not draw the film: {reason}") from error
