"""Comparison with an independent measure of grafts, where it is at hand beside the checkout.

``../shared/quality`` has its own kinematics, features and classifiers.
"""

import importlib
import sys
from pathlib import Path

import numpy as np
import pytest

from lab.donors.donor_methods import RandomLength, grafts_by
from mograft import read_bvh
from mograft.evaluation.detectability import detectability
from mograft.evaluation.novelty import novelty
from mograft.evaluation.world_measures import WorldReference
from tests.evaluation.planted import ByCost

pytest.importorskip("sklearn", reason="scikit-learn is not installed")
pytest.importorskip("scipy", reason="SciPy is not installed")

SHARED = Path(__file__).parents[3] / "shared"
METHODS = (
    ByCost(),
    ByCost("trunk on pelvis", config_changes=(("torso", "pelvis"),)),
    RandomLength(),
)


@pytest.fixture(scope="module")
def reference():
    """Return the modules of the independent measure, by name."""
    if not (SHARED / "quality" / "physics.py").exists():
        pytest.skip(f"the independent measure is not at hand in {SHARED / 'quality'}")
    names = ("sources", "physics", "c2st", "novelty")
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(SHARED / "quality"))
        yield {name: importlib.import_module(name) for name in names}
        for name in (*names, "figure"):
            sys.modules.pop(name, None)


@pytest.fixture(scope="module")
def source(reference):
    """Return the recordings of one dance as the independent measure reads them."""
    files = sorted((SHARED / "data" / "dance_cmu60_salsa").glob("*.bvh"))
    if not files:
        pytest.skip("the recordings dance_cmu60_salsa are missing")
    return reference["sources"].Source("salsa", [read_bvh(file) for file in files])


@pytest.fixture(scope="module")
def grafts(source):
    """Return for each method the grafts on each clip."""
    clips = [clip.name for clip in source.base.clips]
    return [[list(grafts_by(method, source.base, name, 4)) for name in clips] for method in METHODS]


@pytest.fixture(scope="module")
def theirs(reference, source, grafts):
    """Return the grafts of each method as the independent measure represents them."""
    made = reference["sources"].made
    return [
        [made(source, clip, graft) for clip, own in enumerate(several) for graft in own]
        for several in grafts
    ]


def same_order(first, second):
    return (np.argsort(first) == np.argsort(second)).all()


def test_head_jerk_agrees_with_independent_measure(reference, source, grafts, theirs):
    physics = reference["physics"].Physics(source)
    world = WorldReference(source.base)
    expected, found = [], []
    for several, own in zip(grafts, theirs, strict=True):
        flat = [graft for base in several for graft in base]
        expected.append([physics.whole([graft])["head"] for graft in own])
        found.append([world.measure(graft).head_jerk for graft in flat])
    assert np.corrcoef(np.ravel(expected), np.ravel(found))[0, 1] > 0.9
    means = np.mean(expected, axis=1), np.mean(found, axis=1)
    assert means[1] == pytest.approx(means[0], rel=0.15)
    assert same_order(*means)


def test_novelty_agrees_with_independent_measure(reference, source, grafts, theirs):
    judge = reference["novelty"].Novelty(source)
    expected = [judge.of(source, own) for own in theirs]
    found = [novelty(several) for several in grafts]
    for ours, name in (("novelty", "local"), ("coverage", "coverage"), ("between", "between")):
        values = [getattr(own, ours).value for own in found]
        assert values == pytest.approx([own[name] for own in expected], rel=0.1), ours


@pytest.mark.thorough
def test_detectability_agrees_with_independent_measure(reference, source, grafts, theirs):
    judge = reference["c2st"]
    data = [judge.dataset(source, "seam", own) for own in theirs]
    expected = [judge.auc(own, repeats=2) for own in data]
    found = [detectability("x", several) for several in grafts]
    for name in ("gross", "fine"):
        theirs_auc = [own[name][0] for own in expected]
        ours = [getattr(own.seams, name).value for own in found]
        assert ours == pytest.approx(theirs_auc, abs=0.1), name
        assert same_order(theirs_auc, ours), name
    for own in found:
        for null in (own.other_moments, own.donor_windows):
            assert abs(null.gross.value - 0.5) < 0.1
