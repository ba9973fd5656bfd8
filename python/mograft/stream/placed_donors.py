"""Donors resampled to a base segment, with the seam to the committed motion closed."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mograft._util.arrays import FloatArray, IntArray
from mograft.blend.seam_treatments import SEAM_TREATMENTS
from mograft.blend.seams import ROTATIONS, PieceTimes, SeamBoundaries
from mograft.config import Config
from mograft.motion.resample import cubic
from mograft.search.boundary_states import BoundaryStates

VELOCITY_STEP = 0.01  # frames between the values that give the velocity at the end of a segment


@dataclass(frozen=True, eq=False)
class SampledDonors:
    """n donors resampled to the length of a base segment, without seam treatment.

    `values`, shape (n, n_frames + 2, n_joints, 4), are rotations in the frames of the base segment,
    then at 1 and 2 times `VELOCITY_STEP` frames before its end. The velocities, shape (n, n_joints,
    3), are angular velocities in the first and last frame, in radians per second.
    """

    values: FloatArray
    start_velocity: FloatArray
    end_velocity: FloatArray

    @property
    def frames(self) -> FloatArray:
        """Rotations in the frames of the base segment, shape (n, n_frames, n_joints, 4)."""
        return self.values[:, :-2]

    def end_accelerations(self, rate: float) -> tuple[FloatArray, FloatArray]:
        """Return the accelerations of the donors in the first and the last frame.

        Both are in radians per frame² and have shape (n, n_joints, 3). `rate` is in frames per
        second.
        """
        first = ROTATIONS.delta(self.values[:, 0], self.values[:, 1])
        last = ROTATIONS.delta(self.values[:, -4], self.values[:, -3])
        return 2.0 * (first - self.start_velocity / rate), 2.0 * (self.end_velocity / rate - last)

    def select(self, index: int) -> "SampledDonors":
        """Return one of the donors."""
        row = slice(index, index + 1)
        return SampledDonors(self.values[row], self.start_velocity[row], self.end_velocity[row])


@dataclass(frozen=True, eq=False)
class PlacedDonors:
    """n donors resampled to the length of a base segment, after seam treatment."""

    sampled: SampledDonors  # the donors before seam treatment
    values: FloatArray  # rotations after it, in the shape of `sampled.values`
    rate: float  # frames per second

    @property
    def frames(self) -> FloatArray:
        """Rotations in the frames of the base segment, shape (n, n_frames, n_joints, 4)."""
        return self.values[:, :-2]

    @property
    def end_pose(self) -> FloatArray:
        """Rotations in the last frame, shape (n, n_joints, 4)."""
        return self.values[:, -3]

    @property
    def end_velocity(self) -> FloatArray:
        """Angular velocities in the last frame, in radians per second, shape (n, n_joints, 3).

        Joints that the seam treatment does not change at the end have the velocity of the donor.
        """
        last, untreated = self.values[:, -3:], self.sampled.values[:, -3:]
        one_step, two_steps = ROTATIONS.delta(last[:, 0], np.moveaxis(last[:, 1:], 1, 0))
        velocity = (0.5 * two_steps - 2.0 * one_step) * (self.rate / VELOCITY_STEP)
        is_unchanged = (last == untreated).all(axis=(1, 3))
        return np.where(is_unchanged[..., None], self.sampled.end_velocity, velocity)

    @property
    def end_acceleration(self) -> FloatArray:
        """Acceleration of the donors in the last frame, radians per frame², (n, n_joints, 3)."""
        return self.sampled.end_accelerations(self.rate)[1]

    def select(self, index: int) -> "PlacedDonors":
        """Return one of the donors."""
        return PlacedDonors(self.sampled.select(index), self.values[index : index + 1], self.rate)


@dataclass(frozen=True, eq=False)
class MotionEnd:
    """Poses and velocity at the end of the motion of one group."""

    pose: FloatArray  # rotations in the last frame, shape (n_joints, 4)
    velocity: FloatArray  # angular, in the last frame, in radians per second, shape (n_joints, 3)
    pose_before: FloatArray  # rotations in the frame before the last, shape (n_joints, 4)
    acceleration: FloatArray  # of the donor in the last frame, radians per frame², (n_joints, 3)


@dataclass(frozen=True, eq=False)
class CommittedEnd(MotionEnd):
    """Poses and velocity at the end of the committed motion of one group."""

    boundary: BoundaryStates  # of the last donor before seam treatment, for seam costs


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


def sample_donors(
    tracks: Sequence[FloatArray], joints: IntArray, length: int, rate: float
) -> SampledDonors:
    """Resample donors to the length of a base segment.

    Each track, shape (n_frames + 2, n_joints, 4), is a donor as `frames_with_neighbours` returns
    it; `joints` are those of the group. `length` is in frame intervals, `rate` in frames per
    second.
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
    return SampledDonors(values.reshape(shape), start_velocity, end_velocity)


def place_donors(
    sampled: SampledDonors, previous: MotionEnd | None, rate: float, config: Config
) -> PlacedDonors:
    """Close the seam between the committed motion and each donor.

    `previous` is None for the first segment, which has no seam. A treatment `Config.seam` that
    changes frames before a seam is replaced by "inertial". `rate` is in frames per second.
    """
    raw = sampled.values
    if previous is None:
        return PlacedDonors(sampled, raw, rate)
    treatment = SEAM_TREATMENTS[config.seam]
    if not treatment.is_causal:
        treatment = SEAM_TREATMENTS["inertial"]
    n, n_times = raw.shape[:2]
    pieces = np.repeat(np.arange(1, n + 1), n_times)
    # The blend may outlast a short segment: the next one starts from the treated end.
    durations = np.full(n + 1, np.inf)
    times = PieceTimes(
        pieces, np.tile(_sample_frames(n_times - 3) / rate, n), durations, config.seam_blend
    )
    boundaries = SeamBoundaries(
        ROTATIONS,
        np.broadcast_to(previous.pose, (n, *previous.pose.shape)),
        raw[:, 0],
        np.broadcast_to(previous.velocity, sampled.start_velocity.shape),
        sampled.start_velocity,
    )
    flat = raw.reshape(-1, *raw.shape[2:])
    values = treatment.close(flat, times, boundaries)
    return PlacedDonors(sampled, values.reshape(raw.shape), rate)


def _sample_frames(length: int) -> FloatArray:
    """Return the times of `SampledDonors.values`, in frames since the base segment's start."""
    before_end = [length - VELOCITY_STEP, length - 2 * VELOCITY_STEP]
    return np.append(np.arange(length + 1), before_end)
