"""Cutting motions at the extrema of their kinetic energy (paper, 4.1.1)."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from mograft import _core
from mograft._util.arrays import (
    BoolArray,
    FloatArray,
    IntArray,
    as_indices,
    make_read_only,
    restore,
)
from mograft._util.gaussian import gaussian_filter, gaussian_kernel
from mograft._util.validate import check_type
from mograft.body.mass import mass_model
from mograft.body.mass import moments_of_inertia as moments
from mograft.config import Config
from mograft.motion.motion import Motion

__all__ = ["OnlineSegmenter", "Segments", "gaussian_filter", "kinetic_energy", "segment"]


@dataclass(frozen=True, eq=False)
class Segments:
    """Stretches of clips: the units that are compared and exchanged.

    Parameters
    ----------
    start, stop : array_like of int, shape (n_segments,)
        First and last frame, both included: neighbours share a frame.
    clip : array_like of int, shape (n_segments,), optional
        Index of the clip that each belongs to. Default: 0, a single clip.

    Raises
    ------
    ValueError
        If the lengths differ or a segment spans no interval.

    Examples
    --------
    >>> cut = Segments([0, 8, 15], [8, 15, 21])
    >>> cut.lengths
    array([8, 7, 6])
    """

    start: IntArray
    stop: IntArray
    clip: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))

    def __post_init__(self) -> None:
        start = as_indices("start", self.start, ("n_segments",)).copy()
        stop = as_indices("stop", self.stop, (len(start),)).copy()
        given = self.clip if np.size(self.clip) else np.zeros(len(start), np.int64)
        clip = as_indices("clip", given, (len(start),)).copy()
        if (start >= stop).any():
            at = int(np.argmax(start >= stop))
            raise ValueError(f"segment {at} must span an interval, got {start[at]} to {stop[at]}")
        for name, array in (("start", start), ("stop", stop), ("clip", clip)):
            make_read_only(array)
            object.__setattr__(self, name, array)

    def __setstate__(self, state: dict[str, Any]) -> None:
        restore(self, state)

    def __len__(self) -> int:
        return len(self.start)

    def __getitem__(self, which: IntArray | BoolArray | slice) -> "Segments":
        """Return some of the segments, in the order given."""
        return Segments(self.start[which], self.stop[which], self.clip[which])

    def __repr__(self) -> str:
        n_clips = len(np.unique(self.clip))
        return f"Segments({len(self)} of {n_clips} clip{'s' if n_clips != 1 else ''})"

    @property
    def lengths(self) -> IntArray:
        """Intervals of each segment, shape (n_segments,): one less than its frames."""
        return self.stop - self.start

    def of_clip(self, clip: int) -> IntArray:
        """Return the indices of a clip's segments, in order of time."""
        return np.flatnonzero(self.clip == clip)


def kinetic_energy(
    motion: Motion, *, omega: str = Config.omega, inertia: str = Config.inertia
) -> FloatArray:
    """Return the rotational kinetic energy of every frame, E = Σ ½ I ω² (eq. 1).

    Parameters
    ----------
    motion : Motion
        The motion, of at least two frames.
    omega : {"world", "local"}
        Whether a link's angular velocity is relative to the world or to its parent.
    inertia : {"own", "subtree", "unit"}
        Whether a link's moment of inertia about its joint is its own, that of all that hangs
        on it, or 1.

    Returns
    -------
    ndarray, shape (n_frames,)
        With masses that sum to 1 and lengths in skeleton heights, so only its shape has
        meaning: skeletons of other sizes have the same.

    Raises
    ------
    ValueError
        If the motion has a single frame.

    Notes
    -----
    The paper leaves open what I and ω are. Of the combinations the default comes nearest to
    the true kinetic energy without the root's travel.

    Examples
    --------
    >>> from mograft.dancer import dance
    >>> motion = dance(strides=1).motion
    >>> energy = kinetic_energy(motion)
    >>> energy.shape == (motion.n_frames,), bool((energy >= 0).all())
    (True, True)
    """
    check_type("motion", motion, Motion)
    if motion.n_frames < 2:
        raise ValueError(
            f"kinetic energy needs at least 2 frames, {motion.name or 'the motion'} has 1"
        )
    skeleton = motion.skeleton
    return _core.kinetic_energy(
        skeleton.parents,
        np.ascontiguousarray(motion.rotations),
        moments(mass_model(skeleton), skeleton, inertia),
        motion.frame_time,
        omega,
    )


def extrema(curve: FloatArray) -> IntArray:
    """Return where a curve turns: the middles of its tops and bottoms.

    Parameters
    ----------
    curve : ndarray, shape (n,)
        The curve.

    Returns
    -------
    ndarray of int
        Indices, ascending, without the ends. Differences of up to 1e-12 of the greatest
        value count as none; of a level top or bottom the middle is taken.
    """
    rises = np.diff(curve)
    rises[np.abs(rises) <= 1e-12 * np.abs(curve).max(initial=0.0)] = 0.0
    moving = np.flatnonzero(rises)
    turns = np.flatnonzero(np.sign(rises[moving[1:]]) != np.sign(rises[moving[:-1]]))
    # The curve is level from the end of the last rise to the start of the next fall.
    return (moving[turns] + 1 + moving[turns + 1]) // 2


def segment(motion: Motion, config: Config | None = None) -> Segments:
    """Cut a motion at the extrema of its kinetic energy.

    Parameters
    ----------
    motion : Motion
        The motion, of at least two frames.
    config : Config, optional
        Gives `smoothing`, `min_length`, `max_length`, `omega` and `inertia`.

    Returns
    -------
    Segments
        They tile the motion: each starts at the frame where the one before stops.

    Raises
    ------
    ValueError
        If the motion has a single frame.

    Notes
    -----
    While the shortest segment is too short, that one of its inner boundaries goes which
    stands out least from the energy at its neighbours.

    Examples
    --------
    >>> from mograft.dancer import dance
    >>> segments = segment(dance(strides=1).motion)
    >>> bool((segments.stop[:-1] == segments.start[1:]).all())
    True
    """
    config = Config() if config is None else config
    energy = kinetic_energy(motion, omega=config.omega, inertia=config.inertia)
    smooth = gaussian_filter(energy, config.smoothing * motion.rate)
    bounds = np.concatenate([[0], extrema(smooth), [motion.n_frames - 1]])
    bounds = _merge(bounds, smooth, max(round(config.min_length * motion.rate), 1))
    bounds = _split(bounds, config.max_length * motion.rate)
    return Segments(bounds[:-1], bounds[1:])


class OnlineSegmenter:
    """Cuts a motion that grows, at the extrema of its kinetic energy.

    Parameters
    ----------
    rate : float
        Frames per second.
    config : Config
        As for `segment`.

    Attributes
    ----------
    bounds : list of int
        The frames where segments meet, ascending from 0, as far as they are settled: nothing
        that comes later changes them. The caller may take away the first ones.

    Notes
    -----
    `segment` merges short segments beginning with the shortest of all; here with the shortest
    of those not settled, and one is settled when there is a next one. Where a curve does not
    turn for `Config.max_length` it is cut there, not in equal parts.
    """

    def __init__(self, rate: float, config: Config) -> None:
        self.bounds: list[int] = []
        self._sigma = config.smoothing * rate
        self._least = max(round(config.min_length * rate), 1)
        self._most = config.max_length * rate
        self._kernel = gaussian_kernel(self._sigma)
        self._energies: list[float] = []
        self._curve: list[float] = []
        self._gone = 0
        """Frames that are not looked at any more, of the energies as of the curve."""
        self._settled = 0
        self._turns: list[int] = []
        self._rising: bool | None = None
        self._moved = 0
        self._top = 0.0

    @property
    def n_frames(self) -> int:
        """Frames whose energy is known."""
        return self._gone + len(self._energies)

    def push(self, energies: FloatArray) -> None:
        """Take in the kinetic energy of the next frames.

        Parameters
        ----------
        energies : ndarray, shape (n,)
            As `kinetic_energy` gives them.
        """
        radius = len(self._kernel) // 2
        for energy in energies.tolist():
            self._energies.append(energy)
            middle = len(self._energies) - 1 - radius
            if middle < 0:
                continue
            first = middle - radius
            window = self._energies[max(first, 0) : middle + radius + 1]
            if first < 0:  # only at the very start, which is reflected
                window = self._energies[-first - 1 :: -1] + window
            self._follow(float(np.dot(self._kernel, window)))

    def close(self) -> None:
        """Settle the rest: no frame comes any more."""
        smooth = gaussian_filter(np.array(self._energies), self._sigma)
        for value in smooth[len(self._curve) :].tolist():
            self._follow(value)
        last = self.n_frames - 1
        self.bounds += self._tentative([*self._turns, last])[1 if self._settled else 0 :]
        self._settled, self._turns = last, []

    def _follow(self, value: float) -> None:
        """Take in the next value of the smooth curve."""
        at = self._gone + len(self._curve)
        rise = value - self._curve[-1] if self._curve else 0.0
        self._curve.append(value)
        self._top = max(self._top, abs(value))
        before = len(self._turns)
        if abs(rise) > 1e-12 * self._top:
            turn = (self._moved + 1 + at - 1) // 2
            latest = self._turns[-1] if self._turns else self._settled
            if self._rising not in (None, rise > 0) and turn > latest:
                self._turns.append(turn)
            self._rising, self._moved = rise > 0, at - 1
        latest = self._turns[-1] if self._turns else self._settled
        if at - latest > self._most:
            self._turns.append(latest + int(self._most))
        if len(self._turns) > before:
            self._settle()

    def _settle(self) -> None:
        bounds = self._tentative(self._turns)
        while len(bounds) > 2:
            if not self._settled:
                self.bounds.append(0)
            self._settled = bounds[1]
            self.bounds.append(self._settled)
            self._turns = [turn for turn in self._turns if turn > self._settled]
            bounds = self._tentative(self._turns)
        # The smoothing at the end looks back as far as the kernel reaches, twice.
        spare = min(self._settled, self._gone + len(self._curve) - 2 * len(self._kernel))
        if spare > self._gone:
            del self._energies[: spare - self._gone], self._curve[: spare - self._gone]
            self._gone = spare

    def _tentative(self, turns: list[int]) -> list[int]:
        """Return bounds from the last settled one as `segment` would have them."""
        bounds = np.array([self._settled, *turns]) - self._gone
        merged = _split(_merge(bounds, np.array(self._curve), self._least), self._most)
        return [int(bound) + self._gone for bound in merged]


def _merge(bounds: IntArray, curve: FloatArray, least: int) -> IntArray:
    """Drop boundaries until no interval is shorter than `least`, if the motion allows."""
    bounds = np.unique(bounds)
    while len(bounds) > 2:
        lengths = np.diff(bounds)
        shortest = int(np.argmin(lengths))
        if lengths[shortest] >= least:
            break
        inner = [b for b in (shortest, shortest + 1) if 0 < b < len(bounds) - 1]
        before, at, after = (curve[bounds[[b + step for b in inner]]] for step in (-1, 0, 1))
        weakest = inner[int(np.argmin(np.abs(at - 0.5 * (before + after))))]
        bounds = np.delete(bounds, weakest)
    return bounds


def _split(bounds: IntArray, most: float) -> IntArray:
    """Split intervals longer than `most` into parts as equal as can be."""
    parts = np.maximum(np.ceil(np.diff(bounds) / most), 1).astype(np.int64)
    if (parts == 1).all():
        return bounds
    steps = [
        np.linspace(a, b, n + 1).round().astype(np.int64)[:-1]
        for a, b, n in zip(bounds[:-1], bounds[1:], parts, strict=True)
    ]
    return np.concatenate([*steps, bounds[-1:]])
