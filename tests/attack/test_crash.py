"""Law of every command that writes: after any fault the state is old or new, and nothing remains.

Faults are failed and interrupted calls, losses of what was not synced, full disks and kills.
"""

import contextlib
import tempfile
from pathlib import Path

import pytest

from tests.attack.crash import CrashHarness
from tests.attack.write_paths import WRITE_PATHS

_BY_NAME = {path.name: path for path in WRITE_PATHS}
_KILLS = {"index": 100, "index --add": 100, "index --force": 100}
_OTHER_KILLS = 40


@contextlib.contextmanager
def open_harness(paths):
    # In memory if possible: what is not synced is lost in the model, not on the disk.
    memory = Path("/dev/shm")
    temporary = tempfile.TemporaryDirectory(dir=memory if memory.is_dir() else None)
    with temporary as folder, CrashHarness(Path(folder), paths) as harness:
        yield harness


@pytest.fixture(scope="module")
def quick():
    with open_harness([_BY_NAME["groups"]]) as harness:
        yield harness


@pytest.fixture(scope="module")
def harness():
    with open_harness(WRITE_PATHS) as harness:
        yield harness


def test_failed_calls_leave_an_old_or_new_file(quick):
    outcome = quick.faults(_BY_NAME["groups"], every=3)
    assert outcome.trials > 10
    assert outcome.failures == []


def test_losses_of_what_was_not_synced_leave_an_old_or_new_file(quick):
    outcome = quick.losses(_BY_NAME["groups"], every=3)
    assert outcome.trials > 10
    assert outcome.failures == []


@pytest.mark.thorough
@pytest.mark.parametrize("path", WRITE_PATHS, ids=list(_BY_NAME))
@pytest.mark.parametrize("kind", ["faults", "losses"])
def test_every_call_of_every_command_can_fail_or_end(harness, path, kind):
    outcome = getattr(harness, kind)(path)
    assert outcome.trials > harness.baseline(path).run.calls
    assert outcome.failures == []


@pytest.mark.thorough
@pytest.mark.parametrize("path", WRITE_PATHS, ids=list(_BY_NAME))
def test_full_disk_at_every_write_leaves_the_old_state(harness, path):
    outcome = harness.full_disk(path, every_byte=path.name == "groups")
    assert outcome.trials > 3
    assert outcome.failures == []


@pytest.mark.thorough
@pytest.mark.parametrize("path", WRITE_PATHS, ids=list(_BY_NAME))
def test_kills_at_random_moments_leave_an_old_or_new_state(harness, path):
    outcome = harness.random_kills(path, _KILLS.get(path.name, _OTHER_KILLS))
    assert outcome.failures == []
