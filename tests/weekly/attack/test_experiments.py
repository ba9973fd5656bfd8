"""The experiments of `tests.weekly.attack` with few trials, and the table of their results."""

import re
from pathlib import Path

import pytest

from tests.weekly.attack.__main__ import COMMANDS, MARKS, OTHERS, PAGE

_QUICK = (
    *("damaged_texts", "cut_texts", "damaged_libraries"),
    *("small_linkages", "repeated_calls"),
)
# Trials of the first hostile review of the project; the table has at least as many.
_LEAST = {
    "random_kills": 118,
    "full_disks": 34,
    "opens_during_rewrites": 315,
    "damaged_libraries": 973,
    "damaged_texts": 22_423,
    "cut_texts": 20_070,
    "small_linkages": 3_400,
    "repeated_calls": 5_220,
    "grafts_in_workers": 360,
    "hostile_pages": 24,
}


@pytest.mark.parametrize("name", _QUICK)
def test_few_trials_have_no_failure(name, tmp_path):
    outcome = OTHERS[name][0](tmp_path, 25)
    assert outcome.trials >= 20
    assert outcome.failures == []


@pytest.mark.thorough
@pytest.mark.parametrize("name", sorted(set(OTHERS) - set(_QUICK)))
def test_few_trials_of_slow_experiments_have_no_failure(name, tmp_path):
    outcome = OTHERS[name][0](tmp_path, 25)
    assert outcome.trials >= 20
    assert outcome.failures == []


def test_page_has_the_results_of_all_experiments_without_failure():
    begin, end = MARKS
    table = Path(PAGE).read_text(encoding="utf-8").partition(begin)[2].partition(end)[0]
    rows = dict(re.findall(r"^\| (.+?)(?: \(one in \d+\))? \| ([\d,]+) \| 0 \|$", table, re.M))
    titles = {name: own[-1] for name, own in (COMMANDS | OTHERS).items()}
    assert set(rows) == set(titles.values())
    for name, least in _LEAST.items():
        assert int(rows[titles[name]].replace(",", "")) >= least, name
