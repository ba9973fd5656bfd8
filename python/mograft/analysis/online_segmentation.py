"""Segmentation of a motion whose frames arrive one after the other."""

import numpy as np

from mograft._util.arrays import FloatArray
from mograft._util.gaussian import gaussian_filter, gaussian_kernel
from mograft.analysis.segmentation import merge_short_segments, split_long_segments
from mograft.config import Config


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
        self.bounds += bounds[1 if self._final_bound else 0 :]
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
                self.bounds.append(0)
            self._final_bound = bounds[1]
            self.bounds.append(self._final_bound)
            self._turns = [turn for turn in self._turns if turn > self._final_bound]
            bounds = self._tentative_bounds(self._turns)
        # Smoothing at the end of the motion needs two lengths of the kernel.
        n_curve = self._first_frame + len(self._curve)
        first_used = min(self._final_bound, n_curve - 2 * len(self._kernel))
        if first_used > self._first_frame:
            n_unused = first_used - self._first_frame
            del self._energies[:n_unused], self._curve[:n_unused]
            self._first_frame = first_used

    def _tentative_bounds(self, turns: list[int]) -> list[int]:
        """Return the last final bound and the bounds after it, given the frames `turns`.

        Segments are merged and split as in `segment`. Further frames can change all but the first.
        """
        bounds = np.array([self._final_bound, *turns]) - self._first_frame
        bounds = merge_short_segments(bounds, np.array(self._curve), self._min_length)
        bounds = split_long_segments(bounds, self._max_length)
        return [int(bound) + self._first_frame for bound in bounds]
