"""The algebra of rotations.

A rotation is a unit quaternion **xyzw**, scalar last, as in SciPy and glam; `q` and `-q`
are the same rotation. Products compose from right to left: `multiply(a, b)` turns by `b`,
then by `a`. Angles are in radians. Arrays broadcast; the last axis holds the components.
"""

import numpy as np
import numpy.typing as npt

from mograft import _core
from mograft._util.arrays import FloatArray, as_floats, as_quaternions, as_vectors

__all__ = [
    "IDENTITY",
    "angle",
    "continuous_signs",
    "exp",
    "from_axis_angle",
    "from_euler",
    "hermite",
    "inverse",
    "log",
    "multiply",
    "rotate",
    "shortest_arc",
    "to_euler",
    "twist",
]

IDENTITY: FloatArray = np.array([0.0, 0.0, 0.0, 1.0])
IDENTITY.flags.writeable = False

_AXES = {"X": 0, "Y": 1, "Z": 2}


def multiply(a: FloatArray, b: FloatArray) -> FloatArray:
    """Compose rotations: first `b`, then `a`.

    Parameters
    ----------
    a, b : ndarray, shape (..., 4)
        Quaternions, scalar last.

    Returns
    -------
    ndarray, shape (..., 4)
        The Hamilton product; not made unit again.

    Examples
    --------
    >>> quarter = about([0, 0, 1], np.pi / 2)
    >>> multiply(quarter, quarter).round(3) + 0.0
    array([0., 0., 1., 0.])
    """
    return _core.multiply(*_alike(a, b))


def inverse(q: FloatArray) -> FloatArray:
    """Return the rotation that undoes `q`: its conjugate.

    Parameters
    ----------
    q : ndarray, shape (..., 4)
        Unit quaternions.

    Returns
    -------
    ndarray, shape (..., 4)
        The inverses.
    """
    undone: FloatArray = np.negative(q)
    undone[..., 3] = q[..., 3]
    return undone


def rotate(q: FloatArray, vectors: FloatArray) -> FloatArray:
    """Turn vectors by rotations.

    Parameters
    ----------
    q : ndarray, shape (..., 4)
        Unit quaternions.
    vectors : ndarray, shape (..., 3)
        Vectors.

    Returns
    -------
    ndarray, shape (..., 3)
        The turned vectors.
    """
    return _core.rotate(*_alike(q, vectors))


def _alike(a: FloatArray, b: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return both as the kernels want them: broadcast, but for the axis of components."""
    if a.shape[:-1] != b.shape[:-1]:
        shape = np.broadcast_shapes(a.shape[:-1], b.shape[:-1])
        a, b = (np.broadcast_to(own, (*shape, own.shape[-1])) for own in (a, b))
    return np.ascontiguousarray(a, np.float64), np.ascontiguousarray(b, np.float64)


def from_axis_angle(axis: npt.ArrayLike, angles: npt.ArrayLike) -> FloatArray:
    """Return rotations about an axis.

    Parameters
    ----------
    axis : array_like, shape (3,)
        The axis, of any length but 0.
    angles : array_like, shape (...)
        Angles in radians.

    Returns
    -------
    ndarray, shape (..., 4)
        The rotations.
    """
    direction = as_vectors("axis", axis, ())
    direction = direction / np.linalg.norm(direction)
    half = 0.5 * as_floats("angles", angles)[..., None]
    return np.concatenate([np.sin(half) * direction, np.cos(half)], axis=-1)


def shortest_arc(start: FloatArray, end: FloatArray) -> FloatArray:
    """Return the shortest rotations that turn directions into others.

    Parameters
    ----------
    start, end : ndarray, shape (..., 3)
        Vectors; the shapes broadcast.

    Returns
    -------
    ndarray, shape (..., 4)
        Unit quaternions. Between opposite directions a half turn about some axis across them;
        no turn where a vector is 0.

    Examples
    --------
    >>> between(np.array([2.0, 0, 0]), np.array([0, 1.0, 0])).round(3)
    array([0.   , 0.   , 0.707, 0.707])
    """
    start, end = np.broadcast_arrays(start, end)
    lengths = np.linalg.norm(start, axis=-1) * np.linalg.norm(end, axis=-1)
    halves = lengths + np.einsum("...i,...i->...", start, end)
    quats = np.concatenate([np.cross(start, end), halves[..., None]], axis=-1)
    norms = np.linalg.norm(quats, axis=-1, keepdims=True)
    lost = norms[..., 0] <= 1e-9 * lengths
    if lost.any():
        across = np.cross(start[lost], np.eye(3)[np.abs(start[lost]).argmin(axis=-1)])
        quats[lost] = np.concatenate([across, np.zeros((len(across), 1))], axis=-1)
        quats[lengths == 0.0] = IDENTITY
        norms = np.linalg.norm(quats, axis=-1, keepdims=True)
    turns: FloatArray = quats / norms
    return turns


def exp(vectors: npt.ArrayLike) -> FloatArray:
    """Return the rotations that rotation vectors stand for.

    Parameters
    ----------
    vectors : array_like, shape (..., 3)
        Axis times angle, in radians.

    Returns
    -------
    ndarray, shape (..., 4)
        Unit quaternions.

    Raises
    ------
    ValueError
        If the shape is wrong or a value is not finite.
    """
    return _core.exp(as_vectors("vectors", vectors))


def log(rotations: npt.ArrayLike) -> FloatArray:
    """Return the shortest rotation vectors of rotations.

    Parameters
    ----------
    rotations : array_like, shape (..., 4)
        Unit quaternions.

    Returns
    -------
    ndarray, shape (..., 3)
        Axis times angle, of length 0 to π. Of the two that a half turn has, the one whose
        first nonzero component is positive.

    Raises
    ------
    ValueError
        If the shape is wrong, or a quaternion is not of unit norm.

    Examples
    --------
    >>> log(about([0, 1, 0], 1.5)).round(6)
    array([0. , 1.5, 0. ])
    """
    return _core.log(as_quaternions("rotations", rotations))


def angle(a: npt.ArrayLike, b: npt.ArrayLike) -> FloatArray:
    """Return the angles between rotations.

    Parameters
    ----------
    a, b : array_like, shape (..., 4)
        Unit quaternions; the shapes broadcast.

    Returns
    -------
    ndarray, shape (...)
        Angles in radians, 0 to π; exact near 0 too.

    Raises
    ------
    ValueError
        If a shape is wrong, or a quaternion is not of unit norm.
    """
    first, second = np.broadcast_arrays(as_quaternions("a", a), as_quaternions("b", b))
    return _core.angle(np.ascontiguousarray(first), np.ascontiguousarray(second))


def hermite(
    start: npt.ArrayLike,
    end: npt.ArrayLike,
    leaving: npt.ArrayLike,
    reaching: npt.ArrayLike,
    t: npt.ArrayLike,
) -> FloatArray:
    """Evaluate cubics on the sphere that meet given ends and end velocities.

    Parameters
    ----------
    start, end : array_like, shape (n, 4)
        Rotations at t = 0 and t = 1.
    leaving, reaching : array_like, shape (n, 3)
        Angular velocities at the two ends, in the body's own frame, in radians per unit of t.
    t : array_like, shape (n,)
        Where to evaluate each, 0 to 1.

    Returns
    -------
    ndarray, shape (n, 4)
        The rotations.

    Raises
    ------
    ValueError
        If a shape is wrong, a value is not finite or a quaternion not of unit norm.

    Notes
    -----
    The cumulative cubic Bézier curve of Kim, Kim and Shin (SIGGRAPH 1995).
    """
    at = as_floats("t", t, ("n",))
    n = len(at)
    return _core.hermite(
        as_quaternions("start", start, (n,)),
        as_quaternions("end", end, (n,)),
        as_vectors("leaving", leaving, (n,)),
        as_vectors("reaching", reaching, (n,)),
        at,
    )


def continuous_signs(rotations: FloatArray) -> FloatArray:
    """Choose signs so that quaternions do not jump from frame to frame.

    Parameters
    ----------
    rotations : ndarray, shape (n_frames, ..., 4)
        Unit quaternions.

    Returns
    -------
    ndarray, shape (n_frames, ..., 4)
        The same rotations; w ≥ 0 in the first frame, and every later quaternion within a
        right angle of the one before.
    """
    if not len(rotations):
        return rotations
    flips = np.ones(rotations.shape[:-1])
    flips[0] = np.where(rotations[0, ..., 3] < 0, -1.0, 1.0)
    flips[1:] = np.where(np.einsum("...i,...i->...", rotations[1:], rotations[:-1]) < 0, -1.0, 1.0)
    return rotations * np.cumprod(flips, axis=0)[..., None]


def twist(rotations: FloatArray, axis: int) -> FloatArray:
    """Return the part of rotations that turns about a coordinate axis.

    The rest, `multiply(inverse(twist), rotation)`, turns about an axis at right angles to it
    (swing and twist).

    Parameters
    ----------
    rotations : ndarray, shape (..., 4)
        Unit quaternions.
    axis : int
        0, 1 or 2 for x, y or z.

    Returns
    -------
    ndarray, shape (..., 4)
        Rotations about the axis; the identity where the rotation is a half turn about an
        axis at right angles, which leaves the twist open.
    """
    twists = np.zeros_like(rotations)
    twists[..., axis] = rotations[..., axis]
    twists[..., 3] = rotations[..., 3]
    norms = np.linalg.norm(twists, axis=-1, keepdims=True)
    return np.where(norms < 1e-6, IDENTITY, twists / np.maximum(norms, 1e-6))


def from_euler(angles: npt.ArrayLike, order: str) -> FloatArray:
    """Return rotations about one axis after the other, each about the axes already turned.

    This is how BVH means its channels: `order` is that of the file's rotation channels.

    Parameters
    ----------
    angles : array_like, shape (..., len(order))
        Angles in radians, in the order of the axes.
    order : str
        Any number of the letters X, Y and Z; with none the result is the identity.

    Returns
    -------
    ndarray, shape (..., 4)
        Unit quaternions.

    Raises
    ------
    ValueError
        If the order has other letters, the shape is wrong or a value is not finite.

    Examples
    --------
    >>> from_euler([np.pi / 2, 0.0, 0.0], "ZXY").round(3)
    array([0.   , 0.   , 0.707, 0.707])
    """
    floats = as_floats("angles", angles)
    if not set(order) <= set(_AXES):
        raise ValueError(f"order must be of the letters X, Y and Z, got {order!r}")
    if floats.shape[-1:] != (len(order),):
        raise ValueError(f"angles must have shape (..., {len(order)}), got {floats.shape}")
    return _core.from_euler(floats, [_AXES[letter] for letter in order])


def to_euler(
    rotations: npt.ArrayLike, order: str, near: npt.ArrayLike = (0.0, 0.0, 0.0)
) -> FloatArray:
    """Return Euler angles of successive rotations that follow one another without jumps.

    Parameters
    ----------
    rotations : array_like, shape (n_frames, 4)
        Unit quaternions.
    order : str
        Up to three different letters of X, Y and Z, as for `from_euler`.
    near : array_like, shape (3,), optional
        Angles in radians, in the order of the axes, that the first frame should be near to.

    Returns
    -------
    ndarray, shape (n_frames, len(order))
        Angles in radians. Of all that give the rotation, those nearest to the previous
        frame's; in gimbal lock the first angle stays. With fewer than three axes the rest
        of the rotation, if any, is left out.

    Raises
    ------
    ValueError
        If the order is none, a shape is wrong, or a quaternion is not of unit norm.

    Examples
    --------
    >>> quats = about([0, 0, 1], [3.0, 3.5])
    >>> to_euler(quats, "ZXY").round(3) + 0.0
    array([[3. , 0. , 0. ],
           [3.5, 0. , 0. ]])
    """
    quats = as_quaternions("rotations", rotations, ("n_frames",))
    if not set(order) <= set(_AXES) or len(set(order)) != len(order):
        raise ValueError(f"order must be different letters of X, Y and Z, got {order!r}")
    axes = [_AXES[letter] for letter in order]
    axes += [axis for axis in range(3) if axis not in axes]
    start = as_floats("near", near, (3,))
    first, second, third = axes
    angles = _core.to_euler(
        quats, (first, second, third), (float(start[0]), float(start[1]), float(start[2]))
    )
    return angles[:, : len(order)]
