"""``mograft index``: a library of many files, in a folder."""

import argparse
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mograft.cli._common import (
    above_zero,
    at_least_one,
    given,
    left_out,
    print_json,
    progress,
    say,
)
from mograft.cli.graft import chosen_config, chosen_groups
from mograft.errors import join_names

if TYPE_CHECKING:
    from concurrent.futures import Executor


def add(commands: Any) -> None:  # noqa: ANN401 - argparse keeps the type to itself
    """Add the command to the parser."""
    index = commands.add_parser("index", help="make a library of many files, or add to one")
    index.add_argument("files", nargs="+", metavar="FILE|DIR", help="BVH files and folders of them")
    index.add_argument("-o", "--output", type=Path, required=True, metavar="LIB")
    index.add_argument(
        "--add", action="store_true", help="add to a library; only new and changed files are read"
    )
    index.add_argument(
        "-j", "--jobs", type=at_least_one, default=1, metavar="N", help="processes (default 1)"
    )
    index.add_argument("--groups", metavar="NAME|FILE", help="default: lower_upper")
    index.add_argument("--preset", choices=("default", "paper"))
    index.add_argument("--sigma-scale", type=above_zero, metavar="X", help="see mograft graft")
    index.add_argument(
        "--rate",
        type=above_zero,
        metavar="FPS",
        help="of the library; default: that of most frames",
    )
    index.add_argument(
        "--true-rate",
        action="append",
        default=[],
        metavar="CLIP=FPS",
        help="a clip, or a glob of them, whose file gives a wrong rate; may be repeated",
    )
    index.add_argument(
        "--tags", type=Path, metavar="CSV", help="rows of a clip and its tags; folders are tags too"
    )
    index.add_argument(
        "--strict", action="store_true", help="refuse files that do not fit instead of leaving out"
    )
    index.add_argument("--force", action="store_true", help="replace the library that is there")
    index.add_argument("--json", action="store_true", help="what came of it as a JSON document")
    index.set_defaults(run=run, usage=index.error)


def run(options: argparse.Namespace) -> int:
    """Run the command."""
    # Matrices are small here: the threads of NumPy's BLAS, in this process and in its workers,
    # mostly wait for one another, for seconds where another program holds a processor. They are
    # settled when NumPy is loaded.
    for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    from mograft.library.discover import find_clips, matching_values, read_tags
    from mograft.library.library import Library

    fixed = given(options, "groups", "preset", "sigma_scale", "rate", "force")
    if options.add and fixed:
        options.usage(f"--{fixed[0].replace('_', '-')} is settled when a library is made: no --add")
    rates = _true_rates(options)
    tags = None if options.tags is None else read_tags(options.tags)
    if rates or tags:
        table = {key: key for key in (*rates, *(tags or ()))}
        used = {key for own in find_clips(options.files) for key in matching_values(table, own)}
        unused = [key for key in table if key not in used]
        if unused:
            say(f"warning: --true-rate or --tags name no clip of these files: {join_names(unused)}")
    with progress() as tell, _pool(options.jobs) as executor:
        if options.add:
            before = set(Library.open(options.output).refused)
            library = Library.open(options.output).add(
                options.files,
                frame_rates=rates,
                tags=tags,
                strict=options.strict,
                executor=executor,
                progress=tell,
            )
        else:
            before = set()
            options.groups = options.groups or "lower_upper"
            library = Library.index(
                options.files,
                options.output,
                chosen_groups(options),
                chosen_config(options),
                rate=options.rate,
                frame_rates=rates,
                tags=tags,
                strict=options.strict,
                force=options.force,
                executor=executor,
                progress=tell,
            )
    refused = {path: why for path, why in library.refused.items() if path not in before}
    for path, why in refused.items():
        say(left_out(path, why))
    if options.json:
        from mograft.cli.lib import described

        print_json({"schema": "mograft.index/1", **described(library), "left_out": refused})
    else:
        say(f"{library}")
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
            options.usage(f"--true-rate must be CLIP=FPS, got {text}")
    return rates


@contextmanager
def _pool(jobs: int) -> "Iterator[Executor | None]":
    if jobs == 1:
        yield None
        return
    # Spawned, not forked, as threads and open files do not survive a fork.
    import multiprocessing

    from mograft.cli._pool import Pool

    pool = Pool(jobs, mp_context=multiprocessing.get_context("spawn"))
    try:
        yield pool
    finally:
        pool.shutdown(cancel_futures=True)
