"""`cut_cycle`: a loop, such as two steps of a walk, cut out of a longer motion."""

import numpy as np

from mograft._util.arrays import FloatArray, as_floats
from mograft._util.validate import check_type
from mograft.blend.loop_join import close_values
from mograft.blend.recombine import Part, recombine
from mograft.blend.rigid_alignment import AlignmentTransform, RootTransforms, root_part
from mograft.blend.seams import ROTATIONS, TRANSLATIONS, ValueSpace
from mograft.body.mass import mass_model, up_axis
from mograft.config import Config
from mograft.motion import rotations
from mograft.motion.motion import Motion

_MAX_DIFFERENCE = 0.15
"""Difference between the ends of a cycle, at most, as a share of the largest within it.

Chosen on the walks (0.02 to 0.08) and the dance (0.24) in `bandai_ds1` and `bandai_ds2`. On others,
40 s each: all three walks in `skel_snu_wd2` and four Indian dances have a cycle, one of three clips
of a pair that dances."""
_MIN_EXTENT = 0.005  # skeleton heights; smaller differences within a cycle are noise
_VELOCITY_SECONDS = 0.1  # that multiply differences of velocities, as in transition costs
_MIN_SECONDS, _MAX_SECONDS = 0.3, 10.0  # of a cycle, unless its duration is given
_LONGER, _TOLERANCE = 1.5, 0.25
"""Longest cycle compared, per shortest one; deviation from a given duration, at most."""


def cut_cycle(motion: Motion, seconds: float | None = None) -> tuple[Motion, tuple[int, int]]:
    """Cut a loop out of a motion, such as two steps of a walk.

    Parameters
    ----------
    motion : Motion
        The motion.
    seconds : float, optional
        Duration of the loop, within a quarter. Default: the shortest one, from 0.3 to 10 s.

    Returns
    -------
    cycle : Motion
        The loop. The pose and the velocity of its last frame meet those of its first. The place on
        the floor and the heading of the root continue: a walk still covers ground.
    frames : tuple of int
        Its first and last frame in `motion`.

    Raises
    ------
    ValueError
        If the motion does not repeat itself, or not within about `seconds`; the message has the
        frames whose ends differ least.

    Notes
    -----
    The difference between two frames is the root mean square over all joints below the root of
    their distances, and of 0.1 s times the differences of their velocities, relative to the root
    and its heading. Both ends of a loop differ by at most 15 % of the largest difference between
    its first and any of its frames. Of the loops up to half longer than the shortest, the one with
    the smallest such share is taken. Offsets that decay within `Config.seam_blend` close it.

    Examples
    --------
    >>> from mograft.dancer import dance
    >>> cycle, (first, last) = cut_cycle(dance(strides=4).motion)
    >>> cycle.n_frames == last - first + 1
    True
    """
    check_type("motion", motion, Motion)
    if seconds is not None and not float(as_floats("seconds", seconds, ())) > 0.0:
        raise ValueError(f"`seconds` must be above 0, got {seconds}")
    first, last = _find_cycle(motion, seconds)
    return _close(motion, first, last), (first, last)


def _find_cycle(motion: Motion, seconds: float | None) -> tuple[int, int]:
    """Return the first and the last frame of the cycle with the smallest relative difference."""
    low, high = _MIN_SECONDS, _MAX_SECONDS
    if seconds is not None:
        low, high = seconds * (1.0 - _TOLERANCE), seconds * (1.0 + _TOLERANCE)
    features, longest = _features(motion), high * motion.rate
    best, found, largest = np.inf, (0, 0), np.zeros(len(features))
    for lag in range(1, len(features)):
        if lag > longest:
            break
        differences = np.linalg.norm(features[lag:] - features[:-lag], axis=1)
        largest = np.maximum(largest[:-1], differences)  # from each frame to those before its end
        shares = np.where(largest < _MIN_EXTENT, np.inf, differences / largest.clip(_MIN_EXTENT))
        first = int(shares.argmin())
        if lag >= max(low * motion.rate, 3.0) and shares[first] < best:
            best, found = float(shares[first]), (first, first + lag)
            if best <= _MAX_DIFFERENCE and seconds is None:
                longest = min(longest, _LONGER * lag)
    if best <= _MAX_DIFFERENCE:
        return found
    reason = "it moves too little" if motion.duration >= low else f"it has {motion.duration:.3g} s"
    if found[1]:
        reason = (
            f"the ends of the nearest, frames {found[0]}-{found[1]}, differ by {best:.0%} of the "
            f"largest difference within it (limit {_MAX_DIFFERENCE:.0%})"
        )
    raise ValueError(
        f"{motion.name or 'the motion'} has no cycle of {low:.3g} to {high:.3g} s: {reason}; give "
        "another clip, other frames of it or another duration"
    )


def _features(motion: Motion) -> FloatArray:
    """Return the poses and velocities of all frames, in heights, relative to the root's heading."""
    root, up = motion.locomotion_root(), up_axis(motion)
    if motion.n_frames < 3:
        return np.zeros((motion.n_frames, 1))
    quats, places = motion.world_transforms()
    turns = rotations.multiply(quats[:, root], rotations.inverse(quats[0, root]))
    headings = rotations.inverse(rotations.twist(turns, up))[:, None]
    velocities = np.gradient(places, motion.frame_time, axis=0, edge_order=2)
    origins = places[:, [root]] * (np.arange(3) != up)
    body = motion.skeleton.subtree_mask([root])
    both = np.concatenate([places - origins, _VELOCITY_SECONDS * velocities], axis=1)
    both = rotations.rotate(headings, both[:, np.tile(body, 2)]).reshape(motion.n_frames, -1)
    return both / (mass_model(motion.skeleton).height * np.sqrt(body.sum()))


def _close(motion: Motion, first: int, last: int) -> Motion:
    """Return the frames of a cycle, with offsets near its ends that make them meet."""
    cycle, rate, blend = motion[first : last + 1], motion.rate, Config().seam_blend
    root, up = motion.locomotion_root(), up_axis(motion)
    frames = np.arange(first, last + 1)
    is_second = (frames > first + (last - first) // 2)[:, None]
    has_context = first > 0 and last < motion.n_frames - 1

    def velocity(space: ValueSpace, values: FloatArray, frame: int) -> FloatArray:
        # At an end of the clip one side is unknown: only the pose is closed.
        before, after = values[[frame - 1]], values[[(frame + 1) % len(values)]]
        return 0.5 * rate * has_context * space.delta(before, after)

    def close(space: ValueSpace, values: FloatArray, later: FloatArray) -> FloatArray:
        both = velocity(space, later, last), velocity(space, values, first)
        joined = np.where(is_second[:, None], later[frames], values[frames])
        return close_values(joined, space, both, rate, blend)

    others = np.setdiff1d(np.arange(motion.n_joints), [root, *motion.skeleton.ancestors(root)])
    quats, places = motion.rotations[:, others], motion.positions[:, others]
    closed = close(ROTATIONS, quats, quats), close(TRANSLATIONS, places, places)
    # The root of the half before the join is closed at the place and the heading of the first.
    track = RootTransforms.from_motion(motion, root)
    moved = AlignmentTransform.from_roots(track[frames[-1:]], track[frames[:1]], up)
    later = moved.apply(track)
    quats = close(ROTATIONS, track.rotations[:, None], later.rotations[:, None])[:, 0]
    places = close(TRANSLATIONS, track.positions[:, None], later.positions[:, None])[:, 0]
    back = rotations.inverse(moved.yaws)
    ends = RootTransforms(
        np.where(is_second, rotations.multiply(back, quats), quats),
        np.where(is_second, rotations.rotate(back, places - moved.translations), places),
    )
    is_far = np.minimum(frames - first, last - frames) >= blend * rate
    parts = [Part(others, *closed), root_part(cycle, root, ends, is_far)]
    return recombine(cycle, parts, motion.name)
