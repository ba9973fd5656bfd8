"""Segmentation of motions, whole or frame by frame, at the extrema of their kinetic energy.

The method is that of the paper, 4.1.1; users can also give the cut frames.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from mograft import _core
from mograft._util.arrays import FloatArray, IntArray
from mograft._util.gaussian import gaussian_filter, gaussian_kernel
from mograft._util.validate import as_cut_frames, check_choice, check_type
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
    check_choice("omega", omega, CHOICES["omega"])
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


class OnlineSegmenter:
    """Segments a motion, whose frames arrive one by one, at the extrema of its kinetic energy.

    The list `bounds` has the frames at which final segments start and stop.

    The result may differ from that of `segment` in two respects. `segment` merges the shortest
    segment of the whole motion first; this class merges the shortest segment that is not final. A
    segment is final as soon as another segment follows it. `segment` divides a segment longer than
    `Config.max_length` into equal parts; this class ends a segment as soon as it has that length.
    """

    def __init__(self, rate: float, config: Config) -> None:
        # The frames at which segments meet, ascending from 0. Further frames do not change them.
        # The caller may remove entries from the front.
        self.bounds: list[int] = []
        self.known_at: list[int] = []  # number of frames pushed when each of them became known
        self._sigma = config.smoothing * rate
        self._min_length = max(round(config.min_length * rate), 1)
        self._max_length = max(config.max_length * rate, 1.0)
        self._kernel = gaussian_kernel(self._sigma)
        # Energy and smoothed energy of the frames from `_first_frame` on.
        self._energies: list[float] = []
        self._curve: list[float] = []
        self._first_frame = 0
        self._final_bound = 0
        self._turns: list[int] = []
        # Sign and frame of the last nonzero step of the curve, and its greatest absolute value.
        self._is_rising: bool | None = None
        self._last_step = 0
        self._greatest = 0.0

    @property
    def n_frames(self) -> int:
        """The number of frames whose energies `push` has received."""
        return self._first_frame + len(self._energies)

    def push(self, energies: FloatArray) -> None:
        """Add the kinetic energies of the next frames, shape (n,); see `kinetic_energy`."""
        radius = len(self._kernel) // 2
        for energy in energies.tolist():
            self._energies.append(energy)
            center = len(self._energies) - 1 - radius
            if center < 0:
                continue
            first = center - radius
            window = self._energies[max(first, 0) : center + radius + 1]
            if first < 0:  # only at the start of the motion, where the curve is reflected
                window = self._energies[-first - 1 :: -1] + window
            self._add_smoothed(float(np.dot(self._kernel, window)))

    def close(self) -> None:
        """End the motion: add all remaining bounds to `bounds`."""
        curve = gaussian_filter(np.array(self._energies), self._sigma)
        for value in curve[len(self._curve) :].tolist():
            self._add_smoothed(value)
        last = self.n_frames - 1
        bounds = self._tentative_bounds([*self._turns, last])
        self._add_bounds(*bounds[1 if self._final_bound else 0 :])
        self._final_bound, self._turns = last, []

    def _add_smoothed(self, value: float) -> None:
        """Add the next smoothed energy; record a turn at an extremum or at the maximum length."""
        frame = self._first_frame + len(self._curve)
        step = value - self._curve[-1] if self._curve else 0.0
        self._curve.append(value)
        self._greatest = max(self._greatest, abs(value))
        n_turns = len(self._turns)
        if abs(step) > 1e-12 * self._greatest:
            turn = (self._last_step + 1 + frame - 1) // 2
            latest = self._turns[-1] if self._turns else self._final_bound
            if self._is_rising not in (None, step > 0) and turn > latest:
                self._turns.append(turn)
            self._is_rising, self._last_step = step > 0, frame - 1
        latest = self._turns[-1] if self._turns else self._final_bound
        if frame - latest > self._max_length:
            self._turns.append(latest + int(self._max_length))
        if len(self._turns) > n_turns:
            self._finalize()

    def _finalize(self) -> None:
        """Append to `bounds` those that further frames cannot change; discard unused energies."""
        bounds = self._tentative_bounds(self._turns)
        while len(bounds) > 2:
            if not self._final_bound:
                self._add_bounds(0)
            self._final_bound = bounds[1]
            self._add_bounds(self._final_bound)
            self._turns = [turn for turn in self._turns if turn > self._final_bound]
            bounds = self._tentative_bounds(self._turns)
        # Smoothing at the end of the motion needs two lengths of the kernel.
        n_curve = self._first_frame + len(self._curve)
        first_used = min(self._final_bound, n_curve - 2 * len(self._kernel))
        if first_used > self._first_frame:
            n_unused = first_used - self._first_frame
            del self._energies[:n_unused], self._curve[:n_unused]
            self._first_frame = first_used

    def _add_bounds(self, *bounds: int) -> None:
        self.bounds += bounds
        self.known_at += [self.n_frames] * len(bounds)

    def _tentative_bounds(self, turns: list[int]) -> list[int]:
        """Return the last final bound and the bounds after it, given the frames `turns`.

        Segments are merged and split as in `segment`. Further frames can change all but the first.
        """
        bounds = np.array([self._final_bound, *turns]) - self._first_frame
        bounds = merge_short_segments(bounds, np.array(self._curve), self._min_length)
        bounds = split_long_segments(bounds, self._max_length)
        return [int(bound) + self._first_frame for bound in bounds]
