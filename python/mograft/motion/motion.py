"""Motion: how a skeleton moves, frame by frame."""

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
    as_floats,
    as_quaternions,
    as_vectors,
    make_read_only,
    restore,
)
from mograft.motion import rotations
from mograft.motion.resample import resample_segment_positions, resample_segments
from mograft.motion.skeleton import Skeleton

__all__ = ["Motion", "world_transforms"]


@dataclass(frozen=True, eq=False)
class Motion:
    """A skeleton's motion; the content of one clip.

    Parameters
    ----------
    skeleton : Skeleton
        What moves.
    frame_time : float
        Seconds from one frame to the next.
    rotations : array_like, shape (n_frames, n_joints, 4)
        Local rotations: unit quaternions, xyzw.
    positions : array_like, shape (n_frames, n_joints, 3)
        Local translations in the file's unit: from the file's position channels, else the
        rest offset.
    channel_values : array_like, shape (n_frames, n_channels), optional
        The numbers of the file, in its own order and units (degrees). NaN where a number
        must be derived anew from the rotation or translation when it is written; the
        default is so everywhere.
    name : str
        What to call the motion; for a file its name without ending.
    path : Path, optional
        The file that it was read from.
    repairs : tuple of str
        What the reader tolerated in the file, each with its place.

    Raises
    ------
    ValueError
        If a shape does not fit the skeleton, a value is not finite, a quaternion is not of
        unit norm, or the frame time is not above 0.

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
    name: str = ""
    path: Path | None = None
    repairs: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        n_joints = self.skeleton.n_joints
        quats = as_quaternions("rotations", self.rotations, ("n_frames", n_joints))
        places = as_vectors("positions", self.positions, (len(quats), n_joints))
        if not len(quats):
            raise ValueError("rotations must hold at least one frame, got none")
        frame_time = float(as_floats("frame_time", self.frame_time, ()))
        if frame_time <= 0:
            raise ValueError(f"frame_time must be above 0 seconds, got {frame_time}")
        shape = (len(quats), self.skeleton.n_channels)
        if self.channel_values is not None and self.channel_values.shape != shape:
            got = self.channel_values.shape
            raise ValueError(f"channel_values must have shape {shape}, got {got}")
        for name, array in (("rotations", quats), ("positions", places)):
            view = array.view()
            make_read_only(view)
            object.__setattr__(self, name, view)
        if self.channel_values is not None:
            view = self.channel_values.view()
            make_read_only(view)
            object.__setattr__(self, "channel_values", view)
        object.__setattr__(self, "frame_time", frame_time)

    def __setstate__(self, state: dict[str, Any]) -> None:
        restore(self, state)

    def __repr__(self) -> str:
        joints = "1 joint" if self.n_joints == 1 else f"{self.n_joints} joints"
        frames = "1 frame" if self.n_frames == 1 else f"{self.n_frames} frames"
        name = f"{self.name}: " if self.name else ""
        return f"Motion({name}{joints}, {frames}, {self.rate:.6g} fps, {self.duration:.2f} s)"

    def __len__(self) -> int:
        return self.n_frames

    def _repr_html_(self) -> str:
        # Pages stand at the end of the way of the data: only notebooks need them here.
        from mograft.viewing.page import embedded  # layer exception: notebooks show a page

        return embedded(self)

    def __getitem__(self, frames: slice) -> "Motion":
        """Return a motion of those frames; a step keeps the time that they take."""
        if not isinstance(frames, slice):
            raise TypeError(f"frames must be a slice, as motion[100:400], got {frames!r}")
        step = 1 if frames.step is None else frames.step
        if step < 1:
            raise ValueError(f"the step must be 1 or more, got {step}")
        chosen = range(*frames.indices(self.n_frames))
        if not chosen:
            raise ValueError(f"motion[{frames.start}:{frames.stop}] holds no frame")
        values = self.channel_values
        return replace(
            self,
            frame_time=self.frame_time * step,
            rotations=self.rotations[frames],
            positions=self.positions[frames],
            channel_values=None if values is None else values[frames],
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
    def travels(self) -> BoolArray:
        """Which joints have a translation that varies, in their order."""
        varies: BoolArray = (self.positions != self.positions[0]).any(axis=(0, 2))
        return varies

    def world_transforms(self) -> tuple[FloatArray, FloatArray]:
        """Return rotations and positions of all joints in the world, by forward kinematics.

        Returns
        -------
        rotations : ndarray, shape (n_frames, n_joints, 4)
            Unit quaternions, xyzw.
        positions : ndarray, shape (n_frames, n_joints, 3)
            In the file's unit.
        """
        return world_transforms(self.skeleton, self.rotations, self.positions)

    def world_positions(self) -> FloatArray:
        """Return where the joints are in the world, shape (n_frames, n_joints, 3)."""
        return self.world_transforms()[1]

    def resample(self, rate: float) -> "Motion":
        """Return the motion at another frame rate, by cubics on the sphere.

        Parameters
        ----------
        rate : float
            Frames per second.

        Returns
        -------
        Motion
            Of the same duration exactly: its frame time is the duration over the nearest
            whole number of intervals, so its rate may differ a little from the one wanted.

        Raises
        ------
        ValueError
            If the rate is not above 0, or so high that memory does not hold the frames.
        """
        wanted = float(as_floats("rate", rate, ()))
        if wanted <= 0:
            raise ValueError(f"rate must be above 0 frames per second, got {wanted}")
        if self.duration * wanted >= 2**53:
            raise ValueError(f"rate must be one whose frames can be counted, got {wanted:g}")
        intervals = max(round(self.duration * wanted), 1)
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
        """Return the joint that carries the body through the world.

        That is the first whose translation varies: in some files the file's own root is a
        dummy that never moves. The file's root where none does.
        """
        moving = np.flatnonzero(self.travels)
        return int(moving[0]) if len(moving) else 0

    def channel_numbers(self) -> FloatArray:
        """Return the numbers that the motion has in a file.

        Returns
        -------
        ndarray, shape (n_frames, n_channels)
            In the order and units of the file (degrees): those read where they are known,
            the others derived from rotations and translations, each angle as near to the
            frame before as can be.
        """
        n_frames, skeleton = self.n_frames, self.skeleton
        known = self.channel_values
        numbers = (
            np.full((n_frames, skeleton.n_channels), np.nan) if known is None else known.copy()
        )
        missing = set(np.flatnonzero(np.isnan(numbers).any(axis=0)).tolist())
        for joint, columns in enumerate(skeleton.channel_columns):
            if missing.isdisjoint(columns):
                continue
            names = skeleton.channels[joint]
            for column, name in zip(columns, names, strict=True):
                if name.endswith("position"):
                    own = self.positions[:, joint, "XYZ".index(name[0])]
                    numbers[:, column] = np.where(
                        np.isnan(numbers[:, column]), own, numbers[:, column]
                    )
            turns = [c for c, name in zip(columns, names, strict=True) if name.endswith("rotation")]
            if turns:
                order = skeleton.rotation_order(joint)
                numbers[:, turns] = _fill_angles(numbers[:, turns], self.rotations[:, joint], order)
        return numbers


def world_transforms(
    skeleton: Skeleton, rotations: FloatArray, positions: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return what `Motion.world` does, of local rotations and positions that are no motion.

    Parameters
    ----------
    skeleton : Skeleton
        Whose joints they are.
    rotations : ndarray, shape (n, n_joints, 4)
        Local rotations, each row a pose; taken as they are.
    positions : ndarray, shape (n, n_joints, 3)
        Local positions.

    Returns
    -------
    rotations, positions : ndarray
        Of the same shapes, in the world.
    """
    return _core.world(
        skeleton.parents, np.ascontiguousarray(rotations), np.ascontiguousarray(positions)
    )


def _fill_angles(angles: FloatArray, quats: FloatArray, order: str) -> FloatArray:
    """Derive missing Euler angles in degrees, run by run of frames, each near the one before."""
    filled = angles.copy()
    unknown = np.isnan(angles).any(axis=1)
    edges = np.flatnonzero(np.diff(unknown, prepend=False, append=False))
    for start, stop in edges.reshape(-1, 2):
        near = np.zeros(3)
        if start > 0:
            near[: len(order)] = np.radians(filled[start - 1])
        elif stop < len(filled):
            near[: len(order)] = np.radians(filled[stop])
        filled[start:stop] = np.degrees(rotations.to_euler(quats[start:stop], order, near))
    return filled
