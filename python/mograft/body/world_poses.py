"""`Poses`: world poses of a body, for constraints and obstacles."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from mograft._util.arrays import FloatArray, IntArray
from mograft.body.capsules import Capsules, capsules
from mograft.body.mass import mass_model, up_axis
from mograft.motion.motion import Motion
from mograft.motion.skeleton import Skeleton


@dataclass(frozen=True, eq=False)
class Poses:
    """World poses of a body in selected frames of a base motion.

    Attributes
    ----------
    skeleton : Skeleton
        The skeleton.
    frames : ndarray of int, shape (n,)
        Frame of the base motion of each pose; a frame may occur several times.
    rotations : ndarray, shape (n, n_joints, 4)
        World rotations.
    positions : ndarray, shape (n, n_joints, 3)
        World positions.
    frame_time : float
        Seconds from one frame to the next.
    capsules : Capsules
        Capsules around the bones.
    height : float
        Stature in the unit of the file.
    up : int
        Index of the vertical axis.
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
    def from_motion(cls, motion: Motion, shape: Capsules | None = None) -> "Poses":
        """Return the world poses of all frames of a motion.

        `shape` are the capsules that represent the body; by default those that `capsules` returns.
        """
        skeleton = motion.skeleton
        world_rotations, positions = motion.world_transforms()
        return cls(
            skeleton=skeleton,
            frames=np.arange(motion.n_frames),
            rotations=world_rotations,
            positions=positions,
            frame_time=motion.frame_time,
            capsules=capsules(skeleton) if shape is None else shape,
            height=mass_model(skeleton).height,
            up=up_axis(motion),
        )

    def with_poses(
        self, frames: IntArray, world_rotations: FloatArray, positions: FloatArray
    ) -> "Poses":
        """Return the same body with other poses."""
        return replace(self, frames=frames, rotations=world_rotations, positions=positions)

    def __len__(self) -> int:
        return len(self.frames)

    @cached_property
    def ends(self) -> FloatArray:
        """Both ends of each capsule, shape (n, n_capsules, 2, 3)."""
        return self.capsules.ends(self.rotations, self.positions)

    def joint_positions(self, joint: str) -> FloatArray:
        """Return the world positions of the joint with this name, shape (n, 3)."""
        return self.positions[:, self.skeleton.index(joint)]
