"""Fixtures of pages and reports: the dancer, its library and a graft."""

from dataclasses import replace

import pytest

from mograft import Library, graft
from mograft.dancer import dance
from tests.browser import chromium


@pytest.fixture(scope="package")
def motion():
    """The dancer, one bout of strides."""
    return dance(seed=1, strides=1).motion


@pytest.fixture(scope="package")
def takes():
    """Two takes of 420 frames."""
    return [replace(dance(seed=s, strides=1).motion[:420], name=f"take{s}") for s in range(2)]


@pytest.fixture(scope="package")
def library(motion):
    """The library of the dancer."""
    return Library.build(motion)


@pytest.fixture(scope="package")
def new(library):
    """A graft of the library."""
    return graft(library, seed=3)


@pytest.fixture(scope="module")
def browser():
    """A headless Chromium."""
    with chromium() as found:
        yield found
