"""How the documentation is built: ``sphinx-build -W docs docs/_build``.

Pictures, the live viewer, the reference of the command line and that of the API are made at
build time from the code itself, so that they cannot fall behind it.
"""

import importlib
import inspect
import sys
from pathlib import Path
from types import ModuleType

import matplotlib as mpl

mpl.use("agg")
from matplotlib import pyplot

import mograft as mg
from mograft import cli, plot
from mograft.cli.parser import build_parsers
from mograft.dancer import dance
from mograft.scenario.walks import walk
from mograft.synthesis.stream import joined

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent / "benches"))
from collision import Trial  # noqa: E402 - the experiment is a script beside the package

MADE = HERE / "_made"

project = "mograft"
author = "the mograft authors"
release = mg.__version__
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
html_theme = "furo"
html_title = f"mograft {release}"
html_extra_path = ["_made/pages"]
exclude_patterns = ["_build", "_made/pages"]
# The n_joints of a shape is taken for a name, of which there are two.
suppress_warnings = ["config.cache", "ref.python"]
myst_heading_anchors = 3
myst_enable_extensions = ["dollarmath"]
napoleon_google_docstring = False
napoleon_use_ivar = True
autodoc_member_order = "bysource"
autodoc_typehints = "none"
autodoc_class_signature = "separated"


def make_pictures() -> None:
    """Draw the pictures of the concepts and the page that they embed."""
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
        "live": lambda: plot.strip(streamed(library)[300:1200], 10, groups="lower_upper"),
        "minute": lambda: plot.strip(minute.motion, 20, groups="lower_upper"),
        "pca": lambda: plot.pca(library),
        "dendrogram": lambda: plot.dendrogram(library),
        "clusters": lambda: plot.clusters(library),
    }
    for name, draw in drawings.items():
        draw().get_figure(root=True).savefig(MADE / f"{name}.png", dpi=110)
        pyplot.close("all")
    collides = Trial.of(dance(seed=3, strides=1).motion)
    assert collides is not None
    collides.draw(MADE / "collision.png")
    mg.view(new.base[:900], new.motion[:900], title="A graft", show=False).save(
        MADE / "pages" / "graft.html", force=True
    )
    mg.report_page([new]).save(MADE / "pages" / "report.html", force=True)


def streamed(library: mg.Library) -> mg.Motion:
    """Return what a stream makes of a dance that comes ten frames at a time."""
    base = dance(seed=2, strides=1).motion
    stream = mg.Stream(library, seed=7)
    pieces = []
    for frame in range(0, base.n_frames, 10):
        stream.push(base[frame : frame + 10])
        pieces += stream.pieces()
    stream.close()
    return joined(pieces + stream.pieces())


def make_command_line() -> None:
    """Write the reference of the command line from its parsers."""
    lines = ["# Command line", ""]
    for words, parser in build_parsers(cli.COMMANDS).items():
        if words:
            lines += [f"{'#' * (len(words) + 1)} {' '.join(('mograft', *words))}", ""]
        lines += ["```text", parser.format_help().rstrip(), "```", ""]
    lines += ["## Exit codes", "", inspect.getdoc(cli).split("\n\n")[1], ""]
    (MADE / "cli.md").write_text("\n".join(lines), encoding="utf-8")


def make_api() -> None:
    """Write a page that names all that is public."""
    parts: dict[str, list[str]] = {"Functions": [], "Classes": [], "Errors": []}
    for name in sorted(mg.__all__, key=str.lower):
        value = getattr(mg, name)
        if inspect.isclass(value):
            is_error = issubclass(value, Exception)
            options = "" if is_error else ":members:\n"
            kind = "Errors" if is_error else "Classes"
            directive = "autoexception" if is_error else "autoclass"
            parts[kind].append(
                f"```{{eval-rst}}\n.. {directive}:: mograft.{name}\n   {options}```\n"
            )
        elif inspect.isfunction(value):
            parts["Functions"].append(f"```{{eval-rst}}\n.. autofunction:: mograft.{name}\n```\n")
    modules = [getattr(mg, name) for name in mg.__all__ if inspect.ismodule(getattr(mg, name))]
    others = [importlib.import_module(f"mograft.{name}") for name in ("body.capsules", "dancer")]
    for module in (*modules, *others):
        title, entries = _module(module)
        parts[title] = entries
    lines = ["# API", ""]
    for title, entries in parts.items():
        lines += [f"## {title}", "", *entries]
    (MADE / "api.md").write_text("\n".join(lines), encoding="utf-8")


def _module(module: ModuleType) -> tuple[str, list[str]]:
    """Return the name of a module and the entries of its public names."""
    entries = [f"{inspect.getdoc(module).split(chr(10) * 2)[0]}\n"]
    for name in module.__all__:
        value = getattr(module, name)
        if hasattr(mg, name) and getattr(mg, name) is value:
            entries.append(f"`mograft.{name}`, above.\n")
        elif inspect.isfunction(value) or inspect.isclass(value):
            directive = "autofunction" if inspect.isfunction(value) else "autoclass"
            entries.append(f"```{{eval-rst}}\n.. {directive}:: {module.__name__}.{name}\n```\n")
    return module.__name__, entries


def make_depth() -> None:
    """Write a page that lists those that no other page does."""
    listed = set((HERE / "index.md").read_text(encoding="utf-8").split())
    others = [p.stem for p in sorted(HERE.glob("*.md")) if p.stem not in {"index", *listed}]
    lines = ["# In depth", "", "How single stages work, with what was measured.", ""]
    if others:
        lines += ["```{toctree}", *(f"/{name}" for name in others), "```", ""]
    (MADE / "depth.md").write_text("\n".join(lines), encoding="utf-8")


make_pictures()
make_depth()
make_command_line()
make_api()
