"""Segmentation of motions at the extrema of their kinetic energy (paper, 4.1.1) and otherwise."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from mograft import _core
from mograft._util.arrays import FloatArray, IntArray
from mograft._util.cut_frames import as_cut_frames
from mograft._util.gaussian import gaussian_filter
from mograft._util.validate import check_choice, check_type
from mograft.body.mass import mass_model, moments_of_inertia
from mograft.config import CHOICES, Config
from mograft.errors import suggest_name
from mograft.motion.limits import MAX_CLIP_FRAME_TIME, MIN_CLIP_FRAME_TIME
from mograft.motion.motion import Motion
from mograft.motion.segments import Segments


def kinetic_energy(
    motion: Motion, *, omega: str = Config.omega, inertia: str = Config.inertia
) -> FloatArray:
    """Return the rotational kinetic energy of every frame, E = Σ ½ I ω² (eq. 1).

    Parameters
    ----------
    motion : Motion
        The motion, of at least two frames.
    omega : {"world", "local"}
        Whether the angular velocity of a link is relative to the world or to its parent.
    inertia : {"own", "subtree", "unit"}
        Moment of inertia of a link about its joint: of the link alone, of the link and all
        links below it, or 1.

    Returns
    -------
    ndarray, shape (n_frames,)
        The energy, in units in which the mass and the height of the skeleton are 1. It does not
        depend on the size of the skeleton, and only ratios of energies have a meaning.

    Raises
    ------
    ValueError
        If the motion has a single frame, or `omega` or `inertia` is unknown.

    Notes
    -----
    The paper defines neither I nor ω. Of all combinations of `omega` and `inertia`, the default
    is nearest to the physical kinetic energy without the translation of the root.

    Examples
    --------
    >>> from mograft.dancer import dance
    >>> motion = dance(strides=1).motion
    >>> energy = kinetic_energy(motion)
    >>> energy.shape == (motion.n_frames,), bool((energy >= 0).all())
    (True, True)
    """
    check_type("motion", motion, Motion)
    for name, value in (("omega", omega), ("inertia", inertia)):
        check_choice(name, value, CHOICES[name])
    if motion.n_frames < 2:
        raise ValueError(
            f"kinetic energy needs at least 2 frames, {motion.name or 'the motion'} has 1"
        )
    skeleton = motion.skeleton
    return _core.kinetic_energy(
        skeleton.parents,
        np.ascontiguousarray(motion.rotations),
        moments_of_inertia(mass_model(skeleton), skeleton, inertia),
        motion.frame_time,
        omega,
    )


def extrema(curve: FloatArray) -> IntArray:
    """Return the frames of the local maxima and minima of a curve, ascending, without the ends.

    Differences of at most 1e-12 times the largest absolute value count as zero. If the values at a
    maximum or minimum are equal over several frames, the middle frame is returned.
    """
    steps = np.diff(curve)
    steps[np.abs(steps) <= 1e-12 * np.abs(curve).max(initial=0.0)] = 0.0
    nonzero = np.flatnonzero(steps)
    is_turn = np.sign(steps[nonzero[1:]]) != np.sign(steps[nonzero[:-1]])
    turns = np.flatnonzero(is_turn)
    # The curve is level from the end of one step to the start of the next nonzero step.
    return (nonzero[turns] + 1 + nonzero[turns + 1]) // 2


def segment(
    motion: Motion,
    config: Config | None = None,
    *,
    method: str | Sequence[int] | Callable[[Motion], Any] | None = None,
) -> Segments:
    """Segment a motion.

    Parameters
    ----------
    motion : Motion
        The motion, of at least two frames.
    config : Config, optional
        Provides `segmentation` and, for "energy", its parameters `smoothing`, `omega`, `inertia`,
        `min_length` and `max_length`.
    method : str, sequence of int, or callable, optional
        The method, if it is not that of `config`: "energy", the cut frames, or a function that
        receives the motion and returns its cut frames. docs/segmentation.md describes the methods.

    Returns
    -------
    Segments
        They tile the motion: each starts at the frame at which the previous one stops.

    Raises
    ------
    ValueError
        If the motion has a single frame, its frame time is not between 0.0001 and 1 second, the
        method is unknown, or cut frames are not ascending frames of the motion.

    Notes
    -----
    Segments shorter than `min_length` are merged as `merge_short_segments` describes; segments
    longer than `max_length` are split into equal parts of at least one frame interval. Segments
    between cut frames that the user gives are neither merged nor split.

    Examples
    --------
    >>> from mograft.dancer import dance
    >>> motion = dance(strides=1).motion
    >>> segments = segment(motion)
    >>> bool((segments.stop[:-1] == segments.start[1:]).all())
    True
    >>> segment(motion, method=[10, 25]).start
    array([ 0, 10, 25])
    """
    config = Config() if config is None else config
    check_type("config", config, Config)
    check_type("motion", motion, Motion)
    if method is not None:
        chosen: Any = method
        if not isinstance(method, str | Mapping) and not callable(method):
            chosen = {motion.name: as_cut_frames(method, "in `method`")}
        config = replace(config, segmentation=chosen)
    return segment_clip(motion, config, motion.rate)


def segment_clip(motion: Motion, config: Config, own_rate: float) -> Segments:
    """Segment a motion that was resampled from the rate `own_rate`, in frames per second.

    If `Config.segmentation` is a mapping, its cut frames are numbers of frames at `own_rate`.
    """
    first, last = MIN_CLIP_FRAME_TIME, MAX_CLIP_FRAME_TIME
    if not first <= motion.frame_time <= last:
        raise ValueError(
            f"the frame time of {motion.path or motion.name or 'the motion'} must be between "
            f"{first} and {last:g} seconds, got {motion.frame_time:g}"
        )
    if not isinstance(config.segmentation, str):
        bounds = _given_bounds(motion, config, own_rate)
        return Segments(bounds[:-1], bounds[1:])
    energy = kinetic_energy(motion, omega=config.omega, inertia=config.inertia)
    curve = gaussian_filter(energy, config.smoothing * motion.rate)
    bounds = np.concatenate([[0], extrema(curve), [motion.n_frames - 1]])
    bounds = merge_short_segments(bounds, curve, max(round(config.min_length * motion.rate), 1))
    bounds = split_long_segments(bounds, config.max_length * motion.rate)
    return Segments(bounds[:-1], bounds[1:])


def _given_bounds(motion: Motion, config: Config, own_rate: float) -> IntArray:
    """Return both ends of a motion and the cut frames that the user gives, by mapping or function.

    Raises ValueError if the motion has a single frame, the user gives no cut frames for it, or one
    of them is not a frame of the motion.
    """
    chosen, last = config.segmentation, motion.n_frames - 1
    name = motion.name or "the motion"
    if last < 1:
        raise ValueError(f"segmentation needs at least 2 frames, {name} has 1")
    if isinstance(chosen, Mapping):
        if motion.name not in chosen:
            raise ValueError(
                f"`segmentation` must have cut frames for every clip, got none for "
                f"{motion.name!r}{suggest_name(motion.name, list(chosen))}"
            )
        given, scale = chosen[motion.name], motion.rate / own_rate
    else:
        assert callable(chosen)
        given = as_cut_frames(chosen(motion), f"that `segmentation` returned for {name}")
        scale = 1.0
    cuts = np.round(np.array(given, np.int64) * scale).astype(np.int64)
    # One frame of tolerance, for durations that are not a whole number of frames at both rates.
    if len(cuts) and cuts[-1] > last + (scale != 1.0):
        raise ValueError(
            f"cut frames of {name} must be at most {round(last / scale)}, its last frame, got "
            f"{given[-1]}"
        )
    return np.unique(np.concatenate([[0], np.minimum(cuts, last), [last]]))


def merge_short_segments(bounds: IntArray, curve: FloatArray, min_length: int) -> IntArray:
    """Remove bounds until no segment is shorter than `min_length` intervals, or only one is left.

    `bounds` are the frames at which segments meet, and both ends, which are never removed. The
    shortest segment is merged first: of its two bounds, the one is removed at which the curve
    differs less from the mean of its values at the previous and the next bound. Of equal segments
    or bounds, the first is selected.
    """
    bounds = np.unique(bounds)
    while len(bounds) > 2:
        lengths = np.diff(bounds)
        shortest = int(np.argmin(lengths))
        if lengths[shortest] >= min_length:
            break
        inner = np.array([b for b in (shortest, shortest + 1) if 0 < b < len(bounds) - 1])
        before, value, after = (curve[bounds[inner + step]] for step in (-1, 0, 1))
        prominence = np.abs(value - 0.5 * (before + after))
        bounds = np.delete(bounds, inner[int(np.argmin(prominence))])
    return bounds


def split_long_segments(bounds: IntArray, max_length: float) -> IntArray:
    """Split segments longer than `max_length` intervals into as few equal parts as possible.

    `bounds` are the frames at which segments meet, and both ends. The lengths of the parts of one
    segment differ by at most one interval. A `max_length` below 1 counts as 1.
    """
    lengths = np.diff(bounds) / max(max_length, 1.0)
    n_parts = np.maximum(np.ceil(lengths), 1).astype(np.int64)
    if (n_parts == 1).all():
        return bounds
    parts = [
        np.linspace(start, stop, n + 1).round().astype(np.int64)[:-1]
        for start, stop, n in zip(bounds[:-1], bounds[1:], n_parts, strict=True)
    ]
    return np.concatenate([*parts, bounds[-1:]])
