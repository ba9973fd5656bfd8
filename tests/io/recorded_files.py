"""Recorded and unusual BVH files outside of the repository; tests skip if they are absent."""

from pathlib import Path

import pytest

SHARED = Path(__file__).parents[3] / "shared"
DATA, ODD = SHARED / "data", SHARED / "odd"
RECORDINGS = sorted(DATA.glob("*/*.bvh")) or [None]
ODD_FILES = sorted(ODD.glob("*.bvh")) or [None]


def file_id(path):
    return "none" if path is None else f"{path.parent.name}/{path.stem}"


def require(path, folder):
    if path is None or not path.exists():
        pytest.skip(f"no such files in {folder}")
    return path
