"""Rotations of donors with the frames beside them, read from a library on demand."""

from collections import OrderedDict

import numpy as np

from mograft._util.arrays import FloatArray
from mograft.blend.value_spaces import ROTATIONS
from mograft.library.library import Library

MAX_CACHED_DONORS = 4096


class DonorFrames:
    """A cache of the rotations of the latest `MAX_CACHED_DONORS` donors that were read."""

    def __init__(self, library: Library) -> None:
        self._library = library
        self._cache: OrderedDict[int, FloatArray] = OrderedDict()

    def rotations(self, segment: int) -> FloatArray:
        """Return a segment's rotations as `frames_with_neighbours` does."""
        frames = self._cache.get(segment)
        if frames is None:
            segments = self._library.segments
            clip = self._library.clips[segments.clip[segment]]
            start, stop = int(segments.start[segment]), int(segments.stop[segment])
            frames = frames_with_neighbours(clip.rotations, start, stop)
            self._cache[segment] = frames
            if len(self._cache) > MAX_CACHED_DONORS:
                self._cache.popitem(last=False)
        return frames


def frames_with_neighbours(track: FloatArray, start: int, stop: int) -> FloatArray:
    """Return frames `start` to `stop` of a clip, with one frame before and one after them.

    `track` holds the rotations of the clip, at least two frames, shape (n_frames, n_joints, 4); the
    result has shape (stop - start + 3, n_joints, 4). Beyond an end of the clip the frame is
    extrapolated from the last three frames. The velocities at both ends, and `cubic` between the
    frames, are then the same as in the whole clip.
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
