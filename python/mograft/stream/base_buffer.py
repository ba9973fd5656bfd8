"""`BaseBuffer`: the frames of a growing base motion that are still needed."""

from dataclasses import replace

import numpy as np

from mograft._util.arrays import FloatArray
from mograft.analysis.segmentation import kinetic_energy
from mograft.config import Config
from mograft.motion.motion import Motion

BOUNDARY_MARGIN = 2  # frames kept on both sides of a segment; the velocities at its ends need them


class BaseBuffer:
    """The latest frames of a base motion that grows at its end.

    Frames are numbered from the first pushed frame, even after it has been dropped.
    """

    def __init__(self, frames: Motion) -> None:
        self.first_frame = frames[:1]
        self._tracks = _tracks(frames)
        self._n_discarded = 0
        self._first_needed = 0
        self._n_energies = 0

    def __len__(self) -> int:
        """Return the number of frames in the buffer."""
        return len(self._tracks["rotations"])

    @property
    def n_frames(self) -> int:
        """Number of frames that have been pushed."""
        return self._n_discarded + len(self)

    def push(self, frames: Motion) -> None:
        """Append frames, and drop frames that are no longer needed."""
        n_unneeded, new = self._first_needed - self._n_discarded, _tracks(frames)
        # Channel values are kept only if all frames have them.
        names = [name for name in self._tracks if name in new]
        self._tracks = {
            name: np.concatenate([self._tracks[name][n_unneeded:], new[name]]) for name in names
        }
        self._n_discarded += n_unneeded

    def discard_before(self, frame: int) -> None:
        """Mark the frames before `frame` as no longer needed; the next push drops them."""
        # Without energies, the segmenter holds the frames that it needs.
        n_used = self._n_energies or self.n_frames
        self._first_needed = max(self._first_needed, min(frame, n_used - 1))

    def motion(self, start: int, stop: int) -> Motion:
        """Return the frames `start` to `stop` - 1."""
        rows = slice(start - self._n_discarded, stop - self._n_discarded)
        values = self._tracks.get("channel_values")
        return replace(
            self.first_frame,
            rotations=self._tracks["rotations"][rows],
            positions=self._tracks["positions"][rows],
            channel_values=None if values is None else values[rows],
        )

    def motion_with_margin(self, start: int, stop: int) -> tuple[Motion, int]:
        """Return frames `start` to `stop`, both included, and `BOUNDARY_MARGIN` more on both sides.

        At the ends of the buffer there are fewer frames. The second result is the index of frame
        `start` in the first result.
        """
        first = max(start - BOUNDARY_MARGIN, self._n_discarded)
        return self.motion(first, min(stop + BOUNDARY_MARGIN + 1, self.n_frames)), start - first

    def next_energies(self, config: Config) -> FloatArray:
        """Return the kinetic energies of the frames pushed since the previous call.

        Before them, the energy of the last frame of the previous call is returned again, because it
        depends on the frame that follows.
        """
        first = max(self._n_energies - 1, 0)
        window = self.motion(first, self.n_frames)
        energies = kinetic_energy(window, omega=config.omega, inertia=config.inertia)
        new = energies[self._n_energies - first :]
        self._n_energies = self.n_frames - 1
        return new


def _tracks(frames: Motion) -> dict[str, FloatArray]:
    tracks = {"rotations": frames.rotations, "positions": frames.positions}
    if frames.channel_values is not None:
        tracks["channel_values"] = frames.channel_values
    return tracks
