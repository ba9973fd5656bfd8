"""Law of every command that writes: after any fault the state is old or new, and nothing remains.

Faults are failed and interrupted calls, losses of what was not synced, full disks and kills. The
thorough run of all commands is `python -m tests.weekly.attack`.
"""

import pytest

from tests.weekly.attack import crash
from tests.weekly.attack.write_paths import WRITE_PATHS

_SMALL = [path for path in WRITE_PATHS if path.name == "groups"]


@pytest.mark.parametrize(
    ("experiment", "scale"),
    [(crash.failed_calls, 0.5), (crash.lost_writes, 0.3), (crash.full_disks, 0.02)],
)
def test_faults_of_a_small_command_leave_an_old_or_new_file(experiment, scale):
    outcome = crash.try_all(experiment, scale, _SMALL)
    assert outcome.trials > 5
    assert outcome.failures == []


@pytest.mark.thorough
@pytest.mark.parametrize(
    "experiment", [crash.failed_calls, crash.lost_writes, crash.full_disks, crash.random_kills]
)
def test_faults_of_all_commands_leave_an_old_or_new_state(experiment):
    outcome = crash.try_all(experiment, 0.1)
    assert outcome.trials >= 10
    assert outcome.failures == []
