"""The declarations of all commands."""

from pathlib import Path

from mograft.cli.arguments import (
    Argument,
    command,
    exclusive,
    option,
    positional,
    repeated_option,
    setting,
    setting_switch,
    switch,
)
from mograft.cli.options import (
    BVH_FILES,
    FIGURE_COLOURS,
    FILES_OR_LIBRARY,
    FORCE,
    GROUPS,
    INCLUDE_GRAFTS,
    JSON,
    NEIGHBOURHOOD,
    PRESET,
    PRESETS,
    SCENARIO_OPTIONS,
    SEED,
    SIGMA_SCALE,
    VARIETY,
    config_option,
    constraint_options,
    files_argument,
    groups_option,
    output_option,
)
from mograft.cli.values import (
    UNITS,
    frame_range,
    non_negative_integer,
    picture_size,
    positive_integer,
    positive_number,
    unit,
)

PLOT_KINDS = ("strip", "timeline", "energy", "pca", "dendrogram", "clusters")
EVALUATION_TOPICS = (
    "enrichment",
    "balance",
    "naturalness",
    "quality",
    "world",
    "detectability",
)
LABEL = "label"
"""Word after ``mograft evaluate`` that writes the page for labelling."""


def _table_format(name: str, description: str) -> Argument:
    keywords = {"dest": "kind", "action": "store_const", "const": name, "help": description}
    return Argument(flags=(f"--{name}",), keywords=keywords)


_LIBRARY = positional("library", "folder of a library", is_path=True, type=Path, metavar="LIB")
_LIB = command(
    "lib",
    "describe, verify or export a library",
    actions=(
        command(
            "info",
            "print the contents and the configuration",
            _LIBRARY,
            setting_switch("--clips", "also list the clips"),
            JSON,
        ),
        command(
            "verify",
            "compare each file of the library with its checksum",
            _LIBRARY,
            setting_switch("--sources", "also compare the source files with their checksums"),
            JSON,
        ),
        command(
            "export",
            "write the tables for DuckDB, Spark or pandas",
            _LIBRARY,
            exclusive(
                _table_format("parquet", "Parquet files, with the extra parquet"),
                _table_format("csv", "CSV files"),
                _table_format("npz", "one NumPy archive"),
            ),
            output_option("folder for the tables; with --npz a file", required=True),
            FORCE,
            JSON,
        ),
    ),
)
_CANDIDATES = command(
    "candidates",
    "list the donors of a segment, and why other segments are refused",
    FILES_OR_LIBRARY,
    INCLUDE_GRAFTS,
    option("--clip NAME", "clip of the segment (default: the first)"),
    exclusive(
        option("--segment N", "number of the segment in the clip, from 0", non_negative_integer),
        option(
            "--frame N", "frame of the clip that the segment contains, from 0", non_negative_integer
        ),
    ),
    GROUPS,
    option("--group GROUP", "group to exchange (default: the first except the base group)"),
    NEIGHBOURHOOD,
    switch("--json", "print all candidates as one JSON document"),
    constraint_options(),
)
_GRAFT = command(
    "graft",
    "create motions on the base group of a captured one",
    files_argument("one library, or BVH files", "LIB|FILE"),
    INCLUDE_GRAFTS,
    option(
        "--base CLIP|FILE",
        "motion that provides the base group (default: the first clip)",
        is_path=True,
    ),
    GROUPS,
    setting("--swap GROUP,...", "groups to exchange (default: all except the base group)"),
    option("-n --count", "number of motions (default: 1)", positive_integer, 1),
    output_option("folder for the motions, or for one motion a .bvh file", required=True),
    PRESET,
    setting_switch("--mirror", "use the mirror images of all clips as additional donors"),
    VARIETY,
    setting(
        "--sigma-scale X",
        "cluster diameter threshold, as a multiple of sigma; a larger value gives more "
        "variety, a smaller one more similarity (default: that of the configuration, usually "
        "0.75; if fewer than COUNT different motions exist, it is multiplied by 4/3 "
        "repeatedly, up to 4)",
        positive_number,
    ),
    NEIGHBOURHOOD,
    config_option("choice", "selection of donors", "sample, with --preset paper random"),
    setting(
        "--temperature X",
        "cost difference that makes a draw of --choice sample less likely by the factor e "
        "(default: 1)",
        positive_number,
    ),
    *SCENARIO_OPTIONS,
    config_option("seam", "seam treatment", "gradient, with --preset paper paper"),
    config_option("alignment", "time alignment of donors", "uniform"),
    config_option(
        "torso", "orientation that an exchanged trunk keeps", "world, with --preset paper pelvis"
    ),
    config_option("feet", "foot planting", "auto, with --preset paper never"),
    setting_switch("--report", "also write an HTML page that describes the motions"),
    setting_switch(
        "--measure",
        "also measure jerk, feet and balance of each motion, for its .json file and the page; "
        "needs the extra evaluate",
    ),
    switch("--json", "print the provenance as one JSON document"),
    SEED,
    FORCE,
    constraint_options(
        switch("--repair", "exchange only the segments that violate the constraints"),
        setting_switch(
            "--best-effort",
            "write the motions with the smallest violation and return exit code 0 even if no "
            "donor sequence satisfies the constraints",
        ),
    ),
    description="Create motions that keep the base group of a captured motion, by default legs and "
    "root, and exchange the other joint groups for those of similar segments.",
)
_PLOT = command(
    "plot",
    "draw motions, or the clusters of their segments",
    positional(
        "kind",
        "poses of one motion, segments along time, kinetic energy, principal components, "
        "linkage tree, or cluster sizes",
        choices=PLOT_KINDS,
    ),
    FILES_OR_LIBRARY,
    repeated_option(
        "--clip NAME",
        "clips of a library for strip, energy or timeline, globs such as walk* (default: all); "
        "may be repeated",
    ),
    output_option(".png, .svg or .pdf file to write", required=True),
    groups_option(default="lower_upper; for strip trunk, arms and legs"),
    INCLUDE_GRAFTS,
    option("--group NAME", "joint group of pca, dendrogram or clusters (default: the base group)"),
    setting("--poses", "number of poses of strip (default: 12)", positive_integer, 12),
    option(
        "--frames FIRST-LAST", "frames of strip, timeline or energy (default: all)", frame_range
    ),
    setting_switch("--dark", "draw in light colours on a dark background"),
    setting("--dpi", "resolution of a .png in dots per inch (default: 150)", positive_integer, 150),
    JSON,
    FORCE,
)
_EXPORT = command(
    "export",
    "write motions for other programs",
    files_argument("BVH file; for a .glb also several of one skeleton, for a film also several"),
    output_option("file to write", required=True, metavar="FILE"),
    option("--frames FIRST-LAST", "frames to write (default: all)", frame_range),
    setting(
        "--rate FPS",
        "frame rate to resample to, in frames per second (default: that of the file, of a film "
        "at most 60, of a GIF 20)",
        positive_number,
    ),
    setting(
        "--scale UNIT|X",
        f"unit of the BVH file, for a figure: {', '.join(UNITS)}, or a number of metres "
        "(default: the unit that gives the figure human height)",
        unit,
    ),
    groups_option(f"{FIGURE_COLOURS} of a figure or film", "trunk, arms and legs"),
    setting(
        "--size WIDTHxHEIGHT",
        "size of a film in pixels (default: 720x480)",
        picture_size,
        "720x480",
    ),
    setting_switch("--dark", "draw a film in light colours on a dark background"),
    JSON,
    FORCE,
    description="Write motions in the format that the ending of the output file selects: an "
    "animated figure (.glb; .usd, .usda or .usdc with the extra usd), a film (.mp4 or .gif, with "
    "the extra video), or channel values (.npz, .csv, .bvh).",
)
_EVALUATE = command(
    "evaluate",
    "measure enrichment, balance, naturalness, quality and detectability of grafts",
    files_argument("one library, or BVH files; and words that select what to measure", "LIB|FILE"),
    INCLUDE_GRAFTS,
    output_option(
        f"folder for evaluation.json and index.html; with {LABEL} the .html file to write "
        "(default: no files)",
        metavar="DIR",
    ),
    GROUPS,
    PRESET,
    SIGMA_SCALE,
    setting(
        "--rate FPS",
        "frame rate to which all files are resampled, in frames per second (default: that of "
        "the files)",
        positive_number,
    ),
    setting(
        "--runs", "number of motions for each base and method (default: 10)", positive_integer, 10
    ),
    setting("--bases", "number of clips that serve as base (default: 4)", positive_integer, 4),
    setting(
        "--labels CSV",
        f"labels that a person gave on the page that {LABEL} writes (default: none)",
        Path,
    ),
    option(
        "-n --count",
        f"with {LABEL}, number of pieces on the page (default: 500, as in the paper)",
        positive_integer,
        500,
    ),
    JSON,
    SEED,
    FORCE,
    description="Measure grafts, and for comparison grafts with random donors and with donors that "
    "other methods select. Words among FILE that are not files select what to measure: "
    f"{', '.join(EVALUATION_TOPICS)} (default: all). The word {LABEL} writes a page instead, on "
    "which a person labels pieces as natural or not.",
)

COMMANDS = (
    command(
        "demo",
        "run all stages on the built-in dancer",
        output_option("folder for the files (default: demo)", default=Path("demo")),
        switch("--open", "open the page in the browser"),
        JSON,
        SEED,
        FORCE,
    ),
    command(
        "info",
        "print joints, frame rate, duration, joint groups and faults of files",
        BVH_FILES,
        JSON,
    ),
    command(
        "check",
        "check the syntax of BVH files, and list faults of the recordings",
        BVH_FILES,
        setting_switch(
            "--strict", "refuse deviations from the format that are tolerated otherwise"
        ),
        JSON,
    ),
    command(
        "groups",
        "print the joint groups of a file as TOML, to edit and to pass to --groups",
        positional("file", "BVH file", is_path=True, metavar="FILE"),
        setting(
            "--preset",
            "preset of joint groups (default: lower_upper)",
            choices=PRESETS,
            default="lower_upper",
        ),
        output_option("TOML file to write (default: stdout)"),
        FORCE,
        JSON,
    ),
    command(
        "index",
        "create a library of many files, or add files to one",
        files_argument("BVH files, or folders of them", "FILE|DIR"),
        INCLUDE_GRAFTS,
        output_option("folder of the library", required=True, metavar="LIB"),
        switch("--add", "add to an existing library; only new and changed files are read"),
        setting("-j --jobs N", "number of processes (default: 1)", positive_integer, 1),
        GROUPS,
        PRESET,
        SIGMA_SCALE,
        setting(
            "--rate FPS",
            "frame rate of the library in frames per second (default: the rate of most frames)",
            positive_number,
        ),
        repeated_option(
            "--true-rate CLIP=FPS",
            "frame rate of clips whose files state a wrong one; CLIP may be a glob; may be "
            "repeated",
        ),
        option(
            "--tags CSV",
            "table of clips and their tags; names of folders are tags as well",
            Path,
            is_path=True,
        ),
        setting_switch("--strict", "fail if a file cannot be used, instead of excluding it"),
        switch("--force", "replace an existing library"),
        JSON,
    ),
    _LIB,
    _CANDIDATES,
    _GRAFT,
    command(
        "view",
        "show motions side by side in the browser",
        FILES_OR_LIBRARY,
        repeated_option(
            "--clip NAME", "clips of a library, globs such as walk* (default: all); may be repeated"
        ),
        groups_option(FIGURE_COLOURS, "trunk, arms and legs"),
        option("--title", "title of the page (default: the names of the motions)"),
        output_option("HTML file to write (default: a temporary file, opened in the browser)"),
        switch("--open", "open the written page in the browser"),
        JSON,
        FORCE,
    ),
    _PLOT,
    _EXPORT,
    _EVALUATE,
    command("doctor", "check the installation, and list absent extras", JSON),
    command(
        "config",
        "print the settings of the configuration file and the environment",
        has_settings=False,
        actions=(
            command(
                "show",
                "print all settings as a mograft.toml",
                positional(
                    "only",
                    "command whose settings are printed (default: all)",
                    nargs="?",
                    metavar="COMMAND",
                ),
                setting_switch("--origin", "also print the source of each value"),
                JSON,
                description="Print the settings of the commands as a mograft.toml with the same "
                "values. Settings come from mograft.toml in the working folder or the nearest "
                "folder above it; a table such as [graft] applies to one command, keys before all "
                "tables to every command. Environment variables override the file: MOGRAFT_SEED, "
                "for example, applies to every command and MOGRAFT_GRAFT_SEED, which overrides it, "
                "to graft. The command line overrides both.",
            ),
        ),
    ),
    command(
        "completion",
        "print a script for shell completion of commands, options and files",
        positional(
            "shell",
            "shell for which the script is written",
            choices=("bash", "zsh", "fish", "tcsh", "powershell"),
        ),
        description='Print a completion script for a shell. bash: eval "$(mograft completion '
        'bash)" in ~/.bashrc; zsh: save it as _mograft in a folder of $fpath; fish: save it as '
        "~/.config/fish/completions/mograft.fish. Needs the extra completion.",
    ),
)
"""All commands, in the order of ``mograft --help``."""
