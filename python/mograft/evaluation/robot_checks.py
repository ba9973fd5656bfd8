"""Whether a robot can follow a motion: limits, velocities, accelerations, feet and balance."""

from collections.abc import Iterable, Mapping

import numpy as np

from mograft.analysis.zero_moment import SMOOTHING_SECONDS, smooth_tracks
from mograft.body import support_polygon as body
from mograft.body.capsules import Poses
from mograft.body.contacts import Ground, skating_share
from mograft.io.robots.poses import hinges_of
from mograft.motion import rotations
from mograft.motion.hinges import Hinges
from mograft.motion.motion import Motion
from mograft.search.pose_constraints import AvoidSelf

UNITS = {
    "limits": "° beyond the limits of a joint",
    "speed": "rad/s",
    "overspeed": "rad/s above the limit of a joint",
    "acceleration": "rad/s²",
    "skating": "% of the frames",
    "zero_moment": "% of the frames outside the feet",
    "self_contact": "% of the frames",
    "floor": "cm below the floor",
}
"""The unit of each result of `robot_checks`."""

_PERCENTILE = 99
"""Of speeds and accelerations over all joints and frames; of recordings in `feasible_limits`."""


def robot_checks(motion: Motion, floor_reference: Motion | None = None) -> dict[str, float]:
    """Return measures of a robot's motion, with the keys and units of `UNITS`.

    Speed and acceleration are the 99th percentile over all joints and frames, excesses the maximum.
    The zero-moment point is that of the masses of the model; its share is of the frames on the
    floor, and 0 without masses or legs. The floor is that of `floor_reference`, by default of
    `motion`. Raises ValueError if the skeleton has no hinges.
    """
    hinges, rate = hinges_of(motion.skeleton), motion.rate
    angles, floor = hinges.angles(motion.rotations), Ground.below(motion, floor_reference)
    speeds, rates, outside = np.zeros_like(angles), np.zeros_like(angles), 0.0
    poses = Poses.from_motion(motion)
    if motion.n_frames > 2:
        speeds = np.gradient(angles, axis=0) * rate
        rates = np.gradient(speeds, axis=0) * rate
        outside = _share_outside(motion, hinges, poses, floor_reference) if floor.limbs else 0.0
    contact, _ = AvoidSelf(tolerance=1.0).errors(poses)
    depths = -floor.above(floor.points(motion))
    values = (
        np.degrees(np.abs(hinges.excess(angles)).max()),
        np.percentile(np.abs(speeds), _PERCENTILE),
        np.maximum(np.abs(speeds) - hinges.speeds, 0.0).max(),
        np.percentile(np.abs(rates), _PERCENTILE),
        100.0 * skating_share(motion, floor),
        100.0 * outside,
        100.0 * (contact > 0.0).mean(),
        100.0 * np.maximum(depths, 0.0).max(initial=0.0),
    )
    return dict(zip(UNITS, np.round(values, 9).tolist(), strict=True))  # less is rounding


def _share_outside(motion: Motion, hinges: Hinges, poses: Poses, base: Motion | None) -> float:
    """Return the share of the frames on the floor whose zero-moment point is outside the feet."""
    centers = poses.positions + rotations.rotate(poses.rotations, hinges.centers)
    center = (hinges.masses[:, None] * centers).sum(axis=1) / max(hinges.masses.sum(), 1e-9)
    center = smooth_tracks(center, SMOOTHING_SECONDS * motion.rate)
    moved = np.gradient(np.gradient(center, axis=0), axis=0) * motion.rate**2
    support = body.support_polygons(motion, floor_reference=base)
    # Lengths are metres: with this height gravity is not scaled.
    floor = support.up, support.floor, body.STATURE_METERS
    points, is_loaded = body.zero_moment_points(center, moved, *floor)
    away = body.signed_distance(support.polygons, support.sizes, points[:, support.axes])
    is_loaded &= (support.sizes > 0) & (hinges.masses.sum() > 0.0)
    return float((away[is_loaded] > 0.0).sum() / max(is_loaded.sum(), 1))


def feasible_limits(recordings: Iterable[Motion]) -> dict[str, float]:
    """Return the 99th percentile of each measure over recordings."""
    rows = [list(robot_checks(own).values()) for own in recordings]
    highest = np.percentile(rows, _PERCENTILE, axis=0, method="higher")
    return dict(zip(UNITS, highest.tolist(), strict=True))


def describe_checks(checks: Mapping[str, float]) -> str:
    """Return a line with all measures."""
    return "; ".join(f"{name} {checks[name]:.3g} {unit}" for name, unit in UNITS.items())
