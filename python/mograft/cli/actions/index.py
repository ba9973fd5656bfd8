"""``mograft index``: a library of many files, in a folder."""

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from mograft._util.workers import worker_processes
from mograft.cli.actions.lib import describe_library
from mograft.cli.configuration import (
    options_given,
    selected_config,
    selected_groups,
    selected_skeleton,
)
from mograft.cli.exclusions import describe_excluded
from mograft.cli.files import check_suffix
from mograft.cli.output import print_remark, print_result, show_progress
from mograft.errors import join_names
from mograft.library.discover import find_clips, matching_values, read_tags
from mograft.library.library import Library

_FIXED_OPTIONS = (
    "groups",
    "preset",
    "segmentation",
    "sigma_scale",
    "rate",
    "force",
    "match",
    "skeleton",
)
"""Options that cannot be combined with ``--add``."""


def run(options: argparse.Namespace) -> int:
    """Run the command."""
    check_suffix(options, is_folder=True)
    if options.add:
        fixed = options_given(options, *_FIXED_OPTIONS)
        if fixed:
            flag = f"--{fixed[0].replace('_', '-')}"
            options.usage_error(
                f"{flag} is fixed when a library is created; it cannot be combined with --add"
            )
    if not options.add and not options.force and _holds_files(options.output):
        raise FileExistsError(f"{options.output} exists; use --force to replace a library")
    rates = _true_rates(options)
    tags = None if options.tags is None else read_tags(options.tags)
    _warn_of_unused(options.files, rates, tags or {})
    library, refused = _index(options, rates, tags)
    for line in describe_excluded(refused):
        print_remark(line)
    if not options.json:
        print_remark(f"{library}")
    document = {**describe_library(library), "left_out": refused}
    print_result(options, "index", document, [options.output])
    return 0


def _holds_files(path: Path) -> bool:
    """Return whether a path is a file, or a folder that is not empty."""
    return path.exists() and (not path.is_dir() or any(path.iterdir()))


def _true_rates(options: argparse.Namespace) -> dict[str, float]:
    rates = {}
    for text in options.true_rate:
        clip, _, rate = text.rpartition("=")
        try:
            rates[clip] = float(rate)
        except ValueError:
            clip = ""
        if not clip or not 0 < rates[clip] < float("inf"):
            options.usage_error(f"--true-rate must be CLIP=FPS, got {text}")
    return rates


def _warn_of_unused(
    files: Sequence[str], rates: Mapping[str, float], tags: Mapping[str, object]
) -> None:
    """Print a warning that lists the names of ``--true-rate`` and ``--tags`` that match no clip."""
    if not rates and not tags:
        return
    table = {key: key for key in (*rates, *tags)}
    used = {key for source in find_clips(files) for key in matching_values(table, source)}
    unused = [key for key in table if key not in used]
    if unused:
        print_remark(
            f"warning: no clip matches these names of --true-rate or --tags: {join_names(unused)}; "
            "they have no effect"
        )


def _index(
    options: argparse.Namespace,
    rates: Mapping[str, float],
    tags: Mapping[str, Sequence[str]] | None,
) -> tuple[Library, dict[str, str]]:
    """Create a library, or add files to one; return the library and the newly excluded files.

    The excluded files are a dict from path to reason.
    """
    with show_progress() as progress, worker_processes(options.jobs) as executor:
        keywords: dict[str, Any] = {
            "frame_rates": rates,
            "tags": tags,
            "strict": options.strict,
            "executor": executor,
            "progress": progress,
            "include_grafts": options.include_grafts,
        }
        before: set[str] = set()
        if options.add:
            library = Library.open(options.output)
            before = set(library.refused)
            library = library.add(options.files, **keywords)
        else:
            groups, config = selected_groups(options), selected_config(options)
            keywords |= {
                "rate": options.rate,
                "force": options.force,
                "match": options.match or "names",
            }
            keywords["skeleton"] = selected_skeleton(options)
            library = Library.index(options.files, options.output, groups, config, **keywords)
    return library, {path: why for path, why in library.refused.items() if path not in before}
