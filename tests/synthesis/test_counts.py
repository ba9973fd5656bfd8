"""How many motions there are: limits that are known before the search, and the best attempt."""

from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import mograft as mg
from mograft.config import scale_of_variety, variety_of_scale
from mograft.dancer import dance
from mograft.solve.plan import GraftPlan
from mograft.synthesis import graft as graft_module
from tests.strategies import few_examples

SHORT = dance(seed=1, strides=1).motion[:60]


@st.composite
def plans(draw):
    n_frames = draw(st.integers(20, 60))
    changes = {"sigma_scale": draw(st.sampled_from([0.01, 0.75, 2.0, 4.0]))}
    changes["choice"] = draw(st.sampled_from(["sample", "viterbi", "random"]))
    library = mg.Library.build(SHORT[:n_frames], config=mg.Config(**changes))
    return GraftPlan.build(library, None, None, ())


@few_examples(15)
@pytest.mark.filterwarnings("ignore:group")
@given(plans(), st.integers(1, 40))
def test_n_combinations_is_never_exceeded_and_counts_all_sequences(plan, count):
    donors = plan.choose_donors(count, 0)
    assert len(donors) <= plan.n_combinations
    size = np.prod([float(len(own)) for own in plan.problem.candidates["upper"]])
    assert plan.n_combinations == pytest.approx(size)
    if size <= 200:
        sequences = {tuple(own) for own in product(*plan.problem.candidates["upper"])}
        assert len(sequences) == plan.n_combinations
        assert {tuple(own["upper"].tolist()) for own in donors} <= sequences


@pytest.mark.filterwarnings("ignore:group")
def test_graft_many_more_motions_than_exist_warns_with_their_number():
    library = mg.Library.build(SHORT[:20], config=mg.Config(sigma_scale=0.01))
    plan = GraftPlan.build(library, None, None, ())
    with pytest.warns(UserWarning, match=f"^at most {plan.n_combinations} different motions"):
        grafts = mg.graft_many(library, count=plan.n_combinations + 1, widen=False)
    assert len(grafts) <= plan.n_combinations


@pytest.mark.filterwarnings("ignore:at most")
@given(st.lists(st.integers(1, 9), min_size=6, max_size=6))
def test_graft_many_widening_keeps_the_attempt_with_most_motions(sizes):
    library, left = mg.Library.build(SHORT), list(sizes)

    def choose(plan, *_):
        donors = plan.problem.captured_donors
        return (donors,) * left.pop(0)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(graft_module, "_choose_donors", choose)
        grafts = mg.graft_many(library, count=10)
    tried = len(sizes) - len(left)
    assert tried == 6  # 0.75 · (4/3)^5 is the last scale of at most 4
    assert len(grafts) == max(sizes)
    last_best = tried - 1 - sizes[::-1].index(max(sizes))
    scale = grafts._plan.config.sigma_scale
    assert scale == pytest.approx(0.75 * (4 / 3) ** last_best)
    assert ("is kept" in grafts.notes[-1]) == (last_best < tried - 1)
    assert "sigma_scale" not in " ".join(grafts.notes)


@given(st.floats(0.0, 1.0))
def test_variety_of_scale_inverts_scale_of_variety(variety):
    assert np.isclose(variety_of_scale(scale_of_variety(variety)), variety, atol=1e-12)
