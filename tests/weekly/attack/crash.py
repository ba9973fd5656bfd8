"""Experiments with interrupted writes; each yields the defects of every trial, "" if none."""

import contextlib
import errno
import io
import os
import shutil
import signal
import tempfile
import time
from pathlib import Path

import numpy as np

from mograft import LibraryError, write_bvh
from mograft.dancer import dance
from tests.exit_codes import exit_code
from tests.weekly.attack import commands, faults
from tests.weekly.attack.lost_writes import Disk

# Kinds of faults, their error, and at how many calls one is tried: at each, or at each fourth.
_FAULTS = [("kill", 0, 1), ("fail once", errno.EIO, 1), ("fail from", errno.EIO, 4)]
_FAULTS += [("fail once", number, 4) for number in (errno.ENOSPC, errno.EACCES, errno.EINTR)]
_LOSSES = ((0.0, 0.0), (1.0, 0.0), (0.5, 0.5))  # probabilities of names and data to be kept
_CODE_OF_SIGNAL = {signal.SIGINT: 130, signal.SIGTERM: 143, signal.SIGKILL: -9}
_START_SECONDS = 0.25


def make_inputs(folder):
    """Write clips to the folder ``in``, a library and the record of a graft to ``made``."""
    motion = dance(seed=5, strides=1).motion
    (folder / "in").mkdir()
    write_bvh(motion[:60], folder / "in/a.bvh")
    write_bvh(motion[90:150], folder / "in/b.bvh")
    run_here("index in -o made/l", folder)
    run_here("graft in/a.bvh -o made/g.bvh", folder)


def absolute(words, folder):
    """Return the words of a command with absolute paths."""
    starts = ("in/", "made/", "work/")
    return [str(folder / w) if f"{w}/".startswith(starts) else w for w in words.split()]


def run_here(words, folder):
    """Run a command in this process; it must succeed."""
    texts = io.StringIO()
    with contextlib.redirect_stdout(texts), contextlib.redirect_stderr(texts):
        assert exit_code(absolute(words, folder)) == 0, texts.getvalue()


class Attack:
    """A command in a folder, its old and new state, and its run without faults."""

    def __init__(self, folder, command):
        self.command, self.template, self.work = command, folder / "template", folder / "work"
        self._checked = set()  # folders from which the next start was tried
        make_inputs(folder)
        self.work.mkdir()
        if command.prepare:
            run_here(command.prepare, folder)
        self.old = commands.visible_state(self.work)
        shutil.copytree(self.work, self.template)
        run_here(command.words, folder)  # so that the forks need not import its modules
        self.whole = self.run()
        assert self.whole.code == 0, self.whole.output
        self.new = commands.visible_state(self.work)

    def restore(self):
        """Restore the old state."""
        shutil.rmtree(self.work)
        shutil.copytree(self.template, self.work)

    def run(self, *fault, **options):
        """Run the command from its old state; see `faults.run`."""
        self.restore()
        words = absolute(self.command.words, self.work.parent)
        return faults.run(words, self.work, *fault, **options)

    def check(self, run, what, *defects, codes=(*commands.CODES, -signal.SIGKILL)):
        """Return the defects of the state after a run, and of the next start, as a message."""
        found = "; ".join([*filter(None, defects), *self._find_defects(run, codes)])
        return found and f"{self.command.name}, {what}: {found}"

    def _find_defects(self, run, codes):
        if problem := commands.complaint(run.code, run.output, run.output, codes):
            yield problem
        try:
            state = commands.visible_state(self.work)
        except (LibraryError, OSError, ValueError) as error:
            yield f"the state cannot be read: {error}"
            return
        if not self.command.resumes:
            yield from commands.differences(state, self.old, self.new)
        if run.code == 0 and state != self.new:
            yield "the command succeeded, but the state is not new"
        tree = commands.hash_tree(self.work)
        if tree in self._checked or (self.command.keeps and state == self.new):
            return  # the next start from the same files was tried, or would be refused
        self._checked.add(tree)
        words = absolute(self.command.again(self.work), self.work.parent)
        again = faults.run(words, self.work)
        if again.code:
            yield f"the next start fails: {again.output[-300:]}"
        elif commands.visible_state(self.work) != self.new:
            yield "the state after the next start is not new"
        elif debris := commands.list_debris(self.work, self.new):
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
        debris = commands.list_debris(attack.work, attack.old | attack.new)
        defects = [f"leaves {debris}" if debris else "", "exit code 0" if is_unseen else ""]
        yield attack.check(run, f"full after {count} bytes", *defects)


def random_signals(attack, scale):
    """End the program or its group by signals at random moments, 10 % of them during start-up."""
    rng, words = np.random.default_rng(0), absolute(attack.command.words, attack.work.parent)
    attack.restore()
    begin = time.monotonic()
    commands.start(words, attack.work.parent).communicate()
    seconds = time.monotonic() - begin
    for _ in range(max(1, round(20 * scale))):
        attack.restore()
        number = list(_CODE_OF_SIGNAL)[rng.integers(3)]
        is_early, to_group = rng.random() < 0.1, rng.random() < 0.5
        moment = rng.uniform(0.03, _START_SECONDS) if is_early else rng.uniform(0.1, seconds)
        process = commands.start(words, attack.work.parent)
        time.sleep(moment)
        (os.killpg if to_group else os.kill)(process.pid, number)
        _, text = process.communicate()
        run = faults.Run(process.returncode, text, moment, 0, 0, [])
        known = attack.old | attack.new
        debris = number != signal.SIGKILL and not attack.command.resumes
        debris = debris and commands.list_debris(attack.work, known)
        yield attack.check(
            run,
            f"{number.name} after {moment:.2f} s, group {to_group}",
            f"leaves {debris}" if debris else "",
            codes=(0, _CODE_OF_SIGNAL[number]),
        )


def try_commands(experiment, scale, names=None):
    """Yield the trials of an experiment with all commands, or those with the given names.

    `scale` is the share of calls, or of signals, that are tried.
    """
    memory = "/dev/shm"  # what is not synced is lost in the model, not on the disk
    for command in commands.COMMANDS:
        if names is None or command.name in names:
            with tempfile.TemporaryDirectory(dir=memory if os.path.isdir(memory) else None) as own:
                yield from experiment(Attack(Path(own), command), scale)
