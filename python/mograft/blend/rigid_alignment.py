"""Where the joint that carries a body stands, and bodies moved over the floor to stand there."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from mograft._util.arrays import FloatArray, IntArray
from mograft.body.world_poses import Poses
from mograft.motion import rotations
from mograft.motion.motion import Motion

__all__ = ["Placement", "Root"]


@dataclass(frozen=True, eq=False)
class Root:
    """A root at some moments, in the world.

    Attributes
    ----------
    turns : ndarray, shape (n, 4)
        Its rotations, xyzw.
    spots : ndarray, shape (n, 3)
        Its places, in the file's unit.
    """

    turns: FloatArray
    spots: FloatArray

    @classmethod
    def of(cls, motion: Motion, joint: int) -> "Root":
        """Return a joint of a motion in all frames; the top one's numbers are the motion's own."""
        chain = [joint]
        while (parent := int(motion.skeleton.parents[chain[-1]])) >= 0:
            chain.append(parent)
        turns, spots = motion.rotations[:, chain[-1]], motion.positions[:, chain[-1]]
        for below in chain[-2::-1]:
            spots = spots + rotations.rotate(turns, motion.positions[:, below])
            turns = rotations.multiply(turns, motion.rotations[:, below])
        return cls(turns, spots)

    def under(self, motion: Motion, frames: IntArray, joint: int) -> "Root":
        """Return it as its parent sees it, the parent being as in frames of a motion."""
        parent = int(motion.skeleton.parents[joint])
        if parent < 0:
            return self
        above = Root.of(motion, parent)[frames]
        back = rotations.inverse(above.turns)
        return Root(
            rotations.multiply(back, self.turns),
            rotations.rotate(back, self.spots - above.spots),
        )

    def __getitem__(self, which: npt.NDArray[np.bool_] | IntArray) -> "Root":
        return Root(self.turns[which], self.spots[which])

    def __len__(self) -> int:
        return len(self.turns)


@dataclass(frozen=True, eq=False)
class Placement:
    """Turns about up, each with a shift over the floor.

    Attributes
    ----------
    yaws : ndarray, shape (n, 4)
        The turns, xyzw, about the world's origin.
    shifts : ndarray, shape (n, 3)
        The shifts, in the file's unit; 0 along up.
    """

    yaws: FloatArray
    shifts: FloatArray

    @classmethod
    def onto(cls, own: Root, wanted: Root, up: int) -> "Placement":
        """Return how to move roots so that they stand and head as others do.

        Parameters
        ----------
        own, wanted : Root
            As many of each.
        up : int
            The axis that points up.

        Returns
        -------
        Placement
            It leaves heights and leans as they are, and what is there already to the bit.

        Notes
        -----
        The heading between two rotations is the twist about up of what leads from the one to
        the other.

        Examples
        --------
        >>> ahead = Root(np.array([[0.0, 0, 0, 1]]), np.array([[1.0, 9, 2]]))
        >>> about = Root(np.array([[0.0, 1, 0, 0]]), np.array([[5.0, 8, 5]]))
        >>> Placement.onto(ahead, about, up=1).root(ahead).spots
        array([[5., 9., 5.]])
        """
        between = rotations.multiply(wanted.turns, rotations.inverse(own.turns))
        yaws = rotations.twist(between, up)
        level = np.arange(3) != up
        shifts = level * (wanted.spots - rotations.rotate(yaws, own.spots))
        there = (own.turns == wanted.turns).all(axis=1) & (own.spots == wanted.spots).all(axis=1)
        yaws[there], shifts[there] = rotations.IDENTITY, 0.0
        return cls(yaws, shifts)

    def __getitem__(self, which: npt.NDArray[np.bool_] | IntArray) -> "Placement":
        return Placement(self.yaws[which], self.shifts[which])

    def root(self, root: Root) -> Root:
        """Return roots, as many, moved."""
        return Root(
            rotations.multiply(self.yaws, root.turns),
            rotations.rotate(self.yaws, root.spots) + self.shifts,
        )

    def poses(self, poses: Poses) -> Poses:
        """Return whole bodies, as many, moved."""
        # As matrices, for all joints at once.
        turns = rotations.multiply(self.yaws[:, None], np.eye(4))
        axes = rotations.rotate(self.yaws[:, None], np.eye(3))
        return poses.with_poses(
            poses.frames, poses.rotations @ turns, poses.positions @ axes + self.shifts[:, None]
        )
