"""Sphinx configuration: ``sphinx-build -W docs docs/_build``.

The build generates the pictures, the viewer page, and the references of the command line and of
the API from the code.
"""

import importlib
import inspect
from collections.abc import Mapping
from pathlib import Path
from types import ModuleType

import matplotlib as mpl

mpl.use("agg")
from matplotlib import pyplot
from sphinx.application import Sphinx

import mograft as mg
from mograft import cli
from mograft.cli.syntax.parser import build_parsers
from mograft.dancer import dance
from mograft.scenario import walk
from mograft.stream.stream import join_pieces
from mograft.viewing import plot

HERE = Path(__file__).parent
MADE = HERE / "_made"

project = "mograft"
author = "the mograft authors"
project_copyright = author
release = mg.__version__
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
html_theme = "furo"
html_title = f"mograft {release}"
html_extra_path = ["_made/pages"]
exclude_patterns = ["_build", "_made/pages"]
# Sphinx resolves the n_joints of a shape as a name, which is ambiguous.
suppress_warnings = ["config.cache", "ref.python"]
myst_heading_anchors = 3
myst_enable_extensions = ["dollarmath"]
napoleon_google_docstring = False
napoleon_use_ivar = True
autodoc_member_order = "bysource"
autodoc_typehints = "none"
autodoc_class_signature = "separated"


def make_pictures() -> None:
    """Draw the pictures and write the pages that the documentation embeds."""
    (MADE / "pages").mkdir(parents=True, exist_ok=True)
    motion = dance(seed=0, strides=2).motion
    library = mg.Library.build(motion)
    new = mg.graft(library, seed=7)
    minute = mg.graft(library, scenario=walk(library, 60.0, seed=7), seed=7)
    drawings = {
        "strip": lambda: plot.strip(motion[:900], 10, groups="lower_upper"),
        "graft": lambda: plot.strip(new.motion[:900], 10, groups="lower_upper"),
        "energy": lambda: plot.energy(motion[:300]),
        "timeline": lambda: plot.timeline(new, frames=(0, 300)),
        "live": lambda: plot.strip(stream_dance(library)[300:1200], 10, groups="lower_upper"),
        "minute": lambda: plot.strip(minute.motion, 20, groups="lower_upper"),
        "pca": lambda: plot.pca(library),
        "dendrogram": lambda: plot.dendrogram(library),
    }
    for name, draw in drawings.items():
        draw().get_figure(root=True).savefig(MADE / f"{name}.png", dpi=110)
        pyplot.close("all")
    mg.view(new, title="A graft", show=False).save(MADE / "pages" / "graft.html", force=True)
    mg.report_page([new]).save(MADE / "pages" / "report.html", force=True)


def stream_dance(library: mg.Library) -> mg.Motion:
    """Return the graft of a stream that receives ten frames at a time."""
    base = dance(seed=2, strides=1).motion
    stream = mg.Stream(library, seed=7)
    pieces = []
    for frame in range(0, base.n_frames, 10):
        stream.push(base[frame : frame + 10])
        pieces += stream.pieces()
    stream.close()
    return join_pieces(pieces + stream.pieces())


GALLERY = {
    "strip": ("Ten poses of the built-in dancer", "plot.strip(motion, 10)"),
    "graft": ("The same frames with grafted upper bodies", "plot.strip(graft.motion, 10)"),
    "timeline": ("Source of each part of a graft", "plot.timeline(graft)"),
    "energy": ("Kinetic energy and the segments cut at its extrema", "plot.energy(motion)"),
    "pca": ("Segments as points, coloured by cluster", "plot.pca(library)"),
    "dendrogram": ("Tree of complete linkage", "plot.dendrogram(library)"),
    "minute": ("A base of a minute from a random walk", "mg.graft(library, scenario=walk(...))"),
    "live": ("Graft of a stream that receives ten frames at a time", "mg.Stream(library)"),
}
"""Title and code of each picture, in the order of the gallery."""

PAGES = {
    "graft": ("A captured motion and a graft, side by side", "mg.view(graft)"),
    "report": ("Report with the source of each part", "mograft graft dance.bvh -o out --report"),
}
"""Title and code of each page."""


def make_gallery() -> None:
    """Write a page with all pictures and pages that the build has made."""
    lines = ["# Gallery", "", "The build of this documentation makes all pictures and pages.", ""]
    for name, (title, code) in PAGES.items():
        lines += [f'- <a href="../{name}.html">{title}</a>: `{code}`']
    for name, (title, code) in GALLERY.items():
        lines += ["", f"## {title}", "", f"`{code}`", "", f"![{title}]({name}.png)"]
    (MADE / "gallery.md").write_text("\n".join(lines) + "\n", encoding="utf-8")


def make_command_line() -> None:
    """Write the reference of the command line from its parsers."""
    lines = ["# Command line", ""]
    for words, parser in build_parsers().items():
        if words:
            lines += [f"{'#' * (len(words) + 1)} {' '.join(('mograft', *words))}", ""]
        lines += ["```text", parser.format_help().rstrip(), "```", ""]
    lines += ["## Exit codes", "", inspect.getdoc(cli).split("\n\n")[1], ""]
    (MADE / "cli.md").write_text("\n".join(lines), encoding="utf-8")


def make_api() -> None:
    """Write a page with every public name."""
    parts: dict[str, list[str]] = {"Functions": [], "Classes": [], "Errors": []}
    for name in sorted(mg.__all__, key=str.lower):
        value = getattr(mg, name)
        if inspect.isclass(value):
            is_error = issubclass(value, Exception)
            options = "" if is_error else ":members:\n"
            if any(base.__name__ == "LibraryData" for base in value.__mro__):
                options += "   :inherited-members:\n"
            kind = "Errors" if is_error else "Classes"
            directive = "autoexception" if is_error else "autoclass"
            parts[kind].append(
                f"```{{eval-rst}}\n.. {directive}:: mograft.{name}\n   {options}```\n"
            )
        elif inspect.isfunction(value):
            parts["Functions"].append(f"```{{eval-rst}}\n.. autofunction:: mograft.{name}\n```\n")
    modules = {name: getattr(mg, name) for name in mg.__all__}
    modules = {name: value for name, value in modules.items() if inspect.ismodule(value)}
    for name in ("body.capsules", "dancer"):
        modules[name] = importlib.import_module(f"mograft.{name}")
    for name, module in modules.items():
        parts[f"mograft.{name}"] = _module_entries(f"mograft.{name}", module)
    lines = ["# API", ""]
    for title, entries in parts.items():
        lines += [f"## {title}", "", *entries]
    (MADE / "api.md").write_text("\n".join(lines), encoding="utf-8")


def _module_entries(path: str, module: ModuleType) -> list[str]:
    """Return the summary of a module and the entries of its public names; users import `path`."""
    entries = [f"{inspect.getdoc(module).split(chr(10) * 2)[0]}\n"]
    for name in module.__all__:
        value = getattr(module, name)
        if hasattr(mg, name) and getattr(mg, name) is value:
            entries.append(f"`mograft.{name}`, above.\n")
        elif inspect.isfunction(value) or inspect.isclass(value):
            directive = "autofunction" if inspect.isfunction(value) else "autoclass"
            entries.append(f"```{{eval-rst}}\n.. {directive}:: {path}.{name}\n```\n")
        else:
            entries.append(_data_entry(f"{path}.{name}", value))
    return entries


def _data_entry(name: str, value: object) -> str:
    """Return the entry of a constant: its type, and the keys of a mapping."""
    text = "Constant."
    if isinstance(value, Mapping):
        text = f"Mapping with the keys {', '.join(f'``{key}``' for key in value)}."
    kind = type(value).__name__
    return f"```{{eval-rst}}\n.. py:data:: {name}\n   :type: {kind}\n\n   {text}\n```\n"


def make_depth() -> None:
    """Write a page that lists the pages missing from the index."""
    listed = set((HERE / "index.md").read_text(encoding="utf-8").split())
    others = [p.stem for p in sorted(HERE.glob("*.md")) if p.stem not in {"index", *listed}]
    lines = ["# In depth", "", "Further pages on single stages.", ""]
    if others:
        lines += ["```{toctree}", *(f"/{name}" for name in others), "```", ""]
    (MADE / "depth.md").write_text("\n".join(lines), encoding="utf-8")


def setup(app: Sphinx) -> None:  # noqa: ARG001
    """Make the generated pages; Sphinx calls this before it reads any page."""
    make_pictures()
    make_depth()
    make_gallery()
    make_command_line()
    make_api()
