"""The declarations of all commands."""

from pathlib import Path

from mograft.cli.syntax.arguments import (
    Argument,
    command,
    exclusive,
    option,
    positional,
    repeated_option,
    setting,
    setting_flag,
    setting_switch,
    switch,
)
from mograft.cli.syntax.frame_times import frame
from mograft.cli.syntax.options import (
    DIGITS,
    FIGURE_COLOURS,
    FILES_OR_LIBRARY,
    FORCE,
    GROUPS,
    INCLUDE_GRAFTS,
    JSON,
    MATCH,
    MOTION_FILES,
    NEIGHBOURHOOD,
    PRESET,
    PRESETS,
    REPLAY_OPTIONS,
    SCENARIO_OPTIONS,
    SEED,
    SEGMENTATION,
    SIGMA_SCALE,
    SKELETON,
    VARIETY,
    config_option,
    constraint_options,
    files_argument,
    groups_option,
    output_option,
)
from mograft.cli.syntax.picture_commands import EXPORT, PLOT
from mograft.cli.syntax.stream_command import STREAM
from mograft.cli.syntax.values import (
    non_negative_integer,
    non_negative_number,
    positive_integer,
    positive_number,
    positive_number_or_auto,
    preset_or_automatic,
)

EVALUATION_TOPICS = ("quality", "world", "detectability", "balance")


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
            switch("--clips", "also list the clips"),
            JSON,
        ),
        command(
            "verify",
            "compare each file of the library with its checksum",
            _LIBRARY,
            switch(
                "--sources",
                "also compare the motion files of the library with their checksums",
            ),
            JSON,
        ),
        command(
            "export",
            "write the library as tables, for programs such as DuckDB, Spark or pandas",
            _LIBRARY,
            exclusive(
                _table_format("parquet", "write Parquet files (needs mograft[parquet])"),
                _table_format("csv", "write CSV files"),
                _table_format("npz", "write one NumPy archive"),
            ),
            output_option("folder for the tables; with --npz the file to write", required=True),
            FORCE,
            JSON,
        ),
    ),
)
_CANDIDATES = command(
    "candidates",
    "list the segments that may replace a segment, and why others are refused",
    FILES_OR_LIBRARY,
    INCLUDE_GRAFTS,
    MATCH,
    SKELETON,
    option("--clip NAME", "clip that contains the segment (default: the first clip)"),
    exclusive(
        option("--segment N", "index of the segment in the clip, from 0", non_negative_integer),
        option(
            "--frame N|S",
            "a frame of the segment, counted from 0 in the clip, or a time such as 10.5s",
            frame,
        ),
    ),
    GROUPS,
    SEGMENTATION,
    option(
        "--group GROUP",
        "joint group to exchange (default: the first group that is not the base group)",
    ),
    NEIGHBOURHOOD,
    switch("--json", "print all candidates as one JSON document"),
    constraint_options(),
)
_GRAFT = command(
    "graft",
    "create motions by exchanging joint groups of a captured motion",
    files_argument(
        "motion files, or one library (not required with --from)", "LIB|FILE", nargs="*"
    ),
    *REPLAY_OPTIONS,
    INCLUDE_GRAFTS,
    MATCH,
    SKELETON,
    option(
        "--base CLIP|FILE",
        "motion that provides the base group (default: the first clip)",
        is_path=True,
    ),
    GROUPS,
    SEGMENTATION,
    setting("--swap GROUP,...", "joint groups to exchange (default: all except the base group)"),
    option("-n --count", "number of motions (default: 1)", positive_integer, 1),
    output_option(
        "folder for the motions, or a file: a .bvh file for a single motion; an .npz file for a "
        "single motion, which is a copy of the base's AMASS file; a .glb file for one or more "
        "motions, which is a copy of the base's glTF file",
        required=True,
    ),
    DIGITS,
    PRESET,
    setting_switch("--mirror", "use the mirror images of all clips as additional donors"),
    VARIETY,
    setting(
        "--sigma-scale X|auto",
        "cluster diameter threshold, as a multiple of sigma, the spread of all segments; larger "
        "values give more variety, smaller values more similarity; auto chooses X for each joint "
        "group from how much repeated motions differ (default: the value of the configuration, "
        "usually 0.75). If neither this option nor --variety is given and the donors allow fewer "
        "than COUNT different motions, X is multiplied by 4/3 until they allow enough or X would "
        "exceed 4. --repair also multiplies X, even if this option is given, while violations "
        "remain that other donors could remove",
        positive_number_or_auto,
    ),
    NEIGHBOURHOOD,
    config_option("choice", "selection of donors", "sample", paper="random"),
    setting(
        "--temperature X",
        "temperature of --choice sample: a donor sequence that costs X more than another is drawn "
        "with a probability that is smaller by the factor e (default: 0.25)",
        positive_number,
    ),
    setting(
        "--diversity X",
        "with -n above 1: additional cost of a donor for each earlier motion that has this donor "
        "at the same position; a larger cost makes the motions differ more from each other, and "
        "the gaps at their seams wider (default: 1)",
        non_negative_number,
    ),
    *SCENARIO_OPTIONS,
    config_option("seam", "seam treatment", "gradient", paper="paper"),
    config_option("alignment", "time alignment of donors", "uniform"),
    config_option("torso", "orientation of an exchanged trunk", "balanced", paper="pelvis"),
    config_option("feet", "foot planting", "auto", paper="never"),
    setting(
        "--reach-ik X",
        "maximum distance over which inverse kinematics moves a hand or foot to the target of "
        "--reach, as a fraction of the length of the limb; 0 disables it (default: 0.25; with "
        "--preset paper: 0)",
        non_negative_number,
    ),
    setting_flag(
        "--self-repair",
        "whether to replace donors at frames at which the acceleration, jerk or depth below the "
        "floor of a new motion exceeds that of the recordings (default: on; with --preset paper: "
        "off)",
    ),
    setting_switch("--report", "also write an HTML page that describes the motions"),
    setting_switch(
        "--measure",
        "also measure jerk, foot contacts and balance of each motion, and add the values to its "
        ".json file and to the page of --report (needs mograft[evaluate])",
    ),
    switch("--json", "print the provenance of the motions as one JSON document"),
    SEED,
    FORCE,
    constraint_options(
        switch("--repair", "exchange only the segments that violate the constraints"),
        setting_switch(
            "--best-effort",
            "if no donor sequence satisfies the constraints, write the motions with the smallest "
            "violation and return exit code 0 instead of 4",
        ),
    ),
    description="Create motions from a captured motion. The base group, by default the legs and "
    "the root, keeps its motion. The other joint groups are taken from segments in which the base "
    "group moves similarly.",
)
_EVALUATE = command(
    "evaluate",
    "measure the quality, novelty, variety, detectability and balance of grafts",
    files_argument(
        "motion files, or one library; additional words such as balance select what to measure",
        "LIB|FILE",
    ),
    INCLUDE_GRAFTS,
    MATCH,
    SKELETON,
    output_option(
        "folder for evaluation.json and index.html (default: no files)",
        metavar="DIR",
    ),
    GROUPS,
    SEGMENTATION,
    PRESET,
    SIGMA_SCALE,
    setting(
        "--rate FPS",
        "frame rate to which all files are resampled, in frames per second (default: the rate "
        "that most frames of the files have)",
        positive_number,
    ),
    setting("--runs", "number of motions created from each base (default: 4)", positive_integer, 4),
    setting(
        "--bases", "maximum number of clips that are used as base (default: 4)", positive_integer, 4
    ),
    JSON,
    SEED,
    FORCE,
    description="Make grafts of some of the clips, and measure them. Words among FILE that are not "
    f"files select what to measure: {', '.join(EVALUATION_TOPICS)} (default: all).",
)

COMMANDS = (
    command(
        "demo",
        "create a sample dance, three grafts and a page that shows them",
        output_option("folder for the files (default: demo)", default=Path("demo")),
        switch("--open", "open the page in the browser"),
        JSON,
        SEED,
        FORCE,
    ),
    command(
        "info",
        "print joints, frame rate, duration, joint groups and faults of motion files",
        MOTION_FILES,
        setting(
            "--match",
            "anatomy also lists which joints of each file correspond to those of the first file "
            "(default: names)",
            choices=("names", "anatomy"),
        ),
        SKELETON,
        JSON,
    ),
    command(
        "check",
        "check the syntax of motion files, and list faults of the recordings",
        MOTION_FILES,
        setting_switch("--strict", "treat every deviation from the BVH format as an error"),
        SKELETON,
        JSON,
    ),
    command(
        "groups",
        "print the joint groups of a file as TOML, which can be edited and passed to --groups",
        positional(
            "file",
            "motion file or folder; --preset auto uses all files of a folder, other presets the "
            "first file",
            is_path=True,
            metavar="FILE",
        ),
        setting(
            "--preset NAME",
            f"preset of joint groups, one of {', '.join(PRESETS)}; or auto or auto:N, groups of "
            "joints that move together (default: lower_upper)",
            preset_or_automatic(PRESETS),
            "lower_upper",
        ),
        SKELETON,
        output_option("TOML file to write (default: stdout)"),
        FORCE,
        JSON,
    ),
    command(
        "index",
        "create a library from motion files, or add files to a library",
        files_argument("motion files, or folders of them", "FILE|DIR"),
        INCLUDE_GRAFTS,
        MATCH,
        SKELETON,
        output_option("folder of the library", required=True, metavar="LIB"),
        switch("--add", "add to an existing library; only new and changed files are read"),
        setting(
            "-j --jobs N", "number of processes that read files (default: 1)", positive_integer, 1
        ),
        GROUPS,
        SEGMENTATION,
        PRESET,
        SIGMA_SCALE,
        setting(
            "--rate FPS",
            "frame rate of the library in frames per second (default: the rate that most frames "
            "of the files have)",
            positive_number,
        ),
        repeated_option(
            "--true-rate CLIP=FPS",
            "true frame rate of a clip whose file contains a wrong frame rate; CLIP may be a glob; "
            "may be repeated",
        ),
        option(
            "--tags CSV",
            "table of clips and their tags; the folders of a clip also become its tags",
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
    STREAM,
    command(
        "view",
        "show motions side by side in the browser",
        FILES_OR_LIBRARY,
        repeated_option(
            "--clip NAME",
            "clips of a library to show; NAME may be a glob such as walk*; may be repeated "
            "(default: all clips)",
        ),
        groups_option(FIGURE_COLOURS, "trunk, arms and legs"),
        SEGMENTATION,
        SKELETON,
        option("--title", "title of the page (default: the names of the first three motions)"),
        output_option("HTML file to write (default: a temporary file, opened in the browser)"),
        switch("--open", "open the page in the browser, even if -o is given"),
        JSON,
        FORCE,
    ),
    PLOT,
    EXPORT,
    _EVALUATE,
    command("doctor", "check the installation, and list missing optional packages", JSON),
    command(
        "config",
        "print the settings of the configuration file and the environment",
        has_settings=False,
        actions=(
            command(
                "show",
                "print all settings in the format of mograft.toml",
                positional(
                    "only",
                    "command whose settings are printed (default: all)",
                    nargs="?",
                    metavar="COMMAND",
                ),
                switch("--origin", "also print the file or variable that sets each value"),
                JSON,
                description="Print the current settings of the commands in the format of "
                "mograft.toml. mograft reads this file from the working folder or the nearest "
                "folder above it. A table such as [graft] applies to one command; keys before all "
                "tables apply to every command. Environment variables override the file. For "
                "example, MOGRAFT_SEED applies to every command, and MOGRAFT_GRAFT_SEED applies to "
                "graft and overrides MOGRAFT_SEED. The command line overrides the file and the "
                "environment.",
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
        "~/.config/fish/completions/mograft.fish. This command needs mograft[completion].",
    ),
)
"""All commands, in the order of ``mograft --help``."""
