"""Options that several commands share."""

from mograft._util.registry import CONFIG_OPTIONS
from mograft.cli.arguments import Argument, option, positional, switch
from mograft.cli.values import non_negative_integer, positive_number

__all__ = [
    "BVH_FILES",
    "FILES_OR_LIBRARY",
    "FORCE",
    "GROUPS",
    "JSON",
    "LIBRARY_OR_FILES",
    "PRESET",
    "PRESETS",
    "SEED",
    "SIGMA_SCALE",
    "config_option",
]

PRESETS = (
    "lower_upper",
    "lower_torso_arms",
    "lower_torso_larm_rarm",
    "lower_torso_head_larm_rarm",
)

BVH_FILES = positional(
    "files", is_path=True, nargs="+", metavar="FILE", help="BVH files, or folders of them"
)
FILES_OR_LIBRARY = positional(
    "files", is_path=True, nargs="+", metavar="FILE", help="BVH files, or one library"
)
LIBRARY_OR_FILES = positional(
    "files", is_path=True, nargs="+", metavar="LIB|FILE", help="one library, or BVH files"
)
GROUPS = option(
    "--groups",
    is_path=True,
    metavar="NAME|FILE",
    help="joint groups: the name of a preset, or a TOML file (default: lower_upper)",
)
PRESET = option(
    "--preset",
    choices=("default", "paper"),
    help="configuration that the other options change: default, or paper for the parameters of "
    "the paper (default: default)",
)
SIGMA_SCALE = option(
    "--sigma-scale",
    type=positive_number,
    metavar="X",
    help="cluster diameter threshold, as a multiple of sigma; larger gives more variety, "
    "smaller more similarity (default: 0.75, with --preset paper 1)",
)
SEED = option(
    "--seed",
    type=non_negative_integer,
    default=0,
    help="seed of the random number generator (default: 0)",
)
FORCE = switch("--force", is_setting=False, help="overwrite existing files")
JSON = switch("--json", is_setting=False, help="print the results as one JSON document")


def config_option(field: str, subject: str, default: str) -> Argument:
    """Return the option for a field of `Config` that selects one of several named values.

    Parameters
    ----------
    field : str
        Name of the field; `CONFIG_OPTIONS` lists its values.
    subject : str
        What the option sets.
    default : str
        The value if the option is not given.
    """
    values = CONFIG_OPTIONS[field].entries.items()
    described = "; ".join(f"{name} - {description}" for name, description in values)
    return option(
        f"--{field}",
        choices=CONFIG_OPTIONS[field].names,
        help=f"{subject} (default: {default}): {described}",
    )
