"""The experiments of ``docs/evidence.md``.

``python benches/experiments.py [--data FOLDER] [--only NAME...] [--sources NAME...] [--write]``
reads the recordings in FOLDER (default: ``../shared/data`` beside the checkout), runs the
experiments of `benches.evidence`, and prints a page of Markdown; ``--write`` writes it to
``docs/evidence.md``. Each result is stored in the folder ``--cache`` under the version of the code
and of the recordings. An interrupted run continues where it stopped. ``--processes`` results are
computed at once, by default one on each processor. ``--stored`` computes nothing and writes the
page from the newest stored results; the page then names the versions. ``--quick`` measures a few
seconds of each source. Needs ``pip install 'mograft[evaluate]'``.
"""

import argparse
import math
import multiprocessing
import os
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path

# Before NumPy is imported: the threads of OpenMP wait for each other longer than they compute.
os.environ["OMP_NUM_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"] = "1"
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import mograft as mg
from benches._common import run, tiny_motion
from benches.evidence import page
from benches.evidence.cache import Cache, code_version, input_version
from benches.evidence.sources import SOURCES, Recordings, find_files, read_recordings

ROOT = Path(__file__).resolve().parents[1]
FACTS = "facts"  # name under which the numbers of clips, frames and segments are stored


def measure_facts(recordings):
    """Return the numbers of clips, frames and segments of a source."""
    library = recordings.library
    n_frames = sum(clip.n_frames for clip in library.clips)
    return [len(library.clips), n_frames, len(library.segments)]


class Run:
    """Measures sources, or reads the stored results."""

    def __init__(self, options):
        self.options = options
        self.cache = Cache(options.cache)
        self.files = {
            name: find_files(SOURCES[name], options.data, options.cache) for name in SOURCES
        }
        self._inputs = {}
        self._recordings = Recordings("", ())
        self.n_seconds = 0.0
        self.versions = {}

    def recordings(self, name):
        """Return the recordings of a source; those of the last source stay in memory."""
        if self._recordings.name != name:
            is_quick = self.options.quick
            self._recordings = read_recordings(name, self.files[name], is_quick=is_quick)
        return self._recordings

    def result(self, experiment, modules, name, measure):
        """Return the stored result of an experiment on a source; compute it if it is missing.

        The result depends on the package and on the code in `modules`.
        """
        if name not in self._inputs:
            self._inputs[name] = input_version(self.files[name])
        code = code_version(modules)
        size = "quick" if self.options.quick else "full"
        version = f"{code}-{self._inputs[name]}-{size}"
        stored = self.cache.read(experiment, name, version, is_any_version=self.options.stored)
        if stored is None and not self.options.stored:
            start = time.process_time()
            try:
                stored = {"value": measure(self.recordings(name))}
            except mg.InsufficientDataError as error:
                stored = {"refused": str(error)}
            stored |= {"processor_seconds": time.process_time() - start, "code": code}
            self.cache.write(experiment, name, version, stored)
            print(
                f"{experiment}, {name}: {stored['processor_seconds']:.0f} s",
                file=sys.stderr,
                flush=True,
            )
        if stored is not None:
            self.n_seconds += stored.get("processor_seconds", math.nan)
            self.versions.setdefault(experiment, set()).add(stored["code"])
        return stored

    def experiment(self, experiment, name):
        """Return the stored or computed result of a module of experiments on a source."""
        return self.result(
            experiment.NAME,
            (experiment, *getattr(experiment, "HELPERS", ())),
            name,
            partial(experiment.measure, is_quick=self.options.quick),
        )

    def pairs(self):
        """Return the chosen pairs of experiment and source for which there are recordings."""
        return [
            (experiment, name)
            for name in self.sources()
            for experiment in page.experiments()
            if name in experiment.SOURCES
            and (not self.options.only or experiment.NAME in self.options.only)
        ]

    def sources(self):
        """Return the chosen sources for which there are recordings."""
        return [name for name in self.options.sources or SOURCES if self.files[name]]


def start_process(options):
    """Prepare a process that computes results; it keeps the recordings of the last source."""
    global _run
    _run = Run(options)


def compute_pair(pair):
    """Compute and store the result of the experiment of a name on a source."""
    experiments = {own.NAME: own for own in page.experiments()}
    _run.experiment(experiments[pair[0]], pair[1])


def compute(options):
    """Compute and store the missing results, several at a time."""
    pairs = [(experiment.NAME, name) for experiment, name in Run(options).pairs()]
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(options.processes, context, start_process, (options,)) as pool:
        list(pool.map(compute_pair, pairs))


def collect(options):
    """Return the results by experiment and source, the facts by source, and the notes."""
    if options.processes > 1 and not options.stored:
        compute(options)
    current = Run(options)
    facts, results = {}, {}
    for name in current.sources():
        stored = current.result(FACTS, (), name, measure_facts)
        if stored is not None and "value" in stored:
            facts[name] = stored["value"]
    for experiment, name in current.pairs():
        stored = current.experiment(experiment, name)
        if stored is not None:
            results.setdefault(experiment.NAME, {})[name] = stored
    missing = [name for name in SOURCES if not current.files[name]]
    minutes = current.n_seconds / 60
    notes = []
    if math.isfinite(minutes):
        notes.append(f"All experiments took {minutes:.0f} minutes of processor time.")
    if len(set().union(*current.versions.values())) > 1 or options.stored:
        listed = "; ".join(
            f"{name} {', '.join(sorted(found))}" for name, found in current.versions.items()
        )
        notes.append(
            "Checksums of the code that computed the results, each of the package and of the "
            f"modules of the section: {listed}. `{FACTS}` are the numbers in the table of sources."
        )
    if options.quick:
        notes.append("This is a quick run on a few seconds of each source: not a result.")
    if missing:
        notes.append(f"Missing recordings: {', '.join(missing)}.")
    return results, facts, notes


def report(options):
    if options.tiny:
        recordings = Recordings("tiny", (tiny_motion(), tiny_motion(2)))
        results = {}
        for experiment in page.experiments():
            try:
                value = {"value": experiment.measure(recordings, is_quick=True)}
            except mg.InsufficientDataError as error:
                value = {"refused": str(error)}
            results[experiment.NAME] = {experiment.SOURCES[0]: value}
        page.write_page(results, {}, [])
        return
    start = time.perf_counter()
    text = page.write_page(*collect(options))
    print(f"{(time.perf_counter() - start) / 60:.1f} minutes in all", file=sys.stderr)
    print(text)
    if options.write:
        (ROOT / "docs" / "evidence.md").write_text(text, encoding="utf-8")


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, default=ROOT.parent / "shared" / "data")
    parser.add_argument(
        "--cache",
        type=Path,
        default=ROOT / ".evidence",
        help="folder of results and of unpacked recordings",
    )
    parser.add_argument(
        "--only",
        nargs="+",
        choices=[experiment.NAME for experiment in page.experiments()],
        help="experiments to run (default: all)",
    )
    parser.add_argument(
        "--sources", nargs="+", choices=SOURCES, help="sources to measure (default: all)"
    )
    parser.add_argument(
        "--processes",
        type=int,
        default=len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else 1,
        help="number of results computed at once (default: number of processors)",
    )
    parser.add_argument("--quick", action="store_true", help="a few seconds of each source")
    parser.add_argument("--stored", action="store_true", help="compute nothing")
    parser.add_argument("--write", action="store_true", help="write docs/evidence.md")
    run(parser, report, argv)


if __name__ == "__main__":
    main()
