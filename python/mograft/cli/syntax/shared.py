"""Options that several commands share."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mograft.cli.syntax import values
from mograft.cli.syntax.arguments import (
    DIFFERENT,
    DONORS,
    INPUT,
    KEEP,
    OPTIONS,
    OUTPUT,
    PLACE,
    Options,
    option,
    positional,
    repeated,
    setting,
    switch,
)
from mograft.cli.syntax.frames import Range, SegmentValue, Taken, ban, frames, take

PRESETS = ("lower_upper", "lower_torso_arms", "lower_torso_larm_rarm", "lower_torso_head_larm_rarm")


def files_argument(help: str, metavar: str = "LIB|FILE", nargs: str | int = "+") -> Any:  # noqa: A002, ANN401
    """Return the positional argument for files; `nargs` is that of `add_argument`."""
    return positional(help, is_path=True, nargs=nargs, metavar=metavar)


def groups_option(help: str = "joint groups", default: str = "lower_upper") -> Any:  # noqa: A002, ANN401
    """Return the option ``--groups``; `default` is described, not set."""
    return setting(
        f"{help}: a preset, a TOML file or auto:N (default: {default})",
        details="auto:N finds N groups of joints that move together, auto also chooses N",
        metavar="NAME|FILE|auto:N",
        section=INPUT,
        is_path=True,
    )


def output_option(help: str, metavar: str = "FILE", **keywords: Any) -> Any:  # noqa: A002, ANN401
    """Return the option ``-o``; `keywords` are passed to `option`."""
    keywords |= {"metavar": metavar, "short": "-o", "section": OUTPUT, "is_path": True}
    return option(help, Path, **keywords)


def decimals_option() -> Any:  # noqa: ANN401
    """Return the option ``--digits``."""
    return setting(
        "decimals of computed angles in a .bvh file, from 1 to 12 (default: those of the file)",
        values.decimals,
        details="unchanged angles keep their decimals; computed ones have at least 6 by default",
        metavar="N",
        section=OUTPUT,
        is_expert=True,
    )


@dataclass(frozen=True, kw_only=True)
class ResultOptions(Options):
    """Options of commands that print a result."""

    json: bool = switch("print the results as one JSON document", section=OUTPUT, is_expert=True)


@dataclass(frozen=True, kw_only=True)
class WriterOptions(ResultOptions):
    """Options of commands that write files."""

    force: bool = switch("overwrite existing files", section=OUTPUT)


@dataclass(frozen=True, kw_only=True)
class SkeletonOptions(ResultOptions):
    """Options of commands that read motion files."""

    files: tuple[str, ...] = files_argument("motion files, or folders of them", "FILE")
    skeleton: str | None = setting(
        "rest pose for files that store none, such as those of AMASS: a motion file, or a .json "
        "file of offsets (default: a substitute with published body proportions)",
        metavar="FILE",
        section=INPUT,
        is_expert=True,
        is_path=True,
    )


@dataclass(frozen=True, kw_only=True)
class FieldOptions(ResultOptions):
    """Options of commands that segment motions."""

    set: tuple[tuple[str, str], ...] = setting(
        "another field of the configuration",
        values.assignment,
        details="such as seam=offset; may be repeated; docs/settings.md lists the fields",
        metavar="FIELD=VALUE",
        section=DIFFERENT,
        action="append",
    )
    configured: tuple[tuple[str, str], ...] = ()
    """Fields and values of ``set`` in the configuration file and the environment."""


@dataclass(frozen=True, kw_only=True)
class LibraryOptions(FieldOptions, SkeletonOptions):
    """Options of commands that open a library, or build one from motion files."""

    files: tuple[str, ...] = files_argument("motion files, or one library")
    groups: str | None = groups_option()
    include_grafts: bool = switch(
        "also read the grafts in folders",
        details="that is, motions with a .json file of mograft graft beside them",
        section=INPUT,
        is_expert=True,
        is_setting=True,
    )
    match: str | None = setting(
        "how motions of different hierarchies fit together: names or anatomy (default: names)",
        details="names - all must have the same joint names and hierarchy; anatomy - joints "
        "correspond by body part, and those without a counterpart are listed",
        section=INPUT,
        is_expert=True,
        choices=("names", "anatomy"),
    )
    preset: str | None = setting(
        "configuration before other options change it: default, or paper, which has the "
        "parameters of the paper (default: default)",
        section=DIFFERENT,
        is_expert=True,
        choices=("default", "paper"),
    )
    variety: float | None = setting(
        "from 0 (few, similar donors) to 1 (many, less similar donors) (default: 0.5)",
        values.share,
        metavar="X",
        section=DIFFERENT,
    )


@dataclass(frozen=True, kw_only=True)
class ConstraintOptions(LibraryOptions):
    """Options that set constraints."""

    keep: tuple[Range, ...] = repeated(
        "frames, or times as 3s-4s, that stay as captured",
        frames,
        details="segments that contain part of this range are not exchanged; may be repeated",
        metavar="FIRST-LAST",
        section=KEEP,
    )
    reach: tuple[tuple[Range, str, values.Point, float], ...] = repeated(
        "position of a joint in a frame",
        values.reach,
        details="or in all frames to LAST, within TOL skeleton heights "
        f"(default: {values.REACH_TOLERANCE}); may be repeated",
        metavar="FRAME[-LAST]:JOINT:X,Y,Z[~TOL]",
        section=PLACE,
    )
    avoid: tuple[tuple[str, tuple[float, ...], Range | None], ...] = repeated(
        "obstacle, such as sphere:X,Y,Z,RADIUS",
        values.obstacle,
        details="FILE.bvh[@X,Y,Z[,YAW]] (another character, turned by YAW degrees, then moved by "
        "X,Y,Z), capsule:X,Y,Z,X,Y,Z,RADIUS (its two ends), box:X,Y,Z,HX,HY,HZ (its centre and "
        "half of its sizes) or wall:X,Y,Z,NX,NY,NZ (a point and the normal); in all frames or "
        "from FIRST to LAST; may be repeated",
        metavar="WHAT[@FIRST-LAST]",
        section=PLACE,
    )
    radius: float = setting(
        "factor on the thickness of the bodies of the characters of --avoid (default: 1)",
        values.positive_number,
        1.0,
        metavar="X",
        section=PLACE,
        is_expert=True,
    )
    avoid_self: bool = switch(
        "forbid contact of hands and forearms with trunk, head, thighs and each other",
        section=PLACE,
        is_expert=True,
        is_setting=True,
    )
    face: tuple[tuple[values.Point, Range | None], ...] = repeated(
        "position that the head must face within 20 degrees",
        values.face,
        details="in all frames or from FIRST to LAST; may be repeated",
        metavar="X,Y,Z[@FIRST-LAST]",
        section=PLACE,
        is_expert=True,
    )
    take: tuple[tuple[SegmentValue, Taken], ...] = repeated(
        "donor that a base segment must have",
        take,
        details="frames FIRST-LAST of CLIP, from any cluster and of any duration; SEGMENT is the "
        "index of the base segment, from 0, or its frames FIRST-LAST; GROUP:SEGMENT selects one "
        "of several exchanged groups; may be repeated",
        metavar="SEGMENT=CLIP:FIRST-LAST",
        section=DONORS,
    )
    ban: tuple[tuple[SegmentValue, str | Taken | None], ...] = repeated(
        "donors that a base segment must not have",
        ban,
        details="all segments of CLIP, or those that overlap its frames FIRST-LAST. Without CLIP, "
        "the base segment must not keep its captured motion, or with --from the donor that it has "
        "in the graft. SEGMENT is as for --take; may be repeated",
        metavar="SEGMENT[=CLIP[:FIRST-LAST]]",
        section=DONORS,
    )
    only_from: tuple[str, ...] | None = setting(
        "clips that may provide donors; CLIP may be a glob such as waltz* (default: all clips)",
        values.names,
        metavar="CLIP,...",
        section=DONORS,
    )
    not_from: tuple[str, ...] | None = setting(
        "clips that must not provide donors; CLIP may be a glob such as waltz* (default: none)",
        values.names,
        metavar="CLIP,...",
        section=DONORS,
    )
    only_tagged: tuple[str, ...] | None = setting(
        "tags of clips that may provide donors (default: all clips)",
        values.names,
        metavar="TAG,...",
        section=DONORS,
    )
    not_tagged: tuple[str, ...] | None = setting(
        "tags of clips that must not provide donors (default: none)",
        values.names,
        metavar="TAG,...",
        section=DONORS,
    )
    max_stretch: float | None = setting(
        "maximum difference between the durations of donor and base segment, as a fraction of the "
        "duration of the base segment (default: 0.15)",
        values.non_negative_number,
        metavar="X",
        section=DONORS,
    )
    max_angle: float | None = setting(
        "maximum seam angle in degrees (default: 45)",
        values.positive_number,
        metavar="DEGREES",
        section=DONORS,
    )


def seed_option(section: str = OPTIONS) -> Any:  # noqa: ANN401
    """Return the option ``--seed``."""
    return setting(
        "seed of the random number generator (default: 0)",
        values.non_negative_integer,
        metavar="N",
        section=section,
    )
