"""Fixtures of the tests of the laboratory."""

import pytest

pytest.importorskip("sklearn", reason="scikit-learn is not installed")

from lab.donors import classifier
from tests.evaluation.conftest import library, single_clip_library, small_library

__all__ = ["library", "single_clip_library", "small_library"]


@pytest.fixture(autouse=True, scope="package")
def small_parameter_grid():
    """Replace the parameter grid, whose search takes most of the time."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(classifier, "PARAMETER_GRID", {"C": (10.0,), "gamma": (0.03,)})
        yield
