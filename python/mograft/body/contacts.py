"""Foot contacts: legs, floor heights, and frames in which feet are in contact or skate."""

from dataclasses import dataclass

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray
from mograft._util.runs import extend_runs, find_runs
from mograft._util.validate import check_type
from mograft.body.anatomy import anatomy, highest_of_part
from mograft.body.mass import mass_model, mean_world_positions, up_axis
from mograft.config import FRAME
from mograft.motion import rotations
from mograft.motion.motion import Motion
from mograft.motion.skeleton import Skeleton

CONTACT_HEIGHT = 0.03
"""Maximum height above the floor of a heel or toe in contact, in skeleton heights."""
_CONTACT_SPEED = 0.25
"""Maximum speed of a heel or toe in contact, in skeleton heights per second."""
SLIDING_SPEED = 0.6
"""Maximum speed just before and after a contact, in skeleton heights per second."""
_SKATING_HEIGHT, _SKATING_SPEED = 0.03, 0.3
"""Height below and speed above which a foot skates, in skeleton heights and heights per second."""
_MIN_CONTACT_SECONDS = 3 * FRAME
_MAX_GAP_SECONDS = 2 * FRAME


@dataclass(frozen=True)
class Leg:
    """The joints of one leg, or of the foreleg of an animal."""

    side: str  # "left", "right" or ""
    hip: int  # upper end of the leg
    knee: int
    ankle: int
    toe: int | None  # the joint at the ball of the foot, if there is one
    tip: tuple[float, float, float]  # if `toe` is None: from the ankle to the tip of the foot


def find_legs(skeleton: Skeleton) -> tuple[Leg, ...]:
    """Return the legs that have a knee joint, left before right, then the forelegs of animals."""
    known, found = anatomy(skeleton), mass_model(skeleton)
    ends: list[tuple[str, int, int | None]] = [(f.side, f.ankle, f.toe) for f in found.feet]
    lengths = np.linalg.norm(skeleton.offsets, axis=1)
    for hand in () if known.human else known.highest("hand", skeleton):
        if hand not in known.details:
            longest = max(skeleton.children[hand], key=lambda child: lengths[child], default=None)
            ends.append((known.sides[hand], hand, longest))
    found_legs = []
    for side, ankle, toe in ends:
        above = int(skeleton.parents[ankle])
        knee = highest_of_part(skeleton, above)
        hip = int(skeleton.parents[knee])
        if above < 0 or hip < 0 or known.parts[above] not in ("shank", "forearm"):
            continue
        tip = found.bone[ankle] if toe is None else np.zeros(3)
        hip = highest_of_part(skeleton, hip)
        found_legs.append(Leg(side, hip, knee, ankle, toe, (tip[0], tip[1], tip[2])))
    return tuple(found_legs)


def detect_contacts(motion: Motion) -> BoolArray:
    """Return whether each heel and toe touches a level floor, bool, shape (n_frames, n_legs, 2).

    On the last axis, index 0 is the heel, for which the ankle joint is used, and index 1 the toe.
    The floor of a point is the 5th percentile of its height over all frames. A point is in contact
    if it is within 0.03 skeleton heights of its floor and slower than 0.25 heights per second for
    at least 0.1 s; gaps of up to 0.07 s are ignored. The contact extends to adjacent frames in
    which the point is as low and slower than 0.6 heights per second.
    """
    ground = Ground.of(motion)
    points = ground.points(motion)
    low = ground.above(points) < CONTACT_HEIGHT * ground.height
    speed = point_speeds(points, motion.rate) / ground.height
    stands = low & (speed < _CONTACT_SPEED)
    slides = low & (speed < SLIDING_SPEED)
    for leg, point in np.ndindex(stands.shape[1:]):
        runs_kept = _remove_short_runs(stands[:, leg, point], motion.rate)
        stands[:, leg, point] = extend_runs(runs_kept, slides[:, leg, point])
    return stands


def foot_heights(motion: Motion) -> FloatArray:
    """Return the heights of heels and toes above the floor, shape (n_frames, n_legs, 2).

    The unit is the skeleton height. The floor is that of `detect_contacts`; points below it have
    negative heights.
    """
    ground = Ground.of(motion)
    return ground.above(ground.points(motion)) / ground.height


def foot_skate(motion: Motion) -> float:
    """Return the fraction of the steps from frame to frame in which a foot slides.

    A step is counted once for each foot. A foot slides if its heel or toe is less than 0.03
    skeleton heights above its floor and moves horizontally faster than 0.3 heights per second. If
    both heel and toe are that low, both must be that fast, so that a foot that rolls over its toe
    does not slide.

    Parameters
    ----------
    motion : Motion
        The motion.

    Returns
    -------
    float
        0 to 1; 0 without legs.

    Examples
    --------
    >>> from mograft.dancer import dance
    >>> 0.0 < foot_skate(dance(strides=1).motion) < 0.3
    True
    """
    check_type("motion", motion, Motion)
    return skating_share(motion, Ground.of(motion))


@dataclass(frozen=True, eq=False)
class Ground:
    """Heights of the floor, in world coordinates, below each heel and toe."""

    limbs: tuple[Leg, ...]
    up: FloatArray  # unit vector
    floors: FloatArray  # of heel and toe along `up`, (n_legs, 2)
    height: float  # stature

    @classmethod
    def of(cls, motion: Motion) -> "Ground":
        """Estimate the floor below each heel and toe as the 5th percentile of its height."""
        found, means = mass_model(motion.skeleton), mean_world_positions(motion)
        up, axis = np.zeros(3), up_axis(motion)
        ankles = [foot.ankle for foot in found.feet]
        leg = means[found.hips] - means[ankles].mean(axis=0) if ankles else np.ones(3)
        up[axis] = -1.0 if leg[axis] < 0 else 1.0
        ground = cls(find_legs(motion.skeleton), up, np.zeros((0, 2)), found.height)
        points = ground.points(motion)
        floors = np.percentile(points @ up, 5, axis=0) if points.size else np.zeros((0, 2))
        return cls(ground.limbs, up, floors, found.height)

    @classmethod
    def below(cls, motion: Motion, floor_reference: Motion | None) -> "Ground":
        """Return the floor of `floor_reference`; None means that of `motion`.

        Raises TypeError if `floor_reference` is not a motion, SkeletonMismatchError if it has
        another hierarchy than `motion`.
        """
        if floor_reference is None:
            return cls.of(motion)
        check_type("floor_reference", floor_reference, Motion)
        motion.skeleton.check_same_hierarchy(floor_reference.skeleton, "`floor_reference`")
        return cls.of(floor_reference)

    def points(self, motion: Motion) -> FloatArray:
        """Return the positions of each leg's heel and toe, shape (n_frames, n_legs, 2, 3)."""
        points = np.empty((motion.n_frames, len(self.limbs), 2, 3))
        for frames, world_rotations, positions in motion.world_blocks():
            for index, limb in enumerate(self.limbs):
                points[frames, index, 0] = ankle = positions[:, limb.ankle]
                if limb.toe is None:
                    bone = rotations.rotate(world_rotations[:, limb.ankle], np.array(limb.tip))
                    points[frames, index, 1] = ankle + bone
                else:
                    points[frames, index, 1] = positions[:, limb.toe]
        return points

    def above(self, points: FloatArray) -> FloatArray:
        """Return heights above the floors in the unit of the file, shape (n_frames, n_legs, 2).

        `points` is a result of the method `points`. Each height is measured from the floor below
        the heel or toe.
        """
        return points @ self.up - self.floors


def point_speeds(points: FloatArray, rate: float) -> FloatArray:
    """Return the speeds of points in units of length per second, shape (n_frames, ...).

    `points` has shape (n_frames, ..., 3), and `rate` is in frames per second. Velocities are
    central differences.
    """
    if len(points) < 2:
        return np.zeros(points.shape[:-1])
    velocity = np.gradient(points, axis=0) * rate
    return np.linalg.norm(velocity, axis=-1)


def skating_share(motion: Motion, ground: Ground) -> float:
    """Return `foot_skate` for a given floor."""
    slides = sliding_feet(motion, ground)
    return float(slides.mean()) if slides.size else 0.0


def sliding_feet(motion: Motion, ground: Ground) -> BoolArray:
    """Return which feet slide in each step from frame to frame, shape (n_frames - 1, n_legs)."""
    points = ground.points(motion)
    low = ground.above(points) < _SKATING_HEIGHT * ground.height
    low = low[1:] & low[:-1]
    steps = np.diff(points, axis=0)
    level = steps - (steps @ ground.up)[..., None] * ground.up
    speeds = np.linalg.norm(level, axis=-1) * motion.rate
    slowest = np.where(low, speeds, np.inf).min(axis=-1)
    return low.any(axis=-1) & (slowest > _SKATING_SPEED * ground.height)


def _remove_short_runs(marked: BoolArray, rate: float) -> BoolArray:
    """Return a mask in which short gaps are marked, and then short runs are unmarked.

    A gap is short if it lasts at most 2/30 s and is not at an end of the mask. A run is short if it
    lasts less than 3/30 s.
    """
    kept = marked.copy()
    for start, stop in find_runs(~marked):
        is_inner = start > 0 and stop < len(marked)
        kept[start:stop] = is_inner and stop - start <= round(_MAX_GAP_SECONDS * rate)
    for start, stop in find_runs(kept):
        kept[start:stop] &= stop - start >= round(_MIN_CONTACT_SECONDS * rate)
    return kept
