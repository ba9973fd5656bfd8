"""One self-contained HTML page: no network, no file beside it, no script but its own."""

import base64
import hashlib
import html
import json
import os
import sys
import tempfile
import webbrowser
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

from mograft._util.atomic import write_text
from mograft.body.groups import JointGroups
from mograft.io.bvh import read_bvh
from mograft.library.library import Library
from mograft.motion.motion import Motion
from mograft.synthesis.graft import Graft
from mograft.viewing.scene import POINTS, Scene

__all__ = ["Page", "embedded", "inline", "view"]

_INLINE = 300_000
Item = Motion | Graft | Library | Scene | str | os.PathLike[str]


@dataclass(frozen=True)
class Page:
    """An HTML page that needs nothing but a browser.

    Attributes
    ----------
    title : str
        Its title.
    html : str
        The whole page.
    """

    title: str
    html: str

    def __repr__(self) -> str:
        return f"Page({self.title!r}, {len(self.html.encode()) / 1000:.0f} KB)"

    def _repr_html_(self) -> str:
        return inline(self.html, self.title)

    def save(self, path: str | os.PathLike[str], *, force: bool = False) -> Path:
        """Write the page to a file, whole or not at all.

        Parameters
        ----------
        path : str or path
            The file.
        force : bool
            Whether to overwrite one that is there.

        Returns
        -------
        Path
            The file.

        Raises
        ------
        FileExistsError
            If the file is there and `force` is not given.
        """
        target = Path(path)
        if target.exists() and not force:
            raise FileExistsError(f"{target} exists; force=True overwrites")
        write_text(target, self.html)
        return target

    def open(self) -> bool:
        """Show the page in the browser, from a file in the folder for temporary ones.

        Returns
        -------
        bool
            Whether a browser was found.
        """
        return open_file(self.save(temporary_path()))


def view(
    *items: Item,
    groups: JointGroups | str | None = None,
    title: str | None = None,
    show: bool | None = None,
) -> Page:
    """Show motions side by side, with the timeline of their segments.

    Parameters
    ----------
    *items : Motion, Graft, Library, Scene, or path of a BVH file
        What to show. Each graft is shown after its base; each motion once.
    groups : JointGroups or str, optional
        The joint groups that plain motions are coloured by, or the name of a preset.
        Default: those of the grafts and libraries, else trunk, arms and legs.
    title : str, optional
        The page's title. Default: the names of what is shown.
    show : bool, optional
        Whether to open the browser. Default: where Python runs in a terminal; a notebook
        shows the page inline when it is the value of a cell.

    Returns
    -------
    Page
        The page, which can be saved.

    Raises
    ------
    TypeError, ValueError
        If there is nothing to show, an item is none of these, or the groups do not fit.
    BvhError
        If a file is no BVH motion.

    Examples
    --------
    >>> from mograft.dancer import dance
    >>> page = view(dance(strides=1).motion[:100], title="The dancer", show=False)
    >>> page.html.startswith("<!doctype html>")
    True
    """
    read = [read_bvh(item) if isinstance(item, str | os.PathLike) else item for item in items]
    scene = Scene.of(read, groups)
    named = title or " and ".join(figure.name for figure in scene.figures[:3])
    page = document(scene, named)
    if (_wants_browser() if show is None else show) and not page.open():
        print("mograft: no browser found; save the page with .save(path)", file=sys.stderr)
    return page


def document(scene: Scene, title: str, points: int = POINTS) -> Page:
    """Return the page of a scene alone.

    Parameters
    ----------
    scene : Scene
        What to show.
    title : str
        The page's title.
    points : int
        How many places of nodes it may hold; of longer motions not every frame is kept.

    Returns
    -------
    Page
        The page.
    """
    return assembled(title, viewer(scene, points), "alone")


def embedded(item: Motion | Graft) -> str:
    """Return one thing as notebooks show it, long motions with fewer frames.

    Parameters
    ----------
    item : Motion or Graft
        What to show.

    Returns
    -------
    str
        HTML, of a megabyte or two at most.
    """
    scene = Scene.of([item])
    return inline(document(scene, scene.figures[0].name, _INLINE).html, scene.figures[0].name)


def viewer(scene: Scene, points: int = POINTS) -> str:
    """Return the part of a page that shows a scene; a page holds one at most."""
    return f"{_part('viewer.html')}\n{data(scene.as_dict(points))}"


def assembled(title: str, body: str, kind: str, style: str = "", script: str | None = None) -> Page:
    """Return a whole page that may run one script and nothing else.

    Parameters
    ----------
    title : str
        Its title, as plain text.
    body : str
        Its content, with the viewer in it.
    kind : {"alone", "report"}
        Whether the viewer fills the page.
    style : str
        More style.
    script : str, optional
        The script. Default: the viewer's.

    Returns
    -------
    Page
        The page.
    """
    # A name in a file may hold half a pair of surrogates, which no page can.
    title, body = (text.encode("utf-8", "replace").decode("utf-8") for text in (title, body))
    script = _part("viewer.js") if script is None else script
    sheet = _part("viewer.css") + style
    # Names in the page come from files: should one slip through as a tag after all, it finds
    # that no script but this and no address at all is allowed.
    policy = (
        f"default-src 'none'; img-src data:; base-uri 'none'; form-action 'none'; "
        f"script-src '{_digest(script)}'; style-src '{_digest(sheet)}'"
    )
    return Page(
        title,
        "<!doctype html>\n"
        '<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f'<meta http-equiv="Content-Security-Policy" content="{policy}">'
        f"<title>{html.escape(title)}</title>"
        f"<style>{sheet}</style></head>\n"
        f'<body class="{kind}">\n{body}\n<script>{script}</script>\n</body></html>\n',
    )


def inline(page: str, title: str, height: int = 620) -> str:
    """Return a page as an element of another one, as notebooks show it.

    Parameters
    ----------
    page : str
        The whole page.
    title : str
        What it shows, for those who do not see it.
    height : int
        In pixels.

    Returns
    -------
    str
        An ``iframe`` that holds the page and can reach nothing outside of it.
    """
    return (
        f'<iframe sandbox="allow-scripts" srcdoc="{html.escape(page)}" '
        f'title="{html.escape(title)}" '
        f'style="width:100%;height:{height}px;border:1px solid #8888;border-radius:8px"></iframe>'
    )


def temporary_path() -> Path:
    """Return the path of a page in a new temporary folder."""
    return Path(tempfile.mkdtemp(prefix="mograft-")) / "view.html"


def open_file(path: Path) -> bool:
    """Open a file in the browser; tell whether there is one."""
    return webbrowser.open(path.resolve().as_uri())


def _wants_browser() -> bool:
    if "ipykernel" in sys.modules:
        return False
    return sys.stdout is not None and sys.stdout.isatty()


def data(values: dict[str, Any]) -> str:
    """Return values as JSON that no text in it can break out of."""
    text = json.dumps(values, separators=(",", ":"), ensure_ascii=True)
    for letter in "<>&":
        text = text.replace(letter, f"\\u{ord(letter):04x}")
    return f'<script type="application/json" id="mograft-data">{text}</script>'


def _digest(text: str) -> str:
    return "sha256-" + base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()


@cache
def _part(name: str) -> str:
    return files("mograft.viewing").joinpath(name).read_text(encoding="utf-8").strip()
