"""The join of a loop: its last frame meets its first, as two pieces meet at a seam."""

from dataclasses import replace

import numpy as np

from mograft._util.arrays import FloatArray
from mograft.blend.recombine import Part
from mograft.blend.seam_treatments import SEAM_TREATMENTS
from mograft.blend.seams import ROTATIONS, TRANSLATIONS, PieceTimes, SeamBoundaries, ValueSpace


def close_join(part: Part, rate: float, blend: float) -> Part:
    """Return a part whose last frame equals its first, with a continuous velocity.

    Offsets that decay within `blend` seconds, and within half of the loop, are added at both ends,
    as by the seam treatment "offset". `rate` is in frames per second.
    """
    positions = part.positions

    def close(values: FloatArray, space: ValueSpace) -> FloatArray:
        steps = space.delta(values[-2:-1], values[-1:]), space.delta(values[:1], values[1:2])
        return close_values(values, space, (rate * steps[0], rate * steps[1]), rate, blend)

    return replace(
        part,
        rotations=close(part.rotations, ROTATIONS),
        positions=None if positions is None else close(positions, TRANSLATIONS),
    )


def close_values(
    values: FloatArray,
    space: ValueSpace,
    velocities: tuple[FloatArray, FloatArray],
    rate: float,
    blend: float,
) -> FloatArray:
    """Close the join of rotations or translations, shape (n_frames, n_joints, 4 or 3).

    `velocities`, per second and of shape (1, n_joints, 3), are those of the last and of the first
    frame.
    """
    last = len(values) - 1
    middle = last // 2
    frames = np.arange(last + 1)
    is_second = frames > middle  # the half before the join
    times = PieceTimes(
        piece=np.where(is_second, 0, 1),
        seconds=np.where(is_second, frames - middle, frames) / rate,
        durations=np.array([last - middle, middle]) / rate,
        blend=blend,
    )
    boundaries = SeamBoundaries(space, values[-1:], values[:1], *velocities)
    closed = SEAM_TREATMENTS["offset"].close(values, times, boundaries)
    is_opposite = (closed[-1] * closed[0]).sum(axis=-1, keepdims=True) < 0.0
    is_negative = is_opposite if space is ROTATIONS else np.zeros_like(is_opposite)
    closed[-1] = np.where(is_negative, -closed[0], closed[0])
    return closed
