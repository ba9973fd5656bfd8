"""``mograft view``: motions side by side in the browser."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mograft.cli._common import (
    check_free,
    chosen_clips,
    expanded,
    given,
    library_folder,
    print_json,
    say,
)
from mograft.cli.graft import chosen_groups

if TYPE_CHECKING:
    from mograft.viewing.scene import Scene


def add(commands: Any) -> None:  # noqa: ANN401 - argparse keeps the type to itself
    """Add the command to the parser."""
    view = commands.add_parser("view", help="show motions side by side in the browser")
    view.add_argument("files", nargs="+", metavar="FILE", help="BVH files, or a library")
    view.add_argument(
        "--clip",
        action="append",
        default=[],
        metavar="NAME",
        help="clips of a library, as walk*; may be repeated",
    )
    view.add_argument("--groups", metavar="NAME|FILE", help="joint groups to colour by")
    view.add_argument("--title", help="title of the page")
    view.add_argument(
        "-o", "--output", type=Path, help="page to write; default: a temporary one, opened"
    )
    view.add_argument("--open", action="store_true", help="open the page that was written")
    view.add_argument("--json", action="store_true", help="tell as JSON what was written")
    view.add_argument("--force", action="store_true", help="overwrite what is there")
    view.set_defaults(run=run, usage=view.error)


def run(options: argparse.Namespace) -> int:
    """Run the command."""
    from mograft.viewing.page import open_file, temporary, view

    if options.output is not None:
        check_free([options.output], force=options.force)
    folder = library_folder(options)
    if options.clip and folder is None:
        options.usage("--clip chooses clips of a library")
    if folder is None:
        groups = None if options.groups is None else chosen_groups(options)
        page = view(*expanded(options.files), groups=groups, title=options.title, show=False)
    else:
        page = view(_clips(folder, options), title=options.title, show=False)
    if options.output is not None:
        options.output.parent.mkdir(parents=True, exist_ok=True)
    path = page.save(temporary() if options.output is None else options.output, force=True)
    if options.json:
        print_json({"schema": "mograft.view/1", "file": str(path), "title": page.title})
    else:
        print(path)
    if (options.output is None or options.open) and not open_file(path):
        say("no browser was found: open the page yourself")
    return 0


def _clips(folder: Path, options: argparse.Namespace) -> "Scene":
    from mograft.library.library import Library
    from mograft.viewing.scene import Scene

    if given(options, "groups"):
        options.usage("--groups is settled when a library is made")
    library = Library.open(folder)
    return Scene.of_clips(library, chosen_clips(library, options.clip))
