"""``python -m lab.pairs make|analyse``: the study in which people compare motions."""

import argparse
import csv
import json
import sys
import tempfile
import warnings
from pathlib import Path

from lab.common import tiny_motion
from lab.experiments.sources import SOURCES, TEST, Recordings, find_files, read_recordings
from lab.pairs.analysis import prefer, read_key, read_results
from lab.pairs.excerpts import ARMS, CHOICES, N_PAIRS, SECONDS, find_excerpts
from lab.pairs.study import build_study

MAX_CLIPS = 24  # of a source, evenly spaced
TEST_SOURCES = tuple(
    name for name in TEST if name not in ("actions and styles", "acting", "estimated")
)
QUICK_SECONDS = 1.0


def make(options):
    """Write the page and the key of a study into a new folder."""
    if options.output.exists():
        raise FileExistsError(f"{options.output}: expected a new folder")
    if options.quick:
        recordings = [Recordings("dancer", (tiny_motion(), tiny_motion(2)))]
    elif options.recordings:
        recordings = [
            read_recordings(path.name, _motion_files(path)) for path in options.recordings
        ]
    else:
        chosen = [SOURCES[name] for name in options.sources]
        with tempfile.TemporaryDirectory() as folder:
            files = {own.name: find_files(own, options.data, Path(folder)) for own in chosen}
            recordings = [read_recordings(name, own) for name, own in files.items() if own]
    recordings = [
        Recordings(own.name, own.motions[:: -(-len(own.motions) // MAX_CLIPS)])
        for own in recordings
    ]
    count, seconds = (6, QUICK_SECONDS) if options.quick else (options.pairs, SECONDS)
    excerpts = find_excerpts(
        recordings,
        count,
        options.seed,
        seconds=seconds,
        arms=options.arms,
        n_checks=2 if options.quick else 4,
    )
    page, key = build_study(excerpts, options.arms, options.contact, options.seed)
    options.output.mkdir(parents=True)
    page.save(options.output / "study.html")
    text = json.dumps(key, indent=1)
    (options.output / "key.json").write_text(f"{text}\n", encoding="utf-8")
    print(f"{options.output}/study.html: {len(page.html) / 1e6:.1f} MB, {count} pairs an arm")
    print(f"{options.output}/key.json: keep it from participants; `analyse` needs it")


def _motion_files(path):
    files = [path] if path.is_file() else sorted(path.rglob("*.bvh"))
    if not files:
        raise FileNotFoundError(f"{path}: no BVH file")
    return files


def analyse(options):
    """Print what participants preferred, and write it to a CSV file."""
    judgements, excluded = read_results(options.results, read_key(options.key))
    found = [prefer(own) for own in judgements.values()]
    n_raters = len(options.results) - len(excluded)
    print(f"{n_raters} participants; {len(excluded)} files excluded")
    for name, reason in excluded:
        print(f"  {name}: {reason}")
    rows = [("graft against", "preferred", "low", "high", "judgements", "agreement", "verdict")]
    for own in found:
        low, high = (f"{end:.3f}" for end in own.interval) if own.interval else ("", "")
        cells = (
            own.arm,
            f"{own.share:.3f}",
            low,
            high,
            str(own.n),
            f"{own.alpha:.2f}",
            own.verdict,
        )
        rows.append(cells)
        print(f"graft against {own.arm}: {own.share:.0%} ({low} to {high}), {own.verdict}")
    if options.output:
        _write_csv(options.output, rows)


def _write_csv(path, rows):
    with path.open("w", encoding="utf-8", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows(rows)


def main(argv=None):
    """Run a command of the study."""
    parser = argparse.ArgumentParser(prog="python -m lab.pairs", description=__doc__)
    commands = parser.add_subparsers(required=True)
    own = commands.add_parser("make", help=make.__doc__)
    own.add_argument("recordings", nargs="*", type=Path, help="BVH files, or folders of one figure")
    own.add_argument("-o", "--output", type=Path, required=True, help="new folder")
    own.add_argument("--contact", required=True, help="name and address that the page shows")
    own.add_argument("--data", type=Path, default=Path(__file__).parents[3] / "shared" / "data")
    own.add_argument("--sources", nargs="+", choices=SOURCES, default=TEST_SOURCES)
    own.add_argument(
        "--arms", nargs="+", default=ARMS, choices=CHOICES, help="what grafts are compared with"
    )
    own.add_argument("--pairs", type=int, default=N_PAIRS, help="pairs an arm (default: 60)")
    own.add_argument("--seed", type=int, default=0)
    own.add_argument("--quick", action="store_true", help="six seconds-long pairs of the dancer")
    own.set_defaults(run=make)
    own = commands.add_parser("analyse", help=analyse.__doc__)
    own.add_argument("key", type=Path)
    own.add_argument("results", nargs="+", type=Path, help="files of participants")
    own.add_argument("-o", "--output", type=Path, help="CSV file")
    own.set_defaults(run=analyse)
    options = parser.parse_args(argv)
    warnings.simplefilter("ignore")
    return options.run(options)


if __name__ == "__main__":
    sys.exit(main())
