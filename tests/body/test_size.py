"""Figures of one hierarchy in different units: lengths of donors are scaled to the base."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import mograft as mg
from mograft.body.size import describe_sizes
from mograft.dancer import dance
from mograft.scenario.scenario import Scenario, realize_scenario
from tests.strategies import few_examples, transform_motion


@pytest.fixture(scope="module")
def clips():
    """Return two short dances, in which the spine also moves along its bone."""
    found = []
    for seed in range(2):
        motion = dance(seed=seed, strides=1).motion[:300]
        positions = motion.positions.copy()
        spine = motion.skeleton.index("Spine")
        positions[:, spine, 1] += np.sin(0.1 * np.arange(motion.n_frames))
        found.append(replace(motion, positions=positions, channel_values=None, name=f"clip{seed}"))
    return found


# Powers of two scale numbers exactly, so that every choice and every bit must be the same.
FACTORS = st.lists(st.integers(-6, 6).map(lambda power: 2.0**power), min_size=2, max_size=2)


@pytest.fixture(scope="module")
def plain(clips):
    """Return libraries of these clips by base group: "lower" holds the root, "upper" does not."""
    preset = mg.JointGroups.preset("lower_upper", clips[0].skeleton)
    members = {name: own.tolist() for name, own in preset.resolve(clips[0].skeleton).items()}
    groups = {base: mg.JointGroups(members, base=base) for base in members}
    return {base: mg.Library.build(clips, own) for base, own in groups.items()}


def in_units(library, factors):
    """Return the library of clips in other units."""
    clips = [transform_motion(*own) for own in zip(library.clips, factors, strict=True)]
    return mg.Library.build(clips, library.groups)


@pytest.mark.parametrize("base", ["lower", "upper"])
@few_examples(6)
@given(factors=FACTORS, chosen=st.integers(0, 1), seed=st.integers(0, 99))
@pytest.mark.filterwarnings("ignore:legs are not as long")
def test_graft_clips_in_other_units_equals_scaled_graft(plain, base, factors, chosen, seed):
    library = plain[base]
    expected = mg.graft(library, f"clip{chosen}", seed=seed)
    found = mg.graft(in_units(library, factors), f"clip{chosen}", seed=seed)
    assert any(own.donor != own.segment for own in expected.substitutions)
    assert (found.motion.rotations == expected.motion.rotations).all()
    assert (found.motion.positions == factors[chosen] * expected.motion.positions).all()


@few_examples(3)
@given(factors=FACTORS, first=st.integers(0, 1))
@pytest.mark.filterwarnings("ignore:legs are not as long")
def test_scenario_clips_in_other_units_has_the_size_of_the_first(plain, factors, first):
    library = plain["lower"]
    segments = np.flatnonzero(library.segments.start > 50)[::7]
    segments = segments[np.argsort(library.segments.clip[segments] != first, kind="stable")]
    expected, _ = realize_scenario(library, Scenario(segments))
    found, _ = realize_scenario(in_units(library, factors), Scenario(segments))
    assert (found.positions == factors[first] * expected.positions).all()


@given(st.lists(st.sampled_from([0.01, 0.3, 0.9, 1.0, 1.2, 3.0, 17.2]), min_size=1, max_size=6))
def test_describe_sizes_names_exactly_the_figures_of_another_size(factors):
    skeleton = dance(strides=1).motion.skeleton
    named = {f"<{i}>": skeleton.with_offsets(f * skeleton.offsets) for i, f in enumerate(factors)}
    median = sorted(factors)[(len(factors) - 1) // 2]
    expected = {f"<{i}>" for i, f in enumerate(factors) if max(f / median, median / f) > 2.0}
    lines = describe_sizes(named)
    assert len(lines) == bool(expected)
    assert {name for name in named for line in lines if f"{name} (" in line} == expected
