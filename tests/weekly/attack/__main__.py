"""Attack mograft in many ways, and print the results: ``python -m tests.weekly.attack``.

All experiments together take hours, with ``--scale 0.02`` minutes: ``--scale`` repeats them less
often. ``--only`` selects some, and ``--commands`` some of the commands that write. ``--write``
writes the table to docs/reliability.md. The exit code is 1 if an experiment failed.
"""

import argparse
import math
import os
import re
import sys
import tempfile
from pathlib import Path

from tests.weekly.attack import crash, experiments, faults, hostile

PAGE = Path(__file__).resolve().parents[3] / "docs" / "reliability.md"
MARKS = ("<!-- attack: begin -->", "<!-- attack: end -->")

COMMANDS = {
    "failed_calls": "each call that changes files fails, or the process ends there",
    "lost_writes": "power failure at each call: what was not synced is lost",
    "full_disks": "full disk before, in and after each write",
    "random_signals": "Ctrl-C, SIGTERM or SIGKILL at a random moment",
}
"""Experiments with the commands that write, and their descriptions."""

OTHERS = {
    "opens_during_rewrites": (320, "opening while another process writes"),
    "cut_texts": (20_100, "BVH texts cut anywhere"),
    "damaged_files": (100_000, "random changes of BVH, GLB, NPZ, USDA and USDC files"),
    "hostile_texts": (5_040, "deep, long or changed TOML and JSON"),
    "damaged_libraries": (2_000, "changed libraries, half of them sealed again"),
    "repeated_calls": (5_300, "repeated calls: memory does not grow"),
    "grafts_in_workers": (360, "grafts in threads, forked and new processes"),
    "public_functions_in_threads": (1_000, "public functions from 8 threads on one library"),
}
"""Other experiments, their numbers of trials, and their descriptions."""


def find_experiment(name):
    """Return the function of one of the `OTHERS`."""
    return getattr(hostile if hasattr(hostile, name) else experiments, name)


def run(name, scale, commands=None):
    """Run an experiment; print its failures, and return its row of the table."""
    if name in COMMANDS:
        title = COMMANDS[name] + (f" (one in {every})" if (every := round(1 / scale)) > 1 else "")
        trials = list(crash.try_commands(getattr(crash, name), scale, commands))
    else:
        count, title = OTHERS[name]
        with tempfile.TemporaryDirectory() as folder:
            count = max(4, math.ceil(scale * count))
            trials = list(find_experiment(name)(Path(folder), count))
    failures = [message for message in trials if message]
    for message in failures[:20]:
        print(f"{name}: {message}", file=sys.stderr)
    return f"| {title} | {len(trials):,} | {len(failures)} |"


def write_page(table):
    """Replace the table of the page."""
    begin, end = MARKS
    before, _, rest = PAGE.read_text(encoding="utf-8").partition(begin)
    PAGE.write_text(f"{before}{begin}\n{table}\n{end}{rest.partition(end)[2]}", encoding="utf-8")


def main(arguments):
    parser = argparse.ArgumentParser(prog="python -m tests.weekly.attack", description=__doc__)
    names = [*COMMANDS, *OTHERS]
    parser.add_argument("--only", nargs="+", choices=names, default=names, metavar="NAME")
    parser.add_argument("--commands", nargs="+", metavar="NAME")
    parser.add_argument("--scale", type=float, default=1.0)
    parser.add_argument("--write", action="store_true")
    options = parser.parse_args(arguments)
    if not os.environ.get("LD_PRELOAD") and set(options.only) & set(COMMANDS):
        process = faults.start(["tests.weekly.attack", *arguments])
        print(process.stdout, process.stderr, sep="", end="")
        return process.returncode
    rows = [run(name, options.scale, options.commands) for name in options.only]
    table = "\n".join(["| attack | trials | failures |", "|---|--:|--:|", *rows])
    print(table)
    if options.write:
        write_page(table)
    return int(not all(re.search(r"\| 0 \|$", row) for row in rows))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
