"""Fixtures of the tests of file formats."""

import pytest

from mograft.dancer import dance


@pytest.fixture(scope="session")
def motion():
    """The first 90 frames of a dance."""
    return dance(seed=1, strides=1).motion[:90]
