"""The sections that compare generators and seam treatments: donors, pooled numbers, text."""

import math
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lab.baselines import catalogue
from lab.experiments import generators, seam_tests
from lab.experiments.pooling import Z, pool, subtract
from lab.experiments.sources import Recordings
from mograft import rotations
from mograft.dancer import dance

NUMBERS = st.floats(-100, 100)


class Kept(NamedTuple):
    """The part of a substitution that `keep_own` reads."""

    group: str
    segment: int
    is_own: bool


def as_estimate(value, error, n=10):
    return {"value": value, "interval": [value - Z * error, value + Z * error], "n": n, "of": "x"}


@pytest.fixture(scope="module")
def recordings():
    return Recordings("dancer", tuple(take.motion for take in dance(seed=4, strides=2).takes(3)))


@given(NUMBERS, st.floats(0, 10), st.integers(1, 9))
def test_pool_equal_sources_divides_the_error_by_the_root(value, error, n):
    pooled = pool([as_estimate(value, error)] * n)
    assert pooled["value"] == pytest.approx(value)
    assert pooled["n"] == 10 * n
    low, high = pooled["interval"]
    assert (high - low) / (2 * Z) == pytest.approx(error / math.sqrt(n), abs=1e-9)


@given(NUMBERS, NUMBERS, st.floats(0, 10), st.floats(0, 10))
def test_subtract_adds_the_variances(first, second, error, other_error):
    found = subtract(as_estimate(first, error), as_estimate(second, other_error))
    assert found["value"] == pytest.approx(first - second)
    low, high = found["interval"]
    assert (high - low) / (2 * Z) == pytest.approx(math.hypot(error, other_error), abs=1e-9)


def test_pool_missing_interval_leaves_no_interval():
    unknown = {"value": 1.0, "interval": None, "n": 3, "of": "x"}
    missing = {"value": None, "interval": None, "n": 0, "of": "x"}
    assert pool([as_estimate(2.0, 1.0), unknown])["interval"] is None
    assert pool([as_estimate(2.0, 1.0), missing])["value"] == 2.0
    assert pool([missing])["value"] is None


def test_treat_every_treatment_has_the_same_donors(recordings):
    library = recordings.library
    chosen = seam_tests.choose_donors(library, 2)
    treated = {name: seam_tests.treat(library, chosen, name) for name in seam_tests.TREATMENTS}
    donors = [
        [(own.group, own.segment, own.donor) for graft in grafts for own in graft.substitutions]
        for grafts in treated.values()
    ]
    assert all(own == donors[0] for own in donors)
    first = [grafts[0].motion.rotations for grafts in treated.values()]
    for index, motion in enumerate(first):
        assert all(not np.array_equal(motion, other) for other in first[:index])


@given(st.data(), st.integers(1, 12))
def test_keep_own_keeps_exactly_the_segments_that_are_kept(data, n):
    is_own = data.draw(st.lists(st.booleans(), min_size=n, max_size=n))
    drawn = np.arange(100, 100 + n)
    kept = [Kept("upper", segment, own) for segment, own in enumerate(is_own)]
    donors = catalogue.keep_own(kept, {"upper": drawn})["upper"]
    np.testing.assert_array_equal(donors, np.where(is_own, np.arange(n), drawn))
    np.testing.assert_array_equal(drawn, np.arange(100, 100 + n))


def test_same_segments_and_random_donors_change_the_recording(recordings):
    studio = catalogue.Studio(recordings.library, recordings)
    base = recordings.library.clips[0]
    for motions in (studio.same_segments(0, 2), studio.random_donors(0, 2)):
        for motion in motions:
            new, old = (own.rotations[:, studio.joints] for own in (motion, base))
            assert rotations.angle(new, old).mean() > 0.1
            kept = np.setdiff1d(np.arange(base.n_joints), studio.joints)
            np.testing.assert_array_equal(motion.rotations[:, kept], base.rotations[:, kept])


@pytest.mark.thorough
def test_generators_measure_renders_every_row(recordings, monkeypatch):
    chosen = tuple(own for own in catalogue.GENERATORS if own.name in ("graft", "CutMix", "noise"))
    monkeypatch.setattr(catalogue, "GENERATORS", chosen)
    monkeypatch.setattr(generators, "QUICK", tuple(own.name for own in chosen))
    value = generators.measure(recordings, is_quick=True)
    assert (
        value["captured"]["gross"]["interval"][0] < 0.5 < value["captured"]["gross"]["interval"][1]
    )
    assert value["noise"]["fine"]["value"] > 0.9
    assert value["graft"]["skate"]["value"] == value["CutMix"]["skate"]["value"]
    tables = generators.tables({"gestures": value, "perfume": value})
    for use in ("test", "development"):
        rows = tables[f"realism-{use}"].rows
        assert [row[0] for row in rows] == ["captured", "graft", "CutMix", "noise"]
        assert "nan" not in str(rows)


@pytest.mark.thorough
def test_seam_tests_measure_renders_every_treatment(recordings):
    value = seam_tests.measure(recordings, is_quick=True)
    low, high = value["auc"]["captured, other moments"]["gross"]["interval"]
    assert low <= 0.5 <= high
    rows = seam_tests.tables({"gestures": value})["auc-test"].rows
    assert {row[0] for row in rows} == {*seam_tests.TREATMENTS, *seam_tests.NULLS}


def test_noise_of_studio_turns_joints_by_two_degrees(recordings):
    studio = catalogue.Studio(recordings.library, recordings)
    (motion,), seconds = studio.make(catalogue.Generator("noise", "noise", ""), 0, 1)
    angles = np.degrees(rotations.angle(motion.rotations, recordings.library.clips[0].rotations))
    assert np.sqrt((angles**2).mean()) == pytest.approx(catalogue.NOISE_DEGREES, rel=0.05)
    assert seconds > 0
