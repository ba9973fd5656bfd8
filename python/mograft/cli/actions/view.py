"""``mograft view``: motions side by side in the browser."""

import argparse
from pathlib import Path

from mograft.cli.configuration import (
    figure_groups,
    refuse_fixed_options,
    selected_config,
    selected_skeleton,
)
from mograft.cli.files import (
    check_suffix,
    check_writable,
    expand_folders,
    library_folder,
    select_clips,
)
from mograft.cli.output import print_result
from mograft.cli.results import open_page
from mograft.library.library import Library
from mograft.viewing.page import temporary_path, view
from mograft.viewing.scene import Scene


def run(options: argparse.Namespace) -> int:
    """Run the command."""
    if options.output is not None:
        check_suffix(options, ".html", ".htm")
        check_writable([options.output], force=options.force, inputs=options.files)
    folder = library_folder(options)
    if options.clip and folder is None:
        options.usage_error("--clip requires a library")
    if folder is None:
        files = expand_folders(options.files)
        page = view(
            *files,
            groups=figure_groups(options, files),
            config=selected_config(options),
            title=options.title,
            show=False,
            skeleton=selected_skeleton(options),
        )
    else:
        refuse_fixed_options(options, "groups", "segmentation", "skeleton")
        library = Library.open(folder)
        clips = Scene.of_clips(library, select_clips(library, options.clip))
        page = view(clips, title=options.title, show=False)
    target: Path = options.output or temporary_path()
    target.parent.mkdir(parents=True, exist_ok=True)
    path = page.save(target, force=True)
    print_result(options, "view", {"file": str(path), "title": page.title}, [path])
    if options.output is None or options.open:
        open_page(path)
    return 0
