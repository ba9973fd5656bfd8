"""Options that several commands share, and the option groups of ``mograft graft``."""

from pathlib import Path
from typing import Any

from mograft._util.registry import CONFIG_OPTIONS
from mograft.cli import values
from mograft.cli.arguments import (
    Argument,
    ArgumentGroup,
    option,
    positional,
    repeated_option,
    setting,
    setting_switch,
    switch,
)
from mograft.cli.values import non_negative_integer, non_negative_number, positive_number, share

PRESETS = ("lower_upper", "lower_torso_arms", "lower_torso_larm_rarm", "lower_torso_head_larm_rarm")
DEFAULT_DURATION = 60.0
"""Duration of ``--scenario graph`` in seconds."""


def files_argument(help: str, metavar: str = "FILE") -> Argument:  # noqa: A002 - as add_argument
    """Return the positional argument for one or more files."""
    return positional("files", help, is_path=True, nargs="+", metavar=metavar)


def groups_option(subject: str = "joint groups", default: str = "lower_upper") -> Argument:
    """Return ``--groups``; its help describes the groups as `subject`."""
    return setting(
        "--groups NAME|FILE",
        f"{subject}: the name of a preset, or a TOML file (default: {default})",
        is_path=True,
    )


def output_option(help: str, **keywords: Any) -> Argument:  # noqa: A002, ANN401 - as add_argument
    """Return ``-o``; `keywords` are those of `add_argument`."""
    return option("-o --output", help, Path, is_path=True, **keywords)


def config_option(field: str, subject: str, default: str) -> Argument:
    """Return the option that selects one of the values that `CONFIG_OPTIONS` lists for a field.

    `subject` is what the option sets, `default` the value if it is not given.
    """
    registry = CONFIG_OPTIONS[field]
    described = "; ".join(f"{name} - {text}" for name, text in registry.entries.items())
    return setting(
        f"--{field}", f"{subject} (default: {default}): {described}", choices=registry.names
    )


BVH_FILES = files_argument("BVH files, or folders of them")
FILES_OR_LIBRARY = files_argument("BVH files, or one library")
GROUPS = groups_option()
FIGURE_COLOURS = "joint groups that set the colours"
PRESET = setting(
    "--preset",
    "configuration that the other options change: default, or paper for the parameters of the "
    "paper (default: default)",
    choices=("default", "paper"),
)
SIGMA_SCALE = setting(
    "--sigma-scale X",
    "cluster diameter threshold, as a multiple of sigma; larger gives more variety, smaller more "
    "similarity (default: 0.75, with --preset paper 1)",
    positive_number,
)
VARIETY = setting(
    "--variety X",
    "variety from 0, few and similar donors, to 1, many and less similar ones; sets --sigma-scale "
    "(default: 0.5)",
    share,
)
NEIGHBOURHOOD = config_option("neighbourhood", "segments that can be donors", "cluster")
SEED = setting(
    "--seed", "seed of the random number generator (default: 0)", non_negative_integer, 0
)
INCLUDE_GRAFTS = setting_switch(
    "--include-grafts",
    "also take the grafts in a folder, files beside which mograft graft wrote a .json, as donors",
)
FORCE = switch("--force", "overwrite existing files")
JSON = switch("--json", "print the results as one JSON document")

SCENARIO_OPTIONS = (
    option(
        "--scenario original|graph|N,...",
        "motion of the base group: original (a captured clip), graph (a random walk through the "
        "transition graph of the segments), or the numbers of segments that follow each other "
        "(default: original)",
        default="original",
    ),
    option(
        "--duration S",
        f"duration of --scenario graph, in seconds (default: {DEFAULT_DURATION:.0f})",
        positive_number,
    ),
    option(
        "--frames N",
        "exact length of --scenario graph, in frames (default: set by --duration)",
        int,
    ),
    setting(
        "--path X,Z:X,Z:...",
        "corners of the path of --scenario graph on the floor, in the unit of the file (X,Y if z "
        "points up); the length of the path sets the duration (default: no path)",
        values.corners,
    ),
    setting(
        "--beats BPM",
        "tempo of --scenario graph in beats per minute: each beat falls on a seam (default: no "
        "tempo)",
        positive_number,
    ),
    setting(
        "--among CLIP,...", "clips that --scenario graph uses, globs such as waltz* (default: all)"
    ),
)


def constraint_options(*more: Argument) -> ArgumentGroup:
    """Return the options of the constraints, followed by `more`."""
    return ArgumentGroup(
        (*_POSE_OPTIONS, *_SEGMENT_OPTIONS, *_DONOR_OPTIONS, *more),
        "constraints",
        "Positions are in the unit of the file, frames are those of the base. If no donor "
        "sequence satisfies the constraints, the exit code is 4 and stderr lists the smallest "
        "violation.",
    )


_POSE_OPTIONS = (
    repeated_option(
        "--avoid WHAT",
        "obstacle that the body must not touch: FILE.bvh[@X,Y,Z[,YAW]] (another character, moved "
        "to a position and turned by YAW degrees), sphere:X,Y,Z,R, capsule:X,Y,Z,X,Y,Z,R, "
        "box:X,Y,Z,HALF,HALF,HALF or wall:X,Y,Z,NX,NY,NZ; may be repeated",
        values.obstacle,
    ),
    setting(
        "--radius X",
        "factor on the capsule radii of the characters of --avoid (default: 1)",
        positive_number,
        1.0,
    ),
    setting_switch(
        "--avoid-self",
        "forbid contact of hands and forearms with trunk, head, thighs and each other",
    ),
    repeated_option(
        "--reach FRAME:JOINT:X,Y,Z[~TOL]",
        "position of a joint in a frame, within TOL skeleton heights "
        f"(default: {values.REACH_TOLERANCE}); may be repeated",
        values.reach,
    ),
    repeated_option(
        "--face X,Y,Z[@FIRST-LAST]",
        "position that the head faces, within 20 degrees, in all frames or a range; may be "
        "repeated",
        values.face,
    ),
    repeated_option(
        "--keep FIRST-LAST", "frames that keep the captured motion; may be repeated", values.frames
    ),
)
_SEGMENT_OPTIONS = (
    repeated_option(
        "--take SEGMENT=CLIP:FIRST-LAST",
        "donor of a base segment, from any cluster and of any length; SEGMENT is its number, from "
        "0, or its frames FIRST-LAST; may be repeated",
        values.take,
    ),
    repeated_option(
        "--ban SEGMENT[=CLIP[:FIRST-LAST]]",
        "donors that a base segment must not have: the segments of a clip, or those in a range of "
        "its frames (default: the captured part, so that it is exchanged); SEGMENT is as for "
        "--take; may be repeated",
        values.ban,
    ),
)
_DONOR_OPTIONS = (
    setting(
        "--only-from CLIP,...", "clips that may provide donors, globs such as waltz* (default: all)"
    ),
    setting(
        "--not-from CLIP,...",
        "clips that are excluded as donors, globs such as waltz* (default: none)",
    ),
    setting("--only-tagged TAG,...", "tags of the clips that may provide donors (default: all)"),
    setting("--not-tagged TAG,...", "tags of the clips that provide no donors (default: none)"),
    setting(
        "--max-stretch X",
        "maximum difference between the durations of donor and base segment, as a fraction of the "
        "latter (default: 0.15)",
        non_negative_number,
    ),
    setting("--max-angle DEGREES", "maximum seam angle in degrees (default: 45)", positive_number),
)
