"""Self-contained HTML pages: they load nothing and run only the script that they contain."""

import base64
import hashlib
import html
import json
import os
import re
import sys
import tempfile
import webbrowser
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

from mograft._util.atomic import write_text
from mograft.body.groups import JointGroups
from mograft.config import Config
from mograft.motion.motion import Motion
from mograft.motion.skeleton import Skeleton
from mograft.synthesis.graft_result import Graft
from mograft.viewing.encoding import MAX_ROTATIONS, encode_scene
from mograft.viewing.scene import Item, Scene

_MAX_NOTEBOOK_ROTATIONS = 200_000
"""Maximum number of joint rotations in a notebook cell, which is saved with the notebook."""

_SCRIPTS = (
    *("scene", "poses", "colours", "character", "actors", "player", "objects", "stage"),
    *("choices", "timeline", "figures", "details", "input", "main"),
)
"""The modules of the viewer's script; each imports only from those before it."""

_MAX_SHOWN = 12
"""Maximum number of figures that a page shows at first."""


@dataclass(frozen=True)
class Page:
    """A self-contained HTML page.

    Attributes
    ----------
    title : str
        The title as plain text.
    html : str
        The HTML of the page.
    """

    title: str
    html: str

    def __repr__(self) -> str:
        return f"Page({self.title!r}, {len(self.html.encode()) / 1000:.0f} KB)"

    def _repr_html_(self) -> str:
        # Isolated from the notebook around it; the title is for screen readers.
        return (
            f'<iframe sandbox="allow-scripts" srcdoc="{html.escape(self.html)}" '
            f'title="{html.escape(self.title)}" '
            'style="width:100%;height:620px;border:1px solid #8888;border-radius:8px"></iframe>'
        )

    def save(self, path: str | os.PathLike[str], *, force: bool = False) -> Path:
        """Write the page to a file; a failure leaves no partial file.

        Parameters
        ----------
        path : str or path
            The file.
        force : bool
            Whether to overwrite an existing file.

        Returns
        -------
        Path
            The file.

        Raises
        ------
        FileExistsError
            If the file exists and `force` is false.
        """
        target = Path(path)
        if target.exists() and not force:
            raise FileExistsError(f"{target} exists; force=True overwrites it")
        write_text(target, self.html)
        return target

    def open(self) -> bool:
        """Open the page in the browser, from a temporary file.

        Returns
        -------
        bool
            Whether a browser was found.
        """
        return open_file(self.save(temporary_path()))


def view(
    *items: Item,
    groups: JointGroups | str | None = None,
    config: Config | None = None,
    title: str | None = None,
    show: bool | None = None,
    skeleton: Skeleton | None = None,
) -> Page:
    """Show motions side by side, with the timeline of their segments.

    Parameters
    ----------
    *items : Motion, Graft, Library, Scene, or address of motions
        What to show. A graft is shown after its base. A motion that occurs twice is shown once.
        A file beside which ``mograft graft`` wrote a .json file is shown as a graft with its
        donors, after its base if the file of the base is found unchanged.
    groups : JointGroups or str, optional
        The joint groups that set the colours of motions, or the name of a preset. Default: the
        groups of the first library with the same joint names (an item, or the library of a
        graft), otherwise trunk, arms and legs. `groups` have no effect on grafts, their bases
        and the clips of these libraries, which have the colours of their library or .json file,
        and on the figures of a scene.
    config : Config, optional
        Parameters of the segmentation of motions that are in none of these libraries.
    title : str, optional
        Title of the page. Default: the names of the first three figures.
    show : bool, optional
        Whether to open the browser. Default: True if Python runs in a terminal. A notebook shows
        the page inline if the page is the value of a cell.
    skeleton : Skeleton, optional
        Rest pose for files that store none, such as those of AMASS; see `read`. Default: the
        stand-in of the reader.

    Returns
    -------
    Page
        The page.

    Raises
    ------
    TypeError, ValueError
        If there is no item, an item has another type, or the groups do not fit.
    FormatError
        If a file is invalid.

    Examples
    --------
    >>> from mograft.dancer import dance
    >>> page = view(dance(strides=1).motion[:100], title="The dancer", show=False)
    >>> page.html.startswith("<!doctype html>")
    True
    """
    scene = Scene.of(items, groups, config, skeleton)
    page = viewer_page(scene, title or " and ".join(own.name for own in scene.figures[:3]))
    if show is None:
        is_terminal = sys.stdout is not None and sys.stdout.isatty()
        show = is_terminal and "ipykernel" not in sys.modules
    if show and not page.open():
        print("mograft: no browser found; save the page with .save(path)", file=sys.stderr)
    return page


def viewer_page(scene: Scene, title: str, max_rotations: int = MAX_ROTATIONS) -> Page:
    """Return a page that contains only the viewer; see `encode_scene` for `max_rotations`."""
    return assemble_page(title, viewer_html(scene, max_rotations), "alone")


def notebook_view(item: Motion | Graft) -> str:
    """Return the HTML that shows a motion or graft in a notebook cell.

    It has at most about two megabytes, because only every n-th frame of long motions is stored.
    """
    scene = Scene.of([item])
    return viewer_page(scene, scene.figures[0].name, _MAX_NOTEBOOK_ROTATIONS)._repr_html_()


def viewer_html(scene: Scene, max_rotations: int = MAX_ROTATIONS, n_shown: int = _MAX_SHOWN) -> str:
    """Return the HTML of the viewer with a scene; a page can contain only one viewer.

    The page shows the first `n_shown` figures until the reader chooses others. The positions of
    each figure are in a separate element, which the script reads when it first shows the figure.
    """
    data = encode_scene(scene, max_rotations, n_shown)
    characters = [own["clip"] for own in data["objects"] if own["kind"] == "figure"]
    elements = [asset("viewer.html")]
    for index, clip in enumerate([*data["clips"], *characters, *data["windows"].values()]):
        clip["data"] = f"mograft-poses-{index}"
        poses = {key: clip.pop(key) for key in ("units", "pose")}
        elements.append(embed_json(poses, clip["data"]))
    for index, character in enumerate(data["characters"]):
        character["data"] = f"mograft-character-{index}"
        stored = {key: character.pop(key) for key in ("arrays", "textures")}
        elements.append(embed_json(stored, character["data"]))
    return "\n".join([*elements, embed_json(data)])


def viewer_script() -> str:
    """Return the script of the viewer: its modules in one scope, without imports and exports."""
    text = "\n".join(asset(f"script/{name}.js") for name in _SCRIPTS)
    body = re.sub(r"^(?:import .*\n|export (?=\w))", "", text, flags=re.MULTILINE)
    return f'"use strict";\n(() => {{\n{body}\n}})();'


def assemble_page(
    title: str, body: str, kind: str, style: str = "", script: str | None = None
) -> Page:
    """Return a page whose content security policy allows only its script and its style sheet.

    `title` is plain text, `body` is HTML. `kind` is ``"report"`` for a page of text, or ``"alone"``
    if the viewer fills the page. `style` is appended to the style sheet of the viewer. `script`
    replaces the script of the viewer; "" means no script.
    """
    # A name in a file may contain a lone surrogate, which UTF-8 cannot encode.
    title, body = (text.encode("utf-8", "replace").decode("utf-8") for text in (title, body))
    scripts = [asset("three.js"), viewer_script()] if script is None else [script]
    sheet = asset("viewer.css") + style
    # Additional protection against names from files that contain HTML: the browser runs only
    # this script and loads nothing.
    policy = (
        f"default-src 'none'; img-src data:; base-uri 'none'; form-action 'none'; "
        f"script-src {' '.join(map(_quoted_digest, scripts))}; style-src {_quoted_digest(sheet)}"
    )
    return Page(
        title,
        "<!doctype html>\n"
        '<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f'<meta http-equiv="Content-Security-Policy" content="{policy}">'
        f"<title>{html.escape(title)}</title>"
        f"<style>{sheet}</style></head>\n"
        f'<body class="{kind}">\n{body}\n'
        + "\n".join(f"<script>{text}</script>" for text in scripts)
        + "\n</body></html>\n",
    )


def temporary_path() -> Path:
    """Create a temporary folder, and return a path for a page in it."""
    return Path(tempfile.mkdtemp(prefix="mograft-")) / "view.html"


def open_file(path: Path) -> bool:
    """Open a file in the browser; return whether a browser was found."""
    return webbrowser.open(path.resolve().as_uri())


def embed_json(values: dict[str, Any], name: str = "mograft-data") -> str:
    """Return an HTML script element with values as JSON and the id `name`.

    The characters <, > and & are escaped, so that no string among the values closes the element.
    """
    text = json.dumps(values, separators=(",", ":"), ensure_ascii=True)
    for letter in "<>&":
        text = text.replace(letter, f"\\u{ord(letter):04x}")
    return f'<script type="application/json" id="{name}">{text}</script>'


def _quoted_digest(text: str) -> str:
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"


def asset(name: str) -> str:
    """Return the text of a file in `mograft.viewing`, without white space at its ends."""
    return files("mograft.viewing").joinpath(name).read_text(encoding="utf-8").strip()
