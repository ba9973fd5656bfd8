"""Fixtures of the tests of evaluation."""

import pytest

from lab.donors.methods import ByCost, makers
from mograft import Config, Library
from mograft.dancer import dance
from mograft.evaluation import RandomLength, evaluate


@pytest.fixture(scope="package")
def library():
    """Return a library of two dance clips."""
    return Library.build([take.motion for take in dance(seed=8, strides=1).takes(2)])


@pytest.fixture(scope="package")
def single_clip_library():
    """Return a library of one dance clip."""
    return Library.build(dance(seed=7, strides=1).motion)


@pytest.fixture(scope="package")
def small_library():
    """Return a library of three dance clips with 1,000 frames."""
    takes = [take.motion for take in dance(seed=9, strides=1)[:1000].takes(3)]
    # With balls the donors are from too many blocks for the tests of detectability.
    return Library.build(takes, config=Config(neighbourhood="cluster"))


@pytest.fixture(scope="package")
def evaluation(small_library):
    """Return an evaluation of all topics with two methods."""
    pytest.importorskip("sklearn", reason="scikit-learn is not installed")
    methods = (RandomLength(), ByCost())
    return evaluate(small_library, methods=makers(methods), runs=2, bases=1, seed=1)
