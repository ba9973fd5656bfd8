"""How parameters change the variety of grafts: share exchanged and differences between grafts."""

import warnings
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import pytest

import mograft as mg
from mograft.dancer import dance
from mograft.synthesis.graft_plan import GraftPlan

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
SIGMA_SCALES = (0.3, 0.5, 0.75, 1.0, 1.5, 2.5, 5.0)


@pytest.fixture(scope="module", params=["dance 1", "dance 2", "dance_carousel_pair", "bandai_ds1"])
def library(request):
    if request.param.startswith("dance "):
        return mg.Library.build(dance(seed=int(request.param[-1]), strides=2).motion)
    files = sorted((DATA / request.param).rglob("*.bvh"))
    if not files:
        pytest.skip(f"{request.param} is not at hand below {DATA}")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # resampled clips, recording faults
        motions = [mg.read_bvh(file) for file in files]
        same = [own for own in motions if own.skeleton.names == motions[0].skeleton.names]
        return mg.Library.build(same[:6])


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
    shares = [
        exchanged_share(library.relabelled(replace(config, sigma_scale=scale)))
        for scale in SIGMA_SCALES
    ]
    assert all(wider >= narrower - 0.02 for narrower, wider in pairwise(shares)), shares
    assert shares[-1] > 0.9 > shares[0]
