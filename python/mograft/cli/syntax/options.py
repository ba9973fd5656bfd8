"""Options of ``mograft graft`` and those that commands share, by heading of ``--help``."""

from typing import Any, Literal

from mograft.cli.syntax import values
from mograft.cli.syntax.arguments import Options, option, positional, setting

DEFAULT_DURATION = 60.0
"""Duration of ``--scenario graph`` in seconds."""


def groups_option(help: str = "joint groups", default: str = "lower_upper") -> Any:  # noqa: A002, ANN401
    """Return the option ``--groups``; `default` is described, not set."""
    help = f"{help}: a preset, a TOML file or auto:N (default: {default})"  # noqa: A001
    details = "auto:N finds N groups of joints that move together, auto also chooses N"
    return setting(help, details=details)


class ResultOptions(Options, section="output"):
    """Options of commands that print a result."""

    json: bool = option("print the results as one JSON document", is_expert=True)


class WriterOptions(ResultOptions, section="output"):
    """Options of commands that write files."""

    force: bool = option("overwrite existing files")


class SeedOptions(Options, section="how different"):
    """Options of commands that draw random numbers."""

    seed: values.Index | None = setting("seed of the random number generator (default: 0)")


class DigitsOptions(Options, section="output"):
    """Options of commands that write .bvh files."""

    digits: values.Decimals | None = setting(
        "decimals of computed angles in .bvh files, 1 to 12 (default: of the file, at least 6)",
        is_expert=True,
    )


class SkeletonOptions(ResultOptions, section="input"):
    """Options of commands that read motion files."""

    files: tuple[values.Source, ...] = positional("motion files, or folders of them", "+")
    skeleton: values.Source | None = setting(
        "motion file with the rest pose of input files that store none, such as those of AMASS "
        "(default: published body proportions)",
        is_expert=True,
    )
    model: values.Source | None = setting("model of a robot, MJCF or URDF")
    quaternion: Literal["wxyz", "xyzw"] | None = setting(
        "order of the root's quaternion in robot CSV files (default: found in each file)",
        is_expert=True,
    )
    fps: tuple[values.FileRate, ...] = setting(
        "frames per second of robot CSV files that state none, or of those whose names match GLOB "
        "(default: 30); may be repeated",
        is_expert=True,
    )


class FieldOptions(ResultOptions, section="how different"):
    """Options of commands that segment motions."""

    set: tuple[values.Assignment, ...] = setting(
        "another field of the configuration",
        details="such as seam_blend=0.6 (seconds that a seam blends), reach_ik=1 (a whole arm) or "
        "loop=on; may be repeated; docs/settings.md lists the fields",
    )
    configured: tuple[tuple[str, str], ...] = ()
    """Fields and values of ``set`` in the configuration file and the environment."""


class LibraryFileOptions(SkeletonOptions, section="input"):
    """Options for the files from which a library is built."""

    files: tuple[values.LibraryOrFile, ...] = positional("motion files, or one library", "+")
    groups: values.Groups | None = groups_option("joint groups that exist")
    include_grafts: bool = setting(
        "also read grafts: motions with the provenance of mograft graft in the file or beside it",
        is_expert=True,
    )
    match: Literal["names", "anatomy"] | None = setting(
        "which joints of the motions correspond (default: names)",
        details="names - those of the same name; all motions must have one hierarchy; anatomy - "
        "those of the same body part; joints without a counterpart are left out and listed",
        is_expert=True,
    )


class LibraryOptions(FieldOptions, LibraryFileOptions, section="how different"):
    """Options of commands that open a library, or build one from motion files."""

    preset: Literal["default", "paper", "paper-rms"] | None = setting(
        "configuration that other options change: of the paper, or with its sigma as root mean "
        "square (default: default)",
        is_expert=True,
    )
    variety: values.Share | None = setting("0 (few, similar donors) to 1 (default: 0.5)")


class KeepOptions(Options, section="what to keep"):
    """Options for frames that are not exchanged."""

    keep: tuple[values.Frames, ...] = option(
        "frames, or times as 3s-4s, that stay as captured",
        details="segments that contain part of this range are not exchanged; may be repeated",
    )


class PlaceOptions(Options, section="where the hands go"):
    """Options for places that the body must reach, face or avoid."""

    reach: tuple[values.Reach, ...] = option(
        "position of a joint, also relative to a @PART",
        details="in a frame or in all frames to LAST, within TOL skeleton heights "
        f"(default: {values.REACH_TOLERANCE}); 120:LeftHand:@chest+0,0,0.25 is relative to the "
        "chest, @LeftHand+0,0.1,0 to the present place of the hand: in skeleton heights to the "
        "left of the figure, up and forward; may be repeated",
    )
    avoid: tuple[values.Avoid, ...] = option(
        "obstacle, such as sphere:X,Y,Z,RADIUS",
        details="FILE.bvh[@X,Y,Z[,YAW]] (another character, turned by YAW degrees, then moved by "
        "X,Y,Z), capsule:X,Y,Z,X,Y,Z,RADIUS (its two ends), box:X,Y,Z,HX,HY,HZ (its centre and "
        "half of its sizes) or wall:X,Y,Z,NX,NY,NZ (a point and the normal); in all frames or "
        "from FIRST to LAST; may be repeated",
    )
    avoid_self: bool = setting(
        "forbid contact of hands and forearms with trunk, head, thighs and each other",
        is_expert=True,
    )
    face: tuple[values.Face, ...] = option(
        "position that the head must face within 20 degrees; may be repeated", is_expert=True
    )


class DonorOptions(Options, section="donors"):
    """Options for the segments that may be donors."""

    take: tuple[values.Take, ...] = option(
        "donor that a base segment must have: the segment of CLIP with frames FIRST-LAST, from "
        "mograft candidates or any other, however long and similar; SEGMENT is the index of the "
        "base segment, from 0, or its frames FIRST-LAST; GROUP:SEGMENT selects one of several "
        "exchanged groups; may be repeated"
    )
    ban: tuple[values.Ban, ...] = option(
        "donors that a base segment must not have: all segments of CLIP, or those that overlap its "
        "frames FIRST-LAST. Without CLIP, the base segment must not keep its captured motion, or "
        "with --from the donor that it has in the graft, if it has another candidate. SEGMENT is "
        "as for --take; may be repeated"
    )
    only_from: values.Clips | None = setting(
        "clips that may provide donors, or globs such as waltz*"
    )
    not_from: values.Clips | None = setting("clips that must not provide donors, or globs")
    only_tagged: values.Tags | None = setting("tags of clips that may provide donors")
    not_tagged: values.Tags | None = setting("tags of clips that must not provide donors")
    max_stretch: values.Stretch | None = setting(
        "maximum stretch of a donor, as a fraction of the base segment's duration (default: 0.15)"
    )
    max_angle: values.Degrees | None = setting("maximum seam angle in degrees (default: 45)")


class ConstraintOptions(DonorOptions, PlaceOptions, KeepOptions, LibraryOptions):
    """Options of commands that open a library and set constraints."""


class CandidatesOptions(ConstraintOptions):
    """List the segments that may replace a segment, and why others are refused."""

    clip: values.Name | None = option("clip that contains the segment (default: the first clip)")
    segment: values.Index | None = option("index of the segment in the clip, from 0; or --frame")
    frame: values.FrameValue | None = option(
        "frame of the segment, from 0, or a time such as 10.5s"
    )
    group: values.Name | None = option("joint group to exchange (default: the first but the base)")


class ScenarioOptions(Options, section="scenario"):
    """Options for base motions that are not captured."""

    scenario: Literal["original", "graph"] = option(
        "motion of the base group: original - a captured clip; graph - a random sequence of "
        "segments, in which each segment continues the motion of the previous one (default: "
        "original)",
        default="original",
    )
    duration: values.Duration | None = option(
        f"duration of --scenario graph in seconds, at most 86400 (default: {DEFAULT_DURATION:.0f})"
    )
    length: values.Length | None = option("exact frames of --scenario graph, or a time such as 30s")
    path: values.Corners | None = setting(
        "corners of a path that --scenario graph follows, in the unit of the file (X,Y if z is up)"
    )
    beats: values.Tempo | None = setting(
        "beats per minute, on which --scenario graph ends segments"
    )
    among: values.Clips | None = setting(
        "clips that --scenario graph uses, or globs such as waltz*"
    )


class RecordOptions(Options, section="input"):
    """Options for grafts that are made again."""

    files: tuple[values.LibraryOrFile, ...] = positional(
        "motion files, or one library; none with --from", "*"
    )
    from_: values.Record | None = option(
        "graft to make again: .json or FILE.glb#NAME",
        details="the bytes are the same; --change, --take, --ban, --keep, and options "
        "for places and donors change what they must and leave the rest unchanged; --set of fields "
        "of blending keeps all donors; LIB|FILE is needed only if files have moved",
    )
    project: values.File | None = option(
        "project file of mograft studio; writes the motions that it keeps, with the same bytes",
        is_expert=True,
    )


class ChangeOptions(Options, section="what to change"):
    """Options for the parts that are exchanged, and for the motion of the base group."""

    base: values.ClipOrFile | None = option(
        "base motion (default: the first clip)", section="what to keep"
    )
    swap: values.Words | None = setting("which of --groups change (default: all but base)")
    change: tuple[values.Change, ...] = option(
        "another part of a clip for a group",
        details="or for a body part in it (torso, head, arms, larm, rarm), in a range of frames or "
        "times; arms@60- is to the end; CLIP may be a glob such as wave*; without CLIP, the part "
        "that fits best of those that differ by 15 degrees or more from the present one, from "
        "clips that are not used there, if there are any; -n makes as many alternatives. All other "
        "frames and joints stay as they are in the graft of --from, or else as captured; in a "
        "loop, a part of CLIP stays whole at the ends; may be repeated",
    )
    only_violations: bool = option("exchange only what violates the constraints", is_expert=True)


class VarietyOptions(SeedOptions, section="how different"):
    """Options for several motions."""

    count: values.Motions = option(
        "number of motions (default: 1)",
        default=1,
        details="without --variety, less similar donors are used if others allow fewer motions",
        short="-n",
    )
    distinct: values.Distance = setting(
        "smallest angle between two motions (default: 0)",
        default=0.0,
        details="it is the mean of the exchanged joints",
    )
    mirror: bool = setting("use the mirror images of all clips as donors, too", is_expert=True)


class GraftOptions(
    DigitsOptions,
    WriterOptions,
    VarietyOptions,
    ChangeOptions,
    RecordOptions,
    ScenarioOptions,
    ConstraintOptions,
    section="output",
):
    """Create motions by exchanging joint groups of a captured motion.

    The base group, by default the legs and the root, keeps its motion. The other joint groups are
    taken from segments in which the base group moves similarly. Positions are in the unit of the
    file; frames are counted from 0.
    """

    output: values.OutputPath = option(
        "folder, or a .bvh, .csv, .npz or .glb file",
        details="a .bvh file (for a robot .csv) for a single motion; a .glb or .npz file for one "
        "or more: a copy of the glTF, FBX or AMASS file of the base, else bones or arrays. With "
        "--from, a .glb file that exists is updated as with --into",
        short="-o",
        is_required=True,
        alternative="into",
    )
    into: values.OutputPath | None = option(
        "instead of -o: .glb file to which the motions are added as animations; a graft of the "
        "same name is replaced, another animation only with --force",
        is_expert=True,
    )
    as_: values.Name | None = option("name of the animation in a .glb file", is_expert=True)
    best_effort: bool = setting(
        "if no donor sequence satisfies the constraints, write the motions with the smallest "
        "violation and return exit code 0 instead of 4",
        section="where the hands go",
        is_expert=True,
    )
    report: bool = setting("also write an HTML page that describes the motions")
    only_feasible: bool = setting(
        "of a robot, write only motions whose checks are at most the 99th percentile of those of "
        "the recordings; see mograft check",
        is_expert=True,
    )
    measure: bool = setting(
        "also measure jerk, foot contacts and balance of each motion (needs mograft[evaluate])",
        is_expert=True,
    )
