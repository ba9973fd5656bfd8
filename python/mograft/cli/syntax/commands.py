"""All commands, and the options of those that need few."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from mograft.cli.syntax import values
from mograft.cli.syntax.arguments import (
    Command,
    Options,
    option,
    positional,
    repeated,
    setting,
    switch,
)
from mograft.cli.syntax.frames import Range
from mograft.cli.syntax.options import (
    PRESETS,
    CandidatesOptions,
    DigitsOptions,
    FieldOptions,
    GraftOptions,
    LibraryOptions,
    ResultOptions,
    SeedOptions,
    SkeletonOptions,
    WriterOptions,
    groups_option,
    output_option,
)

PLOT_KINDS = ("strip", "timeline", "energy", "pca", "dendrogram", "clusters", "groups")
EVALUATION_TOPICS = ("quality", "world", "detectability", "balance")
_FIGURE_COLOURS = "joint groups that set the colours"
_SHELLS = ("bash", "zsh", "fish", "tcsh", "powershell")


@dataclass(frozen=True, kw_only=True)
class DemoOptions(SeedOptions, WriterOptions, section="output"):
    """Create a sample dance, three grafts and a page that shows them."""

    output: Path = output_option("folder for the files (default: demo)", values.DIR, Path("demo"))
    open: bool = switch("open the page in the browser")


@dataclass(frozen=True, kw_only=True)
class InfoOptions(SkeletonOptions):
    """Print joints, frame rate, duration, joint groups and faults of motion files."""

    match: str | None = setting(
        "anatomy also lists which joints of each file correspond to those of the first file "
        "(default: names)",
        values.choice("names", "anatomy"),
    )


@dataclass(frozen=True, kw_only=True)
class CheckOptions(SkeletonOptions):
    """Check the syntax of motion files, and list faults of the recordings."""

    strict: bool = switch("treat every deviation from the BVH format as an error", is_setting=True)


@dataclass(frozen=True, kw_only=True)
class GroupsOptions(SkeletonOptions, WriterOptions):
    """Print the joint groups of a file as TOML, which can be edited and passed to --groups."""

    preset: str = setting(
        f"one of {', '.join(PRESETS)}, for the first file; or auto or auto:N, groups of joints "
        "that move together in all files (default: lower_upper)",
        values.Value("NAME", values.preset_or_automatic(PRESETS)),
        "lower_upper",
    )
    output: Path | None = output_option("TOML file to write (default: stdout)", values.FILE)


@dataclass(frozen=True, kw_only=True)
class IndexFileOptions(Options, section="input"):
    """Options for the files of a new library."""

    files: tuple[str, ...] = positional(
        "motion files, or folders of them", values.Value("FILE|DIR", is_path=True), "+"
    )
    rate: float | None = setting(
        "frame rate of the library (default: the rate that most frames of the files have)",
        values.RATE,
    )
    true_rate: tuple[tuple[str, float], ...] = repeated(
        "true frame rate of a clip whose file contains a wrong one; CLIP may be a glob; may be "
        "repeated",
        values.Value("CLIP=FPS", values.true_rate),
        is_expert=True,
    )
    tags: Path | None = option(
        "table of clips and their tags; the folders of a clip also become its tags",
        values.Value("CSV", Path, is_path=True),
    )
    strict: bool = switch("fail if a file cannot be used, instead of excluding it", is_setting=True)


@dataclass(frozen=True, kw_only=True)
class IndexOptions(IndexFileOptions, LibraryOptions, WriterOptions, section="output"):
    """Create a library from motion files, or add files to a library."""

    output: Path = output_option(
        "folder of the library", values.Value("LIB", Path, is_path=True), is_required=True
    )
    add: bool = switch("add to an existing library; only new and changed files are read")
    force: bool = switch("replace an existing library")
    jobs: int = setting(
        "number of processes that read files (default: 1)", values.COUNT, 1, short="-j"
    )


@dataclass(frozen=True, kw_only=True)
class StoredOptions(ResultOptions):
    """Options of the subcommands of ``mograft lib``."""

    library: Path = positional("folder of a library", values.Value("LIB", Path, is_path=True))


@dataclass(frozen=True, kw_only=True)
class VerifyOptions(StoredOptions):
    """Compare each file of a library with its checksum."""


@dataclass(frozen=True, kw_only=True)
class LibInfoOptions(StoredOptions):
    """Print the contents and the configuration of a library."""

    clips: bool = switch("also list the clips")


@dataclass(frozen=True, kw_only=True)
class TablesOptions(StoredOptions, WriterOptions, section="output"):
    """Write a library as tables, for programs such as DuckDB, Spark or pandas."""

    format: Literal["parquet", "csv", "npz"] = option(
        "parquet needs mograft[parquet]", values.choice("parquet", "csv", "npz"), is_required=True
    )
    output: Path = output_option(
        "folder for the tables; for npz the file to write", values.PATH, is_required=True
    )


@dataclass(frozen=True, kw_only=True)
class StreamOptions(LibraryOptions):
    """Serve grafts of a motion that arrives frame by frame, as mograft.Stream makes them.

    Game engines and other programs connect with the protocol mograft.stream/1. The command prints
    one line with the address, and runs until it is interrupted.
    """

    port: int | None = option(
        "TCP port from 0 to 65535; 0 selects a free port; or give --socket",
        values.Value("N", values.port),
    )
    socket: Path | None = option("path of a Unix socket to create", values.PATH)
    host: str = setting(
        "address at which the TCP port is open (default: 127.0.0.1, only this computer)",
        values.Value("ADDRESS"),
        "127.0.0.1",
    )
    timeout: float = setting(
        "pause between two messages, in seconds, after which a connection is closed (default: 600)",
        values.SECONDS,
        600.0,
    )


@dataclass(frozen=True, kw_only=True)
class ViewOptions(FieldOptions, SkeletonOptions, WriterOptions):
    """Show motions side by side in the browser."""

    files: tuple[str, ...] = positional(
        "motion files, or one library", values.LIBRARY_OR_FILES, "+"
    )
    clip: tuple[str, ...] = repeated(
        "clips of a library to show; NAME may be a glob such as walk*; may be repeated", values.NAME
    )
    groups: str | None = groups_option(_FIGURE_COLOURS, "trunk, arms and legs")
    output: Path | None = output_option(
        "HTML file to write (default: a temporary file, opened in the browser)", values.FILE
    )
    open: bool = switch("open the page in the browser, even if -o is given")


@dataclass(frozen=True, kw_only=True)
class PlotOptions(LibraryOptions, WriterOptions):
    """Draw motions, or the clusters of their segments."""

    kind: str = positional(
        "strip (poses of one motion), timeline (segments along time), energy (kinetic energy), pca "
        "(segments in principal components), dendrogram (linkage tree), clusters (cluster sizes) "
        "or groups (which joints move together)",
        values.choice(*PLOT_KINDS, placeholder="KIND"),
    )
    clip: tuple[str, ...] = repeated(
        "clips of a library for strip, energy or timeline; NAME may be a glob; may be repeated",
        values.NAME,
    )
    output: Path = output_option(".png, .svg or .pdf file to write", values.FILE, is_required=True)
    groups: str | None = groups_option(
        default="lower_upper; for strip trunk, arms and legs; for groups auto"
    )
    group: str | None = option(
        "joint group for pca, dendrogram or clusters (default: the base group)", values.NAME
    )
    poses: int = setting("number of poses of strip (default: 12)", values.COUNT, 12)
    frames: Range | None = option(
        "frames, or times such as 3.3s-13.3s, for strip, timeline or energy (default: all)",
        values.FRAMES,
    )
    dark: bool = switch("draw in light colours on a dark background", is_setting=True)


@dataclass(frozen=True, kw_only=True)
class ExportOptions(DigitsOptions, SkeletonOptions, WriterOptions):
    """Write motions in other file formats.

    The suffix of the file selects the format: an animated figure (.glb; .usd, .usda or .usdc, which
    need mograft[usd]), a film (.mp4 or .gif, which need mograft[video]), or tables of channel
    values (.npz, .csv, .bvh).
    """

    files: tuple[str, ...] = positional(
        "motion file; several for a film, and for a .glb if they have the same skeleton",
        values.FILES,
        "+",
    )
    output: Path = output_option("file to write", values.FILE, is_required=True)
    frames: Range | None = option(
        "frames, or times such as 3.3s-13.3s, to write (default: all)", values.FRAMES
    )
    rate: float | None = setting(
        "frame rate of the output (default: the rate of the input; for an .mp4 at most 60, for a "
        ".gif at most 20)",
        values.RATE,
    )
    scale: float | str | None = setting(
        f"unit of length of the motion file, for .glb and .usd: {', '.join(values.UNITS)}, or a "
        "number of metres (default: the unit that gives the figure human height)",
        values.Value("UNIT|X", values.unit),
    )
    like: str | None = option(
        "AMASS file from which a .npz takes all arrays that the motion did not change (default: "
        "write the arrays of mograft)",
        values.SOURCE,
    )
    groups: str | None = groups_option(
        f"{_FIGURE_COLOURS} of a figure or film", "trunk, arms and legs"
    )
    size: tuple[int, int] = setting(
        "size of a film in pixels (default: 720x480)",
        values.Value("WIDTHxHEIGHT", values.picture_size),
        "720x480",
    )
    dark: bool = switch("draw a film in light colours on a dark background", is_setting=True)


@dataclass(frozen=True, kw_only=True)
class EvaluateOptions(SeedOptions, LibraryOptions, WriterOptions):
    """Measure the quality, novelty, variety, detectability and balance of grafts.

    Grafts of some of the clips are made and measured. The words quality, world, detectability and
    balance among FILE, if they are not files, select what to measure (default: all).
    """

    files: tuple[str, ...] = positional(
        "motion files, or one library; additional words such as balance select what to measure",
        values.LIBRARY_OR_FILES,
        "+",
    )
    output: Path | None = output_option(
        "folder for evaluation.json and index.html (default: no files)", values.DIR
    )
    rate: float | None = setting(
        "frame rate to which all files are resampled (default: the rate of most frames)",
        values.RATE,
    )
    runs: int = setting("number of motions created from each base (default: 6)", values.COUNT, 6)
    bases: int = setting(
        "maximum number of clips that are used as base (default: 4)", values.COUNT, 4
    )


@dataclass(frozen=True, kw_only=True)
class DoctorOptions(ResultOptions):
    """Check the installation, and list missing optional packages."""


@dataclass(frozen=True, kw_only=True)
class ShowOptions(ResultOptions):
    """Print all settings in the format of mograft.toml.

    mograft reads this file from the working folder or the nearest folder above it. Environment
    variables such as MOGRAFT_SEED or MOGRAFT_GRAFT_SEED override the file, and the command line
    overrides both.
    """

    only: str | None = positional(
        "command whose settings are printed (default: all)", values.Value("COMMAND"), "?"
    )
    origin: bool = switch("also print the file or variable that sets each value")


@dataclass(frozen=True, kw_only=True)
class CompletionOptions(Options):
    """Print a script for shell completion of commands, options and files.

    bash: eval "$(mograft completion bash)" in ~/.bashrc; zsh: save it as _mograft in a folder of
    $fpath; fish: save it as ~/.config/fish/completions/mograft.fish. This command needs
    mograft[completion].
    """

    shell: str = positional("shell for which the script is written", values.choice(*_SHELLS))


COMMANDS = (
    Command("demo", DemoOptions, "demo:run"),
    Command("info", InfoOptions, "motions:run_info"),
    Command("check", CheckOptions, "motions:run_check"),
    Command("groups", GroupsOptions, "motions:run_groups"),
    Command("index", IndexOptions, "library:run_index"),
    Command(
        "lib",
        summary="describe, verify or export a library",
        actions=(
            Command("info", LibInfoOptions, "library:run_info"),
            Command("verify", VerifyOptions, "library:run_verify"),
            Command("export", TablesOptions, "library:run_export"),
        ),
    ),
    Command("candidates", CandidatesOptions, "candidates:run"),
    Command("graft", GraftOptions, "graft:run"),
    Command("stream", StreamOptions, "stream:run"),
    Command("view", ViewOptions, "pictures:run_view"),
    Command("plot", PlotOptions, "pictures:run_plot"),
    Command("export", ExportOptions, "export:run"),
    Command("evaluate", EvaluateOptions, "evaluate:run"),
    Command("doctor", DoctorOptions, "program:run_doctor"),
    Command(
        "config",
        summary="print the settings of the configuration file and the environment",
        actions=(Command("show", ShowOptions, "program:run_config"),),
    ),
    Command("completion", CompletionOptions, "program:run_completion"),
)
"""All commands, in the order of ``mograft --help``."""
