"""Faults of recordings: what looks wrong in a motion, and in which frames.

Nothing is repaired here. Sizes are in figure heights and speeds per second, so that the
same limits hold for any unit and frame rate.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from mograft._util.arrays import FloatArray
from mograft._util.validate import check_type
from mograft.motion import rotations
from mograft.motion.motion import Motion

__all__ = ["KINDS", "Fault", "find_faults"]

KINDS = ("frame_time", "first_frame", "teleport", "glitch", "flip", "frozen", "wrap")

# Mean speed of all joints, in heights per second, that only a leap of the data has: a
# sprint is 4, the fastest frames of breakdance come to 2.5.
_LEAP = 3.0
# How far above the steps around it, or above the usual one, a step has to be.
_ABOVE = 6.0
_FAR_ABOVE = 10.0
# Steps to either side that a step is compared with.
_AROUND = 8
# A frame that leaves and comes back: how much shorter the way past it is than either step.
_RETURN = 3.0
_RETURN_SPEED = 1.5
# Rotation speed, in radians per second, out and back within one frame; at 30 fps an eighth
# of a turn.
_SPIN = np.radians(45.0) * 30.0
_LEAST_SPIN = np.radians(10.0)
_FLIP = np.radians(150.0)
# Seconds and frames without any change.
_FROZEN, _FROZEN_FRAMES = 0.25, 4
# Seconds between frames outside of which a frame time is taken for another number.
_SHORTEST, _LONGEST = 1.0 / 2000.0, 1.0


@dataclass(frozen=True)
class Fault:
    """Something that looks wrong in a motion.

    Parameters
    ----------
    kind : str
        One of `KINDS`.
    frames : tuple of int
        The first and the last frame concerned, from 0.
    joint : int or None
        The joint concerned, where it is one.
    message : str
        What is the matter, in words.
    """

    kind: str
    frames: tuple[int, int]
    joint: int | None
    message: str


def find_faults(motion: Motion) -> tuple[Fault, ...]:
    """Look for what is wrong in a recording.

    Parameters
    ----------
    motion : Motion
        The recording.

    Returns
    -------
    tuple of Fault
        By kind, then by frame.

        ``frame_time``
            Below 1/2000 s or 1 s and more: perhaps a rate, or milliseconds.
        ``first_frame``
            The step from the first frame to the next is far above the usual one: a T-pose
            or rest pose before the motion.
        ``teleport``
            A step far above those around it, faster than bodies move: a cut, or markers
            lost and found. The frames are those before and after.
        ``glitch``
            A frame that leaves and comes back, as a whole or in one joint.
        ``flip``
            A joint turns by more than 150 degrees from one frame to the next.
        ``frozen``
            Nothing changes for at least a quarter of a second.
        ``wrap``
            An angle of the file jumps by more than half a turn while the joint does not.
            That is no fault of the motion, but of curves drawn or filtered from the file.

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
    # Places beyond all measure overflow; no limit is above that.
    with np.errstate(over="ignore", invalid="ignore"):
        return (
            *_frame_time(motion),
            *_leaps(motion),
            *_turns(motion),
            *_frozen(motion),
            *_wraps(motion),
        )


def _frame_time(motion: Motion) -> Iterator[Fault]:
    seconds = motion.frame_time
    if _SHORTEST <= seconds < _LONGEST:
        return
    guess = ""
    if seconds >= _LONGEST:
        guess = f"; a rate of {seconds:g} fps, or {seconds:g} ms?"
    message = f"a frame lasts {seconds:g} s{guess}"
    yield Fault("frame_time", (0, motion.n_frames - 1), None, message)


def _leaps(motion: Motion) -> Iterator[Fault]:
    """Find steps of the whole body that no body takes."""
    if motion.n_frames < 4:
        return
    places = motion.world_positions()[:, _moving(motion)]
    height = float(np.median(np.ptp(places, axis=1).max(axis=-1)))
    if height == 0.0:
        return
    steps = _lengths(places[1:] - places[:-1]) / height
    passing = _lengths(places[2:] - places[:-2]) / height
    rate = motion.rate
    usual = float(np.median(steps))
    # Where all is still, noise is no leap.
    floor = 1e-4 * _LEAP / rate
    first = steps[0] > max(_FAR_ABOVE * usual, _RETURN * steps[1], 0.02)
    if first:
        ratio = steps[0] / max(usual, floor)
        message = f"the step to the next frame is {ratio:.0f} times the usual, as after a rest pose"
        yield Fault("first_frame", (0, 0), None, message)
    both = np.minimum(steps[1:], steps[:-1])
    out_and_back = (both > _RETURN * passing) & (both * rate > _RETURN_SPEED)
    glitches = np.flatnonzero(out_and_back) + 1
    leaping = (steps > _ABOVE * np.maximum(_median_around(steps), floor)) & (steps * rate > _LEAP)
    leaping[:1] &= not first
    leaping[glitches - 1] = leaping[glitches] = False
    for start, stop in _runs(leaping):
        height_share = 100.0 * steps[start:stop].max()
        message = f"joints leap by {height_share:.0f} % of the figure's height"
        yield Fault("teleport", (start, stop), None, message)
    for frame in glitches:
        message = f"one frame {100.0 * both[frame - 1]:.0f} % of the figure's height away"
        yield Fault("glitch", (int(frame), int(frame)), None, message)


def _turns(motion: Motion) -> Iterator[Fault]:
    """Find turns of single joints that no joint makes."""
    if motion.n_frames < 2:
        return
    turned = motion.rotations
    names = motion.skeleton.names
    steps = rotations.angle(turned[1:], turned[:-1])
    glitched = np.zeros_like(steps, dtype=bool)
    if motion.n_frames > 2:
        passing = rotations.angle(turned[2:], turned[:-2])
        both = np.minimum(steps[1:], steps[:-1])
        limit = max(_SPIN * min(motion.frame_time, 1.0 / 30.0), _LEAST_SPIN)
        out_and_back = (both > limit) & (both > _RETURN * passing)
        glitched[1:] |= out_and_back
        glitched[:-1] |= out_and_back
        for before, joint in np.argwhere(out_and_back).tolist():
            degrees = np.degrees(both[before, joint])
            message = f"{names[joint]} turns by {degrees:.0f} degrees for one frame"
            yield Fault("glitch", (before + 1, before + 1), joint, message)
    for frame, joint in np.argwhere((steps > _FLIP) & ~glitched).tolist():
        degrees = np.degrees(steps[frame, joint])
        message = f"{names[joint]} turns by {degrees:.0f} degrees in one step"
        yield Fault("flip", (frame, frame + 1), joint, message)


def _frozen(motion: Motion) -> Iterator[Fault]:
    turned, placed = motion.rotations, motion.positions
    still = (turned[1:] == turned[:-1]).all(axis=(1, 2)) & (placed[1:] == placed[:-1]).all(
        axis=(1, 2)
    )
    for start, stop in _runs(still):
        seconds = (stop - start) * motion.frame_time
        if seconds >= _FROZEN and stop - start + 1 >= _FROZEN_FRAMES:
            yield Fault("frozen", (start, stop), None, f"nothing moves for {seconds:.2f} s")


def _wraps(motion: Motion) -> Iterator[Fault]:
    if motion.channel_values is None or motion.n_frames < 2:
        return
    skeleton = motion.skeleton
    for joint, columns in enumerate(skeleton.channel_columns):
        turns = [
            column
            for name, column in zip(skeleton.channels[joint], columns, strict=True)
            if name.endswith("rotation")
        ]
        if not turns:
            continue
        jumps = np.abs(np.diff(motion.channel_values[:, turns], axis=0)).max(axis=1) > 180.0
        frames = np.flatnonzero(jumps)
        if not len(frames):
            continue
        smooth = rotations.angle(
            motion.rotations[frames, joint], motion.rotations[frames + 1, joint]
        )
        frames = frames[smooth < _FLIP]
        if len(frames):
            first, last = int(frames[0]), int(frames[-1]) + 1
            times = "once" if len(frames) == 1 else f"{len(frames)} times"
            message = f"an angle of {skeleton.names[joint]} jumps by a turn {times}"
            yield Fault("wrap", (first, last), joint, message)


def _moving(motion: Motion) -> npt.NDArray[np.bool_]:
    """Mark the joint that carries the body through the world, and those below it."""
    moving = np.zeros(motion.n_joints, dtype=bool)
    moving[motion.locomotion_root()] = True
    for joint, parent in enumerate(motion.skeleton.parents):
        moving[joint] |= parent >= 0 and moving[parent]
    return moving


def _lengths(ways: FloatArray) -> FloatArray:
    """Return the mean length over the joints."""
    lengths: FloatArray = np.sqrt(np.einsum("...i,...i->...", ways, ways)).mean(axis=-1)
    return lengths


def _median_around(steps: FloatArray) -> FloatArray:
    reach = min(_AROUND, len(steps) - 1)
    padded = np.pad(steps, reach, mode="reflect")
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * reach + 1)
    medians: FloatArray = np.median(windows, axis=-1)
    return medians


def _runs(marked: npt.NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return where runs of marked elements begin, and where the first unmarked follows."""
    edges = np.flatnonzero(np.diff(marked, prepend=False, append=False))
    return [(int(start), int(stop)) for start, stop in edges.reshape(-1, 2)]
