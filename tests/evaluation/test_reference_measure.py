"""Comparison with an independent measure of grafts, where it is at hand beside the checkout.

``../shared/quality`` has its own kinematics, features and classifiers.
"""

import importlib
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from lab.donors.methods import ByCost
from mograft import read_bvh
from mograft.evaluation import RandomLength, grafts_by
from mograft.evaluation.detectability import detectability
from mograft.evaluation.novelty import novelty

pytest.importorskip("sklearn", reason="scikit-learn is not installed")

SHARED = Path(__file__).parents[3] / "shared"
MODULES = ("sources", "c2st", "novelty")
METHODS = (
    ByCost(),
    ByCost("trunk on pelvis", config_changes=(("torso", "pelvis"),)),
    RandomLength(),
)


@pytest.fixture(scope="module")
def reference():
    """Return the independent measure, the recordings, and for each method its grafts there."""
    files = sorted((SHARED / "data" / "dance_cmu60_salsa").glob("*.bvh"))
    if not files or not (SHARED / "quality" / "novelty.py").exists():
        pytest.skip(f"the independent measure or its recordings are not at hand in {SHARED}")
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(SHARED / "quality"))
        found = SimpleNamespace(**{name: importlib.import_module(name) for name in MODULES})
        source = found.source = found.sources.Source("salsa", [read_bvh(file) for file in files])
        clips = [clip.name for clip in source.base.clips]
        found.grafts = [[list(grafts_by(m, source.base, c, 4)) for c in clips] for m in METHODS]
        found.theirs = [
            [found.sources.made(source, i, graft) for i, own in enumerate(several) for graft in own]
            for several in found.grafts
        ]
        yield found
        for name in (*MODULES, "figure"):
            sys.modules.pop(name, None)


def test_novelty_agrees_with_independent_measure(reference):
    judge = reference.novelty.Novelty(reference.source)
    expected = [judge.of(reference.source, own) for own in reference.theirs]
    found = [novelty(several) for several in reference.grafts]
    for ours, name in (("novelty", "local"), ("coverage", "coverage"), ("between", "between")):
        values = [getattr(own, ours).value for own in found]
        assert values == pytest.approx([own[name] for own in expected], rel=0.1), ours


@pytest.mark.thorough
def test_detectability_agrees_with_independent_measure(reference):
    judge, source = reference.c2st, reference.source
    expected = [
        judge.auc(judge.dataset(source, "seam", own), repeats=2) for own in reference.theirs
    ]
    found = [detectability("x", several) for several in reference.grafts]
    for name in ("gross", "fine"):
        theirs = [own[name][0] for own in expected]
        ours = [getattr(own.seams, name).value for own in found]
        assert ours == pytest.approx(theirs, abs=0.1), name
        assert np.argmin(ours) == np.argmin(theirs), name
    nulls = [null for own in found for null in (own.other_moments, own.donor_windows)]
    assert [null.gross.value for null in nulls] == pytest.approx([0.5] * len(nulls), abs=0.1)
