"""Options of ``mograft graft`` and those that commands share, by heading of ``--help``."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mograft.cli.syntax import values
from mograft.cli.syntax.arguments import Options, option, positional, repeated, setting, switch
from mograft.cli.syntax.frames import Frame, Range, SegmentValue, Taken

PRESETS = ("lower_upper", "lower_torso_arms", "lower_torso_larm_rarm", "lower_torso_head_larm_rarm")
DEFAULT_DURATION = 60.0
"""Duration of ``--scenario graph`` in seconds."""
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


@dataclass(frozen=True, kw_only=True)
class CandidatesOptions(ConstraintOptions):
    """List the segments that may replace a segment, and why others are refused."""

    clip: str | None = option(
        "clip that contains the segment (default: the first clip)", values.NAME
    )
    segment: int | None = option(
        "index of the segment in the clip, from 0; or give --frame", values.INDEX
    )
    frame: Frame | None = option(
        "a frame of the segment, counted from 0 in the clip, or a time such as 10.5s", values.FRAME
    )
    group: str | None = option(
        "joint group to exchange (default: the first group that is not the base group)", values.NAME
    )


@dataclass(frozen=True, kw_only=True)
class BaseOptions(Options, section="what to keep"):
    """Options for the motion of the base group."""

    base: str | None = option(
        "base motion (default: the first clip)", values.Value("CLIP|FILE", is_path=True)
    )


@dataclass(frozen=True, kw_only=True)
class ScenarioOptions(Options, section="scenario"):
    """Options for base motions that are not captured."""

    scenario: str = option(
        "motion of the base group: original - a captured clip; graph - a random sequence of "
        "segments, in which each segment continues the motion of the previous one; or indices of "
        "segments in the library, which are joined in this order (default: original)",
        values.Value("original|graph|N,..."),
        "original",
    )
    duration: float | None = option(
        f"duration of --scenario graph in seconds, at most 86400 (default: {DEFAULT_DURATION:.0f})",
        values.SECONDS,
    )
    frames: Frame | None = option(
        "exact number of frames of --scenario graph, or a time such as 30s", values.LENGTH
    )
    path: list[tuple[float, float]] | None = setting(
        "corners of a path on the floor that --scenario graph follows, in the unit of the file "
        "(X,Y if z points up); the length of the path determines the duration",
        values.Value("X,Z:X,Z:...", values.corners),
    )
    beats: float | None = setting(
        "tempo of --scenario graph in beats per minute: a segment ends on each beat",
        values.Value("BPM", values.positive_number),
    )
    among: tuple[str, ...] | None = setting(
        "clips whose segments --scenario graph uses; CLIP may be a glob such as waltz*",
        values.CLIPS,
    )


@dataclass(frozen=True, kw_only=True)
class RecordOptions(Options, section="input"):
    """Options for grafts that are made again."""

    files: tuple[str, ...] = positional(
        "motion files, or one library; none with --from", values.LIBRARY_OR_FILES, "*"
    )
    from_: str | None = option(
        ".json file of a graft to make again, byte for byte",
        values.Value("JSON", is_path=True),
        details="--take, --ban, --keep and --reroll change some segments and leave the others "
        "unchanged; LIB|FILE is needed only if files have moved",
    )


@dataclass(frozen=True, kw_only=True)
class ChangeOptions(Options, section="what to change"):
    """Options for the parts that are exchanged."""

    swap: tuple[str, ...] | None = setting(
        "groups to exchange (default: all but the base)", values.Value("GROUP,...", values.names)
    )
    repair: bool = switch("exchange only segments that violate the constraints", is_expert=True)
    reroll: tuple[SegmentValue, ...] = repeated(
        "with --from: index of a base segment that gets another donor, or frames FIRST-LAST of "
        "several; may be repeated",
        values.SEGMENT,
        is_expert=True,
    )


@dataclass(frozen=True, kw_only=True)
class VarietyOptions(SeedOptions, section="how different"):
    """Options for several motions."""

    count: int = option(
        "number of motions (default: 1)",
        values.COUNT,
        1,
        details="if neither --variety nor --set sigma_scale is given and the donors allow fewer "
        "different motions, the clusters are enlarged",
        short="-n",
    )
    distinct: float = option(
        "smallest mean angle, in degrees, between the exchanged joints of any two motions; motions "
        "that are nearer are left out (default: 0)",
        values.Value("DEGREES", values.non_negative_number),
        0.0,
        is_setting=True,
    )
    mirror: bool = switch(
        "use the mirror images of all clips as additional donors", is_expert=True, is_setting=True
    )


@dataclass(frozen=True, kw_only=True)
class EffortOptions(Options, section="where the hands go"):
    """Options for constraints that cannot be satisfied."""

    best_effort: bool = switch(
        "if no donor sequence satisfies the constraints, write the motions with the smallest "
        "violation and return exit code 0 instead of 4",
        is_expert=True,
        is_setting=True,
    )


@dataclass(frozen=True, kw_only=True)
class GraftOptions(
    DigitsOptions,
    WriterOptions,
    EffortOptions,
    VarietyOptions,
    ChangeOptions,
    RecordOptions,
    ScenarioOptions,
    BaseOptions,
    ConstraintOptions,
    section="output",
):
    """Create motions by exchanging joint groups of a captured motion.

    The base group, by default the legs and the root, keeps its motion. The other joint groups are
    taken from segments in which the base group moves similarly. Positions are in the unit of the
    file; frames are counted from 0.
    """

    output: Path = output_option(
        "folder, or a .bvh, .npz or .glb file",
        values.PATH,
        details="a .bvh file for a single motion; an .npz file for a single motion, which is a "
        "copy of the base's AMASS file; a .glb file for one or more motions, which is a copy of "
        "the base's glTF file",
        is_required=True,
    )
    report: bool = switch("also write an HTML page that describes the motions", is_setting=True)
    measure: bool = switch(
        "also measure jerk, foot contacts and balance of each motion, and add the values to its "
        ".json file and to the page of --report (needs mograft[evaluate])",
        is_expert=True,
        is_setting=True,
    )
