"""The frames of glTF animations: their times, and the values of tracks at these."""

from collections.abc import Sequence

import numpy as np

from mograft import _core
from mograft._util.arrays import FloatArray, IntArray
from mograft.io.gltf.animation import Animation
from mograft.io.gltf.nodes import Transforms
from mograft.motion.limits import check_frames

DEFAULT_RATE = 30.0
"""Frames per second of animations whose keys give no rate."""

_RATE_BOUNDS = (12.0, 500.0)
"""Rates that keys may give; slower keys are poses between which a motion is interpolated."""

_GRID_TOLERANCE = 1e-3
"""Deviation of key times from a uniform grid that is tolerated, as a fraction of its step."""

_MIN_POSE_LIMIT = 1 << 21
_POSES_PER_BYTE = 8
_FRAMES_PER_KEY = 8
"""Limits of the poses of nodes in a motion. A motion of at most the first constant is accepted;
otherwise its poses must not exceed these multiples of the bytes of the file and of the keys of the
longest track. A file of few keys may claim a duration whose frames exceed any memory."""


def choose_times(
    key_times: Sequence[FloatArray], rate: float | None, n_nodes: int, n_bytes: int
) -> FloatArray:
    """Return equally spaced times of frames, from the first to the last key.

    The duration is divided into a whole number of intervals, so that the rate is as near as
    possible to `rate`, by default the rate of the keys. An animation of one key has one frame.
    Raises ValueError if the poses of `n_nodes` nodes in all frames exceed the limit for the keys
    and for a file of `n_bytes`.
    """
    keys = np.unique(np.concatenate(key_times))
    start, stop = float(keys[0]), float(keys[-1])
    if rate is None:
        rate = _key_rate(keys)
    n_intervals = (stop - start) * rate
    most_keys = max(map(len, key_times))
    limit = min(_FRAMES_PER_KEY * most_keys * n_nodes, _POSES_PER_BYTE * n_bytes)
    if (n_intervals + 1) * n_nodes > max(_MIN_POSE_LIMIT, limit):
        raise ValueError(
            f"a duration of {stop - start:.6g} s at {rate:.6g} frames per second is too long for "
            f"{most_keys} keys of {n_nodes} nodes; choose a lower rate"
        )
    count = 1 if stop == start else max(round(n_intervals), 1) + 1
    check_frames(count)
    return np.linspace(start, stop, count)


def _key_rate(times: FloatArray) -> float:
    """Return the rate of the uniform grid on which all key times lie.

    The step is the smallest interval between keys; not every time of the grid needs a key. Return
    `DEFAULT_RATE` if there is no such grid, or its rate is not within `_RATE_BOUNDS`.
    """
    if len(times) < 3:
        return DEFAULT_RATE
    gaps = np.diff(times)
    step = float(gaps.min())
    counts = np.round((times - times[0]) / step)
    span = times[-1] - times[0]
    # Single precision rounds long key times; their step is more precise over the whole span.
    step = span / counts[-1]
    rounding = 4 * np.finfo(np.float32).eps * times[-1]
    deviation = np.abs(times - times[0] - counts * step).max()
    low, high = _RATE_BOUNDS
    is_grid = deviation <= _GRID_TOLERANCE * step + rounding
    return 1.0 / step if is_grid and low <= 1.0 / step <= high else DEFAULT_RATE


def sample(animation: Animation, times: FloatArray, rest: Transforms, rows: IntArray) -> Transforms:
    """Return the local transforms of nodes at the times of the frames.

    `rest` holds the default transforms of these nodes, one frame. `rows` holds for each node of the
    file its index in the result.
    """
    found = rest.of(np.arange(rest.scales.shape[1]), len(times))
    arrays = {"translation": found.translations, "rotation": found.rotations, "scale": found.scales}
    key_times = np.concatenate(animation.key_times)
    starts = np.cumsum([0, *map(len, animation.key_times)])
    for tracks in animation.tracks:
        sampled = _core.sample_keys(times, key_times, starts, tracks.values, tracks.table)
        arrays[tracks.path][:, rows[tracks.nodes]] = sampled
    return found
