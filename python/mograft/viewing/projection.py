"""The projector of films and strips: a camera that sees figures from beside their front."""

from dataclasses import dataclass
from math import inf

import numpy as np

from mograft._util.arrays import FloatArray
from mograft.body.anatomy import anatomy
from mograft.motion.skeleton import Skeleton


@dataclass(frozen=True)
class Camera:
    """A camera that looks at the middle of a figure; angles in radians, lengths in body heights.

    Attributes
    ----------
    yaw : float
        Angle about the vertical axis between the camera and the direction +z, positive towards +x.
    tilt : float
        Angle of the view below the horizontal.
    distance : float
        Distance from the middle of the figure. Infinite: a parallel projection.
    """

    yaw: float
    tilt: float = 0.0
    distance: float = inf

    def project(self, offsets: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return coordinates to the right and up in the picture, and the share of full size.

        `offsets`, shape (..., 3), are those from the middle of the figure, with y up. The results
        have shape (...). The share is 1 at the distance of the middle, and above 1 nearer.
        """
        cos, sin = np.cos(self.yaw), np.sin(self.yaw)
        x, up, z = np.moveaxis(offsets, -1, 0)
        across, near = cos * x - sin * z, sin * x + cos * z
        high = np.cos(self.tilt) * up - np.sin(self.tilt) * near
        near = np.cos(self.tilt) * near + np.sin(self.tilt) * up
        size = 1.0 / (1.0 - near / self.distance)
        return size * across, size * high, size


def front_yaw(skeleton: Skeleton, positions: FloatArray) -> float:
    """Return the yaw of the direction in which a figure faces, 0 for +z; 0 if it has no thighs.

    `positions` are those of the nodes in one frame with y up, shape (n_nodes, 3).
    """
    thighs = [anatomy(skeleton).joints("thigh", side=side) for side in ("left", "right")]
    if not all(thighs):
        return 0.0
    x, _, z = positions[thighs[0][0]] - positions[thighs[1][0]]
    return float(np.arctan2(-z, x))
