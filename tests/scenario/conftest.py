"""The dancer's library and its transition graph, built once."""

import pytest

from mograft import Library
from mograft.dancer import dance
from mograft.scenario import transitions


@pytest.fixture(scope="package")
def library():
    return Library.build(dance(seed=1, strides=1).motion)


@pytest.fixture(scope="package")
def graph(library):
    return transitions(library)
