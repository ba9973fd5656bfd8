"""Rotations as unit quaternions.

Quaternions are stored as **xyzw**, scalar last, as in SciPy and glam. `q` and `-q` are the same
rotation. `multiply(a, b)` applies `b` first, then `a`. Angles are in radians. Arrays broadcast;
the last axis holds the components.
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
    "from_matrices",
    "hermite",
    "inverse",
    "log",
    "mean_of_products",
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
    """Return the products of unit quaternions, shape (..., 4): `b` is applied first, then `a`.

    The result is the Hamilton product. It is not renormalised. The shapes broadcast.

    Examples
    --------
    >>> quarter = from_axis_angle([0, 0, 1], np.pi / 2)
    >>> multiply(quarter, quarter).round(3) + 0.0
    array([0., 0., 1., 0.])
    """
    return _core.multiply(*_broadcast(a, b))


def inverse(q: FloatArray) -> FloatArray:
    """Return the inverses of unit quaternions, shape (..., 4), which are their conjugates."""
    conjugate: FloatArray = np.negative(q)
    conjugate[..., 3] = q[..., 3]
    return conjugate


def rotate(q: FloatArray, vectors: FloatArray) -> FloatArray:
    """Rotate vectors, shape (..., 3), by unit quaternions, shape (..., 4); the shapes broadcast."""
    return _core.rotate(*_broadcast(q, vectors))


def _broadcast(a: FloatArray, b: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return both arrays broadcast to the same shape on all axes but the last."""
    if a.shape[:-1] != b.shape[:-1]:
        shape = np.broadcast_shapes(a.shape[:-1], b.shape[:-1])
        a, b = (np.broadcast_to(array, (*shape, array.shape[-1])) for array in (a, b))
    return np.ascontiguousarray(a, np.float64), np.ascontiguousarray(b, np.float64)


def from_axis_angle(axis: npt.ArrayLike, angles: npt.ArrayLike) -> FloatArray:
    """Return the rotations by given angles about one axis, shape (..., 4).

    The axis, shape (3,), may have any length above 0; the angles, shape (...), are in radians.
    Raises ValueError if the axis is zero, a shape is wrong or a value is not finite.
    """
    direction = as_vectors("axis", axis, ())
    length = np.linalg.norm(direction)
    if not length > 0:
        raise ValueError(f"`axis` must have a length above 0, got {direction.tolist()}")
    direction = direction / length
    half = 0.5 * as_floats("angles", angles)[..., None]
    return np.concatenate([np.sin(half) * direction, np.cos(half)], axis=-1)


def from_matrices(matrices: npt.ArrayLike) -> FloatArray:
    """Return the unit quaternions, shape (..., 4), of rotation matrices, shape (..., 3, 3).

    The matrices act on column vectors. They must be orthonormal with determinant 1; small errors,
    such as those of rounding, cause errors of the same order. Raises ValueError if the shape is
    wrong or a value is not finite.

    Notes
    -----
    There is one formula of the quaternion for each of its four components, which divides by that
    component. The formula of the largest component is used (Shepperd, Journal of Guidance and
    Control 1, 1978).

    Examples
    --------
    >>> from_matrices([[0, -1, 0], [1, 0, 0], [0, 0, 1]]).round(3) + 0.0
    array([0.   , 0.   , 0.707, 0.707])
    """
    given = as_vectors("matrices", matrices)
    if given.shape[-2:] != (3, 3):
        raise ValueError(f"`matrices` must have shape (..., 3, 3), got {given.shape}")
    # Four times the products of the components, as a symmetric matrix: its largest row is parallel
    # to the quaternion.
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = np.moveaxis(given, (-2, -1), (0, 1))
    rows = [
        [1 + xx - yy - zz, xy + yx, xz + zx, zy - yz],
        [xy + yx, 1 - xx + yy - zz, yz + zy, xz - zx],
        [xz + zx, yz + zy, 1 - xx - yy + zz, yx - xy],
        [zy - yz, xz - zx, yx - xy, 1 + xx + yy + zz],
    ]
    products = np.moveaxis(np.array(rows), (0, 1), (-2, -1))
    largest = np.einsum("...ii->...i", products).argmax(axis=-1)
    quats = np.take_along_axis(products, largest[..., None, None], axis=-2)[..., 0, :]
    return quats / np.linalg.norm(quats, axis=-1, keepdims=True)


def shortest_arc(start: FloatArray, end: FloatArray) -> FloatArray:
    """Return the rotations of smallest angle from one direction to another, shape (..., 4).

    The vectors, shape (..., 3), broadcast. Opposite directions give a half turn about an arbitrary
    perpendicular axis; a zero vector gives the identity.

    Examples
    --------
    >>> shortest_arc(np.array([2.0, 0, 0]), np.array([0, 1.0, 0])).round(3)
    array([0.   , 0.   , 0.707, 0.707])
    """
    start, end = np.broadcast_arrays(start, end)
    lengths = np.linalg.norm(start, axis=-1) * np.linalg.norm(end, axis=-1)
    halves = lengths + np.einsum("...i,...i->...", start, end)
    quats = np.concatenate([np.cross(start, end), halves[..., None]], axis=-1)
    norms = np.linalg.norm(quats, axis=-1, keepdims=True)
    opposite = norms[..., 0] <= 1e-9 * lengths
    if opposite.any():
        unit_axes = np.eye(3)[np.abs(start[opposite]).argmin(axis=-1)]
        normals = np.cross(start[opposite], unit_axes)
        quats[opposite] = np.concatenate([normals, np.zeros((len(normals), 1))], axis=-1)
        quats[lengths == 0.0] = IDENTITY
        norms = np.linalg.norm(quats, axis=-1, keepdims=True)
    return quats / norms


def exp(vectors: npt.ArrayLike) -> FloatArray:
    """Return the unit quaternions, shape (..., 4), of rotation vectors (exponential map).

    A rotation vector, shape (..., 3), is the axis times the angle in radians. Raises ValueError if
    the shape is wrong or a value is not finite.
    """
    return _core.exp(as_vectors("vectors", vectors))


def log(rotations: npt.ArrayLike) -> FloatArray:
    """Return the shortest rotation vectors, shape (..., 3), of unit quaternions (logarithmic map).

    A rotation vector is the axis times the angle, 0 to π. For a half turn, it is the vector whose
    first nonzero component is positive. Raises ValueError if the shape is wrong or a quaternion
    does not have unit norm.

    Examples
    --------
    >>> log(from_axis_angle([0, 1, 0], 1.5)).round(6)
    array([0. , 1.5, 0. ])
    """
    return _core.log(as_quaternions("rotations", rotations))


def angle(a: npt.ArrayLike, b: npt.ArrayLike) -> FloatArray:
    """Return the angles between rotations in radians, 0 to π. Small angles are accurate, too.

    The unit quaternions `a` and `b`, shape (..., 4), broadcast. Raises ValueError if a shape is
    wrong or a quaternion does not have unit norm.
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
    """Evaluate cubic rotation curves with given end rotations and end velocities.

    Each of the n curves has end rotations `start` and `end`, shape (n, 4), and angular velocities
    `leaving` and `reaching`, shape (n, 3), in the axes of the rotated body, in radians per unit
    of t. The result, shape (n, 4), is the rotation at `t`, shape (n,), from 0 to 1. Raises
    ValueError if a shape is wrong, a value is not finite or a quaternion does not have unit norm.

    Notes
    -----
    The curves are the cumulative cubic Bézier curves of Kim, Kim and Shin (SIGGRAPH 1995).
    """
    at = as_floats("t", t, ("n",))
    n = len(at)
    ends = as_quaternions("start", start, (n,)), as_quaternions("end", end, (n,))
    speeds = as_vectors("leaving", leaving, (n,)), as_vectors("reaching", reaching, (n,))
    return _core.hermite(*ends, *speeds, at)


def continuous_signs(rotations: FloatArray) -> FloatArray:
    """Return the same rotations with quaternion signs that do not jump between frames.

    The shape is (n_frames, ..., 4). In the first frame w ≥ 0. The dot product of the quaternions
    of consecutive frames is not negative.
    """
    return _core.continuous_signs(np.ascontiguousarray(rotations, np.float64))


def mean_of_products(sums: FloatArray) -> FloatArray:
    """Return mean rotations, shape (n, 4), given `sums` of q qᵀ over quaternions q, (n, 4, 4).

    A mean m is the unit quaternion with w ≥ 0 that maximises Σ (q·m)². The signs of the
    quaternions therefore have no effect (Markley et al. 2007).
    """
    means = np.linalg.eigh(sums)[1][..., -1]
    return np.where(means[..., 3:] < 0, -means, means)


def twist(rotations: FloatArray, axis: int) -> FloatArray:
    """Return the twist of rotations, shape (..., 4), about the coordinate axis 0, 1 or 2.

    In the swing-twist decomposition, a rotation is ``multiply(twist, swing)``, where the axis of
    the swing is perpendicular to that of the twist. The twist of a half turn about a perpendicular
    axis is undefined; the identity is returned for it.
    """
    twists = np.zeros_like(rotations)
    twists[..., axis] = rotations[..., axis]
    twists[..., 3] = rotations[..., 3]
    norms = np.linalg.norm(twists, axis=-1, keepdims=True)
    return np.where(norms < 1e-6, IDENTITY, twists / np.maximum(norms, 1e-6))


def from_euler(angles: npt.ArrayLike, order: str) -> FloatArray:
    """Return rotations, shape (..., 4), from intrinsic Euler angles in radians.

    `angles` has shape (..., k). `order` names the rotation axes of the k angles by the letters X, Y
    and Z, such as ``"ZXY"`` for the order of the rotation channels in many BVH files; an empty
    order gives the identity. Raises ValueError if `order` has other letters, the shape is wrong or
    a value is not finite.

    Examples
    --------
    >>> from_euler([np.pi / 2, 0.0, 0.0], "ZXY").round(3)
    array([0.   , 0.   , 0.707, 0.707])
    """
    floats = as_floats("angles", angles)
    if not set(order) <= set(_AXES):
        raise ValueError(f"`order` must consist of the letters X, Y and Z, got {order!r}")
    if floats.shape[-1:] != (len(order),):
        raise ValueError(f"`angles` must have shape (..., {len(order)}), got {floats.shape}")
    return _core.from_euler(floats, [_AXES[letter] for letter in order])


def to_euler(
    rotations: npt.ArrayLike, order: str, near: npt.ArrayLike = (0.0, 0.0, 0.0)
) -> FloatArray:
    """Return intrinsic Euler angles of consecutive rotations, without jumps of 2π.

    The rotations are unit quaternions, shape (n_frames, 4); the angles are in radians, shape
    (n_frames, len(order)). `order` has at most three different letters of X, Y and Z, as for
    `from_euler`. Of all angles that give a rotation, those nearest to the previous frame are
    returned; in the first frame, those nearest to `near`. `near`, shape (3,), are angles about the
    axes of `order`, followed by the axes that `order` lacks. In gimbal lock the first angle keeps
    its previous value. If `order` has fewer than three axes, the rotation about the others is
    dropped. Raises ValueError if an argument is invalid.

    Examples
    --------
    >>> quats = from_axis_angle([0, 0, 1], [3.0, 3.5])
    >>> to_euler(quats, "ZXY").round(3) + 0.0
    array([[3. , 0. , 0. ],
           [3.5, 0. , 0. ]])
    """
    quats = as_quaternions("rotations", rotations, ("n_frames",))
    if not set(order) <= set(_AXES) or len(set(order)) != len(order):
        raise ValueError(f"`order` must be different letters among X, Y and Z, got {order!r}")
    x, y, z = as_floats("near", near, (3,)).tolist()
    return _core.to_euler(quats, euler_axes(order), (x, y, z))[:, : len(order)]


def euler_axes(order: str) -> tuple[int, int, int]:
    """Return the axes of `order`, followed by the axes that it lacks.

    Examples
    --------
    >>> euler_axes("ZX")
    (2, 0, 1)
    """
    axes = [_AXES[letter] for letter in order]
    first, second, third = [*axes, *(axis for axis in range(3) if axis not in axes)]
    return first, second, third
