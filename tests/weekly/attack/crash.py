"""Experiments with interrupted writes; each yields the defects of every trial, "" if none."""

import contextlib
import errno
import io
import os
import shutil
import tempfile
from pathlib import Path

import numpy as np

from mograft import LibraryError, write_bvh
from mograft.dancer import dance
from tests.exit_codes import exit_code
from tests.weekly.attack import faults, write_paths
from tests.weekly.attack.lost_writes import Disk

# Kinds of faults, their error, and at how many calls one is tried: at each, or at each fourth.
_FAULTS = [("kill", 0, 1), ("fail once", errno.EIO, 1)]
_FAULTS += [("fail once", errno.ENOSPC, 4), ("fail from", errno.EIO, 4)]
_LOSSES = ((0.0, 0.0), (1.0, 0.0), (0.5, 0.5))  # probabilities of names and data to be kept


class Attack:
    """A command of `write_paths` in a folder, its old and new state, and its run without faults."""

    def __init__(self, folder, path):
        self.path, self.template, self.work = path, folder / "template", folder / "work"
        self._checked = set()  # folders from which the next start was tried
        motion = dance(seed=5, strides=1).motion
        for name in ("in", "work"):
            (folder / name).mkdir()
        write_bvh(motion[:60], folder / "in/a.bvh")
        write_bvh(motion[90:150], folder / "in/b.bvh")
        self._run_here("index in/a.bvh -o in/l")
        if path.prepare:
            self._run_here(path.prepare)
        self.old = write_paths.visible_state(self.work)
        shutil.copytree(self.work, self.template)
        self._run_here(path.again)  # so that the forks need not import its modules
        self.whole = self.run()
        assert self.whole.code == 0, self.whole.output
        self.new = write_paths.visible_state(self.work)

    def _fill(self, words):
        is_path = ("in/", "work/")
        folder = self.work.parent
        return [str(folder / w) if f"{w}/".startswith(is_path) else w for w in words.split()]

    def _run_here(self, words):
        texts = io.StringIO()
        with contextlib.redirect_stdout(texts), contextlib.redirect_stderr(texts):
            assert exit_code(self._fill(words)) == 0, texts.getvalue()

    def run(self, *fault, **options):
        """Run the command from its old state; see `faults.run`."""
        shutil.rmtree(self.work)
        shutil.copytree(self.template, self.work)
        return faults.run(self._fill(self.path.words), self.work, *fault, **options)

    def check(self, run, what, *defects):
        """Return the defects of the state after a run, and of the next start, as a message."""
        found = "; ".join([*filter(None, defects), *self._find_defects(run)])
        return found and f"{self.path.name}, {what}: {found}"

    def _find_defects(self, run):
        try:
            state = write_paths.visible_state(self.work)
        except (LibraryError, OSError, ValueError) as error:
            yield f"the state cannot be read: {error}"
            return
        if not write_paths.is_allowed(state, self.old, self.new):
            yield f"the state is neither old nor new: {sorted(state)}"
        if run.code == 0 and state != self.new:
            yield "the command succeeded, but the state is not new"
        if "Traceback" in run.output:
            yield f"traceback: {run.output[-300:]}"
        tree = write_paths.hash_tree(self.work)
        if tree in self._checked:
            return  # the next start from the same files was tried
        self._checked.add(tree)
        again = faults.run(self._fill(self.path.again), self.work)
        if again.code:
            yield f"the next start fails: {again.output[-300:]}"
        elif write_paths.visible_state(self.work) != self.new:
            yield "the state after the next start is not new"
        elif debris := write_paths.list_debris(self.work, self.new):
            yield f"the next start leaves {debris}"


def failed_calls(attack, scale):
    """Fail a share of the calls in turn, once or for good, or end the process before them."""
    every = round(1 / scale)
    for call in range(1, attack.whole.calls + 1, every):
        for mode, number, further in _FAULTS:
            if call // every % further == 0:
                run = attack.run(mode, call, errno=number)
                missed = "no fault" if run.faults == 0 and run.calls >= call else ""
                what = f"{mode} at call {call} ({errno.errorcode.get(number)})"
                yield attack.check(run, what, missed)


def lost_writes(attack, scale):
    """End the process at a share of the calls in turn, and lose what was not synced."""
    rng, last = np.random.default_rng(0), attack.whole.calls + 1  # at the last, the command ends
    for call in [*range(1, last, round(1 / scale)), last]:
        run, disk = attack.run("kill", call), Disk(attack.work, attack.template)
        disk.replay(run.log)
        for kept in _LOSSES:
            disk.write_lost(rng, *kept)
            yield attack.check(run, f"losses after call {call - 1}, keeping {kept}")


def full_disks(attack, scale):
    """Let writes fail after numbers of bytes: each of a small output, else around every write."""
    sizes = [int(line[1]) for line in attack.whole.log if line[0] == "write"]
    stops = np.cumsum([0, *sizes])
    counts = np.unique([stops - 1, stops, stops + 1, stops + np.append(sizes, 0) // 2])
    if stops[-1] < 2_000:
        counts = np.arange(stops[-1] + 1)
    for count in counts[counts >= 0][:: round(1 / scale)].tolist():
        run = attack.run("full", count)
        is_unseen = run.code == 0 and count < stops[-1]
        debris = write_paths.list_debris(attack.work, attack.old | attack.new)
        defects = [f"leaves {debris}" if debris else "", "exit code 0" if is_unseen else ""]
        yield attack.check(run, f"full after {count} bytes", *defects)


def random_kills(attack, scale):
    """Kill at random moments: 100 times commands that write libraries, 40 times others."""
    rng, count = np.random.default_rng(0), 100 if "work/l" in attack.path.words else 40
    for _ in range(max(1, round(scale * count))):
        delay = float(rng.uniform(0.0, 1.1 * attack.whole.seconds))
        yield attack.check(attack.run(seconds=delay), f"killed after {delay:.4f} s")


def try_commands(experiment, scale, names=None):
    """Yield the trials of an experiment with all commands, or those with the given names.

    `scale` is the share of calls, or of kills, that are tried.
    """
    memory = "/dev/shm"  # what is not synced is lost in the model, not on the disk
    for path in write_paths.WRITE_PATHS:
        if names is None or path.name in names:
            with tempfile.TemporaryDirectory(dir=memory if os.path.isdir(memory) else None) as own:
                yield from experiment(Attack(Path(own), path), scale)
