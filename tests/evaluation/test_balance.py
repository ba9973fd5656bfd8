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
    Balance,
    BalanceSample,
    balance_row,
    dynamic_balance,
    static_balance,
)
from tests.strategies import transform_motion

DANCE = dance(seed=3, strides=1).motion[:400]


def static_distances(distance):
    """Return a balance whose frames with a finite distance are grounded."""
    return Balance("static", distance, np.isfinite(distance), "rods")


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
        np.testing.assert_array_equal(expected.classify(cut), found.classify(cut))


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
    states = np.full(len(cut), np.nan)
    sample = BalanceSample(states, states[None], np.ones((1, len(cut)), bool))
    with pytest.raises(InsufficientDataError, match="flight"):
        balance_row("static", "x", [sample])
    assert support_polygons(lifted).sizes.any()  # without a reference, its floor is higher


def standing_figure(lean=0.0):
    """Return a figure in the first pose of the dance, with the spine rotated by `lean`."""
    pose = DANCE[:1]
    quats = np.repeat(pose.rotations, 40, axis=0)
    names = DANCE.skeleton.names
    (spine,) = (c for c in DANCE.skeleton.children[0] if names[c] == "Spine")
    quats[:, spine] = rotations.multiply(rotations.exp(np.array([lean, 0.0, 0.0])), quats[:, spine])
    positions = np.repeat(pose.positions, 40, axis=0)
    return replace(DANCE, rotations=quats, positions=positions, channel_values=None)


def test_static_balance_leaning_figure_is_unbalanced():
    upright = static_balance(standing_figure(), floor_reference=DANCE)
    leaning = static_balance(standing_figure(-1.4), floor_reference=DANCE)
    assert upright.distance[0] < 0 < leaning.distance[0]
    cut = Segments([0, 10], [10, 39])
    assert not upright.classify(cut)[0].any()
    assert leaning.classify(cut)[0].all()


@pytest.mark.parametrize("acceleration", [-300.0, 0.0, 150.0, 600.0])
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
    if acceleration == 0.0:
        static = static_balance(cart, floor_reference=DANCE)
        np.testing.assert_allclose(static.distance, expected / height, atol=1e-9)


@given(npst.arrays(np.float64, 30, elements=st.sampled_from([-0.1, 0.1, np.nan])))
def test_classify_segments_by_their_grounded_frames(distance):
    cut = Segments([0, 7, 15], [7, 15, 29])
    unbalanced, flight = static_distances(distance).classify(cut)
    for index, (start, stop) in enumerate(zip(cut.start, cut.stop, strict=True)):
        frames = distance[start : stop + 1]
        frames = frames[np.isfinite(frames)]
        assert flight[index] == (len(frames) == 0)
        assert unbalanced[index] == (len(frames) > 0 and (frames > 0).all())


def test_balance_unsupported_arguments_raise():
    pole = Skeleton(["a", "b"], [-1, 0], [[0, 0, 0], [0, 1, 0]])
    motion = Motion(pole, 1 / 30, np.tile([0.0, 0, 0, 1], (20, 2, 1)), np.zeros((20, 2, 3)))
    with pytest.raises(InsufficientDataError, match="no leg"):
        static_balance(motion)
    with pytest.raises(InsufficientDataError, match="frames for derivatives"):
        dynamic_balance(DANCE[:3], floor_reference=DANCE)


@pytest.mark.parametrize("measure", [static_balance, dynamic_balance])
@pytest.mark.parametrize("n_frames", [1, 19, 21])
def test_balance_support_of_other_frames_raises_value_error(measure, n_frames):
    """Support of one frame would be that of every frame."""
    support = support_polygons(DANCE[:n_frames], floor_reference=DANCE)
    message = f"`support` must have 20 frames, as the motion has, got {n_frames}"
    with pytest.raises(ValueError, match=message):
        measure(DANCE[:20], support=support)


def test_balance_row_random_states_equals_counted_rates():
    """A fifth of the segments is in flight."""
    rng, samples, states, changed = np.random.default_rng(4), [], [], []
    for n in (15, 10):
        states.append(rng.choice([0.0, 1.0, 1.0, 0.0, np.nan], (4, n)))
        changed.append(rng.random((3, n)) < 0.5)
        samples.append(BalanceSample(states[-1][0], states[-1][1:], changed[-1]))
    row = balance_row("static", "x", samples)
    (before, *after), is_changed = np.concatenate(states, 1), np.concatenate(changed, 1)
    differences = np.array(after) - before
    assert row.rate.value == pytest.approx(np.nanmean(after))
    assert row.rate_changed.value == pytest.approx(np.nanmean(np.array(after)[is_changed]))
    assert row.difference_changed.value == pytest.approx(np.nanmean(differences[is_changed]))
    assert row.flight == pytest.approx(np.isnan(after).mean())
    assert row.rate.n == np.isfinite(after).sum()
    assert row.difference_changed.n == np.isfinite(differences[is_changed]).sum()
    assert row.runs == 3
