"""All commands, and the options of those that need few."""

from pathlib import Path
from typing import Annotated, Literal

from mograft._util.names import AUTOMATIC
from mograft.cli.syntax import datasets, options, values
from mograft.cli.syntax.arguments import Command, Options, option, positional, setting
from mograft.cli.syntax.converters import Value, choice

PLOT_KINDS = ("strip", "timeline", "energy", "pca", "dendrogram")
EVALUATION_TOPICS = ("quality", "world", "detectability", "balance")
_FIGURE_COLOURS = "joint groups that set the colours"


class DemoOptions(options.SeedOptions, options.WriterOptions, section="output"):
    """Create a sample dance, three grafts and a page that shows them."""

    output: values.Folder = option("folder (default: demo)", default=Path("demo"), short="-o")
    open: bool = option("open the page in the browser")


class InfoOptions(options.SkeletonOptions):
    """Print joints, frame rate, duration, joint groups and faults of motion files."""

    match: Literal["names", "anatomy"] | None = setting(
        "anatomy also lists the joints that correspond to those of the first file (default: names)"
    )


class CheckOptions(options.SkeletonOptions):
    """Check the syntax of motion files, and list faults of the recordings."""

    strict: bool = setting("treat every deviation from the BVH format as an error")
    contacts: bool = option("also measure how feet slide, and where hands are in the body")


class GroupsOptions(options.SkeletonOptions, options.WriterOptions):
    """Print the joint groups of a file as TOML, which can be edited and passed to --groups."""

    preset: values.Preset = setting(
        f"{', '.join(values.PRESETS)}, auto or auto:N (default: lower_upper)", default="lower_upper"
    )
    output: values.File | None = option("TOML file to write (default: stdout)", short="-o")


class IngestOptions(Options, section="input"):
    """Options for the files of a new library."""

    files: tuple[values.SourceOrFolder, ...] = positional("motion files, or folders of them", "+")
    rate: values.Rate | None = setting("frame rate of the library (default: that of most frames)")
    true_rate: tuple[values.TrueRate, ...] = option(
        "true rate of clips whose files have a wrong one; CLIP may be a glob; may be repeated",
        is_expert=True,
    )
    tags: values.Table | None = option(
        "table (.csv, .parquet) of clips and their tags; folders are tags, too",
        details="the clip is a name, a file, the end of its path, or a glob; columns whose heading "
        "has text, desc or caption are descriptions for find --text",
    )
    tag_columns: values.Columns | None = option(
        "columns of the table of tags that are used (default: all columns of texts)"
    )
    strict: bool = setting("fail if a file cannot be used, instead of excluding it")


class IndexOptions(IngestOptions, options.LibraryOptions, options.WriterOptions, section="output"):
    """Create a library from motion files, or add files to a library."""

    output: values.LibraryFolder = option("folder of the library", short="-o", is_required=True)
    add: bool = option("add to an existing library; only new and changed files are read")
    force: bool = option("replace an existing library")
    jobs: values.Count = setting("processes that read files (default: 1)", default=1, short="-j")


class StoredOptions(options.ResultOptions):
    """Options of the subcommands of ``mograft lib``."""

    library: values.LibraryFolder = positional("folder of a library")


class VerifyOptions(StoredOptions):
    """Compare each file of a library with its checksum."""


class LibInfoOptions(StoredOptions):
    """Print the contents and the configuration of a library."""

    clips: bool = option("also list the clips")
    duplicates: bool = option("also list the spans that occur twice, in other clips or the same")


class TablesOptions(StoredOptions, options.WriterOptions, section="output"):
    """Write a library as tables, for programs such as DuckDB, Spark or pandas."""

    format: Literal["parquet", "csv"] = option("parquet needs mograft[parquet]", is_required=True)
    output: values.OutputPath = option("folder for the tables", short="-o", is_required=True)


class StreamOptions(options.LibraryOptions):
    """Serve grafts of a motion that arrives frame by frame, as mograft.Stream makes them.

    Game engines and other programs connect with the protocol mograft.stream/1. The command prints
    one line with the address, and runs until it is interrupted.
    """

    port: values.Port | None = option("TCP port; 0 selects a free port")
    host: Annotated[str, Value("ADDRESS")] = setting(
        "address at which the TCP port is open (default: 127.0.0.1, only this computer)",
        default="127.0.0.1",
    )
    timeout: values.Duration = setting(
        "pause between two messages, in seconds, after which a connection is closed (default: 600)",
        default=600.0,
    )
    vmc_in: values.Listener | None = option(
        "port at which a VMC sender gives the base (default host: 127.0.0.1, only this computer)"
    )
    vmc: values.Receiver | None = option("VMC receiver of the new motion (default port: 39539)")
    delay: values.Delay = setting(
        "seconds that a part of --vmc-in waits for later ones; with 0 the fewest (default: 1.2)",
        default=1.2,
    )
    status: bool = option("print frames, delay, newness and dropped packets of --vmc each second")


class PlayOptions(options.SkeletonOptions):
    """Send a motion to VSeeFace, Unity, Unreal, Blender or Godot while it plays, over VMC.

    Space pauses in a terminal; Ctrl-C ends it.
    """

    files: tuple[values.Source, ...] = positional("motion file, or a clip of one", "+")
    vmc: values.Receiver = option("address of the receiver (default port: 39539)", is_required=True)
    loop: bool = option("repeat the motion until Ctrl-C")
    speed: values.Speed = option("factor of the speed (default: 1)", default=1.0)


class StudioOptions(options.ResultOptions):
    """Make and change grafts in the browser.

    The command prints the address of the page, which only this computer can open, and runs until
    it is interrupted. The page saves each step in the project of the folder.
    """

    files: tuple[values.LibraryOrFile, ...] = positional(
        "motion files, folders of them, a library, a graft or a project", "*"
    )
    output: values.Folder | None = option(
        "folder of the project, dropped files and exports (default: that of the project; studio)",
        short="-o",
    )
    port: values.Port = setting("TCP port; 0 selects a free port (default: 0)", default=0)
    open: bool = option("open the page in the browser")


class ViewOptions(options.FieldOptions, options.SkeletonOptions, options.WriterOptions):
    """Show motions side by side in the browser."""

    files: tuple[values.LibraryOrFile, ...] = positional("motion files, or one library", "+")
    clip: tuple[values.Name, ...] = option("clips of a library, or globs; may be repeated")
    groups: values.Groups | None = options.groups_option(_FIGURE_COLOURS, "trunk, arms and legs")
    character: values.File | None = option(
        "glTF file whose mesh the figures show (default: the file of the motion, if it is glTF)"
    )
    output: values.File | None = option(
        "HTML file (default: a temporary one, opened in the browser)", short="-o"
    )
    open: bool = option("open the page in the browser, even if -o is given")


class PlotOptions(options.LibraryOptions, options.WriterOptions):
    """Draw motions, or the clusters of their segments."""

    kind: Annotated[str, choice(*PLOT_KINDS, placeholder="KIND")] = positional(
        "strip (poses of one motion), timeline (segments along time), energy (kinetic energy), pca "
        "(segments in principal components) or dendrogram (linkage tree)"
    )
    clip: tuple[values.Name, ...] = option(
        "clips of a library for strip, energy, timeline, or globs (default: all); may be repeated"
    )
    output: values.File = option(".png, .svg or .pdf file to write", short="-o", is_required=True)
    groups: values.Groups | None = options.groups_option(
        default="lower_upper; for strip trunk, arms and legs"
    )
    group: values.Name | None = option("group for pca or dendrogram (default: the base)")
    poses: values.Count = setting("number of poses of strip (default: 12)", default=12)
    frames: values.Frames | None = option(
        "frames, or times as 3s-4s, for strip, timeline or energy (default: all)"
    )
    dark: bool = setting("draw in light colours on a dark background")


class ExportOptions(options.DigitsOptions, options.SkeletonOptions, options.WriterOptions):
    """Write motions in other file formats, as loops, or on a bent path.

    The suffix of the file selects the format: an animated figure (.glb; .usd, .usda or .usdc, which
    need mograft[usd]), a film (.mp4 or .gif, which need mograft[video]), or tables of channel
    values (.npz, .csv, .bvh).
    """

    files: tuple[values.Source, ...] = positional(
        "motion file, folder or FILE#CLIP; several for a film, a .glb of one skeleton or --format",
        "+",
    )
    output: values.File = option(
        "file to write; with --format a folder", short="-o", is_required=True
    )
    format: Literal["bvh", "npz", "csv", "glb", "usd", "usda", "usdc", "mp4", "gif"] | None = (
        option("write a file of this format for each motion, named after it, into -o")
    )
    frames: values.Frames | None = option("frames, or times as 3s-4s, to write (default: all)")
    cycle: values.Cycle | None = option(
        "only one cycle, such as two steps of a walk, closed into a loop: of about S seconds "
        "(default: the shortest)",
        implied=AUTOMATIC,
    )
    turn: values.Turn | None = option(
        "bend the path of a walk into an arc that ends by DEGREES further left (below 0: right)"
    )
    avoid: tuple[values.Avoid, ...] = option(
        "bend the path of a walk round an obstacle, such as capsule:X,Y,Z,X,Y,Z,RADIUS; shapes as "
        "for mograft graft; may be repeated"
    )
    rate: values.Rate | None = setting(
        "frame rate of the output (default: that of the input; .mp4 at most 60, .gif at most 20)"
    )
    scale: values.Unit | None = setting(
        f"unit of length of the motion file, for .glb and .usd: {', '.join(values.UNITS)}, or a "
        "number of metres (default: the unit that gives the figure human height)"
    )
    like: values.Source | None = option(
        "AMASS file whose unchanged arrays an .npz takes (default: write the arrays of mograft)",
        is_expert=True,
    )
    tracker: values.Tracker | None = option(
        "write an .npz of a robot for this tracker, mjlab or beyondmimic", is_expert=True
    )
    groups: values.Groups | None = options.groups_option(
        f"{_FIGURE_COLOURS} of a figure or film", "trunk, arms and legs"
    )
    size: values.Size = setting("size of a film in pixels (default: 720x480)", default="720x480")
    dark: bool = setting("draw a film in light colours on a dark background", is_expert=True)
    renderer: Literal["capsules", "browser"] | None = setting(
        "what draws a film: capsules, or the browser, with the mesh of the character (needs "
        "mograft[browser]; default: capsules)",
        is_expert=True,
    )
    character: values.File | None = option(
        "glTF file whose mesh a film shows, with --renderer browser (default: the file of the "
        "motion, if it is glTF)",
        is_expert=True,
    )


class EvaluateOptions(options.SeedOptions, options.LibraryOptions, options.WriterOptions):
    """Measure the quality, novelty, variety, detectability and balance of grafts.

    Grafts of some of the clips are made and measured. The words quality, world, detectability and
    balance among FILE, if they are not files, select what to measure (default: all).
    """

    files: tuple[values.LibraryOrFile, ...] = positional(
        "motion files, or one library; words such as balance select what to measure", "+"
    )
    output: values.Folder | None = option("folder for evaluation.json and index.html", short="-o")
    rate: values.Rate | None = setting("frame rate of all files (default: that of most frames)")
    runs: values.Count = setting("number of motions created from each base (default: 6)", default=6)
    bases: values.Bases = setting("maximum number of base clips (default: 4)", default=4)


class DoctorOptions(options.ResultOptions):
    """Check the installation, and list missing optional packages."""


class ShowOptions(options.ResultOptions):
    """Print all settings in the format of mograft.toml.

    mograft reads this file from the working folder or the nearest folder above it. Environment
    variables such as MOGRAFT_SEED or MOGRAFT_GRAFT_SEED override the file, and the command line
    overrides both.
    """

    only: Annotated[str, Value("COMMAND")] | None = positional(
        "command whose settings are printed (default: all)", "?"
    )
    origin: bool = option("also print the file or variable that sets each value")


class CompletionOptions(Options):
    """Print a script for shell completion of commands, options and files.

    bash: eval "$(mograft completion bash)" in ~/.bashrc; zsh: save it as _mograft in a folder of
    $fpath; fish: save it as ~/.config/fish/completions/mograft.fish. This command needs
    mograft[completion].
    """

    shell: Literal["bash", "zsh", "fish", "tcsh", "powershell"] = positional(
        "shell for which the script is written"
    )


_LIBRARY_ACTIONS = (
    Command("info", LibInfoOptions, "library:run_info"),
    Command("verify", VerifyOptions, "library:run_verify"),
    Command("export", TablesOptions, "library:run_export"),
)
COMMANDS = (
    Command("demo", DemoOptions, "graft:run_demo"),
    Command("info", InfoOptions, "motions:run_info"),
    Command("check", CheckOptions, "motions:run_check"),
    Command("groups", GroupsOptions, "motions:run_groups"),
    Command("index", IndexOptions, "library:run_index"),
    Command("lib", summary="describe, verify or export a library", actions=_LIBRARY_ACTIONS),
    Command("candidates", options.CandidatesOptions, "candidates:run"),
    Command("graft", options.GraftOptions, "graft:run"),
    Command("augment", datasets.AugmentOptions, "datasets:run_augment"),
    Command("find", datasets.FindOptions, "datasets:run_find"),
    Command("curate", datasets.CurateOptions, "datasets:run_curate"),
    Command("stream", StreamOptions, "live:run_stream"),
    Command("play", PlayOptions, "live:run_play"),
    Command("studio", StudioOptions, "studio:run_studio"),
    Command("view", ViewOptions, "pictures:run_view"),
    Command("plot", PlotOptions, "pictures:run_plot"),
    Command("export", ExportOptions, "pictures:run_export"),
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
