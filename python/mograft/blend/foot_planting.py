"""`plant_feet`: legs are bent so that standing feet do not slide.

After Kovar, Schreiner and Gleicher, Footskate Cleanup for Motion Capture Editing (2002).
Lengths are in skeleton heights, so that no number depends on a file's unit.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray
from mograft._util.runs import find_runs
from mograft._util.validate import check_type
from mograft.blend.foot_targets import (
    CLEARANCE,
    contacts_at_rest,
    foot_displacements,
    lowest_heights,
)
from mograft.blend.recombine import Part, recombine
from mograft.blend.root_shift import limit_descent, limit_floor_speed, shift_for_reach
from mograft.blend.two_bone_ik import bend_leg
from mograft.body.contacts import Ground, detect_contacts, find_legs, skating_share
from mograft.motion import rotations
from mograft.motion.motion import Motion

_MAX_ERROR = 1e-4  # skeleton heights; farther from its plant, a foot counts as out of reach


@dataclass(frozen=True)
class FeetReport:
    """What `plant_feet` changed.

    Attributes
    ----------
    plants : int
        Number of intervals in which a heel or a toe stands.
    skate_before, skate_after : float
        Share of feet and frames that skate; see `foot_skate`.
    moved_root : float
        Greatest shift of the root, in skeleton heights.
    unreached : float
        Greatest distance of a heel or toe from its plant, in skeleton heights.
    unreached_frames : int
        Number of frames in which such a distance exceeds 1e-4 skeleton heights.
    """

    plants: int
    skate_before: float
    skate_after: float
    moved_root: float
    unreached: float
    unreached_frames: int


def plant_feet(
    motion: Motion,
    foot_contacts: BoolArray | None = None,
    *,
    movable_legs: Sequence[bool] | None = None,
    move_root: bool = True,
    floor_reference: Motion | None = None,
    min_heights: FloatArray | None = None,
) -> tuple[Motion, FeetReport]:
    """Keep standing feet from sliding.

    Parameters
    ----------
    motion : Motion
        The motion.
    foot_contacts : ndarray of bool, shape (n_frames, n_legs, 2), optional
        In which frames heels and toes stand. Default: they are detected.
    movable_legs : sequence of bool, optional
        Which legs may be bent. Default: all.
    move_root : bool
        Whether the root may be moved if a leg is too short.
    floor_reference : Motion, optional
        A motion of the same skeleton on the same floor, from which the floor is estimated, and the
        greatest depth of feet; the longer, the more exact. Default: `motion`.
    min_heights : ndarray, shape (n_frames, n_legs, 2), optional
        Least heights of heels and toes above the floor while they do not stand, in skeleton
        heights. Values above 0.05 count as 0.05. Default: none.

    Returns
    -------
    motion : Motion
        The motion with bent legs. The root is moved only where a leg does not reach. Frames that
        need no change keep every number.
    report : FeetReport
        The changes, and the distances that remain.

    Raises
    ------
    ValueError
        If the shape of `foot_contacts` or `min_heights`, or the length of `movable_legs`, does not
        fit the motion's legs.

    Notes
    -----
    A standing heel or toe is placed at its mean position, from 0.01 heights below the floor to 0.03
    above it. Between plants the displacement fades within 3 frames of 1/30 s. The leg is bent in
    its plane: the knee sets its length, the hip its direction. The foot is rotated so that heel and
    toe reach their positions.

    No heel or toe is deeper below its floor than in the same frame of `motion`, by more than 0.001
    heights. On `movable_legs` it is not deeper than anywhere in `floor_reference`, either. It is
    raised to that depth, a plant in all its frames. The root is not lowered if another leg is in
    the floor.

    Examples
    --------
    >>> from mograft.dancer import dance
    >>> still, report = plant_feet(dance(strides=1).motion)
    >>> report.skate_after <= report.skate_before
    True
    """
    check_type("motion", motion, Motion)
    legs = find_legs(motion.skeleton)
    contacts, movable = _checked_arguments(motion, len(legs), foot_contacts, movable_legs)
    if min_heights is not None and min_heights.shape != contacts.shape:
        raise ValueError(f"`min_heights` must have shape {contacts.shape}, got {min_heights.shape}")
    reference = motion if floor_reference is None else floor_reference
    ground = Ground.of(reference)
    skate_before = skating_share(motion, ground)
    has_task = contacts.any() or min_heights is not None or floor_reference is not None
    if not has_task or not movable.any():
        return motion, _without_changes(skate_before)
    points = ground.points(motion)
    planted = contacts_at_rest(contacts, points, ground, motion.rate)
    heights = np.full(contacts.shape, -np.inf) if min_heights is None else min_heights
    heights = np.where(contacts & ~planted, CLEARANCE, heights)
    recorded = points if reference is motion else ground.points(reference)
    lowest = lowest_heights(points, recorded, ground)
    displacements = np.zeros_like(points)
    bent_legs = np.flatnonzero(movable).tolist()
    for leg in bent_legs:
        displacements[:, leg] = foot_displacements(
            points[:, leg],
            planted[:, leg],
            heights[:, leg],
            lowest[:, leg],
            ground,
            leg,
            motion.rate,
        )
    planted &= movable[None, :, None]
    world_rotations, world_positions = motion.world_transforms()
    shift = np.zeros((motion.n_frames, 3))
    if move_root:
        is_planted = planted[..., 0] | planted[..., 1]
        shift = shift_for_reach(
            legs, world_positions, displacements[:, :, 0], is_planted, motion.rate
        )
        path = world_positions[:, motion.locomotion_root()]
        shift = limit_floor_speed(shift, path, ground.up)
        room = points[:, ~movable] @ ground.up - lowest[:, ~movable]
        room = np.maximum(room.min(axis=(1, 2), initial=np.inf), 0.0)
        shift = limit_descent(shift, room, ground.up)
    parts = [
        bend_leg(
            motion,
            world_rotations,
            world_positions + shift[:, None],
            legs[leg],
            points[:, leg] + shift[:, None],
            displacements[:, leg] - shift[:, None],
        )
        for leg in bent_legs
    ]
    parts.append(_shifted_root(motion, world_rotations, shift) if shift.any() else None)
    still = recombine(motion, [part for part in parts if part is not None], motion.name)
    targets = points + displacements
    errors = np.linalg.norm(ground.points(still) - targets, axis=-1) / ground.height
    errors = np.where(planted, errors, 0.0)
    return still, FeetReport(
        plants=sum(
            len(find_runs(planted[:, leg, point])) for leg, point in np.ndindex(planted.shape[1:])
        ),
        skate_before=skate_before,
        skate_after=skating_share(still, ground),
        moved_root=float(np.linalg.norm(shift, axis=1).max()) / ground.height,
        unreached=float(errors.max()),
        unreached_frames=int((errors > _MAX_ERROR).any(axis=(1, 2)).sum()),
    )


def _without_changes(skate: float) -> FeetReport:
    """Return the report of a motion that needs no change."""
    return FeetReport(
        plants=0,
        skate_before=skate,
        skate_after=skate,
        moved_root=0.0,
        unreached=0.0,
        unreached_frames=0,
    )


def _checked_arguments(
    motion: Motion,
    n_legs: int,
    foot_contacts: BoolArray | None,
    movable_legs: Sequence[bool] | None,
) -> tuple[BoolArray, BoolArray]:
    """Return contacts and which legs may be bent, checked and with defaults."""
    contacts = detect_contacts(motion) if foot_contacts is None else np.asarray(foot_contacts, bool)
    expected = (motion.n_frames, n_legs, 2)
    if contacts.shape != expected:
        raise ValueError(f"`foot_contacts` must have shape {expected}, got {contacts.shape}")
    movable = np.ones(n_legs, bool) if movable_legs is None else np.array(movable_legs, bool)
    if len(movable) != n_legs:
        raise ValueError(f"`movable_legs` must have {n_legs} entries, got {len(movable)}")
    return contacts, movable


def _shifted_root(motion: Motion, world_rotations: FloatArray, shift: FloatArray) -> Part:
    """Return the root, shifted in the world."""
    root = motion.locomotion_root()
    parent = int(motion.skeleton.parents[root])
    if parent >= 0:
        shift = rotations.rotate(rotations.inverse(world_rotations[:, parent]), shift)
    positions = motion.positions[:, root] + shift
    return Part(np.array([root]), motion.rotations[:, root][:, None], positions[:, None])
