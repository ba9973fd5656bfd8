"""`BaseBuffer`: the frames of a growing base motion that are still needed; checks of frames."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from mograft._util.arrays import FloatArray, as_floats, as_quaternions
from mograft.analysis.segmentation import kinetic_energy
from mograft.body.capsules import Poses
from mograft.config import Config
from mograft.library.library import Library
from mograft.library.spec import rates_match
from mograft.motion import limits
from mograft.motion.motion import Motion, replace_unchecked
from mograft.motion.skeleton import Skeleton

_MARGIN = 2  # frames kept on both sides of a segment; the velocities at its ends need them


class BaseBuffer:
    """The latest frames of a base motion that grows at its end.

    Frames are numbered from the first pushed frame, even after it has been discarded. `up` is the
    axis that points up.
    """

    def __init__(self, frames: Motion, up: int) -> None:
        self._motion, self.skeleton = frames, frames.skeleton
        self.body = replace(Poses.from_motion(frames[:1]), up=up)
        self._n_discarded = self._n_energies = 0

    def __len__(self) -> int:
        """Return the number of frames in the buffer."""
        return self._motion.n_frames

    @property
    def n_frames(self) -> int:
        """Number of frames that have been pushed."""
        return self._n_discarded + len(self)

    def push(self, frames: Motion) -> None:
        """Append frames."""
        self._motion = join_motions([self._motion, frames], self._motion.name)

    def discard_before(self, frame: int) -> None:
        """Discard the frames before the margin of `frame` that `next_energies` does not need."""
        n_unneeded = max(min(frame - _MARGIN, self._n_energies - 1) - self._n_discarded, 0)
        self._motion = self._motion[n_unneeded:]
        self._n_discarded += n_unneeded

    def motion(self, start: int, stop: int) -> Motion:
        """Return the frames `start` to `stop` - 1."""
        return self._motion[start - self._n_discarded : stop - self._n_discarded]

    def motion_with_margin(self, start: int, stop: int) -> tuple[Motion, int]:
        """Return frames `start` to `stop`, both included, and two more on both sides.

        At the ends of the buffer there are fewer frames. The second result is the index of frame
        `start` in the first result.
        """
        first = max(start - _MARGIN, self._n_discarded)
        return self.motion(first, min(stop + _MARGIN + 1, self.n_frames)), start - first

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
    limits.check_frames(sum(motion.n_frames for motion in motions))
    tracks = dict[str, npt.NDArray[Any] | None]()
    for field in ("rotations", "positions", "channel_values", "computed_values"):
        parts = [getattr(motion, field) for motion in motions]
        tracks[field] = None if any(own is None for own in parts) else np.concatenate(parts)
    return replace_unchecked(motions[0], name=name, **tracks)


def motion_from_arrays(
    frames: npt.ArrayLike, positions: npt.ArrayLike | None, library: Library, skeleton: Skeleton
) -> Motion:
    """Convert arrays that `Stream.push` receives to a motion at the library's frame rate.

    `Stream.push` documents the shapes and errors.
    """
    if positions is None:
        raise TypeError("`positions` must be given with an array of rotations")
    quats = as_quaternions("frames", frames)
    places = as_floats("positions", positions)
    n_joints = skeleton.n_joints
    if quats.ndim == 2:
        quats, places = quats[None], places[None]
    if quats.ndim != 3 or quats.shape[1] != n_joints:
        raise ValueError(
            f"`frames` must have shape (n_frames, {n_joints}, 4) or ({n_joints}, 4), "
            f"got {np.shape(frames)}"
        )
    n_frames = len(quats)
    if places.shape == (n_frames, 3):
        root, places = places, np.tile(skeleton.offsets, (n_frames, 1, 1))
        places[:, library.root] = root
    elif places.shape != (n_frames, n_joints, 3):
        axis = "" if np.ndim(frames) == 2 else f"{n_frames}, "
        raise ValueError(
            f"`positions` must have shape ({axis}{n_joints}, 3) or ({axis}3), "
            f"got {np.shape(positions)}"
        )
    return Motion(skeleton, 1.0 / library.rate, quats, places)


def check_frames(frames: Motion, library: Library, skeleton: Skeleton | None) -> None:
    """Check that the frames fit the library and the frames pushed before.

    `skeleton` is that of the frames pushed before; a different skeleton raises ValueError. For the
    first frames it is None; a hierarchy other than the library's raises SkeletonMismatchError. A
    different frame rate raises ValueError.
    """
    if skeleton is None:
        library.skeleton.check_same_hierarchy(frames.skeleton, frames.name or "the base")
    elif frames.skeleton.names != skeleton.names or not np.array_equal(
        frames.skeleton.offsets, skeleton.offsets
    ):
        raise ValueError("`frames` must all have the same skeleton, got other joints or offsets")
    if not rates_match(frames.rate, library.rate):
        expected = f"the library's rate of {library.rate:.6g} frames/s"
        raise ValueError(f"`frames` must have {expected}, got {frames.rate:.6g}")
