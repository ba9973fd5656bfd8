"""Properties of capsules; the oracle of distances compares dense points on both axes."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from mograft import EndSite, Skeleton
from mograft.body.capsules import Capsules, box_clearance, capsules, clearance
from mograft.motion import rotations
from tests.oracles.capsules import capsule_distances
from tests.strategies import SEEDS, quaternions, smooth_rotations, vectors

ALL_PAIRS = np.array([(i, j) for i in range(3) for j in range(2)])


def bodies(seed, *, flat=False):
    """Return 3 and 2 capsules in four frames; some have zero length, some are parallel."""
    rng = np.random.default_rng(seed)
    ends, others = rng.normal(size=(4, 3, 2, 3)), rng.normal(size=(4, 2, 2, 3))
    ends[0, 0, 1] = ends[0, 0, 0]
    others[1, 0, 1] = others[1, 0, 0]
    others[2, 1] = ends[2, 2] + rng.normal(size=3)
    if flat:  # in one plane, where axes cross
        ends[..., 2] = others[..., 2] = 0.0
    return ends, rng.uniform(0, 0.3, 3), others, rng.uniform(0, 0.3, 2)


def dense_points(capsule, n=300):
    share = np.linspace(0, 1, n)[:, None]
    return capsule[0] * (1 - share) + capsule[1] * share


@settings(max_examples=25, deadline=None)
@given(SEEDS, st.booleans())
def test_clearance_equals_smallest_of_single_pairs_to_the_last_bit(seed, flat):
    sets = bodies(seed, flat=flat)
    distance, which = clearance(*sets, None, ALL_PAIRS)
    single = np.array([clearance(*sets, None, pair[None])[0] for pair in ALL_PAIRS])
    np.testing.assert_array_equal(distance, single.min(axis=0))
    np.testing.assert_array_equal(which, ALL_PAIRS[single.argmin(axis=0)])


@settings(max_examples=25, deadline=None)
@given(SEEDS, st.sets(st.integers(0, 5)), st.booleans())
def test_clearance_of_given_pairs_matches_the_oracle(seed, selected, flat):
    ends, radii, others, other_radii = bodies(seed, flat=flat)
    pairs = ALL_PAIRS[sorted(selected)]
    distance, which = clearance(ends, radii, others, other_radii, None, pairs)
    exact = capsule_distances(ends, radii, others, other_radii)
    expected = exact[:, pairs[:, 0], pairs[:, 1]]
    np.testing.assert_allclose(distance, expected.min(axis=1, initial=np.inf), atol=1e-6)
    allowed = [tuple(pair) for pair in pairs.tolist()] or [(-1, -1)]
    assert {tuple(pair) for pair in which.tolist()} <= set(allowed)


def test_clearance_uses_given_frame_of_others():
    ends, radii, others, other_radii = bodies(3)
    frames = np.array([2, 0, 1, 1])
    distance, _ = clearance(ends, radii, others, other_radii, frames, ALL_PAIRS)
    expected, _ = clearance(ends, radii, others[frames], other_radii, None, ALL_PAIRS)
    np.testing.assert_array_equal(distance, expected)


@settings(max_examples=25, deadline=None)
@given(SEEDS, quaternions(()), vectors((), 0.5))
def test_box_clearance_matches_dense_points(seed, turn, center):
    ends, radii, _, _ = bodies(seed)
    half = np.random.default_rng(seed).uniform(0.05, 0.8, 3)
    found = box_clearance(ends, radii, center, half, turn)
    for frame in range(4):
        for i in range(3):
            points = dense_points(ends[frame, i]) - center
            local = rotations.rotate(np.tile(rotations.inverse(turn), (len(points), 1)), points)
            excess = np.abs(local) - half
            outside = np.linalg.norm(np.maximum(excess, 0), axis=1)
            signed = outside + np.minimum(excess.max(axis=1), 0.0)
            expected = signed.min() - radii[i]
            assert expected >= found[frame, i] - 1e-9
            assert expected == pytest.approx(found[frame, i], abs=0.02)


@settings(max_examples=25, deadline=None)
@given(SEEDS, st.lists(st.integers(0, 4), max_size=4))
def test_capsule_ends_follow_joint_and_rotated_bone(seed, joints):
    rng = np.random.default_rng(seed)
    quats, positions = smooth_rotations(rng, 6, 5), rng.normal(size=(6, 5, 3))
    bones, names = rng.normal(size=(len(joints), 3)), ("",) * len(joints)
    body = Capsules(np.array(joints, np.int64), names, names, bones, np.ones(len(joints)))
    ends = body.ends(quats[::2], positions[::2])
    assert ends.shape == (3, len(joints), 2, 3)
    for row, joint in enumerate(joints):
        start = positions[::2, joint]
        stop = start + Rotation.from_quat(quats[::2, joint]).apply(bones[row])
        np.testing.assert_array_equal(ends[:, row, 0], start)
        np.testing.assert_allclose(ends[:, row, 1], stop, atol=1e-14)


def test_capsules_hand_covers_fingers():
    names = ["Hips", "LeftUpLeg", "LeftArm", "LeftForeArm", "LeftHand", "LeftHandIndex1"]
    offsets = [[0, 0, 0], [9, -5, 0], [20, 50, 0], [30, 0, 0], [25, 0, 0], [9, 0, 0]]
    tip = EndSite(5, (2, 1, 0))
    body = capsules(Skeleton(names, [-1, 0, 0, 2, 3, 4], offsets, end_sites=[tip]))
    assert (body.radii > 0).all()
    assert body.joints.tolist() == [0, 1, 2, 3, 4]
    assert "finger" not in body.parts
    np.testing.assert_allclose(body.bones[body.parts.index("hand")], [11, 1, 0])
