"""Time the parser and the printer of numbers against `float` and `repr` of Python.

Run with a release build: ``python benches/number_texts.py``. Times are processor times per number.
"""

import argparse
import statistics
import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benches._common import run
from mograft import _core


def _seconds(task, n_runs):
    """Return the median processor seconds of a task, which other processes hardly change."""
    runs = []
    for _ in range(n_runs):
        start = time.process_time()
        task()
        runs.append(time.process_time() - start)
    return statistics.median(runs)


def measure_numbers(n_numbers):
    """Print a table of nanoseconds per number."""
    print("| ns per number | parse | `float` | print | `repr` |\n|---|--:|--:|--:|--:|")
    angles = np.random.default_rng(0).uniform(-180.0, 180.0, n_numbers)
    for name, values in (
        ("4 decimals", angles.round(4)),
        ("6 decimals", angles.round(6)),
        ("17 digits", angles),
    ):
        rows = values.reshape(-1, 64)
        text = _core.format_rows(rows)
        words, numbers = text.split(), values.tolist()
        tasks = (
            lambda text=text: _core.scan_numbers(text, 0, n_numbers),
            lambda words=words: [float(word) for word in words],
            lambda rows=rows: _core.format_rows(rows),
            lambda numbers=numbers: [repr(number) for number in numbers],
        )
        times = (f"{_seconds(task, 15) / n_numbers * 1e9:.1f}" for task in tasks)
        print(f"| {name} | {' | '.join(times)} |")


def main(argv=None):
    run(argparse.ArgumentParser(description=__doc__), report, argv, is_timing=True)


def report(options):
    measure_numbers(1 << 8 if options.tiny else 1 << 20)


if __name__ == "__main__":
    main()
