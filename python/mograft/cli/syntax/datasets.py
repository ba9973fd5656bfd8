"""Options of the commands that make data sets and search libraries."""

from typing import Annotated, Literal

from mograft.cli.syntax import options, values
from mograft.cli.syntax.arguments import option, positional, setting
from mograft.cli.syntax.converters import Value


class AugmentOptions(options.SeedOptions, options.LibraryOptions, section="output"):
    """Write a data set of windows of grafts, from which models are trained.

    Bases and donors are clips of one part of a split; clips whose motion also occurs in another
    part are left out. The same options and seed give the same bytes with any number of processes.
    """

    output: values.Folder = option("folder of the data set", short="-o", is_required=True)
    count: values.Windows = option("number of windows", short="-n", is_required=True)
    seconds: values.Duration = setting("duration of a window (default: 4)", default=4.0)
    stride: values.Duration | None = setting(
        "seconds from a window to the next on the same base (default: the duration of a window)"
    )
    bases: values.Clips | None = setting("base clips, or globs such as waltz* (default: all)")
    split: Annotated[str, Value("CSV|auto:KEY")] | None = setting(
        "table of clips and their parts, or automatic parts (default: all clips)",
        details="a row has a clip, a file, a glob or tag:TAG, and a part; auto:clip, auto:file and "
        "auto:tag make train, val and test of 80, 10 and 10 percent, in which clips, files or tags "
        "are not divided; auto:tag:GLOB uses only tags such as performer*",
    )
    part: values.Name | None = setting("part of the split (default: train)")
    features: Annotated[tuple[str, ...], Value("NAME,...", values.names)] | None = setting(
        "arrays of npz, parquet and lerobot, of rotations, rotations_6d, matrices, root, "
        "positions, contacts, humanml3d (default: rotations,root,contacts)"
    )
    format: Literal["npz", "parquet", "lerobot", "bvh", "glb"] = setting(
        "format of the files (default: npz); parquet and lerobot need mograft[parquet]",
        default="npz",
    )
    min_new: values.Share = setting(
        "smallest share of frames of a window that differ from the base (default: 0.5)",
        default=0.5,
        is_expert=True,
    )
    jobs: values.Count = setting("processes that make grafts (default: 1)", default=1, short="-j")
    measure: bool = option(
        "measure whether classifiers distinguish the grafts from captured motion; needs "
        "mograft[evaluate]"
    )
    resume: bool = option("continue an interrupted run with the same options")


class FindOptions(options.WriterOptions, section="output"):
    """Find the spans of a library that move like a clip or file, or clips by their words."""

    query: values.ClipOrFile | None = positional(
        "clip of the library, or motion file; none with --text alone", "?"
    )
    library: values.LibraryFolder = positional("folder of a library")
    frames: values.Frames | None = option(
        "frames, or times as 3s-4s, of QUERY; whole segments are compared (default: all)"
    )
    part: values.Name | None = option("joint group that is compared (default: all groups)")
    text: values.Name | None = option("words of names, tags and descriptions of clips")
    top: values.Count = setting("number of spans (default: 20)", default=20)
    jobs: values.Count = setting("processes that compare (default: 1)", default=1, short="-j")
    output: values.File | None = option(
        "HTML file in which the query and the first spans are side by side", short="-o"
    )
    open: bool = option("open the page in the browser")


class CurateOptions(options.WriterOptions, section="output"):
    """Choose clips of a library that are near all others.

    Every segment without faults of a dropped clip is within the radius of a segment of a kept clip,
    in the embedding of the library. The files of the kept clips are printed.
    """

    library: values.LibraryFolder = positional("folder of a library")
    radius: values.NonNegative | None = setting(
        "radius in cluster diameter thresholds of the library (default: 1)"
    )
    keep: values.Percentage | None = setting(
        "share of the frames to keep, such as 0.1 or 10%; the radius follows from it"
    )
    part: values.Name | None = option("joint group that is compared (default: all groups)")
    shards: values.Count = setting(
        "shards of clips, of which each is chosen from first (default: 1)",
        default=1,
        is_expert=True,
        details="no tree then has the segments of all clips; more clips are kept",
    )
    jobs: values.Count = setting("processes of shards (default: 1)", default=1, short="-j")
    output: values.OutputPath | None = option(
        ".csv file for a table of all clips, with the reason for each; or a folder for this table "
        "and a page with the curve of coverage and examples",
        short="-o",
    )
    files: Literal["link", "copy"] | None = option(
        "also put links to the files of the kept clips, or copies, into the folder"
    )
