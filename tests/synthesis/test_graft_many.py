"""Several motions: their number, newness and variety, and the memory that they need."""

from dataclasses import replace
from itertools import combinations, pairwise, product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import mograft as mg
from mograft._util import memory
from mograft.cli import main
from mograft.config import scale_of_variety, variety_of_scale
from mograft.dancer import dance
from mograft.motion import rotations
from mograft.solve.plan import GraftPlan
from mograft.synthesis import graft as graft_module
from mograft.synthesis.graft import MEMORY_FACTOR
from mograft.synthesis.newness import newness
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


@pytest.fixture(scope="module")
def graft():
    return mg.graft(mg.Library.build(dance(seed=2, strides=1).motion), seed=1)


def turned(graft, angle, frames=slice(None)):
    """The graft's base with all exchanged joints turned by an angle in some frames."""
    joints, quats = graft.library.joints("upper"), graft.base.rotations.copy()
    turn = rotations.exp(np.array([0.0, angle, 0.0]))
    for joint in joints:
        quats[frames, joint] = rotations.multiply(quats[frames, joint], turn)
    motion = replace(graft.base, rotations=quats, channel_values=None, name=f"turned{angle}")
    return replace(graft, motion=motion)


@few_examples(20)
@given(angle=st.floats(0.0, 3.0), share=st.floats(0.0, 1.0))
def test_turned_joints_are_measured(graft, angle, share):
    n = round(share * graft.base.n_frames)
    found = newness(turned(graft, angle, slice(n)))
    assert found.changed == pytest.approx(angle * n / graft.base.n_frames, abs=1e-6)
    if abs(angle - np.radians(5.0)) > 1e-6:
        assert found.new == (n / graft.base.n_frames if angle > np.radians(5.0) else 0.0)
    assert (found.apart, found.nearest) == (None, "")


@few_examples(20)
@given(angles=st.lists(st.floats(0.0, 1.5), min_size=2, max_size=5, unique=True))
def test_nearest_other_motion_is_named(graft, angles):
    own, *others = (turned(graft, angle) for angle in angles)
    found = newness(own, [graft.base[:10], *(other.motion for other in others)])
    gap = min(abs(angles[0] - angle) for angle in angles[1:])
    assert found.apart == pytest.approx(gap, abs=1e-6)
    assert found.nearest in {other.motion.name for other in others}
    assert f"° from {found.nearest}" in str(found)
    assert found.as_dict()["apart"] == found.apart


@few_examples(8)
@given(degrees=st.floats(0.5, 40.0), seed=st.integers(0, 100))
def test_distinct_motions_are_apart_and_keep_their_order(graft, degrees, seed):
    library, joints = graft.library, graft.library.joints("upper")
    library = library.relabelled(replace(library.config, self_repair=False))
    options = {"seed": seed, "widen": False, "distinct": np.radians(degrees)}
    grafts = mg.graft_many(library, count=4, **options)
    motions = [own.motion.rotations[:, joints] for own in grafts]
    for one, two in combinations(motions, 2):
        cosines = np.abs((one * two).sum(axis=-1)).clip(max=1.0)
        assert np.degrees(2 * np.arccos(cosines).mean()) >= degrees - 1e-3
    first = mg.graft_many(library, count=1, seed=seed)[0]
    np.testing.assert_array_equal(grafts[0].motion.rotations, first.motion.rotations)


@pytest.mark.parametrize("distinct", [-0.1, 4.0, True, "1", float("nan")])
def test_distinct_that_is_no_angle_raises_value_error(graft, distinct):
    with pytest.raises(ValueError, match="`distinct` must be an angle from 0 to π"):
        mg.graft_many(graft.library, count=2, distinct=distinct)


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


@given(st.integers(0, 1 << 40), st.integers(0, 1 << 40))
def test_check_memory_refuses_exactly_what_is_large_and_does_not_fit(n_bytes, available):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(memory._core, "available_memory", lambda: available)
        if n_bytes > available and n_bytes > 1 << 28:
            with pytest.raises(mg.MemoryBudgetError, match=r"work needs about .* available: less"):
                memory.check_memory("work", n_bytes, "less")
        else:
            memory.check_memory("work", n_bytes, "less")


def test_graft_that_does_not_fit_is_refused_by_name(monkeypatch, tmp_path, capsys):
    motion = dance(strides=1).motion
    library = mg.Library.build(motion)
    n_numbers = motion.rotations.size + motion.positions.size + motion.channel_numbers().size
    needed = MEMORY_FACTOR * 8 * n_numbers
    monkeypatch.setattr(memory, "_MAX_UNCHECKED_BYTES", 0)
    monkeypatch.setattr(memory._core, "available_memory", lambda: needed)
    mg.graft(library)
    monkeypatch.setattr(memory._core, "available_memory", lambda: needed - 1)
    message = rf"a graft on dance with {motion.n_frames} frames needs about 0\.\d GB"
    for base in (None, "dance", motion):
        with pytest.raises(mg.MemoryBudgetError, match=message) as caught:
            mg.graft(library, base)
        assert isinstance(caught.value, MemoryError)
    mg.write_bvh(motion, tmp_path / "dance.bvh")
    assert main(["graft", str(tmp_path / "dance.bvh"), "-o", str(tmp_path / "new.bvh")]) == 1
    assert "GB of memory" in capsys.readouterr().err
