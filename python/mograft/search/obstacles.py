"""Obstacles: spheres, capsules, boxes, half-spaces and other characters.

Positions and sizes are in the unit of the file.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from mograft._util.arrays import FloatArray, IntArray, as_floats
from mograft._util.validate import check_finite, check_not_negative, check_type, coerce_vector
from mograft.body.capsules import Poses, box_clearance, capsules, clearance
from mograft.body.mass import up_axis
from mograft.motion import rotations
from mograft.motion.motion import Motion

Vector = tuple[float, float, float]


class Obstacle(Protocol):
    """An object whose distance from a body can be computed."""

    def distances(self, poses: Poses, capsule_indices: IntArray) -> tuple[FloatArray, IntArray]:
        """Return for each pose the distance to the nearest capsule, and the index of this capsule.

        `capsule_indices` selects the capsules. Distances, shape (n,), are in the unit of the file;
        they are minus the penetration depth if the capsule penetrates the object. Ties go to the
        first capsule. Without capsules the distance is infinite and the index -1.
        """


@dataclass(frozen=True)
class Sphere:
    """A sphere.

    Parameters
    ----------
    center : tuple of float
        Centre, in the unit of the file.
    radius : float
        Radius, in the unit of the file.

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

    def distances(self, poses: Poses, capsule_indices: IntArray) -> tuple[FloatArray, IntArray]:
        """Return distances from this obstacle; see `Obstacle.distances`."""
        return Capsule(self.center, self.center, self.radius).distances(poses, capsule_indices)


@dataclass(frozen=True)
class Capsule:
    """A cylinder with hemispherical ends.

    Parameters
    ----------
    start, stop : tuple of float
        Ends of the axis, in the unit of the file.
    radius : float
        Radius, in the unit of the file.

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

    def distances(self, poses: Poses, capsule_indices: IntArray) -> tuple[FloatArray, IntArray]:
        """Return distances from this obstacle; see `Obstacle.distances`."""
        ends = np.array([[[self.start, self.stop]]], float)
        return _nearest(poses, capsule_indices, ends, np.array([self.radius], float), None)


@dataclass(frozen=True)
class Box:
    """A box of any orientation.

    Parameters
    ----------
    center : tuple of float
        Centre, in the unit of the file.
    half : tuple of float
        Half the length along each axis of the box, in the unit of the file.
    rotation : tuple of float
        Orientation as a unit quaternion, xyzw. Default: aligned with the world axes.

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
            raise ValueError(f"`half` must not be negative, got {self.half}")
        quat = as_floats("rotation", self.rotation, (4,))
        if abs(np.linalg.norm(quat) - 1) > 1e-6:
            raise ValueError(f"`rotation` must be a unit quaternion, got {self.rotation}")
        object.__setattr__(self, "rotation", tuple(quat.tolist()))

    def distances(self, poses: Poses, capsule_indices: IntArray) -> tuple[FloatArray, IntArray]:
        """Return distances from this obstacle; see `Obstacle.distances`."""
        ends, radii = poses.ends[:, capsule_indices], poses.capsules.radii[capsule_indices]
        box = (np.array(own, float) for own in (self.center, self.half, self.rotation))
        return _minimum(box_clearance(ends, radii, *box), capsule_indices)


@dataclass(frozen=True)
class HalfSpace:
    """The half-space behind a plane, such as a wall or the floor.

    Parameters
    ----------
    point : tuple of float
        A point of the plane, in the unit of the file.
    normal : tuple of float
        Normal that points to the free side; of any length above 0.

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
            raise ValueError("`normal` must not be zero")

    def distances(self, poses: Poses, capsule_indices: IntArray) -> tuple[FloatArray, IntArray]:
        """Return distances from this obstacle; see `Obstacle.distances`."""
        normal = np.array(self.normal, float) / np.linalg.norm(self.normal)
        heights = (poses.ends[:, capsule_indices] - np.array(self.point, float)) @ normal
        radii = poses.capsules.radii[capsule_indices]
        return _minimum(heights.min(axis=2) - radii, capsule_indices)


@dataclass(frozen=True, eq=False)
class Character:
    """Another moving character.

    Parameters
    ----------
    motion : Motion
        Motion of the character, on any skeleton. Before the first frame the character holds the
        pose of that frame, after the last frame the last pose.
    offset : tuple of float
        Translation, in the unit of the file.
    yaw : float
        Rotation about the vertical axis before the translation, in radians.
    delay : float
        Seconds after the start of the base motion at which the character starts.
    radius : float
        Factor by which the capsule radii of the character are multiplied.

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
    def _capsule_ends_and_radii(self) -> tuple[FloatArray, FloatArray]:
        shape = capsules(self.motion.skeleton)
        ends = shape.ends(*self.motion.world_transforms())
        axis = np.zeros(3)
        axis[up_axis(self.motion)] = 1.0
        quat = np.broadcast_to(rotations.exp(self.yaw * axis), (*ends.shape[:-1], 4))
        moved = rotations.rotate(quat, ends) + np.array(self.offset, float)
        return moved, shape.radii * self.radius

    def distances(self, poses: Poses, capsule_indices: IntArray) -> tuple[FloatArray, IntArray]:
        """Return distances from this obstacle; see `Obstacle.distances`."""
        ends, radii = self._capsule_ends_and_radii
        seconds = poses.frames * poses.frame_time - self.delay
        at = np.round(seconds / self.motion.frame_time).astype(np.int64)
        return _nearest(poses, capsule_indices, ends, radii, at.clip(0, self.motion.n_frames - 1))


def _nearest(
    poses: Poses,
    capsule_indices: IntArray,
    others: FloatArray,
    radii: FloatArray,
    at: IntArray | None,
) -> tuple[FloatArray, IntArray]:
    first, second = np.meshgrid(capsule_indices, np.arange(len(radii)), indexing="ij")
    pairs = np.column_stack([first.ravel(), second.ravel()])
    distance, which = clearance(poses.ends, poses.capsules.radii, others, radii, at, pairs)
    return distance, which[:, 0]


def _minimum(distances: FloatArray, capsule_indices: IntArray) -> tuple[FloatArray, IntArray]:
    """Return the smallest distance in each pose and the index of its capsule.

    `distances` has shape (n_poses, n_capsules); `capsule_indices` are the indices of its columns.
    """
    if not len(capsule_indices):
        return np.full(len(distances), np.inf), np.full(len(distances), -1)
    nearest = distances.argmin(axis=1)
    return distances[np.arange(len(distances)), nearest], capsule_indices[nearest]
