"""Seams of a stream that are smoothed with the donor after them, which is chosen in advance."""

from dataclasses import dataclass

import numpy as np

from mograft._util.arrays import FloatArray
from mograft.blend.seam_treatments.gradient import fit_donors
from mograft.blend.seams import ROTATIONS
from mograft.config import Config
from mograft.stream.placed_donors import MotionEnd, PlacedDonors, SampledDonors, place_donors


@dataclass(frozen=True, eq=False)
class SmoothedDonor:
    """One donor in the frames of a base segment, after the seam treatment "gradient".

    The attributes have the meanings and shapes of those of `PlacedDonors` for one donor.
    """

    frames: FloatArray  # rotations, shape (1, n_frames, n_joints, 4)
    end_velocity: FloatArray  # in radians per second, shape (1, n_joints, 3)
    end_acceleration: FloatArray  # of the donor, radians per frame², shape (1, n_joints, 3)

    @property
    def end_pose(self) -> FloatArray:
        """Rotations in the last frame, shape (1, n_joints, 4)."""
        return self.frames[:, -1]


def smooth_with_following(
    sampled: SampledDonors,
    following: SampledDonors,
    previous: MotionEnd | None,
    rate: float,
    config: Config,
) -> SmoothedDonor | PlacedDonors:
    """Fit a donor to the committed motion before it and to the chosen donor after it.

    The result minimises the sum that the seam treatment "gradient" minimises, over the segment and
    the next one. The first frame of the segment and the frame before it are committed and do not
    change. If there is no gap, the result is that of `place_donors`.
    """
    placed = place_donors(sampled, previous, rate, config)
    # The starting point of the solution is continuous.
    start_acceleration, end_acceleration = sampled.end_accelerations(rate)
    end = MotionEnd(
        pose=placed.end_pose[0],
        velocity=placed.end_velocity[0],
        pose_before=placed.frames[0, -2],
        acceleration=end_acceleration[0],
    )
    next_placed = place_donors(following, end, rate, config)
    is_same = (placed.values == sampled.values).all() and _is_continuous(sampled, following)
    if is_same:
        return placed
    values = [placed.frames[0], next_placed.frames[0, 1:]]
    rows = [sampled.frames[0], following.frames[0]]
    n_before = 0
    if previous is not None:
        n_before = 1
        values.insert(0, previous.pose_before[None])
        # The kernel takes the acceleration in the first frame from the steps beside it.
        acceleration = 0.5 * (previous.acceleration + start_acceleration[0])
        step_before = ROTATIONS.delta(*rows[0][:2]) - acceleration
        rows.insert(0, np.stack([ROTATIONS.add(rows[0][0], -step_before), rows[0][0]]))
    stops = np.cumsum([len(own) - 1 for own in rows])
    starts = np.concatenate([[0], stops[:-1]])
    next_acceleration = following.end_accelerations(rate)[0]
    acceleration = 0.5 * (end_acceleration + next_acceleration)
    smooth = fit_donors(
        np.concatenate(values),
        (starts, stops, np.concatenate(rows), np.array([n_before]), acceleration),
        rate,
        # The first frame of the segment is the nearest one that does not change.
        float(len(sampled.frames[0]) - 2),
    )
    stop = int(stops[n_before])
    steps = ROTATIONS.delta(smooth[stop - 1 : stop + 1], smooth[stop : stop + 2])
    return SmoothedDonor(
        frames=smooth[None, n_before : stop + 1],
        end_velocity=0.5 * rate * steps.sum(axis=0)[None],
        end_acceleration=end_acceleration,
    )


def _is_continuous(sampled: SampledDonors, following: SampledDonors) -> bool:
    """Whether the next donor continues a donor in pose and velocity."""
    has_gap = (sampled.frames[0, -1] != following.frames[0, 0]).any()
    return not has_gap and np.allclose(sampled.end_velocity, following.start_velocity, atol=1e-9)
