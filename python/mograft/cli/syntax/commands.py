"""All commands, and the options of those that need few."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from mograft.cli.syntax import values
from mograft.cli.syntax.arguments import (
    INPUT,
    OUTPUT,
    Command,
    Options,
    option,
    positional,
    repeated,
    setting,
    switch,
)
from mograft.cli.syntax.frames import Range, frames
from mograft.cli.syntax.graft_options import CandidatesOptions, GraftOptions
from mograft.cli.syntax.shared import (
    PRESETS,
    FieldOptions,
    LibraryOptions,
    ResultOptions,
    SkeletonOptions,
    WriterOptions,
    decimals_option,
    files_argument,
    groups_option,
    output_option,
    seed_option,
)

PLOT_KINDS = (
    "strip",
    "timeline",
    "energy",
    "pca",
    "dendrogram",
    "clusters",
    "groups",
)
EVALUATION_TOPICS = ("quality", "world", "detectability", "balance")
TABLE_FORMATS = ("parquet", "csv", "npz")
_FIGURE_COLOURS = "joint groups that set the colours"


@dataclass(frozen=True, kw_only=True)
class DemoOptions(WriterOptions):
    """Options of ``mograft demo``."""

    output: Path = output_option(
        "folder for the files (default: demo)", metavar="DIR", default=Path("demo")
    )
    open: bool = switch("open the page in the browser", section=OUTPUT)
    seed: int | None = seed_option()


@dataclass(frozen=True, kw_only=True)
class InfoOptions(SkeletonOptions):
    """Options of ``mograft info``."""

    match: str | None = setting(
        "anatomy also lists which joints of each file correspond to those of the first file "
        "(default: names)",
        choices=("names", "anatomy"),
    )


@dataclass(frozen=True, kw_only=True)
class CheckOptions(SkeletonOptions):
    """Options of ``mograft check``."""

    strict: bool = switch("treat every deviation from the BVH format as an error", is_setting=True)


@dataclass(frozen=True, kw_only=True)
class GroupsOptions(SkeletonOptions, WriterOptions):
    """Options of ``mograft groups``."""

    files: tuple[str, ...] = files_argument(
        "motion file or folder; --preset auto uses all files of a folder, other presets the first",
        "FILE",
        nargs=1,
    )
    preset: str = setting(
        f"one of {', '.join(PRESETS)}; or auto or auto:N, groups of joints that move together "
        "(default: lower_upper)",
        values.preset_or_automatic(PRESETS),
        "lower_upper",
        metavar="NAME",
    )
    output: Path | None = output_option("TOML file to write (default: stdout)")


@dataclass(frozen=True, kw_only=True)
class IndexOptions(LibraryOptions, WriterOptions):
    """Options of ``mograft index``."""

    files: tuple[str, ...] = files_argument("motion files, or folders of them", "FILE|DIR")
    rate: float | None = setting(
        "frame rate of the library (default: the rate that most frames of the files have)",
        values.positive_number,
        metavar="FPS",
        section=INPUT,
    )
    true_rate: tuple[tuple[str, float], ...] = repeated(
        "true frame rate of a clip whose file contains a wrong one; may be repeated",
        values.true_rate,
        details="CLIP may be a glob",
        metavar="CLIP=FPS",
        section=INPUT,
        is_expert=True,
    )
    tags: Path | None = option(
        "table of clips and their tags; the folders of a clip also become its tags",
        Path,
        metavar="CSV",
        section=INPUT,
        is_path=True,
    )
    strict: bool = switch(
        "fail if a file cannot be used, instead of excluding it", section=INPUT, is_setting=True
    )
    output: Path = output_option("folder of the library", metavar="LIB", required=True)
    add: bool = switch(
        "add to an existing library; only new and changed files are read", section=OUTPUT
    )
    jobs: int = setting(
        "number of processes that read files (default: 1)",
        values.positive_integer,
        1,
        metavar="N",
        short="-j",
    )
    force: bool = switch("replace an existing library", section=OUTPUT)


@dataclass(frozen=True, kw_only=True)
class StoredOptions(ResultOptions):
    """Options of the subcommands of ``mograft lib``."""

    library: Path = positional("folder of a library", is_path=True, type=Path, metavar="LIB")


@dataclass(frozen=True, kw_only=True)
class LibInfoOptions(StoredOptions):
    """Options of ``mograft lib info``."""

    clips: bool = switch("also list the clips")


@dataclass(frozen=True, kw_only=True)
class VerifyOptions(StoredOptions):
    """Options of ``mograft lib verify``."""

    sources: bool = switch("also compare the motion files of the library with their checksums")


@dataclass(frozen=True, kw_only=True)
class TablesOptions(StoredOptions, WriterOptions):
    """Options of ``mograft lib export``."""

    format: Literal["parquet", "csv", "npz"] = option(
        f"{', '.join(TABLE_FORMATS)}; parquet needs mograft[parquet]",
        choices=TABLE_FORMATS,
        section=OUTPUT,
        required=True,
    )
    output: Path = output_option(
        "folder for the tables; for npz the file to write", metavar="PATH", required=True
    )


@dataclass(frozen=True, kw_only=True)
class StreamOptions(LibraryOptions):
    """Options of ``mograft stream``."""

    port: int | None = option(
        "TCP port from 0 to 65535; 0 selects a free port; or give --socket",
        values.port,
        metavar="N",
    )
    socket: Path | None = option(
        "path of a Unix socket to create", Path, metavar="PATH", is_path=True
    )
    host: str = setting(
        "address at which the TCP port is open (default: 127.0.0.1, only this computer)",
        default="127.0.0.1",
        metavar="ADDRESS",
    )
    timeout: float = setting(
        "pause between two messages, in seconds, after which a connection is closed (default: 600)",
        values.positive_number,
        600.0,
        metavar="SECONDS",
    )


@dataclass(frozen=True, kw_only=True)
class ViewOptions(FieldOptions, SkeletonOptions, WriterOptions):
    """Options of ``mograft view``."""

    files: tuple[str, ...] = files_argument("motion files, or one library")
    clip: tuple[str, ...] = repeated(
        "clips of a library to show; NAME may be a glob such as walk*; may be repeated "
        "(default: all clips)",
        metavar="NAME",
    )
    groups: str | None = groups_option(_FIGURE_COLOURS, "trunk, arms and legs")
    title: str | None = option("title of the page (default: the names of the first three motions)")
    output: Path | None = output_option(
        "HTML file to write (default: a temporary file, opened in the browser)"
    )
    open: bool = switch("open the page in the browser, even if -o is given", section=OUTPUT)


@dataclass(frozen=True, kw_only=True)
class PlotOptions(LibraryOptions, WriterOptions):
    """Options of ``mograft plot``."""

    kind: str = positional(
        "strip (poses of one motion), timeline (segments along time), energy (kinetic energy), pca "
        "(segments in principal components), dendrogram (linkage tree), clusters (cluster sizes) "
        "or groups (which joints move together)",
        choices=PLOT_KINDS,
        metavar="KIND",
    )
    files: tuple[str, ...] = files_argument("motion files, or one library")
    clip: tuple[str, ...] = repeated(
        "clips of a library for strip, energy or timeline; NAME may be a glob; may be repeated",
        metavar="NAME",
    )
    output: Path = output_option(".png, .svg or .pdf file to write", required=True)
    groups: str | None = groups_option(
        default="lower_upper; for strip trunk, arms and legs; for groups auto"
    )
    group: str | None = option(
        "joint group for pca, dendrogram or clusters (default: the base group)",
        metavar="NAME",
    )
    poses: int = setting("number of poses of strip (default: 12)", values.positive_integer, 12)
    frames: Range | None = option(
        "frames, or times such as 3.3s-13.3s, for strip, timeline or energy (default: all)",
        frames,
        metavar="FIRST-LAST",
    )
    dark: bool = switch("draw in light colours on a dark background", is_setting=True)
    dpi: int = setting(
        "resolution of a .png in dots per inch (default: 150)", values.positive_integer, 150
    )


@dataclass(frozen=True, kw_only=True)
class ExportOptions(SkeletonOptions, WriterOptions):
    """Options of ``mograft export``."""

    files: tuple[str, ...] = files_argument(
        "motion file; several for a film, and for a .glb if they have the same skeleton", "FILE"
    )
    output: Path = output_option("file to write", required=True)
    frames: Range | None = option(
        "frames, or times such as 3.3s-13.3s, to write (default: all)", frames, metavar="FIRST-LAST"
    )
    rate: float | None = setting(
        "frame rate of the output (default: the rate of the input; for an .mp4 at most 60, for a "
        ".gif at most 20)",
        values.positive_number,
        metavar="FPS",
    )
    digits: int | None = decimals_option()
    scale: float | str | None = setting(
        f"unit of length of the motion file, for .glb and .usd: {', '.join(values.UNITS)}, or a "
        "number of metres (default: the unit that gives the figure human height)",
        values.unit,
        metavar="UNIT|X",
    )
    like: str | None = option(
        "AMASS file from which a .npz takes all arrays that the motion did not change (default: "
        "write the arrays of mograft)",
        metavar="FILE",
        is_path=True,
    )
    groups: str | None = groups_option(
        f"{_FIGURE_COLOURS} of a figure or film", "trunk, arms and legs"
    )
    size: tuple[int, int] = setting(
        "size of a film in pixels (default: 720x480)",
        values.picture_size,
        "720x480",
        metavar="WIDTHxHEIGHT",
    )
    dark: bool = switch("draw a film in light colours on a dark background", is_setting=True)


@dataclass(frozen=True, kw_only=True)
class EvaluateOptions(LibraryOptions, WriterOptions):
    """Options of ``mograft evaluate``."""

    files: tuple[str, ...] = files_argument(
        "motion files, or one library; additional words such as balance select what to measure"
    )
    output: Path | None = output_option(
        "folder for evaluation.json and index.html (default: no files)", metavar="DIR"
    )
    rate: float | None = setting(
        "frame rate to which all files are resampled (default: the rate of most frames)",
        values.positive_number,
        metavar="FPS",
    )
    runs: int = setting(
        "number of motions created from each base (default: 4)", values.positive_integer, 4
    )
    bases: int = setting(
        "maximum number of clips that are used as base (default: 4)", values.positive_integer, 4
    )
    seed: int | None = seed_option()


@dataclass(frozen=True, kw_only=True)
class ShowOptions(ResultOptions):
    """Options of ``mograft config show``."""

    only: str | None = positional(
        "command whose settings are printed (default: all)", nargs="?", metavar="COMMAND"
    )
    origin: bool = switch("also print the file or variable that sets each value")


@dataclass(frozen=True, kw_only=True)
class CompletionOptions(Options):
    """Options of ``mograft completion``."""

    shell: str = positional(
        "shell for which the script is written",
        choices=("bash", "zsh", "fish", "tcsh", "powershell"),
    )


COMMANDS = (
    Command(
        "demo",
        "create a sample dance, three grafts and a page that shows them",
        DemoOptions,
        "demo:run",
    ),
    Command(
        "info",
        "print joints, frame rate, duration, joint groups and faults of motion files",
        InfoOptions,
        "motions:run_info",
    ),
    Command(
        "check",
        "check the syntax of motion files, and list faults of the recordings",
        CheckOptions,
        "motions:run_check",
    ),
    Command(
        "groups",
        "print the joint groups of a file as TOML, which can be edited and passed to --groups",
        GroupsOptions,
        "motions:run_groups",
    ),
    Command(
        "index",
        "create a library from motion files, or add files to a library",
        IndexOptions,
        "library:run_index",
    ),
    Command(
        "lib",
        "describe, verify or export a library",
        actions=(
            Command(
                "info",
                "print the contents and the configuration",
                LibInfoOptions,
                "library:run_info",
            ),
            Command(
                "verify",
                "compare each file of the library with its checksum",
                VerifyOptions,
                "library:run_verify",
            ),
            Command(
                "export",
                "write the library as tables, for programs such as DuckDB, Spark or pandas",
                TablesOptions,
                "library:run_export",
            ),
        ),
    ),
    Command(
        "candidates",
        "list the segments that may replace a segment, and why others are refused",
        CandidatesOptions,
        "candidates:run",
    ),
    Command(
        "graft",
        "create motions by exchanging joint groups of a captured motion",
        GraftOptions,
        "graft:run",
        "Create motions from a captured motion. The base group, by default the legs and the root, "
        "keeps its motion. The other joint groups are taken from segments in which the base group "
        "moves similarly. Positions are in the unit of the file; frames are counted from 0.",
    ),
    Command(
        "stream",
        "serve grafts of a motion that arrives frame by frame to game engines and other programs",
        StreamOptions,
        "stream:run",
        "Serve streams of grafts, as mograft.Stream makes them, with the protocol "
        "mograft.stream/1. The command prints one line with the address, and runs until it is "
        "interrupted.",
    ),
    Command("view", "show motions side by side in the browser", ViewOptions, "view:run"),
    Command("plot", "draw motions, or the clusters of their segments", PlotOptions, "plot:run"),
    Command(
        "export",
        "write motions in other file formats",
        ExportOptions,
        "export:run",
        "Write motions to a file, whose suffix selects the format: an animated figure (.glb; .usd, "
        ".usda or .usdc, which need mograft[usd]), a film (.mp4 or .gif, which need "
        "mograft[video]), or tables of channel values (.npz, .csv, .bvh).",
    ),
    Command(
        "evaluate",
        "measure the quality, novelty, variety, detectability and balance of grafts",
        EvaluateOptions,
        "evaluate:run",
        "Make grafts of some of the clips, and measure them. Words among FILE that are not files "
        f"select what to measure: {', '.join(EVALUATION_TOPICS)} (default: all).",
    ),
    Command(
        "doctor",
        "check the installation, and list missing optional packages",
        ResultOptions,
        "program:run_doctor",
    ),
    Command(
        "config",
        "print the settings of the configuration file and the environment",
        actions=(
            Command(
                "show",
                "print all settings in the format of mograft.toml",
                ShowOptions,
                "program:run_config",
                "Print the settings of the commands in the format of mograft.toml, which mograft "
                "reads from the working folder or the nearest folder above it. Environment "
                "variables such as MOGRAFT_SEED or MOGRAFT_GRAFT_SEED override the file, and the "
                "command line overrides both.",
            ),
        ),
    ),
    Command(
        "completion",
        "print a script for shell completion of commands, options and files",
        CompletionOptions,
        "program:run_completion",
        'Print a completion script for a shell. bash: eval "$(mograft completion bash)" in '
        "~/.bashrc; zsh: save it as _mograft in a folder of $fpath; fish: save it as "
        "~/.config/fish/completions/mograft.fish. This command needs mograft[completion].",
    ),
)
"""All commands, in the order of ``mograft --help``."""
