"""`bend`: a captured walk on another path: turned into an arc, or round obstacles."""

from collections.abc import Sequence

import numpy as np

from mograft._util.arrays import FloatArray, as_floats
from mograft._util.gaussian import gaussian_filter_columns
from mograft._util.validate import check_type
from mograft.blend.foot_planting import plant_feet
from mograft.blend.recombine import recombine
from mograft.blend.rigid_alignment import AlignmentTransform, RootTransforms, root_part
from mograft.body.capsules import Poses
from mograft.body.contacts import detect_contacts, foot_heights
from mograft.body.mass import mass_model, up_axis
from mograft.motion import rotations
from mograft.motion.motion import Motion
from mograft.search.pose_constraints import Avoid

_MIN_RADIUS, _EASY_RADIUS = 0.5, 1.5
"""Radius of a curve in skeleton heights, at least, and of the first way round that is tried."""
_SMOOTHING_SECONDS = 0.25  # removes the sway of the root from its path
_PLANTING_SECONDS = 0.5  # before the first bend, within which a foot on the floor may change
_STEP, _MAX_SHIFT = 0.05, 2.0  # shifts of the path that are tried, in skeleton heights
_CLEARANCE = 0.02  # skeleton heights that planted feet may move the body; see `_walk_round`


def bend(motion: Motion, turn: float = 0.0, avoid: Sequence[Avoid] = ()) -> Motion:
    """Bend the path of a captured walk, and plant its feet again.

    Parameters
    ----------
    motion : Motion
        The walk.
    turn : float
        Angle in radians by which its last frame is turned to the left; below 0 to the right. The
        path becomes an arc.
    avoid : sequence of Avoid
        Obstacles. The path leads round them: to the side, and back behind them.

    Returns
    -------
    Motion
        The walk on the new path. The length of the path, all joints below the root but those of the
        legs, and all frames more than 1.5 s before the first bend are as captured.

    Raises
    ------
    ValueError
        If a curve would have a radius below half of a skeleton height, or if no path that is
        shifted by up to two heights avoids the obstacles.

    Notes
    -----
    The figure is moved by one rigid transform in each frame. On the way round obstacles, the
    heading changes by a sine squared of the length of the path, on the longest ramp before them up
    to a radius of 1.5 heights. The smallest of the shifts by multiples of 0.05 heights to both
    sides is taken with which no capsule of the body is in an obstacle.

    Examples
    --------
    >>> from mograft.dancer import dance
    >>> walk = dance(strides=1).motion[:120]
    >>> bend(walk) is walk
    True
    """
    check_type("motion", motion, Motion)
    turn = float(as_floats("turn", turn, ()))
    for constraint in avoid:
        check_type("avoid", constraint, Avoid)
    if turn:
        path = _Path(motion)
        limit = path.total / _MIN_RADIUS
        if abs(turn) > limit:
            raise ValueError(
                f"`turn` must be at most {np.degrees(limit):.3g} degrees on this path of "
                f"{path.total:.3g} skeleton heights, got {np.degrees(turn):.6g}: a longer walk can "
                "turn further"
            )
        motion = path.follow(turn * path.lengths / path.total)
    return _walk_round(motion, avoid) if _depths(Poses.from_motion(motion), avoid).any() else motion


class _Path:
    """The path of a motion's root over the floor; lengths are in skeleton heights."""

    def __init__(self, motion: Motion) -> None:
        self.motion, self.up = motion, up_axis(motion)
        self.root = motion.locomotion_root()
        self.track = RootTransforms.from_motion(motion, self.root)
        floor = self.track.positions * (np.arange(3) != self.up)
        sigma = _SMOOTHING_SECONDS * motion.rate
        more = min(int(4 * sigma) + 1, len(floor) - 1)
        ends = 2 * floor[0] - floor[more:0:-1], 2 * floor[-1] - floor[-2 : -2 - more : -1]
        padded = gaussian_filter_columns(np.concatenate([ends[0], floor, ends[1]]), sigma)
        self.places = padded[more : more + len(floor)]
        self.height = mass_model(motion.skeleton).height
        steps = np.linalg.norm(np.diff(self.places, axis=0), axis=1) / self.height
        self.lengths = np.concatenate([[0.0], np.cumsum(steps)])
        self.total = float(self.lengths[-1])

    def transforms(self, headings: FloatArray) -> AlignmentTransform:
        """Return the transforms that turn the path by `headings`, in radians, in each frame."""
        axis = np.eye(3)[self.up]
        middles = rotations.from_axis_angle(axis, 0.5 * (headings[1:] + headings[:-1]))
        steps = rotations.rotate(middles, np.diff(self.places, axis=0))
        places = np.concatenate([self.places[:1], self.places[0] + np.cumsum(steps, axis=0)])
        yaws = rotations.from_axis_angle(axis, headings)
        return AlignmentTransform(yaws, places - rotations.rotate(yaws, self.places))

    def follow(self, headings: FloatArray) -> Motion:
        """Return the motion on the path that `headings` turn, with feet that do not slide."""
        motion, is_same = self.motion, np.cumsum(headings != 0.0) == 0
        new = self.transforms(headings).apply(self.track)
        bent = recombine(motion, [root_part(motion, self.root, new, is_same)], motion.name)
        # Feet are planted from shortly before the first bend.
        contacts, heights = detect_contacts(motion), foot_heights(motion)
        before = slice(max(int(is_same.sum() - _PLANTING_SECONDS * motion.rate), 0))
        contacts[before], heights[before] = False, -np.inf
        return plant_feet(bent, contacts, min_heights=heights)[0]


def _depths(poses: Poses, avoid: Sequence[Avoid], clearance: float = 0.0) -> FloatArray:
    """Return how deep the body is in obstacles in each frame, in heights; 0 if `clearance` away."""
    wider = [Avoid(o.obstacle, 1.0, o.margin + clearance, frames=o.frames) for o in avoid]
    return np.max([np.zeros(len(poses)), *(own.errors(poses)[0] for own in wider)], axis=0)


def _walk_round(motion: Motion, avoid: Sequence[Avoid]) -> Motion:
    """Return the motion on the path with the smallest shift on which it avoids the obstacles."""
    path, poses = _Path(motion), Poses.from_motion(motion)
    hits = path.lengths[np.flatnonzero(_depths(poses, avoid))[[0, -1]]]
    reason = f"a shift of {_MAX_SHIFT:g} skeleton heights to a side is not enough"
    for shift in np.arange(_STEP, _MAX_SHIFT + _STEP / 2, _STEP).tolist():
        # A heading of a sin² over a ramp of length l shifts by a l / 2; its radius is l / (pi a).
        shortest, easiest = (np.sqrt(2 * np.pi * shift * r) for r in (_MIN_RADIUS, _EASY_RADIUS))
        ramp = min(easiest, hits[0])
        if ramp < shortest:
            reason = f"{hits[0]:.3g} heights before the first contact are too few to turn away"
            break
        angle = 2.0 * shift / ramp
        starts = (path.lengths - hits[0]) / ramp + 1.0, (path.lengths - hits[1]) / ramp
        first = angle * np.sin(np.pi * starts[0].clip(0.0, 1.0)) ** 2
        # On a longer way, the figure passes the obstacles later.
        delay = np.gradient(path.lengths) @ (1.0 - np.cos(first)) / ramp
        last = angle * np.sin(np.pi * (starts[1] - delay).clip(0.0, 1.0)) ** 2
        for headings in (first - last, last - first):
            if _depths(path.transforms(headings).apply_to_poses(poses), avoid, _CLEARANCE).any():
                continue
            bent = path.follow(headings)
            if not _depths(Poses.from_motion(bent), avoid).any():
                return bent
    raise ValueError(
        f"no path round the obstacles of `avoid` was found: {reason}; place the obstacle further "
        "along the path or aside, or begin the walk earlier"
    )
