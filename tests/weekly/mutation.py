"""Measure how many small errors the tests notice: ``python -m tests.weekly.mutation PACKAGE...``.

A mutant is the code with one operator, number, condition or call changed. Of all mutants of the
packages (``search``, ``blend``) or modules (``search.costs``) a sample is drawn that depends on the
seed only: each module gets a share by its number of mutants, and of these those with the smallest
hashes. A mutant keeps its hash when other lines change or the module moves, so that samples before
and after a change are mostly the same. ``--like FILE`` takes the mutants of an earlier run as far
as they still exist, lists the others, and compares the shares of killed mutants.

A first run without mutants records which statements each test executes. Then a process per mutant
imports the changed module, without writing it to a file, and runs the tests that execute the
changed statement, the fastest first, until one fails. The mutant is killed by a failure, survives
if all pass or none executes the statement, and counts as a timeout, which is also noticed, after
five times the processor time of these tests. Tests that start further Pythons do not see mutants.
"""

import argparse
import builtins
import contextlib
import json
import os
import resource
import signal
import sys
import tempfile
import time
import traceback
from collections import defaultdict
from dataclasses import asdict
from pathlib import Path

os.environ["OPENBLAS_NUM_THREADS"] = "1"  # before NumPy is imported

import hypothesis.extra.numpy  # noqa: F401  # imported once for the processes of all mutants
import numpy as np  # noqa: F401
import pytest

from tests.weekly.mutants import (
    HEAD,
    HIT,
    ROOT,
    ChangedModules,
    Mutation,
    draw,
    find_modules,
    find_mutants,
    instrumented,
)

TESTS = ["search", "blend", "solve", "synthesis", "provenance", "stream"]
OPTIONS = ["-x", "-q", "-p", "no:cacheprovider", "--hypothesis-profile", "few"]
OPTIONS += ["--assert=plain"]  # else pytest would import the modules whose doctests it runs itself
NOTICED = ("killed", "timeout")


class _Recorder:
    """Plugin of pytest: the statements and the processor time of each test that passes."""

    def __init__(self):
        self.hits, self.shared = set(), defaultdict(set)
        self.statements, self.seconds, self.unusable = {}, {}, set()
        setattr(builtins, HIT, self.hits.add)

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(self, fixturedef):
        """Count what a fixture of several tests executes for each of them."""
        if fixturedef.scope == "function":
            return (yield)
        before = set(self.hits)
        self.hits.clear()
        result = yield
        self.shared[fixturedef] |= self.hits
        self.hits |= before
        return result

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item):
        self.hits.clear()
        start = time.process_time()
        result = yield
        self.seconds[item.nodeid] = time.process_time() - start
        hits = set(self.hits)
        for fixtures in item._fixtureinfo.name2fixturedefs.values():
            hits.update(*(self.shared[fixture] for fixture in fixtures))
        self.statements[item.nodeid] = sorted(hits)
        return result

    def pytest_runtest_logreport(self, report):
        if report.failed or report.skipped:
            self.unusable.add(report.nodeid)


class _Failures(list):
    __hash__ = object.__hash__  # plugins of pytest are members of sets

    def pytest_runtest_logreport(self, report):
        if report.failed:
            self.append(report.nodeid)


def _in_process(work, seconds):
    """Return the result of a function in a process of its own, None if that takes too long."""
    with tempfile.TemporaryFile("w+") as answer:
        process = os.fork()
        if process == 0:
            try:
                os.setsid()
                resource.setrlimit(resource.RLIMIT_CPU, (int(seconds), int(seconds) + 5))
                signal.alarm(int(20 * seconds))  # of the wall clock: other programs run as well
                errors = os.fdopen(os.dup(2), "w")
                silence = os.open(os.devnull, os.O_RDWR)
                for stream in range(3):
                    os.dup2(silence, stream)
                json.dump(work(), answer)
                answer.flush()
            except BaseException:
                traceback.print_exc(file=errors)
                errors.flush()
            os._exit(0)
        os.waitpid(process, 0)
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process, signal.SIGKILL)
        answer.seek(0)
        return json.loads(answer.read() or "null")


def _record(files, tests):
    """Return the statements and the processor time of each test, and the tests left out."""
    changes = {name: lambda tree, name=name: instrumented(tree, name) for name in files}
    sys.meta_path.insert(0, ChangedModules(files, changes))
    recorder = _Recorder()
    options = [option for option in OPTIONS if option != "-x"]
    pytest.main([*options, *tests], plugins=[recorder])
    for test in recorder.unusable:
        recorder.statements.pop(test, None)
    return recorder.statements, recorder.seconds, sorted(recorder.unusable)


def _run(files, mutant, tests):
    """Return the exit code of the tests with a mutant, and the first that fails."""
    changes = {mutant.module: lambda tree: Mutation(mutant.index).visit(tree)}
    sys.meta_path.insert(0, ChangedModules(files, changes))
    failures = _Failures()
    code = int(pytest.main([*OPTIONS, *tests], plugins=[failures]))
    return code, failures[0] if failures else None


def judge(files, mutant, statements, seconds):
    """Run the tests that execute a mutant; return its outcome and the test that kills it."""
    tests = [
        test
        for test, places in statements.items()
        if any(m == mutant.module and mutant.statement in (line, HEAD) for m, line in places)
    ]
    if not tests:
        return "not executed", None
    by_file = defaultdict(float)
    for test in tests:
        by_file[test.split("::")[0]] += seconds[test]
    tests.sort(key=lambda test: (by_file[test.split("::")[0]], test.split("::")[0], seconds[test]))
    limit = 20 + 5 * sum(seconds[test] for test in tests)
    answer = _in_process(lambda: _run(files, mutant, tests), limit)
    if answer is None:
        return "timeout", None
    return ("killed" if answer[0] else "survived"), answer[1]


def shares(results):
    """Return a line with the number of mutants and the share noticed, by package and of all."""
    packages = defaultdict(list)
    for result in results:
        for package in (result["module"].split(".")[1], "all"):
            packages[package].append(result["outcome"] in NOTICED)
    counts = sorted((name, sum(of), len(of)) for name, of in packages.items())
    return ", ".join(f"{name} {part}/{n} = {part / n:.1%}" for name, part, n in counts)


def compare(results, earlier):
    """Print the shares of the mutants of both runs, and the survivors that were noticed before."""
    paired = [result for result in results if tuple(result["key"]) in earlier]
    before = [{**earlier[tuple(own["key"])], "module": own["module"]} for own in paired]
    print(f"{len(paired)} in both runs, before: {shares(before)}")
    print(f"{len(paired)} in both runs, now: {shares(paired)}")
    for result, old in zip(paired, before, strict=True):
        if old["outcome"] in NOTICED and result["outcome"] not in NOTICED:
            print(f"no longer noticed by {old['test']}: {result['key']}")


def main():
    parser = argparse.ArgumentParser(prog="python -m tests.weekly.mutation")
    parser.add_argument("packages", nargs="+", metavar="PACKAGE", help="package or module")
    parser.add_argument("--sample", type=int, default=220, help="number of mutants (%(default)s)")
    parser.add_argument("--seed", type=int, default=1, help="of the sample (%(default)s)")
    parser.add_argument("--minutes", type=float, default=600, help="start no mutant after these")
    parser.add_argument("--like", type=Path, help="results of an earlier run to compare with")
    parser.add_argument("--json", type=Path, default=Path("mutation.json"), help="results")
    options = parser.parse_args()
    end = time.monotonic() + 60 * options.minutes
    files = find_modules(options.packages)
    mutants = [mutant for module, file in files.items() for mutant in find_mutants(module, file)]
    sample, earlier = draw(mutants, options.sample, options.seed), {}
    if options.like:
        old = json.loads(options.like.read_text())["mutants"]
        earlier = {tuple(result["key"]): result for result in old}
        paired = draw([mutant for mutant in mutants if mutant.key in earlier], None, options.seed)
        sample = paired + [mutant for mutant in sample if mutant.key not in earlier]
        for key in earlier.keys() - {mutant.key for mutant in mutants}:
            print(f"no longer exists: {key}")
    tests = [f"tests/{name}" for name in TESTS if (ROOT / "tests" / name).exists()]
    tests += sorted({str(file.relative_to(ROOT)) for file in files.values()})  # doctests
    statements, seconds, left_out = _in_process(lambda: _record(files, tests), 7200)
    print(f"{len(mutants)} mutants, {len(sample)} drawn; {len(statements)} tests", flush=True)
    results = []
    for mutant in sample:
        if time.monotonic() > end:
            break
        outcome, test = judge(files, mutant, statements, seconds)
        results.append({**asdict(mutant), "key": mutant.key, "outcome": outcome, "test": test})
        print(f"{outcome:12} {mutant.module}:{mutant.number}: {mutant.change}", flush=True)
        answer = {"seed": options.seed, "left_out": left_out, "mutants": results}
        options.json.write_text(json.dumps(answer, indent=1))
    print(shares(results))
    if options.like:
        compare(results, earlier)


if __name__ == "__main__":
    main()
