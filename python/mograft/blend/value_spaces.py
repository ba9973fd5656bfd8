"""Differences and velocities of rotations and of translations, behind one interface."""

from typing import Protocol, TypeAlias

import numpy as np

from mograft._util.arrays import FloatArray
from mograft.motion import rotations

Pair: TypeAlias = tuple[FloatArray, FloatArray]


class ValueSpace(Protocol):
    """Operations on rotations or on translations, called values, and on their differences.

    Values have shape (..., 4) or (..., 3). A delta is the difference from one value to another, a
    velocity the rate of change of a value; both have shape (..., 3).
    """

    def delta(self, start: FloatArray, end: FloatArray) -> FloatArray:
        """Return the shortest delta from `start` to `end`."""

    def add(self, start: FloatArray, delta: FloatArray) -> FloatArray:
        """Return the value that differs from `start` by `delta`."""

    def transport(self, delta: FloatArray, velocity: FloatArray) -> FloatArray:
        """Return the velocity of ``add(value, delta)`` for a value with the given velocity."""

    def delta_rate(self, delta: FloatArray, velocity: FloatArray) -> FloatArray:
        """Return the rate of change of a delta whose end moves with a velocity."""

    def hermite(self, values: Pair, velocities: Pair, t: FloatArray) -> FloatArray:
        """Return cubics at `t`, 0 to 1, from values and velocities (per unit of t) at both ends."""


class _Rotations:
    """Unit quaternions, xyzw; deltas are rotation vectors in the local axes of the joint."""

    def delta(self, start: FloatArray, end: FloatArray) -> FloatArray:
        return rotations.log(rotations.multiply(rotations.inverse(start), end))

    def add(self, start: FloatArray, delta: FloatArray) -> FloatArray:
        return rotations.multiply(start, rotations.exp(delta))

    def transport(self, delta: FloatArray, velocity: FloatArray) -> FloatArray:
        return rotations.rotate(rotations.inverse(rotations.exp(delta)), velocity)

    def delta_rate(self, delta: FloatArray, velocity: FloatArray) -> FloatArray:
        # The inverse of the right Jacobian of exp; its last factor tends to 1/12 at 0.
        angle = np.linalg.norm(delta, axis=-1, keepdims=True)
        is_small = angle < 1e-4
        safe = np.where(is_small, 1.0, angle)
        factor = np.where(is_small, 1.0 / 12.0, 1.0 / safe**2 - 0.5 / (safe * np.tan(0.5 * safe)))
        product = _cross(delta, velocity)
        return velocity + 0.5 * product + factor * _cross(delta, product)

    def hermite(self, values: Pair, velocities: Pair, t: FloatArray) -> FloatArray:
        shape = values[0].shape
        start, end, leaving, reaching = (
            own.reshape(-1, own.shape[-1]) for own in (*values, *velocities)
        )
        times = np.repeat(t, shape[1])
        return rotations.hermite(start, end, leaving, reaching, times).reshape(shape)


class _Translations:
    """Vectors; deltas are differences."""

    def delta(self, start: FloatArray, end: FloatArray) -> FloatArray:
        return end - start

    def add(self, start: FloatArray, delta: FloatArray) -> FloatArray:
        return start + delta

    def transport(self, delta: FloatArray, velocity: FloatArray) -> FloatArray:  # noqa: ARG002
        return velocity

    def delta_rate(self, delta: FloatArray, velocity: FloatArray) -> FloatArray:  # noqa: ARG002
        return velocity

    def hermite(self, values: Pair, velocities: Pair, t: FloatArray) -> FloatArray:
        t = t[:, None, None]
        s = 1.0 - t
        return (
            values[0] * (s * s * (1.0 + 2.0 * t))
            + values[1] * (t * t * (1.0 + 2.0 * s))
            + velocities[0] * (t * s * s)
            - velocities[1] * (t * t * s)
        )


ROTATIONS: ValueSpace = _Rotations()
TRANSLATIONS: ValueSpace = _Translations()


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the cross product; faster than `np.cross` for a few vectors."""
    product: FloatArray = np.empty_like(b)
    for k, m, n in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        product[..., k] = a[..., m] * b[..., n] - a[..., n] * b[..., m]
    return product
