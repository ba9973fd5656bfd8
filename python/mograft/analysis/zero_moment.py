"""How donors change the balance of the base motion: the zero-moment point against the support.

The zero-moment point is where the floor reaction acts (`mograft.body.support_polygon`). A graft
keeps the feet of the base, and with them the support polygon. A donor moves the zero-moment point
by d - (z/g) d̈ along each horizontal axis, where d is the displacement of the centre of mass and z
its height; vertical accelerations of the donor are ignored.
"""

import os
from dataclasses import dataclass

import numpy as np

from mograft import _core
from mograft._util.arrays import BoolArray, FloatArray, IntArray
from mograft._util.gaussian import gaussian_kernel
from mograft.analysis.embedding import Samples, segment_headings
from mograft.body.contacts import Ground
from mograft.body.mass import center_of_mass, mass_model
from mograft.body.support_polygon import (
    GRAVITY,
    STATURE_METERS,
    support_extents,
    zero_moment_points,
)
from mograft.config import Config
from mograft.motion import rotations
from mograft.motion.motion import Motion, forward_kinematics
from mograft.motion.segments import Segments
from mograft.motion.skeleton import Skeleton

# Squared seconds: height of the centre of mass, 0.56 statures, over gravity.
PENDULUM_TIME_SQUARED = 0.56 * STATURE_METERS / GRAVITY
SMOOTHING_SECONDS = 2.0 / 30.0  # standard deviation of the Gaussian before differentiation
N_DIRECTIONS = 48  # half-planes that approximate a support polygon; an even number
# Heights: the zero-moment points of two mass models differ by about this distance.
DISTANCE_SCALE = 0.01

_ANGLES = 2.0 * np.pi * np.arange(N_DIRECTIONS) / N_DIRECTIONS
_DIRECTIONS = np.stack([np.cos(_ANGLES), np.sin(_ANGLES)], axis=1)
"""Unit vectors at equal angles, shape (N_DIRECTIONS, 2)."""


def mass_offsets(
    samples: Samples, skeleton: Skeleton, joints: IntArray, root: int, up: int
) -> FloatArray:
    """Return the horizontal mass moment of a joint group about the root, in heights.

    It is the sum of the group's masses, as shares of the body, times their offsets from the root
    joint; shape (n_segments, n_samples, 2). Axes are those of the samples.
    """
    poses = np.array(samples.rotations, float).reshape(-1, samples.n_joints, 4)
    above = [joint for joint in skeleton.ancestors(root) if joint != root]
    poses[:, above] = rotations.IDENTITY  # the samples hold the root's rotation in the world
    offsets = np.broadcast_to(skeleton.offsets, (len(poses), samples.n_joints, 3))
    world_rotations, positions = forward_kinematics(skeleton.parents, poses, offsets)
    body = mass_model(skeleton)
    heavy = joints[body.mass[joints] > 0]
    arms = np.broadcast_to(body.bone[heavy] * body.center[heavy, None], (len(poses), len(heavy), 3))
    centers = positions[:, heavy] + rotations.rotate(world_rotations[:, heavy], arms)
    moments = ((centers - positions[:, root, None]) * body.mass[heavy, None]).sum(axis=1)
    horizontal = np.delete(moments, up, axis=1) / body.height
    return horizontal.reshape(-1, samples.n_samples, 2)


@dataclass(frozen=True, eq=False)
class ZeroMomentTrack:
    """The zero-moment point of a motion and the headings of its segments."""

    ground: Ground
    points: FloatArray  # shape (n_frames, 3)
    is_loaded: BoolArray  # whether the point exists, shape (n_frames,)
    headings: FloatArray | None  # shape (n_segments, 4); None with `Config.keep_heading`

    @classmethod
    def of(
        cls, motion: Motion, cut: Segments, ground: Ground, config: Config, *, root: int, up: int
    ) -> "ZeroMomentTrack":
        """Measure a motion with the segments `cut`."""
        height = mass_model(motion.skeleton).height
        center = smooth_tracks(center_of_mass(motion), SMOOTHING_SECONDS * motion.rate)
        acceleration = np.gradient(np.gradient(center, axis=0), axis=0) * motion.rate**2
        floor = float(ground.floors.min())
        points, is_loaded = zero_moment_points(center, acceleration, ground.up, floor, height)
        headings = None
        if not config.keep_heading:
            headings = segment_headings(motion.world_track(root)[0][cut.start], up)
        return cls(ground, points, is_loaded, headings)


def support_margins(
    motion: Motion,
    cut: Segments,
    track: ZeroMomentTrack,
    config: Config,
    *,
    up: int,
    chosen: slice = slice(None),
) -> FloatArray:
    """Return how far the zero-moment point may move in segments of a motion, in skeleton heights.

    For each of `N_DIRECTIONS` horizontal directions, the result, shape
    (n_segments, n_samples, N_DIRECTIONS), is the distance from the zero-moment point to the line
    that bounds the support polygon in this direction and is perpendicular to it. At least one is
    negative if the point is outside. The directions are at equal angles from the first horizontal
    axis of the segment, as in `normalise`. All are infinite in frames in which no foot carries
    weight. Samples are those of the nearest frames. `track` is that of the motion with the segments
    `cut`; the result has the segments `cut[chosen]`.
    """
    own = cut[chosen]
    times = np.linspace(0.0, 1.0, config.samples)
    frames = np.rint(own.start[:, None] + own.lengths[:, None] * times).astype(np.int64)
    axes = np.insert(_DIRECTIONS, up, 0.0, axis=1)
    axes = np.broadcast_to(axes, (len(own), N_DIRECTIONS, 3))
    if track.headings is not None:
        headings = track.headings[chosen]
        axes = rotations.rotate(np.repeat(headings[:, None], N_DIRECTIONS, axis=1), axes)
    axes = np.repeat(axes, config.samples, axis=0)
    frames = frames.ravel()
    extents = support_extents(motion, track.ground, frames, axes)
    offsets = np.einsum("nkd,nd->nk", axes, track.points[frames])
    margins = (extents - offsets) / mass_model(motion.skeleton).height
    margins[np.isinf(extents) | ~track.is_loaded[frames, None]] = np.inf
    return margins.reshape(len(own), config.samples, N_DIRECTIONS)


def zero_moment_operators(n_samples: int, seconds: FloatArray) -> FloatArray:
    """Return how displacements of the mass move the zero-moment point, (n, n_samples, n_samples).

    `seconds` are the durations of n base segments. The product of an operator and the difference of
    the `mass_offsets` of donor and base segment, shape (n_samples, 2), is the shift d - (z/g) d̈ at
    the samples. Here d is this difference after smoothing by a Gaussian, which the operator
    includes, and z/g is `PENDULUM_TIME_SQUARED`. For both steps the difference continues beyond the
    ends of the segment by point reflection, so it is the sum of a line and of sines.
    """
    times = np.linspace(0.0, 1.0, n_samples)[:, None]
    line = np.zeros((n_samples, n_samples))
    line[:, :1], line[:, -1:] = 1.0 - times, times
    modes = np.arange(1, n_samples - 1)
    sines = np.sin(np.pi * times * modes)
    squared_frequencies = np.square(np.pi * modes / seconds[:, None])
    gains = np.exp(-0.5 * SMOOTHING_SECONDS**2 * squared_frequencies)
    gains *= 1.0 + PENDULUM_TIME_SQUARED * squared_frequencies
    # Discrete sine transform of the differences from the line.
    amplitudes = 2.0 / (n_samples - 1) * np.einsum("sm,st->mt", sines, np.eye(n_samples) - line)
    # numpy.einsum adds without BLAS, on whose kernels the last bits would depend otherwise.
    return line + np.einsum("nsm,mt->nst", gains[:, None] * sines, amplitudes)


def added_imbalances(
    offsets: FloatArray,
    bases: tuple[IntArray, FloatArray, FloatArray],
    donors: IntArray,
    counts: IntArray,
) -> FloatArray:
    """Return by how much donors raise the imbalance of base segments, shape (n_donors,), 0 to 1.

    The imbalance is the mean over the samples of 1 / (1 + exp(-d / `DISTANCE_SCALE`)), where d is
    the distance of the zero-moment point to the support polygon, negative inside: about the share
    of the time that the point is outside. The result is 0 if the imbalance falls. `offsets` are the
    `mass_offsets` of all segments. `bases` holds the base segments, their `zero_moment_operators`
    and their `support_margins`. `donors` holds the donors of the first base segment, then those of
    the next, and `counts` their numbers.
    """
    half, threads = _DIRECTIONS[: N_DIRECTIONS // 2], os.cpu_count() or 1
    return _core.added_imbalances(
        np.ascontiguousarray(offsets), bases, (donors, counts), half, DISTANCE_SCALE, threads
    )


def smooth_tracks(tracks: FloatArray, sigma: float) -> FloatArray:
    """Smooth tracks, shape (n_frames, n), by a Gaussian of `sigma` frames.

    Beyond both ends they continue by point reflection, so that smoothing keeps the velocity there.
    """
    kernel = gaussian_kernel(sigma)
    radius = len(kernel) // 2
    padded = np.pad(tracks, ((radius, radius), (0, 0)), "reflect", reflect_type="odd")
    return np.stack([np.convolve(track, kernel, "valid") for track in padded.T], axis=1)
