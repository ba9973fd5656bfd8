"""The attacks of `tests.weekly.outside` with few trials."""

import shutil

import pytest

from tests.weekly.outside.attacks import ATTACKS, attack

pytestmark = pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler")
_QUICK = ("hostile_texts",)


@pytest.mark.parametrize(
    "name",
    [
        own.__name__
        if own.__name__ in _QUICK
        else pytest.param(own.__name__, marks=pytest.mark.thorough)
        for own in ATTACKS
    ],
)
def test_few_trials_have_no_failure(name):
    results = list(attack(name, 0.01, 0))
    assert all(n_trials for _, n_trials, _ in results)
    assert [failure for *_, failures in results for failure in failures] == []
