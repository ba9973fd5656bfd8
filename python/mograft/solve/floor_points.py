"""Points of the feet and hands that an exchanged joint group can move below the floor."""

from dataclasses import dataclass

import numpy as np

from mograft._util.arrays import FloatArray, IntArray
from mograft._util.memo import remember
from mograft.body.anatomy import anatomy
from mograft.body.contacts import Ground
from mograft.body.mass import mass_model
from mograft.motion import rotations
from mograft.motion.motion import Motion
from mograft.motion.skeleton import Skeleton
from mograft.solve.search_problem import SearchProblem


@dataclass(frozen=True, eq=False)
class FloorPoints:
    """Heels, toes, wrists and ends of hands, each with the height of the floor below it."""

    joints: IntArray  # the joint to which each point is fixed, shape (n_points,)
    offsets: FloatArray  # from that joint, in its local axes, (n_points, 3)
    floors: FloatArray  # along `up`, (n_points,)
    up: FloatArray  # unit vector

    @classmethod
    def of_group(cls, problem: SearchProblem, group: str) -> "FloorPoints":
        """Return the points that the group moves; empty if the skeleton has no known leg.

        Feet that `plant_feet` raises above the floor afterwards are not among them. The floors are
        those of `Ground`; below a hand, the lowest of them.
        """
        base = problem.base
        skeleton, ground = base.skeleton, remember(base, "ground", lambda: Ground.of(base))
        joints, offsets, floors = [], [], []
        plants = problem.config.feet != "never"
        for leg, is_movable, own in zip(
            ground.limbs, problem.movable_legs, ground.floors, strict=True
        ):
            if not (plants and is_movable):
                toe = leg.ankle if leg.toe is None else leg.toe
                joints += [leg.ankle, toe]
                offsets += [(0.0, 0.0, 0.0), leg.tip]
                floors += own.tolist()
        if ground.limbs:
            for hand in _hands(skeleton, ground):
                joints += [hand, hand]
                offsets += [(0.0, 0.0, 0.0), tuple(mass_model(skeleton).bone[hand].tolist())]
                floors += 2 * [float(ground.floors.min())]
        members = set(problem.library.joints(group).tolist())
        is_moved = [not members.isdisjoint([own, *skeleton.ancestors(own)]) for own in joints]
        return cls(
            np.array(joints, np.int64)[is_moved],
            np.array(offsets).reshape(-1, 3)[is_moved],
            np.array(floors)[is_moved],
            ground.up,
        )

    def depths(self, motion: Motion) -> FloatArray:
        """Return the depth of each point below the floor, shape (n_frames, n_points).

        It is in the unit of the file, and negative above the floor.
        """
        if not len(self.joints):
            return np.zeros((motion.n_frames, 0))
        depths = np.empty((motion.n_frames, len(self.joints)))
        for frames, quats, positions in motion.world_blocks():
            arms = rotations.rotate(quats[:, self.joints], self.offsets)
            depths[frames] = self.floors - (positions[:, self.joints] + arms) @ self.up
        return depths


def _hands(skeleton: Skeleton, ground: Ground) -> list[int]:
    """Return the first joint of each hand that is not the foot of a foreleg."""
    known, feet = anatomy(skeleton), {leg.ankle for leg in ground.limbs}
    return [
        joint
        for joint in known.joints("hand")
        if joint not in known.details
        and joint not in feet
        and known.parts[skeleton.parents[joint]] != "hand"
    ]
