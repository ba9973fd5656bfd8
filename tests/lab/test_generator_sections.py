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
from tests.lab.test_baseline_generators import assert_only_joints_change

NUMBERS, ERRORS = st.floats(-100, 100), st.floats(0, 10)


class Kept(NamedTuple):
    """The part of a substitution that `keep_own` reads."""

    group: str
    segment: int
    is_own: bool


def as_estimate(value, error):
    return {"value": value, "interval": [value - Z * error, value + Z * error], "n": 10, "of": "x"}


def error_of(estimate):
    low, high = estimate["interval"]
    return pytest.approx((high - low) / (2 * Z), abs=1e-9)


@pytest.fixture(scope="module")
def recordings():
    return Recordings("dancer", tuple(take.motion for take in dance(seed=4, strides=2).takes(3)))


@given(NUMBERS, ERRORS, st.integers(1, 9))
def test_pool_equal_sources_divides_the_error_by_the_root(value, error, n):
    pooled = pool([as_estimate(value, error)] * n)
    assert pooled["value"] == pytest.approx(value)
    assert pooled["n"] == 10 * n
    assert error / math.sqrt(n) == error_of(pooled)


@given(NUMBERS, NUMBERS, ERRORS, ERRORS)
def test_subtract_adds_the_variances(first, second, error, other_error):
    found = subtract(as_estimate(first, error), as_estimate(second, other_error))
    assert found["value"] == pytest.approx(first - second)
    assert math.hypot(error, other_error) == error_of(found)


def test_pool_missing_interval_leaves_no_interval():
    unknown, missing = (as_estimate(1.0, 0.0) | {"interval": None, "value": v} for v in (1.0, None))
    assert pool([as_estimate(2.0, 1.0), unknown])["interval"] is None
    assert pool([as_estimate(2.0, 1.0), missing])["value"] == 2.0
    assert pool([missing])["value"] is None


def test_treat_every_treatment_has_the_same_donors(recordings):
    library = recordings.library
    chosen = seam_tests.choose_donors(library, 2)
    treated = {name: seam_tests.treat(library, chosen, name) for name in seam_tests.TREATMENTS}
    donors = {
        tuple((own.group, own.segment, own.donor) for graft in own for own in graft.substitutions)
        for own in treated.values()
    }
    assert len(donors) == 1
    assert len({grafts[0].motion.rotations.tobytes() for grafts in treated.values()}) == len(
        treated
    )


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
            assert_only_joints_change(motion, base, studio.joints, 0.1)


def test_noise_of_studio_turns_joints_by_two_degrees(recordings):
    studio = catalogue.Studio(recordings.library, recordings)
    (motion,), seconds = studio.make(catalogue.Generator("noise", "noise", ""), 0, 1)
    angles = np.degrees(rotations.angle(motion.rotations, recordings.library.clips[0].rotations))
    assert np.sqrt((angles**2).mean()) == pytest.approx(catalogue.NOISE_DEGREES, rel=0.05)
    assert seconds > 0


@pytest.mark.thorough
def test_generators_measure_renders_every_row(recordings, monkeypatch):
    names = ("graft", "CutMix", "noise")
    chosen = tuple(own for own in catalogue.GENERATORS if own.name in names)
    monkeypatch.setattr(catalogue, "GENERATORS", chosen)
    monkeypatch.setattr(generators, "QUICK", names)
    value = generators.measure(recordings, is_quick=True)
    low, high = value["captured"]["gross"]["interval"]
    assert low < 0.5 < high
    assert value["noise"]["fine"]["value"] > 0.9
    assert value["graft"]["skate"]["value"] == value["CutMix"]["skate"]["value"]
    tables = generators.tables({"gestures": value, "perfume": value})
    for use in ("test", "development"):
        rows = tables[f"realism-{use}"].rows
        assert [row[0] for row in rows] == ["captured", *names]
        assert "nan" not in str(rows)
