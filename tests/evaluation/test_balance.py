"""Static and dynamic balance, and the comparison of grafts with their bases."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst

from mograft import InsufficientDataError, Motion, Segments, Skeleton, rotations, segment
from mograft.body.mass import center_of_mass, mass_model
from mograft.body.support_polygon import signed_distance, support_polygons
from mograft.dancer import dance
from mograft.evaluation.balance import (
    RULES,
    Balance,
    BalanceSample,
    balance_row,
    dynamic_balance,
    static_balance,
)
from tests.hierarchies import recording
from tests.strategies import SEEDS, transform_motion

DANCE = dance(seed=3, strides=1).motion[:400]


def static_distances(distance):
    """Return a balance whose frames with a finite distance are grounded."""
    return Balance("static", distance, np.isfinite(distance), "rods", ())


@settings(max_examples=15)
@given(st.floats(0.01, 100), st.floats(-3, 3), st.floats(-9, 9), st.floats(-9, 9))
def test_balance_transformed_motion_is_unchanged(scale, yaw, x, z):
    cut = segment(DANCE)
    other = transform_motion(DANCE, scale, yaw, (x * 100, 0.0, z * 100))
    for measure in (static_balance, dynamic_balance):
        expected, found = measure(DANCE), measure(other)
        np.testing.assert_allclose(found.distance, expected.distance, atol=1e-7)
        distance = np.where(expected.grounded, expected.distance, 1)
        if (np.abs(distance) <= 1e-6).any():
            continue  # rounding may move a point over the edge
        for rule in RULES:
            np.testing.assert_array_equal(
                expected.classify(cut, rule)[0], found.classify(cut, rule)[0]
            )


@given(SEEDS)
def test_center_of_mass_random_frame_is_within_bones(seed):
    rng = np.random.default_rng(seed)
    frame = DANCE[int(rng.integers(DANCE.n_frames)) :][:1]
    model = mass_model(frame.skeleton)
    assert model.mass.sum() == pytest.approx(1.0, abs=1e-12)
    world_rotations, joints = frame.world_transforms()
    ends = joints + rotations.rotate(world_rotations, model.bone)
    low = np.minimum(joints, ends)[0].min(axis=0)
    high = np.maximum(joints, ends)[0].max(axis=0)
    center = center_of_mass(frame)[0]
    assert (center >= low).all()
    assert (center <= high).all()


def test_balance_lifted_motion_over_given_floor_is_flight():
    model = mass_model(DANCE.skeleton)
    heights = DANCE.world_positions()[:, :, 1]
    lift = float(np.ptp(heights)) + 0.04 * model.height
    lifted = transform_motion(DANCE, offset=(0.0, lift, 0.0))
    cut = segment(DANCE)
    for measure in (static_balance, dynamic_balance):
        found = measure(lifted, floor_reference=DANCE)
        assert not found.grounded.any()
        assert np.isnan(found.distance).all()
        unbalanced, flight = found.classify(cut)
        assert flight.all()
        assert not unbalanced.any()
    sample = BalanceSample([found], [[found]], [np.ones((1, len(cut)), bool)], [cut])
    with pytest.raises(InsufficientDataError, match="flight"):
        balance_row("x", sample)
    assert support_polygons(lifted).touching.any()  # without a reference, its floor is higher


def standing_figure(lean=0.0):
    """Return a figure in the first pose of the dance, with the spine rotated by `lean`."""
    pose = DANCE[:1]
    quats = np.repeat(pose.rotations, 40, axis=0)
    names = DANCE.skeleton.names
    (spine,) = (c for c in DANCE.skeleton.children[0] if names[c] == "Spine")
    quats[:, spine] = rotations.multiply(rotations.exp(np.array([lean, 0.0, 0.0])), quats[:, spine])
    positions = np.repeat(pose.positions, 40, axis=0)
    return replace(DANCE, rotations=quats, positions=positions, channel_values=None)


def test_dynamic_balance_still_figure_equals_static_balance():
    static = static_balance(standing_figure(), floor_reference=DANCE)
    dynamic = dynamic_balance(standing_figure(), floor_reference=DANCE)
    np.testing.assert_allclose(dynamic.distance, static.distance, atol=1e-9)


def test_static_balance_leaning_figure_is_unbalanced():
    upright = static_balance(standing_figure(), floor_reference=DANCE)
    leaning = static_balance(standing_figure(-1.4), floor_reference=DANCE)
    assert upright.distance[0] < 0 < leaning.distance[0]
    cut = Segments([0, 10], [10, 39])
    margin = float(leaning.distance[0]) + 1e-9
    for rule in RULES:
        assert not upright.classify(cut, rule)[0].any()
        assert leaning.classify(cut, rule)[0].all()
        assert not leaning.classify(cut, rule, margin=margin)[0].any()


@pytest.mark.parametrize("acceleration", [-300.0, 150.0, 600.0])
def test_dynamic_balance_constant_acceleration_shifts_zero_moment_point(acceleration):
    figure = standing_figure()
    time = np.arange(figure.n_frames) * figure.frame_time
    positions = figure.positions.copy()
    positions[:, 0, 2] += 0.5 * acceleration * time**2
    cart = replace(figure, positions=positions)
    support = support_polygons(cart, floor_reference=DANCE)
    height = mass_model(figure.skeleton).height
    expected_point = center_of_mass(cart)
    gravity = 9.81 * height / 1.75
    expected_point[:, 2] -= (expected_point[:, 1] - support.floor) * acceleration / gravity
    expected = signed_distance(support.polygons, support.sizes, expected_point[:, support.axes])
    found = dynamic_balance(cart, floor_reference=DANCE)
    np.testing.assert_allclose(found.distance, expected / height, atol=1e-6)


@given(npst.arrays(np.float64, 30, elements=st.sampled_from([-0.1, 0.1, np.nan])))
def test_classify_rules_equal_counts_of_grounded_frames(distance):
    balance = static_distances(distance)
    cut = Segments([0, 7, 15], [7, 15, 29])
    by_rule = {rule: balance.classify(cut, rule)[0] for rule in RULES}
    flight = balance.classify(cut)[1]
    for index, (start, stop) in enumerate(zip(cut.start, cut.stop, strict=True)):
        frames = distance[start : stop + 1]
        frames = frames[np.isfinite(frames)]
        assert flight[index] == (len(frames) == 0)
        assert by_rule["all"][index] == (len(frames) > 0 and (frames > 0).all())
        assert by_rule["majority"][index] == ((frames > 0).sum() > len(frames) / 2)
        assert by_rule["any"][index] == (frames > 0).any()


def test_static_balance_without_legs_raises_insufficient_data_error():
    pole = Skeleton(["a", "b"], [-1, 0], [[0, 0, 0], [0, 1, 0]])
    motion = Motion(pole, 1 / 30, np.tile([0.0, 0, 0, 1], (20, 2, 1)), np.zeros((20, 2, 3)))
    with pytest.raises(InsufficientDataError, match="no leg"):
        static_balance(motion)


def test_dynamic_balance_three_frames_raises_insufficient_data_error():
    with pytest.raises(InsufficientDataError, match="frames for derivatives"):
        dynamic_balance(DANCE[:3], floor_reference=DANCE)


def test_static_balance_support_of_other_length_raises_value_error():
    support = support_polygons(DANCE[:10], floor_reference=DANCE)
    with pytest.raises(ValueError, match="20 frames"):
        static_balance(DANCE[:20], support=support)


def test_classify_unknown_rule_raises_value_error():
    with pytest.raises(ValueError, match="rule"):
        static_balance(DANCE).classify(segment(DANCE), "most")


def test_balance_row_random_balances_equals_counted_rates():
    rng = np.random.default_rng(4)
    cuts = [Segments([0, 5, 9], [5, 9, 14]), Segments([0, 4], [4, 9])]

    def random_balance(n):
        return static_distances(rng.choice([-1.0, 1.0], n))

    original = [random_balance(15), random_balance(10)]
    grafts = [[random_balance(n) for _ in range(3)] for n in (15, 10)]
    changed = [rng.random((3, len(cut))) < 0.5 for cut in cuts]
    row = balance_row("x", BalanceSample(original, grafts, changed, cuts), "any")
    after = np.concatenate(
        [
            [balance.classify(cut, "any")[0] for balance in several]
            for several, cut in zip(grafts, cuts, strict=True)
        ],
        axis=1,
    )
    before = np.concatenate(
        [balance.classify(cut, "any")[0] for balance, cut in zip(original, cuts, strict=True)]
    )
    is_changed = np.concatenate(changed, axis=1)
    assert row.rate.value == after.mean()
    assert row.spread == pytest.approx(after.mean(axis=1).std(ddof=1))
    assert row.changed.value == after[is_changed].mean()
    differences = (after.astype(float) - before)[is_changed]
    assert row.difference.value == pytest.approx(differences.mean())
    assert row.rate.n == after.size
    assert row.difference.n == is_changed.sum()


def test_static_balance_quadruped_uses_rods_and_four_legs():
    quadruped = recording("synthetic_quadruped/quadruped_trot")
    found = static_balance(quadruped)
    assert found.model == "rods"
    assert found.grounded.any()
    assert support_polygons(quadruped).touching.shape[1] == 4
