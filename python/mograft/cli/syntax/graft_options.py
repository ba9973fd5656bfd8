"""The options of ``mograft graft`` and of ``mograft candidates``."""

from dataclasses import dataclass
from pathlib import Path

from mograft.cli.syntax import values
from mograft.cli.syntax.arguments import (
    CHANGE,
    DIFFERENT,
    INPUT,
    KEEP,
    OUTPUT,
    PLACE,
    SCENARIO,
    option,
    repeated,
    setting,
    switch,
)
from mograft.cli.syntax.frames import Frame, SegmentValue, frame, frame_count, segment_value
from mograft.cli.syntax.shared import (
    ConstraintOptions,
    WriterOptions,
    decimals_option,
    files_argument,
    output_option,
    seed_option,
)

DEFAULT_DURATION = 60.0
"""Duration of ``--scenario graph`` in seconds."""


@dataclass(frozen=True, kw_only=True)
class CandidatesOptions(ConstraintOptions):
    """Options of ``mograft candidates``."""

    clip: str | None = option(
        "clip that contains the segment (default: the first clip)", metavar="NAME"
    )
    segment: int | None = option(
        "index of the segment in the clip, from 0; or give --frame",
        values.non_negative_integer,
        metavar="N",
    )
    frame: Frame | None = option(
        "a frame of the segment, counted from 0 in the clip, or a time such as 10.5s",
        frame,
        metavar="N|S",
    )
    group: str | None = option(
        "joint group to exchange (default: the first group that is not the base group)"
    )


@dataclass(frozen=True, kw_only=True)
class ScenarioOptions(ConstraintOptions):
    """Options for the base motion."""

    base: str | None = option(
        "base motion (default: the first clip)",
        metavar="CLIP|FILE",
        section=KEEP,
        is_path=True,
    )
    scenario: str = option(
        "motion of the base group (default: original)",
        default="original",
        details="original - a captured clip; graph - a random sequence of segments, in which each "
        "segment continues the motion of the previous one; or indices of segments in the library, "
        "which are joined in this order",
        metavar="original|graph|N,...",
        section=SCENARIO,
    )
    duration: float | None = option(
        "duration of --scenario graph, in seconds, at most 86400 "
        f"(default: {DEFAULT_DURATION:.0f})",
        values.positive_number,
        metavar="S",
        section=SCENARIO,
    )
    frames: Frame | None = option(
        "exact number of frames of --scenario graph, or a time such as 30s",
        frame_count,
        metavar="N|S",
        section=SCENARIO,
    )
    path: list[tuple[float, float]] | None = setting(
        "corners of a path on the floor that --scenario graph follows, in the unit of the file "
        "(X,Y if z points up); the length of the path determines the duration",
        values.corners,
        metavar="X,Z:X,Z:...",
        section=SCENARIO,
    )
    beats: float | None = setting(
        "tempo of --scenario graph in beats per minute: a segment ends on each beat",
        values.positive_number,
        metavar="BPM",
        section=SCENARIO,
    )
    among: tuple[str, ...] | None = setting(
        "clips whose segments --scenario graph uses; CLIP may be a glob such as waltz*",
        values.names,
        metavar="CLIP,...",
        section=SCENARIO,
    )


@dataclass(frozen=True, kw_only=True)
class GraftOptions(ScenarioOptions, WriterOptions):
    """Options of ``mograft graft``."""

    files: tuple[str, ...] = files_argument(
        "motion files, or one library; none with --from", nargs="*"
    )
    from_: str | None = option(
        ".json file of a graft to make again, byte for byte",
        details="--take, --ban, --keep and --reroll change some segments and leave the others "
        "unchanged; LIB|FILE is needed only if files have moved",
        metavar="JSON",
        section=INPUT,
        is_path=True,
    )
    swap: tuple[str, ...] | None = setting(
        "groups to exchange (default: all but the base)",
        values.names,
        metavar="GROUP,...",
        section=CHANGE,
    )
    repair: bool = switch(
        "exchange only segments that violate the constraints", section=CHANGE, is_expert=True
    )
    reroll: tuple[SegmentValue, ...] = repeated(
        "with --from: a base segment that gets another donor; may be repeated",
        segment_value,
        details="its index, or frames FIRST-LAST of several",
        metavar="SEGMENT",
        section=CHANGE,
        is_expert=True,
    )
    count: int = option(
        "number of motions (default: 1)",
        values.positive_integer,
        1,
        details="if neither --variety nor --set sigma_scale is given and the donors allow fewer "
        "different motions, the clusters are enlarged",
        metavar="N",
        short="-n",
        section=DIFFERENT,
    )
    seed: int | None = seed_option(DIFFERENT)
    mirror: bool = switch(
        "use the mirror images of all clips as additional donors",
        section=DIFFERENT,
        is_expert=True,
        is_setting=True,
    )
    best_effort: bool = switch(
        "also write motions that violate constraints",
        is_expert=True,
        details="if no donor sequence satisfies them, those with the smallest violation, and "
        "return exit code 0 instead of 4",
        section=PLACE,
        is_setting=True,
    )
    output: Path = output_option(
        "folder, or a .bvh, .npz or .glb file",
        details="a .bvh file for a single motion; an .npz file for a single motion, which is a "
        "copy of the base's AMASS file; a .glb file for one or more motions, which is a copy of "
        "the base's glTF file",
        metavar="PATH",
        required=True,
    )
    digits: int | None = decimals_option()
    report: bool = switch(
        "also write an HTML page that describes the motions", section=OUTPUT, is_setting=True
    )
    measure: bool = switch(
        "also measure jerk, foot contacts and balance (needs mograft[evaluate])",
        details="the values are added to the .json files and to the page of --report",
        is_expert=True,
        section=OUTPUT,
        is_setting=True,
    )
