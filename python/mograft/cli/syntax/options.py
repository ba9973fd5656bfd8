"""Options that several commands share, and the option groups of ``mograft graft``."""

from pathlib import Path
from typing import Any

from mograft._util.registry import CONFIG_OPTIONS, Registry
from mograft.cli.syntax import values
from mograft.cli.syntax.arguments import (
    Argument,
    ArgumentGroup,
    option,
    positional,
    repeated_option,
    setting,
    setting_switch,
    switch,
)
from mograft.cli.syntax.frame_times import frame_count, frames
from mograft.cli.syntax.segment_values import ban, segment_value, take
from mograft.cli.syntax.values import (
    non_negative_integer,
    non_negative_number,
    positive_number,
    positive_number_or_auto,
    share,
)

PRESETS = ("lower_upper", "lower_torso_arms", "lower_torso_larm_rarm", "lower_torso_head_larm_rarm")
DEFAULT_DURATION = 60.0
"""Duration of ``--scenario graph`` in seconds."""


def files_argument(help: str, metavar: str = "FILE", nargs: str = "+") -> Argument:  # noqa: A002
    """Return the positional argument for files, shown as `metavar` in ``--help``.

    `nargs` is that of `add_argument`.
    """
    return positional("files", help, is_path=True, nargs=nargs, metavar=metavar)


def groups_option(subject: str = "joint groups", default: str = "lower_upper") -> Argument:
    """Return the option ``--groups``, whose help text contains `subject` and `default`."""
    return setting(
        "--groups NAME|FILE|auto:N",
        f"{subject}: the name of a preset, a TOML file, or auto:N, N groups of joints that move "
        f"together (auto: the number is chosen) (default: {default})",
        is_path=True,
    )


def output_option(help: str, **keywords: Any) -> Argument:  # noqa: A002, ANN401 - as add_argument
    """Return the option ``-o``; `keywords` are passed to `option`."""
    return option("-o --output", help, Path, is_path=True, **keywords)


def config_option(field: str, subject: str, default: str, paper: str | None = None) -> Argument:
    """Return the option ``--field``, which sets the field of `Config` with this name.

    `subject` describes the field in the help text. `default` is the value if the option is not
    given, `paper` the one with ``--preset paper`` if it differs.
    """
    registry = CONFIG_OPTIONS[field]
    of_paper = "" if paper is None else f"; with --preset paper: {paper}"
    return setting(
        f"--{field}",
        f"{subject} (default: {default}{of_paper}): {_describe(registry)}",
        choices=registry.names,
    )


def _describe(registry: Registry[str]) -> str:
    """Return the accepted values of a parameter with their descriptions, as one line."""
    return "; ".join(f"{name} - {text}" for name, text in registry.entries.items())


MOTION_FILES = files_argument("motion files, or folders of them")
FILES_OR_LIBRARY = files_argument("motion files, or one library", "LIB|FILE")
GROUPS = groups_option()
FIGURE_COLOURS = "joint groups that set the colours"
PRESET = setting(
    "--preset",
    "configuration before other options change it: default, or paper, which has the parameters "
    "of the paper (default: default)",
    choices=("default", "paper"),
)
SIGMA_SCALE = setting(
    "--sigma-scale X|auto",
    "cluster diameter threshold, as a multiple of sigma, the spread of all segments; larger values "
    "give more variety, smaller values more similarity; auto chooses X for each joint group from "
    "how much repeated motions differ (default: 0.75; with --preset paper: 1)",
    positive_number_or_auto,
)
VARIETY = setting(
    "--variety X",
    "variety of the motions, from 0 (few, similar donors) to 1 (many, less similar donors); sets "
    "--sigma-scale (default: 0.5)",
    share,
)
NEIGHBOURHOOD = config_option("neighbourhood", "segments that can be donors", "cluster")
SEED = setting("--seed", "seed of the random number generator (default: 0)", non_negative_integer)
SEGMENTATION = setting(
    "--segmentation NAME|FILE",
    "how motions are cut into segments (default: energy): "
    f"{_describe(CONFIG_OPTIONS['segmentation'])}; or a .json file with the cut frames of each "
    'clip, such as {"walk": [12, 40]}. NAME:PARAMETER=VALUE,... sets parameters, such as '
    "com:min_flight=0.2",
    values.segmentation,
    is_path=True,
)
INCLUDE_GRAFTS = setting_switch(
    "--include-grafts",
    "also read the grafts in folders: motions with a .json file of mograft graft beside them "
    "(default: skip them)",
)
DIGITS = setting(
    "--digits N",
    "decimals of computed angles in a .bvh file, from 1 to 12; unchanged angles keep those of "
    "the file (default: those of the file, at least 6)",
    values.decimals,
)
MATCH = setting(
    "--match",
    "how motions of different hierarchies fit together: names - all must have the same joint names "
    "and hierarchy; anatomy - joints correspond by body part, and those without a counterpart are "
    "listed (default: names)",
    choices=("names", "anatomy"),
)
SKELETON = setting(
    "--skeleton FILE",
    "rest pose for files that store none, such as those of AMASS: a motion file, or a .json file "
    "of offsets (default: a substitute with published body proportions)",
    is_path=True,
)
FORCE = switch("--force", "overwrite existing files")
JSON = switch("--json", "print the results as one JSON document")

REPLAY_OPTIONS = (
    option(
        "--from JSON",
        ".json file of the graft to create again, byte for byte; --take, --ban, --keep and "
        "--reroll change some segments and leave the others unchanged; LIB|FILE is needed only if "
        "files have moved",
        is_path=True,
    ),
    repeated_option(
        "--reroll SEGMENT",
        "with --from: index of a base segment that gets another donor, or frames FIRST-LAST of "
        "several; may be repeated",
        segment_value,
    ),
)
SCENARIO_OPTIONS = (
    option(
        "--scenario original|graph|N,...",
        "motion of the base group: original (a captured clip), graph (a random sequence of "
        "segments, in which each segment continues the motion of the previous one), or indices of "
        "segments in the library, which are joined in this order (default: original)",
        default="original",
    ),
    option(
        "--duration S",
        "duration of --scenario graph, in seconds, at most 86400 (default: "
        f"{DEFAULT_DURATION:.0f})",
        positive_number,
    ),
    option(
        "--frames N|S",
        "exact number of frames of --scenario graph, or a time such as 30s (default: --duration "
        "sets the length)",
        frame_count,
    ),
    setting(
        "--path X,Z:X,Z:...",
        "corners of a path on the floor that --scenario graph follows, in the unit of the file "
        "(X,Y if z points up); the length of the path determines the duration (default: no path)",
        values.corners,
    ),
    setting(
        "--beats BPM",
        "tempo of --scenario graph in beats per minute: a segment ends on each beat (default: no "
        "tempo)",
        positive_number,
    ),
    setting(
        "--among CLIP,...",
        "clips whose segments --scenario graph uses; CLIP may be a glob such as waltz* (default: "
        "all clips)",
    ),
)


def constraint_options(*more: Argument) -> ArgumentGroup:
    """Return the group of all options that set constraints, with the options `more` at its end."""
    return ArgumentGroup(
        (*_POSE_OPTIONS, *_SEGMENT_OPTIONS, *_DONOR_OPTIONS, *more),
        "constraints",
        "Positions are in the unit of the file. Frames are counted from 0 in the base motion; a "
        "time in seconds has the suffix s, such as 3.3s-13.3s. If "
        "no donor sequence satisfies all constraints, mograft graft prints the remaining "
        "violations to stderr and returns exit code 4.",
    )


_POSE_OPTIONS = (
    repeated_option(
        "--avoid WHAT[@FIRST-LAST]",
        "obstacle that the body must not touch: FILE.bvh[@X,Y,Z[,YAW]] (another character, turned "
        "by YAW degrees, then moved by X,Y,Z), sphere:X,Y,Z,RADIUS, capsule:X,Y,Z,X,Y,Z,RADIUS "
        "(its two ends), box:X,Y,Z,HX,HY,HZ (its centre and half of its sizes) or "
        "wall:X,Y,Z,NX,NY,NZ (a point and the normal); in all frames or from FIRST to LAST; may be "
        "repeated",
        values.obstacle,
    ),
    setting(
        "--radius X",
        "factor on the thickness of the bodies of the characters of --avoid (default: 1)",
        positive_number,
        1.0,
    ),
    setting_switch(
        "--avoid-self",
        "forbid contact of hands and forearms with trunk, head, thighs and each other",
    ),
    repeated_option(
        "--reach FRAME[-LAST]:JOINT:X,Y,Z[~TOL]",
        "position of a joint in a frame, or in all frames to LAST, within TOL skeleton heights "
        f"(default: {values.REACH_TOLERANCE}); may be repeated",
        values.reach,
    ),
    repeated_option(
        "--face X,Y,Z[@FIRST-LAST]",
        "position that the head must face within 20 degrees, in all frames or from FIRST to LAST; "
        "may be repeated",
        values.face,
    ),
    repeated_option(
        "--keep FIRST-LAST",
        "frames, or times such as 10s-12.5s: segments that contain part of this range are not "
        "exchanged; may be repeated",
        frames,
    ),
)
_SEGMENT_OPTIONS = (
    repeated_option(
        "--take SEGMENT=CLIP:FIRST-LAST",
        "donor that a base segment must have: frames FIRST-LAST of CLIP, from any cluster and of "
        "any duration; SEGMENT is the index of the base segment, from 0, or its frames "
        "FIRST-LAST; GROUP:SEGMENT selects one of several exchanged groups; may be repeated",
        take,
    ),
    repeated_option(
        "--ban SEGMENT[=CLIP[:FIRST-LAST]]",
        "donors that a base segment must not have: all segments of CLIP, or those that overlap "
        "its frames FIRST-LAST. Without CLIP, the base segment must not keep its captured motion, "
        "or with --from the donor that it has in the graft. SEGMENT is as for --take; may be "
        "repeated",
        ban,
    ),
)
_DONOR_OPTIONS = (
    setting(
        "--only-from CLIP,...",
        "clips that may provide donors; CLIP may be a glob such as waltz* (default: all clips)",
    ),
    setting(
        "--not-from CLIP,...",
        "clips that must not provide donors; CLIP may be a glob such as waltz* (default: none)",
    ),
    setting("--only-tagged TAG,...", "tags of clips that may provide donors (default: all clips)"),
    setting("--not-tagged TAG,...", "tags of clips that must not provide donors (default: none)"),
    setting(
        "--max-stretch X",
        "maximum difference between the durations of donor and base segment, as a fraction of the "
        "duration of the base segment (default: 0.15)",
        non_negative_number,
    ),
    setting("--max-angle DEGREES", "maximum seam angle in degrees (default: 45)", positive_number),
)
