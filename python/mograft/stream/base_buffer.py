"""`BaseBuffer`: the frames of a growing base motion that are still needed."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mograft._util.arrays import FloatArray
from mograft.analysis.segmentation import kinetic_energy
from mograft.body.capsules import Poses
from mograft.config import Config
from mograft.motion.motion import Motion

BOUNDARY_MARGIN = 2  # frames kept on both sides of a segment; the velocities at its ends need them

Tracks = dict[str, FloatArray]  # the arrays of a motion with one row per frame, by field


class BaseBuffer:
    """The latest frames of a base motion that grows at its end.

    Frames are numbered from the first pushed frame, even after it has been discarded. `up` is the
    axis that points up.
    """

    def __init__(self, frames: Motion, up: int) -> None:
        self._first_frame = frames[:1]
        self.skeleton = frames.skeleton
        self.body = replace(Poses.from_motion(self._first_frame), up=up)
        self._tracks = _tracks(frames)
        self._n_discarded = self._n_energies = 0

    def __len__(self) -> int:
        """Return the number of frames in the buffer."""
        return len(self._tracks["rotations"])

    @property
    def n_frames(self) -> int:
        """Number of frames that have been pushed."""
        return self._n_discarded + len(self)

    def push(self, frames: Motion) -> None:
        """Append frames."""
        self._tracks = _join_tracks([self._tracks, _tracks(frames)])

    def discard_before(self, frame: int) -> None:
        """Discard the frames before `frame` that `next_energies` does not need."""
        n_unneeded = max(min(frame, self._n_energies - 1) - self._n_discarded, 0)
        self._tracks = {name: track[n_unneeded:] for name, track in self._tracks.items()}
        self._n_discarded += n_unneeded

    def motion(self, start: int, stop: int) -> Motion:
        """Return the frames `start` to `stop` - 1."""
        rows = slice(start - self._n_discarded, stop - self._n_discarded)
        return _with_tracks(
            self._first_frame, {name: track[rows] for name, track in self._tracks.items()}
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


def join_motions(motions: Sequence[Motion], name: str) -> Motion:
    """Join motions of one skeleton in time; channel values are kept if all motions have them."""
    joined = _with_tracks(motions[0], _join_tracks([_tracks(motion) for motion in motions]))
    return replace(joined, name=name)


def _tracks(frames: Motion) -> Tracks:
    tracks = {"rotations": frames.rotations, "positions": frames.positions}
    if frames.channel_values is not None:
        tracks["channel_values"] = frames.channel_values
    return tracks


def _join_tracks(parts: Sequence[Tracks]) -> Tracks:
    names = [name for name in parts[0] if all(name in part for part in parts)]
    return {name: np.concatenate([part[name] for part in parts]) for name in names}


def _with_tracks(motion: Motion, tracks: Tracks) -> Motion:
    return replace(
        motion,
        rotations=tracks["rotations"],
        positions=tracks["positions"],
        channel_values=tracks.get("channel_values"),
    )
