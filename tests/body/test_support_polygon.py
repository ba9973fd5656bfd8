"""Support polygons: convex hulls, signed distances, and the soles of feet."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst
from scipy.spatial import ConvexHull

from mograft import InsufficientDataError, Motion, Skeleton
from mograft.body.mass import mass_model
from mograft.body.support_polygon import convex_hull, signed_distance, support_polygons
from mograft.dancer import dance


def planar_points(min_size=1, max_size=12):
    coordinate = st.floats(-5, 5, width=32) | st.integers(-3, 3).map(float)
    shape = st.tuples(st.integers(min_size, max_size), st.just(2))
    return npst.arrays(np.float64, shape, elements=coordinate)


def test_support_polygons_without_legs_raises_error_with_all_joints():
    skeleton = Skeleton(["Hips"], [-1], [[0, 0, 0]])
    motion = Motion(skeleton, 1 / 30, [[[0.0, 0.0, 0.0, 1.0]]] * 4, [[[0.0, 90.0, 0.0]]] * 4)
    with pytest.raises(InsufficientDataError, match=r"no leg is known among the joints Hips$"):
        support_polygons(motion)


@given(planar_points(3))
def test_convex_hull_of_random_points_equals_scipy_hull(points):
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)[-1]
    assume(spread >= 1e-6)  # SciPy refuses collinear points
    hull = convex_hull(points)
    expected = ConvexHull(points)
    (x, y), (x2, y2) = hull.T, np.roll(hull, -1, axis=0).T
    signed_area = 0.5 * np.sum(x * y2 - x2 * y)
    assert signed_area == pytest.approx(expected.volume, abs=1e-9)  # positive: counterclockwise
    assert {tuple(p) for p in hull.tolist()} <= {tuple(p) for p in points.tolist()}
    outside = expected.equations[:, :2] @ hull.T + expected.equations[:, 2:]
    assert outside.max() < 1e-9
    for vertex in points[expected.vertices]:
        assert np.linalg.norm(hull - vertex, axis=1).min() < 1e-6


@pytest.mark.parametrize(
    ("points", "expected"),
    [([[1, 2], [1, 2], [1, 2]], [[1, 2]]), ([[2, 2], [0, 0], [1, 1], [3, 3]], [[0, 0], [3, 3]])],
)
def test_convex_hull_collinear_points_returns_ends(points, expected):
    np.testing.assert_array_equal(convex_hull(np.array(points, float)), expected)


@given(planar_points(1), planar_points(1, 1), st.integers(0, 3))
def test_signed_distance_of_hull_equals_distance_to_sampled_edges(points, probe, n_padded):
    hull = convex_hull(points)
    n = len(hull)
    found = signed_distance(hull[None], np.array([n]), probe)[0]
    padded = np.concatenate([hull, hull[[-1] * n_padded]])
    assert signed_distance(padded[None], np.array([n]), probe)[0] == found
    fractions = np.linspace(0, 1, 400)[:, None]
    edges = list(zip(hull, np.roll(hull, -1, axis=0), strict=True))
    samples = np.concatenate([a + fractions * (b - a) for a, b in edges])
    expected = np.linalg.norm(samples - probe, axis=1).min()
    assert abs(found) <= expected + 1e-9
    assert abs(found) >= expected - 0.03 - 1e-9  # half the distance between two samples
    if n > 2:
        crosses = [
            (b - a)[0] * (probe[0] - a)[1] - (b - a)[1] * (probe[0] - a)[0] for a, b in edges
        ]
        if min(crosses) > 1e-9:
            assert found < 0
        if min(crosses) < -1e-9:
            assert found > 0
    else:
        assert found >= 0


def test_signed_distance_empty_polygon_is_nan():
    distances = signed_distance(np.zeros((1, 3, 2)), np.array([0]), np.zeros((1, 2)))
    assert np.isnan(distances).all()


def test_support_polygons_both_feet_down_contain_ankles():
    sample = dance(seed=3, strides=1)[:400]
    motion = sample.motion
    support = support_polygons(motion)
    model = mass_model(motion.skeleton)
    joints = motion.world_positions()
    frames = np.flatnonzero(sample.stance.all(axis=1))[::20]
    assert len(frames)
    for frame in frames:
        polygon = support.polygons[frame][: support.sizes[frame]]
        for foot in model.feet:
            ankle = joints[frame, foot.ankle][list(support.axes)][None]
            distance = signed_distance(polygon[None], np.array([len(polygon)]), ankle)[0]
            assert distance < 0.12 * model.height  # one foot length, if only the toe touches
