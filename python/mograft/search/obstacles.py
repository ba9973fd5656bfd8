"""Things in the world that a body can be near to: balls, poles, boxes, walls, somebody else.

Places and sizes are in the file's unit.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from mograft._util.arrays import FloatArray, IntArray, as_floats
from mograft._util.validate import check_finite, check_not_negative, check_type, coerce_vector
from mograft.body.capsules import box_clearance, capsules, clearance
from mograft.body.mass import up_axis
from mograft.body.world_poses import Poses
from mograft.motion import rotations
from mograft.motion.motion import Motion

__all__ = ["Box", "Capsule", "Character", "HalfSpace", "Obstacle", "Sphere", "Vector"]

Vector = tuple[float, float, float]


class Obstacle(Protocol):
    """Something that a body can be near to."""

    def distances(self, poses: Poses, counted: IntArray) -> tuple[FloatArray, IntArray]:
        """Return for each pose how far the nearest of some capsules is, and which that is."""
        ...


@dataclass(frozen=True)
class Sphere:
    """A ball.

    Parameters
    ----------
    center : tuple of float
        Its middle, in the file's unit.
    radius : float
        In the file's unit.

    Examples
    --------
    >>> Sphere((0, 100, 50), 30)
    Sphere(center=(0.0, 100.0, 50.0), radius=30)
    """

    center: Vector
    radius: float

    def __post_init__(self) -> None:
        coerce_vector(self, "center")
        check_not_negative(self, "radius")

    def distances(self, poses: Poses, counted: IntArray) -> tuple[FloatArray, IntArray]:
        """As `Obstacle.distances`."""
        ends = np.array([[[self.center, self.center]]], float)
        return _nearest(poses, counted, ends, np.array([self.radius], float), None)


@dataclass(frozen=True)
class Capsule:
    """A pole with round ends.

    Parameters
    ----------
    start, stop : tuple of float
        The ends of its axis, in the file's unit.
    radius : float
        In the file's unit.

    Examples
    --------
    >>> Capsule((0, 0, 50), (0, 200, 50), 10).radius
    10
    """

    start: Vector
    stop: Vector
    radius: float

    def __post_init__(self) -> None:
        coerce_vector(self, "start")
        coerce_vector(self, "stop")
        check_not_negative(self, "radius")

    def distances(self, poses: Poses, counted: IntArray) -> tuple[FloatArray, IntArray]:
        """As `Obstacle.distances`."""
        ends = np.array([[[self.start, self.stop]]], float)
        return _nearest(poses, counted, ends, np.array([self.radius], float), None)


@dataclass(frozen=True)
class Box:
    """A box, turned as one likes.

    Parameters
    ----------
    center : tuple of float
        Its middle, in the file's unit.
    half : tuple of float
        Half of its length along each of its own axes.
    rotation : tuple of float
        A unit quaternion, xyzw. Default: along the axes of the world.

    Examples
    --------
    >>> Box((0, 50, 80), half=(40, 50, 20)).half
    (40.0, 50.0, 20.0)
    """

    center: Vector
    half: Vector
    rotation: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)

    def __post_init__(self) -> None:
        coerce_vector(self, "center")
        coerce_vector(self, "half")
        if min(self.half) < 0:
            raise ValueError(f"half must not be negative, got {self.half}")
        turn = as_floats("rotation", self.rotation, (4,))
        if abs(np.linalg.norm(turn) - 1) > 1e-6:
            raise ValueError(f"rotation must be a unit quaternion, got {self.rotation}")

    def distances(self, poses: Poses, counted: IntArray) -> tuple[FloatArray, IntArray]:
        """As `Obstacle.distances`."""
        apart = box_clearance(
            poses.ends[:, counted],
            poses.capsules.radii[counted],
            np.array(self.center, float),
            np.array(self.half, float),
            np.array(self.rotation, float),
        )
        return _least(apart, counted)


@dataclass(frozen=True)
class HalfSpace:
    """All that is behind a plane, such as a wall or the floor.

    Parameters
    ----------
    point : tuple of float
        A point of the plane, in the file's unit.
    normal : tuple of float
        Points to where the body may be; of any length.

    Examples
    --------
    >>> HalfSpace(point=(0, 0, 120), normal=(0, 0, -1)).normal  # a wall in front
    (0.0, 0.0, -1.0)
    """

    point: Vector
    normal: Vector

    def __post_init__(self) -> None:
        coerce_vector(self, "point")
        coerce_vector(self, "normal")
        if not any(self.normal):
            raise ValueError("normal must not be zero")

    def distances(self, poses: Poses, counted: IntArray) -> tuple[FloatArray, IntArray]:
        """As `Obstacle.distances`."""
        normal = np.array(self.normal, float) / np.linalg.norm(self.normal)
        above = (poses.ends[:, counted] - np.array(self.point, float)) @ normal
        return _least(above.min(axis=2) - poses.capsules.radii[counted], counted)


@dataclass(frozen=True, eq=False)
class Character:
    """Somebody else who moves.

    Parameters
    ----------
    motion : Motion
        What they do, on a skeleton of their own. Before and after it they stand still.
    offset : tuple of float
        Where they are moved to, in the file's unit.
    yaw : float
        By what angle they are turned about the upward axis of the world first, in radians.
    delay : float
        How many seconds after the base motion they begin.
    radius : float
        Factor on the radii of their capsules.

    Examples
    --------
    >>> from mograft.dancer import dance
    >>> Character(dance(seed=1, strides=1).motion, offset=(80, 0, 0), yaw=3.14).offset
    (80.0, 0.0, 0.0)
    """

    motion: Motion
    offset: Vector = (0.0, 0.0, 0.0)
    yaw: float = 0.0
    delay: float = 0.0
    radius: float = 1.0

    def __post_init__(self) -> None:
        check_type("motion", self.motion, Motion)
        coerce_vector(self, "offset")
        check_not_negative(self, "radius")
        for name in ("yaw", "delay"):
            check_finite(self, name)

    @cached_property
    def _flesh(self) -> tuple[FloatArray, FloatArray]:
        own = capsules(self.motion.skeleton)
        ends = own.ends(*self.motion.world_transforms())
        axis = np.zeros(3)
        axis[up_axis(self.motion)] = 1.0
        turn = np.broadcast_to(rotations.exp(self.yaw * axis), (*ends.shape[:-1], 4))
        return rotations.rotate(turn, ends) + np.array(self.offset, float), own.radii * self.radius

    def distances(self, poses: Poses, counted: IntArray) -> tuple[FloatArray, IntArray]:
        """As `Obstacle.distances`."""
        ends, radii = self._flesh
        seconds = poses.frames * poses.frame_time - self.delay
        at = np.round(seconds / self.motion.frame_time).astype(np.int64)
        return _nearest(poses, counted, ends, radii, at.clip(0, self.motion.n_frames - 1))


def _nearest(
    poses: Poses, counted: IntArray, others: FloatArray, radii: FloatArray, at: IntArray | None
) -> tuple[FloatArray, IntArray]:
    pairs = np.stack([np.repeat(counted, len(radii)), np.tile(np.arange(len(radii)), len(counted))])
    distance, which = clearance(poses.ends, poses.capsules.radii, others, radii, at, pairs.T)
    return distance, which[:, 0]


def _least(apart: FloatArray, counted: IntArray) -> tuple[FloatArray, IntArray]:
    if not len(counted):
        return np.full(len(apart), np.inf), np.full(len(apart), -1)
    nearest = apart.argmin(axis=1)
    return apart[np.arange(len(apart)), nearest], counted[nearest]
