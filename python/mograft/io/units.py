"""Units and axes of exported files: metres, y up, in single precision."""

from dataclasses import dataclass

import numpy as np

from mograft._util.arrays import FloatArray
from mograft.body.mass import mass_model, mean_world_positions, up_axis, up_sign
from mograft.motion import rotations
from mograft.motion.motion import Motion
from mograft.motion.skeleton import Skeleton

UNITS = {"m": 1.0, "CMU": 0.056444, "inch": 0.0254, "cm": 0.01, "mm": 0.001}
"""Metres per unit; the unit of the CMU recordings is 1/0.45 inches."""

_HUMAN_HEIGHT = 1.7  # metres
_MAX_SINGLE = 1e38  # sums of three such values are finite in single precision


@dataclass(frozen=True, eq=False)
class ExportTransform:
    """The transform of a motion to metres and y up: a scale factor and a rotation of the root.

    The local rotations of all joints but the root do not change.
    """

    scale: float  # metres per unit of length
    unit: str  # key of `UNITS` if the scale was guessed, else "given"
    up_axis: int  # vertical axis of the motion, 0 to 2
    to_y_up: FloatArray  # rotation from the up direction of the motion to y, shape (4,), xyzw

    @classmethod
    def of(cls, motion: Motion, scale: float | None) -> "ExportTransform":
        """Return the transform of a motion; if `scale` is None, `guess_unit` determines it.

        Raises ValueError if `scale`, in metres per unit, is not above 0.
        """
        unit = "given" if scale is not None else guess_unit(motion.skeleton)
        if scale is None:
            scale = UNITS[unit]
        elif not (np.isfinite(scale) and scale > 0):
            raise ValueError(f"`scale` must be above 0 metres per unit, got {scale}")
        axis = up_axis(motion)
        return cls(float(scale), unit, axis, _rotation_to_y_up(motion, axis))

    @property
    def metadata(self) -> dict[str, float | str]:
        """The entries by which an exported file documents the transform."""
        return {
            "metres_in_a_unit": self.scale,
            "unit": self.unit,
            "up_in_the_motion": "xyz"[self.up_axis],
        }

    def points(self, points: FloatArray) -> FloatArray:
        """Rotate and scale points or vectors, shape (..., 3)."""
        return self.scale * rotations.rotate(self.to_y_up, points)

    def local_transforms(self, motion: Motion) -> tuple[FloatArray, FloatArray]:
        """Return the transformed local rotations and positions of a motion.

        Rotations have shape (n_frames, n_joints, 4) and do not change sign from frame to frame.
        Positions have shape (n_frames, n_joints, 3). Raises ValueError if one is too large for
        single precision.
        """
        quats, positions = motion.rotations.copy(), self.scale * motion.positions
        hint = f" m; `scale` is {self.scale:.6g}"
        owner = motion.name or "the motion"
        check_single_precision("position", positions, motion.skeleton, owner, hint)
        quats[:, 0] = rotations.multiply(self.to_y_up, quats[:, 0])
        positions[:, 0] = rotations.rotate(self.to_y_up, positions[:, 0])
        return rotations.continuous_signs(quats), positions


def guess_unit(skeleton: Skeleton) -> str:
    """Return the unit, a key of `UNITS`, for which the height of a skeleton is nearest to 1.7 m.

    The nearest height is that whose ratio to 1.7 m is nearest to 1. BVH files do not state their
    unit. The guess may be wrong for children and animals.
    """
    height = mass_model(skeleton).height
    return min(UNITS, key=lambda unit: abs(np.log(height * UNITS[unit] / _HUMAN_HEIGHT)))


def _rotation_to_y_up(motion: Motion, up_axis: int) -> FloatArray:
    """Return the rotation, xyzw, that maps the up direction of a motion to y.

    The up direction is the axis `up_axis`, or the opposite direction if the mean coordinate of the
    head on this axis is below that of the feet.
    """
    half = np.sqrt(0.5)
    rotation = np.array([[0, 0, half, half], [0, 0, 0, 1.0], [-half, 0, 0, half]][up_axis])
    if up_sign(motion.skeleton, mean_world_positions(motion)[:, up_axis]) < 0:
        rotation = rotations.multiply(np.array([0, 0, 1.0, 0]), rotation)
    return rotation


def check_single_precision(
    kind: str, values: FloatArray, skeleton: Skeleton, owner: str = "", hint: str = ""
) -> None:
    """Raise ValueError if a value is too large for single precision.

    `values` have shape (n_joints, 3) or (n_frames, n_joints, 3). The message states what the values
    are (`kind`, such as "position"), the joint, the frame, the motion (`owner`) and the value, and
    ends with `hint`.
    """
    largest = np.abs(values).max(initial=0.0)
    if largest <= _MAX_SINGLE:
        return
    index = tuple(np.argwhere(~(np.abs(values) <= _MAX_SINGLE))[0])
    frame = f" in frame {index[0]}" if values.ndim == 3 else ""
    owner = f" of {owner}" if owner else ""
    raise ValueError(
        f"the {kind} of {skeleton.names[index[-2]]}{frame}{owner} must be within the range of "
        f"single precision, -1e38 to 1e38, got {values[index]:.6g}{hint}"
    )
