"""No graft takes a part from a copy of its base, however the copy came into the library."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import mograft as mg
import mograft.constraints as mc
from mograft.body.mirroring import mirror
from mograft.dancer import dance
from mograft.search.copies import COPY_ANGLE
from tests.strategies import few_examples, transform_motion

COPIES = {
    "renamed": lambda take: take,
    "piece": lambda take: take[300:700],
    "rescaled": lambda take: transform_motion(take, scale=0.01),
    "turned": lambda take: transform_motion(take, yaw=1.3, offset=(50.0, 0.0, 9.0)),
    "mirrored": lambda take: mirror(mirror(take)),
    "resampled": lambda take: take.resample(120).resample(30),
}


def shares_of_copies(graft):
    """Whether each exchanged segment has the base's poses in all frames; joints of one group."""
    base, motion = graft.base.rotations, graft.motion.rotations
    cosines = np.abs((base * motion).sum(-1))[:, graft.library.joints("upper")]
    angles = 2 * np.arccos(np.clip(cosines, 0.0, 1.0))
    spans = [angles[s.start : s.stop + 1] for s in graft.substitutions if not s.is_own]
    return [bool((span <= COPY_ANGLE).all()) for span in spans]


@pytest.mark.filterwarnings("ignore:legs are not as long")
@pytest.mark.parametrize("neighbourhood", ["cluster", "ball"])
@pytest.mark.parametrize("name", COPIES)
@few_examples(3)
@given(seed=st.integers(0, 1000))
def test_graft_on_a_clip_with_a_copy_takes_nothing_from_it(name, neighbourhood, seed):
    take = dance(seed=seed, strides=1).motion
    config = mg.Config(neighbourhood=neighbourhood, self_repair=False, choice="random")
    twin = replace(COPIES[name](take), name="copy", channel_values=None)
    library = mg.Library.build([take, twin], config=config)
    for graft in mg.graft_many(library, "copy", 2, seed=seed):
        copies = shares_of_copies(graft)
        assert copies
        assert not any(copies)


@few_examples(5)
@given(seed=st.integers(0, 1000), groups=st.sampled_from(["lower_upper", "upper_lower"]))
def test_are_copies_equals_comparison_of_all_pairs(seed, groups):
    """Also in groups with the root: the oracle compares the samples of all joints."""
    take = dance(seed=seed, strides=1).motion[:400]
    jitter = mg.rotations.exp(np.random.default_rng(seed).normal(0, 0.002, (400, 18, 3)))
    rough = replace(take, rotations=mg.rotations.multiply(take.rotations, jitter), name="rough")
    twin = replace(COPIES["turned"](take), name="twin")
    library = mg.Library.build([take, twin, replace(rough, channel_values=None)])
    group = {"lower_upper": "upper", "upper_lower": "lower"}[groups]
    n = len(library.segments)
    base, donors = (own.ravel() for own in np.indices((n, n)))
    quats = library.samples.rotations[:, :, library.joints(group)]
    expected = np.zeros((n, n), bool)
    for row in range(n):
        cosines = np.abs((quats[row] * quats).sum(-1)).clip(0, 1)
        expected[row] = (2 * np.arccos(cosines) <= COPY_ANGLE).all(axis=(1, 2))
    np.fill_diagonal(expected, val=False)
    found = library.pool(group).parts.are_copies(base, donors)
    np.testing.assert_array_equal(found.reshape(n, n), expected)
    assert expected.sum() >= len(library.segments.of_clip(0))


def test_use_of_a_copy_is_kept_and_candidates_refuse_it_with_its_reason():
    take = dance(seed=1, strides=1).motion
    library = mg.Library.build([take, replace(take, name="copy")])
    twin = len(library.segments.of_clip(0)) + 5
    graft = mg.graft(library, constraints=[mc.Use(5, twin)])
    assert graft.substitutions[5].donor == twin
    assert not graft.violations
    found = mg.candidates(library, 5, "upper")
    (refused,) = (own for own in found.refused if own.segment == twin)
    assert refused.refused == "copy: it moves the group as the base segment does"
    assert twin not in [own.segment for own in found.allowed]
