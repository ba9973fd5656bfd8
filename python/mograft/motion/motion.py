"""`Motion`: the joint rotations and positions of a skeleton in every frame."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
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
    ReadOnlyArrays,
    as_floats,
    as_quaternions,
    set_fields,
)
from mograft._util.html_table import notebook_html
from mograft._util.runs import find_runs
from mograft._util.validate import check_type
from mograft.motion import limits, rotations
from mograft.motion.resample import resample_segment_positions, resample_segments
from mograft.motion.skeleton import Skeleton

_FRAMES_PER_BLOCK = 2048
"""Frames whose world transforms are computed together."""

NO_FILE: dict[str, Any] = {"path": None, "clip": None, "repairs": ()}
"""The fields of a motion that is not from a file."""


@dataclass(frozen=True, eq=False)
class Motion(ReadOnlyArrays):
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
    computed_values : array_like of bool, shape (n_frames, n_channels), optional
        Whether each of `channel_values` was computed from the rotations, and not read from the
        file. A writer rounds such values. Default: False everywhere.
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
        If a shape does not fit the skeleton; if a value is not finite, except NaN in
        `channel_values`; if a quaternion does not have unit norm; if the frame time is not between
        1e-5 and 1000 seconds; or if there is no frame or there are more than 16,777,216.
    TypeError
        If the elements of an array are not numbers, or those of `computed_values` not booleans.

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
        shape = (len(quats), n_joints, 3)
        places = as_floats("positions", self.positions, shape, limits.MAX_COORDINATE)
        if not len(quats):
            raise ValueError("`rotations` must hold at least one frame, got none")
        limits.check_frames(len(quats))
        frame_time = float(as_floats("frame_time", self.frame_time, ()))
        limits.check_frame_time(frame_time, "`frame_time`")
        arrays = {"rotations": quats, "positions": places}
        per_channel = (len(quats), self.skeleton.n_channels)
        for name, kind in (("channel_values", np.float64), ("computed_values", np.bool_)):
            if getattr(self, name) is not None:
                arrays[name] = _as_channel_array(name, getattr(self, name), per_channel, kind)
        views = {name: array.view() for name, array in arrays.items()}
        set_fields(self, {"frame_time": frame_time, **views})

    def __repr__(self) -> str:
        joints = "1 joint" if self.n_joints == 1 else f"{self.n_joints} joints"
        frames = "1 frame" if self.n_frames == 1 else f"{self.n_frames} frames"
        name = f"{self.name}: " if self.name else ""
        return f"Motion({name}{joints}, {frames}, {self.rate:.6g} fps, {self.duration:.2f} s)"

    def __len__(self) -> int:
        return self.n_frames

    def _repr_html_(self) -> str | None:
        return notebook_html(self)

    def __getitem__(self, frames: slice) -> "Motion":
        """Return the frames of a slice as a motion; a step of k multiplies the frame time by k."""
        if not isinstance(frames, slice):
            raise TypeError(f"`frames` must be a slice such as motion[100:400], got {frames!r}")
        step = 1 if frames.step is None else frames.step
        if step < 1:
            raise ValueError(f"the step of the slice must be 1 or more, got {step}")
        chosen = range(*frames.indices(self.n_frames))
        if not chosen:
            wanted = f"motion[{frames.start}:{frames.stop}]"
            raise ValueError(f"{wanted} selects none of the frames 0 to {self.n_frames - 1}")
        limits.check_frame_time(self.frame_time * step, "`frame_time`")
        return select_frames(self, frames, self.frame_time * step)

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
        return (self.positions != self.positions[0]).any(axis=(0, 2))

    def world_transforms(self) -> tuple[FloatArray, FloatArray]:
        """Return world rotations and positions of all joints, by forward kinematics.

        Rotations have shape (n_frames, n_joints, 4), xyzw; positions (n_frames, n_joints, 3).
        """
        return forward_kinematics(self.skeleton.parents, self.rotations, self.positions)

    def world_positions(self) -> FloatArray:
        """Return the world positions of all joints, shape (n_frames, n_joints, 3)."""
        positions = np.empty(self.positions.shape)
        for frames, _, block in self.world_blocks():
            positions[frames] = block
        return positions

    def world_blocks(self) -> Iterator[tuple[slice, FloatArray, FloatArray]]:
        """Yield consecutive ranges of frames, each with its `world_transforms`.

        This needs less memory than the transforms of all frames.
        """
        for start in range(0, self.n_frames, _FRAMES_PER_BLOCK):
            frames = slice(start, start + _FRAMES_PER_BLOCK)
            local = self.rotations[frames], self.positions[frames]
            yield frames, *forward_kinematics(self.skeleton.parents, *local)

    def world_track(self, joint: int) -> tuple[FloatArray, FloatArray]:
        """Return the world rotations, (n_frames, 4), and positions, (n_frames, 3), of a joint."""
        chain = [*self.skeleton.ancestors(joint)[::-1], joint]
        local = self.rotations[:, chain], self.positions[:, chain]
        quats, positions = forward_kinematics(np.arange(-1, len(chain) - 1), *local)
        return quats[:, -1], positions[:, -1]

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
            If the rate is not above 0 or gives more than 16,777,216 frames.
        """
        rate = float(as_floats("rate", rate, ()))
        if rate <= 0:
            raise ValueError(f"`rate` must be above 0 frames per second, got {rate}")
        # A huge duration cannot be rounded to an integer.
        intervals = max(round(min(self.duration * rate, limits.MAX_FRAMES)), 1)
        if intervals >= limits.MAX_FRAMES:
            raise ValueError(f"`rate` must give at most {limits.MAX_FRAMES} frames, got {rate:g}")
        if self.n_frames == 1 or intervals == self.n_frames - 1:
            return self
        bounds: tuple[npt.ArrayLike, ...] = ([0], [self.n_frames - 1], [intervals + 1])
        quats, hinges = resample_segments(self.rotations, *bounds), self.skeleton.hinges
        if hinges is not None:
            own = self.skeleton.parents, quats, self.rotations, np.ones(self.n_joints, bool)
            quats = hinges.keep(*own, rate)
        return replace(
            self,
            frame_time=self.duration / intervals,
            rotations=quats,
            positions=resample_segment_positions(self.positions, *bounds),
            channel_values=None,
            computed_values=None,
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
        are returned unchanged. Missing values, which are NaN, are derived from the rotations and
        translations; if `channel_values` is None, all values are. If one angle of a joint in a
        frame is NaN, all angles of that joint in that frame are derived. Of equivalent angles,
        those nearest to the previous frame are returned.
        """
        numbers = np.empty((self.n_frames, self.skeleton.n_channels))
        stop = 0
        for block in self.channel_blocks(_FRAMES_PER_BLOCK):
            start, stop = stop, stop + len(block)
            numbers[start:stop] = block
        return numbers

    def channel_blocks(self, length: int) -> Iterator[FloatArray]:
        """Yield the `channel_numbers` of consecutive blocks of at most `length` frames."""
        skeleton, known = self.skeleton, self.channel_values
        owners = np.repeat(np.arange(self.n_joints), [len(own) for own in skeleton.channels])
        last: FloatArray | None = None  # the frame before the block
        for start in range(0, self.n_frames, length):
            frames = slice(start, min(start + length, self.n_frames))
            numbers = np.empty((frames.stop - start, skeleton.n_channels))
            is_missing = np.ones(numbers.T.shape, bool)
            if known is not None:
                numbers = known[frames].copy()
                is_missing = np.isnan(numbers.T, order="C")
            missing = np.unique(owners[is_missing.any(axis=1)])
            quats = np.ascontiguousarray(self.rotations[frames, missing].swapaxes(0, 1))
            for joint, own in zip(missing.tolist(), quats, strict=True):
                columns = skeleton.channel_columns[joint]
                for column, name in zip(columns, skeleton.channels[joint], strict=True):
                    if name.endswith("position"):
                        translations = self.positions[frames, joint, "XYZ".index(name[0])]
                        np.copyto(numbers[:, column], translations, where=is_missing[column])
                turns, order = skeleton.rotation_columns[joint], skeleton.rotation_order(joint)
                axes, near = rotations.euler_axes(order), np.zeros(3)
                before = self._first_known_angles(joint) if last is None else last[turns]
                runs = [(0, len(numbers))]
                if known is not None:
                    runs = find_runs(is_missing[turns].any(axis=0)).tolist()
                for first, stop in runs:
                    # Of equivalent angles, those nearest to the frame before are chosen.
                    near[: len(order)] = np.radians(numbers[first - 1, turns] if first else before)
                    x, y, z = near.tolist()
                    angles = _core.to_euler(own[first:stop], axes, (x, y, z))
                    numbers[first:stop, turns] = np.degrees(angles[:, : len(order)])
            last = numbers[-1].copy()  # callers may change the block
            yield numbers

    def _first_known_angles(self, joint: int) -> FloatArray:
        """Return the angles of a joint, in degrees, in the first frame in which none is NaN.

        If there is no such frame, return zeros.
        """
        columns, values = self.skeleton.rotation_columns[joint], self.channel_values
        if values is not None and (is_known := ~np.isnan(values[:, columns]).any(axis=1)).any():
            return values[is_known.argmax(), columns]
        return np.zeros(len(columns))

    def is_computed(self, numbers: FloatArray, start: int = 0) -> BoolArray:
        """Return whether each of `numbers` was computed instead of read from a file.

        `numbers` are rows of `channel_numbers`; `start` is the frame of the first row.
        """
        computed = np.ones(numbers.shape, bool)
        frames = slice(start, start + len(numbers))
        if self.channel_values is not None:
            computed = numbers != self.channel_values[frames]
            if self.computed_values is not None:
                computed |= self.computed_values[frames]
        return computed


def select_frames(
    motion: Motion, frames: slice | IntArray, frame_time: float, *, has_channels: bool = True
) -> Motion:
    """Return some frames of a motion, whose values are not checked again.

    Without `has_channels`, channel values are left out.
    """
    state: dict[str, Any] = {"frame_time": frame_time}
    for name in ("rotations", "positions", "channel_values", "computed_values"):
        values = getattr(motion, name)
        if name.endswith("_values") and not has_channels:
            state[name] = None
        elif values is not None:
            state[name] = np.ascontiguousarray(values[frames])
    return replace_unchecked(motion, **state)


def replace_unchecked(motion: Motion, **changes: object) -> Motion:
    """Return a motion with other fields, which are not checked; arrays become read-only."""
    state = {own.name: getattr(motion, own.name) for own in fields(motion)}
    changed = object.__new__(Motion)
    set_fields(changed, state | changes)
    return changed


def _as_channel_array(
    name: str, value: npt.ArrayLike, shape: tuple[int, int], kind: type[np.generic]
) -> npt.NDArray[Any]:
    """Return `value` as an array of `kind` with one element per frame and channel; NaN is allowed.

    Raises TypeError if the elements have another type, ValueError if the shape differs or an
    element is infinite. The messages call the array `name`.
    """
    given = np.asarray(value)
    if given.shape != shape:
        raise ValueError(f"`{name}` must have shape {shape}, got {given.shape}")
    if not np.can_cast(given.dtype, kind, "same_kind"):
        raise TypeError(f"`{name}` must be an array of {np.dtype(kind)}, got {given.dtype}")
    array = given.astype(kind, copy=False)
    if np.isinf(array).any():
        index = np.argwhere(np.isinf(array))[0].tolist()
        raise ValueError(f"`{name}` must be finite or NaN, got {array[tuple(index)]} at {index}")
    return array


def forward_kinematics(
    parents: IntArray, rotations: FloatArray, positions: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return world rotations and positions from local ones, which are not checked.

    Parents precede their children; that of joint 0 is -1. For n poses, rotations have shape
    (n, n_joints, 4) and positions (n, n_joints, 3). The results have the same shapes.
    """
    return _core.world(parents, np.ascontiguousarray(rotations), np.ascontiguousarray(positions))


def as_motions(motions: Motion | Sequence[Motion]) -> list[Motion]:
    """Return the argument `motions` as a list; raise an error if it is empty or has other items."""
    given = [motions] if isinstance(motions, Motion) else list(motions)
    for motion in given:
        check_type("motions", motion, Motion)
    if not given:
        raise ValueError("`motions` must hold at least one motion, got none")
    return given
