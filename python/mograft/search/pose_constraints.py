"""Constraints on the poses of a new motion: collisions, targets, view directions, regions."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray, IntArray, as_floats
from mograft._util.validate import (
    as_integer,
    check_finite,
    check_not_negative,
    check_positive,
    coerce_vector,
)
from mograft.body.anatomy import find_joint
from mograft.body.capsules import Capsules, Poses, clearance
from mograft.body.mass import mass_model, up_axis
from mograft.motion import rotations
from mograft.motion.motion import Motion
from mograft.motion.skeleton import Skeleton
from mograft.search.constraints import Constraint, Errors, no_errors
from mograft.search.figure_position import FigurePosition, facing_direction
from mograft.search.obstacles import Obstacle, Vector


@dataclass(frozen=True, kw_only=True)
class PoseConstraint(Constraint):
    """Base class of constraints on poses."""

    def errors(self, poses: Poses, joints: BoolArray | None = None) -> Errors:
        """As `Constraint.errors`; computed only in the frames in which the constraint applies."""
        applies = self.applies(poses.frames)
        if applies.all():
            return self._applied_errors(poses, joints)
        error, joint = no_errors(poses)
        if applies.any():
            error[applies], joint[applies] = self._applied_errors(poses[applies], joints)
        return error, joint

    def _applied_errors(self, poses: Poses, joints: BoolArray | None) -> Errors:
        """As `Constraint.errors`, for poses in frames in which the constraint applies."""
        raise NotImplementedError


@dataclass(frozen=True)
class Avoid(PoseConstraint):
    """Keep the whole body out of an obstacle.

    Parameters
    ----------
    obstacle : Obstacle
        A `Sphere`, `Capsule`, `Box`, `HalfSpace` or `Character`.
    tolerance : float
        Allowed penetration depth, in skeleton heights.
    margin : float
        Additional distance to keep, in skeleton heights.

    Examples
    --------
    >>> from mograft.search.obstacles import HalfSpace
    >>> floor = HalfSpace((0, 0, 0), (0, 1, 0))
    >>> Avoid(floor, tolerance=0.02).is_hard
    True
    >>> Avoid(floor, weight=2.0, frames=(0, 60)).is_hard  # soft, for the first 2 s at 30 fps
    False
    """

    obstacle: Obstacle
    tolerance: float = 0.005
    margin: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        _check_obstacle("obstacle", self.obstacle)
        check_finite(self, "margin")
        check_positive(self, "tolerance")

    def _applied_errors(self, poses: Poses, joints: BoolArray | None) -> Errors:
        distance, which = self.obstacle.distances(poses, _capsules_of(poses.capsules, joints))
        depth = self.margin * poses.height - distance
        error = np.maximum(depth, 0.0) / (self.tolerance * poses.height)
        return error, np.where(which >= 0, poses.capsules.joints[which], -1)

    def describe_error(self, error: float, height: float) -> str:
        """As `Constraint.describe_error`."""
        depth, limit = error * self.tolerance, self.tolerance
        return (
            f"penetration depth {depth:.3f} heights ({depth * height:.3g} in the unit of the "
            f"file), tolerance {limit:.3f}"
        )


@dataclass(frozen=True)
class AvoidSelf(PoseConstraint):
    """Keep hands and forearms out of the trunk, the head, the thighs and each other.

    Parameters
    ----------
    tolerance : float
        Allowed penetration depth in addition to `captured`, in skeleton heights.
    captured : float
        Largest depth of self-collision in the captured motion, in skeleton heights: capsules
        overlap if, for example, a hand touches a hip. If it is 0, `mograft.graft` computes it.

    Examples
    --------
    >>> AvoidSelf().describe_error(4.0, height=180.0)
    'self-collision 0.020 heights deeper than captured, tolerance 0.005'
    """

    tolerance: float = 0.005
    captured: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        check_positive(self, "tolerance")
        check_not_negative(self, "captured")

    def _applied_errors(self, poses: Poses, joints: BoolArray | None) -> Errors:
        capsules = poses.capsules
        pairs = capsules.self_collision_pairs
        if joints is not None:
            pairs = pairs[joints[capsules.joints[pairs[:, 0]]]]
        distance, which = clearance(
            poses.ends, capsules.radii, poses.ends, capsules.radii, np.arange(len(poses)), pairs
        )
        depth = -distance - self.captured * poses.height
        error = np.maximum(depth, 0.0) / (self.tolerance * poses.height)
        return error, np.where(which[:, 0] >= 0, capsules.joints[which[:, 0]], -1)

    def self_collision_depth(self, poses: Poses) -> float:
        """Return the largest depth of self-collision over all poses, in skeleton heights."""
        error, _ = AvoidSelf(tolerance=1.0).errors(poses)
        return float(error.max(initial=0.0))

    def describe_error(self, error: float, height: float) -> str:
        """As `Constraint.describe_error`."""
        depth, limit = error * self.tolerance, self.tolerance
        return f"self-collision {depth:.3f} heights deeper than captured, tolerance {limit:.3f}"


@dataclass(frozen=True)
class Reach(PoseConstraint):
    """Bring a joint to a position at a frame, or hold it there.

    If donors bring an exchanged hand or foot near the target, inverse kinematics moves it to the
    target itself: see `Config.reach_ik`.

    Parameters
    ----------
    joint : str
        Name of the joint.
    target : tuple of float or FigurePosition
        World position, in the unit of the file, or a position relative to the figure.
    frame : int, optional
        The frame of the base motion; `frames` gives a range of frames instead.
    tolerance : float
        Allowed distance from the target, in skeleton heights.

    Raises
    ------
    ValueError
        If neither `frame` nor `frames` is given, or if `frames` contains other frames than `frame`.

    Examples
    --------
    >>> Reach("LeftHand", (30, 140, 20), frame=120).describe_error(2.0, height=180.0)
    'LeftHand is 0.060 heights (10.8 in the unit of the file) from the target, tolerance 0.030'
    """

    joint: str
    target: Vector | FigurePosition
    frame: int | None = None
    tolerance: float = 0.03

    def __post_init__(self) -> None:
        super().__post_init__()
        if not isinstance(self.target, FigurePosition):
            coerce_vector(self, "target")
        check_positive(self, "tolerance")
        if self.frame is not None:
            frame = as_integer("frame", self.frame)
            if self.frames not in (None, (frame, frame)):
                raise ValueError("`frame` and `frames` must not both be given")
            object.__setattr__(self, "frame", frame)
            object.__setattr__(self, "frames", (frame, frame))
        elif self.frames is None:
            raise ValueError("`frame` or `frames` must be given, got neither")

    def _applied_errors(self, poses: Poses, joints: BoolArray | None) -> Errors:
        at = find_joint(poses.skeleton, self.joint)
        if joints is not None and not joints[at]:
            return no_errors(poses)
        targets = self._locate(poses.skeleton, poses.positions, lambda: poses.up)
        distance = np.linalg.norm(poses.positions[:, at] - targets, axis=1)
        return distance / (self.tolerance * poses.height), np.full(len(poses), at)

    def targets(self, motion: Motion) -> FloatArray:
        """Return the target in each frame of a motion in which the constraint applies, (n, 3)."""
        first, last = self.frames or (0, motion.n_frames)
        positions = motion[first : last + 1].world_positions()
        return self._locate(motion.skeleton, positions, lambda: up_axis(motion))

    def _locate(
        self, skeleton: Skeleton, positions: FloatArray, find_up: Callable[[], int]
    ) -> FloatArray:
        if isinstance(self.target, FigurePosition):
            return self.target.locate(skeleton, positions, find_up())
        return np.broadcast_to(np.array(self.target), (len(positions), 3))

    def describe_error(self, error: float, height: float) -> str:
        """As `Constraint.describe_error`."""
        distance = error * self.tolerance
        return (
            f"{self.joint} is {distance:.3f} heights ({distance * height:.3g} in the unit of the "
            f"file) from the target, tolerance {self.tolerance:.3f}"
        )


@dataclass(frozen=True)
class Face(PoseConstraint):
    """Turn the view direction of a joint towards a position.

    In the rest pose, the view direction is the direction that the body faces.

    Parameters
    ----------
    target : tuple of float
        World position, in the unit of the file.
    joint : str, optional
        The joint to turn. Default: the head.
    tolerance : float
        Allowed angle between view direction and target, in radians. Default: 20°.

    Examples
    --------
    >>> Face((0, 150, 300), frames=(30, 60)).describe_error(1.5, height=180.0)
    'view direction 30.0° off the target, tolerance 20.0°'
    """

    target: Vector
    joint: str | None = None
    tolerance: float = float(np.radians(20.0))

    def __post_init__(self) -> None:
        super().__post_init__()
        coerce_vector(self, "target")
        check_positive(self, "tolerance")

    def _applied_errors(self, poses: Poses, joints: BoolArray | None) -> Errors:
        skeleton = poses.skeleton
        at = mass_model(skeleton).head if self.joint is None else find_joint(skeleton, self.joint)
        if at is None:
            raise ValueError("`joint` must be given: the skeleton has no head")
        if joints is not None and not joints[at]:
            return no_errors(poses)
        forward = np.broadcast_to(_rest_forward(poses.skeleton, poses.up), (len(poses), 3))
        view = rotations.rotate(poses.rotations[:, at], forward)
        to_target = np.array(self.target) - poses.positions[:, at]
        sine = np.linalg.norm(np.cross(view, to_target), axis=1)
        angle = np.arctan2(sine, (view * to_target).sum(axis=1))
        return angle / self.tolerance, np.full(len(poses), at)

    def describe_error(self, error: float, height: float) -> str:
        """As `Constraint.describe_error`."""
        angle, limit = np.degrees([error * self.tolerance, self.tolerance])
        return f"view direction {angle:.1f}° off the target, tolerance {limit:.1f}°"


@dataclass(frozen=True)
class KeepOut(PoseConstraint):
    """Keep one joint outside or inside a region.

    Parameters
    ----------
    joint : str
        Name of the joint, which is treated as a point.
    region : Obstacle
        A `Sphere`, `Capsule`, `Box` or `HalfSpace`.
    inside : bool
        If True, the joint must be inside the region.
    tolerance : float
        Allowed distance from the surface on the wrong side, in skeleton heights.

    Examples
    --------
    >>> from mograft.search.obstacles import Sphere
    >>> KeepOut("LeftHand", Sphere((0, 100, 0), 30)).describe_error(4.0, height=180.0)
    'LeftHand is 0.020 heights inside, tolerance 0.005'
    """

    joint: str
    region: Obstacle
    inside: bool = False
    tolerance: float = 0.005

    def __post_init__(self) -> None:
        super().__post_init__()
        _check_obstacle("region", self.region)
        check_positive(self, "tolerance")

    def _applied_errors(self, poses: Poses, joints: BoolArray | None) -> Errors:
        at = find_joint(poses.skeleton, self.joint)
        if joints is not None and not joints[at]:
            return no_errors(poses)
        joint, bones, radii = np.array([at]), np.zeros((1, 3)), np.zeros(1)
        point = Capsules(joints=joint, parts=("",), sides=("",), bones=bones, radii=radii)
        distance, _ = self.region.distances(replace(poses, capsules=point), np.array([0]))
        depth = distance if self.inside else -distance
        error = np.maximum(depth, 0.0) / (self.tolerance * poses.height)
        return error, np.full(len(poses), at)

    def describe_error(self, error: float, height: float) -> str:
        """As `Constraint.describe_error`."""
        where, depth = "outside" if self.inside else "inside", error * self.tolerance
        return f"{self.joint} is {depth:.3f} heights {where}, tolerance {self.tolerance:.3f}"


@dataclass(frozen=True)
class Custom(PoseConstraint):
    """A constraint that a function defines.

    Parameters
    ----------
    function : callable
        Takes `Poses` of n frames and returns n errors: at most 1 for an accepted pose, and
        increasing with the violation. Errors below 0 count as 0.
    name : str
        Name in messages.
    joint : str, optional
        The joint that causes the error; only its group is searched. Default: all groups.

    Examples
    --------
    >>> low = Custom(lambda poses: poses.positions[:, 0, 1] / 60.0, "hips below 60")
    >>> low.is_hard
    True
    """

    function: Callable[[Poses], FloatArray]
    name: str = "custom"
    joint: str | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if not callable(self.function):
            raise TypeError(f"`function` must be callable, got {self.function!r}")

    def _applied_errors(self, poses: Poses, joints: BoolArray | None) -> Errors:
        at = -1 if self.joint is None else find_joint(poses.skeleton, self.joint)
        if joints is not None and at >= 0 and not joints[at]:
            return no_errors(poses)
        label = f"result of {self.name}"
        error = np.maximum(as_floats(label, self.function(poses), (len(poses),)), 0.0)
        return error, np.full(len(poses), at)

    def describe_error(self, error: float, height: float) -> str:
        """As `Constraint.describe_error`."""
        return f"{self.name}: {error:.3g} tolerances"


def with_captured_depth(constraints: Sequence[Constraint], captured: Poses) -> list[Constraint]:
    """Return the constraints; every `AvoidSelf.captured` that is 0 is replaced by a measured depth.

    The depth is the largest one in `captured`, the captured poses of all frames whose donors are
    chosen together: the whole base motion in a graft, one base segment in a stream.
    """
    return [
        replace(constraint, captured=constraint.self_collision_depth(captured))
        if isinstance(constraint, AvoidSelf) and constraint.captured == 0
        else constraint
        for constraint in constraints
    ]


def anchor_reaches(constraints: Sequence[Constraint], motion: Motion) -> list[Constraint]:
    """Return the constraints; a `Reach` relative to its own joint gets a position in the world.

    It is relative to the place of the joint in `motion`, at the first frame of the `Reach`.
    """
    return [
        replace(own, target=tuple(own.targets(motion)[0].tolist()))
        if isinstance(own, Reach)
        and isinstance(own.target, FigurePosition)
        and own.target.part == own.joint
        and (own.frames or (0,))[0] < motion.n_frames
        else own
        for own in constraints
    ]


def _capsules_of(capsules: Capsules, joints: BoolArray | None) -> IntArray:
    """Return the indices of the capsules of the joints in a mask; None means all joints."""
    return np.flatnonzero(np.ones(len(capsules)) if joints is None else joints[capsules.joints])


def _rest_forward(skeleton: Skeleton, up: int) -> FloatArray:
    """Return the direction that the body faces in the rest pose, as a unit vector.

    `up` is the index of the vertical axis.
    """
    known, rest = mass_model(skeleton), skeleton.rest_positions()
    top = rest[known.hips if known.head is None else known.head]
    feet = [foot.ankle for foot in known.feet]
    is_upright = not feet or top[up] >= rest[feet].mean(axis=0)[up]
    return facing_direction(skeleton, rest, np.eye(3)[up] * (1.0 if is_upright else -1.0))


def _check_obstacle(name: str, value: object) -> None:
    if not callable(getattr(value, "distances", None)):
        expected = "an obstacle such as Sphere, Capsule or Box"
        raise TypeError(f"`{name}` must be {expected}, got {value!r}")
