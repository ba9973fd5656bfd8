"""`Motion`: the joint rotations and positions of a skeleton in every frame."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from mograft import _core
from mograft._util.arrays import (
    BoolArray,
    FloatArray,
    IntArray,
    as_floats,
    as_quaternions,
    as_vectors,
    set_fields,
)
from mograft._util.runs import find_runs
from mograft.motion import rotations
from mograft.motion.resample import resample_segment_positions, resample_segments
from mograft.motion.skeleton import Skeleton

_FRAMES_PER_BLOCK = 2048  # whose world transforms are computed together


@dataclass(frozen=True, eq=False)
class Motion:
    """Joint rotations and positions of a skeleton in every frame of one clip.

    Parameters
    ----------
    skeleton : Skeleton
        Joints, their hierarchy and channels.
    frame_time : float
        Seconds from one frame to the next.
    rotations : array_like, shape (n_frames, n_joints, 4)
        Local rotations: unit quaternions, xyzw.
    positions : array_like, shape (n_frames, n_joints, 3)
        Local translations in the unit of the file. The translation of a joint without position
        channels is its rest offset.
    channel_values : array_like, shape (n_frames, n_channels), optional
        The channel values of the file, in the order and units of the file; angles are in degrees.
        NaN marks a value that the writer derives from the rotation or translation. Default: NaN
        everywhere.
    computed_values : ndarray of bool, shape (n_frames, n_channels), optional
        Which of `channel_values` were computed from the rotations, and not read from the file: a
        writer rounds them. Default: none.
    name : str
        Name of the motion; for a file, its stem.
    path : Path, optional
        The file from which the motion was read.
    clip : str, optional
        Name of the motion in the file, if the file holds several.
    repairs : tuple of str
        Deviations from the format that the reader tolerated, each with its line number.

    Raises
    ------
    ValueError
        If a shape does not fit the skeleton, a value is not finite, a quaternion does not have
        unit norm or the frame time is not above 0.

    Examples
    --------
    >>> skeleton = Skeleton(["Hips"], [-1], [[0, 0, 0]])
    >>> motion = Motion(skeleton, 1 / 30, [[[0, 0, 0, 1]]] * 61, [[[0, 90, 0]]] * 61)
    >>> motion
    Motion(1 joint, 61 frames, 30 fps, 2.00 s)
    >>> motion[15:31]
    Motion(1 joint, 16 frames, 30 fps, 0.50 s)
    """

    skeleton: Skeleton
    frame_time: float
    rotations: FloatArray
    positions: FloatArray
    channel_values: FloatArray | None = None
    computed_values: BoolArray | None = None
    name: str = ""
    path: Path | None = None
    clip: str | None = None
    repairs: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        n_joints = self.skeleton.n_joints
        quats = as_quaternions("rotations", self.rotations, ("n_frames", n_joints))
        places = as_vectors("positions", self.positions, (len(quats), n_joints))
        if not len(quats):
            raise ValueError("`rotations` must hold at least one frame, got none")
        frame_time = float(as_floats("frame_time", self.frame_time, ()))
        if frame_time <= 0:
            raise ValueError(f"`frame_time` must be above 0 seconds, got {frame_time}")
        arrays = {"rotations": quats, "positions": places}
        shape = (len(quats), self.skeleton.n_channels)
        given = {name: getattr(self, name) for name in ("channel_values", "computed_values")}
        for name, array in given.items():
            if array is not None and array.shape != shape:
                raise ValueError(f"`{name}` must have shape {shape}, got {array.shape}")
        arrays |= {name: array for name, array in given.items() if array is not None}
        views = {name: array.view() for name, array in arrays.items()}
        set_fields(self, {"frame_time": frame_time, **views})

    def __setstate__(self, state: dict[str, Any]) -> None:
        set_fields(self, state)

    def __repr__(self) -> str:
        joints = "1 joint" if self.n_joints == 1 else f"{self.n_joints} joints"
        frames = "1 frame" if self.n_frames == 1 else f"{self.n_frames} frames"
        name = f"{self.name}: " if self.name else ""
        return f"Motion({name}{joints}, {frames}, {self.rate:.6g} fps, {self.duration:.2f} s)"

    def __len__(self) -> int:
        return self.n_frames

    def _repr_html_(self) -> str:
        return notebook_html(self)

    def __getitem__(self, frames: slice) -> "Motion":
        """Return the motion of a slice of frames; a step of k multiplies the frame time by k."""
        if not isinstance(frames, slice):
            raise TypeError(f"`frames` must be a slice such as motion[100:400], got {frames!r}")
        step = 1 if frames.step is None else frames.step
        if step < 1:
            raise ValueError(f"the step of the slice must be 1 or more, got {step}")
        chosen = range(*frames.indices(self.n_frames))
        if not chosen:
            raise ValueError(
                f"motion[{frames.start}:{frames.stop}] selects none of the frames 0 to "
                f"{self.n_frames - 1}"
            )
        values, is_computed = self.channel_values, self.computed_values
        return replace(
            self,
            frame_time=self.frame_time * step,
            rotations=self.rotations[frames],
            positions=self.positions[frames],
            channel_values=None if values is None else values[frames],
            computed_values=None if is_computed is None else is_computed[frames],
        )

    @property
    def n_frames(self) -> int:
        """Number of frames."""
        return len(self.rotations)

    @property
    def n_joints(self) -> int:
        """Number of joints."""
        return self.skeleton.n_joints

    @property
    def rate(self) -> float:
        """Frames per second."""
        return 1.0 / self.frame_time

    @property
    def duration(self) -> float:
        """Seconds from the first frame to the last."""
        return (self.n_frames - 1) * self.frame_time

    @cached_property
    def is_translated(self) -> BoolArray:
        """Whether the local translation of each joint varies over time, shape (n_joints,)."""
        varies: BoolArray = (self.positions != self.positions[0]).any(axis=(0, 2))
        return varies

    def world_transforms(self) -> tuple[FloatArray, FloatArray]:
        """Return world rotations and positions of all joints, by forward kinematics.

        Rotations have shape (n_frames, n_joints, 4), xyzw; positions (n_frames, n_joints, 3).
        """
        return world_transforms(self.skeleton, self.rotations, self.positions)

    def world_positions(self) -> FloatArray:
        """Return the world positions of all joints, shape (n_frames, n_joints, 3)."""
        positions = np.empty(self.positions.shape)
        for frames, _, own in self.world_blocks():
            positions[frames] = own
        return positions

    def world_blocks(self) -> Iterator[tuple[slice, FloatArray, FloatArray]]:
        """Yield consecutive ranges of frames, each with its `world_transforms`.

        This needs less memory than the transforms of all frames.
        """
        for start in range(0, self.n_frames, _FRAMES_PER_BLOCK):
            frames = slice(start, start + _FRAMES_PER_BLOCK)
            own = world_transforms(self.skeleton, self.rotations[frames], self.positions[frames])
            yield frames, *own

    def resample(self, rate: float) -> "Motion":
        """Return the motion resampled to another frame rate, by cubic interpolation.

        Parameters
        ----------
        rate : float
            Frames per second.

        Returns
        -------
        Motion
            Motion of exactly the same duration. It has a whole number of frames, so its rate is
            the possible rate nearest to `rate`.

        Raises
        ------
        ValueError
            If the rate is not above 0 or gives 2**53 frames or more.
        """
        rate = float(as_floats("rate", rate, ()))
        if rate <= 0:
            raise ValueError(f"`rate` must be above 0 frames per second, got {rate}")
        if self.duration * rate >= 2**53:
            raise ValueError(f"`rate` must give fewer than 2**53 frames, got {rate:g}")
        intervals = max(round(self.duration * rate), 1)
        if self.n_frames == 1 or intervals == self.n_frames - 1:
            return self
        bounds: tuple[npt.ArrayLike, ...] = ([0], [self.n_frames - 1], [intervals + 1])
        return replace(
            self,
            frame_time=self.duration / intervals,
            rotations=resample_segments(self.rotations, *bounds),
            positions=resample_segment_positions(self.positions, *bounds),
            channel_values=None,
        )

    def locomotion_root(self) -> int:
        """Return the index of the joint that moves the body through the world.

        This is the first joint whose translation varies: in some files the root of the hierarchy
        is a helper joint that never moves. If no translation varies, the root is returned.
        """
        moving = np.flatnonzero(self.is_translated)
        return int(moving[0]) if len(moving) else 0

    def channel_numbers(self) -> FloatArray:
        """Return the channel values as a file stores them, shape (n_frames, n_channels).

        Order and units are those of the file; angles are in degrees. Numbers in `channel_values`
        are returned unchanged. NaN, or all values if `channel_values` is None, are derived from the
        rotations and translations. If one angle of a joint in a frame is NaN, all angles of that
        joint in that frame are derived. Of equivalent angles, those nearest to the previous frame
        are returned.
        """
        (numbers,) = self.channel_blocks(self.n_frames)
        return numbers

    def channel_blocks(self, length: int) -> Iterator[FloatArray]:
        """Yield the `channel_numbers` of consecutive blocks of at most `length` frames."""
        skeleton, known = self.skeleton, self.channel_values
        near = [self._first_known_angles(joint) for joint in range(self.n_joints)]
        for start in range(0, self.n_frames, length):
            frames = slice(start, min(start + length, self.n_frames))
            if known is None:
                numbers = np.full((frames.stop - start, skeleton.n_channels), np.nan)
            else:
                numbers = known[frames].copy()
            for joint, columns in enumerate(skeleton.channel_columns):
                if not np.isnan(numbers[:, columns]).any():
                    continue
                for column, name in zip(columns, skeleton.channels[joint], strict=True):
                    if name.endswith("position"):
                        translations = self.positions[frames, joint, "XYZ".index(name[0])]
                        is_missing = np.isnan(numbers[:, column])
                        numbers[is_missing, column] = translations[is_missing]
                turns = skeleton.rotation_columns[joint]
                order, quats = skeleton.rotation_order(joint), self.rotations[frames, joint]
                numbers[:, turns] = _fill_angles(numbers[:, turns], quats, order, near[joint])
            for joint, turns in enumerate(skeleton.rotation_columns):
                near[joint] = numbers[-1, turns]
            yield numbers

    def _first_known_angles(self, joint: int) -> FloatArray:
        """Return the angles of a joint, in degrees, in the first frame that has all; 0 if none."""
        columns = self.skeleton.rotation_columns[joint]
        if self.channel_values is not None and columns:
            for start in range(0, self.n_frames, _FRAMES_PER_BLOCK):
                angles = self.channel_values[start : start + _FRAMES_PER_BLOCK, columns]
                rows = np.flatnonzero(~np.isnan(angles).any(axis=1))
                if len(rows):
                    first: FloatArray = angles[rows[0]]
                    return first
        return np.zeros(len(columns))

    def is_computed(self, numbers: FloatArray, start: int = 0) -> BoolArray:
        """Return which numbers of `channel_numbers`, from a frame on, were not read from a file."""
        computed = np.ones(numbers.shape, bool)
        frames = slice(start, start + len(numbers))
        if self.channel_values is not None:
            computed = numbers != self.channel_values[frames]
            if self.computed_values is not None:
                computed |= self.computed_values[frames]
        return computed


def notebook_html(item: Any) -> str:  # noqa: ANN401 - a motion, or a graft of a higher layer
    """Return the HTML that shows a motion or a graft in a notebook."""
    from mograft.viewing.page import notebook_view  # layer exception: notebooks show a page

    return notebook_view(item)


def world_transforms(
    skeleton: Skeleton, rotations: FloatArray, positions: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return world rotations and positions from local ones, by forward kinematics.

    For n poses, rotations have shape (n, n_joints, 4) and positions (n, n_joints, 3). The results
    have the same shapes. The values are not checked.
    """
    return forward_kinematics(skeleton.parents, rotations, positions)


def forward_kinematics(
    parents: IntArray, rotations: FloatArray, positions: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return world rotations and positions as `world_transforms` does, given only the parents.

    Parents precede their children; that of joint 0 is -1.
    """
    return _core.world(parents, np.ascontiguousarray(rotations), np.ascontiguousarray(positions))


def _fill_angles(
    angles: FloatArray, quats: FloatArray, order: str, before: FloatArray
) -> FloatArray:
    """Return `angles`, in degrees, with all rows that contain NaN computed from `quats`.

    Of equivalent Euler angles, those nearest to the previous frame are chosen; `before` has the
    angles of the frame before the first. `order`, such as ``"ZXY"``, names the rotation axes of the
    columns of `angles`.
    """
    filled = angles.copy()
    unknown = np.asarray(np.isnan(angles).any(axis=1))
    for start, stop in find_runs(unknown):
        near = np.zeros(3)
        near[: len(order)] = np.radians(filled[start - 1] if start else before)
        filled[start:stop] = np.degrees(rotations.to_euler(quats[start:stop], order, near))
    return filled
