"""Attack mograft in many ways, and print the results: ``python -m tests.weekly.attack``.

All experiments together take about half an hour. ``--only`` selects some, ``--scale`` repeats them
less often, and ``--results FILE`` keeps results, so that several runs give one table. ``--write``
writes the table to docs/reliability.md. The exit code is 1 if an experiment failed.
"""

import argparse
import json
import math
import re
import sys
import tempfile
import time
from pathlib import Path

from tests.weekly.attack.crash import failed_calls, full_disks, lost_writes, random_kills, try_all
from tests.weekly.attack.experiments import (
    cut_texts,
    damaged_libraries,
    damaged_texts,
    grafts_in_workers,
    opens_during_rewrites,
    public_functions_in_threads,
    repeated_calls,
    small_linkages,
)
from tests.weekly.attack.pages import hostile_pages

PAGE = Path(__file__).resolve().parents[3] / "docs" / "reliability.md"
MARKS = ("<!-- attack: begin -->", "<!-- attack: end -->")

COMMANDS = {
    "failed_calls": (failed_calls, "each call that changes files fails, or the process ends there"),
    "lost_writes": (lost_writes, "power failure at each call: what was not synced is lost"),
    "full_disks": (full_disks, "full disk before, in and after each write"),
    "random_kills": (random_kills, "kill at a random moment"),
}
"""Experiments with the commands that write, by name, and their descriptions."""

OTHERS = {
    "opens_during_rewrites": (opens_during_rewrites, 320, "opening while another process writes"),
    "damaged_libraries": (damaged_libraries, 1_000, "files of libraries changed, cut or removed"),
    "damaged_texts": (damaged_texts, 25_000, "damaged BVH texts"),
    "cut_texts": (cut_texts, 20_100, "BVH texts cut anywhere"),
    "small_linkages": (small_linkages, 3_400, "trees of small sets of points, half with ties"),
    "repeated_calls": (repeated_calls, 5_300, "repeated calls: memory does not grow"),
    "grafts_in_workers": (grafts_in_workers, 360, "grafts in threads, forked and new processes"),
    "public_functions_in_threads": (
        public_functions_in_threads,
        1_000,
        "public functions from 8 threads on one library",
    ),
    "hostile_pages": (hostile_pages, 28, "pages with hostile names in Chromium, half without CSP"),
}
"""Other experiments by name, their numbers of trials, and their descriptions."""


def run(name, scale):
    """Run an experiment and return its row: description, trials, failures and seconds."""
    start = time.perf_counter()
    if name in COMMANDS:
        experiment, title = COMMANDS[name]
        outcome = try_all(experiment, scale)
        title += f" (one in {round(1 / scale)})" if round(1 / scale) > 1 else ""
    else:
        function, count, title = OTHERS[name]
        with tempfile.TemporaryDirectory() as folder:
            outcome = function(Path(folder), max(4, math.ceil(scale * count)))
    for message in outcome.failures[:20]:
        print(f"{name}: {message}", file=sys.stderr)
    return {
        "name": name,
        "title": title,
        "trials": outcome.trials,
        "failures": len(outcome.failures),
        "seconds": round(time.perf_counter() - start),
    }


def render(rows):
    """Return the rows as a table, in the order of the experiments."""
    lines = ["| attack | trials | failures |", "|---|--:|--:|"]
    lines += [
        f"| {rows[name]['title']} | {rows[name]['trials']:,} | {rows[name]['failures']} |"
        for name in (*COMMANDS, *OTHERS)
        if name in rows
    ]
    return "\n".join(lines)


def write_page(table):
    """Replace the table of the page."""
    begin, end = map(re.escape, MARKS)
    text = PAGE.read_text(encoding="utf-8")
    found = re.sub(
        f"{begin}.*{end}", lambda _: f"{MARKS[0]}\n{table}\n{MARKS[1]}", text, flags=re.DOTALL
    )
    PAGE.write_text(found, encoding="utf-8")


def main(arguments):
    parser = argparse.ArgumentParser(prog="python -m tests.weekly.attack", description=__doc__)
    parser.add_argument("--only", nargs="+", choices=[*COMMANDS, *OTHERS], metavar="NAME")
    parser.add_argument("--scale", type=float, default=1.0)
    parser.add_argument("--results", type=Path)
    parser.add_argument("--write", action="store_true")
    options = parser.parse_args(arguments)
    rows = {}
    if options.results is not None and options.results.exists():
        rows = json.loads(options.results.read_text())
    chosen = options.only
    if chosen is None:
        chosen = [name for name in (*COMMANDS, *OTHERS) if name not in rows]
    for name in chosen:
        rows[name] = run(name, options.scale)
        print(f"{name}: {rows[name]}", file=sys.stderr, flush=True)
        if options.results is not None:
            options.results.write_text(json.dumps(rows, indent=1))
    print(render(rows))
    if options.write:
        write_page(render(rows))
    return 1 if any(row["failures"] for row in rows.values()) else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
