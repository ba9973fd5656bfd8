"""How parameters change the variety of grafts: share exchanged and differences between grafts."""

from dataclasses import replace
from itertools import pairwise

import pytest

import mograft as mg
from mograft.dancer import dance
from mograft.solve.plan import GraftPlan

SIGMA_SCALES = (0.02, 0.3, 0.5, 0.75, 1.0, 1.5, 2.5, 5.0)


@pytest.fixture(scope="module", params=[1, 2])
def library(request):
    return mg.Library.build(dance(seed=request.param, strides=2).motion)


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
