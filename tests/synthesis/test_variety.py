"""How parameters change the variety of grafts: share exchanged and differences between grafts."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

import mograft as mg
import mograft.constraints as mc
from mograft.dancer import dance
from mograft.search.neighbourhoods import FEWEST_DONORS
from mograft.solve.plan import GraftPlan

SIGMA_SCALES = (0.02, 0.3, 0.5, 0.75, 1.0, 1.5, 2.5, 5.0)


@pytest.fixture(scope="module", params=[1, 2])
def library(request):
    return mg.Library.build(dance(seed=request.param, strides=2).motion)


@pytest.fixture(scope="module")
def dance_library():
    return mg.Library.build(dance(seed=1, strides=2).motion)


def exchanged_share(library):
    """Return the share of exchanged positions in the cheapest donor sequences of all clips."""
    n_exchanged = n_positions = 0
    for info in library.entries:
        plan = GraftPlan.build(library, info.name, None, ())
        for donors in plan.choose_donors(1, 0)[0].values():
            n_exchanged += (donors != plan.problem.scenario).sum()
            n_positions += len(donors)
    return n_exchanged / n_positions


def test_exchanged_share_does_not_fall_as_sigma_scale_grows(library):
    config = replace(library.config, choice="viterbi")
    configs = [replace(config, sigma_scale=scale) for scale in SIGMA_SCALES]
    shares = [exchanged_share(library.relabelled(own)) for own in configs]
    assert all(wider >= narrower - 0.02 for narrower, wider in pairwise(shares)), shares
    assert shares[-1] > 0.9 > shares[0]


def test_graft_takes_the_listed_candidates_of_the_ball(dance_library, tmp_path):
    dance_library.save(tmp_path / "lib")
    library = mg.Library.open(tmp_path / "lib")
    points, sigma = library.embedding["lower"].points, library.sigma["lower"]
    n_outside = 0
    for graft in mg.graft_many(library, count=2, seed=3):
        for own in graft.substitutions:
            distance = np.linalg.norm(points[own.donor] - points[own.segment])
            assert distance <= 2 * sigma
            n_outside += library.labels["lower"][own.donor] != library.labels["lower"][own.segment]
    assert n_outside
    for segment in range(0, len(library.segments), 40):
        found = mg.candidates(library, segment, "upper")
        listed = {own.segment for own in (*found.allowed, *found.refused)}
        distances = np.linalg.norm(points - points[segment], axis=1)
        beyond = [k for k in listed if distances[k] > sigma]
        assert set(np.flatnonzero(distances <= sigma)) | set(beyond) == listed
        assert len(beyond) <= FEWEST_DONORS
        assert not beyond or len(found.allowed) <= FEWEST_DONORS + 1
        assert found.elsewhere == len(points) - len(listed)
        ways = mg.candidates(library, segment, "upper", [mc.Avoid(mc.Sphere((0.0, 0.0, 0.0), 9e3))])
        assert {own.segment for own in ways.refused} == listed
