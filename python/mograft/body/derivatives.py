"""Accelerations and jerks of joints, as differences between frames."""

from collections.abc import Iterator

import numpy as np

from mograft import _core
from mograft._util.arrays import FloatArray, IntArray
from mograft.motion.motion import Motion

_FRAMES_PER_BLOCK = 1024


def greatest_derivatives(
    motion: Motion, joints: IntArray, step: int = 1
) -> tuple[FloatArray, FloatArray]:
    """Return the greatest angular acceleration and jerk of some joints in each frame.

    Derivatives are differences between frames that are `step` frames apart. Both results have shape
    (n_frames,), in rad/step² and rad/step³. The length of a rotation vector is taken as
    2 sin(angle / 2), which is 1 % too short at 0.5 rad. An acceleration is computed from three
    frames and assigned to the second, a jerk from four frames and assigned to the second. Frames at
    the ends, to which none is assigned, have the value 0.
    """
    derivatives = np.zeros((2, motion.n_frames))
    for read, assigned, own in _blocks(motion.n_frames, step):
        rotations = np.ascontiguousarray(motion.rotations[read])
        derivatives[:, assigned] = np.stack(_core.greatest_derivatives(rotations, joints))[:, own]
    return derivatives[0], derivatives[1]


def world_jerk(
    motion: Motion, joints: IntArray, step: int = 1, frames: slice = slice(None)
) -> FloatArray:
    """Return the magnitude of the jerk of joints in the world, shape (n_frames, len(joints)).

    It is in units of the file per step³, from differences between frames that are `step` frames
    apart. A jerk is computed from the positions in four frames and assigned to the second. Frames
    at the ends, to which none is assigned, have the value 0. Only the frames `frames` are read.
    """
    rotations, positions = motion.rotations[frames], motion.positions[frames]
    jerks = np.zeros((len(rotations), len(joints)))
    for read, assigned, own in _blocks(len(rotations), step):
        quats, places = map(np.ascontiguousarray, (rotations[read], positions[read]))
        found = _core.world_jerk(motion.skeleton.parents, quats, places, joints)
        jerks[assigned] = found[own]
    return jerks


def _blocks(n_frames: int, step: int) -> Iterator[tuple[slice, slice, slice]]:
    """Yield small blocks of frames, which save memory; each frame is in one block.

    The frames of a block are `step` apart. The slices are: the frames that are read, those to which
    results belong, and the latter among the frames that are read. A block also reads the frame one
    step before its frames, and the two frames one and two steps after them, if they exist.
    """
    for first in range(min(step, n_frames)):
        frames = range(first, n_frames, step)
        for start in range(0, len(frames), _FRAMES_PER_BLOCK):
            before = min(start, 1)
            assigned = frames[start : start + _FRAMES_PER_BLOCK]
            read = frames[start - before : start + _FRAMES_PER_BLOCK + 2]
            yield (
                slice(read.start, read[-1] + 1, step),
                slice(assigned.start, assigned[-1] + 1, step),
                slice(before, before + len(assigned)),
            )
