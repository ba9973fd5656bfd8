"""Experiments with interrupted writes; each returns the number of trials and the failures."""

import errno
import shutil
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mograft import LibraryError, write_bvh
from mograft.dancer import dance
from tests.weekly.attack.faults import FaultServer
from tests.weekly.attack.lost_writes import Disk
from tests.weekly.attack.outcome import Outcome
from tests.weekly.attack.write_paths import (
    WRITE_PATHS,
    hash_tree,
    list_debris,
    reset,
    visible_state,
)

# Kinds of faults, their error, and at how many calls one is tried: at each, or at each fourth.
_FAULTS = (
    ("kill", 0, 1),
    ("fail once", errno.EIO, 1),
    ("fail once", errno.ENOSPC, 4),
    ("fail from", errno.EIO, 4),
)
_LOSSES = ((0.0, 0.0), (1.0, 0.0), (0.5, 0.5))  # probabilities of names and data to be kept


@dataclass(frozen=True)
class Baseline:
    """A command without faults: the states before and after it, its run, and the visible names."""

    old: dict[str, str]
    new: dict[str, str]
    run: object


class CrashHarness:
    """Runs the commands of `write_paths` with faults in a folder; a context manager."""

    def __init__(self, folder, paths=WRITE_PATHS, n_frames=60):
        self._folder, self.trial = folder, folder / "trial"
        self.paths, self._n_frames = paths, n_frames
        self._baselines = {}
        self._checked = set()  # folders from which the next start was tried

    def __enter__(self):
        motion = dance(seed=5, strides=1).motion
        inputs = self.trial / "in"
        inputs.mkdir(parents=True)
        for number, name in enumerate(("a", "b")):
            start = 90 * number
            write_bvh(motion[start : start + self._n_frames], inputs / f"{name}.bvh")
        warm_folder = self._folder / "warm"
        shutil.copytree(inputs, warm_folder / "in")
        (warm_folder / "work").mkdir()
        commands = [["index", str(inputs / "a.bvh"), "-o", str(inputs / "l")]]
        commands.append(["index", str(warm_folder / "in/a.bvh"), "-o", str(warm_folder / "in/l")])
        for path in self.paths:
            commands += [path.fill(words, warm_folder) for words in (*path.prepare, path.again)]
        self._server = FaultServer(self._folder, commands).__enter__()
        return self

    def __exit__(self, *_):
        self._server.__exit__()

    def _template(self, path):
        return self._folder / "templates" / path.name.replace(" ", "")

    def baseline(self, path):
        """Return the `Baseline` of a write path."""
        if path.name not in self._baselines:
            template = self._template(path)
            work = self.trial / "work"
            shutil.rmtree(work, ignore_errors=True)
            work.mkdir(parents=True)
            for words in path.prepare:
                run = self._server.run(path.fill(words, self.trial), work)
                assert run.code == 0, run.output
            shutil.copytree(work, template / "work")
            old = visible_state(work)
            run = self._server.run(path.fill(path.words, self.trial), work, has_log=True)
            assert run.code == 0, run.output
            self._baselines[path.name] = Baseline(old, visible_state(work), run)
        return self._baselines[path.name]

    def _run(self, path, *arguments, **options):
        reset(self.trial, self._template(path))
        words = path.fill(path.words, self.trial)
        return self._server.run(words, self.trial / "work", *arguments, **options)

    def _check(self, path, run, what, outcome):
        """Check the state after a run, and that the next start works and leaves no debris."""
        work, baseline = self.trial / "work", self.baseline(path)
        outcome.trials += 1

        def fail(message):
            outcome.failures.append(f"{path.name}, {what}: {message}")

        try:
            state = visible_state(work)
        except (LibraryError, OSError, ValueError) as error:
            fail(f"the state cannot be read: {error}")
            return
        if not path.allows(state, baseline.old, baseline.new):
            fail(f"the state is neither old nor new: {sorted(state)}")
        if run.code == 0 and state != baseline.new:
            fail("the command succeeded, but the state is not new")
        if "Traceback" in run.output:
            fail(f"traceback: {run.output[-300:]}")
        tree = (path.name, hash_tree(work))
        if tree in self._checked:
            return  # the next start from the same files was tried
        self._checked.add(tree)
        again = self._server.run(path.fill(path.again, self.trial), work)
        if again.code:
            fail(f"the next start fails: {again.output[-300:]}")
            return
        if visible_state(work) != baseline.new:
            fail("the state after the next start is not new")
        debris = list_debris(work, baseline.new)
        if debris:
            fail(f"the next start leaves {debris}")

    def faults(self, path, every=1):
        """Fail each `every`-th call in turn, once or for good, or end the process before it."""
        outcome = Outcome()
        for call in range(1, self.baseline(path).run.calls + 1, every):
            for mode, number, further in _FAULTS:
                if call // every % further:
                    continue
                run = self._run(path, mode, call, errno=number)
                what = f"{mode} at call {call} ({errno.errorcode.get(number)})"
                self._check(path, run, what, outcome)
                if run.faults == 0 and run.calls >= call:
                    outcome.failures.append(f"{path.name}: no fault at call {call}")
        return outcome

    def losses(self, path, every=1, seed=0):
        """End the process at each `every`-th call in turn, and lose what was not synced."""
        outcome, rng = Outcome(), np.random.default_rng(seed)
        last = self.baseline(path).run.calls + 1  # without a kill: the command ends
        for call in [*range(1, last, every), last]:
            reset(self.trial, self._template(path))
            disk = Disk(self.trial / "work")
            words = path.fill(path.words, self.trial)
            run = self._server.run(words, self.trial / "work", "kill", call, has_log=True)
            disk.replay(run.log)
            disk.load()
            for keep_names, keep_data in _LOSSES:
                disk.write_lost(rng, keep_names=keep_names, keep_data=keep_data)
                what = f"losses after call {call - 1}, keeping {keep_names} {keep_data}"
                self._check(path, run, what, outcome)
        return outcome

    def full_disk(self, path, every=1, *, every_byte=False):
        """Let writes fail after numbers of bytes: every one, or before, in and after each write."""
        outcome, baseline = Outcome(), self.baseline(path)
        sizes = [int(line[1]) for line in baseline.run.log if line[0] == "write"]
        stops = np.cumsum([0, *sizes])
        counts = np.unique([stops - 1, stops, stops + 1, stops + np.append(sizes, 0) // 2])
        if every_byte:
            counts = np.arange(stops[-1] + 1)
        visible = {name.split("/")[0] for name in (*baseline.old, *baseline.new)}
        for count in counts[counts >= 0][::every].tolist():
            run = self._run(path, "full", count)
            debris = {entry.name for entry in (self.trial / "work").iterdir()} - visible
            if debris:
                outcome.failures.append(f"{path.name}, full at {count}: leaves {debris}")
            if run.code == 0 and count < stops[-1]:
                outcome.failures.append(f"{path.name}, full at {count}: exit code 0")
            self._check(path, run, f"full after {count} bytes", outcome)
        return outcome

    def random_kills(self, path, count, seed=0):
        """Kill the process at random moments of its run."""
        outcome, rng = Outcome(), np.random.default_rng(seed)
        seconds = self.baseline(path).run.seconds
        for _ in range(count):
            delay = float(rng.uniform(0.0, 1.1 * seconds))
            run = self._run(path, seconds=delay)
            self._check(path, run, f"killed after {delay:.4f} s", outcome)
        return outcome


def try_all(experiment, scale, paths=WRITE_PATHS):
    """Return the outcome of an experiment of `CrashHarness` for all commands.

    `scale` is the share of calls, or of kills, that are tried.
    """
    outcome = Outcome()
    memory = Path("/dev/shm")  # what is not synced is lost in the model, not on the disk
    temporary = tempfile.TemporaryDirectory(dir=memory if memory.is_dir() else None)
    with temporary as folder, CrashHarness(Path(folder), paths) as harness:
        for path in paths:
            outcome.add(experiment(harness, path, scale))
    return outcome


def failed_calls(harness, path, scale):
    """Fail calls in turn; see `CrashHarness.faults`."""
    return harness.faults(path, round(1 / scale))


def lost_writes(harness, path, scale):
    """Lose what was not synced; see `CrashHarness.losses`."""
    return harness.losses(path, round(1 / scale))


def full_disks(harness, path, scale):
    """Fill the disk: at every byte for the smallest command, else around every write."""
    return harness.full_disk(path, round(1 / scale), every_byte=path.name == "groups")


def random_kills(harness, path, scale):
    """Kill at random moments: 100 times commands that write libraries, 40 times others."""
    count = 100 if path.name.startswith("index") else 40
    return harness.random_kills(path, max(1, round(scale * count)))
