"""``mograft index``: a library of many files, in a folder."""

import argparse
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from mograft.cli.arguments import Command, option, positional, repeated_option, switch
from mograft.cli.configuration import options_given, selected_config, selected_groups
from mograft.cli.lib import describe_library
from mograft.cli.options import GROUPS, JSON, PRESET, SIGMA_SCALE
from mograft.cli.output import (
    describe_excluded_file,
    print_json,
    print_remark,
    show_progress,
)
from mograft.cli.values import positive_integer, positive_number
from mograft.errors import join_names

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from mograft.library.library import Library


def run(options: argparse.Namespace) -> int:
    """Run the command."""
    from mograft.library.discover import read_tags

    if options.add:
        fixed = options_given(options, "groups", "preset", "sigma_scale", "rate", "force")
        if fixed:
            flag = f"--{fixed[0].replace('_', '-')}"
            options.usage_error(
                f"{flag} is fixed when a library is created; it cannot be combined with --add"
            )
    rates = _true_rates(options)
    tags = None if options.tags is None else read_tags(options.tags)
    _warn_of_unused(options.files, rates, tags or {})
    library, refused = _index(options, rates, tags)
    for path, reason in refused.items():
        print_remark(describe_excluded_file(path, reason))
    if options.json:
        document = {"schema": "mograft.index/1", **describe_library(library), "left_out": refused}
        print_json(document)
    else:
        print_remark(f"{library}")
        print(options.output)
    return 0


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
    """Print the patterns of ``--true-rate`` and ``--tags`` that match no clip."""
    from mograft.library.discover import find_clips, matching_values

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
    tags: "Mapping[str, Sequence[str]] | None",
) -> "tuple[Library, dict[str, str]]":
    """Create the library or add to it; return it and the files that were refused this time."""
    from mograft.library.library import Library

    with show_progress() as progress, _workers(options.jobs) as executor:
        if options.add:
            before = set(Library.open(options.output).refused)
            library = Library.open(options.output).add(
                options.files,
                frame_rates=rates,
                tags=tags,
                strict=options.strict,
                executor=executor,
                progress=progress,
            )
        else:
            before = set()
            library = Library.index(
                options.files,
                options.output,
                selected_groups(options),
                selected_config(options),
                rate=options.rate,
                frame_rates=rates,
                tags=tags,
                strict=options.strict,
                force=options.force,
                executor=executor,
                progress=progress,
            )
    return library, {path: why for path, why in library.refused.items() if path not in before}


@contextmanager
def _workers(jobs: int) -> "Iterator[Executor | None]":
    """Yield a pool of processes; None for one job."""
    if jobs == 1:
        yield None
        return
    # Spawned, not forked, as threads and open files do not survive a fork.
    import multiprocessing

    from mograft.cli.pool import Pool

    pool = Pool(jobs, mp_context=multiprocessing.get_context("spawn"))
    try:
        yield pool
    finally:
        pool.shutdown(cancel_futures=True)


COMMAND = Command(
    name="index",
    help="create a library of many files, or add files to one",
    run=run,
    arguments=(
        positional(
            "files",
            is_path=True,
            nargs="+",
            metavar="FILE|DIR",
            help="BVH files, or folders of them",
        ),
        option(
            "-o",
            "--output",
            is_setting=False,
            is_path=True,
            type=Path,
            required=True,
            metavar="LIB",
            help="folder of the library",
        ),
        switch(
            "--add",
            is_setting=False,
            help="add to an existing library; only new and changed files are read",
        ),
        option(
            "-j",
            "--jobs",
            type=positive_integer,
            default=1,
            metavar="N",
            help="number of processes (default: 1)",
        ),
        GROUPS,
        PRESET,
        SIGMA_SCALE,
        option(
            "--rate",
            type=positive_number,
            metavar="FPS",
            help="frame rate of the library in frames per second (default: the rate of most "
            "frames)",
        ),
        repeated_option(
            "--true-rate",
            metavar="CLIP=FPS",
            help="frame rate of clips whose files state a wrong one; CLIP may be a glob; may be "
            "repeated",
        ),
        option(
            "--tags",
            is_setting=False,
            is_path=True,
            type=Path,
            metavar="CSV",
            help="table of clips and their tags; names of folders are tags as well",
        ),
        switch("--strict", help="fail if a file cannot be used, instead of excluding it"),
        switch("--force", is_setting=False, help="replace an existing library"),
        JSON,
    ),
)
