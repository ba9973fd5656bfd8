"""`FigurePosition`: a position relative to the figure, such as in front of the chest."""

from dataclasses import dataclass

import numpy as np

from mograft._util.arrays import FloatArray
from mograft._util.validate import coerce_vector
from mograft.body.anatomy import anatomy, find_joint
from mograft.body.mass import mass_model
from mograft.body.support_polygon import normalize
from mograft.motion.skeleton import Skeleton
from mograft.search.obstacles import Vector


@dataclass(frozen=True)
class FigurePosition:
    """A position relative to the figure, as the target of a `Reach`; it moves with the figure.

    Parameters
    ----------
    part : str
        Name of a joint, or a body part such as "chest" or "left hand".
    offset : tuple of float
        Distance from this joint to the left of the figure, up and forward, in skeleton heights.
        Forward is the horizontal direction that hips and shoulders face.

    Examples
    --------
    >>> FigurePosition("chest", (0, 0.1, 0.4))
    FigurePosition(part='chest', offset=(0.0, 0.1, 0.4))
    """

    part: str
    offset: Vector

    def __post_init__(self) -> None:
        coerce_vector(self, "offset")

    def locate(self, skeleton: Skeleton, positions: FloatArray, up: int) -> FloatArray:
        """Return the position in the world for each of some poses, shape (n, 3).

        `positions` are those of the joints, shape (n, n_joints, 3), and `up` is the vertical axis.
        """
        upward = np.eye(3)[up]
        forward = facing_direction(skeleton, positions, upward)
        left, height = np.cross(upward, forward), mass_model(skeleton).height
        x, y, z = (height * own for own in self.offset)
        origin = positions[:, find_joint(skeleton, self.part, is_part=True)]
        return origin + x * left + y * upward + z * forward


def facing_direction(skeleton: Skeleton, positions: FloatArray, upward: FloatArray) -> FloatArray:
    """Return the horizontal directions that hips and shoulders face, as unit vectors, (..., 3).

    `positions` are those of the joints, shape (..., n_joints, 3); `upward` is a unit vector.
    """
    known = anatomy(skeleton)
    left, right = (known.joints("thigh", "upper_arm", side=side) for side in ("left", "right"))
    if not left or not right:
        raise ValueError("the view direction is unknown: the skeleton has no left and right limbs")
    lateral = positions[..., left, :].mean(axis=-2) - positions[..., right, :].mean(axis=-2)
    return normalize(np.cross(lateral, upward))
