"""Interpolation of rotations and positions at times between frames."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from mograft import _core
from mograft._util import arrays
from mograft._util.arrays import FloatArray, IntArray

__all__ = ["cubic", "cubic_positions", "resample_segment_positions", "resample_segments", "slerp"]


def slerp(times: npt.ArrayLike, rotations: npt.ArrayLike, at: npt.ArrayLike) -> FloatArray:
    """Interpolate joint rotations linearly on the sphere (SLERP) at new times.

    Between two frames each joint rotates at constant speed along the shorter arc. Before the
    first frame and after the last the nearest frame is returned.

    Parameters
    ----------
    times : array_like, shape (n_frames,)
        Times of the frames in seconds, strictly increasing; at least two.
    rotations : array_like, shape (n_frames, n_joints, 4)
        Unit quaternions, scalar last.
    at : array_like, shape (n_times,)
        Times to interpolate at, in seconds, in any order.

    Returns
    -------
    ndarray, shape (n_times, n_joints, 4)
        Unit quaternions. At the time of a frame the result is that frame, up to sign.

    Raises
    ------
    ValueError
        If a shape is wrong, a value is not finite, a quaternion does not have unit norm or the
        times do not increase.

    Notes
    -----
    The paper writes "cubic interpolation of quaternions (SLERP)" in 4.1.3 and 4.5; SLERP is not
    cubic. The package resamples with `cubic`, because SLERP changes the angular velocity abruptly
    at every frame. It uses SLERP only between two poses: to resample a segment of two frames, and
    in the seam treatments.

    Examples
    --------
    Halfway to a turn about y:

    >>> slerp([0.0, 1.0], [[[0, 0, 0, 1]], [[0, 0.6, 0, 0.8]]], [0.5]).round(3)
    array([[[0.   , 0.316, 0.   , 0.949]]])
    """
    frame_times = arrays.as_floats("times", times, ("n_frames",))
    quats = arrays.as_quaternions("rotations", rotations, (len(frame_times), "n_joints"))
    return _core.slerp(frame_times, quats, arrays.as_floats("at", at, ("n_times",)))


def cubic(times: npt.ArrayLike, rotations: npt.ArrayLike, at: npt.ArrayLike) -> FloatArray:
    """Interpolate joint rotations at new times with continuous angular velocity.

    The curve passes through all frames. Its velocity at a frame is that of the parabola through
    the frame and its two neighbours; each interval is a curve of `mograft.rotations.hermite`.
    Before the first frame and after the last the nearest frame is returned.

    Parameters
    ----------
    times, rotations, at
        As for `slerp`; the errors are the same.

    Returns
    -------
    ndarray, shape (n_times, n_joints, 4)
        Unit quaternions; at the time of a frame exactly that frame.
    """
    frame_times = arrays.as_floats("times", times, ("n_frames",))
    quats = arrays.as_quaternions("rotations", rotations, (len(frame_times), "n_joints"))
    return _core.cubic(frame_times, quats, arrays.as_floats("at", at, ("n_times",)))


def cubic_positions(
    times: npt.ArrayLike, positions: npt.ArrayLike, at: npt.ArrayLike
) -> FloatArray:
    """Interpolate positions at new times with continuous velocity, as `cubic` does rotations.

    Parameters
    ----------
    times, at
        As for `slerp`; the errors are the same.
    positions : array_like, shape (n_frames, n_joints, 3)
        Positions, in any unit.

    Returns
    -------
    ndarray, shape (n_times, n_joints, 3)
        Positions, in the same unit.
    """
    frame_times = arrays.as_floats("times", times, ("n_frames",))
    vectors = arrays.as_vectors("positions", positions, (len(frame_times), "n_joints"))
    return _core.cubic_positions(frame_times, vectors, arrays.as_floats("at", at, ("n_times",)))


def resample_segments(
    rotations: npt.ArrayLike, starts: npt.ArrayLike, stops: npt.ArrayLike, counts: npt.ArrayLike
) -> FloatArray:
    """Resample each segment of a clip to equally spaced frames, and concatenate the results.

    Segment i, frames ``starts[i]`` to ``stops[i]`` inclusive of `rotations`, shape (n_frames,
    n_joints, 4), becomes ``counts[i]`` frames. The curve is that of `cubic` and uses no frame
    outside the segment. A sample at the time of a frame is that frame bit for bit. A count of 1
    returns the first frame. Raises ValueError if a shape is wrong, or if a segment exceeds the clip
    or has fewer than two frames.

    Examples
    --------
    >>> quats = [[[0, 0, 0, 1]], [[0, 0.6, 0, 0.8]], [[0, 0.96, 0, 0.28]]]
    >>> resample_segments(quats, [0], [2], [2])[:, 0, 1]
    array([0.  , 0.96])
    """
    quats = arrays.as_quaternions("rotations", rotations, ("n_frames", "n_joints"))
    return _core.segments(quats, *_bounds(starts, stops, counts))


def resample_segment_positions(
    positions: npt.ArrayLike, starts: npt.ArrayLike, stops: npt.ArrayLike, counts: npt.ArrayLike
) -> FloatArray:
    """Resample the positions in each segment, as `resample_segments` resamples rotations.

    `positions` has shape (n_frames, n_joints, 3).
    """
    vectors = arrays.as_vectors("positions", positions, ("n_frames", "n_joints"))
    return _core.segments_positions(vectors, *_bounds(starts, stops, counts))


def sample_clips(tracks: Sequence[FloatArray], clips: IntArray, times: FloatArray) -> FloatArray:
    """Return the values of clips at n times, interpolated as by `cubic`.

    `tracks` are the rotations or translations of each clip, shape (n_frames, n_joints, 4 or 3);
    they are not checked. `clips`, shape (n,), holds for each time the index of its clip in
    `tracks`. `times`, shape (n,), are in frames from the start of the clip. The result has shape
    (n, n_joints, 4 or 3).
    """
    return _core.sample_clips([np.ascontiguousarray(track) for track in tracks], clips, times)


def clip_states(
    tracks: Sequence[FloatArray], clips: IntArray, frames: IntArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the values, velocities and accelerations of clips in n frames.

    `tracks` are as for `sample_clips`. `clips` and `frames`, shape (n,), give the clip and the
    frame. Velocities, shape (n, n_joints, 3), are those of the curves of `cubic`, per frame;
    angular velocities are in the joint's local axes. Accelerations, of the same shape, are second
    differences, per frame². The first and last frame of a clip get the acceleration of the adjacent
    frame. In a clip of fewer than three frames all accelerations are 0.
    """
    return _core.clip_states([np.ascontiguousarray(track) for track in tracks], clips, frames)


def _bounds(
    starts: npt.ArrayLike, stops: npt.ArrayLike, counts: npt.ArrayLike
) -> tuple[IntArray, IntArray, IntArray]:
    first = arrays.as_indices("starts", starts, ("n_segments",))
    last = arrays.as_indices("stops", stops, (len(first),))
    n_frames = arrays.as_indices("counts", counts, (len(first),))
    for name, indices in (("starts", first), ("stops", last), ("counts", n_frames)):
        if (indices < 0).any():
            raise ValueError(f"`{name}` must not be negative, got {indices.min()}")
    return first, last, n_frames
