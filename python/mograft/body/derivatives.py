"""Accelerations and jerks of joints, as differences between frames."""

from collections.abc import Iterator
from typing import NamedTuple

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
    for block in _blocks(motion.n_frames, step):
        rotations = np.ascontiguousarray(motion.rotations[block.read])
        found = np.stack(_core.greatest_derivatives(rotations, joints))
        derivatives[:, block.assigned] = found[:, block.own]
    return derivatives[0], derivatives[1]


def world_jerk(motion: Motion, joints: IntArray, step: int = 1) -> FloatArray:
    """Return the magnitude of the jerk of joints in the world, shape (n_frames, len(joints)).

    It is in units of the file per step³, from differences between frames that are `step` frames
    apart. A jerk is computed from the positions in four frames and assigned to the second. Frames
    at the ends, to which none is assigned, have the value 0.
    """
    jerks = np.zeros((motion.n_frames, len(joints)))
    parents = motion.skeleton.parents
    for block in _blocks(motion.n_frames, step):
        rotations, positions = (
            np.ascontiguousarray(own[block.read]) for own in (motion.rotations, motion.positions)
        )
        found = _core.world_jerk(parents, rotations, positions, joints)
        jerks[block.assigned] = found[block.own]
    return jerks


class _Block(NamedTuple):
    """Frames that are a step apart: those that are read, and those to which results belong."""

    read: slice
    assigned: slice
    own: slice  # of the frames that are read, those of `assigned`


def _blocks(n_frames: int, step: int) -> Iterator[_Block]:
    """Yield small blocks of frames, which save memory; each frame is in one block.

    The frames of a block are `step` apart. A block also reads the frame one step before its frames,
    and the two frames one and two steps after them, if they exist.
    """
    for first in range(min(step, n_frames)):
        frames = range(first, n_frames, step)
        for start in range(0, len(frames), _FRAMES_PER_BLOCK):
            before = min(start, 1)
            stop = min(start + _FRAMES_PER_BLOCK, len(frames))
            read = frames[start - before : stop + 2]
            assigned = frames[start:stop]
            yield _Block(
                slice(read.start, read[-1] + 1, step),
                slice(assigned.start, assigned[-1] + 1, step),
                slice(before, before + stop - start),
            )
