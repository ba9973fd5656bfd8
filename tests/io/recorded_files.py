"""Recorded and unusual files outside of the repository; tests skip if they are absent."""

import pytest

from tests.hierarchies import DATA

ODD = DATA.parent / "odd"
RECORDINGS = sorted(DATA.glob("*/*.bvh"))
ODD_FILES = sorted(ODD.glob("*.bvh"))


def require(path):
    if not path.exists():
        pytest.skip(f"the file {path.name} is missing")
    return path
