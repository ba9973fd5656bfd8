"""The declarations of the commands that draw motions or write them in other formats."""

from mograft.cli.syntax.arguments import (
    command,
    option,
    positional,
    repeated_option,
    setting,
    setting_switch,
)
from mograft.cli.syntax.frame_times import frames
from mograft.cli.syntax.options import (
    DIGITS,
    FIGURE_COLOURS,
    FILES_OR_LIBRARY,
    FORCE,
    INCLUDE_GRAFTS,
    JSON,
    MATCH,
    SEGMENTATION,
    SKELETON,
    files_argument,
    groups_option,
    output_option,
)
from mograft.cli.syntax.values import UNITS, picture_size, positive_integer, positive_number, unit

PLOT_KINDS = (
    "strip",
    "timeline",
    "energy",
    "pca",
    "dendrogram",
    "clusters",
    "threshold",
    "groups",
)

PLOT = command(
    "plot",
    "draw motions, or the clusters of their segments",
    positional(
        "kind",
        "what to draw: strip (poses of one motion), timeline (segments along time), energy "
        "(kinetic energy), pca (segments in principal components), dendrogram (linkage tree), "
        "clusters (cluster sizes), threshold (how --sigma-scale auto is chosen) or groups (which "
        "joints move together)",
        choices=PLOT_KINDS,
    ),
    FILES_OR_LIBRARY,
    repeated_option(
        "--clip NAME",
        "clips of a library to draw with strip, energy or timeline; NAME may be a glob such as "
        "walk*; may be repeated (default: all clips)",
    ),
    output_option(".png, .svg or .pdf file to write", required=True),
    groups_option(default="lower_upper; for strip trunk, arms and legs; for groups auto"),
    SEGMENTATION,
    INCLUDE_GRAFTS,
    MATCH,
    SKELETON,
    option(
        "--group NAME",
        "joint group that pca, dendrogram, clusters or threshold draws (default: the base group)",
    ),
    setting("--poses", "number of poses that strip draws (default: 12)", positive_integer, 12),
    option(
        "--frames FIRST-LAST",
        "frames, or times such as 3.3s-13.3s, that strip, timeline or energy draws (default: all "
        "frames)",
        frames,
    ),
    setting_switch("--dark", "draw in light colours on a dark background"),
    setting("--dpi", "resolution of a .png in dots per inch (default: 150)", positive_integer, 150),
    JSON,
    FORCE,
)
EXPORT = command(
    "export",
    "write motions in other file formats",
    files_argument(
        "motion file; several files are allowed for a film, and for a .glb if they have the same "
        "skeleton"
    ),
    output_option("file to write", required=True, metavar="FILE"),
    option(
        "--frames FIRST-LAST",
        "frames, or times such as 3.3s-13.3s, to write (default: all)",
        frames,
    ),
    setting(
        "--rate FPS",
        "frame rate of the output in frames per second (default: the rate of the input; for an "
        ".mp4 at most 60, for a .gif at most 20)",
        positive_number,
    ),
    DIGITS,
    setting(
        "--scale UNIT|X",
        f"unit of length of the motion file, for .glb and .usd files: {', '.join(UNITS)}, or a "
        "number of metres (default: the unit that gives the figure human height)",
        unit,
    ),
    option(
        "--like FILE",
        "AMASS file from which a .npz takes all arrays that the motion did not change "
        "(default: write the arrays of mograft)",
        is_path=True,
    ),
    SKELETON,
    groups_option(f"{FIGURE_COLOURS} of a figure or film", "trunk, arms and legs"),
    setting(
        "--size WIDTHxHEIGHT",
        "size of a film in pixels (default: 720x480)",
        picture_size,
        "720x480",
    ),
    setting_switch("--dark", "draw a film in light colours on a dark background"),
    JSON,
    FORCE,
    description="Write motions to a file, whose suffix selects the format: an animated figure "
    "(.glb; .usd, .usda or .usdc, which need mograft[usd]), a film (.mp4 or .gif, which need "
    "mograft[video]), or tables of channel values (.npz, .csv, .bvh).",
)
