"""The options of ``mograft graft`` and of ``mograft candidates``."""

from dataclasses import dataclass
from pathlib import Path

from mograft.cli.syntax import values
from mograft.cli.syntax.arguments import (
    Options,
    option,
    positional,
    repeated,
    setting,
    switch,
)
from mograft.cli.syntax.frames import Frame, SegmentValue
from mograft.cli.syntax.shared import (
    ConstraintOptions,
    DigitsOptions,
    SeedOptions,
    WriterOptions,
    output_option,
)

DEFAULT_DURATION = 60.0
"""Duration of ``--scenario graph`` in seconds."""


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
