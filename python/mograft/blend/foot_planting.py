"""`plant_feet`: bend legs so that feet in contact with the floor do not slide.

After Kovar, Schreiner and Gleicher, Footskate Cleanup for Motion Capture Editing (2002).
Lengths are in skeleton heights, so that no number depends on a file's unit.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from mograft._util.arrays import BoolArray, FloatArray
from mograft._util.gaussian import gaussian_filter_columns
from mograft._util.runs import find_runs
from mograft._util.validate import check_type
from mograft.blend import foot_targets
from mograft.blend.recombine import Part, recombine
from mograft.blend.two_bone_ik import bend_leg
from mograft.body.contacts import Ground, Leg, detect_contacts, find_legs, skating_share
from mograft.config import FRAME
from mograft.motion import rotations
from mograft.motion.motion import Motion

_MAX_ERROR = 1e-4  # skeleton heights; a foot farther from its plant counts as unreached

_SMOOTHING_SECONDS = 3 * FRAME
_MAX_LEG_SHARE = 0.995  # hip-ankle distance per leg length, unless the leg is straighter already
_N_PROJECTIONS = 10
_MAX_SWEEPS, _SPEED_MARGIN = 1000, 0.9999
"""Maximum number of passes of `limit_floor_speed`, and their target as a share of the limit."""


@dataclass(frozen=True)
class FeetReport:
    """The changes that `plant_feet` made to a motion.

    Attributes
    ----------
    plants : int
        Number of plants: intervals in which a heel or a toe stays in contact with the floor.
    skate_before, skate_after : float
        Result of `foot_skate` for the motion before and after.
    moved_root : float
        Maximum shift of the root, in skeleton heights.
    unreached : float
        Maximum distance of a heel or toe from the position of its plant, in skeleton heights.
    unreached_frames : int
        Number of frames in which such a distance exceeds 1e-4 skeleton heights.
    """

    plants: int
    skate_before: float
    skate_after: float
    moved_root: float = 0.0
    unreached: float = 0.0
    unreached_frames: int = 0


def plant_feet(
    motion: Motion,
    foot_contacts: BoolArray | None = None,
    *,
    movable_legs: Sequence[bool] | None = None,
    move_root: bool = True,
    floor_reference: Motion | None = None,
    min_heights: npt.ArrayLike | None = None,
) -> tuple[Motion, FeetReport]:
    """Bend legs so that feet in contact with the floor do not slide.

    Parameters
    ----------
    motion : Motion
        The motion to correct.
    foot_contacts : ndarray of bool, shape (n_frames, n_legs, 2), optional
        Whether the heel and the toe of each leg are in contact with the floor. Default: the result
        of `detect_contacts`.
    movable_legs : sequence of bool, optional
        Whether each leg may be bent. Default: all may.
    move_root : bool
        Whether the root may be moved if a leg is too short to reach its target.
    floor_reference : Motion, optional
        A motion of the same skeleton on the same floor, from which the floor height and the maximum
        depth of the feet below the floor are estimated. A longer motion gives a better estimate.
        Default: `motion`.
    min_heights : array_like, shape (n_frames, n_legs, 2), optional
        Minimum heights of heels and toes above the floor while they are not in contact, in
        skeleton heights. Values above 0.05 count as 0.05. Default: none.

    Returns
    -------
    motion : Motion
        The motion with bent legs. The root is moved only if a leg cannot reach its target. Frames
        that need no change are returned bit for bit.
    report : FeetReport
        The changes, and the remaining distances of feet from their targets.

    Raises
    ------
    ValueError
        If the shape of `foot_contacts`, `min_heights` or `movable_legs` does not fit the motion's
        legs, or `min_heights` has NaN.
    SkeletonMismatchError
        If `floor_reference` has another hierarchy.

    Notes
    -----
    During a contact, the heel or toe stays at the mean of its positions, with the height clamped to
    0.01 skeleton heights below the floor to 0.03 above it. Before and after the contact, the
    displacement fades to 0 within 0.1 s. The leg is bent in its plane: the knee sets the distance
    from hip to ankle, the hip sets the direction. The foot is rotated so that heel and toe reach
    their targets.

    The depth of a heel or toe below the floor exceeds its depth in the same frame of `motion` by at
    most 0.001 skeleton heights. On `movable_legs` it also exceeds the maximum depth in
    `floor_reference` by at most 0.001 heights. A heel or toe below this limit is raised; if it is
    in contact, in all frames of the contact. The root is not lowered so far that the foot of
    another leg falls below the limit.

    Examples
    --------
    >>> from mograft.dancer import dance
    >>> still, report = plant_feet(dance(strides=1).motion)
    >>> report.skate_after <= report.skate_before
    True
    """
    check_type("motion", motion, Motion)
    legs = find_legs(motion.skeleton)
    shape = (motion.n_frames, len(legs), 2)
    contacts = detect_contacts(motion) if foot_contacts is None else foot_contacts
    contacts = _check_shape("foot_contacts", contacts, shape, np.bool_)
    movable = np.ones(len(legs), bool) if movable_legs is None else movable_legs
    movable = _check_shape("movable_legs", movable, shape[1:2], np.bool_)
    heights = np.full(shape, -np.inf) if min_heights is None else min_heights
    heights = _check_shape("min_heights", heights, shape, np.float64)
    if np.isnan(heights).any():
        raise ValueError("`min_heights` must be numbers, got NaN")
    ground = Ground.below(motion, floor_reference)
    skate_before = skating_share(motion, ground)
    has_task = contacts.any() or min_heights is not None or floor_reference is not None
    if not has_task or not movable.any():
        return motion, FeetReport(plants=0, skate_before=skate_before, skate_after=skate_before)
    points = ground.points(motion)
    planted = foot_targets.remove_sliding_frames(contacts, points, ground, motion.rate)
    heights = np.where(contacts & ~planted, foot_targets.CLEARANCE, heights)
    recorded = points if floor_reference is None else ground.points(floor_reference)
    lowest = foot_targets.lowest_heights(points, recorded, ground)
    displacements = np.zeros_like(points)
    bent_legs = np.flatnonzero(movable).tolist()
    for leg in bent_legs:
        own = points[:, leg], planted[:, leg], heights[:, leg], lowest[:, leg]
        displacements[:, leg] = foot_targets.foot_displacements(*own, ground, leg, motion.rate)
    planted &= movable[None, :, None]
    world_rotations, world_positions = motion.world_transforms()
    shift = np.zeros((motion.n_frames, 3))
    if move_root:
        is_planted = planted[..., 0] | planted[..., 1]
        shift = shift_for_reach(
            legs, world_positions, displacements[:, :, 0], is_planted, motion.rate
        )
        room = points[:, ~movable] @ ground.up - lowest[:, ~movable]
        shift = _limit_shift(motion, shift, room, ground)
    moved_positions = world_positions + shift[:, None]
    parts = []
    for leg in bent_legs:
        moved = points[:, leg] + shift[:, None], displacements[:, leg] - shift[:, None]
        bent = bend_leg(motion, world_rotations, moved_positions, legs[leg], *moved)
        parts += [bent] if bent else []
    parts += [_shifted_root(motion, world_rotations, shift)] if shift.any() else []
    still = recombine(motion, parts, motion.name)
    errors = np.linalg.norm(ground.points(still) - (points + displacements), axis=-1)
    errors = np.where(planted, errors / ground.height, 0.0)
    columns = planted.reshape(len(planted), -1).T
    return still, FeetReport(
        plants=sum(len(find_runs(column)) for column in columns),
        skate_before=skate_before,
        skate_after=skating_share(still, ground),
        moved_root=float(np.linalg.norm(shift, axis=1).max()) / ground.height,
        unreached=float(errors.max()),
        unreached_frames=int((errors > _MAX_ERROR).any(axis=(1, 2)).sum()),
    )


def _limit_shift(motion: Motion, shift: FloatArray, room: FloatArray, ground: Ground) -> FloatArray:
    """Limit the floor speed of a shifted root, and the descent of legs that do not bend.

    The speed is limited to the captured maximum. `room`, shape (n_frames, n_fixed_legs, 2), is the
    distance by which the heel and toe of each leg that does not bend may be lowered.
    """
    path = motion.world_positions()[:, motion.locomotion_root()]
    shift = limit_floor_speed(shift, path, ground.up)
    room = np.maximum(room.min(axis=(1, 2), initial=np.inf), 0.0)
    excess: FloatArray = np.maximum(-(shift @ ground.up) - room, 0.0)
    return shift + excess[:, None] * ground.up


def _check_shape(
    name: str, value: npt.ArrayLike, shape: tuple[int, ...], kind: type[np.generic]
) -> npt.NDArray[Any]:
    """Return `value` as an array of `kind`; raise ValueError if it has another shape."""
    array = np.array(value, kind)
    if array.shape != shape:
        raise ValueError(f"`{name}` must have shape {shape}, got {array.shape}")
    return array


def _shifted_root(motion: Motion, world_rotations: FloatArray, shift: FloatArray) -> Part:
    """Return the motion of the root with `shift`, in world axes, added to its position."""
    root = motion.locomotion_root()
    parent = int(motion.skeleton.parents[root])
    if parent >= 0:
        shift = rotations.rotate(rotations.inverse(world_rotations[:, parent]), shift)
    positions = motion.positions[:, root] + shift
    return Part(np.array([root]), motion.rotations[:, root][:, None], positions[:, None])


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
    return project(gaussian_filter_columns(nearest[frames], _SMOOTHING_SECONDS * rate))


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
