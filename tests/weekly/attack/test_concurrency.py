"""Law of threads: every public function gives the results of one thread, from any number."""

import inspect

import pytest

import mograft as mg
from mograft import Library, write_bvh
from mograft.dancer import dance
from tests.weekly.attack.concurrency import CALLS, EXEMPT, compare_threads


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A library of three short clips."""
    clips = tmp_path_factory.mktemp("clips")
    motion = dance(seed=5, strides=1).motion
    for number in range(3):
        write_bvh(motion[number * 90 : number * 90 + 160], clips / f"{number}.bvh")
    Library.index(clips, clips / "l")
    return clips / "l"


def test_calls_hold_every_public_function():
    spaces = (mg, mg.clustering, mg.formats)
    functions = {n for own in spaces for n in own.__all__ if inspect.isfunction(getattr(own, n))}
    assert functions - set(CALLS) - set(EXEMPT) == set()
    assert set(EXEMPT) <= functions


def test_threads_on_one_library_give_the_results_of_one(folder):
    outcome = compare_threads(folder, n_threads=2)
    assert outcome.trials == 2 * len(CALLS)
    assert outcome.failures == []


@pytest.mark.thorough
def test_eight_threads_many_times_give_the_results_of_one(folder):
    assert compare_threads(folder, rounds=10).failures == []
