"""Fixtures of the tests of the laboratory, which are left out where its packages are missing."""

from importlib.util import find_spec

import pytest

from tests.evaluation.conftest import library, single_clip_library, small_library

__all__ = ["library", "single_clip_library", "small_library"]
collect_ignore_glob = []
if not all(map(find_spec, ("matplotlib", "scipy", "sklearn"))):
    collect_ignore_glob = ["test_*.py"]


@pytest.fixture(autouse=True, scope="package")
def small_parameter_grid():
    """Replace the parameter grid, whose search takes most of the time."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("lab.donors.classifier.PARAMETER_GRID", {"C": (1.0, 10.0), "gamma": (0.03,)})
        yield
