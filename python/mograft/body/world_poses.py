"""A body in some frames, as constraints and obstacles see it."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mograft._util.arrays import FloatArray, IntArray
from mograft.body.capsules import Capsules, capsules
from mograft.body.mass import mass_model, up_axis
from mograft.motion.motion import Motion
from mograft.motion.skeleton import Skeleton

__all__ = ["Poses"]


@dataclass(frozen=True, eq=False)
class Poses:
    """A body in some frames, as constraints see it.

    Attributes
    ----------
    skeleton : Skeleton
        Whose it is.
    frames : ndarray of int, shape (n,)
        Frames of the base motion; one may come several times, in different poses.
    rotations : ndarray, shape (n, n_joints, 4)
        World rotations.
    positions : ndarray, shape (n, n_joints, 3)
        World positions.
    frame_time : float
        Seconds from one frame to the next.
    capsules : Capsules
        The flesh.
    height : float
        Stature in the file's unit.
    up : int
        The axis that points up.
    """

    skeleton: Skeleton
    frames: IntArray
    rotations: FloatArray
    positions: FloatArray
    frame_time: float
    capsules: Capsules
    height: float
    up: int

    @classmethod
    def from_motion(cls, motion: Motion, flesh: Capsules | None = None) -> "Poses":
        """Return all frames of a motion.

        Parameters
        ----------
        motion : Motion
            The motion.
        flesh : Capsules, optional
            Its capsules. Default: those of `capsules`.
        """
        skeleton = motion.skeleton
        return cls(
            skeleton,
            np.arange(motion.n_frames),
            *motion.world_transforms(),
            motion.frame_time,
            capsules(skeleton) if flesh is None else flesh,
            mass_model(skeleton).height,
            up_axis(motion),
        )

    def with_poses(self, frames: IntArray, turned: FloatArray, placed: FloatArray) -> "Poses":
        """Return the same body in other poses."""
        return Poses(
            self.skeleton,
            frames,
            turned,
            placed,
            self.frame_time,
            self.capsules,
            self.height,
            self.up,
        )

    def __len__(self) -> int:
        return len(self.frames)

    @cached_property
    def ends(self) -> FloatArray:
        """Both ends of each capsule, shape (n, n_capsules, 2, 3)."""
        return self.capsules.ends(self.rotations, self.positions)

    def joint_positions(self, joint: str) -> FloatArray:
        """Return where a joint is in the world, shape (n, 3)."""
        return self.positions[:, self.skeleton.index(joint)]
