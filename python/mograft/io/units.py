"""Units and axes of exported files: metres, y up."""

import numpy as np

from mograft._util.arrays import FloatArray
from mograft.body.mass import mass_model, up_axis
from mograft.motion import rotations
from mograft.motion.motion import Motion
from mograft.motion.skeleton import Skeleton

UNITS = {"m": 1.0, "CMU": 0.056444, "inch": 0.0254, "cm": 0.01, "mm": 0.001}
"""Metres per unit; the unit of the CMU recordings is 1/0.45 inches."""

_HUMAN_HEIGHT = 1.7  # metres


def guess_unit(skeleton: Skeleton) -> str:
    """Return the key of `UNITS` in which the height of a skeleton is nearest to 1.7 m.

    BVH files do not state their unit. The guess is wrong for small children and for animals.

    Examples
    --------
    >>> from mograft.dancer import dance
    >>> guess_unit(dance(strides=1).motion.skeleton)
    'cm'
    """
    height = mass_model(skeleton).height
    return min(UNITS, key=lambda unit: abs(np.log(height * UNITS[unit] / _HUMAN_HEIGHT)))


def metres_per_unit(skeleton: Skeleton, scale: float | None) -> tuple[float, str]:
    """Return the metres per unit of length, and the key of `UNITS` or ``"given"``.

    Without a `scale` the unit is that of `guess_unit`. Raises ValueError if `scale` is not above 0.
    """
    if scale is None:
        unit = guess_unit(skeleton)
        return UNITS[unit], unit
    if not (np.isfinite(scale) and scale > 0):
        raise ValueError(f"`scale` must be above 0 metres per unit, got {scale}")
    return float(scale), "given"


def rotation_to_y_up(motion: Motion) -> FloatArray:
    """Return the rotation from the up direction of a motion to y, shape (4,), xyzw."""
    axis = up_axis(motion)
    model = mass_model(motion.skeleton)
    low = [foot.ankle for foot in model.feet] or [model.hips]
    high = model.head if model.head is not None else model.hips
    heights = motion.world_positions()[..., axis]
    half = np.sqrt(0.5)
    rotation = np.array([[0, 0, half, half], [0, 0, 0, 1.0], [-half, 0, 0, half]][axis])
    if heights[:, high].mean() < heights[:, low].mean():
        rotation = rotations.multiply(np.array([0, 0, 1.0, 0]), rotation)
    return rotation
