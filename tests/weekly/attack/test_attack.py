"""The experiments of `tests.weekly.attack` with few trials, and the table of their results."""

import inspect
import re

import pytest

import mograft as mg
from tests.weekly.attack import experiments, faults
from tests.weekly.attack.__main__ import COMMANDS, MARKS, OTHERS, PAGE, find_experiment
from tests.weekly.attack.concurrency import CALLS, EXEMPT, compare_threads

_QUICK = ("cut_texts", "repeated_calls", "hostile_texts")


@pytest.mark.parametrize(
    "name", [n if n in _QUICK else pytest.param(n, marks=pytest.mark.thorough) for n in OTHERS]
)
def test_few_trials_have_no_failure(name, tmp_path):
    trials = list(find_experiment(name)(tmp_path.resolve(), 25))
    assert len(trials) >= 20
    assert not any(trials)


@pytest.mark.parametrize(
    ("name", "scale", "commands"),
    [
        *(("failed_calls", 0.05, own) for own in ("index", "index --add", "augment npz")),
        *(("lost_writes", 0.05, "index --add"), ("full_disks", 0.05, "index --add")),
        *(pytest.param(name, 0.1, None, marks=pytest.mark.thorough) for name in COMMANDS),
    ],
)
def test_faults_of_commands_leave_an_old_or_new_state(name, scale, commands):
    words = ["tests.weekly.attack", "--only", name, "--scale", str(scale)]
    process = faults.start([*words, *(["--commands", commands] if commands else [])])
    trials, failures = re.findall(r"\| ([\d,]+) \| (\d+) \|", process.stdout)[0]
    assert int(trials.replace(",", "")) > 5
    assert failures == "0", process.stderr
    assert process.returncode == 0


def test_page_has_the_results_of_all_experiments_without_failure():
    begin, end = MARKS
    table = PAGE.read_text(encoding="utf-8").partition(begin)[2].partition(end)[0]
    rows = re.findall(r"^\| (.+?)(?: \(one in \d+\))? \| [\d,]+ \| 0 \|$", table, re.MULTILINE)
    assert rows == [*COMMANDS.values(), *(title for _, title in OTHERS.values())]


def test_calls_hold_every_public_function():
    spaces = (mg, mg.clustering, mg.formats)
    functions = {n for own in spaces for n in own.__all__ if inspect.isfunction(getattr(own, n))}
    assert functions - set(CALLS) - set(EXEMPT) == set()
    assert set(EXEMPT) <= functions


def test_threads_on_one_library_give_the_results_of_one(tmp_path):
    found = compare_threads(experiments.make_library(tmp_path, n_clips=3), n_threads=2)
    assert len(found) == 2 * len(CALLS)
    assert not any(found)
