"""Features of parts of the classifier of pairs."""

from dataclasses import replace

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from lab.donors.part_features import part_features
from mograft import Library, rotations
from mograft.dancer import dance
from tests.strategies import SEEDS, transform_motion

CLIP = dance(seed=7, strides=1).motion[:300]
LIBRARY = Library.build(CLIP)


def perturb(joints, rng):
    """Return the clip with random rotations of joints, and a random path if the root is one."""
    quats = CLIP.rotations.copy()
    noise = rotations.exp(rng.normal(size=(len(CLIP), len(joints), 3)) * 0.5)
    quats[:, joints] = rotations.multiply(quats[:, joints], noise)
    positions = CLIP.positions.copy()
    if 0 in joints:
        positions[:, 0] += rng.normal(size=(len(CLIP), 3)) * 10
    return replace(CLIP, rotations=quats, positions=positions, channel_values=None)


@settings(max_examples=10)
@given(SEEDS)
def test_part_features_perturbed_group_leaves_other_group_unchanged(seed):
    rng = np.random.default_rng(seed)
    before = {group: part_features(LIBRARY, group) for group in ("lower", "upper")}
    for changed, unchanged in (("upper", "lower"), ("lower", "upper")):
        other = replace(LIBRARY, clips=(perturb(LIBRARY.joints(changed), rng),))
        np.testing.assert_allclose(part_features(other, unchanged), before[unchanged], atol=1e-9)
        assert np.abs(part_features(other, changed) - before[changed]).max() > 1e-3


@settings(max_examples=10)
@given(st.floats(-3, 3), st.floats(-500, 500), st.floats(0.01, 50))
def test_part_features_transformed_motion_are_unchanged(yaw, x, scale):
    other = replace(LIBRARY, clips=(transform_motion(CLIP, scale, yaw, (x, 0.0, -x)),))
    for group in ("lower", "upper"):
        found, expected = part_features(other, group), part_features(LIBRARY, group)
        np.testing.assert_allclose(found, expected, atol=1e-6)
