"""Where feet are and when they stand, found without units.

Lengths are in skeleton heights, so that no number depends on a file's unit.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray, IntArray
from mograft._util.validate import check_type
from mograft.body.anatomy import anatomy
from mograft.body.mass import mass_model, up_axis
from mograft.config import FRAME
from mograft.motion import rotations
from mograft.motion.motion import Motion
from mograft.motion.skeleton import Skeleton

__all__ = [
    "CONTACT_HEIGHT",
    "SLIDING_SPEED",
    "Ground",
    "Leg",
    "detect_contacts",
    "find_legs",
    "foot_heights",
    "foot_skate",
    "horizontal_speeds",
    "runs",
    "skating_share",
]

CONTACT_HEIGHT = 0.03
"""Heights above its floor at which a heel or toe may stand."""
_SLOW = 0.25
"""Heights a second up to which it may move there: dancers press and roll."""
SLIDING_SPEED = 0.6
"""And just before and after: there it is coming to rest, or leaving."""
_SKATES_BELOW, _SKATES_ABOVE = 0.03, 0.3
"""A foot skates where it is lower than that, in heights, and faster, in heights a second."""
_SHORTEST = 3 * FRAME
_PAUSE = 2 * FRAME


@dataclass(frozen=True)
class Leg:
    """The joints of one leg, or of an animal's foreleg.

    Attributes
    ----------
    side : str
        ``"left"``, ``"right"`` or ``""``.
    hip, knee, ankle : int
        Where the leg starts, where it bends and where its foot starts.
    toe : int or None
        The joint at the ball of the foot, if there is one.
    tip : tuple of float
        Without such a joint: the end of the foot's bone, seen from the ankle; zero if unknown.
    """

    side: str
    hip: int
    knee: int
    ankle: int
    toe: int | None
    tip: tuple[float, float, float]


def find_legs(skeleton: Skeleton) -> tuple[Leg, ...]:
    """Return the legs of a skeleton that have a knee.

    Parameters
    ----------
    skeleton : Skeleton
        Human or animal; an animal's forelegs are legs too.

    Returns
    -------
    tuple of Leg
        Left before right, hind before fore. Empty where no leg is known.

    Examples
    --------
    >>> from mograft.dancer import dance
    >>> [leg.side for leg in find_legs(dance(strides=1).motion.skeleton)]
    ['left', 'right']
    """
    known, found = anatomy(skeleton), mass_model(skeleton)
    ends: list[tuple[str, int, int | None]] = [(f.side, f.ankle, f.toe) for f in found.feet]
    if not known.human:
        hands = [
            hand
            for hand in known.joints("hand")
            if hand not in known.details and known.parts[skeleton.parents[hand]] != "hand"
        ]
        ends += [(known.sides[hand], hand, _ball(skeleton, hand)) for hand in hands]
    several = []
    for side, ankle, toe in ends:
        above = int(skeleton.parents[ankle])
        lower = known.parts[above] if above >= 0 else ""
        if lower not in ("shank", "forearm"):
            continue
        knee = _highest(skeleton, known.parts, above)
        hip = int(skeleton.parents[knee])
        if hip < 0:
            continue
        hip = _highest(skeleton, known.parts, hip)
        tip = found.bone[ankle] if toe is None else np.zeros(3)
        several.append(Leg(side, hip, knee, ankle, toe, (tip[0], tip[1], tip[2])))
    return tuple(several)


def detect_contacts(motion: Motion) -> BoolArray:
    """Tell when heels and toes stand on the floor.

    Parameters
    ----------
    motion : Motion
        The motion; its floor is even.

    Returns
    -------
    ndarray of bool, shape (n_frames, n_legs, 2)
        For each of `legs` its heel (the ankle joint) and its toe. They stand where they are
        within 0.03 skeleton heights of the floor, which is the 5th percentile of their own
        height, and slower than 0.25 heights a second; for 0.1 s at least, and before and after
        that as long as they are slower than 0.6.
    """
    ground = Ground.of(motion)
    points = ground.points(motion)
    low = ground.above(points) < CONTACT_HEIGHT * ground.height
    fast = horizontal_speeds(points, motion.rate) / ground.height
    stands = low & (fast < _SLOW)
    slides = low & (fast < SLIDING_SPEED)
    for leg in range(stands.shape[1]):
        for point in range(2):
            tidy = _tidied(stands[:, leg, point], motion.rate)
            stands[:, leg, point] = _widened(tidy, slides[:, leg, point])
    return stands


def foot_heights(motion: Motion) -> FloatArray:
    """Return how high heels and toes are above the floor that `contacts` finds.

    Parameters
    ----------
    motion : Motion
        The motion.

    Returns
    -------
    ndarray, shape (n_frames, n_legs, 2)
        In skeleton heights; below 0 where they are lower than in 95 of 100 frames.
    """
    ground = Ground.of(motion)
    heights: FloatArray = ground.above(ground.points(motion)) / ground.height
    return heights


def foot_skate(motion: Motion) -> float:
    """Return the share of feet and frames that slide over the floor.

    Parameters
    ----------
    motion : Motion
        The motion.

    Returns
    -------
    float
        0 to 1. A foot slides where its heel or toe is lower than 0.03 skeleton heights above
        its floor and the slowest of those that are moves over the floor at more than 0.3
        heights a second: a foot that rolls over its toe does not. 0 without legs.

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
    """Where the floor is below each heel and toe.

    `up` is the unit vector that points up, `floors` (n_legs, 2) the height of the floor below
    heel and toe along it, `height` the stature.
    """

    limbs: tuple[Leg, ...]
    up: FloatArray
    floors: FloatArray
    height: float

    @classmethod
    def of(cls, motion: Motion) -> "Ground":
        """Find the floor of a motion: the 5th percentile of each heel's and toe's height."""
        found = mass_model(motion.skeleton)
        up = np.zeros(3)
        axis = up_axis(motion)
        places = motion.world_positions().mean(axis=0)
        ankles = [foot.ankle for foot in found.feet]
        stands = places[found.hips] - places[ankles].mean(axis=0) if ankles else np.ones(3)
        up[axis] = -1.0 if stands[axis] < 0 else 1.0
        ground = cls(find_legs(motion.skeleton), up, np.zeros((0, 2)), found.height)
        points = ground.points(motion)
        floors = np.percentile(points @ up, 5, axis=0) if points.size else np.zeros((0, 2))
        return cls(ground.limbs, up, floors, found.height)

    def points(self, motion: Motion) -> FloatArray:
        """Return where heels and toes are, shape (n_frames, n_legs, 2, 3)."""
        turned, placed = motion.world_transforms()
        points = np.empty((motion.n_frames, len(self.limbs), 2, 3))
        for index, limb in enumerate(self.limbs):
            points[:, index, 0] = placed[:, limb.ankle]
            if limb.toe is None:
                tip = np.tile(limb.tip, (motion.n_frames, 1))
                points[:, index, 1] = placed[:, limb.ankle] + rotations.rotate(
                    turned[:, limb.ankle], tip
                )
            else:
                points[:, index, 1] = placed[:, limb.toe]
        return points

    def above(self, points: FloatArray) -> FloatArray:
        """Return how high points are above their floors."""
        above: FloatArray = points @ self.up - self.floors
        return above


def _highest(skeleton: Skeleton, parts: Sequence[str], joint: int) -> int:
    """Return the highest joint above that is of the same part: rolls are not knees."""
    while skeleton.parents[joint] >= 0 and parts[skeleton.parents[joint]] == parts[joint]:
        joint = int(skeleton.parents[joint])
    return joint


def _ball(skeleton: Skeleton, hand: int) -> int | None:
    below = skeleton.children[hand]
    lengths = np.linalg.norm(skeleton.offsets, axis=1)
    return max(below, key=lambda joint: float(lengths[joint]), default=None)


def horizontal_speeds(points: FloatArray, rate: float) -> FloatArray:
    """Return speeds from frame to frame, at each frame the mean of both sides."""
    if len(points) < 2:
        return np.zeros(points.shape[:-1])
    velocity = np.gradient(points, axis=0) * rate
    speeds: FloatArray = np.linalg.norm(velocity, axis=-1)
    return speeds


def skating_share(motion: Motion, ground: Ground) -> float:
    """Return what `foot_skate` does, on a floor that is known."""
    points = ground.points(motion)
    if not points.size or motion.n_frames < 2:
        return 0.0
    low = ground.above(points) < _SKATES_BELOW * ground.height
    low = low[1:] & low[:-1]
    steps = np.diff(points, axis=0)
    level = steps - (steps @ ground.up)[..., None] * ground.up
    speeds = np.linalg.norm(level, axis=-1) * motion.rate
    slowest = np.where(low, speeds, np.inf).min(axis=-1)
    return float((low.any(axis=-1) & (slowest > _SKATES_ABOVE * ground.height)).mean())


def runs(marked: BoolArray) -> IntArray:
    """Return first and last frames of runs of marked frames, shape (n_runs, 2)."""
    edges = np.flatnonzero(np.diff(marked.astype(np.int8), prepend=0, append=0))
    runs: IntArray = edges.reshape(-1, 2) - np.array([0, 1])
    return runs


def _tidied(marked: BoolArray, rate: float) -> BoolArray:
    """Close short pauses, then drop short runs."""
    tidy = np.ones(len(marked), bool)
    inner = runs(~marked)
    for first, last in inner:
        inside = first > 0 and last < len(marked) - 1
        if not inside or last - first + 1 > round(_PAUSE * rate):
            tidy[first : last + 1] = False
    for first, last in runs(tidy):
        if last - first + 1 < round(_SHORTEST * rate):
            tidy[first : last + 1] = False
    return tidy


def _widened(marked: BoolArray, allowed: BoolArray) -> BoolArray:
    """Widen runs of marked frames as far as is allowed."""
    wide = marked.copy()
    for first, last in runs(allowed | marked):
        if marked[first : last + 1].any():
            wide[first : last + 1] = True
    return wide
