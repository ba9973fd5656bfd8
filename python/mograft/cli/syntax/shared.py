"""Options that several commands share, one class for each heading of ``--help``."""

from dataclasses import dataclass
from typing import Any

from mograft.cli.syntax import values
from mograft.cli.syntax.arguments import (
    Options,
    option,
    positional,
    repeated,
    setting,
    switch,
)
from mograft.cli.syntax.frames import Range, SegmentValue, Taken

PRESETS = ("lower_upper", "lower_torso_arms", "lower_torso_larm_rarm", "lower_torso_head_larm_rarm")
_GROUPS = values.Value("NAME|FILE|auto:N", is_path=True)
_MATCH = values.choice("names", "anatomy", placeholder="names|anatomy")


def groups_option(help: str = "joint groups", default: str = "lower_upper") -> Any:  # noqa: A002, ANN401
    """Return the option ``--groups``; `default` is described, not set."""
    help = f"{help}: a preset, a TOML file or auto:N (default: {default})"  # noqa: A001
    details = "auto:N finds N groups of joints that move together, auto also chooses N"
    return setting(help, _GROUPS, details=details)


def output_option(*given: Any, **more: Any) -> Any:  # noqa: ANN401 - those of `option`
    """Return the option ``-o``."""
    return option(*given, short="-o", **more)


@dataclass(frozen=True, kw_only=True)
class ResultOptions(Options, section="output"):
    """Options of commands that print a result."""

    json: bool = switch("print the results as one JSON document", is_expert=True)


@dataclass(frozen=True, kw_only=True)
class WriterOptions(ResultOptions, section="output"):
    """Options of commands that write files."""

    force: bool = switch("overwrite existing files")


@dataclass(frozen=True, kw_only=True)
class SeedOptions(Options, section="how different"):
    """Options of commands that draw random numbers."""

    seed: int | None = setting("seed of the random number generator (default: 0)", values.INDEX)


@dataclass(frozen=True, kw_only=True)
class DigitsOptions(Options, section="output"):
    """Options of commands that write .bvh files."""

    digits: int | None = setting(
        "decimals of computed angles in a .bvh file, from 1 to 12 (default: those of the file, at "
        "least 6)",
        values.Value("N", values.decimals),
        is_expert=True,
    )


@dataclass(frozen=True, kw_only=True)
class SkeletonOptions(ResultOptions, section="input"):
    """Options of commands that read motion files."""

    files: tuple[str, ...] = positional("motion files, or folders of them", values.FILES, "+")
    skeleton: str | None = setting(
        "rest pose for files that store none, such as those of AMASS: a motion file, or a .json "
        "file of offsets (default: a substitute with published body proportions)",
        values.SOURCE,
        is_expert=True,
    )


@dataclass(frozen=True, kw_only=True)
class FieldOptions(ResultOptions, section="how different"):
    """Options of commands that segment motions."""

    set: tuple[tuple[str, str], ...] = setting(
        "another field of the configuration",
        values.Value("FIELD=VALUE", values.assignment),
        (),
        details="such as seam=offset; may be repeated; docs/settings.md lists the fields",
        is_repeated=True,
    )
    configured: tuple[tuple[str, str], ...] = ()
    """Fields and values of ``set`` in the configuration file and the environment."""


@dataclass(frozen=True, kw_only=True)
class LibraryFileOptions(SkeletonOptions, section="input"):
    """Options for the files from which a library is built."""

    files: tuple[str, ...] = positional(
        "motion files, or one library", values.LIBRARY_OR_FILES, "+"
    )
    groups: str | None = groups_option()
    include_grafts: bool = switch(
        "also read grafts in folders: motions with a .json file of mograft graft beside them",
        is_expert=True,
        is_setting=True,
    )
    match: str | None = setting(
        "how motions of different hierarchies fit together (default: names)",
        _MATCH,
        details="names - all must have the same joint names and hierarchy; anatomy - joints "
        "correspond by body part, and those without a counterpart are listed",
        is_expert=True,
    )


@dataclass(frozen=True, kw_only=True)
class LibraryOptions(FieldOptions, LibraryFileOptions, section="how different"):
    """Options of commands that open a library, or build one from motion files."""

    preset: str | None = setting(
        "configuration before other options change it; paper has the parameters of the paper "
        "(default: default)",
        values.choice("default", "paper"),
        is_expert=True,
    )
    variety: float | None = setting(
        "from 0 (few, similar donors) to 1 (many, less similar donors) (default: 0.5)",
        values.Value("X", values.share),
    )


@dataclass(frozen=True, kw_only=True)
class KeepOptions(Options, section="what to keep"):
    """Options for frames that are not exchanged."""

    keep: tuple[Range, ...] = repeated(
        "frames, or times as 3s-4s, that stay as captured",
        values.FRAMES,
        details="segments that contain part of this range are not exchanged; may be repeated",
    )


@dataclass(frozen=True, kw_only=True)
class PlaceOptions(Options, section="where the hands go"):
    """Options for places that the body must reach, face or avoid."""

    reach: tuple[tuple[Range, str, values.Point, float], ...] = repeated(
        "position of a joint in a frame",
        values.Value("FRAME[-LAST]:JOINT:X,Y,Z[~TOL]", values.reach),
        details="or in all frames to LAST, within TOL skeleton heights "
        f"(default: {values.REACH_TOLERANCE}); may be repeated",
    )
    avoid: tuple[tuple[str, tuple[float, ...], Range | None], ...] = repeated(
        "obstacle, such as sphere:X,Y,Z,RADIUS",
        values.Value("WHAT[@FIRST-LAST]", values.obstacle),
        details="FILE.bvh[@X,Y,Z[,YAW]] (another character, turned by YAW degrees, then moved by "
        "X,Y,Z), capsule:X,Y,Z,X,Y,Z,RADIUS (its two ends), box:X,Y,Z,HX,HY,HZ (its centre and "
        "half of its sizes) or wall:X,Y,Z,NX,NY,NZ (a point and the normal); in all frames or "
        "from FIRST to LAST; may be repeated",
    )
    avoid_self: bool = switch(
        "forbid contact of hands and forearms with trunk, head, thighs and each other",
        is_expert=True,
        is_setting=True,
    )
    face: tuple[tuple[values.Point, Range | None], ...] = repeated(
        "position that the head must face within 20 degrees; may be repeated",
        values.Value("X,Y,Z[@FIRST-LAST]", values.face),
        is_expert=True,
    )


@dataclass(frozen=True, kw_only=True)
class DonorOptions(Options, section="donors"):
    """Options for the segments that may be donors."""

    take: tuple[tuple[SegmentValue, Taken], ...] = repeated(
        "donor that a base segment must have: frames FIRST-LAST of CLIP, from any cluster and of "
        "any duration; SEGMENT is the index of the base segment, from 0, or its frames FIRST-LAST; "
        "GROUP:SEGMENT selects one of several exchanged groups; may be repeated",
        values.TAKE,
    )
    ban: tuple[tuple[SegmentValue, str | Taken | None], ...] = repeated(
        "donors that a base segment must not have: all segments of CLIP, or those that overlap its "
        "frames FIRST-LAST. Without CLIP, the base segment must not keep its captured motion, or "
        "with --from the donor that it has in the graft. SEGMENT is as for --take; may be repeated",
        values.BAN,
    )
    only_from: tuple[str, ...] | None = setting(
        "clips that may provide donors; CLIP may be a glob such as waltz*", values.CLIPS
    )
    not_from: tuple[str, ...] | None = setting(
        "clips that must not provide donors; CLIP may be a glob such as waltz*", values.CLIPS
    )
    only_tagged: tuple[str, ...] | None = setting(
        "tags of clips that may provide donors", values.TAGS
    )
    not_tagged: tuple[str, ...] | None = setting(
        "tags of clips that must not provide donors", values.TAGS
    )
    max_stretch: float | None = setting(
        "maximum difference between the durations of donor and base segment, as a fraction of the "
        "duration of the base segment (default: 0.15)",
        values.Value("X", values.non_negative_number),
    )
    max_angle: float | None = setting(
        "maximum seam angle in degrees (default: 45)",
        values.Value("DEGREES", values.positive_number),
    )


@dataclass(frozen=True, kw_only=True)
class ConstraintOptions(DonorOptions, PlaceOptions, KeepOptions, LibraryOptions):
    """Options of commands that open a library and set constraints."""
