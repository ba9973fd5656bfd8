"""Detection of recording faults: implausible steps and rotations, frozen spans, angle wraps.

Motions are not changed. Lengths are in figure heights: the median, over frames, of the largest
extent of the joints along an axis. Speeds are per second. No limit depends on unit or frame rate.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray
from mograft._util.runs import find_runs
from mograft._util.validate import check_type
from mograft._util.verdict import compare_with_most
from mograft.motion import rotations
from mograft.motion.motion import Motion, forward_kinematics

HARMLESS_FAULTS = ("wrap",)
"""Kinds that do not change the motion and require no action."""

# Minimum mean joint speed of a teleport, in heights per second. The fastest frames of breakdance
# reach 2.5.
_TELEPORT_SPEED = 3.0
# Minimum ratio of a teleport to the median step around it, and of the first step to the median.
_TELEPORT_RATIO = 6.0
_FIRST_STEP_RATIO = 10.0
# Number of steps on each side that the local median includes.
_MEDIAN_RADIUS = 8
# Glitch: minimum ratio of the steps to and from a frame to that between its neighbours, and
# minimum speed in heights per second.
_GLITCH_RATIO = 3.0
_GLITCH_SPEED = 1.5
# Minimum angular speed of a joint glitch, in radians per second, and its minimum angle.
_GLITCH_SPIN = np.radians(45.0) * 30.0
_MIN_GLITCH_ANGLE = np.radians(10.0)
_FLIP_ANGLE = np.radians(150.0)
_MIN_FROZEN_SECONDS, _MIN_FROZEN_FRAMES = 0.25, 4
# A frame time outside this range, in seconds, is reported.
_MIN_FRAME_TIME, _MAX_FRAME_TIME = 1.0 / 2000.0, 1.0
_STEPS_PER_BLOCK = 4096  # minimum number of steps whose arrays are in memory together


@dataclass(frozen=True)
class Fault:
    """A suspected recording fault.

    Parameters
    ----------
    kind : {"frame_time", "first_frame", "teleport", "glitch", "flip", "frozen", "wrap"}
        What is suspected.
    frames : tuple of int
        First and last frame, counted from 0.
    joint : int or None
        Index of the joint; None if the fault concerns the whole body.
    message : str
        Description with the measured value, and the range of most steps.
    """

    kind: str
    frames: tuple[int, int]
    joint: int | None
    message: str


def find_faults(motion: Motion) -> tuple[Fault, ...]:
    """Detect recording faults.

    Parameters
    ----------
    motion : Motion
        The recording.

    Returns
    -------
    tuple of Fault
        The faults, in the order of the kinds below. A step is the mean displacement of the joints
        from one frame to the next.

        ``frame_time``
            The frame time is below 1/2000 s or at least 1 s. The file may state a rate or a time
            in milliseconds instead of a time in seconds.
        ``first_frame``
            The step from the first frame to the next is more than 10 times the median step, and
            more than 3 times the second step. The first frame may be a T-pose or rest pose.
        ``teleport``
            A step is more than 6 times the median of the steps around it and faster than 3
            heights per second, as at a cut or with lost markers. `frames` are those before and
            after the step.
        ``glitch``
            The body or one joint jumps in a single frame and returns: the steps to and from the
            frame are fast, and more than 3 times the difference between its neighbours.
        ``flip``
            A joint rotates by more than 150 degrees between consecutive frames.
        ``frozen``
            Nothing changes for at least a quarter of a second and four frames.
        ``wrap``
            An angle of the file jumps by more than 180 degrees, but the rotation itself does not.
            The motion is unaffected, but the jump shows in plots and filters of the angles.

    Examples
    --------
    >>> import mograft as mg
    >>> skeleton = mg.Skeleton(["Hips"], [-1], [[0, 0, 0]])
    >>> still = [[[0.0, 0.0, 0.0, 1.0]]] * 40
    >>> motion = mg.Motion(skeleton, 1 / 30, still, [[[0.0, 90.0, 0.0]]] * 40)
    >>> for fault in find_faults(motion):
    ...     print(fault.kind, fault.frames, fault.message)
    frozen (0, 39) nothing moves for 1.30 s
    """
    check_type("motion", motion, Motion)
    return (
        *_frame_time(motion),
        *_implausible_steps(motion),
        *_implausible_rotations(motion),
        *_frozen_spans(motion),
        *_angle_wraps(motion),
    )


def _frame_time(motion: Motion) -> Iterator[Fault]:
    seconds = motion.frame_time
    if not _MIN_FRAME_TIME <= seconds < _MAX_FRAME_TIME:
        is_long = seconds >= _MAX_FRAME_TIME
        guess = f"; is it a rate of {seconds:g} fps or {seconds:g} ms?" if is_long else ""
        message = f"the frame time is {seconds:g} s{guess}"
        yield Fault("frame_time", (0, motion.n_frames - 1), None, message)


def _implausible_steps(motion: Motion) -> Iterator[Fault]:
    """Yield the faults of the whole body: ``first_frame``, ``teleport`` and ``glitch``."""
    if motion.n_frames < 4:
        return
    steps, passing, extents = _mean_steps(motion)
    height = float(np.median(extents))
    if height == 0.0:
        return
    steps, passing, rate = steps / height, passing / height, motion.rate
    median = float(np.median(steps))
    # A lower bound, so that noise in a still motion is not a fault.
    floor = 1e-4 * _TELEPORT_SPEED / rate
    first = steps[0] > max(_FIRST_STEP_RATIO * median, _GLITCH_RATIO * steps[1], 0.02)
    if first:
        ratio = steps[0] / max(median, floor)
        usual = compare_with_most(ratio, steps / max(median, floor))
        message = f"the first step is {ratio:.0f} times the median step ({usual})"
        yield Fault("first_frame", (0, 0), None, f"{message}, as after a rest pose")
    smaller_step = np.minimum(steps[1:], steps[:-1])
    out_and_back = (smaller_step > _GLITCH_RATIO * passing) & (smaller_step * rate > _GLITCH_SPEED)
    glitches = np.flatnonzero(out_and_back) + 1
    is_outlier = steps > _TELEPORT_RATIO * np.maximum(_median_around(steps), floor)
    is_teleport = is_outlier & (steps * rate > _TELEPORT_SPEED)
    is_teleport[:1] &= not first
    is_teleport[glitches - 1] = is_teleport[glitches] = False
    for start, stop in find_runs(is_teleport).tolist():
        message = _describe_jump(steps[start:stop].max(), steps)
        yield Fault("teleport", (start, stop), None, message)
    for frame in glitches:
        message = f"{_describe_jump(smaller_step[frame - 1], steps)} for one frame"
        yield Fault("glitch", (int(frame), int(frame)), None, message)


def _describe_jump(step: float, steps: FloatArray) -> str:
    """Return a step in percent, and how it compares with all `steps`; both are in heights."""
    usual = compare_with_most(100.0 * step, 100.0 * steps)
    return f"joints jump by {100.0 * step:.0f} % of the figure height ({usual})"


def _mean_steps(motion: Motion) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the mean joint displacements from each frame to the next, and to the one after that.

    The third result is the extent of the figure in each frame, along the axis of greatest extent.
    """
    n = motion.n_frames
    moving = motion.skeleton.subtree_mask([motion.locomotion_root()])
    steps, passing, extents = np.empty(n - 1), np.empty(n - 2), np.empty(n)
    for start, stop in _step_blocks(n):
        frames = slice(start, stop + 2)
        local = motion.rotations[frames], motion.positions[frames]
        positions = forward_kinematics(motion.skeleton.parents, *local)[1][:, moving]
        extents[frames] = np.ptp(positions, axis=1).max(axis=-1)
        steps[start:stop] = _mean_lengths(positions[1:] - positions[:-1])[: stop - start]
        passing[start:stop] = _mean_lengths(positions[2:] - positions[:-2])
    return steps, passing, extents


def _step_blocks(n_frames: int) -> Iterator[tuple[int, int]]:
    """Yield half-open ranges of almost equal length that cover the steps of `n_frames` frames.

    Each has at least `_STEPS_PER_BLOCK` steps, except if there are fewer steps in all.
    """
    count = max((n_frames - 1) // _STEPS_PER_BLOCK, 1)
    return pairwise(number * (n_frames - 1) // count for number in range(count + 1))


def _implausible_rotations(motion: Motion) -> Iterator[Fault]:
    """Yield the faults of single joints: ``glitch`` and ``flip``."""
    limit = max(_GLITCH_SPIN * min(motion.frame_time, 1.0 / 30.0), _MIN_GLITCH_ANGLE)
    glitches: list[tuple[int, int, float]] = []  # frame before, joint, angle
    flips: list[tuple[int, int, float]] = []
    for start, stop in _step_blocks(motion.n_frames):
        quats = motion.rotations[start : stop + 2]
        steps = rotations.angle(quats[1:], quats[:-1])
        passing = rotations.angle(quats[2:], quats[:-2])
        smaller_step = np.minimum(steps[1:], steps[:-1])
        out_and_back = (smaller_step > limit) & (smaller_step > _GLITCH_RATIO * passing)
        glitches += _locate(out_and_back, smaller_step, start)
        steps = steps[: stop - start]
        flips += _locate(steps > _FLIP_ANGLE, steps, start)
    for before, joint, angle in glitches:
        message = f"{_describe_turn(motion, joint, angle)} for one frame"
        yield Fault("glitch", (before + 1, before + 1), joint, message)
    glitched = {(before + step, joint) for before, joint, _ in glitches for step in (0, 1)}
    for frame, joint, angle in flips:
        if (frame, joint) not in glitched:
            message = f"{_describe_turn(motion, joint, angle)} in one step"
            yield Fault("flip", (frame, frame + 1), joint, message)


def _describe_turn(motion: Motion, joint: int, angle: float) -> str:
    """Return an angle in degrees, and how it compares with those of all steps of a joint."""
    quats = motion.rotations[:, joint]
    usual = compare_with_most(np.degrees(angle), np.degrees(rotations.angle(quats[1:], quats[:-1])))
    return f"{motion.skeleton.names[joint]} rotates by {np.degrees(angle):.0f} degrees ({usual})"


def _locate(
    is_fault: BoolArray, angles: FloatArray, start: int
) -> Iterator[tuple[int, int, float]]:
    """Yield the frame, counted from `start`, the joint and the angle of each marked fault."""
    for frame, joint in np.argwhere(is_fault).tolist():
        yield start + frame, joint, float(angles[frame, joint])


def _frozen_spans(motion: Motion) -> Iterator[Fault]:
    still = np.zeros(motion.n_frames - 1, bool)
    for start, stop in _step_blocks(motion.n_frames):
        frames = slice(start, stop + 1)
        quats, positions = motion.rotations[frames], motion.positions[frames]
        same_rotations = (quats[1:] == quats[:-1]).all(axis=(1, 2))
        still[start:stop] = same_rotations & (positions[1:] == positions[:-1]).all(axis=(1, 2))
    for start, stop in find_runs(still).tolist():
        seconds = (stop - start) * motion.frame_time
        if seconds >= _MIN_FROZEN_SECONDS and stop - start + 1 >= _MIN_FROZEN_FRAMES:
            yield Fault("frozen", (start, stop), None, f"nothing moves for {seconds:.2f} s")


def _angle_wraps(motion: Motion) -> Iterator[Fault]:
    if motion.channel_values is None:
        return
    skeleton = motion.skeleton
    for joint, columns in enumerate(skeleton.rotation_columns):
        if not columns:
            continue
        steps = np.abs(np.diff(motion.channel_values[:, columns], axis=0))
        frames = np.flatnonzero(steps.max(axis=1) > 180.0)
        quats = motion.rotations[:, joint]
        frames = frames[rotations.angle(quats[frames], quats[frames + 1]) < _FLIP_ANGLE]
        if len(frames):
            first, last = int(frames[0]), int(frames[-1]) + 1
            times = "once" if len(frames) == 1 else f"{len(frames)} times"
            message = f"an angle of {skeleton.names[joint]} jumps by 360 degrees {times}"
            yield Fault("wrap", (first, last), joint, message)


def _mean_lengths(vectors: FloatArray) -> FloatArray:
    """Return the mean length of vectors, shape (..., n_joints, 3), over the joints."""
    return np.sqrt(np.einsum("...i,...i->...", vectors, vectors)).mean(axis=-1)


def _median_around(steps: FloatArray) -> FloatArray:
    reach = min(_MEDIAN_RADIUS, len(steps) - 1)
    padded = np.pad(steps, reach, mode="reflect")
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * reach + 1)
    blocks = _step_blocks(len(steps) + 1)
    return np.concatenate([np.median(windows[start:stop], axis=-1) for start, stop in blocks])
