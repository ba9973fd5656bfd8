"""How the documentation is built: ``sphinx-build -W docs docs/_build``.

Pictures, the live viewer, the reference of the command line and that of the API are made at
build time from the code itself, so that they cannot fall behind it.
"""

import argparse
import inspect
from pathlib import Path

import matplotlib as mpl

mpl.use("agg")
from matplotlib import pyplot

import mograft as mg
from mograft import cli, evaluation, plot
from mograft.dancer import dance

HERE = Path(__file__).parent
MADE = HERE / "_made"

project = "mograft"
author = "the mograft authors"
release = mg.__version__
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
html_theme = "furo"
html_title = f"mograft {release}"
html_extra_path = ["_made/pages"]
exclude_patterns = ["_build", "_made/pages"]
suppress_warnings = ["config.cache"]
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
    drawings = {
        "strip": lambda: plot.strip(motion[:900], 10, groups="lower_upper"),
        "graft": lambda: plot.strip(new.motion[:900], 10, groups="lower_upper"),
        "energy": lambda: plot.energy(motion[:300]),
        "timeline": lambda: plot.timeline(new, frames=(0, 300)),
        "pca": lambda: plot.pca(library),
        "dendrogram": lambda: plot.dendrogram(library),
        "clusters": lambda: plot.clusters(library),
    }
    for name, draw in drawings.items():
        draw().get_figure(root=True).savefig(MADE / f"{name}.png", dpi=110)
        pyplot.close("all")
    mg.view(new.base[:900], new.motion[:900], title="A graft", show=False).save(
        MADE / "pages" / "graft.html", force=True
    )
    mg.report_page([new]).save(MADE / "pages" / "report.html", force=True)


def make_command_line() -> None:
    """Write the reference of the command line from its parser."""
    parser = cli._parser()
    lines = ["# Command line", "", "```text", parser.format_help().rstrip(), "```", ""]
    (commands,) = (a for a in parser._actions if isinstance(a, argparse._SubParsersAction))
    for name, command in commands.choices.items():
        lines += [f"## mograft {name}", "", "```text", command.format_help().rstrip(), "```", ""]
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
    for name in plot.__all__:
        if inspect.isfunction(getattr(plot, name)):
            parts.setdefault("mograft.plot", []).append(
                f"```{{eval-rst}}\n.. autofunction:: mograft.plot.{name}\n```\n"
            )
    for name in evaluation.__all__:
        kind = "autoclass" if inspect.isclass(getattr(evaluation, name)) else "autofunction"
        options = "   :members:\n" if kind == "autoclass" else ""
        parts.setdefault("mograft.evaluation", []).append(
            f"```{{eval-rst}}\n.. {kind}:: mograft.evaluation.{name}\n{options}```\n"
        )
    lines = ["# API", ""]
    for title, entries in parts.items():
        lines += [f"## {title}", "", *entries]
    (MADE / "api.md").write_text("\n".join(lines), encoding="utf-8")


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
