"""Distances between capsules."""

import numpy as np


def capsule_distances(ends, radii, others, other_radii):
    """Return the signed distances (F, n, m) between two sets of capsules in every frame.

    The nearest points of two segments a + s (b - a) and c + t (d - c) are found in closed form
    (Ericson 2004, Real-Time Collision Detection, 5.1.9).
    """
    a, b = ends[:, :, None, 0], ends[:, :, None, 1]
    c, d = others[:, None, :, 0], others[:, None, :, 1]
    u, v, w = b - a, d - c, a - c

    def dot(x, y):
        return (x * y).sum(axis=-1)

    uu, vv, vw, uw, uv = dot(u, u), dot(v, v), dot(v, w), dot(u, w), dot(u, v)
    tiny = 1e-300
    determinant = uu * vv - uv**2
    s = np.where(
        determinant > 0, ((uv * vw - uw * vv) / np.maximum(determinant, tiny)).clip(0, 1), 0.0
    )
    # If the second segment is a point, s is the projection of that point on the first.
    s = np.where(vv > 0, s, (-uw / np.maximum(uu, tiny)).clip(0, 1))
    t = (uv * s + vw) / np.maximum(vv, tiny)
    s = np.where(t < 0, (-uw / np.maximum(uu, tiny)).clip(0, 1), s)
    s = np.where(t > 1, ((uv - uw) / np.maximum(uu, tiny)).clip(0, 1), s)
    t = t.clip(0, 1)
    distances = np.linalg.norm(a + u * s[..., None] - c - v * t[..., None], axis=-1)
    return distances - radii[:, None] - other_radii
