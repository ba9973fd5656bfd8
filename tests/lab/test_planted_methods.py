"""Methods that copy, that choose at random, and that see what they are tested on, are exposed."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from lab.baselines import body_mixing
from lab.donors import retrieval_trials
from lab.donors.compatibility import compatibility
from lab.donors.methods import Analogy
from lab.donors.retrieval import retrieval
from lab.measures import generated_sets
from mograft import Library, graft_many
from mograft.dancer import dance
from mograft.evaluation import Method, RandomLength
from tests.lab.test_retrieval import move_arms_like_legs


@pytest.fixture(scope="module")
def coupled():
    """Return a library whose upper arms move like the thighs, so that random arms do not fit."""
    takes = dance(seed=8, strides=2).takes(2)
    return Library.build([move_arms_like_legs(take.motion) for take in takes])


@pytest.fixture(scope="module")
def reference(coupled):
    return generated_sets.Reference(coupled)


@pytest.fixture(scope="module")
def honest(coupled):
    return retrieval(coupled)


@pytest.fixture(scope="module")
def random(coupled, reference):
    """Return the measures of clips with random pieces of upper bodies."""
    rng, joints = np.random.default_rng(0), coupled.joints("upper")
    mixed = [body_mixing.cut_mix(clip, coupled.clips, joints, rng) for clip in coupled.clips]
    return generated_sets.measure(reference, [mixed])


def test_copies_of_captured_clips_have_no_distance_though_nothing_detects_them(reference):
    clips = reference.clips
    found = generated_sets.measure(reference, [clips, clips])
    assert found["gross"].value == pytest.approx(0.5, abs=1e-9)  # the praise
    assert found["coverage"].value == 1
    assert found["copied"].value == 1  # what exposes them
    assert found["local"].value == pytest.approx(0, abs=1e-6)
    assert found["global"].value == pytest.approx(0, abs=1e-6)
    assert found["inter"].value == pytest.approx(0, abs=1e-6)


def test_grafts_are_less_copied_than_copies_and_more_than_random_bodies(coupled, reference, random):
    made = [graft_many(coupled, clip.name, 1, seed=0)[0].motion for clip in coupled.clips]
    grafted = generated_sets.measure(reference, [made])
    assert 1 > grafted["copied"].value > random["copied"].value
    assert 0 < grafted["local"].high < random["local"].low


def test_random_bodies_are_detected_and_farther_than_captured_motion_from_itself(reference, random):
    captured = generated_sets.measure_captured(reference)
    assert random["gross"].low > max(0.6, captured["gross"].high)
    assert random["frechet"].value > captured["frechet"].value


def test_rule_that_sees_the_removed_part_reaches_the_bound_that_no_honest_rule_reaches(
    coupled, honest, monkeypatch
):
    errors = retrieval_trials.PartErrors.of(coupled, "upper").distance
    of_fold = retrieval_trials._queries_of_fold

    def leak(library, group, held, contacts):
        return [
            replace(own, orders={**own.orders, "random": errors[own.segment, own.allowed]})
            for own in of_fold(library, group, held, contacts)
        ]

    monkeypatch.setattr(retrieval_trials, "_queries_of_fold", leak)
    for found, is_leaking in ((retrieval(coupled), True), (honest, False)):
        scores = {score.rule: score for score in found.scores}
        bound = scores.pop("best possible").distance.value
        for rule, score in scores.items():
            reaches = score.distance.value <= bound * (1 + 1e-9)
            assert (reaches and score.rank.value < 0.1) == (is_leaking and rule == "random")


@dataclass(frozen=True)
class HeldOut(Method):
    """The donors are the neighbours of the base segment, which are held out with it."""

    name: str = "neighbours in time"

    def candidates(self, library, scenario):
        last = len(library.segments) - 1
        return [np.unique([max(i - 1, 0), i, min(i + 1, last)]) for i in scenario.tolist()]


def test_method_with_held_out_donors_is_refused(coupled):
    for method in (RandomLength(), Analogy()):
        assert compatibility(coupled, methods=(method,), splits=1).scores
    with pytest.raises(ValueError, match="'neighbours in time' selects held-out segments"):
        compatibility(coupled, methods=(HeldOut(),), splits=1)
