"""Splice: a motion that is replaced by another one in ranges of frames."""

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray
from mograft._util.runs import find_runs
from mograft.motion.motion import Motion

MAX_ANGLE = 1e-4
"""Maximum angle, in radians, between the motions at the ends of a range; 0.006 degrees."""

_MAX_SHIFT = 1e-4  # maximum difference of translations there, in skeleton heights


def splice(
    before: Motion, after: Motion, is_new: BoolArray, height: float, moving: Collection[int]
) -> Motion:
    """Return `after` in the frames `is_new`, and `before`, bit for bit, in all others.

    Ranges of `is_new`, shape (n_frames,), grow on both sides until the motions differ by at most
    `MAX_ANGLE` at every joint, and by 1e-4 of `height` in every translation. The joints `moving`
    carry the body: they are not compared, and are those of `after` in all frames from the start of
    the first range.
    """
    is_new = _grow(is_new, _is_near(before, after, height, moving))
    changed = np.flatnonzero(is_new)
    if not len(changed):
        return replace(before, name=after.name)
    follows = np.arange(len(is_new)) >= changed[0]
    joints = range(before.n_joints)
    from_after = np.stack([follows if joint in moving else is_new for joint in joints], axis=1)
    quats = np.where(from_after[..., None], _with_signs(before, after, is_new), before.rotations)
    # Angles that a writer derives depend on those of the frames before, so they are kept, too.
    values = before.channel_numbers()
    is_computed = before.is_computed(values)
    counts = [len(columns) for columns in before.skeleton.channel_columns]
    new = np.nan if after.channel_values is None else after.channel_values
    values = np.where(np.repeat(from_after, counts, axis=1), new, values)
    positions = np.where(from_after[..., None], after.positions, before.positions)
    return replace(
        after,
        rotations=quats,
        positions=positions,
        channel_values=values,
        computed_values=is_computed,
    )


def _is_near(before: Motion, after: Motion, height: float, moving: Collection[int]) -> BoolArray:
    """Return the frames in which motions differ by at most the limits, without joints `moving`.

    The result is a mask of shape (n_frames,).
    """
    others = np.setdiff1d(np.arange(before.n_joints), list(moving))
    quats = [motion.rotations[:, others] for motion in (before, after)]
    # |q - p| or |q + p| is 2 sin(angle / 4), which is exact where |q·p| rounds to 1.
    chords = np.minimum(
        np.linalg.norm(quats[0] - quats[1], axis=2), np.linalg.norm(quats[0] + quats[1], axis=2)
    )
    shifts = np.linalg.norm(before.positions[:, others] - after.positions[:, others], axis=2)
    is_near: BoolArray = (chords <= 2.0 * np.sin(MAX_ANGLE / 4.0)).all(axis=1)
    is_near &= (shifts <= _MAX_SHIFT * height).all(axis=1)
    return is_near


def _grow(is_new: BoolArray, is_near: BoolArray) -> BoolArray:
    """Extend each range of `is_new` over the adjacent frames that `is_near` does not mark."""
    grown = is_new.copy()
    for start, stop in find_runs(~is_near).tolist():
        touches = is_new[max(start - 1, 0) : stop + 1]
        if touches.any():
            grown[start:stop] = True
    return grown


def _with_signs(before: Motion, after: Motion, is_new: BoolArray) -> FloatArray:
    """Return the quaternions of `after`, with the signs of `before` at the start of each range."""
    quats = after.rotations.copy()
    ranges: Sequence[Sequence[int]] = find_runs(is_new).tolist()
    for start, stop in ranges:
        products = (quats[start] * before.rotations[start]).sum(axis=1, keepdims=True)
        quats[start:stop] *= np.where(products < 0.0, -1.0, 1.0)
    return quats
