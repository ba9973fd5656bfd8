"""Donors resampled to a base segment, with the seam to the committed motion closed."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mograft._util.arrays import FloatArray, IntArray
from mograft.blend.seam_treatments import SEAM_TREATMENTS, fit_donors
from mograft.blend.seams import ROTATIONS, PieceTimes, SeamBoundaries
from mograft.config import FRAME, Config
from mograft.motion.resample import cubic

VELOCITY_STEP = 0.01  # frames between the values that give the velocity at the end of a segment


@dataclass(frozen=True, eq=False)
class PlacedDonor:
    """One donor in the frames of a base segment, after seam treatment."""

    frames: FloatArray  # rotations, shape (n_frames, n_joints, 4)
    end_velocity: FloatArray  # angular, in the last frame, radians per second, (n_joints, 3)
    end_acceleration: FloatArray  # of the donor in the last frame, rad/frame², (n_joints, 3)


@dataclass(frozen=True, eq=False)
class SampledDonors:
    """n donors resampled to the length of a base segment, without seam treatment.

    `values`, shape (n, n_frames + 2, n_joints, 4), are rotations in the frames of the base segment,
    then at 1 and 2 times `VELOCITY_STEP` frames before its end. The velocities, shape (n, n_joints,
    3), are angular velocities in the first and last frame, in radians per second. `rate` is in
    frames per second.
    """

    values: FloatArray
    start_velocity: FloatArray
    end_velocity: FloatArray
    rate: float

    @classmethod
    def of(
        cls, tracks: Sequence[FloatArray], joints: IntArray, length: int, rate: float
    ) -> "SampledDonors":
        """Resample donors to the length of a base segment.

        Each track, shape (n_frames + 2, n_joints, 4), is a donor as `frames_with_neighbours`
        returns it; `joints` are those of the group. `length` is in frame intervals, `rate` in
        frames per second.
        """
        counts = np.array([len(track) for track in tracks])
        starts, lengths = np.cumsum(counts) - counts + 1, counts - 3
        track = np.concatenate(tracks).take(joints, axis=1)
        # Multiplying before dividing makes integral results exact.
        times = starts[:, None] + _sample_frames(length) * lengths[:, None] / length
        values = cubic(np.arange(len(track)), track, times.ravel())
        ends = np.stack([starts, starts + lengths])
        before, after = ROTATIONS.delta(track[[ends - 1, ends]], track[[ends, ends + 1]])
        speed_factor = (rate * lengths / length)[:, None, None]
        start_velocity, end_velocity = 0.5 * (before + after) * speed_factor
        shape = (len(tracks), length + 3, -1, 4)
        return cls(values.reshape(shape), start_velocity, end_velocity, rate)

    @property
    def frames(self) -> FloatArray:
        """Rotations in the frames of the base segment, shape (n, n_frames, n_joints, 4)."""
        return self.values[:, :-2]

    @property
    def start_acceleration(self) -> FloatArray:
        """Accelerations in the first 1/30 s, in radians per frame², shape (n, n_joints, 3)."""
        n = self._n_steps
        step = ROTATIONS.delta(self.values[:, 0], self.values[:, n])
        return 2.0 / n * (step / n - self.start_velocity / self.rate)

    @property
    def end_acceleration(self) -> FloatArray:
        """Accelerations in the last 1/30 s, in radians per frame², shape (n, n_joints, 3)."""
        n = self._n_steps
        step = ROTATIONS.delta(self.values[:, -3 - n], self.values[:, -3])
        return 2.0 / n * (self.end_velocity / self.rate - step / n)

    @property
    def _n_steps(self) -> int:
        """Frame intervals of accelerations: in shorter ones, they would mostly be noise."""
        return max(1, min(round(FRAME * self.rate), self.values.shape[1] - 3))

    def place(self, previous: PlacedDonor | None, config: Config) -> FloatArray:
        """Return `values` with the seam between the committed motion and each donor closed.

        `previous` is None for the first segment, which has no seam. A treatment `Config.seam` that
        changes frames before a seam is replaced by "inertial".
        """
        raw = self.values
        if previous is None:
            return raw
        treatment = SEAM_TREATMENTS[config.seam]
        if not treatment.is_causal:
            treatment = SEAM_TREATMENTS["inertial"]
        n, n_times = raw.shape[:2]
        times = PieceTimes(
            np.repeat(np.arange(1, n + 1), n_times),
            np.tile(_sample_frames(n_times - 3) / self.rate, n),
            # The blend may outlast a short segment: the next one starts from the treated end.
            np.full(n + 1, np.inf),
            config.seam_blend,
        )
        boundaries = SeamBoundaries(
            ROTATIONS,
            np.broadcast_to(previous.frames[-1], raw[:, 0].shape),
            raw[:, 0],
            np.broadcast_to(previous.end_velocity, self.start_velocity.shape),
            self.start_velocity,
        )
        values = treatment.close(raw.reshape(-1, *raw.shape[2:]), times, boundaries)
        return values.reshape(raw.shape)

    def select(self, placed: FloatArray, index: int) -> PlacedDonor:
        """Return one of the donors; `placed` are `values` after seam treatment.

        Joints that the seam treatment does not change at the end have the velocity of the donor.
        """
        last = placed[index, -3:]
        one_step, two_steps = ROTATIONS.delta(last[0], last[1:])
        velocity = (0.5 * two_steps - 2.0 * one_step) * (self.rate / VELOCITY_STEP)
        is_unchanged = (last == self.values[index, -3:]).all(axis=(0, 2))
        return PlacedDonor(
            frames=placed[index, :-2],
            end_velocity=np.where(is_unchanged[:, None], self.end_velocity[index], velocity),
            end_acceleration=self.end_acceleration[index],
        )

    def smooth_with(
        self, following: "SampledDonors", previous: PlacedDonor | None, config: Config
    ) -> PlacedDonor:
        """Fit a donor to the committed motion before it and to the chosen donor after it.

        The result minimises the sum that the seam treatment "gradient" minimises, over the segment
        and the next one. The first frame of the segment and the frame before it are committed and
        do not change. If there is no gap, the result is that of `place`.
        """
        values = self.place(previous, config)
        placed = self.select(values, 0)
        is_continuous = (
            (values == self.values).all()
            and (self.frames[0, -1] == following.frames[0, 0]).all()
            and np.allclose(self.end_velocity, following.start_velocity, atol=1e-9)
        )
        if is_continuous:
            return placed
        # The starting point of the solution is continuous.
        parts = [placed.frames, following.place(placed, config)[0, 1:-2]]
        rows = [self.frames[0], following.frames[0]]
        ending, starting = [self.end_acceleration[0]], [following.start_acceleration[0]]
        n_before = 0
        if previous is not None:
            n_before = 1
            parts.insert(0, previous.frames[-2:-1])
            rows.insert(0, rows[0][[0, 0]])  # a step between fixed frames, which has no effect
            ending.insert(0, previous.end_acceleration)
            starting.insert(0, self.start_acceleration[0])
        stops = np.cumsum([len(own) - 1 for own in rows])
        smooth = fit_donors(
            np.concatenate(parts),
            (
                np.append(0, stops[:-1]),
                stops,
                np.concatenate(rows),
                np.arange(n_before + 1),
                np.stack([ending, starting]),
            ),
            self.rate,
            # The next seam may change all frames of the segment but the first.
            float(len(self.frames[0]) - 2),
            n_fixed=1 + n_before,
        )
        stop = int(stops[n_before])
        steps = ROTATIONS.delta(smooth[stop - 1 : stop + 1], smooth[stop : stop + 2])
        velocity = 0.5 * self.rate * steps.sum(axis=0)
        return PlacedDonor(smooth[n_before : stop + 1], velocity, placed.end_acceleration)


def frames_with_neighbours(track: FloatArray, start: int, stop: int) -> FloatArray:
    """Return frames `start` to `stop` of a clip, with one frame before and one after them.

    `track` has the rotations in all frames of the clip, at least two, shape (n_frames, n_joints,
    4); the result has shape (stop - start + 3, n_joints, 4). A frame outside the clip is
    extrapolated from the three frames nearest to it. The velocities at both ends, and the values
    that `cubic` interpolates between the frames, are then the same as in the whole clip.
    """
    rows = [track[start : stop + 1]]
    n_steps = min(2, max(len(track) - 1, 1))
    if start > 0:
        rows.insert(0, track[start - 1 : start])
    else:
        deltas = ROTATIONS.delta(track[:n_steps], track[1 : n_steps + 1])
        rows.insert(0, ROTATIONS.add(track[:1], -(2.0 * deltas[:1] - deltas[-1:])))
    if stop + 1 < len(track):
        rows.append(track[stop + 1 : stop + 2])
    else:
        deltas = ROTATIONS.delta(track[-1 - n_steps : -1], track[-n_steps:])
        rows.append(ROTATIONS.add(track[-1:], 2.0 * deltas[-1:] - deltas[:1]))
    return np.concatenate(rows)


def _sample_frames(length: int) -> FloatArray:
    """Return the times of `SampledDonors.values`, in frames since the base segment's start."""
    before_end = [length - VELOCITY_STEP, length - 2 * VELOCITY_STEP]
    return np.append(np.arange(length + 1), before_end)
