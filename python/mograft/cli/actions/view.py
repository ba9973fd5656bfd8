"""``mograft view``: motions side by side in the browser."""

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
from mograft.cli.graft_files import open_page
from mograft.cli.output import print_result
from mograft.cli.syntax.arguments import UsageError
from mograft.cli.syntax.commands import ViewOptions
from mograft.library.library import Library
from mograft.viewing.page import temporary_path, view
from mograft.viewing.scene import Scene


def run(options: ViewOptions) -> int:
    """Run the command."""
    if options.output is not None:
        check_suffix(options.output, ".html", ".htm")
        check_writable([options.output], force=options.force, inputs=options.files)
    folder = library_folder(options.files)
    if options.clip and folder is None:
        raise UsageError("--clip requires a library")
    if folder is None:
        files = expand_folders(options.files)
        config, skeleton = selected_config(options), selected_skeleton(options.skeleton)
        groups = figure_groups(options.groups, files, config, skeleton)
        page = view(
            *files, groups=groups, config=config, title=options.title, show=False, skeleton=skeleton
        )
    else:
        refuse_fixed_options(options, "groups", "skeleton")
        library = Library.open(folder)
        clips = Scene.of_clips(library, select_clips(library, options.clip))
        page = view(clips, title=options.title, show=False)
    target = options.output or temporary_path()
    target.parent.mkdir(parents=True, exist_ok=True)
    path = page.save(target, force=True)
    print_result(options, "view", {"file": str(path), "title": page.title}, [path])
    if options.output is None or options.open:
        open_page(path)
    return 0
