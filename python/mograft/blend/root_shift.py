"""Shifts of the root that bring planted feet within reach of their legs."""

from collections.abc import Sequence

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray
from mograft._util.gaussian import gaussian_filter
from mograft.body.contacts import Leg
from mograft.config import FRAME

_SMOOTHING_SECONDS = 3 * FRAME
_MAX_LEG_SHARE = 0.995  # hip-ankle distance per leg length, unless the leg is straighter already
_N_PROJECTIONS = 10
_MAX_SWEEPS, _SPEED_MARGIN = 1000, 0.9999
"""Maximum number of passes of `limit_floor_speed`, and their target as a share of the limit."""


def shift_for_reach(
    legs: Sequence[Leg],
    world_positions: FloatArray,
    displacements: FloatArray,
    is_planted: BoolArray,
    rate: float,
) -> FloatArray:
    """Return a smooth shift of the root, (n_frames, 3), with which planted feet are within reach.

    `world_positions`, shape (n_frames, n_joints, 3), are the positions of the joints.
    `displacements`, shape (n_frames, n_legs, 3), lead from the ankles to their targets.
    `is_planted`, shape (n_frames, n_legs), marks the legs whose ankle must reach its target. The
    shift is 0 if all of them do so without it. `rate` is in frames per second.
    """
    centers, radii = [], []
    for index, leg in enumerate(legs):
        hip, knee, ankle = (world_positions[:, j] for j in (leg.hip, leg.knee, leg.ankle))
        whole = np.linalg.norm(knee - hip, axis=1) + np.linalg.norm(ankle - knee, axis=1)
        current = np.linalg.norm(ankle - hip, axis=1)
        centers.append(ankle + displacements[:, index] - hip)
        reach = np.maximum(_MAX_LEG_SHARE * whole, current)
        radii.append(np.where(is_planted[:, index], reach, np.inf))

    def project(shift: FloatArray) -> FloatArray:
        """Project `shift`, for each leg in turn, onto the shifts by which its target is reached."""
        for _ in range(_N_PROJECTIONS):
            for center, radius in zip(centers, radii, strict=True):
                offset = shift - center
                distance = np.linalg.norm(offset, axis=1)
                is_out = distance > radius * (1.0 + 1e-9)
                shift = shift.copy()
                scale = (radius[is_out] / distance[is_out])[:, None]
                shift[is_out] = center[is_out] + offset[is_out] * scale
        return shift

    nearest = project(np.zeros((len(world_positions), 3)))
    if not nearest.any():
        return nearest
    # Each frame takes the largest shift nearby before smoothing, so that the smooth shift is large
    # enough: a correction after smoothing would be a jump.
    width = round(2 * _SMOOTHING_SECONDS * rate)
    sizes = np.pad(np.linalg.norm(nearest, axis=1), width, mode="edge")
    windows = np.lib.stride_tricks.sliding_window_view(sizes, 2 * width + 1)
    frames = (np.arange(len(nearest)) + windows.argmax(axis=1) - width).clip(0, len(nearest) - 1)
    smooth = [gaussian_filter(axis, _SMOOTHING_SECONDS * rate) for axis in nearest[frames].T]
    return project(np.stack(smooth, axis=1))


def limit_descent(shift: FloatArray, room: FloatArray, up: FloatArray) -> FloatArray:
    """Return a shift, (n_frames, 3), raised where it lowers a frame by more than `room`.

    `room`, shape (n_frames,), is in the unit of the file.
    """
    excess: FloatArray = np.maximum(-(shift @ up) - room, 0.0)
    return shift + excess[:, None] * up


def limit_floor_speed(shift: FloatArray, path: FloatArray, up: FloatArray) -> FloatArray:
    """Limit a shift so that the speed of the shifted path never exceeds the maximum of `path`.

    Only the speed over the floor counts. `shift` is added to `path`; both have shape (n_frames, 3);
    `up` is a unit vector. A shift that is slow enough is returned unchanged. Otherwise successive
    floor positions that are too far apart are moved towards each other, repeatedly. If 1000 passes
    are not enough, the horizontal shift is 0.
    """
    level = np.eye(3) - np.outer(up, up)
    given, target = path @ level, (path + shift) @ level
    limit = np.linalg.norm(np.diff(given, axis=0), axis=1).max(initial=0.0)
    moved = target.copy()
    for _ in range(_MAX_SWEEPS if limit > 0 else 0):
        steps = np.diff(moved, axis=0)
        speeds = np.linalg.norm(steps, axis=1)
        fast = np.flatnonzero(speeds > limit)
        if not len(fast):
            return shift + (moved - target)
        # The target is slightly below the limit, so that the iteration ends.
        correction = 0.5 * (1.0 - _SPEED_MARGIN * limit / speeds[fast])[:, None] * steps[fast]
        moved[fast] += correction
        moved[fast + 1] -= correction
    return shift + (given - target)
