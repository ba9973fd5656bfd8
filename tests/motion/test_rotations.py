"""Properties of quaternions, rotation vectors and Euler angles."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from mograft.motion import rotations
from tests.oracles import rotations as oracle
from tests.strategies import SEEDS, assert_same_rotations, quaternions, smooth_rotations, vectors

ORDERS = ("XYZ", "XZY", "YXZ", "YZX", "ZXY", "ZYX")


@given(quaternions((5,)))
def test_exp_inverts_log_and_log_is_shortest(q):
    logs = rotations.log(q)
    assert (np.linalg.norm(logs, axis=-1) <= np.pi + 1e-15).all()
    assert_same_rotations(rotations.exp(logs), q, 1e-12)
    np.testing.assert_array_equal(rotations.log(-q), logs)


@given(
    SEEDS,
    st.sampled_from(
        [((), ()), ((3,), ()), ((), (2, 3)), ((4, 1), (3,)), ((2, 1, 3), (4, 1)), ((0,), (1,))]
    ),
)
def test_multiply_and_rotate_broadcast(seed, shapes):
    """The arguments include views with negative strides and broadcast axes."""
    rng = np.random.default_rng(seed)
    a, b, v = (
        rng.normal(size=(*s, n)) for s, n in zip((*shapes, shapes[1]), (4, 4, 3), strict=True)
    )
    a, b = a / np.linalg.norm(a, axis=-1, keepdims=True), b[..., ::-1]
    np.testing.assert_allclose(rotations.multiply(a, b), oracle.multiply(a, b), atol=1e-14)
    pure = np.concatenate([v, np.zeros((*v.shape[:-1], 1))], axis=-1)
    expected = oracle.multiply(oracle.multiply(a, pure), oracle.inverse(a))[..., :3]
    np.testing.assert_allclose(rotations.rotate(a, v), expected, atol=1e-14)
    np.testing.assert_array_equal(rotations.inverse(a), oracle.inverse(a))


@given(vectors((), size=1e-6))
def test_angle_near_zero_is_accurate(v):
    q = rotations.exp(v)
    np.testing.assert_allclose(rotations.log(q), v, rtol=1e-12, atol=1e-300)
    near = rotations.angle(q, rotations.IDENTITY)
    np.testing.assert_allclose(near, np.linalg.norm(v), rtol=1e-9, atol=1e-16)


@given(quaternions((4,)), quaternions((4,)))
def test_angle_matches_scipy(a, b):
    expected = (Rotation.from_quat(a).inv() * Rotation.from_quat(b)).magnitude()
    np.testing.assert_allclose(rotations.angle(a, b), expected, atol=1e-12)


@given(quaternions((3, 2)))
def test_from_matrices_matches_scipy(q):
    matrices = Rotation.from_quat(q.reshape(-1, 4)).as_matrix().reshape(3, 2, 3, 3)
    assert_same_rotations(rotations.from_matrices(matrices), q)
    # Of all half turns, too, where the scalar component is 0.
    halves = rotations.multiply(q, [1.0, 0, 0, 0] * np.ones_like(q))
    matrices = Rotation.from_quat(halves.reshape(-1, 4)).as_matrix().reshape(3, 2, 3, 3)
    assert_same_rotations(rotations.from_matrices(matrices), halves)


@given(vectors((3,), size=10.0), st.sampled_from(ORDERS))
def test_to_euler_matches_scipy_and_round_trips(angles, order):
    q = rotations.from_euler(angles, order)
    assert_same_rotations(q, Rotation.from_euler(order, angles).as_quat(), 1e-12)
    assert_same_rotations(rotations.from_euler(rotations.to_euler(q, order), order), q, 1e-9)


@given(st.floats(-3, 3), st.floats(-3, 3), st.sampled_from((-0.5, 0.5)), st.sampled_from(ORDERS))
def test_to_euler_gimbal_lock_keeps_rotation_and_first_angle(first, last, middle, order):
    q = rotations.from_euler([[first, middle * np.pi, last]], order)
    angles = rotations.to_euler(q, order, [first + 0.1, middle * np.pi, 0.0])
    assert_same_rotations(rotations.from_euler(angles, order), q, 1e-9)
    np.testing.assert_allclose(angles[0, 0], first + 0.1, atol=1e-9)


@given(SEEDS, st.sampled_from(ORDERS))
def test_to_euler_continuous_rotation_gives_continuous_angles(seed, order):
    """Angles do not jump, except near gimbal lock, where the outer angles may change fast."""
    q = smooth_rotations(np.random.default_rng(seed), 60, 1, speed=0.05)[:, 0]
    angles = rotations.to_euler(q, order)
    free = np.abs(np.cos(angles[:, 1])) > 0.3
    jumps = np.abs(np.diff(angles, axis=0))[free[1:] & free[:-1]]
    assert (jumps < 1.0).all()


@given(vectors((2,), size=1.0), st.sampled_from(("Z", "XY", "YZ", "")))
def test_to_euler_fewer_axes_round_trips(angles, order):
    expected = angles[:, : len(order)]
    q = rotations.from_euler(expected, order)
    np.testing.assert_allclose(rotations.to_euler(q, order), expected, atol=1e-9)


@given(SEEDS)
def test_continuous_signs_keeps_rotations_and_removes_jumps(seed):
    rng = np.random.default_rng(seed)
    q = smooth_rotations(rng, 20, 2) * rng.choice([-1.0, 1.0], (20, 2, 1))
    smooth = rotations.continuous_signs(q)
    assert_same_rotations(smooth, q, 1e-15)
    assert (smooth[0, :, 3] >= 0).all()
    assert (np.einsum("fji,fji->fj", smooth[1:], smooth[:-1]) >= 0).all()


@given(quaternions((6,)), st.sampled_from((0, 1, 2)))
def test_twist_remaining_swing_has_perpendicular_axis(q, axis):
    swing = rotations.multiply(rotations.inverse(rotations.twist(q, axis)), q)
    is_defined = np.hypot(q[:, axis], q[:, 3]) > 1e-6
    np.testing.assert_allclose(swing[is_defined, axis], 0.0, atol=1e-9)


@given(quaternions((3,)), quaternions((3,)), vectors((3,)), vectors((3,)))
def test_hermite_meets_end_rotations_and_velocities(start, end, leaving, reaching):
    def at(t):
        return rotations.hermite(start, end, leaving, reaching, np.full(3, t))

    np.testing.assert_array_equal(at(0.0), start)
    np.testing.assert_array_equal(at(1.0), end)
    np.testing.assert_allclose(np.linalg.norm(at(0.4), axis=-1), 1.0, atol=1e-14)
    step = 1e-7
    for near, far, velocity in ((start, at(step), leaving), (at(1 - step), end, reaching)):
        across = rotations.multiply(rotations.inverse(near), far)
        np.testing.assert_allclose(rotations.log(across) / step, velocity, atol=2e-5)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: rotations.exp(["a", "b", "c"]), "`vectors` must be real numbers, got <U1"),
        (lambda: rotations.exp([1j, 0, 0]), "`vectors` must be real numbers, got complex128"),
        (lambda: rotations.exp(np.zeros(3, "m8[s]")), "must be real numbers, got timedelta64"),
        (lambda: rotations.log([0, 0, 0, 2.0]), "`rotations` must be unit quaternions, got norm 2"),
        (lambda: rotations.log([1e300, 0, 0, 1e308]), "unit quaternions, got norm 1e.308"),
        (lambda: rotations.log([0, 0, 1.0]), r"`rotations` must have shape \(..., 4\), got \(3,\)"),
        (lambda: rotations.exp([0, np.nan, 0]), r"`vectors` must be finite, got nan at \[1\]"),
        (lambda: rotations.from_matrices(np.eye(4)), r"`matrices` must have shape \(\.\.\., 3"),
        (lambda: rotations.from_axis_angle([0, 0, 0], 1.0), "`axis` must have a length above 0"),
        (lambda: rotations.from_euler([1.0], "Q"), "`order` must consist of the letters X, Y and"),
        (lambda: rotations.from_euler([1.0, 2.0], "X"), r"`angles` must have shape \(..., 1\)"),
        (lambda: rotations.to_euler([[0, 0, 0, 1.0]], "ZXZ"), "`order` must be different letters"),
    ],
)
def test_rotations_invalid_argument_raises_error(call, message):
    with pytest.raises((TypeError, ValueError), match=message):
        call()
