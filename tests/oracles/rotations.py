"""Rotations and curves through rotations, with SciPy and formulas in NumPy."""

import numpy as np
from scipy.spatial.transform import Rotation


def exp(vectors):
    """Return quaternions of rotation vectors."""
    shape = vectors.shape[:-1]
    return Rotation.from_rotvec(vectors.reshape(-1, 3)).as_quat().reshape(*shape, 4)


def log(quats):
    """Return shortest rotation vectors of quaternions."""
    shape = quats.shape[:-1]
    return Rotation.from_quat(quats.reshape(-1, 4)).as_rotvec().reshape(*shape, 3)


def multiply(a, b):
    """Return the Hamilton product."""
    u, s, v, w = a[..., :3], a[..., 3:], b[..., :3], b[..., 3:]
    real = s * w - (u * v).sum(axis=-1, keepdims=True)
    return np.concatenate([s * v + w * u + np.cross(u, v), real], axis=-1)


def inverse(q):
    """Return the conjugate."""
    return q * [-1, -1, -1, 1]


def hermite(q0, q1, v0, v1, t):
    """Evaluate the cubic on the sphere of Kim, Kim and Shin."""
    middle = log(multiply(exp(-v0 / 3), multiply(inverse(q0), multiply(q1, exp(-v1 / 3)))))
    curve = multiply(q0, exp(v0 / 3 * (1 - (1 - t) ** 3)))
    curve = multiply(curve, exp(middle * (3 * t**2 - 2 * t**3)))
    return multiply(curve, exp(v1 / 3 * t**3))


def tangents(steps):
    """Return the velocity at each frame from the differences between frames."""
    if len(steps) == 1:
        return np.concatenate([steps, steps])
    inner = (steps[:-1] + steps[1:]) / 2
    first, last = (3 * steps[0] - steps[1]) / 2, (3 * steps[-1] - steps[-2]) / 2
    return np.concatenate([[first], inner, [last]])


def resample(frames, count):
    """Return `count` frames spread evenly over a segment's rotations (n + 1, J, 4)."""
    n = len(frames) - 1
    velocity = tangents(log(multiply(inverse(frames[:-1]), frames[1:])))
    result = np.empty((count, *frames.shape[1:]))
    for sample in range(count):
        whole, rest = divmod(sample * n, count - 1)
        result[sample] = frames[whole]
        if rest:
            ends = (*frames[whole : whole + 2], *velocity[whole : whole + 2])
            result[sample] = hermite(*ends, rest / (count - 1))
    return result


def resample_positions(frames, count):
    """Return `count` frames spread evenly over a segment's positions (n + 1, 3)."""
    n = len(frames) - 1
    velocity = tangents(np.diff(frames, axis=0))
    result = np.empty((count, 3))
    for sample in range(count):
        whole, rest = divmod(sample * n, count - 1)
        t = rest / (count - 1)
        result[sample] = frames[whole]
        if rest:
            result[sample] = (
                frames[whole] * (1 + 2 * t) * (1 - t) ** 2
                + velocity[whole] * t * (1 - t) ** 2
                + frames[whole + 1] * t**2 * (3 - 2 * t)
                + velocity[whole + 1] * t**2 * (t - 1)
            )
    return result


def to_euler_degrees(rotations, order, before):
    """Return Euler angles in degrees that continue `before` without jumps of a turn."""
    angles = Rotation.from_quat(rotations).as_euler(order, degrees=True)
    return np.unwrap(np.concatenate([before[None], angles]), axis=0, period=360)[1:]
