"""``mograft view``: motions side by side in the browser."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from mograft.cli.arguments import Command, option, repeated_option, switch
from mograft.cli.configuration import refuse_fixed_options, selected_groups
from mograft.cli.files import check_writable, expand_folders, library_folder, select_clips
from mograft.cli.options import FILES_OR_LIBRARY, FORCE, JSON
from mograft.cli.output import print_json, print_remark

if TYPE_CHECKING:
    from mograft.viewing.scene import Scene


def run(options: argparse.Namespace) -> int:
    """Run the command."""
    from mograft.viewing.page import open_file, temporary_path, view

    if options.output is not None:
        check_writable([options.output], force=options.force)
    folder = library_folder(options)
    if options.clip and folder is None:
        options.usage_error("--clip requires a library")
    if folder is None:
        groups = None if options.groups is None else selected_groups(options)
        page = view(*expand_folders(options.files), groups=groups, title=options.title, show=False)
    else:
        page = view(_clips(folder, options), title=options.title, show=False)
    if options.output is not None:
        options.output.parent.mkdir(parents=True, exist_ok=True)
    path = page.save(temporary_path() if options.output is None else options.output, force=True)
    if options.json:
        print_json({"schema": "mograft.view/1", "file": str(path), "title": page.title})
    else:
        print(path)
    if (options.output is None or options.open) and not open_file(path):
        print_remark(f"no browser found: open {path} yourself")
    return 0


def _clips(folder: Path, options: argparse.Namespace) -> "Scene":
    from mograft.library.library import Library
    from mograft.viewing.scene import Scene

    refuse_fixed_options(options, "groups")
    library = Library.open(folder)
    return Scene.of_clips(library, select_clips(library, options.clip))


COMMAND = Command(
    name="view",
    help="show motions side by side in the browser",
    run=run,
    arguments=(
        FILES_OR_LIBRARY,
        repeated_option(
            "--clip",
            metavar="NAME",
            help="clips of a library, globs such as walk* (default: all); may be repeated",
        ),
        option(
            "--groups",
            is_path=True,
            metavar="NAME|FILE",
            help="joint groups that set the colours: the name of a preset, or a TOML file "
            "(default: trunk, arms and legs)",
        ),
        option(
            "--title",
            is_setting=False,
            help="title of the page (default: the names of the motions)",
        ),
        option(
            "-o",
            "--output",
            is_setting=False,
            is_path=True,
            type=Path,
            help="HTML file to write (default: a temporary file, opened in the browser)",
        ),
        switch("--open", is_setting=False, help="open the written page in the browser"),
        JSON,
        FORCE,
    ),
)
