"""Run the experiments on recordings, and write their tables.

The recordings are in the folder ``--data`` (default: ``../shared/data`` beside the checkout). Each
result is stored in the folder ``--cache`` under the version of the code and of the recordings, so
that an interrupted run continues where it stopped. ``--stored`` computes nothing and writes the
tables of the newest stored results. ``--quick`` measures a few seconds of each source.

An experiment measures one source at a time; a study compares methods on several sources at once,
and each of its tables is a result.
"""

import argparse
import csv
import importlib
import multiprocessing
import os
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path

import mograft as mg
from lab.common import tiny_motion
from lab.experiments.cache import Cache, code_version, input_version
from lab.experiments.constants import CONSTANTS
from lab.experiments.sources import SOURCES, Recordings, find_files, read_recordings
from lab.experiments.tables import Table, read_csv, write_csv

ROOT = Path(__file__).resolve().parents[2]
RESULTS = ROOT / "lab" / "results"
EXPERIMENTS = (
    "retrieval",
    "matched",
    "ablation",
    "readings",
    "new_motions",
    "collisions",
    "counts",
    "balance",
    "seam_tests",
    "generators",
    "tradeoff",
    "learning",
    "editing",
)
STUDIES = ("segmentations", "behaviours", "power")
CODE = "code.csv"  # the version of the code that measured each experiment
FACTS = "facts"  # name under which the numbers of clips, frames and segments are stored


def experiments():
    """Return the modules of all experiments."""
    return [importlib.import_module(f"lab.experiments.{name}") for name in EXPERIMENTS]


def studies():
    """Return the modules of all studies with stored tables."""
    return [importlib.import_module(f"lab.studies.{name}") for name in STUDIES]


def version_of(module):
    """Return the version of the code of an experiment or a study."""
    return code_version(module, *getattr(module, "CODE", ()))


def measure_facts(recordings):
    """Return the numbers of clips, frames and segments of a source."""
    library = recordings.library
    n_frames = sum(clip.n_frames for clip in library.clips)
    return [len(library.clips), n_frames, len(library.segments)]


def stale_experiments(folder):
    """Return the experiments with tables in a folder that other code measured, or unknown code."""
    path = folder / CODE
    known = {own["experiment"]: own["code"] for own in read_csv(path)} if path.exists() else {}
    every = [*experiments(), *studies()]
    return {own.NAME for own in every if known.get(own.NAME) != version_of(own)}


def write_code(results, folder):
    """Note in a folder which code measured the experiments; those without results keep theirs."""
    path = folder / CODE
    known = {own["experiment"]: own["code"] for own in read_csv(path)} if path.exists() else {}
    for experiment, stored in results.items():
        versions = {own.get("code", "unknown") for own in stored.values()}
        known[experiment] = versions.pop() if len(versions) == 1 else "several"
    write_csv(Table(("experiment", "code"), sorted(known.items())), path)


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
        self._of_study = {}

    def recordings(self, name):
        """Return the recordings of a source; those of the last source stay in memory."""
        if self._recordings.name != name:
            is_quick = self.options.quick
            self._recordings = read_recordings(name, self.files[name], is_quick=is_quick)
        return self._recordings

    def result(self, experiment, code, name, measure):
        """Return the stored result of an experiment on a source; compute it if it is missing.

        `code` is the version of the code on which the result depends.
        """
        if name not in self._inputs:
            self._inputs[name] = input_version(self.files[name])
        version = f"{code}-{self._inputs[name]}"
        return self.stored(experiment, name, version, lambda: measure(self.recordings(name)))

    def stored(self, experiment, name, version, measure):
        """Return the stored value of a version; compute it if it is missing."""
        version += "-quick" if self.options.quick else "-full"
        stored = self.cache.read(experiment, name, version, is_any_version=self.options.stored)
        if stored is None and not self.options.stored:
            start = time.process_time()
            try:
                stored = {"value": measure()}
            except mg.InsufficientDataError as error:
                stored = {"refused": str(error)}
            seconds = time.process_time() - start
            stored |= {"processor_seconds": seconds, "code": version.partition("-")[0]}
            self.cache.write(experiment, name, version, stored)
            print(f"{experiment}, {name}: {seconds:.0f} s", file=sys.stderr, flush=True)
        return stored

    def experiment(self, experiment, name):
        """Return the stored or computed result of a module of experiments on a source."""
        measure = partial(experiment.measure, is_quick=self.options.quick)
        return self.result(experiment.NAME, version_of(experiment), name, measure)

    def study(self, study, title):
        """Return the stored or computed table of a study."""
        folders = self.options.data, self.options.cache

        def measure():
            if study.NAME not in self._of_study:
                inputs = study.read_inputs(*folders, is_quick=self.options.quick)
                self._of_study = {study.NAME: inputs}
            return study.PARTS[title](self._of_study[study.NAME]).__dict__

        version = f"{version_of(study)}-{input_version(study.find_inputs(*folders))}"
        return self.stored(study.NAME, title, version, measure)

    def parts(self):
        """Return the chosen pairs of study and title of a table, unless sources are chosen."""
        return [
            (study, title)
            for study in studies()
            for title in study.PARTS
            if (not self.options.only or study.NAME in self.options.only)
            and not self.options.sources
        ]

    def pairs(self):
        """Return the chosen pairs of experiment and source for which there are recordings."""
        return [
            (experiment, name)
            for name in self.sources()
            for experiment in experiments()
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
    """Compute and store an experiment on a source, or a table of a study."""
    by_name = {own.NAME: own for own in [*experiments(), *studies()]}
    module = by_name[pair[0]]
    (_run.study if hasattr(module, "PARTS") else _run.experiment)(module, pair[1])


def compute(options):
    """Compute and store the missing results, several at a time."""
    current = Run(options)
    pairs = [(own.NAME, name) for own, name in [*current.parts(), *current.pairs()]]
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(options.processes, context, start_process, (options,)) as pool:
        list(pool.map(compute_pair, pairs))


def write_tables(results, facts, folder):
    """Write the tables of all results to a folder; return what was not measured, with reasons.

    `results` maps the name of an experiment to the stored values by source, `facts` the name of a
    source to its numbers of clips, frames and segments.
    """
    refusals = []
    for experiment in experiments():
        stored = results.get(experiment.NAME, {})
        measured = {name: own["value"] for name, own in stored.items() if "value" in own}
        refusals += [
            (experiment.NAME, name, own["refused"])
            for name, own in stored.items()
            if "refused" in own
        ]
        if measured:
            for title, table in experiment.tables(measured).items():
                write_csv(table, folder / f"{experiment.NAME}-{title}.csv")
    for study in studies():
        for title, own in results.get(study.NAME, {}).items():
            if "value" in own:
                write_csv(Table(**own["value"]), folder / f"{study.NAME}-{title}.csv")
            else:
                refusals.append((study.NAME, title, own["refused"]))
    write_code(results, folder)
    sources = [
        (name, SOURCES[name].use, SOURCES[name].description, *own) for name, own in facts.items()
    ]
    constants = [
        (
            own.name,
            f"{own.value:.4g}" if isinstance(own.value, float) else own.value,
            own.paper,
            own.chosen_on,
        )
        for own in CONSTANTS
    ]
    for name, head, rows in (
        ("sources", ("source", "use", "recordings", "clips", "frames", "segments"), sources),
        ("constants", ("constant", "value", "in the paper", "chosen on"), constants),
        ("refused", ("experiment", "source", "reason"), refusals),
    ):
        if rows:
            folder.mkdir(parents=True, exist_ok=True)
            with (folder / f"{name}.csv").open("w", encoding="utf-8", newline="") as file:
                csv.writer(file, lineterminator="\n").writerows([head, *rows])
    return refusals


def collect(options):
    """Return the results by experiment and source, and the facts by source."""
    if options.processes > 1 and not options.stored:
        compute(options)
    current = Run(options)
    facts, results = {}, {}
    for name in current.sources():
        stored = current.result(FACTS, code_version(), name, measure_facts)
        if stored is not None and "value" in stored:
            facts[name] = stored["value"]
    found = [(own, name, current.experiment(own, name)) for own, name in current.pairs()]
    found += [(own, title, current.study(own, title)) for own, title in current.parts()]
    for module, name, stored in found:
        if stored is not None:
            results.setdefault(module.NAME, {})[name] = stored
    return results, facts


def measure_tiny(names=None):
    """Return the results of all experiments on a few seconds of the dancer, for tests."""
    recordings = Recordings("tiny", (tiny_motion(), tiny_motion(2)))
    results = {}
    for experiment in experiments():
        if names is not None and experiment.NAME not in names:
            continue
        try:
            value = {"value": experiment.measure(recordings, is_quick=True)}
        except mg.InsufficientDataError as error:
            value = {"refused": str(error)}
        results[experiment.NAME] = {experiment.SOURCES[0]: value}
    for study in studies():
        if names is None or study.NAME in names:
            inputs = study.read_inputs(None, None, is_quick=True)
            results[study.NAME] = {
                title: {"value": part(inputs).__dict__} for title, part in study.PARTS.items()
            }
    return results


def main(argv=None):
    """Run the experiments that are not stored, and write the tables."""
    parser = argparse.ArgumentParser(prog="lab experiments", description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, default=ROOT.parent / "shared" / "data")
    parser.add_argument("--cache", type=Path, default=ROOT / ".evidence")
    parser.add_argument("-o", "--output", type=Path, help="folder of the tables")
    names = [own.NAME for own in [*experiments(), *studies()]]
    parser.add_argument("--only", nargs="+", choices=names)
    parser.add_argument("--sources", nargs="+", choices=SOURCES)
    parser.add_argument("--processes", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--quick", action="store_true", help="a few seconds of each source")
    parser.add_argument("--stored", action="store_true", help="compute nothing")
    options = parser.parse_args(argv)
    if options.quick and options.output is None:
        parser.error("--quick needs -o FOLDER: its tables are no results")
    start = time.perf_counter()
    for row in write_tables(*collect(options), options.output or RESULTS):
        print("not measured:", *row, file=sys.stderr)
    print(f"{(time.perf_counter() - start) / 60:.1f} minutes in all", file=sys.stderr)
