"""``mograft plot``: pictures of motions and of what was found in them."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mograft._util.atomic import atomic_path
from mograft.cli._common import (
    at_least_one,
    check_free,
    chosen_clips,
    expanded,
    frames,
    given,
    library_folder,
    only_frames,
    print_json,
)
from mograft.cli.graft import chosen_groups

if TYPE_CHECKING:
    from matplotlib.axes import Axes

KINDS = ("strip", "timeline", "energy", "pca", "dendrogram", "clusters")
ENDINGS = (".png", ".svg", ".pdf")
_USES = {
    "frames": ("strip", "timeline", "energy"),
    "groups": ("strip", "timeline", "pca", "dendrogram", "clusters"),
    "group": ("pca", "dendrogram", "clusters"),
}


def add(commands: Any) -> None:  # noqa: ANN401 - argparse keeps the type to itself
    """Add the command to the parser."""
    plot = commands.add_parser("plot", help="pictures of motions and of their clusters")
    plot.add_argument("kind", choices=KINDS)
    plot.add_argument("files", nargs="+", metavar="FILE", help="BVH files, or a library")
    plot.add_argument(
        "--clip",
        action="append",
        default=[],
        metavar="NAME",
        help="clip of a library, as walk*, for a strip, energy curve or timeline; may be repeated",
    )
    plot.add_argument(
        "-o", "--output", type=Path, required=True, help="a .png, .svg or .pdf to write"
    )
    plot.add_argument(
        "--groups",
        metavar="NAME|FILE",
        help="joint groups; default: lower_upper, of a strip trunk, arms and legs",
    )
    plot.add_argument(
        "--group",
        metavar="NAME",
        help="of points, a tree or sizes: the group to show; default: the base group",
    )
    plot.add_argument("--poses", type=at_least_one, default=12, help="of a strip (default 12)")
    plot.add_argument(
        "--frames", type=frames, metavar="FIRST-LAST", help="of a timeline, strip or energy curve"
    )
    plot.add_argument("--dark", action="store_true", help="light on dark")
    plot.add_argument("--dpi", type=at_least_one, default=150, help="of a .png (default 150)")
    plot.add_argument("--json", action="store_true", help="tell as JSON what was written")
    plot.add_argument("--force", action="store_true", help="overwrite what is there")
    plot.set_defaults(run=run, usage=plot.error)


def run(options: argparse.Namespace) -> int:
    """Run the command."""
    target: Path = options.output
    if target.suffix.lower() not in ENDINGS:
        options.usage(f"-o must end in {', '.join(ENDINGS)}, got {target.name}")
    check_free([target], force=options.force)
    try:
        import matplotlib as mpl
    except ImportError as error:
        raise ValueError("plots need matplotlib: pip install 'mograft[plot]'") from error
    mpl.use("agg")
    metadata = {".svg": {"Date": None}, ".pdf": {"CreationDate": None}}.get(target.suffix.lower())
    from matplotlib import pyplot

    with mpl.rc_context(), pyplot.style.context("dark_background" if options.dark else "default"):
        # The same input gives the same bytes: no date, and names of parts that do not change.
        mpl.rcParams["svg.hashsalt"] = "mograft"
        figure = _draw(options).get_figure(root=True)
        assert figure is not None  # The axes were made with theirs.
        target.parent.mkdir(parents=True, exist_ok=True)
        try:
            with atomic_path(target) as draft:
                figure.savefig(draft, dpi=options.dpi, metadata=metadata)
        finally:
            pyplot.close("all")
    if options.json:
        print_json({"schema": "mograft.plot/1", "file": str(target), "kind": options.kind})
    else:
        print(target)
    return 0


def _draw(options: argparse.Namespace) -> "Axes":
    from mograft import plot
    from mograft.io.bvh import read_bvh
    from mograft.library.library import Library
    from mograft.viewing.scene import Scene

    folder = library_folder(options)
    if folder is not None and given(options, "groups"):
        options.usage("--groups is settled when a library is made")
    if options.clip and (folder is None or options.kind in ("pca", "dendrogram", "clusters")):
        options.usage("--clip chooses clips of a library for a strip, energy curve or timeline")
    files = expanded(options.files) if folder is None else []
    for name in given(options, *_USES):
        if options.kind not in _USES[name]:
            options.usage(f"--{name} is for {', '.join(_USES[name])}; got {options.kind}")
    groups = None if options.groups is None else chosen_groups(options)
    if options.kind in ("strip", "energy"):
        if folder is not None:
            library = Library.open(folder)
            motions = [library.clips[index] for index in chosen_clips(library, options.clip)]
            groups = library.groups
        else:
            motions = [read_bvh(file) for file in files]
        if len(motions) != 1:
            raise ValueError(f"{options.kind} shows one motion, got {len(motions)}")
        motion = only_frames(motions[0], options.frames)
        if options.kind == "energy":
            return plot.energy(motion)
        return plot.strip(motion, options.poses, groups=groups)
    library = (
        Library.build(files, groups or "lower_upper") if folder is None else Library.open(folder)
    )
    if folder is not None and options.kind == "timeline":
        clips = Scene.of_clips(library, chosen_clips(library, options.clip))
        return plot.timeline(clips, frames=options.frames)
    if options.kind == "timeline":
        return plot.timeline(library, frames=options.frames)
    return {"pca": plot.pca, "dendrogram": plot.dendrogram, "clusters": plot.clusters}[
        options.kind
    ](library, options.group)
